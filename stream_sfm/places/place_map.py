"""A map of the places of a run: the sink that recognises them, and the corrected world.

The engine's world drifts and never jumps; here it is called odom. The world of the map is the first keyframe, and
`world_from_odom` is the correction, which may jump. A loop counts only if it agrees with the prediction
by both covariances; if the prediction is so uncertain that another place is possible, several loops must agree.
"""

import logging
from bisect import bisect_left
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import chdtri

from ..camera.pixels import GreyScaler, to_grey
from ..camera.rectification import Rectifier
from ..camera.rig import MonoRig, StereoRig, masked_by
from ..camera.unseen_errors import PhysicalAxes
from ..config import Config
from ..errors import ConfigError
from ..geometry import Array, se3
from ..geometry.robust_rules import RobustRules
from ..motion import UNSEEN, Motion
from ..system.blas import one_thread
from ..types import Frame, FrameEstimate, Trajectory
from .chain import Chain
from .finding import Words, apart, may_overlap, nearest_poses, offsets_m, stds
from .graph import Loop, PoseGraph
from .keyframes import Keyframe, make_keyframe
from .map_file import load_map, save_map
from .settings import SETTINGS
from .verifying import Seen, Verifier


class _Found(NamedTuple):
    """The result of a job: see PlaceMap."""

    frame_index: int
    world_from_odom: Array
    located: bool
    hopeful: bool  # some place looks familiar


class _Node(NamedTuple):
    """A keyframe, and the distance travelled until then."""

    keyframe: Keyframe
    path_m: float


