"""The checks of what a camera or a recorder does to all of its images, and when they look.

They look at the first moving frames of a run and then rarely, but at each frame while there is a suspicion. What a
frame shows is a log-likelihood ratio; their sum decides when a suspicion begins and when it ends, eq. (7a).
"""

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ..config.rules import Rules
from ..geometry import Array
from ..geometry.evidence import Evidence
from ..record import changed, record
from .ghosts import GhostRules, Ghosts
from .interlacing import Interlaced
from .one_image import OneImage
from .prepared import PreparedImages
from .rules import ImageRules
from .view import View


class Check(Protocol):
    """A fault that all images of a recording may have."""

    sentence: ClassVar[str]  # what is wrong, with its likely cause and its cure
    of_pair: ClassVar[bool]  # whether left and right then say nothing about the motion

    @property
    def earlier(self) -> int:
        """The number of earlier frames in `views` that it needs, if there are so many."""
        ...

    def nats(self, images: PreparedImages, views: tuple[View, ...]) -> float | None:
        """Return the log-likelihood ratio of the fault in a frame; None if the frame says nothing.

        `views`: of the latest frames, the newest one last.
        """
        ...


def checks(rules: Rules) -> tuple[Check, ...]:
    return Ghosts(rules.of(GhostRules)), OneImage(rules.of(ImageRules)), Interlaced()


@record
class Suspicion:
    """What a check has found: its evidence, the number of informative frames, and how many it leaves out."""

    check: Check
    evidence: Evidence
    looks: int = 0
    wait: int = 0


@record
class Suspicions:
    """The state of all checks, with the views of the latest frames as far as a check may soon need them."""

    each: tuple[Suspicion, ...] = ()
    views: tuple[View, ...] = ()
    first_looks: int = 0
    every: int = 1

    @classmethod
    def begun(cls, rules: Rules) -> "Suspicions":
        """Return the state before the first frame."""
        images = rules.of(ImageRules)
        none = Evidence(images.bound_nats, images.first_looks)
        return cls(tuple(Suspicion(check, none) for check in checks(rules)), (), images.first_looks, images.every)

    def after(self, images: PreparedImages, ids: NDArray[np.int64], left_px: Array) -> "Suspicions":
        """Return the state after a frame with its tracks `ids` (n,), which ascend, at `left_px` (n, 2)."""
        earlier = max((s.check.earlier for s in self.each if s.wait <= s.check.earlier), default=-1)
        views = (*self.views, View(images.left, ids, left_px))[-earlier - 1 :] if earlier >= 0 else ()
        return changed(self, each=tuple(self._looked(s, images, views) for s in self.each), views=views)

    def _looked(self, s: Suspicion, images: PreparedImages, views: tuple[View, ...]) -> Suspicion:
        if s.wait:
            return changed(s, wait=s.wait - 1)
        nats = s.check.nats(images, views)
        if nats is None:
            return s
        evidence, looks = s.evidence.after(nats), s.looks + 1
        calm = looks >= self.first_looks and not evidence.is_there and evidence.change == 0
        return changed(s, evidence=evidence, looks=looks, wait=self.every - 1 if calm else 0)

    def interrupted(self) -> "Suspicions":
        """Return the state after a frame that could not be followed."""
        return changed(self, views=())

    @property
    def problem(self) -> str:
        """What is wrong with the images of this recording, or an empty string."""
        return next((s.check.sentence for s in self.each if s.evidence.is_there), "")

    @property
    def problem_of_pair(self) -> str:
        """What is wrong so that left and right say nothing about the motion, or an empty string."""
        return next((s.check.sentence for s in self.each if s.evidence.is_there and s.check.of_pair), "")
