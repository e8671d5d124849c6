"""Checks a calibration against images: matched corners must lie on the same row after rectification.

Rows are judged as in the front-end: by its model of rows at the corners, and by its limits. Errors that it corrects are
not findings. Corners show no velocities, and so no late camera: they only raise a suspicion, which a well-tracked
frame refutes.
"""

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera.lens import rays_of
from ..camera.models import Camera
from ..camera.rig import StereoRig
from ..config import Config
from ..frontend.learnt.pair_check import PairRules, rows_problem
from ..frontend.learnt.rows import Rows
from ..geometry import Array
from ..geometry.medians import MAD_TO_STD, median
from ..geometry.stereo import StereoProjection
from ..logs.recording.rig import REMEDY, right_is_left
from ..logs.recording.stereo_log import StereoLog
from ..logs.recording.topics import PairChoice
from ..record import changed, record
from ..types import Frame, FrameEstimate, Status

Images = tuple[NDArray[np.uint8], NDArray[np.uint8]]  # left, right, (h, w)
Corners = tuple[Array, Array]  # pixels (n, 2) of corners in the left and in the right image
Findings = tuple[list[str], list[str]]  # problems: stereo cannot work; warnings: it works less well


class _Rules(NamedTuple):
    """What counts as a match, and the limits beyond which something is wrong; shares are of all matches."""

    features: int = 1000  # ORB corners per image: about a hundred of them match in an ordinary scene
    max_hamming: int = 40  # of 256 bits between two ORB descriptors that match; random ones differ by 128 ± 8
    window_px: tuple[int, int] = (15, 15)  # patch of the sub-pixel refinement
    max_refinement_px: float = 3.0  # whole pixels of the last pyramid level of ORB are 3.6 px
    min_matches: int = 40  # fewer say nothing certain about rows
    inlier_spreads: float = 3.0  # matches within this many σ of the median row offset
    min_inlier_px: float = 1.0  # but at least within this
    rounds: int = 6  # of median and spread, enough to converge
    negative_px: float = -1.0  # disparities below it are negative beyond the noise of a match
    # A calibration beyond either may be that of swapped cameras, which is then tried.
    row_error_px: float = 0.5
    negative_share: float = 0.05  # also reported
    swapped_share: float = 0.5  # of negative disparities: most of the scene would be beyond infinity
    clearly_better: float = 0.5  # a row error below this share of the other one is decisive
    unswapped_share: float = 0.1  # at most this many with the images swapped, if the rows show that they are
    # Offsets of stamps beyond both are reported: at 50 px of motion per frame, 0.02 periods are one pixel.
    stamp_offset_ms: float = 1.0
    stamp_offset_periods: float = 0.02
    confirmed_by: int = 4  # frames
    equal_scales: float = 0.01  # between factors of width and height: images were resized, not cropped


_RULES = _Rules()


@record
class CalibrationCheck:
    """The matches of a few frames in pixels of rectified images; NaN if there are too few.

    `vertical_px`: median of left minus right row, with `vertical_spread_px`; `negative_share`: share of matches with
    a negative disparity, which is impossible unless the images are swapped. `rows_problem`: why the front-end cannot
    work with these rows; empty if it can.
    """

    matches: int
    vertical_px: float
    vertical_spread_px: float
    negative_share: float
    median_disparity_px: float
    rows_problem: str = ""

    @property
    def row_error_px(self) -> float:
        """The row error of matched corners; infinite with too few matches."""
        return float(np.nan_to_num(np.hypot(self.vertical_px, self.vertical_spread_px), nan=np.inf))


def check_calibration(rig: StereoRig, frames: Sequence[Corners]) -> CalibrationCheck:
    """Compare the rows that a calibration gives to corners of a few frames, which were matched without it."""
    none = np.empty((0, 2))
    cameras = zip((rig.left, rig.right), _rectifying_rotations(rig), strict=True)
    left, right = (
        _rectified(camera, rotation, np.concatenate([none, *(corners[side] for corners in frames)]))
        for side, (camera, rotation) in enumerate(cameras)
    )
    offset = float(rig.left.K[0, 0]) * (left - right)
    finite = np.isfinite(offset).all(axis=1)
    places, (disparity, vertical) = left[finite], offset[finite].T
    # Wrong matches can be anywhere: keep those that agree on one vertical offset.
    centre, spread = 0.0, 0.1 * rig.left.height
    for _ in range(_RULES.rounds):
        good = np.abs(vertical - centre) < max(_RULES.inlier_spreads * spread, _RULES.min_inlier_px)
        if good.sum() < _RULES.min_matches:
            return CalibrationCheck(int(good.sum()), np.nan, np.nan, np.nan, np.nan)
        centre = median(vertical[good])
        spread = MAD_TO_STD * median(np.abs(vertical[good] - centre))
    negative = float(np.mean(disparity[good] < _RULES.negative_px))
    found = CalibrationCheck(int(good.sum()), centre, spread, negative, median(disparity[good]))
    return changed(found, rows_problem=_rows_problem(rig, places[good], vertical[good]))


