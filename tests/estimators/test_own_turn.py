"""The turn of a frame: its size is found before views are gated. It decides nothing about a second motion."""

import numpy as np
import pytest

from stream_sfm.config.robust_rules import RobustRules
from stream_sfm.estimators.window.unknowns.turn import size_turn
from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, SecondMotion, resect
from stream_sfm.geometry.sizes import Sizes
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed
from stream_sfm.rig_model.terms import by_turn
from tests.helpers.rectified import scattered_points

P = StereoProjection(420.0, 255.0, 257.0, 190.0, 0.16, 512, 384)
N, STD_PX, STD_RAD = 120, 0.1, 1e-4
MOTION = se3.exp(np.array([0.02, 0.01, -0.2, 0.001, 0.01, 0.0]))
SECOND = SecondMotion(np.eye(4), np.eye(6), np.zeros(N, bool), 1.0)


def sized(turn: float, of_delay: float = 0.0, seed: int = 0) -> tuple[Sizes, PointViews, Resection, Resection]:
    """Sizes, views and motion after a frame with a turn of so many `STD_RAD` about y, and the motion before.

    A further error that the views share moves all right sides by half a pixel, so many times (`of_delay`).
    """
    rng = np.random.default_rng(seed)
    points = scattered_points(rng, N)
    z_px = P.project_homogeneous(points @ MOTION.T) + STD_PX * rng.normal(size=(N, 4))
    columns = by_turn(P, z_px, STD_RAD * np.eye(3))
    others = np.zeros((N, 4, 1))
    others[:, 2, 0] = 0.5 + 0.01 * rng.normal(size=N)
    z_px = z_px + columns @ np.array([0.3, turn, 0.3]) + of_delay * others[..., 0]
    cov_px, shared = np.tile(STD_PX**2 * np.eye(4), (N, 1, 1)), np.concatenate([columns, others], axis=2)
    seen = PointViews(P, points, None, z_px, cov_px, RobustRules(), shared)
    found = changed(resect(seen, MOTION, np.ones(N)), second=SECOND)
    return *size_turn(Sizes(), 3, seen, np.ones(N), found), found


def test_a_usual_turn_changes_nothing() -> None:
    sizes, seen, motion, before = sized(1.0)
    assert sizes.probable == 1 and motion is before
    assert seen.shared.shape == (N, 4, 4)


@pytest.mark.parametrize("turn", [15.0, 60.0])
def test_a_large_turn_is_found_and_explains_all_views(turn: float) -> None:
    """It moves all right views by up to 2.5 px at once, 25 σ of each."""
    sizes, seen, motion, _ = sized(turn)
    assert sizes.probable in (4, 16, 64) and sizes.probable > turn / 8
    assert motion.accepted.mean() > 0.97 and motion.second is SECOND
    apart = se3.log(motion.cam_from_ref @ se3.inverse(MOTION))
    assert apart @ np.linalg.solve(motion.cov_pose, apart) < 22  # 6 expected, 0.1 %
    std = sizes.probable * np.sqrt(motion.cov_amplitudes[1, 1])
    assert abs(motion.amplitudes[1] * sizes.probable - turn) < 3.5 * std < 0.5 * turn
    assert seen.shared[0, 2, 1] == pytest.approx(sizes.probable * sized(1.0)[1].shared[0, 2, 1], rel=0.05)


def test_what_another_error_explains_is_no_larger_turn() -> None:
    """An offset of all right views by 2 σ of an error that looks like the turn about y."""
    assert sized(0.0, of_delay=2.0)[0].probable == 1
