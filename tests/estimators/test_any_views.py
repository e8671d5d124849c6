"""For any views and covariances, the window returns finite numbers for each frame, or is lost."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config, RigConfig, WindowConfig
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.cross_frame import CrossFrame
from stream_sfm.estimators.window.rig_state import RigState
from stream_sfm.frontend.learnt.usual_turns import TurnRules
from stream_sfm.geometry import se3
from stream_sfm.rig_model.model import RigModel
from stream_sfm.rig_model.terms import TERMS
from stream_sfm.simulation.scenes import MOTIONS, Scene
from stream_sfm.types import Ambiguity, Observations, RigView, Status

SEQUENCE = Scene(frames=10, motion=MOTIONS["arc"], visible=50, round_off=False).sequence(np.random.SeedSequence(5))
MODEL = RigModel.of(SEQUENCE.projection, RigConfig())
OF_CAMERA = ("world_from_cam", "cov_pose", "window_world_from_cam")
OF_POINTS = ("points_in_cam", "cov_points", "points_in_world", "cov_points_in_world")
OF_ENDED = ("ended_points_in_world", "ended_cov_points_in_world")


def some(o: Observations, keep: np.ndarray) -> Observations:
    return replace(o, track_ids=o.track_ids[keep], z_px=o.z_px[keep], cov_px=o.cov_px[keep], n_new=0)


def damaged(o: Observations, rng: np.random.Generator, kind: int) -> Observations:
    """Observations with impossible or extreme values."""
    z_px, n, size = o.z_px.copy(), len(o.track_ids), rng.choice([1e-6, 1.0, 1e6])
    match kind:
        case 0:
            return some(o, rng.permutation(n) < rng.integers(0, 12))
        case 1:
            z_px[rng.random(n) < rng.choice([0.3, 0.9, 1.0]), 2:] = np.nan
        case 2:
            z_px = rng.permutation(z_px)
        case 3:
            z_px[:] = z_px[:1]
        case 4:
            z_px[:, [1, 3]] = 200.0
        case 5:
            z_px[:, 2] = z_px[:, 0] - rng.choice([0, 1e-9, -5])
        case 6:
            z_px += rng.normal(size=z_px.shape) * 10 * size
        case 7:
            return replace(o, cov_px=o.cov_px * size**2)
        case 8:
            return replace(o, cam_from_previous=se3.exp(rng.normal(size=6) * rng.choice([0.1, 10, 1e4])))
        case 9:
            other = Ambiguity(se3.exp(rng.normal(size=6) * 0.1), np.eye(6) * size, misfit=bool(rng.random() < 0.5))
            return replace(o, cam_from_previous=np.eye(4), ambiguity=other)
        case 10:
            return replace(o, rig=replace(o.rig, change_root=MODEL.root_of_turn(TurnRules().std_rad) * size))
        case 11:
            return replace(o, rig=replace(o.rig, delay_by_rows=(size**2, size**2 * rng.normal())))
        case 12:
            return replace(o, rig=replace(o.rig, field_std_px=size))
    return replace(o, z_px=z_px)


@pytest.mark.parametrize("seed", range(16))
def test_any_views_give_finite_estimates_or_a_reason(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds, share = rng.choice(13, size=2, replace=False), rng.choice([0.2, 0.6, 1.0])
    config = Config(window=WindowConfig(frames=int(rng.choice([1, 2, 5]))))
    estimator = make_estimator("cross-frame", SEQUENCE.projection, config)
    for o in SEQUENCE.observations:
        o = replace(o, rig=RigView(MODEL, 0.01))
        for kind in kinds:
            if rng.random() < share and len(o.track_ids):
                o = damaged(o, rng, kind)
        if o.frame_index == 7:
            o = some(o, np.zeros(len(o.track_ids), bool))
        solution = estimator.step(o)
        assert all(np.isfinite(getattr(solution, name)).all() for name in OF_CAMERA + OF_POINTS + OF_ENDED)
        assert solution.relative is None or np.isfinite(solution.relative.cov).all()
        assert solution.status in (Status.OK, Status.INITIALISING) or solution.reason


@pytest.mark.parametrize("size", [30, 300])
def test_a_map_that_cannot_continue_makes_the_rig_unknown_again(size: float) -> None:
    """Otherwise every later map would begin with the same wrong rig, and end in its second frame."""
    estimator = CrossFrame(SEQUENCE.projection, Config())
    wrong = RigState.unknown(np.full(len(TERMS), 1e-3), sizes_unknown=False)
    estimator.rig = replace(wrong, mean=wrong.mean + size * np.random.default_rng(0).normal(size=len(TERMS)))
    status = [estimator.step(replace(o, rig=RigView(MODEL, 0.01))).status for o in SEQUENCE.observations]
    assert Status.LOST in status[:3]
    assert set(status[6:]) == {Status.OK}