def _rows_problem(rig: StereoRig, left: Array, vertical_px: Array) -> str:
    """Return the front-end's verdict on rows of matches at left rays (n, 2) that differ by (n,)."""
    k, config = rig.left.K, Config()
    size = rig.left.width, rig.left.height
    projection = StereoProjection(k[0, 0], k[0, 2], k[0, 2], k[1, 2], rig.baseline_m, *size)
    rows = Rows.unknown(projection, config)
    left_px = k[0, 0] * left + k[:2, 2]
    return rows_problem(rows.learnt(left_px, vertical_px, np.zeros(len(left))), config.rules.of(PairRules))


def matched_corners(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Corners:
    """Match corners between left and right without any calibration."""
    orb = cv2.ORB.create(_RULES.features)
    left_keys, left_words = orb.detectAndCompute(left, None)
    right_keys, right_words = orb.detectAndCompute(right, None)
    found = []
    if left_words is not None and right_words is not None:
        found = list(cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(left_words, right_words))
    found = [m for m in found if m.distance < _RULES.max_hamming]
    if not found:
        return np.empty((0, 2)), np.empty((0, 2))
    left_px = np.array([left_keys[m.queryIdx].pt for m in found], np.float32)
    coarse_px = np.array([right_keys[m.trainIdx].pt for m in found], np.float32)
    # Corners are whole pixels at their scale; the patches around them are located to a tenth of a pixel.
    fine_px, found_again, _ = cv2.calcOpticalFlowPyrLK(
        left,
        right,
        left_px,
        coarse_px.copy(),
        winSize=_RULES.window_px,
        maxLevel=1,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    good = (found_again[:, 0] == 1) & (np.abs(fine_px - coarse_px).max(axis=1) < _RULES.max_refinement_px)
    return left_px[good].astype(float), fine_px[good].astype(float)


def _rectifying_rotations(rig: StereoRig) -> tuple[Array, Array]:
    """Return rotations (3, 3) of left and right camera axes into axes whose x is along the baseline."""
    rotation = rig.right_from_left[:3, :3]
    right_in_left = -rotation.T @ rig.right_from_left[:3, 3]
    x = right_in_left / np.linalg.norm(right_in_left)
    if x[0] < 0:
        x = -x  # keep the image upright if the baseline has the wrong sign
    z = np.array([0.0, 0.0, 1.0]) + rotation[2]  # the mean of both optical axes
    y = np.cross(z, x)
    y /= np.linalg.norm(y)
    from_left = np.stack([x, y, np.cross(x, y)])
    return from_left, from_left @ rotation.T


def _rectified(camera: Camera, rotation: Array, points_px: Array) -> Array:
    """Return normalised rectified coordinates (n, 2) of pixels (n, 2)."""
    if not len(points_px):
        return points_px
    rays = rays_of(camera, points_px) @ rotation.T
    return np.where(rays[:, 2:] > 0.05, rays[:, :2] / np.maximum(rays[:, 2:], 0.05), np.nan)


def size_problem(size: tuple[int, int], rig: StereoRig) -> str | None:
    """Say that images have another size (width, height) than the calibrated one."""
    calibrated = (rig.left.width, rig.left.height)
    if size == calibrated:
        return None
    sx, sy = (a / b for a, b in zip(size, calibrated, strict=True))
    resized = (
        f"they seem to be resized by {sx:.3g}: multiply fx, fy, cx, cy of K (and P) by it as well"
        if abs(sx - sy) < _RULES.equal_scales
        else "they seem to be cropped: subtract the corner of the crop from cx, cy"
    )
    return (
        f"images are {size[0]}×{size[1]}, the calibration is for {calibrated[0]}×{calibrated[1]}; {resized}; {REMEDY}"
    )


def calibration_findings(
    rig: StereoRig,
    check: CalibrationCheck,
    corners: Sequence[Corners],
    choice: PairChoice,
    is_followed: Callable[[], bool],
) -> Findings:
    """Report the first cause that explains the check of these corners; other symptoms of the rows follow from it.

    `is_followed`: whether an engine tracks such frames well; it is called only if the rows of corners are in question.
    """
    swapped = check
    if not (check.row_error_px <= _RULES.row_error_px and check.negative_share <= _RULES.negative_share):
        swapped = check_calibration(rig, [(right, left) for left, right in corners])
    if (problem := _side_problem(rig, check, swapped, choice)) is not None:
        return [problem], []
    problems, warnings = [], []
    if not np.isfinite(check.vertical_px):
        few = f"only {check.matches} corners match left to right"
        warnings.append(f"the calibration could not be checked: {few}")
    elif check.rows_problem and not is_followed():
        cure = f"If they are rectified already, name their topics image_rect; otherwise {REMEDY}"
        problems.append(f"{check.rows_problem} {cure}")
    if check.negative_share > _RULES.negative_share:  # too few for swapped cameras
        warnings.append(
            f"{100 * check.negative_share:.0f} % of the matches have negative disparity, as if they lay beyond "
            "infinity: the angle between the cameras (rotation of right_from_left, or R) or a principal point (cx) is "
            "wrong, and all depths with it"
        )
    return problems, warnings


def images_of(frame: Frame) -> Images:
    """Return the first and the last image of a frame of a log, with 8 bits."""
    images = [np.asarray(image, np.uint8) for image in frame.images]
    return images[0], images[-1]


def log_problems(log: StereoLog, frames: Sequence[Frame]) -> list[str]:
    """Return the problems, as far as these frames show, that prevent a replay of a log with its calibration."""
    rig, choice = log.stereo_rig, PairChoice(log.left_topic, log.right_topic, log.choice_reason)
    corners = [matched_corners(*images_of(frame)) for frame in frames]
    check = check_calibration(rig, corners)
    problems, _ = calibration_findings(rig, check, corners, choice, lambda: False)
    return [f"{log.path}: {problem}" for problem in problems]


def well_followed(statuses: Sequence[Status]) -> bool:
    """Whether an engine has tracked frames, and none of them badly; the first frame of a map does not count."""
    return Status.OK in statuses and set(statuses) <= {Status.OK, Status.INITIALISING}


class CalibrationSink:
    """A sink that checks the calibration of a log against its first frames, and collects `problems`.

    A problem is logged as a warning as soon as it is certain, not after hours; the run continues. Frames that are
    followed well need no check: with exchanged images not one of twelve logs had a second frame that was.
    """

    def __init__(self, log: StereoLog) -> None:
        self._log = log
        self._frames: list[Frame] | None = []  # None after the decision
        self._statuses: list[Status] = []
        self.problems: list[str] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Keep the first frames, and decide by them."""
        if self._frames is None:
            return
        self._frames.append(frame)
        self._statuses.append(estimate.status)
        if len(self._frames) == _RULES.confirmed_by:
            self.close()

    def close(self) -> None:
        """Decide by the frames so far: a problem in the first one must be present in all of them together."""
        frames, self._frames = self._frames, None
        if frames and not well_followed(self._statuses) and log_problems(self._log, frames[:1]):
            self.problems = log_problems(self._log, frames)
            for problem in self.problems:
                logging.getLogger("stream_sfm").warning(problem)


def stamp_warning(offset_ms: float, period_ms: float, right: str) -> str | None:
    """Return a warning if stamps differ, by the median `offset_ms`, by more than a small part of the period."""
    if abs(offset_ms) <= max(_RULES.stamp_offset_ms, _RULES.stamp_offset_periods * period_ms):
        return None
    other_ms = offset_ms - np.sign(offset_ms) * period_ms
    return (
        f"the stamps of {right} differ from the left ones by {offset_ms:+.1f} ms (or by {other_ms:+.1f} ms, if the "
        "images belong to the neighbouring frame): if the cameras are triggered together, correct the stamps; if "
        "they are not, left and right of moving scenes do not fit"
    )


def _side_problem(rig: StereoRig, check: CalibrationCheck, swapped: CalibrationCheck, choice: PairChoice) -> str | None:
    """Report that left and right are swapped in the calibration, in the images, or in both."""
    if np.isnan(check.negative_share):
        return None
    negative_m = right_is_left(rig)
    share = f"{100 * check.negative_share:.0f} % of the matches have negative disparity"
    swap = f"{choice.right} as left and {choice.left} as right"
    # Cameras that converge have disparities of both signs in their images; there the rows decide.
    rows_better = swapped.row_error_px < _RULES.clearly_better * check.row_error_px
    rows_decide = (
        rows_better and check.row_error_px > _RULES.row_error_px and swapped.negative_share < _RULES.unswapped_share
    )
    if check.negative_share <= _RULES.swapped_share and negative_m is not None:
        return (
            f"the sign of the baseline is wrong: by the calibration the right camera stands {negative_m:.4g} m to "
            "the left of the left one, while the images show left and right as they are named; P[3] of the right "
            f"camera must be −fx·baseline, so negate it (or translation_m of right_from_left); {REMEDY}"
        )
    if negative_m is not None:
        return (
            f"left and right are swapped: by the calibration the right camera stands {negative_m:.4g} m to the left "
            f"of the left one, and {share}; name {swap}"
        )
    if check.negative_share > _RULES.swapped_share or rows_decide:
        rows = (
            f"with the images exchanged matched corners lie on one row to {swapped.row_error_px:.2f} px, but only to "
            f"{check.row_error_px:.2f} px as they are"
        )
        return (
            f"the images are swapped: {rows if rows_decide else share}, while the calibration has left and right as "
            f"they are named; name {swap} and give a calibration of that pair, or exchange the names of the image "
            "topics"
        )
    return None
