"""The sections of the settings: one frozen struct per part, units in the names.

The defaults are one configuration for all logs.
"""

import re
from typing import Annotated

from msgspec import Meta

from ..errors import ConfigError
from .section import Section, expert, number

_FRAME_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/]{0,99}")
_FRAMES = {"world_frame": "map", "odom_frame": "odom", "base_frame": "base_link", "camera_frame": "left_camera"}


class FrontendConfig(Section, frozen=True, kw_only=True):
    """Detection, left-right matching, tracking."""

    # Chosen by hand: cost grows with the number; 240 instead of 200 gains little accuracy on our logs.
    max_tracks: Annotated[int, number("most points tracked at the same time", 20, 2000)] = 200
    # Chosen by hand: with less, corners are sought in more frames; with more, parts of the view are left without
    # points.
    renew_fraction: Annotated[float, expert("start new tracks once this share of max_tracks is missing", 0, 1)] = (
        0.05
    )
    # Chosen by hand: patches overlap by half at most, so that their errors differ.
    min_corner_distance_px: Annotated[float, expert("least distance of a new corner from any point", 2, 200)] = 12.0
    # Chosen by hand: a lower limit admits points in weak texture, whose covariance is large. Dark images get a
    # lower one.
    min_corner_response: Annotated[float, expert("least eigenvalue of corner gradients, as OpenCV", 1e-8, 1)] = 2e-4
    # Measured, with templates anchored in a point's first frame: aligned ATE of a rendered log, by full batch
    # adjustment, 35 mm -> 2.3 mm.
    smoothing_px: Annotated[float, expert("σ of the Gaussian that smooths images first, pixels", 0, 5)] = 1.0
    # Chosen by hand: a larger patch has less noise, but more often crosses a depth edge. Similar radii work as
    # well.
    window_radius_px: Annotated[int, expert("half width of the tracked patch, pixels", 3, 30)] = 10
    # Measured: starts are predicted, so more levels change no figure of the logs with ground truth.
    pyramid_levels: Annotated[int, expert("level at which flow starts; it ends at level 1", 1, 8)] = 2
    # Measured: with frames far apart, starts predicted from uncertain depths are wrong by that much. On a drive
    # with every fourth frame, 1.5 px lost a third of the tracks (t_rel 1.8 % instead of 1.6); calm logs do not
    # change.
    max_realignment_px: Annotated[float, expert("largest step of the alignment from its start", 0.1, 50)] = 4.0
    # Twice the error of 0.8 px in the corners of the worst calibration met; the limit narrows as rows are learnt.
    max_vertical_disparity_px: Annotated[float, expert("largest row difference of left and right", 0.1, 50)] = 1.5
    # Chosen by hand, many times the noise of a sensor: it rejects patches that show something else.
    max_photometric_error: Annotated[float, expert("largest deviation of a patch, grey values", 1, 255)] = 20.0
    # Chosen by hand: the nearest depth is f·B over this share of the width; a wider search is slower and errs more
    # often.
    max_disparity_fraction: Annotated[float, number("largest disparity, share of the image's width", 0.01, 1)] = (
        0.25
    )


