"""What the user says about a recording, besides its path."""

from pathlib import Path
from typing import NamedTuple


class Given(NamedTuple):
    """`calibrated`: its own calibration is not used. `rate_hz`: of images without stamps. `mono`: one camera will do.

    `poses`: ground truth of KITTI, in place of its own.
    """

    calibrated: bool = False
    rate_hz: float | None = None
    mono: bool = False
    poses: str | Path | None = None
