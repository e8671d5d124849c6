"""What the user of a recording says of it, beside where it is."""

from typing import NamedTuple


class Given(NamedTuple):
    """Not to use the calibration in it; the rate of images without stamps, Hz; that one camera will do."""

    calibrated: bool = False
    rate_hz: float | None = None
    mono: bool = False


NOTHING = Given()
