"""Every setting of the package: one frozen struct per part, units in the names, read from and written to TOML.

Unknown keys and values out of range are ConfigErrors that name the setting. The defaults are one configuration for all
logs.
"""

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from .errors import ConfigError
from .inputs import LIMITS, parse_toml, read_small
from .wording import expected, invalid_setting

if TYPE_CHECKING:
    from .camera.rig import MonoRig, StereoRig

Rig = TypeVar("Rig", "StereoRig", "MonoRig", "StereoRig | MonoRig")
_FRAME_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/]{0,99}")
_FRAMES = {"world_frame": "map", "odom_frame": "odom", "base_frame": "base_link", "camera_frame": "left_camera"}


def _number(description: str, least: float, most: float) -> Meta:
    """What a number means, and its ends, which are accepted."""
    return Meta(description=description, ge=least, le=most)


def _expert(description: str, least: float, most: float) -> Meta:
    """The same of a setting that few runs need, which is printed in a section such as [expert.frontend]."""
    return Meta(description=description, ge=least, le=most, extra={"expert": True})


class _Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The base of all sections; every value is checked when a section is made, in Python or from a file."""

    def __post_init__(self) -> None:
        for field in msgspec.structs.fields(self):
            value = getattr(self, field.name)
            given = f"{type(self).__name__}({field.name}={value!r})"
            if isinstance(field.default, _Section):
                kind = type(field.default)
                if not isinstance(value, kind):
                    example = f"{kind.__name__}({kind.__struct_fields__[0]}={kind.__struct_defaults__[0]!r})"
                    raise ConfigError(f"{given}: give a {kind.__name__}, as in {field.name}={example}")
                continue
            try:
                msgspec.convert(value, field.type)
            except msgspec.ValidationError as error:
                raise ConfigError(f"{given}: give {expected(str(error))}", hint=("config_to_toml",)) from None


class FrontendConfig(_Section, frozen=True, kw_only=True):
    """Detection, left-right matching, tracking."""

    # Chosen by hand: cost grows with the number; 240 instead of 200 gains little accuracy on our logs.
    max_tracks: Annotated[int, _number("most points tracked at the same time", 20, 2000)] = 200
    # Chosen by hand: less means a search for corners in more frames, more leaves parts of the view without points.
    renew_fraction: Annotated[float, _expert("start new tracks once this share of max_tracks is missing", 0, 1)] = (
        0.05
    )
    # Chosen by hand: patches overlap by half at most, so that their errors differ.
    min_corner_distance_px: Annotated[float, _expert("least distance of a new corner from all points", 2, 200)] = (
        12.0
    )
    # Chosen by hand: lower means points in weak texture, whose covariance is large. Dark images are given a lower one.
    min_corner_response: Annotated[
        float, _expert("least eigenvalue of a corner's gradients, as OpenCV", 1e-8, 1)
    ] = 2e-4
    # Measured, together with templates anchored in the first frame of a point: aligned ATE of a rendered log, by full
    # batch adjustment, 35 mm -> 2.3 mm.
    smoothing_px: Annotated[float, _expert("σ of the Gaussian that smooths images first, pixels", 0, 5)] = 1.0
    # Chosen by hand: more pixels are less noise, but more of them across a depth edge. Radii nearby do as well.
    window_radius_px: Annotated[int, _expert("half width of the tracked patch, pixels", 3, 30)] = 10
    # Measured: starts are predicted, more levels change no figure of the logs with ground truth.
    pyramid_levels: Annotated[int, _expert("level at which flow starts; it ends at level 1", 1, 8)] = 2
    # Measured: where frames are far apart, starts predicted from uncertain depths are off by that much. Of a drive at
    # every fourth frame 1.5 px lost a third of the tracks (t_rel 1.8 % instead of 1.6); calm logs change nothing.
    max_realignment_px: Annotated[float, _expert("largest step of the alignment from its start", 0.1, 50)] = 4.0
    # Twice the 0.8 px that the worst calibration met was off in the corners; what is learnt narrows it.
    max_vertical_disparity_px: Annotated[float, _expert("largest row difference of left and right", 0.1, 50)] = 1.5
    # Chosen by hand, many times a sensor's noise: it refuses patches that show something else.
    max_photometric_error: Annotated[float, _expert("largest deviation of a patch, grey values", 1, 255)] = 20.0
    # Chosen by hand: the nearest depth is f·B over so much of the width; a wider search costs time and finds rivals.
    max_disparity_fraction: Annotated[float, _number("largest disparity, share of the image's width", 0.01, 1)] = (
        0.25
    )


class WindowConfig(_Section, frozen=True, kw_only=True):
    """The cross-frame estimator."""

    frames: Annotated[int, _number("frames in the window (batch size b in the paper)", 1, 64)] = 8
    max_iterations: Annotated[int, _expert("Gauss-Newton steps per frame, at most", 1, 50)] = 6


class RobustConfig(_Section, frozen=True, kw_only=True):
    """Outliers and lost frames, for every estimator."""

    gate_probability: Annotated[
        float, _expert("share of good views that the χ² gate keeps", 0.5, 0.999999999999)
    ] = 0.999
    min_inliers: Annotated[int, _number("a frame with fewer accepted views is lost", 4, 2000)] = 8
    degraded_inliers: Annotated[int, _number("a frame with fewer accepted views is degraded", 4, 2000)] = 25


class MotionConfig(_Section, frozen=True, kw_only=True):
    """The camera's motion while tracking is lost."""

    std_acceleration_m_s2: Annotated[
        float, _number("σ of the acceleration while tracking is lost, m/s²", 1e-3, 1e4)
    ] = 3.0
    std_angular_acceleration_rad_s2: Annotated[
        float, _number("σ of the angular acceleration, rad/s²", 1e-3, 1e4)
    ] = 3.0

    @property
    def std_acceleration(self) -> tuple[float, ...]:
        """σ (6,) of the acceleration about each axis, m/s², and of the angular one, rad/s²."""
        return 3 * (self.std_acceleration_m_s2,) + 3 * (self.std_angular_acceleration_rad_s2,)


