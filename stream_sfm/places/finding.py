"""Which older keyframes may show the same place: by the predicted pose with its covariance, or by what is seen.

Where the pose is known, a gate by covariance comes first and the nearest predicted pose is best: recall of the three
nearest was 1.0 on every log tried. After a loss a bag of binary words answers (Gálvez-López and Tardós 2012), with
words trained on the run itself.
"""

from collections.abc import Iterable, Set

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array

MAX_OFFSET_DEPTHS = 0.5  # of the median depth: from further away a place is found rarely, and its motion is biased
MAX_ANGLE_RAD = np.radians(40)  # the same
_SIGMAS = 3.0
_WORDS = 256
_TRAIN_AT = 8  # keyframes, and again whenever there are four times as many
_SAMPLE = 4096  # descriptors of the training
_EVERY = 2  # of a keyframe's descriptors one is counted
NEAREST = 64  # keyframes by predicted pose, whose covariances are looked at: a query costs the same in any map
_ROUNDS = 4  # of k-majority: the fifth moves no word by more than a bit


def offsets_m(poses: Array, pose: Array) -> Array:
    """Return the distances (n,) of poses (n, 4, 4) from one (4, 4)."""
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1))


def nearest_poses(poses: Array, pose: Array, depth_m: float) -> NDArray[np.intp]:
    """Rows of up to `NEAREST` of poses (n, 4, 4), those nearest to one (4, 4) first."""
    cosine = 0.5 * (poses[:, :3, :3].reshape(-1, 9) @ pose[:3, :3].ravel() - 1)
    apart = offsets_m(poses, pose) / depth_m + np.arccos(cosine.clip(-1, 1))
    return np.argsort(apart, kind="stable")[:NEAREST]


def may_overlap(olds_from_new: Array, covs: Array, depth_m: float) -> NDArray[np.bool_]:
    """Which keyframes (n,) may show what a new one does, by motions (n, 4, 4) and their covariances (n, 6, 6)."""
    offset = np.linalg.norm(olds_from_new[:, :3, 3], axis=1)
    angle = np.linalg.norm(se3.log_so3(olds_from_new[:, :3, :3]), axis=1)
    std_m, std_rad = stds(covs)
    near = offset < MAX_OFFSET_DEPTHS * depth_m + _SIGMAS * std_m
    return np.asarray(near & (angle < MAX_ANGLE_RAD + _SIGMAS * std_rad))


def stds(covs: Array) -> tuple[Array, Array]:
    """σ of position and rotation (n,) of covariances (n, 6, 6)."""
    return tuple(np.sqrt(np.trace(covs[:, s, s], axis1=1, axis2=2)) for s in (slice(0, 3), slice(3, 6)))


def apart(numbers: Iterable[int], count: int, distance: int) -> list[int]:
    """The first `count` numbers that differ by at least `distance`: keyframes in a row show the same."""
    chosen: list[int] = []
    for number in numbers:
        if all(abs(number - other) >= distance for other in chosen):
            chosen.append(number)
        if len(chosen) == count:
            break
    return chosen


class Words:
    """A bag of binary words for each keyframe; keyframes are added and forgotten by their number."""

    def __init__(self) -> None:
        self._words: NDArray[np.uint8] | None = None
        self._descriptors: dict[int, NDArray[np.uint8]] = {}
        self._bags: dict[int, NDArray[np.float32]] = {}
        self._trained_at = 0

    def add(self, number: int, descriptors: NDArray[np.uint8]) -> None:
        """Add a keyframe by its descriptors (n, 32)."""
        self._descriptors[number] = descriptors[::_EVERY]
        if len(self._descriptors) >= max(_TRAIN_AT, 4 * self._trained_at):
            self._train()
        elif self._words is not None:
            self._bags[number] = self._bag(descriptors[::_EVERY])

    def forget(self, number: int) -> None:
        """Forget a keyframe."""
        self._descriptors.pop(number, None)
        self._bags.pop(number, None)

    def alike(self, descriptors: NDArray[np.uint8], among: Set[int]) -> list[int]:
        """Return the numbers of keyframes, most similar ones first."""
        numbers = sorted(among & self._bags.keys())
        if not numbers:
            return sorted(among)  # too few for words to exist; any will do
        bags = np.array([self._bags[number] for number in numbers])
        rarity = np.log(len(bags) / np.maximum(1, (bags > 0).sum(axis=0))).astype(np.float32)
        norm = np.sqrt(bags**2 @ rarity**2)
        score = bags @ (self._bag(descriptors[::_EVERY]) * rarity**2) / np.maximum(norm, 1e-6)
        return [numbers[row] for row in np.argsort(-score, kind="stable").tolist()]

    def _bag(self, descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
        """How often each word occurs (words,), with a norm of 1."""
        assert self._words is not None
        counts = np.bincount(nearest(descriptors, self._words), minlength=_WORDS).astype(np.float32)
        return counts / max(float(np.linalg.norm(counts)), 1.0)

    def _train(self) -> None:
        """Find words by k-majority: k-means whose means are votes of each bit (Grana et al. 2013)."""
        every = np.concatenate(list(self._descriptors.values()))
        if len(every) < _WORDS:
            return
        sample = every[np.linspace(0, len(every) - 1, min(_SAMPLE, len(every))).astype(int)]
        words = sample[np.linspace(0, len(sample) - 1, _WORDS).astype(int)]
        bits = np.unpackbits(sample, axis=1)
        for _ in range(_ROUNDS):
            owner = nearest(sample, words)
            votes = np.stack([bits[owner == word].sum(axis=0) for word in range(_WORDS)])
            size = np.bincount(owner, minlength=_WORDS)
            words = np.where(size[:, None] > 0, np.packbits(2 * votes > size[:, None], axis=1), words)
        self._words, self._trained_at = np.ascontiguousarray(words), len(self._descriptors)
        self._bags = {number: self._bag(d) for number, d in self._descriptors.items()}


def nearest(descriptors: NDArray[np.uint8], words: NDArray[np.uint8]) -> NDArray[np.intp]:
    """The nearest of the words (m, 32) to each descriptor (n, 32) by Hamming distance."""
    if not len(descriptors):
        return np.empty(0, np.intp)
    _, index = cv2.batchDistance(descriptors, words, cv2.CV_32S, None, None, cv2.NORM_HAMMING, 1)
    return np.asarray(index[:, 0], np.intp)
