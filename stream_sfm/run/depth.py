"""The depth images of a log, which all lanes of a run share."""

from ..errors import InputError
from ..recording.ground_truth import Depth
from ..recording.stereo_log import StereoLog


class TrueDepth:
    """Looks up the depth images of a log; after one that cannot be read there are none, and `problem` says why."""

    def __init__(self, log: StereoLog) -> None:
        self._images = log.depth_images()
        self.problem = ""

    def at(self, stamp_ns: int) -> Depth | None:
        """Return the depth image of this moment, or None; stamps ascend."""
        if self.problem:
            return None
        try:
            return self._images.at(stamp_ns)
        except InputError as error:
            self.problem = f"ground-truth depth is not compared: {error}"
            return None