class RigConfig(_Section, frozen=True, kw_only=True):
    """Errors of the calibration, and what is known of them beforehand."""

    # For rendered or simulated images, and to compare with an estimate that does not refine the calibration.
    exact: Annotated[bool, Meta(description="take the calibration as exact")] = False
    # Five real rigs are off by 0.05 to 1.1 px per term.
    std_disparity_px: Annotated[float, _expert("σ of each term of the disparity's error at the edge", 1e-3, 10)] = (
        0.4
    )
    # Of five real rigs one is off by 6 to 15 px in the corner, where no point is, the others by up to 5.
    std_lens_px: Annotated[float, _expert("σ of each error that both lenses share, in the corner", 1e-3, 50)] = 5.0
    # Of five real rigs three differ by 0.4 to 1.2 px.
    std_lens_difference_px: Annotated[
        float, _expert("σ of the radial difference of the two lenses, in the corner", 1e-3, 50)
    ] = 0.5
    # Kalibr and OpenCV give a tenth of that on good recordings; autofocus, heat and a wrong resolution do more.
    std_focal: Annotated[float, _number("σ of the focal length's error, fraction of it", 1e-6, 0.1)] = 0.003
    # Cameras that are triggered by software are a few milliseconds apart.
    std_delay_s: Annotated[float, _number("σ of the right camera's delay, seconds", 1e-6, 0.1)] = 0.005
    # Rolling shutters of cheap cameras read out in 10 to 30 ms.
    std_readout_s: Annotated[float, _number("σ of the readout time of the shutters, seconds", 1e-6, 0.1)] = 0.02
    # A mount that warms up or gives way.
    std_turning_rad_s: Annotated[float, _expert("σ of the turn rate of the right camera, rad/s", 1e-8, 0.1)] = 5e-4
    # An autofocus moves by a percent or two in a second.
    std_focusing_per_s: Annotated[
        float, _expert("σ of the relative change of the focal length per second", 1e-8, 0.1)
    ] = 0.005
    # A principal point that is off by a pixel, at usual focal lengths.
    std_axes_rad: Annotated[float, _expert("σ of the camera's axes, about x and about y", 0, 0.5)] = 0.0015
    # Five real logs with independent truth are 0.1 to 1 % too long or too short, RMS 0.6 %.
    std_baseline: Annotated[float, _number("σ of the baseline's error, fraction of it", 0, 0.5)] = 0.006


