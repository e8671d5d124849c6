"""The points of a map: a block of its state."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry import Array, se3
from ...record import changed, columns_at, record


@record
class MapPoints:
    """Points (P,) of a map: `ids`, ascending, and `q` (P, 3) in the cameras that first saw them, their anchors.

    `ref_from_anchor` (P, 4, 4): the poses of the anchors in the reference camera, which count as known.
    """

    ids: NDArray[np.int64]
    q: Array
    ref_from_anchor: Array

    @classmethod
    def of_reference(cls, ids: NDArray[np.int64], q: Array) -> "MapPoints":
        """Return points first seen by the reference camera."""
        return cls(ids, q, np.tile(np.eye(4), (len(ids), 1, 1)))

    def __len__(self) -> int:
        return len(self.ids)

    def keep(self, rows: NDArray[Any]) -> "MapPoints":
        """Return the points selected by a mask or by rows."""
        return MapPoints(*columns_at((self.ids, self.q, self.ref_from_anchor), rows))

    def with_new(self, ids: NDArray[np.int64], q: Array, ref_from_cam: Array) -> "MapPoints":
        """Return these points and new ones, first seen by a camera (4, 4)."""
        ids = np.concatenate([self.ids, ids])
        order = np.argsort(ids)
        anchors = np.broadcast_to(ref_from_cam, (len(q), 4, 4))
        return MapPoints(
            ids[order],
            np.concatenate([self.q, q])[order],
            np.concatenate([self.ref_from_anchor, anchors])[order],
        )

    def seen_from(self, cam_from_ref: Array) -> "MapPoints":
        """Return the points for another reference camera (4, 4); their anchors stay."""
        return changed(self, ref_from_anchor=se3.orthonormalise(cam_from_ref @ self.ref_from_anchor))
