"""All keyframes together: a pose graph of odometry and loops, solved by GTSAM.

Nodes are numbered by the caller. Odometry is cut where frames were lost: what comes after is a segment of its own, at
home in its own frame, until a loop joins it to an older one. Errors that all motions of a run have in common,
those of the rig, add up as such in what is predicted. Loops do not estimate them: as one more variable they took up
whatever else was wrong with a calibration, and kitti00_mid there and back was off by 20 % more than without a map.
Between loops nothing has to be solved: iSAM2 is given what has come since with the next loop. Loops that came where the
prediction could not exclude another place are judged together with all others by graduated non-convexity (Yang et al.
2020).
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from ..geometry import se3
from ..geometry.linear import symmetric
from ..geometry.se3 import Array
from ..motion import Motion
from ..record import record
from .chain import growth

try:
    import gtsam
except ImportError:  # said where a map is made
    gtsam = None  # type: ignore[assignment]

_ORDER = np.r_[3:6, 0:3]  # GTSAM has rotation before translation
_ANCHOR = 1e-6  # σ, m and rad, of the pose that a segment's world is defined by
_FLOOR = 1e-12  # m² and rad², so that motions known by definition can be inverted
# Loops at ten times their σ first: GTSAM's annealing starts no flatter than residuals of 1000 σ, and true loops are
# further off where the odometry is bad; of eight such graphs three lost every loop.
_SPREADS = (10.0, 1.0)
_KEPT_WEIGHT = 0.5


def require_gtsam() -> None:
    """Raise a ConfigError where GTSAM is not installed."""
    if gtsam is None:
        raise ConfigError(
            "maps need GTSAM, which is not installed: pip install gtsam, or this package with its extra [map]"
        )


@record
class Loop:
    """A place seen again: `motion` carries points of node `new` to node `old`."""

    old: int
    new: int
    motion: Motion


@record
class GraphState:
    """A graph as it is kept in a file: of each node (n) its number, segment, home, pose (n, 4, 4) and the covariance
    (n, 6, 6) of its pose by odometry alone; odometry between nodes, and loops."""

    numbers: list[int]
    segments: list[int]
    homes: list[int]
    poses: Array
    covs: Array
    links: dict[tuple[int, int], Motion]
    loops: list[Loop]


class PoseGraph:
    """Poses of nodes, in the world of the oldest segment that each is joined to.

    `numbers`: of the nodes, in the order they came; `poses` (n, 4, 4) in the same order.
    """

    def __init__(self) -> None:
        require_gtsam()
        self.numbers: list[int] = []
        self.loops: list[Loop] = []
        self.links: dict[tuple[int, int], Motion] = {}  # odometry between nodes, by their numbers
        self._segments = np.zeros(64, np.int64)
        self._row: dict[int, int] = {}
        self._poses = np.zeros((64, 4, 4))
        self._chain = np.zeros((64, 6, 6))  # own covariance of a pose in its segment by odometry alone
        self._jacobian = np.zeros((64, 6, 0))  # of the same poses by the common errors
        self._mean, self._cov_common = np.zeros(0), np.zeros((0, 0))  # what the engine knows of them
        self._home: dict[int, int] = {}  # of a segment: the one whose world it is in
        self._began: dict[int, tuple[Array, Array]] = {}  # of a segment: its first pose, with covariance
        self._bridges: list[Loop] = []  # that joined segments, and the last one: ways of short covariance
        self._isam: Any = None
        self._solved = 0  # nodes that the solver knows
        self._asked: list[Loop] = []  # loops that it does not know

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def poses(self) -> Array:
        """World from camera (n, 4, 4)."""
        return self._poses[: len(self.numbers)]

    def pose(self, number: int) -> Array:
        """World from camera (4, 4) of one node."""
        return self._poses[self._row[number]]

    def home(self, number: int) -> int:
        """The segment in whose world a node's pose is."""
        return self._home[self.segment(number)]

    def segment(self, number: int) -> int:
        """The segment of one node."""
        return int(self._segments[self._row[number]])

    @property
    def segments(self) -> list[int]:
        """The segment (n,) of each node."""
        return self._segments[: len(self)].tolist()

    def state(self) -> GraphState:
        """What is to be kept of the graph."""
        j, rows = self._jacobian[: len(self)], len(self)
        covs = self._chain[:rows] + j @ self._cov_common @ np.swapaxes(j, 1, 2)
        homes = [self.home(number) for number in self.numbers]
        links = {pair: self._whole(link) for pair, link in self.links.items()}
        loops = [Loop(loop.old, loop.new, self._whole(loop.motion)) for loop in self.loops]
        return GraphState(list(self.numbers), self.segments, homes, self.poses.copy(), covs, links, loops)

    def _whole(self, link: Motion) -> Motion:
        """The same motion whose common errors are its own."""
        known = link.given(self._mean, self._cov_common)
        return Motion(known.earlier_from_newest, known.cov)

    def restore(self, state: GraphState) -> None:
        """Begin with a graph that was kept; what is added next begins a segment."""
        for number, segment, home, pose, cov in zip(
            state.numbers, state.segments, state.homes, state.poses, state.covs, strict=True
        ):
            self.add(number, pose, None, segment)
            self._chain[self._row[number]] = cov
            self._home[segment] = home
        self.links, self.loops = dict(state.links), list(state.loops)
        self._bridges = [loop for loop in self.loops if self._joins(loop)]
        self._asked = list(self.loops)

    def add(
        self,
        number: int,
        pose: Array,
        link: Motion | None,
        segment: int | None = None,
        cov: Array | None = None,
    ) -> None:
        """Add a node after the last one, moved by `link` since; without it a segment begins, at `pose`.

        With `segment` it is in that one, at `pose`; `cov` (6, 6): of a pose where a segment begins, None: exact.
        """
        row = len(self.numbers)
        if row == len(self._poses):
            for name in ("_poses", "_chain", "_jacobian", "_segments"):
                array = getattr(self, name)
                setattr(self, name, np.concatenate([array, np.zeros_like(array)]))
        if link is None or not self.numbers:
            new_segment = max(self._home, default=-1) + 1 if segment is None else segment
            self._home.setdefault(new_segment, new_segment)
            self._began.setdefault(new_segment, (pose, np.zeros((6, 6)) if cov is None else cov))
            self._segments[row] = new_segment
            self._poses[row], self._chain[row], self._jacobian[row] = pose, 0.0, 0.0
        else:
            last, before = self.numbers[-1], row - 1
            self._segments[row] = self._segments[before]
            self.links[last, number] = link
            motion = link.given(self._mean, self._cov_common)
            turn = se3.adjoint(se3.inverse(motion.earlier_from_newest))
            self._poses[row] = se3.orthonormalise(self._poses[before] @ motion.earlier_from_newest)
            self._chain[row] = turn @ self._chain[before] @ turn.T + link.cov_own
            self._jacobian[row] = turn @ self._jacobian[before] + motion.common_jacobian
        self.numbers.append(number)
        self._row[number] = row

    def know(self, mean: Array, cov: Array) -> None:
        """Take the engine's present knowledge of the errors c (m,) common to this run's motions."""
        if len(mean) != len(self._mean):
            self._jacobian = np.zeros((*self._jacobian.shape[:2], len(mean)))
        elif not self.loops:  # else the next solution says how the poses change
            rows = len(self.numbers)
            change = self._jacobian[:rows] @ (mean - self._mean)
            self._poses[:rows] = se3.orthonormalise(self._poses[:rows] @ se3.exp(change))
        self._mean, self._cov_common = mean, symmetric(cov)

    def in_world_of(self, number: int) -> NDArray[np.bool_]:
        """Which nodes (n,) are in the same world as one."""
        home = self.home(number)
        return np.isin(self._segments[: len(self)], [s for s, other in self._home.items() if other == home])

    def in_other_worlds(self, number: int) -> set[int]:
        """Return the other nodes."""
        if len(set(self._home.values())) == 1:
            return set()
        return {self.numbers[row] for row in np.flatnonzero(~self.in_world_of(number))}

    def predicted(self, number: int, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Motions (k, 4, 4) from nodes in rows (k,) to this one, their covariances (k, 6, 6), infinite if unknown.

        The covariance is that of the best of few ways: odometry alone, or over one of the latest bridges between.
        """
        motions = se3.inverse(self._poses[rows]) @ self.pose(number)
        covs = np.full((len(rows), 6, 6), np.inf)
        known = self._mean, self._cov_common
        ways = [(number, Motion(np.eye(4), np.zeros((6, 6))).given(*known))]
        for bridge in self._bridges:
            if self.segment(bridge.new) == self.segment(number):
                row = self._row[bridge.new]
                own, jacobian = self._to(np.array([row]), self._row[number])
                onward = se3.inverse(self._poses[row]) @ self.pose(number)
                ways.append((bridge.old, bridge.motion.then(Motion(onward, own[0], jacobian[0], *known))))
        for start, rest in ways:
            here = np.flatnonzero(self._segments[rows] == self.segment(start))
            own, jacobian = self._to(rows[here], self._row[start])
            turn = se3.adjoint(se3.inverse(rest.earlier_from_newest))
            j = turn @ jacobian + rest.common_jacobian
            cov = turn @ own @ turn.T + rest.cov_own + j @ self._cov_common @ np.swapaxes(j, 1, 2)
            better = np.trace(cov, axis1=1, axis2=2) < np.trace(covs[here], axis1=1, axis2=2)
            covs[here[better]] = cov[better]
        return motions, covs

    def between(self, first: int, second: int) -> Motion | None:
        """The motion between two nodes as predicted, with all of its covariance; None where it is not known."""
        (motion,), (cov,) = self.predicted(second, np.array([self._row[first]]))
        return Motion(motion, cov) if np.isfinite(cov).all() else None

    def _to(self, rows: NDArray[np.intp], to: int) -> tuple[Array, Array]:
        """Of the motions from nodes to another one of their segment by odometry alone: own covariances (k, 6, 6), and
        Jacobians (k, 6, m) by the common errors."""
        motion = se3.inverse(self._poses[rows]) @ self._poses[to]
        turn = se3.adjoint(se3.inverse(motion))
        jacobian = self._jacobian[to] - turn @ self._jacobian[rows]
        turned = turn @ self._chain[rows] @ np.swapaxes(turn, 1, 2)
        later = (rows > to)[:, None, None]
        return growth(np.where(later, self._chain[to], turned), np.where(later, turned, self._chain[to])), jacobian

    def close(self, loops: Sequence[Loop], doubtful: bool) -> list[Loop]:
        """Add loops and solve; `doubtful`: they may be false, and all are judged. Returns those that were refused."""
        joins = [loop for loop in loops if self._join(loop)]
        self.loops += loops
        self._asked += loops
        refused: list[Loop] = []
        if doubtful and (refused := self._false()):
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
        moved = [row for row, number in enumerate(self.numbers) if self.home(number) == move]
        self._poses[moved] = se3.orthonormalise(shift @ self._poses[moved])
        for segment, home in self._home.items():
            if home == move:
                self._home[segment] = keep
        return True

    def solve(self) -> None:
        """Solve everything anew: where segments were joined, or nodes and loops have gone."""
        settings = gtsam.ISAM2Params()
        settings.setFactorization("QR")  # σ of one graph differ by 10⁴
        self._isam = gtsam.ISAM2(settings)
        self._solved, self._asked = 0, list(self.loops)
        self._update()

    def _update(self) -> None:
        """Give iSAM2 what is new since the last call, and take its poses."""
        if self._isam is None:
            self.solve()
            return
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        new = self.numbers[self._solved :]
        for number in new:
            values.insert(number, _pose3(self.pose(number)))
        self._add_odometry(factors, new, {self._home[s] for s in self.segments[: self._solved]})
        for loop in self._asked:
            factors.add(self._factor(loop.old, loop.new, loop.motion))
        self._isam.update(factors, values)
        self._isam.update()  # a second step: the first one is linearised before the loop
        self._solved, self._asked = len(self.numbers), []
        values = self._isam.calculateBestEstimate()
        poses = np.array([values.atPose3(number).matrix() for number in self.numbers])
        self._poses[: len(poses)] = se3.orthonormalise(poses)

    def _add_odometry(self, factors: Any, numbers: Sequence[int], seen: set[int]) -> None:
        """The motions to nodes, and of each world that is not among those `seen` where it begins."""
        wanted = set(numbers)
        for number in numbers:
            if (home := self.home(number)) not in seen:
                seen.add(home)
                anchor = gtsam.noiseModel.Isotropic.Sigma(6, _ANCHOR)
                factors.add(gtsam.PriorFactorPose3(number, _pose3(self.pose(number)), anchor))
        for (first, second), link in self.links.items():
            if second in wanted:
                factors.add(self._factor(first, second, link))

    def _factor(self, first: int, second: int, link: Motion, spread: float = 1.0) -> Any:
        """A motion between nodes, whose σ is `spread` times as large; its common errors count as its own."""
        motion = link.given(self._mean, self._cov_common)
        cov = spread**2 * motion.cov + _FLOOR * np.eye(6)
        noise = gtsam.noiseModel.Gaussian.Covariance(symmetric(cov)[np.ix_(_ORDER, _ORDER)])
        return gtsam.BetweenFactorPose3(first, second, _pose3(motion.earlier_from_newest), noise)

    def _batch(self, loops: Sequence[Loop], spread: float = 1.0) -> tuple[Any, Any, int]:
        """All factors, all poses, and how many factors come before the loops, whose σ are `spread` times as large."""
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for number in self.numbers:
            values.insert(number, _pose3(self.pose(number)))
        self._add_odometry(factors, self.numbers, set())
        sure = factors.size()
        for loop in loops:
            factors.add(self._factor(loop.old, loop.new, loop.motion, spread))
        return factors, values, sure

    def _false(self) -> list[Loop]:
        """Return the loops that graduated non-convexity rejects."""
        kept, values = list(self.loops), None
        for spread in _SPREADS:
            if not kept:
                break
            factors, start, sure = self._batch(kept, spread)
            settings = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
            settings.setKnownInliers(list(range(sure)))
            optimizer = gtsam.GncLMOptimizer(factors, start if values is None else values, settings)
            values = optimizer.optimize()
            weights = np.asarray(optimizer.getWeights())[sure:]
            kept = [loop for loop, weight in zip(kept, weights, strict=True) if weight > _KEPT_WEIGHT]
        return [loop for loop in self.loops if loop not in kept]

    def covariances(self) -> Array:
        """Covariances (n, 6, 6) of all poses in the world of the first, of perturbations on their right.

        What is in another world is as uncertain as that one's beginning, too.
        """
        if not self.numbers:
            return np.zeros((0, 6, 6))
        self._update()
        covs = np.array([self._isam.marginalCovariance(number) for number in self.numbers])
        by_common = self._by_common()
        covs = covs[:, _ORDER][:, :, _ORDER] + by_common @ self._cov_common @ np.swapaxes(by_common, 1, 2)
        for row in np.flatnonzero(~self.in_world_of(self.numbers[0])):
            pose, cov = self._began[self.home(self.numbers[row])]
            turn = se3.adjoint(se3.inverse(self._poses[row]) @ pose)
            covs[row] += turn @ cov @ turn.T
        return covs

    def _by_common(self) -> Array:
        """How all poses, loops being as they are, follow the common errors: (n, 6, m) (Schmidt 1966)."""
        mean, solutions = self._mean, []
        for change in (np.zeros_like(mean), *np.eye(len(mean))):
            self._mean = mean + change
            factors, values, _ = self._batch(self.loops)
            moved = factors.linearize(values).optimize()
            solutions.append([moved.at(number)[_ORDER] for number in self.numbers])
        self._mean = mean
        return np.moveaxis(np.array(solutions[1:]).reshape(-1, len(self), 6) - np.array(solutions[0]), 0, 2)

    def remove(self, numbers: Iterable[int]) -> None:
        """Remove nodes; motions to and from each pass to its best-linked neighbour by odometry."""
        for number in numbers:
            ends = [pair for pair in self.links if number in pair]
            if not ends:
                continue
            pair = min(ends, key=lambda p: float(np.trace(self.links[p].cov_own)))
            link = self.links.pop(pair)
            neighbour, onward = (pair[1], link) if pair[0] == number else (pair[0], link.back())
            for first, second in [p for p in ends if p != pair]:
                other = self.links.pop((first, second))
                moved = other.then(onward) if second == number else onward.back().then(other)
                a, b = (first, neighbour) if second == number else (neighbour, second)
                if a != b:
                    self.links[a, b] = moved
            self.loops = [m for loop in self.loops if (m := _moved(loop, number, neighbour, onward)) is not None]
            self._bridges = [
                m for loop in self._bridges if (m := _moved(loop, number, neighbour, onward)) is not None
            ]
            self._drop(number)
        self.solve()

    def _drop(self, number: int) -> None:
        row, n = self._row[number], len(self.numbers)
        for array in (self._poses, self._chain, self._jacobian, self._segments):
            array[row : n - 1] = array[row + 1 : n]
        self.numbers.pop(row)
        self._row = {other: k for k, other in enumerate(self.numbers)}


def _moved(loop: Loop, number: int, neighbour: int, neighbour_link: Motion) -> Loop | None:
    """Return a loop moved from a removed node to a neighbour; None if nothing is left of it."""
    if number not in (loop.old, loop.new):
        return loop
    if neighbour in (loop.old, loop.new):
        return None
    if loop.new == number:
        return Loop(loop.old, neighbour, loop.motion.then(neighbour_link))
    return Loop(neighbour, loop.new, neighbour_link.back().then(loop.motion))


def _pose3(pose: Array) -> Any:
    return gtsam.Pose3(se3.orthonormalise(pose))
