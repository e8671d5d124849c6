"""Which keyframes are examined: gated by covariance if the pose is known, chosen by words if not."""

import numpy as np

from stream_sfm.geometry import se3
from stream_sfm.places.finding import Words, apart, may_overlap, nearest_poses


def test_places_within_reach_of_the_predicted_pose_by_its_covariance() -> None:
    at = np.array([0.3, 5.0, 5.0, 0.1, 0.32, 0.9])
    motions = np.array([se3.exp([x, 0, 0, 0, 0, 0]) for x in at])
    covs = np.tile(1e-6 * np.eye(6), (6, 1, 1))
    covs[2, 0, 0] = 4.0  # so uncertain that it may be near
    assert nearest_poses(motions, np.eye(4), depth_m=1.0).tolist() == [3, 0, 4, 5, 1, 2]
    assert may_overlap(motions, covs, depth_m=1.0, sigmas=3.0).tolist() == [True, False, True, True, True, False]
    assert apart([8, 7, 10, 20, 30, 11], count=3, distance=3) == [8, 20, 30]


def _descriptors(rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """A place seen again: a tenth of the bits of its descriptors are others."""
    bits = np.unpackbits(place, axis=1) ^ (rng.random((len(place), 256)) < 0.1)
    return np.packbits(bits, axis=1)


def test_words_of_the_run_itself_find_a_place_again() -> None:
    rng = np.random.default_rng(1)
    places = rng.integers(0, 256, (60, 200, 32), np.uint8)
    words = Words()
    for number, place in enumerate(places):
        words.add(number, place)
    everything = set(range(60))
    for number in range(0, 60, 7):
        assert words.alike(_descriptors(rng, places[number]), everything)[0] == number
    assert {*words.alike(places[8], {20, 40})} == {20, 40}
    words.forget(14)
    assert 14 not in words.alike(places[14], everything)
    assert words.alike(places[21], everything)[0] == 21


def test_before_there_are_words_any_keyframe_will_do() -> None:
    words = Words()
    words.add(0, np.zeros((10, 32), np.uint8))
    assert words.alike(np.zeros((10, 32), np.uint8), {0}) == [0]
    assert words.alike(np.zeros((0, 32), np.uint8), {0}) == [0]
