"""The factored prior, the window's system and its marginals against the same Gaussians written out densely."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.core import NormalBlocks, _core
from stream_sfm.estimators.window import prior as prior_module
from stream_sfm.estimators.window.inverse_depth import State, WhitenedViews, linearise, points_alone
from stream_sfm.estimators.window.normal_equations import System
from stream_sfm.estimators.window.prior import Prior
from stream_sfm.estimators.window.reported.marginals import Marginals
from stream_sfm.estimators.window.rig_state import RigState
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed
from tests.helpers.estimators import in_reference, point_blocks, q_from_homogeneous, window_views, without_own

P = StereoProjection(600.0, 250.0, 262.0, 240.0, 0.25, 512, 480)
N, K, M, E = 9, 10, 2, 2  # points; modes; those of the rig among them; a frame's own errors
FRAMES, TOTAL = 2, N + 3  # of a window, with three points that are not in the prior
NEW = 2  # points that enter the prior with a frame
ANCHORS = se3.exp(0.1 * np.random.default_rng(4).normal(size=(N, 6)))


def spd(rng, count: int, size: int, scale: float) -> np.ndarray:
    a = rng.normal(size=(count, size, size))
    return scale * (a @ np.swapaxes(a, 1, 2) + 0.3 * np.eye(size))


@pytest.fixture
def prior() -> Prior:
    rng = np.random.default_rng(5)
    points = np.stack([rng.uniform(-1, 1, N), rng.uniform(-1, 1, N), rng.uniform(2, 6, N), np.ones(N)], axis=1)
    q = q_from_homogeneous((se3.inverse(ANCHORS) @ points[..., None])[..., 0])
    return Prior(
        ids=np.arange(N),
        mean=q,
        cov=spd(rng, N, 3, 1e-6),
        modes=1e-3 * rng.normal(size=(N, 3, K)),
        world_from_ref=se3.exp(rng.normal(size=6)),
        world_modes=1e-3 * rng.normal(size=(6, K)),
        rig=replace(
            RigState.unknown(np.ones(M)),
            mean=rng.normal(size=M),
            information=np.linalg.inv([[0.53, 0.08], [0.08, 0.16]]),
            size=np.ones(M),
        ),
    )


def dense(prior: Prior) -> np.ndarray:
    """Joint covariance of all q, of ω and of the rig's errors."""
    of_rig = np.eye(prior.modes.shape[2])[-M:]
    modes = np.concatenate([prior.modes.reshape(3 * len(prior.ids), -1), prior.world_modes, of_rig])
    cov_amplitudes = np.eye(prior.modes.shape[2])
    cov_amplitudes[-M:, -M:] = np.linalg.inv(prior.rig.information)
    cov = modes @ cov_amplitudes @ modes.T
    for i, block in enumerate(prior.cov):
        cov[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block
    return cov


def _estimated(prior: Prior) -> np.ndarray:
    """The mean of all q, of ω and of the rig's errors relative to the linearisation point."""
    modes = np.concatenate([prior.modes[..., -M:].reshape(-1, M), prior.world_modes[:, -M:], np.eye(M)])
    return np.asarray(modes @ np.linalg.solve(prior.rig.information, prior.rig.weighted))


def one_frame(rng, q: np.ndarray, x: np.ndarray, rig_error: np.ndarray) -> tuple[State, WhitenedViews]:
    """Views of each point but one, and of new ones, by the camera x, which is the reference."""
    anchors = np.concatenate([se3.orthonormalise(x @ ANCHORS), np.broadcast_to(np.eye(4), (NEW, 4, 4))])
    q = np.concatenate([q, [[0.1, 0.2, 0.3], [-0.2, 0.1, 0.25]]])
    state = State(np.eye(4)[None], np.arange(N + NEW), anchors, q, rig_error, rng.normal(size=(1, E)))
    z = P.project_homogeneous(in_reference(anchors, q))
    views = window_views(
        np.zeros(N + NEW, int),
        np.arange(N + NEW),
        z + rng.normal(size=z.shape),
        np.broadcast_to(0.7 * np.eye(4), (len(z), 4, 4)),
        rng.normal(size=(len(z), 4, M)),
        own=rng.normal(size=(len(z), 4, E)),
    )
    return state, changed(views, used=np.arange(N + NEW) != 2)


def absorbed_densely(prior: Prior, y: np.ndarray, x: np.ndarray, q: np.ndarray, b: NormalBlocks) -> tuple:
    """Mean and covariance of [q', ω', c] after the views, by a Kalman update with a practically unknown pose."""
    anchors = se3.orthonormalise(x @ ANCHORS)
    moves = np.concatenate([-1e-6 * np.eye(6), 1e-6 * np.eye(6)])[:, None]  # of the reference camera, q's numerically
    moved = se3.inverse(anchors) @ se3.exp(moves) @ in_reference(anchors, q)[..., None]
    less, more = np.split(q_from_homogeneous(moved[..., 0]), 2)
    by_pose = np.moveaxis((more - less) / 2e-6, 0, -1)
    n = 3 * N
    # [q, ω, c, ξ] -> [q', ω', c], with ξ large compared with millimetres
    carry = np.zeros((n + 6 + M, n + 12 + M))
    carry[:n, :n], carry[n + 6 :, n + 6 : n + 6 + M] = np.eye(n), np.eye(M)
    carry[:n, -6:] = by_pose.reshape(n, 6)
    carry[n : n + 6, n : n + 6], carry[n : n + 6, -6:] = se3.adjoint(x), -np.eye(6)
    joint = np.zeros((n + 12 + M, n + 12 + M))
    joint[:-6, :-6], joint[-6:, -6:] = dense(prior), 1e2 * np.eye(6)
    before = carry @ joint @ carry.T
    info = np.zeros_like(before)
    for i, block in enumerate(b.v):
        info[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        info[3 * i : 3 * i + 3, n + 6 :] = b.rig_point[i]
        info[n + 6 :, 3 * i : 3 * i + 3] = b.rig_point[i].T
    info[n + 6 :, n + 6 :] = b.rig
    with_own = np.concatenate([b.w[..., 6:].reshape(n, E), np.zeros((6, E)), b.rig_pose[0, 6:].T])
    gain = np.linalg.solve(b.u[0, 6:, 6:], with_own.T).T
    info -= gain @ with_own.T
    # the prior's mean at modes 0, seen from the state at modes y
    at_y = np.concatenate([(prior.mean - q).ravel(), -prior.world_modes @ y, -y[-M:]])
    away = carry[:, :-6] @ at_y
    right = np.concatenate([b.g_point.ravel(), np.zeros(6), b.g_rig]) - gain @ b.g_pose[0, 6:]
    cov = before @ np.linalg.inv(np.eye(len(before)) + info @ before)
    return away + cov @ (right - info @ away), cov


def test_absorbing_a_frame_is_a_kalman_update_with_an_unknown_pose(prior, monkeypatch) -> None:
    """Information about errors of the rig is kept; all else is estimated with these errors held."""
    rng = np.random.default_rng(6)
    y, x = rng.normal(size=K), se3.exp(0.05 * rng.normal(size=6))
    q = prior.mean + prior.modes @ y  # linearised at the prior's own prediction, so that means can be compared linearly
    state, views = one_frame(rng, q, x, prior.rig_at(y))
    of_prior, of_new = (
        state._replace(ids=state.ids[k], ref_from_anchor=state.ref_from_anchor[k], q=state.q[k])
        for k in (slice(N), slice(N, None))
    )
    mean, cov = absorbed_densely(prior, y, x, q, linearise(P, of_prior, views))
    _, cov_alone, by_own, _ = points_alone(P, views, of_new, np.zeros(M))
    monkeypatch.setattr(prior_module, "_NEGLIGIBLE_SHARE", 0.0)
    after = prior.absorb_frame(P, state, views, np.ones(N + NEW, bool), y, x)
    assert after.ids.tolist() == list(range(N + NEW)) and after.cov[N:] == pytest.approx(cov_alone, rel=1e-6)
    # the errors that new points share with the frame, from the posterior of its own amplitudes given the rest
    shared = after.modes[N:].reshape(3 * NEW, -1)
    cov_new = shared[:, :-M] @ shared[:, :-M].T
    own = np.linalg.lstsq(by_own.reshape(3 * NEW, E), shared[:, :-M], rcond=None)[0]
    assert np.allclose(by_own.reshape(3 * NEW, E) @ own, shared[:, :-M])
    assert (np.linalg.eigvalsh(own @ own.T) < 1).all() and np.trace(cov_new) > 0
    after = replace(after, ids=after.ids[:N], mean=after.mean[:N], cov=after.cov[:N], modes=after.modes[:N])
    scale = np.sqrt(np.diag(cov))
    # a pose of σ 10 is practically unknown
    assert np.abs((dense(after) - cov) / np.outer(scale, scale)).max() < 1e-4
    rig_error = expected(after)[-M:] - (prior.rig.mean + y[-M:])
    assert rig_error == pytest.approx(mean[-M:], abs=1e-3 * scale[-M:].min())  # the same
    assert after.rig.mean == pytest.approx(prior.rig.mean + y[-M:], rel=1e-12)
    mean = mean - cov[:, -M:] @ np.linalg.solve(cov[-M:, -M:], mean[-M:])
    assert np.abs((after.mean - q).ravel() - mean[: 3 * N]).max() < 1e-3 * scale[: 3 * N].min()  # the same
    centre = prior.world(y) @ se3.inverse(x)
    moved = se3.log(se3.inverse(centre) @ after.world_from_ref)
    assert np.abs(moved - mean[3 * N : -M]).max() < 1e-3 * scale[3 * N : -M].min()  # the same


def truncated(prior: Prior) -> Prior:
    """The prior without modes that add less than half of the points' own variance."""
    cov, modes, world_modes = _core._truncate_modes(prior.cov, prior.modes, prior.world_modes, M, 0.5)
    return replace(prior, cov=cov, modes=modes, world_modes=world_modes)


def test_truncating_modes_keeps_every_marginal_and_the_world(prior) -> None:
    rng = np.random.default_rng(7)
    # two modes that are negligible beside the points' own noise, and four that repeat others
    modes = np.concatenate([1e-6 * rng.normal(size=(N, 3, 2)), prior.modes[..., :4], prior.modes], axis=2)
    world_modes = np.concatenate([np.zeros((6, 2)), prior.world_modes[:, :4], prior.world_modes], axis=1)
    full = replace(prior, modes=modes, world_modes=world_modes)
    small = truncated(full)
    assert small.modes.shape[2] < modes.shape[2]
    a, b = dense(full), dense(small)
    scale = np.sqrt(np.diag(a))
    difference = np.abs(a - b) / np.outer(scale, scale)
    rest = -6 - M
    assert difference[rest:].max() < 1e-12  # the world and the rig, and every point's correlation with them
    marginal = difference[:rest, :rest].reshape(N, 3, N, 3)[np.arange(N), :, np.arange(N), :]
    assert marginal.max() < 1e-12
    assert difference.max() < 1e-3  # of σ, between two points: the error of truncation


@pytest.mark.parametrize(("share", "stays"), [(0.49, False), (0.51, True)])
def test_a_truncated_mode_adds_half_a_variance_at_most_to_all_that_follows_from_points(prior, share, stays) -> None:
    """Eq. (36a), for x (6,) by least squares with random Jacobians, and with those that have most of the mode."""
    rng = np.random.default_rng(8)
    mode, own = rng.normal(size=(N, 3)), np.zeros((3 * N, 3 * N))
    for i, block in enumerate(prior.cov):
        own[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    information = np.linalg.inv(own)
    mode *= np.sqrt(share / (mode.ravel() @ information @ mode.ravel()))
    exact = replace(prior, modes=np.zeros_like(prior.modes), world_modes=np.eye(6, K))
    modes = np.concatenate([mode[..., None], exact.modes], axis=2)
    shared = replace(exact, modes=modes, world_modes=np.concatenate([np.zeros((6, 1)), exact.world_modes], axis=1))
    assert truncated(shared).modes.shape[2] == (6 + M + 1 if stays else 6 + M)
    added = []
    for of_mode in (0.0, 1e6):
        jacobian = rng.normal(size=(3 * N, 6))
        jacobian[:, 0] += of_mode * mode.ravel()
        of_x = jacobian.T @ information @ jacobian
        moved = np.linalg.solve(of_x, jacobian.T @ information @ mode.ravel())
        added.append(moved @ of_x @ moved)
    assert added[0] < added[1] <= share * (1 + 1e-9)
    assert added[1] == pytest.approx(share, rel=0.05)


def expected(prior: Prior) -> np.ndarray:
    """Points, world and errors of the rig, the last with their knowledge."""
    return np.concatenate([prior.mean.ravel(), np.zeros(6), prior.rig.mean]) + _estimated(prior)


def measured(prior: Prior, rows: np.ndarray, information: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance after a measurement of some errors of the rig, with the Kalman gain."""
    before, h = dense(prior), np.eye(3 * N + 6 + M)[-M:][rows]
    gain = before @ h.T @ np.linalg.inv(h @ before @ h.T + np.diag(1 / information))
    mean = expected(prior)
    return mean + gain @ (z - h @ mean), before - gain @ h @ before


def assert_known(prior: Prior, mean: np.ndarray, cov: np.ndarray) -> None:
    scale = np.sqrt(np.diag(cov))
    assert np.abs((dense(prior) - cov) / np.outer(scale, scale)).max() < 1e-9
    assert np.abs((expected(prior) - mean) / scale).max() < 1e-9


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ((0.2**-2 - 1, 2.0**-2 - 1), (0.0, 0.0)),  # σ of 0.2 and 2 instead of 1
        ((0.0, 3.0), (0.0, 0.7)),
        ((0.0, 1e6), (0.0, 0.7)),
        ((0.0, -0.2), (0.0, 0.7)),  # rows contain less information than before
    ],
)
def test_information_about_errors_is_a_measurement_of_them(prior, more, said) -> None:
    """Information is negative if an error may be larger than assumed, or rows contain less than before."""
    prior = replace(prior, rig=replace(prior.rig, weighted=np.array([0.3, -0.8])))
    (rows,), information = np.nonzero(more), np.array(more)
    known = measured(prior, rows, information[rows], np.array(said)[rows])
    assert_known(replace(prior, rig=prior.rig.informed(information, information * said)), *known)


@pytest.mark.parametrize("weighted", [(0.0, 0.0), (0.3, -0.8)])
def test_a_change_of_the_rig_adds_to_its_errors_alone(prior, weighted) -> None:
    """Points and world keep their correlation with the old errors.

    If an estimate is held back, the part that the new errors no longer contain counts as covariance.
    """
    prior = replace(prior, rig=replace(prior.rig, weighted=np.array(weighted)))
    change = np.array([[0.5, 0.1, -0.3], [0.2, -0.7, 0.4]])
    expected = dense(prior)
    expected[-M:, -M:] += change @ change.T
    after = prior.with_rig_change(prior.rig.changed(change))
    lost = _estimated(prior) - _estimated(after)
    scale = np.sqrt(np.diag(expected))
    assert np.abs((dense(after) - expected - np.outer(lost, lost)) / np.outer(scale, scale)).max() < 1e-12
    assert np.abs(lost[-M:]).max() < 1e-12  # the errors themselves keep their estimate
    assert (np.abs(lost).max() > 0) == any(weighted)
    assert (after.mean == prior.mean).all() and (after.world_from_ref == prior.world_from_ref).all()
    assert not after.rig.steady


def window_of(prior: Prior, rng: np.random.Generator) -> tuple[State, NormalBlocks, core.MovedWindow, float, System]:
    """Views of all points by two cameras, linearised, the state after a step, the decrease, and the factored system."""
    cams = se3.exp(0.05 * rng.normal(size=(FRAMES, 6)))
    anchors = np.concatenate([ANCHORS, np.broadcast_to(np.eye(4), (3, 4, 4))])
    q = np.concatenate([prior.mean, [[0.1, 0.2, 0.3], [-0.2, 0.1, 0.25], [0.0, -0.1, 0.4]]])
    frame, point = np.divmod(np.arange(FRAMES * TOTAL), TOTAL)
    z = P.project_homogeneous((cams[frame] @ in_reference(anchors, q)[point][..., None])[..., 0])
    views = window_views(
        frame,
        point,
        z + rng.normal(size=z.shape),
        np.broadcast_to(2 * np.eye(4), (len(z), 4, 4)),
        rng.normal(size=(len(z), 4, M)),
        own=rng.normal(size=(len(z), 4, E)),
    )
    state = State(cams, np.arange(TOTAL), anchors, q, prior.rig.mean, rng.normal(size=(FRAMES, E)))
    lin = linearise(P, state, views)
    solved, moved, decrease = core.window_step(P, state, views, prior, np.zeros(K), True, np.zeros((0, 0)), np.zeros(0))
    return state, lin, moved, decrease, System.of(prior, state.ids, solved, state.own.size)


def dense_window(prior: Prior, lin: NormalBlocks) -> tuple[np.ndarray, np.ndarray]:
    """Information and right side of poses, points, world and rig, eqs. (26) and (30)."""
    a, b = 6 * FRAMES, 3 * TOTAL
    h, g = np.zeros((a + b + 6 + M, a + b + 6 + M)), np.zeros(a + b + 6 + M)
    seen = np.r_[: a + b, a + b + 6 : a + b + 6 + M]
    h[np.ix_(seen, seen)], g[seen], _ = without_own(lin)
    with_prior = np.concatenate([a + np.arange(3 * N), a + b + np.arange(6 + M)])
    information = np.linalg.inv(dense(prior))
    h[np.ix_(with_prior, with_prior)] += information
    g[with_prior] += information @ _estimated(prior)
    return h, g


@pytest.mark.parametrize("own", [True, False])
def test_marginals_are_the_joint_covariance_propagated(prior, own) -> None:
    """WC and CC come from one joint covariance: against numerical propagation of the same, written out densely.

    The rig's errors have their covariance from views or their `own`, and more is added to the pose.
    """
    rng = np.random.default_rng(9)
    state, lin, _, _, system = window_of(prior, rng)
    information, points = dense_window(prior, lin)[0], slice(6 * FRAMES, 6 * FRAMES + 3 * TOTAL)
    cov, cov_given = np.linalg.inv(information), np.zeros_like(information)
    if own:
        gain, cov_held = cov[:, -M:] @ np.linalg.inv(cov[-M:, -M:]), spd(rng, 1, M, 0.05)[0]
        cov, system = cov + gain @ (cov_held - cov[-M:, -M:]) @ gain.T, system.with_cov_rig(cov_held)
    marginals = Marginals.compute(system, state, prior.world_from_ref, np.zeros((6, 6)))
    cov_given[:-M, :-M] = np.linalg.inv(information[:-M, :-M])
    world_from_cam = prior.world_from_ref @ se3.inverse(state.cams_from_ref[-1])
    assert np.allclose(marginals.world_from_cam, world_from_cam, atol=1e-12)
    assert marginals.finite.all()

    def read(delta: np.ndarray) -> np.ndarray:
        """Pose error, points in the newest camera, in the world, and q in the camera, of a disturbed state."""
        cam = se3.exp(delta[points.start - 6 : points.start]) @ state.cams_from_ref[-1]
        in_ref = in_reference(state.ref_from_anchor, state.q + delta[points].reshape(TOTAL, 3))
        in_ref = in_ref[:, :3] / in_ref[:, 3:]
        world_from_ref = prior.world_from_ref @ se3.exp(delta[points.stop : points.stop + 6])
        xi = se3.log(se3.inverse(world_from_cam) @ world_from_ref @ se3.inverse(cam))
        in_cam, in_world = se3.transform(cam, in_ref), se3.transform(world_from_ref, in_ref)
        q_in_cam = q_from_homogeneous(np.c_[in_cam, np.ones(TOTAL)])
        return np.concatenate([xi, in_cam.ravel(), in_world.ravel(), q_in_cam.ravel()])

    j = np.stack([(read(d) - read(-d)) / 2e-6 for d in 1e-6 * np.eye(len(cov))], axis=1)
    carried = j @ cov @ j.T
    blocks, blocks_given = point_blocks(carried[6:, 6:]), point_blocks((j @ cov_given @ j.T)[6:, 6:])
    for mine, theirs in (
        (marginals.cov_pose, carried[:6, :6]),
        (marginals.cov_points, blocks[:TOTAL]),
        (marginals.cov_points_in_world, blocks[TOTAL : 2 * TOTAL]),
        (marginals.cov_q_in_cam, blocks_given[2 * TOTAL :]),
    ):
        assert np.abs(mine - theirs).max() < 1e-6 * np.abs(theirs).max()
    assert core.newest_pose_covariance(state, system) == pytest.approx(marginals.cov_pose, rel=1e-12)
    more = spd(rng, 1, 6, 1e-4)[0]
    wide = Marginals.compute(system, state, prior.world_from_ref, more)
    by_pose = world_from_cam[:3, :3] @ se3.point_in_source_jacobian(marginals.points_in_cam)
    expected_cov = marginals.cov_points_in_world + by_pose @ more @ np.swapaxes(by_pose, 1, 2)
    assert wide.cov_points_in_world == pytest.approx(expected_cov, rel=1e-9, abs=1e-12)
    assert wide.cov_pose == pytest.approx(marginals.cov_pose + more, rel=1e-12)


def test_system_is_the_dense_solution(prior) -> None:
    """Errors of the rig are held elsewhere than at their estimate, eq. (72)."""
    rng = np.random.default_rng(8)
    held = prior.rig.mean + rng.normal(size=M)
    prior = replace(prior, rig=replace(prior.rig, held=held, weighted=rng.normal(size=M)))
    state, lin, moved, decrease, system = window_of(prior, rng)
    a, b = 6 * FRAMES, 3 * TOTAL
    h, g = dense_window(prior, lin)
    cov = np.linalg.inv(h)
    delta = cov @ g
    gain = cov[:, -M:] @ np.linalg.inv(cov[-M:, -M:])
    mean, of_views, information_of_rig = system.solved[-3:]
    assert of_views @ information_of_rig == pytest.approx(np.eye(M), abs=1e-9)
    assert mean == pytest.approx(prior.rig.mean + delta[-M:], rel=1e-6)
    assert of_views == pytest.approx(cov[-M:, -M:], rel=1e-6)
    delta = delta + gain @ (held - mean)
    change = rng.normal(size=M)
    followed = core.window_with_rig_moved(state, np.zeros(K), system.solved, change)
    assert np.abs((_step(prior, state, followed) - gain @ change) / np.sqrt(np.diag(cov))).max() < 1e-6
    scale = np.sqrt(np.diag(cov))
    by_rig = np.concatenate(
        [system.by_rig[:a], prior.world_modes @ np.concatenate([system.by_rig[system.at["modes"]], np.eye(M)])]
    )
    assert by_rig == pytest.approx(gain[np.r_[:a, a + b : a + b + 6]], rel=1e-6, abs=1e-9)
    assert np.abs((_step(prior, state, moved) - delta) / scale).max() < 1e-6
    assert decrease == pytest.approx(g @ delta + without_own(lin)[2], rel=1e-9)


def _step(prior: Prior, before: State, after: core.MovedWindow) -> np.ndarray:
    """The step of poses, points, world and rig between two states."""
    poses = se3.log(after.cams_from_ref @ se3.inverse(before.cams_from_ref)).ravel()
    by = after.amplitudes
    assert after.step == pytest.approx(np.concatenate([poses, (after.own - before.own).ravel(), by]))
    return np.concatenate([poses, (after.q - before.q).ravel(), prior.world_modes @ by, by[-M:]])


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_the_information_of_the_window_about_the_rig_counts_by_its_share_in_the_result(size: float) -> None:
    """Along the axes where the prior has 1 and the window λ, it counts as λ²/(1 + λ), with the same mean as before."""
    rng, m = np.random.default_rng(3), 5
    rig = replace(RigState.unknown(np.ones(m)), weighted=rng.normal(size=m))
    axes, own = np.linalg.qr(rng.normal(size=(m, m)))[0], size * rng.uniform(0.5, 2, m)  # λ
    said = rng.normal(size=m)  # the window's mean, along the axes
    before = axes.T @ rig.weighted

    def after(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean = before + information / (1 + information) * (said - before)
        return axes @ mean, axes @ np.diag(1 / (1 + information)) @ axes.T

    mean, cov = after(own)
    mean, counted = rig.tempered(mean, cov, np.linalg.inv(cov))
    expected_mean, expected_cov = after(own**2 / (1 + own))
    assert counted == pytest.approx(expected_cov, rel=1e-6, abs=1e-12)
    assert mean == pytest.approx(expected_mean, rel=1e-6, abs=1e-9)
