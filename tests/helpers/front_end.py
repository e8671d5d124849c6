"""A front-end together with its state, for tests that feed it frame by frame."""

from dataclasses import replace

from stream_sfm.camera.rectification import Rectifier
from stream_sfm.camera.refinement import KnownTiming
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config
from stream_sfm.frontend.front_end import StereoFrontEnd
from stream_sfm.frontend.state import FrontEndState
from stream_sfm.pictures.prepared import PreparedImages
from stream_sfm.types import Observations, StereoFrame


class SteppedFrontEnd:
    """The front-end of a rig, and its `state` after the frames that it was shown."""

    def __init__(self, rig: StereoRig, known_timing: KnownTiming | None = None) -> None:
        self.rectifier = Rectifier(rig)
        if known_timing is not None:
            rig = replace(rig, timing=known_timing)
        self.front_end = StereoFrontEnd(rig, self.rectifier, Config())
        self.state: FrontEndState = self.front_end.start

    def step(self, frame: StereoFrame) -> Observations:
        """Observations of the next frame."""
        smoothing_px = self.front_end.setup.config.frontend.smoothing_px
        images = PreparedImages.of(*self.rectifier.rectify(frame.left, frame.right), smoothing_px)
        self.state, observed = self.front_end.step(self.state, images, frame.stamp_ns)
        return observed