class ImuConfig(_Section, frozen=True, kw_only=True):
    """Inertial samples, where a log or a program has them."""

    enabled: Annotated[bool, Meta(description="use inertial samples where there are any")] = True
    # Kalibr gives a tenth of that; drawings, and tf of robots, half a degree.
    std_axes_rad: Annotated[float, _expert("σ of the unit's rotation against the camera, each axis", 1e-6, 0.5)] = (
        0.01
    )
    # Triggered cameras are stamped within a millisecond, others at arrival.
    std_time_offset_s: Annotated[
        float, _expert("σ of the unit's clock against the camera's, seconds", 1e-6, 0.1)
    ] = 0.005
    # Beyond it a map that begins anew would be elsewhere than the old one for most uses.
    max_std_m: Annotated[
        float, _expert("largest σ of a position by the samples alone, metres; beyond it: lost", 0, 100)
    ] = 0.15


class RosConfig(_Section, frozen=True, kw_only=True):
    """Frames and axes in `estimates.mcap`, as ROS names them; nothing else depends on these."""

    world_frame: Annotated[
        str, Meta(description="the fixed frame in which corrections make the path jump; map in REP 105")
    ] = "map"
    odom_frame: Annotated[str, Meta(description="the fixed frame in which the path never jumps")] = "odom"
    base_frame: Annotated[
        str,
        Meta(
            description="the robot's frame, such as base_link, to report poses of; empty: report those of the camera"
        ),
    ] = ""
    camera_frame: Annotated[str, Meta(description="the left camera: x right, y down, z forward")] = "left_camera"
    z_up: Annotated[
        bool,
        Meta(
            description="x forward, y left, z up in the fixed frames (REP 103), as always with a base_frame; "
            "otherwise the axes of the first camera"
        ),
    ] = False
    camera_x_m: Annotated[float, _number("position of the camera in base_frame: forward, metres", -1e3, 1e3)] = 0.0
    camera_y_m: Annotated[float, _number("to the left, metres", -1e3, 1e3)] = 0.0
    camera_z_m: Annotated[float, _number("upwards, metres", -1e3, 1e3)] = 0.0
    camera_roll_deg: Annotated[
        float, _number("roll, applied first, about x; 0 where the camera is upright; degrees", -360, 360)
    ] = 0.0
    camera_pitch_deg: Annotated[
        float, _number("pitch, applied second, about y; positive where it looks down; degrees", -360, 360)
    ] = 0.0
    camera_yaw_deg: Annotated[
        float, _number("yaw, applied last, about z; 0 where it looks along x; degrees", -360, 360)
    ] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        names = {name: getattr(self, name) for name in _FRAMES}
        for setting, name in names.items():
            if not _FRAME_NAME.fullmatch(name) and (name or setting != "base_frame"):
                raise ConfigError(
                    f"ros.{setting} is {name!r}; give a name of letters, digits, _ and /, as in {_FRAMES[setting]}"
                )
        if len(set(names.values())) < len(names):
            raise ConfigError(
                f"the frames of ROS need different names, not {', '.join(filter(None, names.values()))}: change one "
                "of them (the odom frame is one of its own, below world_frame, which ROS calls map)"
            )


