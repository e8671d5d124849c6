"""All keyframes together: a pose graph of odometry and loops, solved by GTSAM.

Nodes are numbered by the caller. Odometry is cut where frames were lost: the part after that is a separate segment,
whose home is its own frame, until a loop joins it to an older one. Errors that all motions of a run have in common,
those of the rig, accumulate as such in predictions. Loops do not estimate them: as a further variable they absorbed
all other errors of a calibration, and kitti00_mid there and back had 20 % more error than without a map. Between
loops nothing has to be solved: iSAM2 gets the new nodes with the next loop. Loops whose prediction could not
exclude another place are judged together with all others by graduated non-convexity (Yang et al. 2020).
"""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from ..geometry import Array, se3
from ..geometry.linear import LEAST_VARIANCE, symmetric
from ..motion import Motion
from ..record import record
from .chain import positive
from .settings import SETTINGS

try:
    import gtsam
except ImportError:  # reported when a map is made
    gtsam = None  # type: ignore[assignment]

_ORDER = np.r_[3:6, 0:3]  # GTSAM has rotation before translation
_NO_WAY = Motion(np.eye(4), np.zeros((6, 6)))


@record
class Loop:
    """A recognised place: `motion` carries points of node `new` to node `old`."""

    old: int
    new: int
    motion: Motion


@record
class GraphState:
    """A graph as stored in a file: for each node (n) its number, segment, home, pose (n, 4, 4) and the covariance
    (n, 6, 6) of its pose by odometry alone; odometry between nodes, and loops."""

    numbers: list[int]
    segments: list[int]
    homes: list[int]
    poses: Array
    covs: Array
    links: dict[tuple[int, int], Motion]
    loops: list[Loop]


