"""Image checks over several frames: whether the images really are the views of two cameras at one moment.

Each check has its own file. `after` returns its state after a frame, and `problem` says what is wrong, or is empty.
"""

from collections.abc import Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ..config.rules import Rules
from ..record import changed, record
from .echo_check import EchoCheck
from .field_check import FieldCheck
from .ghost_check import GhostCheck
from .patches import View
from .prepared import PreparedImages
from .smear_check import SmearCheck
from .still_check import Lines, StillCheck

Masks = Sequence[NDArray[np.bool_] | None]  # (h, w) per camera, None if all of its image shows the scene


@record
class Suspicions:
    """The checks of images over several frames.

    `ghosts`, `smears`: whether earlier images show through; `still`: whether something is drawn over both; `echo`:
    whether both show everything twice; `fields`: whether alternate rows are of two moments.
    """

    ghosts: GhostCheck = field(default_factory=GhostCheck)
    smears: SmearCheck = field(default_factory=SmearCheck)
    still: StillCheck = field(default_factory=StillCheck)
    echo: EchoCheck = field(default_factory=EchoCheck)
    fields: FieldCheck = field(default_factory=FieldCheck)

    @classmethod
    def begun_by(cls, rules: Rules) -> "Suspicions":
        """Return the checks before the first frame."""
        return cls(
            GhostCheck(rules=rules.ghosts),
            SmearCheck(rules=rules.smears),
            StillCheck(rules=rules.still),
            EchoCheck(rules=rules.echo),
            FieldCheck(rules=rules.fields),
        )

    @property
    def problem(self) -> str:
        """The first problem of the images, or an empty string."""
        checks = self.ghosts, self.smears, self.still, self.echo, self.fields
        return next(filter(None, (check.problem for check in checks)), "")

    def after_images(self, images: PreparedImages, masks: Masks, frame_index: int) -> "Suspicions":
        """Return the checks after a frame's raw images; `masks`: where they show the scene."""
        if images.delivered is None:
            return self
        still, fields = self.still, self.fields
        if frame_index % still.rules.every == 0:
            left, right = (
                Lines.of(image, still.rules, mask) for image, mask in zip(images.delivered, masks, strict=True)
            )
            still, fields = still.after(left, right), fields.after(left, right)
        return changed(self, still=still, fields=fields, echo=self.echo.after(*images.delivered))

    def after_views(self, view: View) -> "Suspicions":
        """Return the checks after a frame that was followed."""
        return changed(self, ghosts=self.ghosts.after(view), smears=self.smears.after(view))

    def interrupted(self) -> "Suspicions":
        """Return the checks after a frame that could not be followed."""
        return changed(self, ghosts=self.ghosts.interrupted(), smears=self.smears.interrupted())
