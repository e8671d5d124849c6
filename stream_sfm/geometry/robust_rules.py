"""The rules for outliers and lost frames."""

from typing import Annotated

from ..config.section import Section, expert, number


class RobustRules(Section, frozen=True, kw_only=True):
    """Outliers and lost frames, for every estimator."""

    gate_probability: Annotated[float, expert("share of good views the χ² gate keeps", 0.5, 0.999999999999)] = 0.999
    # The search costs a few ms. Calm frames of the sample logs accept more than 0.85. (If all squared residuals are
    # twice too large, 0.94 are accepted; if they are four times too large, 0.67.)
    calm_share: Annotated[float, expert("share of the votes below which all motions are searched", 0, 1)] = 0.8
    # The squared residuals of a shaken drone are up to 3.3 times the expected size, and searches that found nothing
    # took 12 of the 30 ms of a frame.
    calm_spread: Annotated[float, expert("squared residuals that need no search, times the expected", 1, 1e6)] = 4.0
    # People who pass in a room reach 0.05 on the sample logs, and 0.09 before any track has a history.
    ambiguous_share: Annotated[float, expert("odds at which a second motion may be the camera's", 1e-6, 1e6)] = 0.1
    # Such views clearly do not belong to the first motion.
    beyond_gates: Annotated[float, expert("least squared residual for a second motion, gates", 1, 1000)] = 2.0
    # Two determine a motion; six more do not agree with it by chance.
    second_views: Annotated[int, expert("least number of views of a second motion", 3, 1_000_000)] = 8
    # 6 are expected. Frames that follow a moving body have 13 to 140; so do some with a wrong calibration, but
    # these reject no views.
    halves_apart: Annotated[float, expert("squared distance at which halves disagree, σ²", 0, 1e8)] = 12.0
    # All views of a half share some errors, above all those of the calibration.
    shared_noise: Annotated[float, expert("share of the variance that views of a half share", 0, 1)] = 0.01
    # Moving bodies have 0.05 to 0.3, halves of the last frames of a drone 1.
    max_odds: Annotated[float, expert("evidence that a motion may leave out, share of its own", 0, 1e6)] = 0.5
    # It is a little wider while the motion still changes fast, so that fewer good views are lost.
    first_half_weight: Annotated[
        float, expert("squared residual of half weight in the first steps, times the expected", 0.1, 1e6)
    ] = 6.0
    wide_steps: Annotated[int, expert("robust steps that use first_half_weight", 1, 100)] = 3
    robust_steps: Annotated[int, expert("steps with robust weights, at most", 1, 100)] = 9
    final_steps: Annotated[int, expert("steps of the final least squares, at most", 1, 100)] = 4
    # In between, the pose moves too little to change the Jacobian much.
    relinearised: Annotated[int, expert("relinearise after this many steps", 1, 100)] = 3
    # This is half a standard deviation; the final least squares does the rest.
    robust_converged: Annotated[float, expert("end the robust steps below this squared step, σ²", 1e-12, 1e6)] = 0.3
    # This is a tenth of a standard deviation.
    final_converged: Annotated[float, expert("end the final steps below this squared step, σ²", 1e-12, 1e6)] = 1e-2
    # With residuals this close to their expected size, one step may be enough.
    settled_spread: Annotated[float, expert("squared residuals that need few steps, times expected", 1, 1e6)] = 2.0
    # Views beyond that belong to something else and say nothing about the noise.
    spread_gates: Annotated[float, expert("learn the noise from views within this many gates", 1, 1e6)] = 10.0
    # Closed form: with 60 % outliers none is clean by (1 - 0.4³)²⁵⁶ < 1e-7, with one side by (1 - 0.4⁴)²⁵⁶ = 0.0013.
    samples: Annotated[int, expert("random samples of a search for a motion, at most", 1, 10_000)] = 256
    # Noise makes some of them useless.
    clean_samples: Annotated[int, expert("expected number of samples without outliers", 1, 10_000)] = 20
    # From a rough start, a fifth step does not change the ranking.
    sample_steps: Annotated[int, expert("Gauss-Newton steps from a sample", 1, 100)] = 4
    # Few noisy views fix a motion only roughly, so the order of the samples is rough.
    refined: Annotated[int, expert("number of best samples that are refined with all views", 1, 1000)] = 12
    # The first gate takes in the neighbourhood of a rough motion, the second its own views.
    first_refining_gates: Annotated[float, expert("first round: gates of views that refine a sample", 1, 1e6)] = 16.0
    refining_gates: Annotated[float, expert("second round: gates of views that refine a sample", 1, 1e6)] = 4.0
    refining_steps: Annotated[int, expert("Gauss-Newton steps of each round that refines a sample", 1, 100)] = 2
    # The extent decides if history does not, by a factor of 0.56 at least, as a background may show through a gap.
    extent_power: Annotated[float, expert("power of the extent of the views in a motion's support", 0, 10)] = 0.25
    min_extent: Annotated[float, expert("least extent of the views of a motion, share of the image", 1e-6, 1)] = 0.1
    # A hundred tracks distinguish about as many places.
    places: Annotated[int, expert("cells per side of the image, each counted once as evidence", 1, 100)] = 8
    min_inliers: Annotated[int, number("a frame with fewer accepted views is lost", 4, 2000)] = 8
    # In a narrow view 20 of 20 are as good as 100 of 100, but 10 of 10 are few.
    degraded_inliers: Annotated[int, number("accepted views of which any share is enough", 4, 2000)] = 25
    # After both images were displaced by 30 px, 23 of 148 agreed with a wrong motion; 14 of 34 and 19 of 54 were right.
    chance_share: Annotated[float, expert("share of the views sought that fewer views must exceed", 0, 1)] = 0.25
    # Below it, the tracks that agree may not be the background.
    degraded_share: Annotated[float, expert("a frame whose motion has less of the votes is degraded", 0, 1)] = 0.5
