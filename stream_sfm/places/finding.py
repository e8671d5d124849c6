"""Which older keyframes may show the same place: by the predicted pose with its covariance, or by appearance.

With a known pose, a gate by covariance comes first, and the nearest predicted poses are best: the recall of the three
nearest was 1.0 on every tested log. After a loss, a bag of binary words is used (Gálvez-López and Tardós 2012), with
words from the run itself.
"""

from collections.abc import Iterable, Set

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from .settings import SETTINGS


def offsets_m(poses: Array, pose: Array) -> Array:
    """Return the distances (n,) of poses (n, 4, 4) from one (4, 4)."""
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1))


def nearest_poses(poses: Array, pose: Array, depth_m: float) -> NDArray[np.intp]:
    """Return rows of up to `nearest` of poses (n, 4, 4), starting with the nearest to one (4, 4)."""
    cosine = 0.5 * (poses[:, :3, :3].reshape(-1, 9) @ pose[:3, :3].ravel() - 1)
    apart = offsets_m(poses, pose) / depth_m + np.arccos(cosine.clip(-1, 1))
    return np.argsort(apart, kind="stable")[: SETTINGS.nearest]


def may_overlap(olds_from_new: Array, covs: Array, depth_m: float, sigmas: float) -> NDArray[np.bool_]:
    """Return which keyframes (n,) may overlap a new one, by motions (n, 4, 4) and their covariances (n, 6, 6).

    `sigmas`: the number of σ by which they may be nearer than predicted.
    """
    offset = np.linalg.norm(olds_from_new[:, :3, 3], axis=1)
    angle = np.linalg.norm(se3.log_so3(olds_from_new[:, :3, :3]), axis=1)
    std_m, std_rad = stds(covs)
    near = offset < SETTINGS.max_offset_depths * depth_m + sigmas * std_m
    return np.asarray(near & (angle < SETTINGS.max_angle_rad + sigmas * std_rad))


def stds(covs: Array) -> tuple[Array, Array]:
    """Return σ of position and rotation (n,) from covariances (n, 6, 6)."""
    return tuple(np.sqrt(np.trace(covs[:, s, s], axis1=1, axis2=2)) for s in (slice(0, 3), slice(3, 6)))


def apart(numbers: Iterable[int], count: int, distance: int) -> list[int]:
    """Return the first `count` numbers that differ by at least `distance`: consecutive keyframes show the same."""
    chosen: list[int] = []
    for number in numbers:
        if all(abs(number - other) >= distance for other in chosen):
            chosen.append(number)
        if len(chosen) == count:
            break
    return chosen


class Words:
    """A bag of binary words for each keyframe; keyframes are added and forgotten by their number.

    Words are descriptors sampled from all keyframes so far, and chosen again whenever there are four times as many.
    """

    def __init__(self) -> None:
        self._words: NDArray[np.uint8] | None = None
        self._descriptors: dict[int, NDArray[np.uint8]] = {}
        self._bags: dict[int, NDArray[np.float32]] = {}
        self._chosen_at = 0

    def add(self, number: int, descriptors: NDArray[np.uint8]) -> None:
        """Add a keyframe by its descriptors (n, 32)."""
        self._descriptors[number] = descriptors
        if len(self._descriptors) >= 4 * self._chosen_at:
            self._choose_words()
        elif self._words is not None:
            self._bags[number] = self._bag(descriptors)

    def forget(self, number: int) -> None:
        self._descriptors.pop(number, None)
        self._bags.pop(number, None)

    def alike(self, descriptors: NDArray[np.uint8], among: Set[int]) -> list[int]:
        """Return the numbers of keyframes, most similar ones first."""
        numbers = sorted(among & self._bags.keys())
        if not numbers:
            return sorted(among)  # too few for words; any will do
        bags = np.array([self._bags[number] for number in numbers])
        rarity = np.log(len(bags) / np.maximum(1, (bags > 0).sum(axis=0))).astype(np.float32)
        norm = np.sqrt(bags**2 @ rarity**2)
        score = bags @ (self._bag(descriptors) * rarity**2) / np.maximum(norm, 1e-6)
        return [numbers[row] for row in np.argsort(-score, kind="stable").tolist()]

    def _bag(self, descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return how often each word occurs (words,), with a norm of 1."""
        assert self._words is not None
        counts = np.zeros(SETTINGS.words, np.float32)
        if len(descriptors):
            _, nearest = cv2.batchDistance(descriptors, self._words, cv2.CV_32S, None, None, cv2.NORM_HAMMING, 1)
            counts = np.bincount(nearest[:, 0], minlength=SETTINGS.words).astype(np.float32)
        return counts / max(float(np.linalg.norm(counts)), 1.0)

    def _choose_words(self) -> None:
        every = np.concatenate(list(self._descriptors.values()))
        if len(every) < SETTINGS.words:
            return
        self._words = every[np.linspace(0, len(every) - 1, SETTINGS.words).astype(int)]
        self._chosen_at = len(self._descriptors)
        self._bags = {number: self._bag(d) for number, d in self._descriptors.items()}