class PoseGraph:
    """Poses of nodes, each in the world of the oldest segment to which it is joined.

    The nodes (n) in order have `numbers`, ascending; `segments`, and `homes`, the segments in whose worlds
    they are; world from camera, `poses` (n, 4, 4). `links`: odometry between nodes, by their numbers. `shared`: factor
    on the variance of loops, as several of them have the same errors. Raises ConfigError if GTSAM is missing.
    """

    def __init__(self, shared: float = 1.0) -> None:
        if gtsam is None:
            raise ConfigError(
                "maps need GTSAM, which is not installed: pip install gtsam, or this package with its extra [map]"
            )
        self.numbers: list[int] = []
        self.loops: list[Loop] = []
        self.links: dict[tuple[int, int], Motion] = {}
        self.segments = self.homes = np.zeros(0, np.int64)
        self.poses = np.zeros((0, 4, 4))
        self._chain = np.zeros((0, 6, 6))  # own covariances of poses in their segments from odometry alone
        self._jacobian = np.zeros((0, 6, 0))  # Jacobians of the same poses by the common errors
        self._mean, self._cov_common = np.zeros(0), np.zeros((0, 0))  # the engine's estimate of them
        self._began: dict[int, tuple[Array, Array]] = {}  # first pose of each segment, with covariance
        self._bridges: list[Loop] = []  # loops that joined segments, and the last one: short ways
        self._shared = shared
        self._isam: Any = None
        self._solved_with = np.zeros(0), np.zeros(0)  # mean and σ of the common errors in the solver's motions
        self._solved = 0  # nodes that the solver knows
        self._asked: list[Loop] = []  # loops that the solver does not know yet

    def _row(self, number: int) -> int:
        return bisect_left(self.numbers, number)

    def pose(self, number: int) -> Array:
        """Return world from camera (4, 4) of one node."""
        return self.poses[self._row(number)]

    def segment(self, number: int) -> int:
        return int(self.segments[self._row(number)])

    def home(self, number: int) -> int:
        """Return the segment in whose world the pose of a node is."""
        return int(self.homes[self._row(number)])

    def in_world_of(self, number: int) -> NDArray[np.bool_]:
        """Return which nodes (n,) are in the same world as a given one."""
        return np.asarray(self.homes == self.home(number))

    def state(self) -> GraphState:
        """Return the part of the graph that is stored."""
        j = self._jacobian
        return GraphState(
            list(self.numbers),
            self.segments.tolist(),
            self.homes.tolist(),
            self.poses.copy(),
            self._chain + j @ self._cov_common @ np.swapaxes(j, 1, 2),
            {pair: self._whole(link) for pair, link in self.links.items()},
            [Loop(loop.old, loop.new, self._whole(loop.motion)) for loop in self.loops],
        )

    def _whole(self, link: Motion) -> Motion:
        """Return the same motion with its common errors counted as its own."""
        known = link.given(self._mean, self._cov_common)
        return Motion(known.earlier_from_newest, known.cov)

    def restore(self, state: GraphState) -> None:
        """Start with a stored graph; the next added node begins a segment."""
        self.numbers, self.segments = list(state.numbers), np.array(state.segments, np.int64)
        self.poses, self._chain, self._jacobian = state.poses, state.covs, np.zeros((len(state.numbers), 6, 0))
        self.homes = np.array(state.homes, np.int64)
        first = dict(zip(reversed(state.segments), state.poses[::-1], strict=True))
        self._began = {segment: (pose, np.zeros((6, 6))) for segment, pose in first.items()}
        self.links, self.loops, self._asked = dict(state.links), list(state.loops), list(state.loops)
        self._bridges = [loop for loop in self.loops if self._joins(loop)]

    def add(self, number: int, pose: Array, link: Motion | None, cov: Array | None = None) -> None:
        """Add a node after the last one, moved by `link` since; without a link a segment begins, at `pose`.

        `cov` (6, 6): that of the pose at the beginning of a segment, None: exact.
        """
        chain, jacobian = np.zeros((6, 6)), np.zeros((6, len(self._mean)))
        if link is None or not self.numbers:
            segment = home = max(self._began, default=-1) + 1
            self._began[segment] = pose, chain if cov is None else cov
        else:
            segment, home = int(self.segments[-1]), int(self.homes[-1])
            self.links[self.numbers[-1], number] = link
            motion = link.given(self._mean, self._cov_common)
            turn = se3.adjoint(se3.inverse(motion.earlier_from_newest))
            pose = se3.orthonormalise(self.poses[-1] @ motion.earlier_from_newest)
            chain = turn @ self._chain[-1] @ turn.T + link.cov_own
            jacobian = turn @ self._jacobian[-1] + motion.common_jacobian
        self.numbers.append(number)
        self.segments, self.homes = np.append(self.segments, segment), np.append(self.homes, home)
        self.poses = np.concatenate([self.poses, pose[None]])
        self._chain = np.concatenate([self._chain, chain[None]])
        self._jacobian = np.concatenate([self._jacobian, jacobian[None]])

    def know(self, mean: Array, cov: Array) -> None:
        """Take the engine's current estimate of the errors c (m,) common to the motions of this run."""
        if len(mean) != len(self._mean):
            self._jacobian = np.zeros((len(self.numbers), 6, len(mean)))
        elif not self.loops:  # otherwise the next solution moves the poses
            self.poses = se3.orthonormalise(self.poses @ se3.exp(self._jacobian @ (mean - self._mean)))
        self._mean, self._cov_common = mean, symmetric(cov)

    def predicted(self, number: int, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return motions (k, 4, 4) from nodes in rows (k,) to this one, and covariances (k, 6, 6), infinite if unknown.

        The covariance is that of the best of a few ways: odometry alone, or over one of the latest bridges.
        """
        motions = se3.inverse(self.poses[rows]) @ self.pose(number)
        covs = np.full((len(rows), 6, 6), np.inf)
        known = self._mean, self._cov_common
        ways = [(number, Motion(np.eye(4), np.zeros((6, 6))).given(*known))]
        for bridge in self._bridges:
            if self.segment(bridge.new) == self.segment(number):
                row = self._row(bridge.new)
                own, jacobian = self._to(np.array([row]), self._row(number))
                onward = se3.inverse(self.poses[row]) @ self.pose(number)
                ways.append((bridge.old, bridge.motion.then(Motion(onward, own[0], jacobian[0], *known))))
        for start, rest in ways:
            here = np.flatnonzero(self.segments[rows] == self.segment(start))
            own, jacobian = self._to(rows[here], self._row(start))
            turn = se3.adjoint(se3.inverse(rest.earlier_from_newest))
            j = turn @ jacobian + rest.common_jacobian
            cov = turn @ own @ turn.T + rest.cov_own + j @ self._cov_common @ np.swapaxes(j, 1, 2)
            better = np.trace(cov, axis1=1, axis2=2) < np.trace(covs[here], axis1=1, axis2=2)
            covs[here[better]] = cov[better]
        return motions, covs

    def between(self, first: int, second: int) -> Motion | None:
        """Return the predicted motion between two nodes, with its whole covariance; None if it is not known."""
        (motion,), (cov,) = self.predicted(second, np.array([self._row(first)]))
        return Motion(motion, cov) if np.isfinite(cov).all() else None

    def _to(self, rows: NDArray[np.intp], to: int) -> tuple[Array, Array]:
        """For the motions from nodes to another one of their segment by odometry alone: own covariances (k, 6, 6),
        and Jacobians (k, 6, m) by the common errors."""
        motion = se3.inverse(self.poses[rows]) @ self.poses[to]
        turn = se3.adjoint(se3.inverse(motion))
        jacobian = self._jacobian[to] - turn @ self._jacobian[rows]
        turned = turn @ self._chain[rows] @ np.swapaxes(turn, 1, 2)
        later = (rows > to)[:, None, None]
        grown = np.where(later, turned, self._chain[to]) - np.where(later, self._chain[to], turned)
        return positive(grown), jacobian

    def close(self, loops: Sequence[Loop], uncertain: bool) -> list[Loop]:
        """Add loops and solve; `uncertain`: they may be false, so all are judged. Returns rejected loops."""
        joins = [loop for loop in loops if self._join(loop)]
        self.loops += loops
        self._asked += loops
        refused: list[Loop] = []
        if uncertain and (refused := self._false()):
            self.loops = [loop for loop in self.loops if loop not in refused]
        if joins or refused:
            self.solve()
        else:
            self._update()
        kept = [loop for loop in loops if loop not in refused]
        permanent = [loop for loop in (*self._bridges, *joins) if self._joins(loop)]
        self._bridges = [loop for loop in permanent if loop not in refused] + kept[-1:]
        return refused

    def _joins(self, loop: Loop) -> bool:
        return self.segment(loop.old) != self.segment(loop.new)

    def _join(self, loop: Loop) -> bool:
        """Move the younger of two worlds into the older one, if a loop is the first between them."""
        old, new = self.home(loop.old), self.home(loop.new)
        if old == new:
            return False
        keep, move = min(old, new), max(old, new)
        here = self.pose(loop.old) @ loop.motion.earlier_from_newest
        shift = here @ se3.inverse(self.pose(loop.new))
        if move == old:
            shift = se3.inverse(shift)
        moved = self.homes == move
        self.poses[moved] = se3.orthonormalise(shift @ self.poses[moved])
        self.homes[moved] = keep
        return True

    def solve(self) -> None:
        """Solve everything again, because segments were joined, or nodes and loops were removed."""
        settings = gtsam.ISAM2Params()
        settings.setFactorization("QR")  # σ in one graph differ by 10⁴
        self._isam = gtsam.ISAM2(settings)
        self._solved, self._asked = 0, list(self.loops)
        self._solved_with = self._mean, np.sqrt(self._cov_common.diagonal())
        self._update()

    def _update(self) -> None:
        """Give iSAM2 everything new since the last call, and take its poses."""
        mean, std = self._solved_with
        outdated = len(mean) != len(self._mean) or (np.abs(self._mean - mean) > SETTINGS.outdated * std).any()
        if self._isam is None or (self._solved and outdated):
            self.solve()
            return
        factors, values, _ = self._problem(self._solved, self._asked)
        self._isam.update(factors, values)
        self._isam.update()  # a second step: the first one is linearised before the loop
        self._solved, self._asked = len(self.numbers), []
        values = self._isam.calculateBestEstimate()
        self.poses = se3.orthonormalise(np.array([values.atPose3(number).matrix() for number in self.numbers]))

    def _problem(self, solved: int, loops: Sequence[Loop], spread: float = 1.0) -> tuple[Any, Any, int]:
        """Return factors and poses of the nodes after the first `solved`, and the number of factors before the loops.

        The loops have σ that are `spread` times as large. A world whose first node is new is fixed there.
        """
        factors, values, new = gtsam.NonlinearFactorGraph(), gtsam.Values(), self.numbers[solved:]
        held = set(self.homes[:solved].tolist())
        for number in new:
            values.insert(number, _pose3(self.pose(number)))
            if (home := self.home(number)) not in held:
                held.add(home)
                anchor = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)  # m and rad: the world is defined by it
                factors.add(gtsam.PriorFactorPose3(number, _pose3(self.pose(number)), anchor))
        wanted = set(new)
        for (first, second), link in self.links.items():
            if second in wanted:
                factors.add(self._factor(first, second, link))
        sure = factors.size()
        for loop in loops:
            factors.add(self._factor(loop.old, loop.new, loop.motion, spread * np.sqrt(self._shared)))
        return factors, values, sure

    def _factor(self, first: int, second: int, link: Motion, spread: float = 1.0) -> Any:
        """Return a motion between nodes, whose σ is `spread` times as large; its common errors count as its own."""
        motion = link.given(self._mean, self._cov_common)
        cov = spread**2 * motion.cov + LEAST_VARIANCE * np.eye(6)
        noise = gtsam.noiseModel.Gaussian.Covariance(symmetric(cov)[np.ix_(_ORDER, _ORDER)])
        return gtsam.BetweenFactorPose3(first, second, _pose3(motion.earlier_from_newest), noise)

    def _false(self) -> list[Loop]:
        """Return the loops that graduated non-convexity rejects."""
        kept, values = list(self.loops), None
        for spread in SETTINGS.spreads:
            if not kept:
                break
            factors, start, sure = self._problem(0, kept, spread)
            settings = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
            settings.setKnownInliers(list(range(sure)))
            optimizer = gtsam.GncLMOptimizer(factors, start if values is None else values, settings)
            values = optimizer.optimize()
            weights = np.asarray(optimizer.getWeights())[sure:]
            kept = [loop for loop, weight in zip(kept, weights, strict=True) if weight > 0.5]
        return [loop for loop in self.loops if loop not in kept]

    def covariances(self) -> Array:
        """Return covariances (n, 6, 6) of all poses in the world of the first one, of right perturbations.

        Those of poses in another world include the uncertainty of the beginning of that world.
        """
        if not self.numbers:
            return np.zeros((0, 6, 6))
        self.solve()  # with the current estimate of the common errors, to which the covariances refer
        covs = np.array([self._isam.marginalCovariance(number) for number in self.numbers])
        by_common = self._by_common()
        covs = covs[:, _ORDER][:, :, _ORDER] + by_common @ self._cov_common @ np.swapaxes(by_common, 1, 2)
        for row in np.flatnonzero(~self.in_world_of(self.numbers[0])):
            pose, cov = self._began[self.home(self.numbers[row])]
            turn = se3.adjoint(se3.inverse(self.poses[row]) @ pose)
            covs[row] += turn @ cov @ turn.T
        return covs

    def _by_common(self) -> Array:
        """Return the Jacobian (n, 6, m) of all poses by the common errors, with fixed loops (Schmidt 1966)."""
        mean, solutions = self._mean, []
        for change in (np.zeros_like(mean), *np.eye(len(mean))):
            self._mean = mean + change
            factors, values, _ = self._problem(0, self.loops)
            moved = factors.linearize(values).optimize()
            solutions.append([moved.at(number)[_ORDER] for number in self.numbers])
        self._mean = mean
        return np.moveaxis(np.array(solutions[1:]).reshape(-1, len(self.numbers), 6) - np.array(solutions[0]), 0, 2)

    def remove(self, numbers: Iterable[int]) -> None:
        """Remove nodes; the motions of each pass to its best-linked neighbour, by odometry or else a loop."""
        for number in numbers:
            links = [Loop(*pair, link) for pair, link in self.links.items() if number in pair]
            ways = links or [loop for loop in self.loops if number in (loop.old, loop.new)]
            if ways:
                way = min(ways, key=lambda way: float(np.trace(way.motion.cov_own)))
                at_first = way.old == number
                neighbour, onward = (way.new, way.motion) if at_first else (way.old, way.motion.back())
            else:
                neighbour, onward = number, _NO_WAY  # no motion is passed on
            for link in links:
                del self.links[link.old, link.new]
                if (moved := _moved(link, number, neighbour, onward)) is not None:
                    self.links[moved.old, moved.new] = moved.motion
            self.loops, self._bridges = (
                [m for loop in loops if (m := _moved(loop, number, neighbour, onward)) is not None]
                for loops in (self.loops, self._bridges)
            )
            row = self._row(number)
            for name in ("segments", "homes", "poses", "_chain", "_jacobian"):
                setattr(self, name, np.delete(getattr(self, name), row, axis=0))
            self.numbers.pop(row)
        self.solve()


def _moved(loop: Loop, number: int, neighbour: int, neighbour_link: Motion) -> Loop | None:
    """Return a motion moved from a removed node to a neighbour; None if nothing is left of it."""
    if number not in (loop.old, loop.new):
        return loop
    if neighbour in (loop.old, loop.new):
        return None
    if loop.new == number:
        return Loop(loop.old, neighbour, loop.motion.then(neighbour_link))
    return Loop(neighbour, loop.new, neighbour_link.back().then(loop.motion))


def _pose3(pose: Array) -> Any:
    return gtsam.Pose3(se3.orthonormalise(pose))
