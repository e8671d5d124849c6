"""Checks a refinement on frames from which it was not made, and on all frames: it must not make any worse."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..camera.refinement import PARTS, Refinement
from ..camera.settings import SETTINGS
from ..types import Selection
from .looks import Look

_NAMES = ("disparity", "lenses of both cameras", "difference of the lenses")

LookAgain = Callable[[Look, Refinement | None, Selection], Look]
"""Replays a selection of the log of a look, with a refinement of its rig."""
Combine = Callable[[Sequence[Look]], Refinement]


class Checked(NamedTuple):
    """The `parts` of a refinement that help held-back frames, and sentences about that; `why` none does."""

    parts: list[slice]
    notes: list[str]
    why: str = ""


def checked(looks: Sequence[Look], again: LookAgain, combine: Combine) -> Checked:
    """Replay each log with the refinement of the others, a single log in halves, and compare it with none."""
    parts = list(looks) if len(looks) > 1 else _halves(looks[0], again)
    known = [part for part in parts if part.rig is not None]
    if len(known) < 2:
        return Checked([], [], "there are too few frames to check it: record more")
    what = "log" if len(looks) > 1 else "half"
    errors = []
    for part in known:
        with_it = again(part, combine([other for other in known if other is not part]), part.selection)
        if why := worse(part, with_it):
            return Checked([], [], f"one {what} becomes worse with what the others show: {why}")
        errors.append((part.found_px(), with_it.found_px()))
    before_px, after_px = np.sqrt(np.mean(np.square(errors), axis=0))
    kept, notes = [], []
    for terms, name, before, after in zip(PARTS, _NAMES, before_px, after_px, strict=True):
        helps = bool(before > SETTINGS.worth_px and after < SETTINGS.helps * before)
        kept += [terms] if helps else []
        notes.append(
            f"{name}: held-back frames find {before:.2f} px without a refinement and {after:.2f} px with it: "
            f"{'written' if helps else 'not written'}"
        )
    return Checked(kept, notes, "" if kept else "held-back frames find no smaller error with it")


def worse(plain: Look, refined: Look) -> str:
    """Return why frames are worse with a refined calibration than without; empty if they are not."""
    if refined.rig is None:
        return "nothing is tracked any more"
    if refined.ok < plain.ok:
        return f"{refined.ok} frames are good instead of {plain.ok}"
    before = [] if plain.rig is None else plain.rig.findings()
    if len(found := refined.rig.findings()) > len(before):
        return f"it finds that {found[-1]}"
    if refined.std_end_m > SETTINGS.sigma_grows * plain.std_end_m:
        return f"σ of the end grows from {plain.std_end_m:.3g} to {refined.std_end_m:.3g} m"
    return ""


def _halves(of: Look, again: LookAgain) -> list[Look]:
    """Return looks at the halves of a log; none if they would be too short."""
    stamps_ns = of.record.stamps_ns
    if len(stamps_ns) < 2 * SETTINGS.least_frames:
        return []
    return [again(of, None, selection) for selection in _selections(of, stamps_ns.tolist())]


def _selections(of: Look, stamps_ns: list[int]) -> Iterator[Selection]:
    """Yield selections of the first and the last half of frames; they have no frame in common."""
    first_s = of.selection.start_s or 0.0
    middle_ns = (stamps_ns[len(stamps_ns) // 2 - 1] + stamps_ns[len(stamps_ns) // 2]) / 2
    cuts_s = [first_s + (ns - stamps_ns[0]) / 1e9 for ns in (stamps_ns[0], middle_ns, stamps_ns[-1])]
    for start_s, end_s in pairwise(cuts_s):
        yield replace(of.selection, start_s=start_s, end_s=end_s, max_frames=None)
