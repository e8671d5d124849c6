"""The engine handles failing cameras, and scenes in which nothing can be seen, as the table in
docs/troubleshooting.md says.

Statuses are written as letters, one a frame: i(nitialising), o(k), d(egraded), l(ost), and r where the frame was
refused. Frames 10 and later are the ones at fault unless said.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

pytestmark = pytest.mark.slow

STEREO = rig()
WALL = Wall(5)
POSES = camera_path(110)
N = 20  # frames, six of them behind the fault
Edit = Callable[[np.ndarray], np.ndarray]


@cache
def seen(n: int) -> sfm.StereoFrame:
    """The frame of pose `n` of the path, at its own time."""
    return view(POSES[n], n)


def view(world_from_cam: np.ndarray, n: int, wall: Wall = WALL) -> sfm.StereoFrame:
    wall.rng = np.random.default_rng(n)  # the same grain in whatever order the tests run
    return wall.frame(STEREO, world_from_cam, n)


def edited(numbers: range, edit: Edit, frame: sfm.StereoFrame, n: int) -> sfm.StereoFrame:
    return replace(frame, left=edit(frame.left), right=edit(frame.right)) if n in numbers else frame


def during(numbers: range, edit: Edit) -> list[sfm.StereoFrame]:
    """`N` frames of which those of `numbers` are edited."""
    return [edited(numbers, edit, seen(n), n) for n in range(N)]


def noise(image: np.ndarray) -> np.ndarray:
    return np.random.default_rng(int(image.sum())).integers(0, 256, image.shape, dtype=np.uint8)


def featureless(image: np.ndarray) -> np.ndarray:
    grain = np.random.default_rng(int(image.sum())).normal(scale=2, size=image.shape)
    return np.clip(np.rint(128 + grain), 0, 255).astype(np.uint8)


def brighter(image: np.ndarray) -> np.ndarray:
    return np.clip(4 * image.astype(int), 0, 255).astype(np.uint8)


def half_black(image: np.ndarray) -> np.ndarray:
    return np.where(np.arange(image.shape[1]) < image.shape[1] // 2, 0, image).astype(np.uint8)


def sides(left: Callable[[int], np.ndarray], right: Callable[[int], np.ndarray]) -> list[sfm.StereoFrame]:
    return [sfm.StereoFrame(n * PERIOD_NS, left(n), right(n)) for n in range(N)]


def at_fault(n: int) -> bool:
    return 10 <= n < 14


def jump(first: int, later_s: float, wall: Wall = WALL) -> list[sfm.StereoFrame]:
    """Ten frames, then those from pose `first` on, so many seconds later, before `wall`."""
    begin = round(later_s * 1e9) + 9 * PERIOD_NS
    return [seen(n) for n in range(10)] + [
        replace(view(POSES[first + k], first + k, wall), stamp_ns=begin + k * PERIOD_NS) for k in range(10)
    ]


@dataclass(frozen=True)
class Fault:
    """`frames`, `statuses` as a pattern, and what the `reason` of a frame at fault says, and of another.

    `off_m`: how far the position may be from the truth although the covariance does not say so. `too_fast`: the
    camera accelerates more than `motion` in the configuration allows for, so that once lost it is anywhere.
    """

    frames: list[sfm.StereoFrame]
    statuses: str
    reason: str = ""
    truth: np.ndarray | None = None  # None: the pose of the path that belongs to the stamp
    off_m: float = 0.005
    too_fast: bool = False


def turned() -> Fault:
    yaw = np.concatenate([np.full(8, -0.785), [-0.26, 0.26], np.full(8, 0.785)])
    poses = np.stack([se3.exp([0.02 * n, 0, 0, 0, 0, 0]) @ se3.exp([0, 0, 0, 0, y, 0]) for n, y in enumerate(yaw)])
    frames = [view(pose, n) for n, pose in enumerate(poses)]
    return Fault(frames, "io{6}[od][odli]{10}", truth=se3.inverse(poses[0]) @ poses, too_fast=True)


def covered_and_carried() -> Fault:
    """Black for a second, and then another part of the wall."""
    shown = [*range(30), *range(90, 100)]
    frames = [edited(range(10, 30), np.zeros_like, seen(k), n) for n, k in enumerate(shown)]
    frames = [replace(f, stamp_ns=n * PERIOD_NS) for n, f in enumerate(frames)]
    return Fault(frames, "io{9}l{20}io{9}", "new map at the predicted pose", POSES[shown])


def held_back_and_carried() -> Fault:
    """The same picture for half a second, each time with other noise, and then another part of the wall."""
    shown = [*range(10), *[9] * 10, *range(90, 100)]
    frames = [replace(view(POSES[k], n), stamp_ns=n * PERIOD_NS) for n, k in enumerate(shown)]
    return Fault(frames, "io{19}lio{8}", "the whole view has changed at once", POSES[shown])


def ten_minutes_at_rest() -> Fault:
    views = [view(np.eye(4), n) for n in range(20)]
    frames = [replace(views[n % 20], stamp_ns=n * 20 * 10**9) for n in range(31)]
    return Fault(frames, "io{30}", truth=np.tile(np.eye(4), (31, 1, 1)))


def exposed(image: np.ndarray, seed: int) -> np.ndarray:
    """Brighter or darker by up to a third, and a pedestal."""
    gain, pedestal = np.random.default_rng(seed).uniform((0.67, 0), (1.33, 20))
    return np.clip(np.rint(gain * image + pedestal), 0, 255).astype(np.uint8)


NOTHING_SEEN: list[Edit] = [noise, featureless, np.zeros_like, lambda image: np.full_like(image, 255)]
LOST = "io{9}l{4}o{6}"  # the view comes back, and the map goes on
FAULTS: dict[str, Callable[[], Fault]] = {
    "right camera missing for 100 frames": lambda: Fault(
        # the same wall is found again after 5 s; the velocity is not known then, and new points disagree by 1 mm
        jump(70, 5), "io{10}d{0,4}o+", truth=POSES[[*range(10), *range(70, 80)]]
    ),
    "gap of 2 s, the same scene": lambda: Fault([seen(n) for n in [*range(10), *range(50, 60)]], "io{19}"),
    "gap of 2 s, another scene": lambda: Fault(
        jump(90, 2, Wall(6)), "io{9}lio{8}", "views of known points", POSES[[*range(10), *range(90, 100)]]
    ),
    "both images frozen": lambda: Fault(
        sides(lambda n: seen(9 if at_fault(n) else n).left, lambda n: seen(9 if at_fault(n) else n).right),
        "io{9}d{4}o{6}", "frozen",
    ),
    "black, white, noise, featureless": lambda: Fault(
        [edited(range(10, 14), NOTHING_SEEN[n % 4], seen(n), n) for n in range(N)],
        LOST, "image is black; image is white; too little texture",
    ),
    "featureless wall at the start": lambda: Fault(during(range(4), featureless), "l{4}io{15}", "too little texture"),
    "half of both images black": lambda: Fault(during(range(10, 14), half_black), "io{9}[od]{4}o{6}"),
    "left image black": lambda: Fault(
        sides(lambda n: seen(n).left * (not at_fault(n)), lambda n: seen(n).right), LOST, "left image is black"
    ),
    "right image black": lambda: Fault(
        sides(lambda n: seen(n).left, lambda n: seen(n).right * (not at_fault(n))),
        "io{9}d{4}o{6}", "right image is black",
    ),
    "exposure to a quarter": lambda: Fault(during(range(10, N), lambda i: i // 4), "io{19}"),
    "exposure of each camera another in each frame": lambda: Fault(
        sides(lambda n: exposed(seen(n).left, 2 * n), lambda n: exposed(seen(n).right, 2 * n + 1)), "io{19}"
    ),
    "exposure times four": lambda: Fault(during(range(10, N), brighter), "io{9}[lid]{2}[od]{8}"),
    "blurred by 5 px": lambda: Fault(
        during(range(10, 14), lambda i: cv2.GaussianBlur(i, (0, 0), 5)), "io{9}[lido]{5}[io]{5}", off_m=0.04
    ),
    # a map of twelve blurred points may be followed by all of them: with σ of 30 mm, and right
    "blurred by 15 px": lambda: Fault(
        during(range(10, 14), lambda i: cv2.GaussianBlur(i, (0, 0), 15)), "io{9}[lid]{2}[lido]{2,3}[io]{5,6}",
        off_m=0.03,
    ),
    "a turn by 90° in three frames": turned,
    "covered, then uncovered elsewhere": covered_and_carried,
    "held back, then elsewhere": held_back_and_carried,
    "ten minutes at rest": ten_minutes_at_rest,
    "stamps backwards and equal, frames of another size": lambda: Fault(
        [*(seen(n) for n in range(10)), replace(seen(10), stamp_ns=5 * PERIOD_NS),
         replace(seen(11), stamp_ns=9 * PERIOD_NS), edited(range(20), lambda i: i[:-2], seen(12), 12),
         *(seen(n) for n in range(13, N))],
        "io{9}r{3}o{7}", "stamps must increase; calibration",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_has_a_defined_result(name):
    fault = FAULTS[name]()
    engine = sfm.Engine(STEREO)
    letters, reasons, estimates = "", [], []
    truth = POSES[[f.stamp_ns // PERIOD_NS for f in fault.frames]] if fault.truth is None else fault.truth
    kept = []
    for frame, pose in zip(fault.frames, truth, strict=True):
        try:
            estimates.append(engine.step(frame))
        except sfm.FrameError as error:
            letters += "r"
            reasons.append(str(error))
            continue
        letters += str(estimates[-1].status)[0]
        reasons.append(estimates[-1].reason)
        kept.append((frame, pose))
    assert re.fullmatch(fault.statuses, letters), letters
    for said in fault.reason.split("; "):
        assert any(said in reason for reason in reasons), said
    for index, (e, (frame, pose)) in enumerate(zip(estimates, kept, strict=True)):
        assert (e.frame_index, e.stamp_ns) == (index, frame.stamp_ns)  # one for each frame, none made up
        rotation = e.world_from_cam[:3, :3]
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12
        assert np.isfinite(e.cov_pose).all() and np.linalg.eigvalsh(e.cov_pose).min() > -1e-12
        if e.status == sfm.Status.LOST:
            assert not len(e.track_ids)
            assert index == 0 or np.trace(e.cov_pose) > np.trace(estimates[index - 1].cov_pose)
        error = se3.log(se3.inverse(e.world_from_cam) @ pose)
        nees = error @ np.linalg.solve(e.cov_pose + 1e-12 * np.eye(6), error)
        beyond_prior = fault.too_fast and sfm.Status.LOST in [x.status for x in estimates[: index + 1]]
        assert nees < 50 or beyond_prior or np.linalg.norm(error[:3]) < fault.off_m, (index, nees, error)
