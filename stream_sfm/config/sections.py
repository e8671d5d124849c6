"""The sections of the settings: one frozen struct per part, units in the names.

The defaults are one configuration for all logs.
"""

import re
from typing import Annotated

from msgspec import Meta

from ..errors import ConfigError
from .section import Section, expert, number

_FRAME_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/]{0,99}")
_FRAMES = {"world_frame": "map", "odom_frame": "odom", "base_frame": "base_link", "camera_frame": "left_camera"}


class FrontendConfig(Section, frozen=True, kw_only=True):
    """Detection, left-right matching, tracking."""

    # Chosen by hand: cost grows with the number; 240 instead of 200 gains little accuracy on our logs.
    max_tracks: Annotated[int, number("most points tracked at the same time", 20, 2000)] = 200
    # Chosen by hand: with less, corners are sought in more frames; with more, parts of the view are left without
    # points.
    renew_fraction: Annotated[float, expert("start new tracks once this share of them is missing", 0, 1)] = 0.05
    # Chosen by hand: patches overlap by half at most, so that their errors differ.
    min_corner_distance_px: Annotated[float, expert("least distance of a new corner from any point", 2, 200)] = 12.0
    # Chosen by hand: a lower limit admits points in weak texture, whose covariance is large. Dark images get a
    # lower one.
    min_corner_response: Annotated[float, expert("least eigenvalue of corner gradients, as OpenCV", 1e-8, 1)] = 2e-4
    # Measured, with templates anchored in a point's first frame: aligned ATE of a rendered log, by full batch
    # adjustment, 35 mm -> 2.3 mm.
    smoothing_px: Annotated[float, expert("σ of the Gaussian that smooths images first, pixels", 0, 5)] = 1.0
    # Chosen by hand: a larger patch has less noise, but more often crosses a depth edge. Similar radii work as
    # well.
    window_radius_px: Annotated[int, expert("half width of the tracked patch, pixels", 3, 30)] = 10
    # Measured: starts are predicted, so more levels change no figure of the logs with ground truth.
    pyramid_levels: Annotated[int, expert("level at which flow starts; it ends at level 1", 1, 8)] = 2
    # Measured: with frames far apart, starts predicted from uncertain depths are wrong by that much. On a drive
    # with every fourth frame, 1.5 px lost a third of the tracks (t_rel 1.8 % instead of 1.6); calm logs do not
    # change.
    max_realignment_px: Annotated[float, expert("largest step of the alignment from its start", 0.1, 50)] = 4.0
    # Twice the error of 0.8 px in the corners of the worst calibration met; the limit narrows as rows are learnt.
    max_vertical_disparity_px: Annotated[float, expert("largest row difference of left and right", 0.1, 50)] = 1.5
    # Chosen by hand, many times the noise of a sensor: it rejects patches that show something else.
    max_photometric_error: Annotated[float, expert("largest deviation of a patch, grey values", 1, 255)] = 20.0
    # Chosen by hand: the nearest depth is f·B over this share of the width; a wider search is slower and errs more
    # often.
    max_disparity_fraction: Annotated[float, number("largest disparity, share of the width", 0.01, 1)] = 0.25


class WindowConfig(Section, frozen=True, kw_only=True):
    """The cross-frame estimator."""

    frames: Annotated[int, number("frames in the window (batch size b in the paper)", 1, 64)] = 8
    max_iterations: Annotated[int, expert("Gauss-Newton steps per frame, at most", 1, 50)] = 6
    # Measured on simulated and real views: after a step, less than a ten-thousandth of its predicted decrease is
    # left. With this limit at most one standard deviation is left, over all variables together; the next frame
    # continues from there. A tenth of it changes the figures of eight logs in the third digit, and takes 8 % more
    # time.
    converged: Annotated[float, expert("stop below this expected decrease of the squares, σ²", 1e-6, 1e12)] = 1e4
    # It is at most 0.025 px on rendered images, and larger within six frames on real ones. Without a field the rig
    # has 20 errors instead of 44 to 65.
    least_field_px: Annotated[float, expert("σ of the disparity field that is estimated, px", 0, 100)] = 0.03
    # A point that never agreed carries little weight beside one that did.
    no_history: Annotated[float, expert("weight of a point that never agreed, frames", 1e-6, 100)] = 0.1
    # With a gate of 99.9 %, six rejections of a good track are unlikely; with more, slow movers are used for
    # longer, and errors in a bare corridor are 4 to 16 % larger.
    rejections: Annotated[int, expert("rejections after which a track is no longer used", 1, 1000)] = 6
    # Several times the noise of a predicted position. A view that has moved by less shows the rig errors of the
    # same place in the image as before.
    rests_px: Annotated[float, expert("motion per frame below which a view rests, px", 0, 100)] = 0.3


