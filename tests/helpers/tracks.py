"""Tracks made by hand."""

import numpy as np

from stream_sfm.frontend.templates import JUST_CUT
from stream_sfm.frontend.tracks import Tracks


def tracks_at(depth_m: np.ndarray, agreed: np.ndarray | None = None, left_px: np.ndarray | None = None) -> Tracks:
    """Tracks (n) of these depths (n,), side by side along a row where no places (n, 2) are given, and their history."""
    n = len(depth_m)
    rays, row_px = np.zeros((n, 2)), np.stack([10.0 * np.arange(n), np.zeros(n)], axis=1)
    return Tracks(
        ids=np.arange(n), slots=np.arange(n), left_px=row_px if left_px is None else left_px,
        cov_left_px=np.zeros((n, 2, 2)),
        points=np.concatenate([rays, np.ones((n, 1)), 1 / depth_m[:, None]], axis=1), var_rho=np.zeros(n),
        anchor_from_start=np.zeros((n, 4, 4)), anchor_rays=rays, anchor_velocity_px_s=np.zeros((n, 2)),
        slopes=np.zeros((n, 2)), exposures=np.tile(JUST_CUT, (n, 1)), contrast=np.full(n, np.nan),
        scale=np.ones(n, np.int64), agreed=np.zeros(n, np.int64) if agreed is None else agreed,
    )  # fmt: skip
