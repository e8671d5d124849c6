"""What several frames together say against their images: that these are not what two cameras saw at one moment.

Each check has a file of its own, and returns what it is `after` a frame; its `problem` says what is wrong, or nothing.
"""

from dataclasses import field

from ..config.rules import Rules
from ..record import changed, record
from .echo_check import EchoCheck
from .field_check import FieldCheck
from .ghost_check import GhostCheck
from .patches import View
from .prepared import PreparedImages
from .smear_check import SmearCheck
from .still_check import StillCheck


@record
class Suspicions:
    """The checks of images over several frames.

    `ghosts`, `smears`: whether earlier images show through; `still`: whether something is drawn over both; `echo`:
    whether both show everything twice; `fields`: whether rows are of two moments in turn.
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
        """Say what is wrong with the images; or nothing."""
        checks = self.ghosts, self.smears, self.still, self.echo, self.fields
        return next(filter(None, (check.problem for check in checks)), "")

    def after_images(self, images: PreparedImages) -> "Suspicions":
        """Return the checks after images as they came, whatever is found in them."""
        now = self
        if images.lines is not None:
            now = changed(now, still=now.still.after(*images.lines), fields=now.fields.after(*images.lines))
        return now if images.middles is None else changed(now, echo=now.echo.after(*images.middles))

    def after_views(self, view: View) -> "Suspicions":
        """Return the checks after a frame that was followed."""
        return changed(self, ghosts=self.ghosts.after(view), smears=self.smears.after(view))

    def interrupted(self) -> "Suspicions":
        """Return the checks after a frame that could not be followed."""
        return changed(self, ghosts=self.ghosts.interrupted(), smears=self.smears.interrupted())