class WindowConfig(Section, frozen=True, kw_only=True):
    """The cross-frame estimator."""

    frames: Annotated[int, number("frames in the window (batch size b in the paper)", 1, 64)] = 8
    max_iterations: Annotated[int, expert("Gauss-Newton steps per frame, at most", 1, 50)] = 6
    # Measured on simulated and real views: after a step, less than a ten-thousandth of its predicted decrease is
    # left. With this limit at most one standard deviation is left, over all variables together; the next frame
    # continues from there. A tenth of it changes the figures of eight logs in the third digit, and takes 8 % more
    # time.
    converged: Annotated[float, expert("stop below this expected decrease of the squares, σ²", 1e-6, 1e12)] = 1e4
    # It is at most 0.017 px on rendered images, and larger within four frames on real ones. Without a field the rig
    # has 20 errors instead of a hundred.
    least_field_px: Annotated[
        float, expert("σ of the disparity error field beyond which it is estimated, px", 0, 100)
    ] = 0.02
    # A point that never agreed carries little weight beside one that did.
    no_history: Annotated[float, expert("weight of a point that never agreed with the map, frames", 1e-6, 100)] = (
        0.1
    )
    # With a gate of 99.9 %, six rejections of a good track are unlikely; with more, slow movers are used for
    # longer.
    rejections: Annotated[int, expert("rejections after which a track is no longer used", 1, 1000)] = 6
    # The gate is twice as wide.
    moved_sigmas: Annotated[float, expert("shift of views by the rig that resets the rejections, σ", 0.01, 1e6)] = (
        2.0
    )
    # Several times the noise of a predicted position. A view that has moved by less shows the rig errors of the
    # same place in the image as before.
    rests_px: Annotated[float, expert("motion per frame below which a view rests, px", 0, 100)] = 0.3
    # Lasting errors are a property of cameras and scene, and change slowly.
    halves_memory: Annotated[float, expert("frames from which the duration of errors is learnt", 1, 1e6)] = 25.0
    # Neighbouring windows have most of their views in common.
    halves_every: Annotated[int, expert("examine every n-th frame after that", 1, 10_000)] = 4
    halves_guess: Annotated[float, expert("weight of the first guess (errors do not last), frames", 0, 1e6)] = 2.5
    halves_least: Annotated[float, expert("smallest share of the tracks that counts as a half", 0, 0.5)] = 0.125
    # A body that moves in one half is not a lasting error. Gaussian errors exceed this in one frame of 10¹⁰.
    halves_most: Annotated[float, expert("cap on one frame, multiple of the mean so far", 1, 1e8)] = 10.0
    # On 20 rendered logs and four simulations, σ of motions over one frame needs a factor of 0.6 to 1.1 with all of
    # it, and of 0.7 to 1.4 without. The largest is in a corridor, which then has 24 frames beyond 5 σ instead of 9.
    feigned_turns: Annotated[
        float, expert("share of the variance of rotations by sliding patches, added to the window's motions", 0, 1)
    ] = 0.25
    # While rig errors are being estimated, the corrections of the path are not noise. With a late right camera, ATE
    # is a third larger than that of the filter with 1.0, and a tenth with 0.5. Over one frame, 0.3 to 1.0 are
    # equally accurate.
    most_followed: Annotated[float, expert("largest lag of the reported pose behind the filter, σ", 0, 10)] = 0.5
    # The tracks of some hundred frames: how much tracks differ is also a property of cameras and scene.
    tracks_memory: Annotated[float, expert("tracks from which the spread of noise is learnt", 1, 1e9)] = 20_000.0
    tracks_guess: Annotated[float, expert("weight of the first guess (all alike), tracks", 1, 1e9)] = 300.0
    # Residuals of moving objects are not noise.
    tracks_most: Annotated[float, expert("cap on one track, multiple of the mean so far", 1, 1e8)] = 4.0


