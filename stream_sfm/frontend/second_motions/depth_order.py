"""Which of two sets of points lies behind the other: along their border, the one behind is the background.

A body stands in front of the scene, and the scene surrounds it. So each point of one set is compared with its nearest
neighbour in the image among the others.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...config.section import Section, expert
from ...geometry.medians import median
from ...geometry.resection import MANY_VIEWS, MIN_VIEWS
from ...geometry.robust_rules import RobustRules
from ..state import Setup
from ..tracks import Tracks


class StartRules(Section, frozen=True, kw_only=True):
    """At the start of a map: which of two motions has its points behind the points of the other."""

    # The share is smaller along the ground, which lies behind and in front of its neighbours.
    behind: Annotated[float, expert("share of neighbours that points behind have in front", 0.5, 1)] = 0.95
    # One start in a thousand follows a body, and 5 σ are 14 more.
    body: Annotated[float, expert("log-odds from which points that agree are on a body in front", 0, 1e6)] = 21.0
    # Depths of neighbours on one surface differ by less.
    deeper: Annotated[float, expert("factor between two depths that differ", 1.01, 100)] = 1.25


def is_behind(setup: Setup, some: Tracks, others: Tracks, fewest: int | None = None) -> bool:
    """Whether some points lie behind the others: where depths differ, most of the others are nearer than neighbours.

    At least `fewest` of them must be. Each of the others is compared with its own neighbour, because the scene
    surrounds a body. (The floor in front of a camera is nearer than a body as well, but far from it in the image.)
    """
    rules, order = setup.rules.of(StartRules), depth_order(others, some, setup.rules.of(StartRules))
    before, behind = ((order == k).sum() for k in (-1, 1))
    fewest = setup.rules.of(RobustRules).second_views if fewest is None else fewest
    return bool(before >= fewest and before > rules.behind * (before + behind))


def is_deeper(setup: Setup, some: Tracks, others: Tracks) -> bool:
    """Whether some points lie behind their neighbours among the others, and hardly any of the others is as far away."""
    if len(some) < MIN_VIEWS:
        return False
    as_far = np.count_nonzero(others.points[:, 3] < setup.rules.of(StartRules).deeper * median(some.points[:, 3]))
    return bool(as_far < MANY_VIEWS) and is_behind(setup, some, others)


def depth_order(some: Tracks, others: Tracks, rules: StartRules) -> NDArray[np.int64]:
    """Return whether points (n,) lie behind (1) or in front of (−1) their nearest neighbours among the others, or 0."""
    if not len(others):
        return np.zeros(len(some), np.int64)
    nearest = np.argmin(((some.left_px[:, None] - others.left_px) ** 2).sum(axis=2), axis=1)
    ratio = others.points[nearest, 3] / np.maximum(some.points[:, 3], 1e-9)
    return (ratio > rules.deeper).astype(np.int64) - (ratio < 1 / rules.deeper)
