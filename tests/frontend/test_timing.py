"""Delay and readout in the front-end: an estimator's values, and the track positions that follow."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.camera.refinement import KnownTiming
from stream_sfm.config import RigConfig
from stream_sfm.frontend.learnt.first_timing import learn_timing
from stream_sfm.frontend.learnt.timing import Timing, TurningError
from stream_sfm.frontend.state import FrontEndState
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.rectified import own_rows, scattered_points
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

P = StereoProjection(420.0, 255.0, 257.0, 190.0, 0.16, 512, 384)
TWIST = np.array([0.5, 0.1, -1.0, 0.3, 0.6, -0.2])  # per second
POINTS = scattered_points(np.random.default_rng(1), 60)
row_of = own_rows(P)


def estimated(delay_s: float, readout_s: float, std_s: float = 2e-4) -> Timing:
    prior = Timing.unknown(P, RigConfig(), row_of)
    return prior.with_estimate(np.array([delay_s, readout_s]), std_s**2 * np.eye(2))


def test_certain_values_are_used_and_values_near_zero_shrink() -> None:
    assert estimated(8e-3, 20e-3).mean == pytest.approx([8e-3, 20e-3], rel=1e-6)
    near = estimated(1e-4, -2e-4)  # half a σ and one
    assert (np.abs(near.mean) < 0.2 * np.array([1e-4, 2e-4])).all()
    shares = [estimated(mean_s, 0.0).mean[0] / mean_s for mean_s in (1e-4, 4e-4, 6e-4, 8e-4, 2e-3)]
    assert shares == sorted(shares) and shares[0] < 0.2 and shares[-1] > 0.99
    # an estimate that is no more certain than the prior is not significant
    assert np.abs(estimated(5e-3, 0.0, std_s=5e-3).mean[0]) <= 0.5 * 5e-3
    assert (np.diag(estimated(8e-3, 0.0).cov) >= 2e-4**2).all()


def test_an_exact_rig_ignores_estimates() -> None:
    exact = Timing.unknown(P, RigConfig(exact=True), row_of)
    assert exact.with_estimate(np.array([8e-3, 0.0]), 1e-8 * np.eye(2)) is exact
    assert (exact.taken_out(POINTS, TWIST) == 0).all()


def test_the_correction_is_the_motion_of_the_views() -> None:
    """The right side is seen later by the delay, and each side by its row's share of the readout.

    The effect of the delay on the right row is part of the row differences, and corrected with them.
    """
    delay_s, readout_s = 1e-4, 3e-4

    def seen(seconds: np.ndarray) -> np.ndarray:
        """Views (n, 4) at times (n, 4) after the frame's."""
        moved = se3.exp(seconds[..., None] * TWIST) @ POINTS[:, None, :, None]
        return P.project_homogeneous(moved[..., 0])[:, range(4), range(4)]

    still = P.project_homogeneous(POINTS)
    seconds = readout_s * row_of(still) + delay_s * np.array([0, 0, 1, 1])
    timing = replace(estimated(8e-3, 20e-3), mean=np.array([delay_s, readout_s]))
    expected = seen(seconds) - still
    in_row = seen(readout_s * row_of(still)) - still
    expected[:, 3] = in_row[:, 3]
    # the rest is of second order in time
    assert timing.taken_out(POINTS, TWIST) == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_a_new_estimate_shifts_the_tracks_of_a_run() -> None:
    """The same estimate again changes nothing more: no part of it is subtracted twice."""
    stereo = rig()
    front, projection = SteppedFrontEnd(stereo), SteppedFrontEnd(stereo).rectifier.projection
    *frames, later = Wall(2).frames(stereo, camera_path(5))
    for frame in frames:
        front.step(frame)
    start = front.state
    before, twist = start.tracks, start.timing.twist
    assert twist is not None and len(before) > 100

    def learnt(state: FrontEndState, seconds: list[float]) -> FrontEndState:
        return learn_timing(projection, state, np.array(seconds), 1e-8 * np.eye(2))

    once = learnt(start, [8e-3, 20e-3])
    placed = once.tracks.points
    expected = before.shifted(projection, once.timing.taken_out(before.points, twist)).points
    assert placed == pytest.approx(expected, abs=1e-12)
    assert np.abs(placed - before.points).max() > 1e-3
    assert (once.tracks.left_px == before.left_px).all()  # the measured positions

    assert (learnt(once, [8e-3, 20e-3]).tracks.points == placed).all()
    back = learnt(once, [0.0, 0.0])
    # undone, except for the change of the columns over the few mrad by which the points were moved
    assert np.abs(back.tracks.points - before.points).max() < 0.05 * np.abs(placed - before.points).max()

    front.state = once
    observed = front.step(later)
    assert np.abs(observed.rig.timing_px).max() > 0.2
    # observations keep the delay; track positions are corrected for it
    without = observed.z_px - observed.rig.timing_px
    off = (projection.project_homogeneous(front.state.tracks.points) - without)[:, :2]
    assert np.abs(off).max() < 0.05 * np.abs(observed.rig.timing_px).max()


@pytest.mark.parametrize("anew", [False, True], ids=["first frame", "after a loss"])
def test_points_begun_before_any_motion_are_placed_by_a_known_timing(anew: bool) -> None:
    """The effect of the delay on all views is not mistaken for a turn of the right camera."""
    stereo, path, delay_s = rig(), camera_path(8), 0.03
    at_stamp = Wall(2).frames(stereo, path)
    of_step = delay_s / (PERIOD_NS / 1e9)  # the path has equal steps
    between = Wall(2).frames(stereo, path @ se3.exp(of_step * se3.log(path[1])))
    frames = [replace(f, right=late.right) for f, late in zip(at_stamp, between, strict=True)]
    front = SteppedFrontEnd(stereo, known_timing=KnownTiming(delay_s, 1e-4, 0.0, 1e-4))
    if anew:
        for frame in frames[:3]:
            front.step(frame)
        front.state = front.state.lost()
    begin = 3 * anew
    front.step(frames[begin])
    assert front.state.timing.twist is None and not front.state.timing.mean[1] and len(front.state.tracks) > 100
    observed = front.step(frames[begin + 1])
    assert "relative to the left" not in observed.note
    in_both = np.isfinite(observed.z_px[: len(observed.z_px) - observed.n_new, 2])
    assert in_both.mean() > 0.9


def test_the_error_of_an_extrapolated_turn_rate_is_learnt_from_the_frames_after_it() -> None:
    """The guess lasts until the first error is known."""
    error, rng = TurningError(), np.random.default_rng(11)
    first = error.after(np.array([9.0, 9.0, 9.0, 0.01, 0.0, 0.0]))  # translations do not count
    assert first.mean_square == pytest.approx(0.01**2 / 3)
    for _ in range(200):
        error = error.after(np.r_[np.zeros(3), 0.3 * rng.normal(size=3)])
    assert np.sqrt(error.mean_square) == pytest.approx(0.3, rel=3 / np.sqrt(2 * 3 * 20))  # 20 frames are remembered
