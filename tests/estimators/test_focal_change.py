"""The evidence for a changing focal length: no change is invented, and jumps, drifts and their ends are found."""

import numpy as np
import pytest

from stream_sfm.config import RigConfig
from stream_sfm.estimators.window.unknowns.focal_change import Calm, Change
from stream_sfm.estimators.window.unknowns.focus_watch import FocusWatch
from stream_sfm.geometry.sizes import Sizes, Weighed

STD = 0.01  # of what a frame shows, in units of `rig.std_refocused`: 0.02 % of the focal length


def frame_of(shown: np.ndarray, var: np.ndarray) -> Weighed:
    """A frame that has no other unknown and shows N(shown, var)."""
    return Weighed(np.zeros((len(shown), 0), np.intp), np.zeros(len(shown)), 1 / var, shown / var)


def followed(amounts: np.ndarray, claimed: float = STD, seed: int = 0) -> list[FocusWatch]:
    """The watch after each frame, which shows these amounts with noise of σ = `STD`, and claims another."""
    watch, found = FocusWatch.begun(RigConfig()), []
    for shown in amounts + STD * np.random.default_rng(seed).normal(size=len(amounts)):
        watch, _ = watch.after(frame_of(np.array([shown]), np.array([claimed**2])), [])
        found.append(watch)
    return found


def begun_in(watches: list[FocusWatch]) -> int | None:
    return next((k for k, watch in enumerate(watches) if watch.evidence.is_there), None)


@pytest.mark.parametrize("mean", [0.0, 0.04])
@pytest.mark.parametrize(("claimed", "most"), [(STD, 0), (STD / 1.3, 3)])
def test_what_calm_frames_show_is_no_change(mean: float, claimed: float, most: int) -> None:
    """Errors of a calibration look like a constant one. Where σ is 1.3 times too small, some runs invent a change."""
    invented = [begun_in(followed(np.full(100, mean), claimed, seed)) is not None for seed in range(20)]
    assert sum(invented) <= most


def test_the_mean_and_the_scatter_of_calm_frames_are_learnt() -> None:
    calm = followed(np.full(200, 0.03), STD / 2, seed=1)[-1].calm
    assert calm is not None
    assert calm.mean == pytest.approx(0.03, abs=4 * STD / np.sqrt(40))
    assert calm.spread == pytest.approx(4.0, abs=3 * 4 * np.sqrt(2 / 40))  # of 40 frames


def test_a_jump_is_found_in_its_frame_and_a_drift_soon() -> None:
    """A jump by 0.25 %, and a drift by 0.02 % per frame of which the points follow nothing."""
    assert begun_in(followed(np.where(np.arange(30) < 12, 0.0, 0.125))) == 12
    drift = begun_in(followed(0.01 * np.maximum(np.arange(40) - 11, 0)))
    assert drift is not None and 12 < drift < 22


def test_a_change_that_ends_where_it_began_is_taken_back() -> None:
    watches = followed(np.r_[np.zeros(12), 0.3 * np.ones(10), np.zeros(60)])
    assert begun_in(watches) == 12 and all(watch.evidence.is_there for watch in watches[12:22])
    assert not watches[-1].evidence.is_there


def test_what_may_be_a_change_is_not_learnt_as_usual() -> None:
    watches = followed(np.r_[np.zeros(12), 0.3 * np.ones(10)])
    assert watches[-1].calm is not None and abs(watches[-1].calm.mean) < 0.01


def test_the_likelihoods_are_densities() -> None:
    """A change is a mixture over sizes of its steps; integrated numerically over the amount, both densities are 1."""
    at, calm, change = np.linspace(-2, 2, 8001), Calm(10.0, 2.0, 1e4, 100.0), Change(0.2, 1e-3)
    var = np.full(len(at), STD**2)
    for log in (calm.log_of(at, var), np.logaddexp.reduce(change.log_of(at, var), axis=-1)):
        assert np.exp(log).sum() * (at[1] - at[0]) == pytest.approx(np.sqrt(2 * np.pi), rel=1e-4)


def test_what_another_unknown_explains_is_no_evidence_for_a_change() -> None:
    """Two sizes of another unknown: with the usual one a frame shows a jump, with the larger one hardly anything.

    The larger one explains the frame better by 20 nats.
    """
    watch = followed(np.zeros(12))[-1]
    rows, shown, var = np.array([[0], [2]]), np.array([0.3, 0.05]), np.array([STD**2, 0.1**2])
    squares = 0.5 * (shown**2 / var + np.log(var))  # of the best change in each case
    for gain, jumps in ((20.0, False), (-20.0, True)):
        frame = Weighed(rows, np.array([0.0, gain]) - squares, 1 / var, shown / var)
        after, likely = watch.after(frame, [Sizes()])
        assert after.moves == jumps
        assert (frame.sizes([Sizes()], likely)[0].probable > 1) == (not jumps)


def test_a_kalman_filter_per_step_size_is_that_of_one_if_all_steps_are_one() -> None:
    change = Change(0.1, 0.02**2, np.array([0.0, 1.0, 0.0]) + 1e-300).after(0.3, STD**2)
    prior = 0.02**2 + 0.05**2
    gain = prior / (prior + STD**2)
    assert change.at == pytest.approx(0.1 + gain * 0.2)
    assert change.var == pytest.approx((1 - gain) * prior)
