"""The pose graph: motions with common errors, loops, segments, and what may be removed."""

from collections.abc import Iterator

import numpy as np
import pytest

from stream_sfm.geometry import se3
from stream_sfm.motion import Motion

gtsam = pytest.importorskip("gtsam", reason="GTSAM is not installed: the extra [map]")
from stream_sfm.places.graph import Loop, PoseGraph  # noqa: E402

STD = np.array([2e-3, 2e-3, 2e-3, 1e-3, 1e-3, 1e-3])
LOOP_STD = np.full(6, 1e-3)
NODES, COMMON = 16, 3


def circle(n: int = NODES) -> np.ndarray:
    """Poses (n, 4, 4) once round a circle of some 4 m; the last one is the first one again."""
    angles = np.linspace(0, 2 * np.pi, n)
    return np.array([se3.exp([0, 0, 0, 0, a, 0]) @ se3.exp([0.6, 0, 0, 0, 0, 0]) for a in angles])


def noisy(motion: np.ndarray, std: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A motion whose error, a perturbation on the right of what is measured, has these deviations."""
    return motion @ se3.exp(-std * rng.normal(size=6))


def test_motions_with_common_errors_compose_as_their_sum_says() -> None:
    """`then` and `back` against the motions composed with other common errors, to first order."""
    rng = np.random.default_rng(1)
    zero, cov = np.zeros(COMMON), np.eye(COMMON)
    a, b = (Motion(se3.exp(0.3 * rng.normal(size=6)), np.eye(6), rng.normal(size=(6, COMMON)), zero, cov) for _ in "ab")

    def pose(motion: Motion, c: np.ndarray) -> np.ndarray:
        return motion.given(c, cov).earlier_from_newest

    for c in 1e-6 * np.eye(COMMON):
        assert np.allclose(se3.log(se3.inverse(pose(a.then(b), c)) @ pose(a, c) @ pose(b, c)), 0, atol=1e-10)
        assert np.allclose(se3.log(se3.inverse(pose(a.back(), c)) @ se3.inverse(pose(a, c))), 0, atol=1e-10)
    alone = Motion(a.earlier_from_newest, a.cov_own)  # of nothing in common
    assert np.allclose(alone.then(b).cov_own, a.then(b).cov_own) and alone.then(b).mean is b.mean


def followed(graph: PoseGraph, rng: np.random.Generator, c: np.ndarray, size: float) -> Iterator[int]:
    """Nodes round the circle, each added; their motions have errors of their own, and by common ones `c`."""
    truth, jacobian = circle(), size * np.random.default_rng(0).normal(size=(6, COMMON))
    graph.know(np.zeros(COMMON), np.eye(COMMON))
    graph.add(0, truth[0], None)
    for k in range(1, NODES):
        motion = se3.inverse(truth[k - 1]) @ truth[k] @ se3.exp(-jacobian @ c)
        graph.add(k, np.eye(4), Motion(noisy(motion, STD, rng), np.diag(STD**2), jacobian, np.zeros(COMMON)))
        yield k


def nees_of(graph: PoseGraph, truth: np.ndarray) -> float:
    """The mean over all poses but the first: 6 is expected."""
    cov = graph.covariances()[1:]  # which brings the poses up to what is known
    error = se3.log(se3.inverse(graph.poses) @ truth)[1:]
    return float(np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error).mean())


def closed(rng: np.random.Generator, false: int = 0) -> tuple[PoseGraph, np.ndarray, list[Loop]]:
    """A circle whose motions have errors of their own and in common, with loops; the last `false` ones are false."""
    truth, graph = circle(), PoseGraph()
    assert [*followed(graph, rng, rng.normal(size=COMMON), 2e-3)] == list(range(1, NODES))
    ends = [(k, NODES - 5 + k, noisy(se3.inverse(truth[k]) @ truth[NODES - 5 + k], LOOP_STD, rng)) for k in range(4)]
    ends += [(6, NODES - 1, se3.exp([0.4, 0, 0.3, 0, 0.2, 0]))] * false
    return graph, truth, [Loop(old, new, Motion(motion, np.diag(LOOP_STD**2))) for old, new, motion in ends]


def test_covariances_with_common_errors_and_loops_hold() -> None:
    """Monte Carlo: the mean NEES of all poses is six within its scatter, before loops and after."""
    before, after = [], []
    for seed in range(24):
        graph, truth, loops = closed(np.random.default_rng(seed))
        for nees in (before, after):
            nees.append(nees_of(graph, truth))
            if nees is before:
                graph.close(loops, uncertain=False)
    # Six is the mean of a χ² whose σ is 3.5, and errors of one trial go together: 3 σ of 24 trials.
    assert 3.9 < np.mean(before) < 8.1
    assert 3.9 < np.mean(after) < 8.1


def test_learning_about_common_errors_updates_earlier_motions() -> None:
    """Monte Carlo: c is hardly known where loops are closed, and well known at the end: the NEES is six all the same.

    Motions that stayed as they were would be off by many times the σ that follows from what is known of c.
    """
    nees, std_c = [], 0.02
    for seed in range(24):
        rng = np.random.default_rng(1000 + seed)
        truth, graph, c = circle(), PoseGraph(), rng.normal(size=COMMON)
        for k in followed(graph, rng, c, 4e-3):
            if k == 2 or k == NODES - 1:
                loop = Motion(noisy(se3.inverse(truth[0]) @ truth[k], LOOP_STD, rng), np.diag(LOOP_STD**2))
                graph.close([Loop(0, k, loop)], uncertain=False)
        graph.know(c + std_c * rng.normal(size=COMMON), std_c**2 * np.eye(COMMON))
        nees.append(nees_of(graph, truth))
    assert 3.9 < np.mean(nees) < 8.1


def test_predicted_covariance_is_that_of_the_marginals() -> None:
    """Where there are no loops, the prediction between two nodes is what the whole graph says."""
    graph, truth, _ = closed(np.random.default_rng(3))
    motions, covs = graph.predicted(NODES - 1, np.arange(NODES))
    assert np.isfinite(covs).all()
    errors = []
    for seed in range(200):
        other, _, _ = closed(np.random.default_rng(100 + seed))
        motion = se3.inverse(other.pose(5)) @ other.pose(NODES - 1)
        errors.append(se3.log(se3.inverse(motion) @ se3.inverse(truth[5]) @ truth[NODES - 1]))
    assert np.allclose(np.cov(np.array(errors).T).diagonal(), covs[5].diagonal(), rtol=0.35)  # 3.5 σ of 200 trials
    assert np.allclose(motions[5], se3.inverse(graph.pose(5)) @ graph.pose(NODES - 1))


def test_uncertain_loops_are_judged_together() -> None:
    graph, truth, loops = closed(np.random.default_rng(4), false=1)
    refused = graph.close(loops, uncertain=True)
    assert refused == loops[-1:]
    assert graph.loops == loops[:-1]
    error, cov = se3.log(se3.inverse(graph.poses[-1]) @ truth[-1]), graph.covariances()[-1]
    assert error @ np.linalg.solve(cov, error) < 22.5  # χ² of six at 0.999
    assert np.sqrt(np.trace(cov[:3, :3])) < 0.02  # the false loop was off by decimetres


def test_a_segment_joins_the_world_it_is_found_in() -> None:
    """After a cut the poses are at home in their own frame, until a loop says where that is."""
    truth, graph = circle(), PoseGraph()
    elsewhere = se3.exp([5, 6, 7, 0.3, 0.2, 0.1])
    for k in range(NODES):
        cut = k in (0, 8)
        link = None if cut else Motion(se3.inverse(truth[k - 1]) @ truth[k], np.diag(STD**2))
        graph.add(k, elsewhere @ truth[k] if k >= 8 else truth[k], link)
    assert graph.home(12) != graph.home(0)
    assert graph.between(3, 12) is None and not graph.in_world_of(12)[:8].any()
    motion = se3.inverse(truth[2]) @ truth[13]
    graph.close([Loop(2, 13, Motion(motion, np.diag(LOOP_STD**2)))], uncertain=False)
    assert graph.home(12) == graph.home(0)
    assert np.allclose(graph.poses, truth, atol=1e-6)
    assert graph.in_world_of(15).all()


def test_nodes_that_go_leave_their_motions_to_their_neighbours() -> None:
    graph, truth, loops = closed(np.random.default_rng(5))
    graph.close(loops, uncertain=False)
    kept = [k for k in range(NODES) if k not in (1, 6, 7, 8, 13)]  # two of them are ends of loops
    before = graph.poses[kept].copy()
    graph.remove([1, 6, 7, 8, 13])
    assert graph.numbers == kept
    moved, cov = se3.log(se3.inverse(before) @ graph.poses)[1:], graph.covariances()[1:]
    assert np.einsum("ni,nij,nj->n", moved, np.linalg.inv(cov), moved).max() < 2  # well within σ, of six directions
    graph.add(NODES, np.eye(4), Motion(np.eye(4), np.diag(STD**2)))
    assert graph.in_world_of(NODES).all()
    assert np.isfinite(graph.covariances()).all()
    assert np.abs(se3.log(se3.inverse(truth[kept]) @ graph.poses[:-1])[:, :3]).max() < 0.05


def test_an_unlinked_node_is_removed_and_one_with_loops_passes_them_to_a_neighbour() -> None:
    truth, graph = circle(), PoseGraph()
    for k in range(5):
        graph.add(k, truth[k], None)
    loop = Motion(se3.inverse(truth[0]) @ truth[1], np.diag(LOOP_STD**2))
    onward = Motion(se3.inverse(truth[1]) @ truth[2], np.diag(LOOP_STD**2))
    graph.close([Loop(0, 1, loop), Loop(1, 2, onward)], uncertain=False)
    graph.remove([1, 4])
    assert graph.numbers == [0, 2, 3] and [(each.old, each.new) for each in graph.loops] == [(0, 2)]
    assert graph.home(2) == graph.home(0) != graph.home(3)
    assert np.allclose(graph.poses, truth[[0, 2, 3]], atol=1e-6)
    assert np.isfinite(graph.covariances()).all()
