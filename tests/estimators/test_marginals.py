"""WC and CC come from one joint covariance: against numerical propagation of the same, written out densely."""

import numpy as np

from stream_sfm.estimators.cross_frame.inverse_depth import NormalBlocks, State, linearise
from stream_sfm.estimators.cross_frame.marginals import Marginals
from stream_sfm.estimators.cross_frame.normal_equations import System
from stream_sfm.estimators.cross_frame.prior import Prior
from stream_sfm.estimators.cross_frame.rig_knowledge import RigKnowledge
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.estimators import dense_system, in_reference, point_blocks, q_from_homogeneous, window_views

P = StereoProjection(600.0, 250.0, 262.0, 240.0, 0.25, 512, 480)
FRAMES, POINTS, MODES, RIG = 2, 6, 8, 3  # the last modes are those of the rig's errors
SIZE = 6 * FRAMES + 3 * POINTS + MODES


def dense_information(lin: NormalBlocks, prior: Prior) -> np.ndarray:
    """Of [poses, q, modes], eqs. (26) and (30)."""
    h = np.zeros((SIZE, SIZE))
    at, y = np.r_[: SIZE - MODES, SIZE - RIG : SIZE], slice(SIZE - MODES, SIZE)
    h[np.ix_(at, at)] = dense_system(lin)[0]
    h[y, y] += np.eye(MODES)
    for i in range(POINTS):
        a = slice(6 * FRAMES + 3 * i, 6 * FRAMES + 3 * i + 3)
        pull = np.linalg.solve(prior.cov[i], prior.modes[i])
        h[a, a] += np.linalg.inv(prior.cov[i])
        h[a, y] -= pull
        h[y, a] -= pull.T
        h[y, y] += prior.modes[i].T @ pull
    return h


def test_marginals_are_the_joint_covariance_propagated() -> None:
    rng = np.random.default_rng(0)
    anchors, cams = se3.exp(0.1 * rng.normal(size=(POINTS, 6))), se3.exp(0.1 * rng.normal(size=(FRAMES, 6)))
    metric = np.c_[rng.uniform(-1, 1, (POINTS, 2)), rng.uniform(2, 4, POINTS), np.ones(POINTS)]
    q = q_from_homogeneous((se3.inverse(anchors) @ metric[..., None])[..., 0])
    world = se3.exp(0.5 * rng.normal(size=6))
    prior = Prior(
        ids=np.arange(POINTS),
        mean=q,
        cov=np.broadcast_to(1e-6 * np.eye(3), (POINTS, 3, 3)),
        modes=1e-3 * rng.normal(size=(POINTS, 3, MODES)),
        world_from_ref=world,
        world_modes=1e-2 * rng.normal(size=(6, MODES)),
        rig=RigKnowledge.unknown(np.ones(RIG)),
    )
    frame, point = np.divmod(np.arange(FRAMES * POINTS), POINTS)
    z = P.project_homogeneous((cams[frame] @ in_reference(anchors, q)[point][..., None])[..., 0])
    roots = np.broadcast_to(3 * np.eye(4), (len(z), 4, 4))
    views = window_views(frame, point, z, roots, rng.normal(size=(len(z), 4, RIG)))
    state = State(cams, np.arange(POINTS), anchors, q, np.zeros(RIG))
    lin = linearise(P, state, views)
    system = System(prior, np.arange(POINTS), lin, q, np.zeros(MODES))
    newest = FRAMES - 1
    marginals = Marginals.compute(system, state, world)
    information = dense_information(lin, prior)
    cov, cov_given = np.linalg.inv(information), np.zeros((SIZE, SIZE))
    cov_given[:-RIG, :-RIG] = np.linalg.inv(information[:-RIG, :-RIG])
    world_from_cam = world @ se3.inverse(cams[newest])
    assert np.allclose(marginals.world_from_cam, world_from_cam, atol=1e-12)

    def read(delta: np.ndarray) -> np.ndarray:
        """Pose error, points in the newest camera, in the world, and q in the camera, of a disturbed state."""
        cam = se3.exp(delta[6 * newest : 6 * newest + 6]) @ cams[newest]
        in_ref = in_reference(anchors, q + delta[6 * FRAMES : -MODES].reshape(POINTS, 3))
        in_ref = in_ref[:, :3] / in_ref[:, 3:]
        world_from_ref = world @ se3.exp(prior.world_modes @ delta[-MODES:])
        xi = se3.log(se3.inverse(world_from_cam) @ world_from_ref @ se3.inverse(cam))
        in_cam, in_world = se3.transform(cam, in_ref), se3.transform(world_from_ref, in_ref)
        q_in_cam = q_from_homogeneous(np.c_[in_cam, np.ones(POINTS)])
        return np.concatenate([xi, in_cam.ravel(), in_world.ravel(), q_in_cam.ravel()])

    j = np.stack([(read(h) - read(-h)) / 2e-6 for h in 1e-6 * np.eye(SIZE)], axis=1)
    carried = j @ cov @ j.T
    blocks, blocks_given = point_blocks(carried[6:, 6:]), point_blocks((j @ cov_given @ j.T)[6:, 6:])
    for mine, theirs in (
        (marginals.cov_pose, carried[:6, :6]),
        (marginals.cov_points, blocks[:POINTS]),
        (marginals.cov_points_in_world, blocks[POINTS : 2 * POINTS]),
        (marginals.cov_q_in_cam, blocks_given[2 * POINTS :]),
    ):
        assert np.abs(mine - theirs).max() < 1e-6 * np.abs(theirs).max()