class RobustConfig(Section, frozen=True, kw_only=True):
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
    halves_apart: Annotated[float, expert("squared distance at which halves of the views disagree, σ²", 0, 1e8)] = (
        12.0
    )
    # All views of a half share some errors, above all those of the calibration.
    shared_noise: Annotated[float, expert("share of the variance that views of a half share", 0, 1)] = 0.01
    # Moving bodies have 0.05 to 0.3, halves of the last frames of a drone 1.
    max_odds: Annotated[float, expert("evidence that one rigid motion may leave out, share of its own", 0, 1e6)] = (
        0.5
    )
    # It is a little wider while the motion still changes fast, so that fewer good views are lost.
    first_half_weight: Annotated[
        float, expert("squared residual of half weight in the first steps, times the expected", 0.1, 1e6)
    ] = 6.0
    wide_steps: Annotated[int, expert("steps with that weight", 1, 100)] = 3
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
    clean_samples: Annotated[
        int, expert("expected samples without outliers once it is known how many views agree", 1, 10_000)
    ] = 20
    # From a rough start, a fifth step does not change the ranking.
    sample_steps: Annotated[int, expert("Gauss-Newton steps from a sample", 1, 100)] = 4
    # Few noisy views fix a motion only roughly, so the order of the samples is rough.
    refined: Annotated[int, expert("number of best samples that are refined with all views", 1, 1000)] = 12
    # The first gate takes in the neighbourhood of a rough motion, the second its own views.
    first_refining_gates: Annotated[float, expert("gates of the views that first refine a sample", 1, 1e6)] = 16.0
    refining_gates: Annotated[float, expert("gates of the views that then refine it", 1, 1e6)] = 4.0
    refining_steps: Annotated[int, expert("Gauss-Newton steps with each of the two", 1, 100)] = 2
    # The extent decides if history does not, by a factor of 0.56 at least, as a background may show through a gap.
    extent_power: Annotated[float, expert("power of the extent of the views in a motion's support", 0, 10)] = 0.25
    min_extent: Annotated[float, expert("least extent, share of the image", 1e-6, 1)] = 0.1
    # A hundred tracks distinguish about as many places.
    places: Annotated[int, expert("cells per side of the image, each counted once as evidence", 1, 100)] = 8
    min_inliers: Annotated[int, number("a frame with fewer accepted views is lost", 4, 2000)] = 8
    degraded_inliers: Annotated[int, number("a frame with fewer accepted views is degraded", 4, 2000)] = 25
    # Below it, the tracks that agree may not be the background.
    degraded_share: Annotated[float, expert("a frame whose motion has less of the votes is degraded", 0, 1)] = 0.5
    # If errors are three times their σ, covariances mean little.
    degraded_spread: Annotated[float, expert("squared residuals of a degraded frame, times expected", 1, 1e8)] = 9.0


class MotionConfig(Section, frozen=True, kw_only=True):
    """The camera's motion while tracking is lost."""

    # As when a person starts to walk.
    build_up_s: Annotated[float, expert("time over which σ of an unknown velocity builds up, s", 0, 1000)] = 1.0
    # The velocity differs from the last known one by what the acceleration builds up in this time, and not by more
    # later. A camera that was moved elsewhere is as uncertain as after this time without images: for a car 30 m,
    # two σ.
    speeds_up_s: Annotated[float, expert("longest time for which a vehicle accelerates, s", 1e-3, 1000)] = 3.0

    std_acceleration_m_s2: Annotated[float, number("σ of acceleration during tracking loss, m/s²", 1e-3, 1e4)] = 3.0
    std_angular_acceleration_rad_s2: Annotated[float, number("σ of angular acceleration, rad/s²", 1e-3, 1e4)] = 3.0

    @property
    def std_acceleration(self) -> tuple[float, ...]:
        """σ (6,) of the acceleration about each axis, m/s², and of the angular one, rad/s²."""
        return 3 * (self.std_acceleration_m_s2,) + 3 * (self.std_angular_acceleration_rad_s2,)


