"""How far the map of one camera has come."""

from dataclasses import field

import numpy as np

from ...geometry.se3 import Array
from ...record import record


@record
class MapState:
    """Part of `FrontEndState` that a pair does not need.

    `mapped`: whether there is a map; before, `waiting` says for what, and the opening frame had `n_opened` points. Ids
    from `first_unseen_id` on have not been handed out. `rho_scene`: median inverse depth of what was last in view, 0
    before the first map; `cov_start` (6, 6): of first_from_now when the map has begun.
    """

    mapped: bool = False
    waiting: str = ""
    n_opened: int = 0
    first_unseen_id: int = 0
    rho_scene: float = 0.0
    cov_start: Array = field(default_factory=lambda: np.zeros((6, 6)))
