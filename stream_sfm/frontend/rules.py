"""The rules that several files of the front-end read: whose motion is that of the camera, and the noise of views."""

from typing import Annotated

from ..config.section import Section, expert


class MotionRules(Section, frozen=True, kw_only=True):
    """Which motion is that of the camera, and how the history of a track counts."""

    # After a sudden blur of 5 px, 14 of 196 tracks agreed by chance with a motion that was wrong by 7 cm.
    min_agreement: Annotated[float, expert("least share of votes in view that agree with a motion", 0, 1)] = 0.15
    # A camera rarely accelerates by more.
    jump_sigmas: Annotated[float, expert("a jump exceeds this multiple of σ of the acceleration", 0.1, 1000)] = 4.0
    # Views that come back do so within a second; after that too much has changed for optical flow.
    max_gap_s: Annotated[float, expert("time to seek the tracks of the last good frame, s", 0, 100)] = 1.0
    # It is 0.93 or more in the first frames of calm scenes, and 0.68 to 0.77 in a crowd, with a right or wrong
    # motion.
    calm_start: Annotated[float, expert("share of points that agree with a camera's motion", 0, 1)] = 0.8
    # It is half a second for most cameras. With more, the last old tracks in a turn would outvote all new ones.
    full_history: Annotated[int, expert("frames of agreement beyond which history no longer counts", 1, 1000)] = 10
    # A body that enters the view is outvoted, but not for ever once it is all that is left in most of the image.
    first_vote: Annotated[float, expert("vote of a track that never agreed, share of the largest", 1e-3, 1e6)] = 0.1
    # A tenth forgets depths from a wrong motion. Less is slower to recover; more wastes earlier views.
    forgetting: Annotated[float, expert("growth per frame of the variance of inverse depth", 1, 10)] = 1.1
    # With 1, 41 frames of KITTI 06 are degraded.
    slides_most: Annotated[float, expert("multiple of the template drift that a track survives", 0, 100)] = 2.0
    # Because of noise, not all of them agree even with the right motion.
    as_many: Annotated[float, expert("share of a motion's views that one in its place must explain", 0, 1)] = 0.9
    # This is long enough to average, and short enough to follow a camera that is put on a vehicle.
    unsteady_frames: Annotated[int, expert("frames over which changes of the motion are averaged", 1, 10_000)] = 30
    # A few frames say more than the assumptions about any camera.
    assumed_frames: Annotated[float, expert("weight of the assumed changes of motion, frames", 1, 10_000)] = 5.0
    # These are odds of 10, beyond which a second motion is excluded as well (`robust.ambiguous_share`).
    confirmed_nats: Annotated[float, expert("evidence of new points that confirms a motion, nats", 0.01, 1e6)] = 2.3
    # The mean share is 0.93, as in calm scenes, and 0.81 says nothing: in crowds 0.68 to 0.77 of the new points agree
    # with a right or a wrong motion.
    new_favour: Annotated[float, expert("a of eq. (7c) for new points and the camera's motion", 1.01, 1e4)] = 13.0
    # Fewer agree by chance.
    hidden_views: Annotated[int, expert("least number of new tracks of a body in front", 2, 10**9)] = 12
    one_body: Annotated[bool, expert("refuse motions between those of two bodies")] = True
    # Without it errors in a bare corridor are 28 to 37 % larger from three of four starts.
    poor_frames: Annotated[bool, expert("give all views more noise if most of them fit badly")] = True
    # A jump of a moving body says nothing about the camera.
    most_unsteady: Annotated[float, expert("cap on a squared change of motion, multiples of the mean", 1, 1e6)] = 9.0
    # Squared distances of six unknowns are 6 on average.
    expected_near: Annotated[float, expert("largest squared distance of a motion from the expected", 0, 1e6)] = 20.0
    # This corresponds to odds of 1800.
    inertial_apart: Annotated[float, expert("least difference of squared distances from inertia", 0, 1e6)] = 15.0


class ErrorRules(Section, frozen=True, kw_only=True):
    """The noise of views, and how long the error of a template lasts."""

    # Outside a fifth and five times the expected σ, something else is wrong.
    least_factor: Annotated[float, expert("least variance factor of views", 1e-6, 1)] = 0.05
    most_factor: Annotated[float, expert("largest variance factor of views", 1, 1e6)] = 30.0
    # With fewer, χ²/dof scatters by a third or more.
    min_dof: Annotated[int, expert("degrees of freedom of a frame that the factor learns from", 1, 10_000)] = 20
    # Views of a rendered wall scatter by about this much.
    typical_std_px: Annotated[float, expert("σ of a view before anything is measured, px", 1e-3, 100)] = 0.15
    # With a quarter, estimates from halves of the tracks agree within their σ, on rendered and on real logs.
    left_fraction: Annotated[float, expert("lasting error of the left side, share of the right one", 0, 1)] = 0.25
    first_white: Annotated[float, expert("first guess of the white part of the error, σ²", 1e-3, 100)] = 1.0
    first_lasting: Annotated[float, expert("first guess of the lasting part of the error, σ²", 0, 100)] = 0.3
    first_decay: Annotated[float, expert("first guess of the decay of lasting errors", 0.01, 0.999)] = 0.92
    # One frame has about as many.
    guess_pairs: Annotated[float, expert("weight of the guess of lasting errors, pairs of views", 1, 1e6)] = 200.0
    # A hundred frames: the errors are a property of cameras and scene and change slowly.
    memory_pairs: Annotated[float, expert("pairs of views that are remembered", 1, 1e8)] = 20_000.0
    # Older points get the least σ.
    remembered_points: Annotated[int, expert("points whose shared error is remembered", 1, 10**7)] = 20_000
    # Beyond it the match may be wrong.
    most_row_sigmas: Annotated[float, expert("largest row difference of a view that counts, σ", 0.1, 1000)] = 3.0
    # From then on information grows at a steady rate.
    oldest_views: Annotated[int, expert("views of a track beyond which more count the same", 2, 10_000)] = 60
    # Images always have noise.
    least_white: Annotated[float, expert("least share of white noise", 1e-3, 1)] = 0.05
    # An error with a smaller decay is white.
    least_decay: Annotated[float, expert("least decay of the lasting part", 0.01, 0.999)] = 0.5
    # Longer durations cannot be distinguished within the life of a track.
    most_decay: Annotated[float, expert("largest decay of the lasting part", 0.01, 0.999)] = 0.98
    # This is σ₀ of eq. (18), for a patch whose halves agree. On two rendered logs the median error of local
    # structure is 0.5 and 1.6 times its σ with it, and 2.6 and 2.8 times without.
    std_shared_px: Annotated[float, expert("σ of the disparity error that a point's views share", 0, 10)] = 0.04
    # This is s of eq. (17). With exact poses and depths, `python -m tools.track_errors` gives a tenth to two
    # tenths, both along the line of sight and across it.
    slide: Annotated[float, expert("share of a patch's change by which its position slides", 0, 10)] = 0.1
    # s_b of eq. (17c). The largest NEES of poses (6 degrees of freedom) on logs blurred by up to 6 px is 21 with it and
    # 61 without; with a tenth it is 64.
    slide_blurred: Annotated[float, expert("share of a change of sharpness by which a patch slides", 0, 10)] = 0.2
    # Without it, over 6 m of a rendered corridor, the pitch error is 0.4 mrad, three times its σ; in a rendered
    # office of 256 px the NEES of poses is 22 instead of 11.
    alike: Annotated[float, expert("share of the slide that all patches of a frame have in common", 0, 1)] = 0.75
