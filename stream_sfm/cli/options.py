"""Options shared by several commands: records whose fields are options, and parsers that say what is wrong."""

import json
import math
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..errors import ConfigError
from ..methods import METHODS
from .tables import Group, Options, Parameter

if TYPE_CHECKING:
    from ..config import Config
    from ..logs.recording.truth_file import GroundTruthFile
    from ..types import Selection

# In the order of the help.
RESULTS, CAMERAS, FRAMES = Group("Results", 1), Group("Cameras", 2), Group("Frames", 3)
SETTINGS, TRUTH = Group("Settings", 4), Group("Ground truth", 5)
PARALLEL, GENERAL = Group("Parallel work", 6), Group("General", 7)

if TYPE_CHECKING:
    Method = str
else:
    Method = Literal[tuple(METHODS)]


def _at_least(least: int) -> Callable[[int], None]:
    def check(value: int) -> None:
        if value < least:
            raise ValueError(f"give a whole number of at least {least}")

    return check


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text!r} is not a finite number")
    return value


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,5})\s*[x×,]\s*(\d{2,5})", text.strip())
    if found is None:
        raise ValueError(f"{text!r} is not a size: give width and height in pixels, such as 640x480")
    return int(found[1]), int(found[2])


def _positive(text: str) -> float:
    if not (value := _finite(text)) > 0:
        raise ValueError(f"{text!r} is not a number above 0")
    return value


def _place(text: str) -> str:
    """A path to write to; an empty one, as an unset variable of a script leaves it, is refused."""
    if not text.strip():
        raise ValueError("the name is empty")
    return text


def _frame_ranges(text: str) -> tuple[tuple[int, int], ...]:
    ranges = []
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", part)
        if found is None or int(found[1]) >= int(found[2]):
            raise ValueError(f"{part!r} is not a range of frames: give it as 0:15 for frames 0 to 14")
        ranges.append((int(found[1]), int(found[2])))
    return tuple(ranges)


def _std_truth(text: str) -> tuple[float, float]:
    try:
        std_m, std_rad = map(float, text.split(","))
    except ValueError:
        std_m = std_rad = math.nan
    if not (0 <= std_m < math.inf and 0 <= std_rad < math.inf):
        raise ValueError(f"{text!r} is not a σ in metres and one in radians, such as 0.001,0.0005")
    return std_m, std_rad


def _one_or_two(files: list[str]) -> None:
    if len(files) > 2:
        raise ValueError("give one file, or two: left and right")


def _setting_names(_context: Any) -> list[str]:
    """The beginnings of every `--set`, for completion in the shell."""
    from ..config import setting_names

    return [f"{name}=" for name in setting_names()]


# Kinds of arguments; where there is no help here, the docstring of a command says what each is for.
Log = Annotated[str, Parameter("LOG")]
Run = Annotated[str, Parameter("RUN")]
Recording = Annotated[
    str, Parameter("LOG", help="the recording: MCAP, a ROS bag, a video, or the folder of a data set or of images")
]
NewLog = Annotated[str, Parameter("OUT.mcap", help="the log to write")]
MaybeSeconds = Annotated[float | None, Parameter(metavar="S")]
Count = Annotated[int, Parameter(validator=_at_least(1), metavar="N")]
MaybeCount = Annotated[int | None, Parameter(validator=_at_least(1), metavar="N")]
MaybeSize = Annotated[
    tuple[int, int] | None,
    Parameter(group=CAMERAS, converter=_size, n_tokens=1, accepts_keys=False, metavar="WxH"),
]
MaybePositive = Annotated[float | None, Parameter(group=CAMERAS, converter=_positive, n_tokens=1, metavar="HZ")]
MaybeIndex = Annotated[int | None, Parameter(group=FRAMES, validator=_at_least(0), metavar="N")]
Workers = Annotated[MaybeCount, Parameter(group=PARALLEL, help="number of processes; by default one per CPU core")]
Folder = Annotated[str, Parameter(group=RESULTS, converter=_place, metavar="DIR")]
MaybeFolder = Annotated[str | None, Parameter(group=RESULTS, converter=_place, metavar="DIR")]
OutFile = Annotated[str, Parameter(group=RESULTS, converter=_place, metavar="FILE")]
MaybeFile = Annotated[str | None, Parameter(metavar="FILE")]
MaybeTopic = Annotated[str | None, Parameter(metavar="TOPIC")]
ResultFile = Annotated[MaybeFile, Parameter(group=RESULTS)]
ResultFlag = Annotated[bool, Parameter(group=RESULTS)]
MethodName = Annotated[
    Method | None, Parameter(group=SETTINGS, metavar="NAME", help="the estimator; cross-frame if not given")
]
Names = Annotated[str, Parameter(group=RESULTS, metavar="NAME,…")]
World = Annotated[
    Literal["camera", "gravity"] | None,
    Parameter(
        group=RESULTS,
        help="gravity: the fixed frame map of ROS has z upwards by the log's inertial samples, and "
        "trajectory_gravity.tum has the poses in it; camera, as without it: the axes of the first camera",
    ),
]
Calibration = Annotated[list[str] | None, Parameter(group=CAMERAS, metavar="FILE", validator=_one_or_two)]
CameraFlag = Annotated[bool, Parameter(group=CAMERAS)]
Force = Annotated[bool, Parameter(group=RESULTS, help="replace OUT.mcap if it exists")]
Quiet = Annotated[bool, Parameter(alias="-q", group=GENERAL, help="print errors only")]
Verbose = Annotated[bool, Parameter(alias="-v", group=GENERAL, help="report changes of status and time per stage")]
Json = Annotated[bool, Parameter(group=GENERAL, help="print one JSON object on standard output and nothing else")]


