"""Compares the local structure of each estimate with the depth images of the log."""

from ..camera.models import Camera
from ..errors import InputError
from ..evaluation.structure import StructureComparison, StructureErrors
from ..recording import StereoLog
from ..recording.ground_truth import Depth
from ..types import Frame, FrameEstimate


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


class StructureSink:
    """A sink that compares the points of each estimate with the depth image of its moment; sinks share the images."""

    def __init__(self, camera: Camera, depth: TrueDepth) -> None:
        self._depth = depth
        self._comparison = StructureComparison(camera)
        self.latest: StructureErrors | None = None  # of the latest frame

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Compare one frame, if the log has a depth image of that moment."""
        self.latest = self._comparison.add(estimate, self._depth.at(estimate.stamp_ns))

    def close(self) -> None:
        """Nothing to finish."""

    @property
    def comparison(self) -> StructureComparison | None:
        """The errors of the whole run; None if a depth image could not be read."""
        return None if self._depth.problem else self._comparison