class PlaceMap:
    """A sink that keeps keyframes, recognises places and corrects the poses.

    The work is done in a separate thread. With `wait`, as in a replay, the result does not depend on its speed: each
    keyframe is finished before the next one is taken. Without it, as in live use, a keyframe that comes while two wait
    is taken later. At most `max_keyframes` are kept; those closest to others are dropped first. `config`: that
    of the engine. `known`: a file of `save`; the camera is located in its world, and this run extends it.
    Raises ConfigError if GTSAM is not installed, or for one camera; InputError if `known` is not a map of this rig.

    `world_from_odom` (4, 4): the latest correction; its product with `world_from_cam` of an estimate is the pose in
    the map. `located`: whether the place of the camera in the world of the map is known, which it is not after a loss
    until an old place is seen. Both are as of the last call of `write`. `problem`: why the map has ended before the
    run, for example because GTSAM gave up; `poses` then end there. It is empty otherwise.
    """

    def __init__(
        self,
        rig: StereoRig | MonoRig,
        config: Config | None = None,
        *,
        wait: bool = False,
        max_keyframes: int = SETTINGS.max_keyframes,
        known: str | Path | None = None,
    ) -> None:
        if not isinstance(rig, StereoRig) or (config is not None and config.mono):
            raise ConfigError("maps need a pair of cameras: with one camera a motion has no length")
        self.problem, self._covs = "", np.zeros((0, 6, 6))
        self._graph = PoseGraph(SETTINGS.shared_structure)
        self._nodes: dict[int, _Node] = {}
        self._max_keyframes = max_keyframes
        config = config or Config()
        self._rectifier = Rectifier(masked_by(config, rig))
        self._rect_from_cam = se3.from_rotation_translation(self._rectifier.rect_from_cam, np.zeros(3))
        self._gate = float(chdtri(6, 1 - config.rules.of(RobustRules).gate_probability))  # χ² of equal motions
        errors, rect_from_cam = config.rig, self._rectifier.rect_from_cam
        self._axes = self._axes_with_unseen = PhysicalAxes(rect_from_cam)
        if not errors.exact:
            self._axes_with_unseen = PhysicalAxes(rect_from_cam, errors.std_baseline, errors.std_axes_rad)
        self._verifier = Verifier(self._rectifier.projection)
        self._scaler = GreyScaler()
        self._chain, self._words = Chain(), Words()
        self._path_m, self._before = 0.0, np.eye(4)
        self._pending: list[Loop] = []
        self._wait = wait
        if known is not None:
            keyframes, state = load_map(known, self._rectifier.projection, self._rectifier.rect_from_cam)
            self._graph.restore(state)
            for number, keyframe in zip(state.numbers, keyframes, strict=True):
                self._nodes[number] = _Node(keyframe, -np.inf)
                self._words.add(number, keyframe.descriptors)
        self._number = self._first = max(self._nodes, default=-1) + 1
        self.world_from_odom, self.located = np.eye(4), False
        self._hopeful, self._lost_until = False, -1  # frame: knowledge about earlier ones is of the previous world
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="places")
        self._jobs: list[Future[_Found | None]] = []

    def __len__(self) -> int:
        """Return the number of keyframes."""
        return len(self._nodes)

    @property
    def loops(self) -> list[tuple[int, int]]:
        """The stamps of the two keyframes of each used loop of this run, the older one first."""
        nodes, loops = self._nodes, self._graph.loops
        found = [loop for loop in loops if max(loop.old, loop.new) >= self._first]
        return [(nodes[loop.old].keyframe.stamp_ns, nodes[loop.new].keyframe.stamp_ns) for loop in found]

    def lines(self) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return lines for a picture: paths of all keyframes before and after loops, and the rows that loops join.

        The paths are (n, 3) in metres, the rows (m, 2); call it after `close`.
        """
        graph, (_, odom_from_cam, rows) = self._graph, self._own()
        after = graph.poses[:, :3, 3].copy()
        before = np.concatenate([after[: rows.start], odom_from_cam[:, :3, 3]])
        joined = np.searchsorted(graph.numbers, [(loop.old, loop.new) for loop in graph.loops])
        return before, after, joined.reshape(-1, 2)

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the next frame; one that becomes a keyframe is handed to the map's thread."""
        if self.problem:
            return
        self._path_m += float(np.linalg.norm((se3.inverse(self._before) @ estimate.world_from_cam)[:3, 3]))
        self._before = estimate.world_from_cam
        if not self._wait:
            self._settle(False)
        soon = self._hopeful or estimate.frame_index - self._lost_until < SETTINGS.search_frames
        due = self._chain.step(estimate, eager=not self.located and soon)
        if self._chain.is_cut:
            self.located, self._lost_until = False, estimate.frame_index
        if not due:
            return
        if self._wait:  # only here, so that the result does not depend on timing
            self._settle(True)
        if len(self._jobs) >= SETTINGS.waiting:
            return
        images = tuple(np.array(image) for image in frame.images)  # a copy, as a camera may overwrite them
        self._jobs.append(self._pool.submit(self._take, estimate, images, self._chain.link, self._path_m))
        self._chain.set_keyframe(estimate)

    def close(self) -> None:
        """Finish waiting jobs, solve everything again with the final knowledge, and compute the covariances."""
        self._settle(True)
        self._pool.shutdown()
        try:
            with one_thread:
                self._covs = self._graph.covariances()
        except (RuntimeError, IndexError) as error:  # of GTSAM
            if not self.problem:
                self._end("the map has no solution", error)
            self._covs = self._graph.state().covs
        newest = max(self._nodes, default=-1)
        if newest >= self._first and self._nodes[newest].keyframe.frame_index >= self._lost_until:
            self.world_from_odom = self._correction(newest)

    def save(self, path: str | Path) -> None:
        """Write the map to a file, with which a later run can continue; call it after `close`. Raises OutputError."""
        keyframes = [self._nodes[number].keyframe for number in self._graph.numbers]
        save_map(path, self._rectifier.projection, self._rectifier.rect_from_cam, keyframes, self._graph.state())

    def poses(self) -> Trajectory:
        """Return the poses of the keyframes of this run in the world of the map, with covariances, after `close`."""
        stamps_ns, _, rows = self._own()
        poses = self._graph.poses[rows].copy()
        in_rect = self._rect_from_cam @ poses @ self._rect_from_cam.T
        _, unseen, _ = self._axes_with_unseen.motions(in_rect, np.zeros((len(poses), 6, 6)))
        return Trajectory(stamps_ns, poses, self._covs[rows] + unseen)

    def corrected(self, trajectory: Trajectory) -> Trajectory:
        """Return the poses of a run in the world of the map, from the keyframes around them; call it after `close`.

        Covariances are those of the nearest keyframe.
        """
        if not self.loops or self.problem:
            return trajectory
        known = self.poses()
        stamps_ns, poses = known.stamps_ns, known.world_from_cam
        corrections = poses @ se3.inverse(self._own()[1])
        after = np.clip(np.searchsorted(stamps_ns, trajectory.stamps_ns), 1, max(1, len(stamps_ns) - 1))
        before, after = after - 1, np.minimum(after, len(stamps_ns) - 1)
        span = np.maximum(stamps_ns[after] - stamps_ns[before], 1)
        share = ((trajectory.stamps_ns - stamps_ns[before]) / span).clip(0, 1)
        change = se3.log(se3.inverse(corrections[before]) @ corrections[after])
        correction = corrections[before] @ se3.exp(share[:, None] * change)
        corrected = se3.orthonormalise(correction @ trajectory.world_from_cam)
        assert known.cov_pose is not None
        nearest = np.where(share < 0.5, before, after)
        turn = se3.adjoint(se3.inverse(corrected) @ poses[nearest])
        covs = turn @ known.cov_pose[nearest] @ np.swapaxes(turn, 1, 2)
        return Trajectory(trajectory.stamps_ns, corrected, covs)

    def _own(self) -> tuple[NDArray[np.int64], Array, slice]:
        """Return stamps (n,) and odom from camera (n, 4, 4) of the keyframes of this run, and their rows among all."""
        first = bisect_left(self._graph.numbers, self._first)
        own = [self._nodes[number].keyframe for number in self._graph.numbers[first:]]
        stamps_ns = np.array([keyframe.stamp_ns for keyframe in own], np.int64)
        odom_from_cam = np.array([keyframe.odom_from_cam for keyframe in own]).reshape(-1, 4, 4)
        return stamps_ns, odom_from_cam, slice(first, None)

    def _settle(self, everything: bool) -> None:
        """Take the results of finished jobs; wait for all of them if `everything`."""
        while self._jobs and (everything or self._jobs[0].done()):
            found = self._jobs.pop(0).result()
            if found is not None and found.frame_index >= self._lost_until:
                self.world_from_odom, self.located = found.world_from_odom, found.located
                self._hopeful = found.hopeful

    def _take(
        self, estimate: FrameEstimate, images: tuple[NDArray[Any], ...], link: Motion | None, path_m: float
    ) -> _Found | None:
        """Make a keyframe of a frame, moved by `link` since the last one; None if the map has ended."""
        if self.problem:
            return None
        try:
            with one_thread:
                return self._add(estimate, images, link, path_m)
        except (RuntimeError, np.linalg.LinAlgError, cv2.error) as error:  # GTSAM raises RuntimeErrors
            self._end(f"the map ends at frame {estimate.frame_index}", error)
            return None

    def _end(self, where: str, error: Exception) -> None:
        """Record why the map has ended, with the first line of GTSAM's message."""
        what, _, _ = str(error).strip().partition("\n")
        self.problem = f"{where}: {what}"
        logging.getLogger("stream_sfm").warning(self.problem)

    def _add(
        self, estimate: FrameEstimate, images: tuple[NDArray[Any], ...], link: Motion | None, path_m: float
    ) -> _Found:
        """Make the next keyframe, and check whether its place is known."""
        number, self._number, turn = self._number, self._number + 1, self._rectifier.rect_from_cam
        rectified = self._rectifier.rectify(*self._scaler.to_uint8(*(to_grey(image) for image in images)))
        keyframe = make_keyframe(
            rectified,
            self._rectifier.projection,
            estimate.frame_index,
            estimate.stamp_ns,
            estimate.world_from_cam,
            estimate.points_in_cam @ turn.T,
            turn @ estimate.cov_points @ turn.T,
            self._rectifier.valid,
        )
        if (common := estimate.common) is not None:
            self._graph.know(common.mean[UNSEEN:], common.cov[UNSEEN:, UNSEEN:])
        self._graph.add(number, estimate.world_from_cam, link, cov=estimate.cov_pose)
        self._nodes[number] = _Node(keyframe, path_m)
        self._find(number, Seen(keyframe, rectified))
        self._words.add(number, keyframe.descriptors)
        if len(self._nodes) > self._max_keyframes:
            self._thin()
        located = self._graph.home(number) == self._graph.home(self._graph.numbers[0])
        hopeful = bool(self._pending) and self._pending[-1].new == number
        return _Found(estimate.frame_index, self._correction(number), located, hopeful)

    def _correction(self, number: int) -> Array:
        """Return world from odom (4, 4) by one keyframe."""
        if not self.loops:  # before that, the poses of the engine are at least as good
            return np.eye(4)
        odom_from_cam = self._nodes[number].keyframe.odom_from_cam
        return se3.orthonormalise(self._graph.pose(number) @ se3.inverse(odom_from_cam))

    def _find(self, number: int, seen: Seen) -> None:
        """Look for older keyframes of the same place: by the predicted pose, and if that is not enough, by words."""
        graph, keyframe = self._graph, seen.keyframe
        rows = np.flatnonzero(graph.in_world_of(number) & self._by_detour(number))
        rows = rows[nearest_poses(graph.poses[rows], graph.pose(number), keyframe.depth_m)]
        motions, covs = graph.predicted(number, rows)
        gate = may_overlap(motions, covs, keyframe.depth_m, np.sqrt(self._gate))
        near = {
            graph.numbers[row]: Motion(*known)
            for row, *known in zip(rows[gate], motions[gate], covs[gate], strict=True)
        }
        sure = {old: link for old, link in near.items() if not self._is_ambiguous(link.cov, keyframe.depth_m)}
        for old in apart(sure, SETTINGS.candidates, SETTINGS.apart):
            if (loop := self._verified(old, number, seen, sure[old])) and self._same(sure[old], loop.motion):
                self._graph.close([loop], uncertain=False)
                return
        elsewhere = np.flatnonzero(~graph.in_world_of(number))
        uncertain = {*near} - {*sure} | {graph.numbers[row] for row in elsewhere}
        alike = self._words.alike(keyframe.descriptors, uncertain) if uncertain else ()
        found = [self._verified(old, number, seen) for old in apart(alike, SETTINGS.candidates, SETTINGS.apart)]
        self._close_uncertain([loop for loop in found if loop is not None])

    def _by_detour(self, number: int) -> NDArray[np.bool_]:
        """Return from which nodes (n,) the camera has come by a detour."""
        nodes, new, graph = self._nodes, self._nodes[number], self._graph
        path_m = new.path_m - np.array([nodes[old].path_m for old in graph.numbers])
        straight_m = offsets_m(graph.poses, graph.pose(number))
        return np.asarray(path_m > straight_m + SETTINGS.min_detour_depths * new.keyframe.depth_m)

    def _verified(self, old: int, new: int, seen: Seen, known: Motion | None = None) -> Loop | None:
        turn = self._rect_from_cam
        predicted = None if known is None else turn @ known.earlier_from_newest @ turn.T
        found = self._verifier.motion(self._nodes[old].keyframe, seen, predicted)
        if found is None:
            return None
        poses, covs, _ = self._axes.motions(found.earlier_from_newest[None], found.cov[None])
        return Loop(old, new, Motion(poses[0], covs[0]))

    def _close_uncertain(self, loops: list[Loop]) -> None:
        """Keep a loop until others agree with it, then close them all; candidates for two places are ignored."""
        if not loops or any(self._are_rivals(loops[0], other) for other in loops[1:]):
            return
        loop = loops[0]
        agreeing = [other for other in self._pending if other.new != loop.new and self._agree(other, loop)]
        self._pending = [*self._pending[-SETTINGS.max_pending :], loop]
        if len({other.new for other in agreeing}) + 1 < SETTINGS.agreeing:
            return
        chosen = [*agreeing, loop]
        self._pending = [other for other in self._pending if other not in chosen]
        self._graph.close(chosen, uncertain=True)

    def _agree(self, a: Loop, b: Loop) -> bool:
        """Whether two loops agree, by the motions between their ends."""
        olds, news = self._graph.between(a.old, b.old), self._graph.between(a.new, b.new)
        return olds is not None and news is not None and self._same(a.motion.then(news), olds.then(b.motion))

    def _are_rivals(self, a: Loop, b: Loop) -> bool:
        """Whether two loops of one keyframe put it at different places."""
        olds = self._graph.between(a.old, b.old)
        return olds is not None and not self._same(a.motion, olds.then(b.motion))

    def _same(self, one: Motion, other: Motion) -> bool:
        """Whether two estimates of a motion with independent errors agree by χ²."""
        error = se3.log(se3.inverse(one.earlier_from_newest) @ other.earlier_from_newest)
        return bool(error @ np.linalg.solve(one.cov + other.cov, error) < self._gate)

    def _is_ambiguous(self, cov: Array, depth_m: float) -> bool:
        """Whether another place may lie within the covariance (6, 6) of a prediction, as far as the gate reaches."""
        (std_m,), (std_rad,) = np.sqrt(self._gate) * np.array(stds(cov[None]))
        return bool(std_m > SETTINGS.max_offset_depths * depth_m or std_rad > SETTINGS.max_angle_rad)

    def _thin(self) -> None:
        """Drop the keyframes that are closest to older ones."""
        numbers = self._graph.numbers[: -SETTINGS.apart]
        depth_m = np.median([self._nodes[number].keyframe.depth_m for number in numbers])
        poses = self._graph.poses[: len(numbers)]
        where = np.hstack([poses[:, :3, 3] / depth_m, poses[:, :3, :3].reshape(-1, 9) / np.sqrt(2)])  # depths and rad
        distance, neighbour = (column[:, 1] for column in KDTree(where).query(where, 2))
        distance[neighbour >= np.arange(len(numbers))] = np.inf  # of two close ones, the newer one is dropped
        too_many = len(self._nodes) - self._max_keyframes  # also those of a loaded map that kept more
        count = max(1, int(SETTINGS.thinned * self._max_keyframes), too_many)
        gone = [numbers[row] for row in np.argsort(distance, kind="stable")[:count].tolist()]
        self._graph.remove(gone)
        self._pending = [loop for loop in self._pending if loop.old not in gone and loop.new not in gone]
        for number in gone:
            del self._nodes[number]
            self._words.forget(number)