class MotionConfig(Section, frozen=True, kw_only=True):
    """The camera's motion while tracking is lost."""

    # As when a person starts to walk.
    build_up_s: Annotated[float, expert("time over which σ of an unknown velocity builds up, s", 0, 1000)] = 1.0
    # The velocity differs from the last known one by what the acceleration builds up in this time, and not by more
    # later. A camera that was moved elsewhere is as uncertain as after this time without images: for a car 30 m,
    # two σ.
    speeds_up_s: Annotated[float, expert("longest time for which a vehicle accelerates, s", 1e-3, 1000)] = 3.0

    std_acceleration_m_s2: Annotated[float, number("σ of acceleration during tracking loss, m/s²", 1e-3, 1e4)] = 3.0
    std_angular_acceleration_rad_s2: Annotated[float, number("σ of angular acceleration, rad/s²", 1e-3, 1e4)] = 3.0

    @property
    def std_acceleration(self) -> tuple[float, ...]:
        """σ (6,) of the acceleration about each axis, m/s², and of the angular one, rad/s²."""
        return 3 * (self.std_acceleration_m_s2,) + 3 * (self.std_angular_acceleration_rad_s2,)


class RigConfig(Section, frozen=True, kw_only=True):
    """Calibration errors, and their prior."""

    # This is for rendered or simulated images, and for comparison with an estimate that does not refine the
    # calibration.
    exact: Annotated[bool, Meta(description="take the calibration as exact")] = False
    # Five real rigs have errors of 0.05 to 1.1 px per term.
    std_disparity_px: Annotated[float, expert("σ of each term of the disparity error at the edge", 1e-3, 10)] = 0.4
    # Of five real rigs, one has errors of 6 to 15 px in the corner, where no point is; the others have up to 5.
    std_lens_px: Annotated[float, expert("σ of each error that both lenses share, in the corner", 1e-3, 50)] = 5.0
    # In three of five real rigs the lenses differ by 0.4 to 1.2 px.
    std_lens_difference_px: Annotated[float, expert("σ of radial lens differences in the corner", 1e-3, 50)] = 0.5
    # Kalibr and OpenCV achieve a tenth of that on good recordings; autofocus, heat and a wrong resolution cause
    # more.
    std_focal: Annotated[float, number("σ of the relative error of the focal length", 1e-6, 0.1)] = 0.003
    # Software triggers are a few milliseconds apart.
    std_delay_s: Annotated[float, number("σ of the right camera's delay, seconds", 1e-6, 0.1)] = 0.005
    # Rolling shutters of cheap cameras read out in 10 to 30 ms.
    std_readout_s: Annotated[float, number("σ of the readout time of the shutters, seconds", 1e-6, 0.1)] = 0.02
    # It is added to the σ of delay and readout, because the front-end extrapolates velocities.
    timing_step: Annotated[float, expert("step of delay and readout per frame, share of their σ", 0, 1)] = 0.01
    # Real rigs deform, and an estimate comes from earlier frames.
    disparity_step_px: Annotated[float, expert("step of each disparity error term per frame, px", 0, 10)] = 0.1
    # This allows for a mount that warms up or gives way.
    std_turning_rad_s: Annotated[float, expert("σ of the turn rate of the right camera, rad/s", 1e-8, 0.1)] = 5e-4
    # An autofocus moves by a percent or two in a second.
    std_focusing_per_s: Annotated[float, expert("σ of relative focal length change per second", 1e-8, 0.1)] = 0.005
    # This is a principal point error of one pixel at usual focal lengths.
    std_axes_rad: Annotated[float, expert("σ of the camera's orientation, about x and y, rad", 0, 0.5)] = 0.0015
    # No calibration is worse: real rigs have 4 to 16; the largest belongs to one with a radial error of 12 px in
    # the corner.
    impossible: Annotated[float, expert("norm of all errors, in units of σ, that is impossible", 1, 1e8)] = 20.0
    # Neighbouring windows share most of their views. On sound logs, rendered and real, roots of the averages are
    # 0.5 to 1.3 (KITTI 06 has 3.2 in one term); with a moving focus they are 2 to 7.
    innovations: Annotated[int, expert("frames over which innovations of rig errors are averaged", 1, 10_000)] = 40
    calm_frames: Annotated[int, expert("calm frames with which the average of innovations starts", 0, 10_000)] = 10
    # An autofocus moves by a percent or two.
    std_refocused: Annotated[
        float, expert("σ of the relative change of a focal length that changes between frames", 1e-6, 0.5)
    ] = 0.02
    # A lens scales about a point some ten pixels from the principal point, which is 0.02 focal lengths.
    refocused_axes_rad: Annotated[
        float,
        expert("σ of the turn of the axes, about x and y, as the focal length doubles, rad", 0, 1),
    ] = 0.02
    # It is at most 4 on sound logs, rendered and real; a jump by 0.25 % on good images says 70 at once.
    refocused: Annotated[float, expert("evidence that a focal length changes, or no longer, nats", 0.1, 1e8)] = 8.0
    rested_frames: Annotated[int, expert("frames after which an unchanged focal length is settled", 3, 10_000)] = 8
    # A larger change is a moving body, not a zoom.
    most_refocused: Annotated[float, expert("largest change between frames, σ of std_refocused", 0.1, 1e8)] = 3.0
    rests: Annotated[float, expert("largest slope and scatter of a settled focal length, σ", 0.1, 1e8)] = 3.0
    # A few frames do not show all errors of a twist.
    least_twist: Annotated[float, expert("least σ of a twist, share of a frame's acceleration", 1e-3, 100)] = 0.1
    # A fifth of the noise of a good view. From 0.07 on, a shaken pair with a right camera 8 ms late has 1.5 to 2 times
    # smaller σ than errors; on KITTI it is 0.015 once the readout is known.
    twist_moves_px: Annotated[float, expert("motion of views by a twist's error that counts, px", 0, 1e8)] = 0.02
    # With 0.2 the focus of an exact camera that looks down on a lawn seems to move, and the run fails: a rendered
    # mower ends up to 15 m off instead of 0.03, with every frame or every other. KITTI would be 3 to 12 % better.
    odds: Annotated[float, expert("prior odds of a cause of errors, or of an inertial error", 1e-12, 1e6)] = 0.05
    share_alone: Annotated[float, expert("share of wrong calibrations with one wrong term only", 0, 1)] = 0.05
    # Lasting errors, and errors that neighbours share, make σ too small by 1.4 (simulated) and 1.5 to 4.5 times
    # (real).
    counts: Annotated[float, expert("share of information about errors that counts for the odds", 1e-6, 1)] = 0.25
    # All views show lenses. With 1 the exact lenses of a render along a street had errors of 7 σ; with 0.25 KITTI's
    # errors are found only after 25 frames, with 0.5 as early as with 1.
    counts_of_lenses: Annotated[
        float, expert("share of information about errors of lenses that counts for the odds", 1e-6, 1)
    ] = 0.5
    # The paths of five real logs with independent truth are 0.1 to 1 % too long or too short, RMS 0.6 %.
    std_baseline: Annotated[float, number("σ of the relative error of the baseline", 0, 0.5)] = 0.006


