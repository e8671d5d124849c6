"""The motion since the previous frame from which every estimator starts a frame, and its outlier test."""

import numpy as np

from ..geometry import Array, se3
from ..geometry.point_views import PointViews
from ..geometry.resection import Resection, SecondMotion, resect
from ..record import changed
from ..types import Observations


def initial_motion(
    views: PointViews,
    observations: Observations,
    cam_from_previous_predicted: Array,
    weights: Array | None = None,
    amplitudes: Array | None = None,
) -> Resection | None:
    """Find cam_from_previous by robust resection of views (n); None if too few agree or they do not determine it.

    The views are those among the `observations` that see points of the previous camera's local structure. The search
    starts from the motion that the front-end found, or else from the prediction of the motion model. If few views agree
    with the result, `resect` searches the whole space of motions, unless the front-end has decided between two.
    `weights` (n,), `amplitudes` (j,): as in `resect`.
    """
    start, ambiguity = observations.cam_from_previous, observations.ambiguity
    try:
        found = resect(
            views,
            cam_from_previous_predicted if start is None else start,
            weights,
            find_second=start is None,
            start_is_close=start is not None,
            start_is_decided=ambiguity is not None and ambiguity.other_from_previous is not None,
            amplitudes=amplitudes,
        )
    except np.linalg.LinAlgError:
        return None
    if not found.ok or found.accepted.sum() < views.settings.min_inliers:
        return None
    return found if start is None else changed(found, second=_second_motion(found, observations))


def _second_motion(found: Resection, observations: Observations) -> SecondMotion | None:
    """Return the other of two motions if the front-end could not decide between them; it measured all views again."""
    ambiguity, own = observations.ambiguity, observations.cam_from_previous
    if ambiguity is None or own is None or ambiguity.other_from_previous is None or ambiguity.cov_other is None:
        return None
    motions = ambiguity.other_from_previous, own
    apart = [np.linalg.norm(se3.log(found.cam_from_ref @ se3.inverse(m))) for m in motions]
    return SecondMotion(
        motions[0] if apart[0] > apart[1] else own,
        ambiguity.cov_other,
        views=np.zeros_like(found.accepted),
        odds=1.0,
    )