class DenseConfig(_Section, frozen=True, kw_only=True):
    """Dense stereo and surfaces (`stream-sfm surface`)."""

    # Chosen by hand: twice what points use, for surfaces close to the camera. The range is narrowed for each frame.
    max_disparity_fraction: Annotated[
        float, _expert("largest disparity, share of the image's width", 0.01, 0.9)
    ] = 0.5
    # OpenCV recommends 3 to 11 for semi-global matching; larger blocks are smoother and lose thin objects.
    block_px: Annotated[int, _expert("edge of the matched block, pixels, odd", 3, 21)] = 7
    # OpenCV recommends 5 to 15: the lowest, because the left-right check and the σ reject mismatches as well.
    uniqueness_percent: Annotated[
        int, _expert("margin by which a match must beat the second best, percent", 0, 50)
    ] = 5
    # As for the points (`frontend.smoothing_px`): interpolation between pixels is biased in sharper images.
    smoothing_px: Annotated[float, _expert("σ of the Gaussian before the sub-pixel step, pixels", 0, 5)] = 1.0
    # Chosen by hand: a larger window averages more noise, but rounds off the edges of objects.
    window_radius_px: Annotated[int, _expert("half width of the window of the sub-pixel step, pixels", 2, 30)] = 6
    # A uniform error of half a pixel has a σ of 0.29.
    std_start_px: Annotated[
        float, _expert("σ of the disparity that the sub-pixel step starts from", 1e-3, 1000)
    ] = 0.3
    # Lens model and interpolation: with it, σ matches the errors of rendered frames (tools/surface_accuracy.py).
    std_bias_px: Annotated[float, _expert("σ of the disparity error that all frames share, pixels", 0, 10)] = 0.06
    # Chosen by hand: a less certain disparity may be a mismatch.
    max_std_px: Annotated[float, _expert("leave out pixels with a larger σ of disparity", 1e-3, 100)] = 1.0
    # Chosen by hand: beyond it, depth is too uncertain to show a shape.
    max_relative_std: Annotated[
        float, _expert("leave out pixels with a larger σ of depth, relative to depth", 1e-4, 1)
    ] = 0.05
    # The limit of fusion in human stereo vision (Burt and Julesz 1980); a steeper step is the edge of an object.
    max_disparity_step_px: Annotated[float, _expert("largest step between connected pixels", 0.01, 1000)] = 1.0
    voxel_m: Annotated[float, _number("voxel size of a fused surface, metres; 0: automatic", 0, 100)] = 0.0
    # About 160 MB; beyond it the edge is doubled, which leaves about a quarter of the voxels of a surface.
    max_voxels: Annotated[
        int, _expert("most voxels; beyond that number they are made larger", 10_000, 100_000_000)
    ] = 4_000_000
    # Mismatches rarely agree in three frames.
    min_frames: Annotated[int, _expert("least number of frames that see a point of a fused surface", 1, 10_000)] = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.voxel_m < (least_m := 1e-4):
            raise ConfigError(f"dense.voxel_m is {self.voxel_m}; give at least {least_m}, or 0: automatic")


class Config(_Section, frozen=True, kw_only=True):
    """All settings; each has a default."""

    method: Annotated[
        str, Meta(description="estimator: cross-frame, ekf, frame-to-frame, or another name in estimators.METHODS")
    ] = "cross-frame"
    mask_left: Annotated[
        str, Meta(description="PNG of the left images' size, black where they show the robot or dirt; empty: none")
    ] = ""
    mask_right: Annotated[str, Meta(description="the same of the right images")] = ""
    mono: Annotated[bool, Meta(description="use the left camera only; lengths have no unit")] = False
    frontend: FrontendConfig = FrontendConfig()
    window: WindowConfig = WindowConfig()
    robust: RobustConfig = RobustConfig()
    motion: MotionConfig = MotionConfig()
    rig: RigConfig = RigConfig()
    imu: ImuConfig = ImuConfig()
    ros: RosConfig = RosConfig()
    dense: DenseConfig = DenseConfig()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mono and self.method != "cross-frame":
            raise ConfigError(f"method {self.method} needs two cameras: with mono the method is cross-frame")

    def masked(self, rig: Rig) -> Rig:
        """Return a StereoRig or MonoRig with the masks that are set here. Raises ConfigError where they do not fit."""
        if not (self.mask_left or self.mask_right):
            return rig
        return rig.masked(self.mask_left or None, self.mask_right or None)

    def needs_scale(self, what: str) -> None:
        """Raise a ConfigError if `what` is to be done with one camera."""
        if self.mono:
            raise ConfigError(f"{what} needs two cameras: leave mono out of the configuration")