class RigConfig(Section, frozen=True, kw_only=True):
    """Calibration errors, and their prior."""

    # This is for rendered or simulated images, and for comparison with an estimate that does not refine the
    # calibration.
    exact: Annotated[bool, Meta(description="take the calibration as exact")] = False
    # Five real rigs have errors of 0.05 to 1.1 px per term.
    std_disparity_px: Annotated[float, expert("σ of each term of the disparity error at the edge", 1e-3, 10)] = 0.4
    # Of five real rigs, one has errors of 6 to 15 px in the corner, where no point is; the others have up to 5.
    std_lens_px: Annotated[float, expert("σ of each error that both lenses share, in the corner", 1e-3, 50)] = 5.0
    # In three of five real rigs the lenses differ by 0.4 to 1.2 px.
    std_lens_difference_px: Annotated[float, expert("σ of radial lens differences in the corner", 1e-3, 50)] = 0.5
    # Kalibr and OpenCV achieve a tenth of that on good recordings; autofocus, heat and a wrong resolution cause
    # more.
    std_focal: Annotated[float, number("σ of the relative error of the focal length", 1e-6, 0.1)] = 0.003
    # Software triggers are a few milliseconds apart.
    std_delay_s: Annotated[float, number("σ of the right camera's delay, seconds", 1e-6, 0.1)] = 0.005
    # Rolling shutters of cheap cameras read out in 10 to 30 ms.
    std_readout_s: Annotated[float, number("σ of the readout time of the shutters, seconds", 1e-6, 0.1)] = 0.02
    # It is added to the σ of delay and readout, because the front-end extrapolates velocities.
    timing_step: Annotated[float, expert("step of delay and readout per frame, share of their σ", 0, 1)] = 0.01
    # Real rigs deform, and an estimate comes from earlier frames.
    disparity_step_px: Annotated[float, expert("step of each disparity error term per frame, px", 0, 10)] = 0.1
    # This allows for a mount that warms up or gives way.
    std_turning_rad_s: Annotated[float, expert("σ of the turn rate of the right camera, rad/s", 1e-8, 0.1)] = 5e-4
    # An autofocus moves by a percent or two in a second.
    std_focusing_per_s: Annotated[float, expert("σ of relative focal length change per second", 1e-8, 0.1)] = 0.005
    # This is a principal point error of one pixel at usual focal lengths.
    std_axes_rad: Annotated[float, expert("σ of the camera's orientation, about x and y, rad", 0, 0.5)] = 0.0015
    # No calibration is worse: real rigs have 4 to 16; the largest belongs to one with a radial error of 12 px in
    # the corner.
    impossible: Annotated[float, expert("norm of all errors, in units of σ, that is impossible", 1, 1e8)] = 20.0
    # Neighbouring windows share most of their views. On sound logs, rendered and real, roots of the averages are
    # 0.5 to 1.3 (KITTI 06 has 3.2 in one term); with a moving focus they are 2 to 7.
    innovations: Annotated[int, expert("frames over which innovations are averaged", 1, 10_000)] = 40
    calm_frames: Annotated[int, expert("calm frames with which this average starts", 0, 10_000)] = 10
    # An autofocus moves by a percent or two.
    std_refocused: Annotated[
        float, expert("σ of the relative change of a focal length that changes between frames", 1e-6, 0.5)
    ] = 0.02
    # A lens scales about a point some ten pixels from the principal point, which is 0.02 focal lengths.
    refocused_axes_rad: Annotated[
        float,
        expert("σ of the turn of the axes, about x and y, as the focal length doubles, rad", 0, 1),
    ] = 0.02
    # It is at most 4 on sound logs, rendered and real; a jump by 0.25 % on good images says 70 at once.
    refocused: Annotated[float, expert("evidence that a focal length changes, or no longer, nats", 0.1, 1e8)] = 11.0
    rested_frames: Annotated[int, expert("frames after which an unchanged focal length is settled", 3, 10_000)] = 8
    # A larger change is a moving body, not a zoom.
    most_refocused: Annotated[float, expert("largest change between frames, σ of std_refocused", 0.1, 1e8)] = 3.0
    rests: Annotated[float, expert("largest slope and scatter of a settled focal length, σ", 0.1, 1e8)] = 3.0
    # A few frames do not show all errors of a twist.
    least_twist: Annotated[float, expert("least σ of a twist, share of a frame's acceleration", 1e-3, 100)] = 0.1
    probable_delay: Annotated[float, expert("a delay is probable beyond this multiple of its σ", 0, 1e8)] = 2.0
    # A carried camera that turns by 0.8 rad/s has 1.4 px while its readout is unknown, one that stands 0.003.
    readout_moves_px: Annotated[
        float, expert("motion by a readout that may be there, beyond which its velocity counts, px", 0, 1e8)
    ] = 0.5
    # With 0.2 the focus of an exact camera that looks down on a lawn seems to move, and the run fails: a rendered
    # mower ends up to 15 m off instead of 0.03, with every frame or every other. KITTI would be 3 to 12 % better.
    odds: Annotated[float, expert("prior odds of a cause of errors, or of an inertial error", 1e-12, 1e6)] = 0.05
    share_alone: Annotated[float, expert("share of wrong calibrations with one wrong term only", 0, 1)] = 0.05
    # Lasting errors, and errors that neighbours share, make σ too small by 1.4 (simulated) and 1.5 to 4.5 times
    # (real).
    counts: Annotated[float, expert("share of information about errors that counts for the odds", 1e-6, 1)] = 0.25
    # All views show lenses. With 1 the exact lenses of a render along a street had errors of 7 σ; with 0.25 KITTI's
    # errors are found only after 25 frames, with 0.5 as early as with 1.
    counts_of_lenses: Annotated[float, expert("this share for errors of lenses", 1e-6, 1)] = 0.5
    # The paths of five real logs with independent truth are 0.1 to 1 % too long or too short, RMS 0.6 %.
    std_baseline: Annotated[float, number("σ of the relative error of the baseline", 0, 0.5)] = 0.006