def calibration_files(calibration: list[str] | None) -> str | list[str] | None:
    """As the functions of this package take it: None, one path, or those of left and right."""
    return calibration[0] if calibration and len(calibration) == 1 else calibration or None


def at_least_one(values: Sequence[str], name: str, cure: str) -> None:
    """Raise a ConfigError where a command that takes any number of arguments is given none."""
    if not values:
        raise ConfigError(f"{name} is missing: name {cure}")


@Parameter(name="*", group=CAMERAS)
class Cameras(Options):
    """How the cameras of a log are found.

    Attributes:
        left: topic of the left images; found automatically
        right: topic of the right images; found automatically
        calibration: a file or folder, of our own format (TOML) or of another tool's, or the files of left and right
        rate: frames per second of a folder of images without stamps (10)
    """

    left: MaybeTopic = None
    right: MaybeTopic = None
    calibration: Calibration = None
    rate: Annotated[float | None, Parameter(metavar="HZ")] = None

    @property
    def chosen(self) -> dict[str, Any]:
        """Left topic, right topic, calibration and rate, as `open_log` takes them."""
        files = calibration_files(self.calibration)
        return {"left": self.left, "right": self.right, "calibration": files, "rate_hz": self.rate}


@Parameter(name="*", group=FRAMES)
class Frames(Options):
    """Which frames of a log are read.

    Attributes:
        start: begin S seconds after the first frame
        end: end S seconds after the first frame
        max_frames: read at most N frames
        stride: read every N-th frame
    """

    start: MaybeSeconds = None
    end: MaybeSeconds = None
    max_frames: MaybeCount = None
    stride: Count = 1

    def selection(self) -> "Selection":
        """The frames chosen. Raises ConfigError where no frame can be among them."""
        from ..types import Selection

        return Selection(self.start, self.end, self.max_frames, self.stride)


@Parameter(name="*", group=SETTINGS)
class Settings(Options):
    """All settings.

    Attributes:
        config: read settings from this file; `stream-sfm config` prints one
        set: change one setting, for example window.frames=12; may be repeated
        no_imu: leave out the inertial samples of a log
        mask: PNGs of the images' size, black where pixels are ignored: the robot itself, dirt on a lens
    """

    config: MaybeFile = None
    set: Annotated[list[str] | None, Parameter(metavar="KEY=VALUE", completer=_setting_names)] = None
    no_imu: Annotated[bool, Parameter(negative="")] = False
    mask: Annotated[
        list[str] | None, Parameter(group=CAMERAS, consume_multiple=True, metavar="LEFT.png", validator=_one_or_two)
    ] = None

    def read(self, world: str | None = None, **chosen: str | bool | None) -> "Config":
        """The configuration, with settings that have an option of their own (None or False: not given).

        Raises ConfigError.
        """
        from ..config import read_config
        from ..estimators import check_method

        masks = dict(zip(("mask_left", "mask_right"), self.mask or (), strict=False))
        chosen |= {name: os.path.abspath(path) for name, path in masks.items()}  # the run says so in config.toml
        further = [f"{name}={json.dumps(value)}" for name, value in chosen.items() if value]
        further += ["imu.enabled=false"] if self.no_imu else []
        further += [] if world is None else [f"ros.gravity={json.dumps(world == 'gravity')}"]
        found = read_config(self.config, [*(self.set or []), *further])
        check_method(found.method)
        return found


@Parameter(name="*", group=TRUTH)
class TruthFile(Options):
    """Where ground truth is, if not in the log.

    Attributes:
        ground_truth: compare with the poses in this file, not with the log's: TUM, EuRoC's CSV, or KITTI with stamps
        ground_truth_frame: what the poses belong to: a frame of the log's transforms, or a sensor.yaml
        ground_truth_offset: add S seconds to their stamps
    """

    ground_truth: MaybeFile = None
    ground_truth_frame: Annotated[str | None, Parameter(metavar="FRAME")] = None
    ground_truth_offset: Annotated[float, Parameter(converter=_finite, metavar="S")] = 0.0

    def read(self) -> "GroundTruthFile | None":
        if self.ground_truth is None:
            return None
        from ..logs.recording.truth_file import GroundTruthFile

        return GroundTruthFile(self.ground_truth, self.ground_truth_frame, self.ground_truth_offset)


_Ranges = Parameter(converter=_frame_ranges, n_tokens=1, accepts_keys=False, metavar="A:B,…")
StdTruth = Annotated[
    tuple[float, float] | None,
    Parameter(group=TRUTH, converter=_std_truth, n_tokens=1, accepts_keys=False, metavar="M,RAD"),
]


@Parameter(name="*", group=TRUTH)
class TruthErrors(Options):
    """Known errors of the ground truth.

    Attributes:
        ignore_ground_truth: do not compare frames A to B-1, because the ground truth is wrong there
        ground_truth_std: σ of the ground truth itself, metres and radians; known for KITTI, EuRoC and TUM-VI
    """

    ignore_ground_truth: Annotated[tuple[tuple[int, int], ...], _Ranges] = ()
    ground_truth_std: StdTruth = None


def protect(outputs: Sequence[str | Path | None], *inputs: str | list[str] | None) -> None:
    """Raise an OutputError where one of the outputs is an input of the command (None: not given)."""
    from ..system.outputs import refuse_overwriting

    given = [path for name in inputs for path in ([name] if isinstance(name, str) else name or [])]
    refuse_overwriting([Path(path) for path in outputs if path], [Path(path) for path in given])
