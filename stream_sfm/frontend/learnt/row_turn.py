"""The turn of the right camera that row differences show: its relative pitch and roll."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...geometry import Array
from ...geometry.stereo import places_over_image
from ...rig_model.estimate import is_certain
from ...rig_model.terms import effects_of_turn
from .rows import Rows, row_terms

# Rows count as turned from this RMS over the image on, if a turn leaves less than a share of them. The rest is of
# lenses: the rows of KITTI's rectified images differ by half a pixel that is no turn.
_LEAST_PX, _MOST_LEFT = 0.05, 0.3
_SAME_RAD = 1e-5  # by which rigs turn between logs, at least


class RowTurn(NamedTuple):
    """A turn of the right camera about its rectified x and z: `rad` (2,) with `cov` (2, 2).

    `rows_px`: the RMS shift of rows by it over the image; `left`: the share of the row differences that it leaves.
    """

    rad: Array
    cov: Array
    rows_px: float
    left: float

    @property
    def is_real(self) -> bool:
        """Whether the turn is certain and explains the rows, and the rows matter."""
        return self.rows_px >= _LEAST_PX and self.left <= _MOST_LEFT and is_certain(self.rad, self.cov)


def turn_by_rows(rows: Sequence[Rows]) -> RowTurn:
    """Return the turn that the row differences of some logs with one rig show, eq. (72d).

    Relative pitch and roll of the cameras are such turns. So is the row of a principal point, but for some hundredths
    of a pixel of disparity.
    """
    projection = rows[0].projection
    places_px = places_over_image(projection, 9, 9)
    by_turn = effects_of_turn(projection, places_px)[:, 1][:, [0, 2]]
    information: Array = np.zeros((2, 2))
    weighted: Array = np.zeros(2)
    differences = []
    for of_log in rows:
        terms = row_terms(projection, places_px, np.zeros(len(places_px)))
        difference_px, cov_px2 = terms @ of_log.mean, terms @ of_log.cov @ terms.T
        weights = 1 / (np.diag(cov_px2) + of_log.rules.std_match_px**2)  # corners without matches count little
        fit = np.linalg.solve(by_turn.T * weights @ by_turn, by_turn.T * weights)
        own = np.linalg.inv(fit @ cov_px2 @ fit.T + _SAME_RAD**2 * np.eye(2))
        information, weighted = information + own, weighted + own @ fit @ difference_px
        differences.append(difference_px)
    cov: Array = np.asarray(np.linalg.inv(information), float)
    turn: Array = cov @ weighted
    all_px = np.array(differences)
    left = np.sqrt(((all_px - by_turn @ turn) ** 2).sum() / max((all_px**2).sum(), 1e-12))
    return RowTurn(turn, cov, float(np.sqrt(((by_turn @ turn) ** 2).mean())), float(left))