class ImuConfig(Section, frozen=True, kw_only=True):
    """Inertial samples from the log or the program."""

    enabled: Annotated[bool, Meta(description="use inertial samples if there are any")] = True
    # Kalibr achieves a tenth of that; drawings and tf of robots are within half a degree.
    std_axes_rad: Annotated[float, expert("σ of the unit's rotation to the camera, each axis, rad", 1e-6, 0.5)] = (
        0.01
    )
    # Triggered cameras have stamps within a millisecond; others are stamped on arrival.
    std_time_offset_s: Annotated[float, expert("σ of the clock offset of unit and camera, s", 1e-6, 0.1)] = 0.005
    # With a larger σ, for most uses a new map would no longer be at the place of the old one.
    max_std_m: Annotated[float, expert("largest σ of a position from samples alone, m; else lost", 0, 100)] = 0.15


class RosConfig(Section, frozen=True, kw_only=True):
    """Frames and axes in `estimates.mcap`, as ROS names them; they affect nothing else."""

    world_frame: Annotated[str, Meta(description="the fixed frame in which the path may jump; map in REP 105")] = (
        "map"
    )
    odom_frame: Annotated[str, Meta(description="the fixed frame in which the path never jumps")] = "odom"
    base_frame: Annotated[
        str,
        Meta(description="the frame of the robot whose poses are reported, such as base_link; empty: the camera"),
    ] = ""
    camera_frame: Annotated[str, Meta(description="the left camera: x right, y down, z forward")] = "left_camera"
    z_up: Annotated[
        bool,
        Meta(description="z up in fixed frames (REP 103), as with a base_frame; else the axes of the first camera"),
    ] = False
    gravity: Annotated[
        bool, expert("use inertial samples to turn z of the world upwards; a replay adds trajectory_gravity.tum")
    ] = False
    camera_x_m: Annotated[float, number("position of the camera in base_frame: forward, metres", -1e3, 1e3)] = 0.0
    camera_y_m: Annotated[float, number("to the left, metres", -1e3, 1e3)] = 0.0
    camera_z_m: Annotated[float, number("upwards, metres", -1e3, 1e3)] = 0.0
    camera_roll_deg: Annotated[
        float, number("roll about x, applied first; 0 if the camera is upright; degrees", -360, 360)
    ] = 0.0
    camera_pitch_deg: Annotated[
        float, number("pitch about y, applied second; positive if the camera looks down; degrees", -360, 360)
    ] = 0.0
    camera_yaw_deg: Annotated[
        float, number("yaw about z, applied last; 0 if the camera looks along x; degrees", -360, 360)
    ] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        names = {name: getattr(self, name) for name in _FRAMES}
        for setting, name in names.items():
            if not _FRAME_NAME.fullmatch(name) and (name or setting != "base_frame"):
                raise ConfigError(
                    f"ros.{setting} is {name!r}; give a name of letters, digits, _ and /, as in {_FRAMES[setting]}"
                )
        if len(set(names.values())) < len(names):
            raise ConfigError(
                f"the frames of ROS need different names, not {', '.join(filter(None, names.values()))}: change one "
                "of them (the odom frame is separate from world_frame, which ROS calls map)"
            )


