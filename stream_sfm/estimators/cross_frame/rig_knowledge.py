"""What the window knows about the calibration's own error c: considered until it is significant, then estimated.

A view of the camera pair is z = h(P) + B c + noise, with B given (`Observations.rig_effects`). c is part of the joint
prior permanently. While nothing significant is known about it, its mean stays as the calibration says: the error counts
in every covariance but moves no estimate, so that an exact calibration is not harmed by the attempt to improve it. From
the frame on where its estimate differs from zero by far more than its σ, it is estimated with all the rest, eq. (72).
"""

from dataclasses import dataclass, replace

import numpy as np

from ...geometry.se3 import Array
from ...types import RigEstimate

# Of χ², as standard deviations of a Gaussian. Six would take an exact calibration for a wrong one once in a thousand
# million frames; but on exact rigs values have been seen that χ² has at three to four. Real rigs are found at dozens.
_SIGNIFICANT = 8.0
# Length of all errors together, each in the σ assumed for it beforehand: no calibration errs by more. Real rigs have
# 4 to 16, the most one with a radial error of 12 px in the corner.
_IMPOSSIBLE = 20.0


@dataclass(frozen=True, slots=True)
class RigKnowledge:
    """c = `mean` (m,) + `root` (m, m) a, with whitened amplitudes a ~ N(`offset` (m,), I).

    `mean` is taken out of all views. `estimated`: the amplitudes are estimated in the window, and `offset` is 0 after
    each absorbed frame; otherwise they are considered and held at 0.
    """

    mean: Array
    root: Array
    offset: Array
    estimated: bool = False

    @classmethod
    def unknown(cls, m: int) -> "RigKnowledge":
        """Return the prior: m errors in units of their own σ."""
        return cls(np.zeros(m), np.eye(m), np.zeros(m))

    def __len__(self) -> int:
        return len(self.mean)

    def at(self, amplitudes: Array) -> Array:
        """Return the error c (m,) that the window takes out at the given amplitudes (m,)."""
        return self.mean + self.root @ amplitudes

    def judge(self, offset: Array) -> "RigKnowledge":
        """Return the knowledge with the estimate `offset` (m,) of the whitened amplitudes, judged for significance."""
        if self.estimated or not len(self):
            return self
        spread = 2 / (9 * len(self))  # χ² of m degrees of freedom after Wilson and Hilferty (1931)
        significant = offset @ offset > len(self) * (1 - spread + _SIGNIFICANT * np.sqrt(spread)) ** 3
        return replace(self, estimated=True) if significant else self

    def after(self, amplitudes: Array, root: Array, step: Array) -> "RigKnowledge":
        """Return the knowledge after a frame was absorbed at the given amplitudes (m,).

        What is left of them has the root (m, m), and the whitened estimate `step` (m,).
        """
        root = self.root @ root
        mean = self.at(amplitudes)
        if self.estimated:
            return replace(self, mean=mean + root @ step, root=root, offset=np.zeros(len(self)))
        return replace(self, mean=mean, root=root, offset=step)


def impossible(rig: RigEstimate | None) -> str:
    """Say that the errors of the calibration are larger than those of any; empty where they are not, or not known."""
    length = 0.0 if rig is None else float(np.linalg.norm(rig.mean))
    if length < _IMPOSSIBLE:
        return ""
    return (
        f"the errors of the calibration would be {length:.1f} times the σ assumed for them: is it of these cameras "
        "and of this resolution, and has none of them moved?"
    )