class ImuConfig(Section, frozen=True, kw_only=True):
    """Inertial samples from the log or the program."""

    enabled: Annotated[bool, Meta(description="use inertial samples if there are any")] = True
    # Kalibr achieves a tenth of that; drawings and tf of robots are within half a degree.
    std_axes_rad: Annotated[float, expert("σ of the unit's rotation to the camera, per axis, rad", 1e-6, 0.5)] = 0.01
    # Triggered cameras have stamps within a millisecond; others are stamped on arrival.
    std_time_offset_s: Annotated[float, expert("σ of the clock offset of unit and camera, s", 1e-6, 0.1)] = 0.005
    # With a larger σ, for most uses a new map would no longer be at the place of the old one.
    max_std_m: Annotated[float, expert("largest σ of a position from samples alone, m; else lost", 0, 100)] = 0.15


class RosConfig(Section, frozen=True, kw_only=True):
    """Frames and axes in `estimates.mcap`, as ROS names them; they affect nothing else."""

    world_frame: Annotated[str, Meta(description="fixed frame in which the path may jump; map in REP 105")] = "map"
    odom_frame: Annotated[str, Meta(description="the fixed frame in which the path never jumps")] = "odom"
    base_frame: Annotated[
        str,
        Meta(description="the frame of the robot whose poses are reported, such as base_link; empty: the camera"),
    ] = ""
    camera_frame: Annotated[str, Meta(description="the left camera: x right, y down, z forward")] = "left_camera"
    z_up: Annotated[
        bool,
        Meta(description="z up in fixed frames (REP 103), as with a base_frame; else the axes of the first camera"),
    ] = False
    gravity: Annotated[
        bool, expert("use inertial samples to turn z of the world upwards; a replay adds trajectory_gravity.tum")
    ] = False
    camera_x_m: Annotated[float, number("position of the camera in base_frame: forward, metres", -1e3, 1e3)] = 0.0
    camera_y_m: Annotated[float, number("position of the camera in base_frame: left, metres", -1e3, 1e3)] = 0.0
    camera_z_m: Annotated[float, number("position of the camera in base_frame: upwards, metres", -1e3, 1e3)] = 0.0
    camera_roll_deg: Annotated[
        float, number("roll of the camera about x, applied first; 0 if it is upright; degrees", -360, 360)
    ] = 0.0
    camera_pitch_deg: Annotated[
        float, number("pitch of the camera about y, applied second; positive if it looks down; degrees", -360, 360)
    ] = 0.0
    camera_yaw_deg: Annotated[
        float, number("yaw of the camera about z, applied last; 0 if it looks along x; degrees", -360, 360)
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
                "of them (the odom frame is separate from world_frame, which ROS calls map)"
            )


class DenseConfig(Section, frozen=True, kw_only=True):
    """Dense stereo and surfaces (`stream-sfm surface`)."""

    voxel_m: Annotated[float, number("voxel size of a fused surface, metres; 0: automatic", 0, 100)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.voxel_m < (least_m := 1e-4):
            raise ConfigError(f"dense.voxel_m is {self.voxel_m}; give at least {least_m}, or 0: automatic")