def read_config(path: str | Path | None, overrides: list[str] | tuple[str, ...] = ()) -> Config:
    """Read the configuration of a TOML file (None: the defaults), then apply `section.key=value` overrides.

    Raises ConfigError naming the file and the key.
    """
    data: dict[str, Any] = {}
    where = ""
    if path is not None:
        where = f" in {path}"
        try:
            data = parse_toml(read_small(path, LIMITS.settings_bytes).decode("utf-8-sig"))
        except OSError as error:
            raise ConfigError(f"cannot read configuration {path}: {error.strerror}") from None
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"configuration {path} is not TOML: {error}") from None
    for override in overrides:
        _apply(override, data)
    _merge_expert(data, where)
    try:
        return msgspec.convert(data, Config)
    except msgspec.ValidationError as error:
        text = invalid_setting(str(error), data, msgspec.to_builtins(Config()))
        raise ConfigError(f"configuration{where}: {text}", hint=("config_to_toml",)) from None


def _merge_expert(data: dict[str, Any], where: str) -> None:
    """Move what is in sections such as [expert.frontend] to [frontend], where it may be as well."""
    expert = data.pop("expert", {})
    if not isinstance(expert, dict) or not all(isinstance(section, dict) for section in expert.values()):
        raise ConfigError(f"configuration{where}: expert holds sections only, such as [expert.frontend]")
    for name, section in expert.items():
        known = data.setdefault(name, {})
        for key, value in section.items():
            if not isinstance(known, dict) or key in known:
                raise ConfigError(f"configuration{where}: {name}.{key} is set twice, also as expert.{name}.{key}")
            known[key] = value


def _apply(override: str, data: dict[str, Any]) -> None:
    """Set what an override such as `window.frames=12` says in the content of a TOML file."""
    key, sign, text = override.partition("=")
    if not sign:
        raise ConfigError(f"setting {override!r} has no value: write KEY=VALUE, for example window.frames=12")
    try:
        value = parse_toml(f"x = {text}")["x"]
    except (ValueError, RecursionError):
        value = text  # a bare word is a string
    *sections, leaf = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigError(f"setting {override!r}: {section} is not a section")
    data[leaf] = value


def setting_names() -> list[str]:
    """Every setting with its section, such as `window.frames`."""
    return [".".join(filter(None, (name, key))) for name, section in _sections(Config()) for key in _keys(section)]


def config_to_toml(config: Config, expert: bool = True) -> str:
    """Return the configuration as commented TOML, which `read_config` reads back unchanged.

    Without `expert`, settings that few runs need are left out, unless they differ from their defaults.
    """
    lines = ["# stream_sfm configuration; every setting may be left out"]
    if not expert:
        lines.append("# settings that few runs need are left out; they have sections such as [expert.frontend]")
    for name, section in _sections(config):
        plain = [key for key, meta in _keys(section).items() if not (meta.extra or {}).get("expert")]
        rest = [key for key in _keys(section) if key not in plain]
        if not expert:
            defaults = type(section)()
            rest = [key for key in rest if getattr(section, key) != getattr(defaults, key)]
        lines += _section_lines(name, section, plain)
        lines += _section_lines(f"expert.{name}", section, rest)
    return "\n".join(lines) + "\n"


def _sections(config: Config) -> list[tuple[str, _Section]]:
    """Names and sections; the first has no name: settings in none."""
    values = ((name, getattr(config, name)) for name in config.__struct_fields__)
    return [("", config), *((name, value) for name, value in values if isinstance(value, _Section))]


def _keys(section: _Section) -> dict[str, Meta]:
    """The settings of a section, without its own sections."""
    hints = get_type_hints(type(section), include_extras=True)
    return {key: hint.__metadata__[0] for key, hint in hints.items() if get_origin(hint) is Annotated}


def _section_lines(name: str, section: _Section, keys: list[str]) -> list[str]:
    if not keys:
        return []
    metas = _keys(section)
    purpose = (type(section).__doc__ or "").partition("\n")[0]  # empty where Python has removed docstrings (-OO)
    lines = ["", f"[{name}]  # {purpose}"] if name else []
    for key in keys:
        lines += [f"# {metas[key].description}", f"{key} = {json.dumps(getattr(section, key), ensure_ascii=False)}"]
    return lines