class DenseConfig(Section, frozen=True, kw_only=True):
    """Dense stereo and surfaces (`stream-sfm surface`)."""

    # Chosen by hand: twice the range of the points, for surfaces close to the camera. Each frame narrows it.
    max_disparity_fraction: Annotated[float, expert("largest disparity, share of the image's width", 0.01, 0.9)] = (
        0.5
    )
    # OpenCV recommends 3 to 11 for semi-global matching; larger blocks are smoother and lose thin objects.
    block_px: Annotated[int, expert("edge of the matched block, pixels, odd", 3, 21)] = 7
    # OpenCV recommends 5 to 15. The lowest is enough, because the left-right check and σ also reject mismatches.
    uniqueness_percent: Annotated[int, expert("margin of a match over the second best, percent", 0, 50)] = 5
    # As for the points (`frontend.smoothing_px`): interpolation between pixels is biased in sharper images.
    smoothing_px: Annotated[float, expert("σ of the Gaussian before the sub-pixel step, pixels", 0, 5)] = 1.0
    # Chosen by hand: a larger window averages more noise, but rounds off the edges of objects.
    window_radius_px: Annotated[int, expert("half width of the window of the sub-pixel step, pixels", 2, 30)] = 6
    # Enough for the range of disparities, at a fraction of the cost.
    search_width_px: Annotated[int, expert("approximate width of the range-search image, px", 32, 10_000)] = 320
    # This is the rounding, which smoothing hides.
    least_noise_grey: Annotated[float, expert("least σ of a grey value", 1e-3, 255)] = 1.0
    # A pixel beside a depth edge must have texture of its own.
    own_px: Annotated[int, expert("edge of the window in which a pixel must have texture, pixels", 1, 31)] = 5
    # A uniform error of half a pixel has a σ of 0.29.
    std_start_px: Annotated[float, expert("σ of the disparity before the sub-pixel step", 1e-3, 1000)] = 0.3
    # It covers lens model and interpolation. With it, σ matches the errors of rendered frames
    # (tools/surface_accuracy.py).
    std_bias_px: Annotated[float, expert("σ of the disparity error that all frames share, pixels", 0, 10)] = 0.06
    # Chosen by hand: a less certain disparity may be a mismatch.
    max_std_px: Annotated[float, expert("leave out pixels with a larger σ of disparity", 1e-3, 100)] = 1.0
    # Chosen by hand: beyond it, depth is too uncertain to show a shape.
    max_relative_std: Annotated[float, expert("leave out pixels with a larger relative σ of depth", 1e-4, 1)] = 0.05
    # The limit of fusion in human stereo vision (Burt and Julesz 1980); a steeper step is the edge of an object.
    max_disparity_step_px: Annotated[float, expert("largest step between connected pixels", 0.01, 1000)] = 1.0
    voxel_m: Annotated[float, number("voxel size of a fused surface, metres; 0: automatic", 0, 100)] = 0.0
    # About 160 MB; beyond it the edge is doubled, which leaves about a quarter of the voxels of a surface.
    max_voxels: Annotated[int, expert("most voxels; beyond it they are enlarged", 10_000, 100_000_000)] = 4_000_000
    # The truncation distance of a fused surface.
    reach_voxels: Annotated[int, expert("voxels on either side of a surface that keep its distance", 1, 16)] = 2
    # Some finer voxels would receive no pixel.
    voxel_footprints: Annotated[float, expert("edge of automatic voxels, px at the median depth", 0.1, 1000)] = 2.0
    # Distances with a larger σ would be truncated by the reach, and so be biased.
    max_std_voxels: Annotated[float, expert("largest σ of a distance, voxels", 0.01, 1000)] = 3.0
    # Mismatches rarely agree in three frames.
    min_frames: Annotated[int, expert("least number of frames that see a point of a fused surface", 1, 10_000)] = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.voxel_m < (least_m := 1e-4):
            raise ConfigError(f"dense.voxel_m is {self.voxel_m}; give at least {least_m}, or 0: automatic")
