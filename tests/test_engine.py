"""The engine as users see it: one call per frame, wrong input refused, lost tracking reported and recovered."""

import copy
import dataclasses
import datetime
import pickle
import threading
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.pixels import to_grey
from stream_sfm.camera.refinement import KnownTiming
from stream_sfm.errors import EngineBusyError
from stream_sfm.frontend.rules import ErrorRules
from stream_sfm.geometry import se3
from tests.helpers.estimates import bytes_of
from tests.helpers.estimators import nees
from tests.helpers.wall import Wall, camera_path, rig

N = 24


@pytest.fixture(scope="module")
def frames() -> list[sfm.StereoFrame]:
    wall, stereo = Wall(5), rig(0.03)
    return wall.frames(stereo, camera_path(N))


@pytest.fixture
def engine() -> sfm.Engine:
    return sfm.Engine(rig(0.03), sfm.Config())


def black(frame: sfm.StereoFrame) -> sfm.StereoFrame:
    return sfm.StereoFrame(frame.stamp_ns, np.zeros_like(frame.left), np.zeros_like(frame.right))


@pytest.mark.parametrize("method", ["cross-frame", "ekf", "frame-to-frame"])
def test_poses_and_structure_follow_the_truth(frames, method: str) -> None:
    engine = sfm.Engine(rig(0.03), sfm.Config(method=method))
    estimates = [engine.step(f) for f in frames]
    assert estimates[0].status == sfm.Status.INITIALISING
    assert all(e.status == sfm.Status.OK for e in estimates[1:])
    truth = camera_path(N)
    error = se3.log(se3.inverse(estimates[-1].world_from_cam) @ truth[-1])
    assert np.linalg.norm(error[:3]) < 0.015 and np.linalg.norm(error[3:]) < 0.004  # m of 0.6, rad
    last = estimates[-1]
    wall_from_cam = se3.inverse(Wall(5).world_from_wall) @ truth[-1]
    off_wall = se3.transform(wall_from_cam, last.points_in_cam)[:, 2]
    assert np.median(np.abs(off_wall)) < 0.02  # m at 3 m: a tenth of a pixel is 17 mm
    assert np.abs(last.world_from_cam[:3, :3] @ last.world_from_cam[:3, :3].T - np.eye(3)).max() < 1e-12


@pytest.mark.parametrize("method", ["cross-frame", "frame-to-frame"])
def test_points_now_and_ended_keep_the_error_that_all_their_views_share(frames, method: str) -> None:
    engine = sfm.Engine(rig(0.03), sfm.Config(method=method))
    projection = engine.observer.projection
    shift = sfm.Config().rules.of(ErrorRules).std_shared_px / (projection.f_px * projection.baseline_m)  # of 1/Z
    count = 0
    for estimate in map(engine.step, frames):
        cam = estimate.window_world_from_cam[0]
        ended = se3.transform(se3.inverse(cam), estimate.ended_points_in_world)
        cov_ended = cam[:3, :3].T @ estimate.ended_cov_points_in_world @ cam[:3, :3]
        count += len(ended)
        for points, cov in ((estimate.points_in_cam, estimate.cov_points), (ended, cov_ended)):
            distance = np.linalg.norm(points, axis=1)
            ray = points / distance[:, None]
            std_m = np.sqrt(np.einsum("ni,nij,nj->n", ray, cov, ray))
            # the least of it; the depth of the rectified camera, which is turned by a hundredth or two
            assert (std_m > 0.98 * distance * points[:, 2] * shift).all()
    assert count > 10  # points that have left the window


def test_backing_away_keeps_points_that_the_window_has_left_behind() -> None:
    """New points enter beside and behind the oldest camera of the window; they are ordinary points."""
    wall, stereo = Wall(6), rig()
    poses = [se3.exp([0, 0, 1.6 - 0.1 * n, 0, 0, 0.002 * n]) for n in range(24)]
    engine = sfm.Engine(stereo, sfm.Config())
    estimates = [engine.step(wall.frame(stereo, pose, n)) for n, pose in enumerate(poses)]
    assert all(e.status == sfm.Status.OK for e in estimates[1:])
    truth = se3.inverse(poses[0]) @ poses[-1]
    error = se3.log(se3.inverse(estimates[-1].world_from_cam) @ truth)
    assert np.linalg.norm(error[:3]) < 0.01 * 2.3 and np.linalg.norm(error[3:]) < 0.004  # 1 % of the path


def test_lost_is_a_result_and_the_map_goes_on_when_the_view_comes_back(frames, engine) -> None:
    estimates = [engine.step(black(f) if 10 <= n < 14 else f) for n, f in enumerate(frames)]
    statuses = [e.status for e in estimates]
    assert statuses[10:14] == [sfm.Status.LOST] * 4
    assert "black" in estimates[10].reason
    assert all(s == sfm.Status.OK for s in statuses[14:])
    before, lost, after = (estimates[n].cov_pose[0, 0] for n in (9, 13, 15))
    assert lost > 100 * before and after < 10 * before  # a fifth of a second of unknown motion
    assert len(np.intersect1d(estimates[9].track_ids, estimates[14].track_ids)) > 50  # of 250: the map was kept
    assert nees(estimates[-1].world_from_cam, estimates[-1].cov_pose, camera_path(N)[-1]) < 22.5  # χ²(6), 0.999


def test_wrong_input_is_refused_and_changes_nothing(frames, engine) -> None:
    engine.step(frames[0])
    good = frames[1]
    changed = partial(dataclasses.replace, good)
    wrong = [
        (changed(stamp_ns=0), "stamps must increase"),
        (changed(stamp_ns=-1), "or make a new engine if the clock was set back"),
        (changed(stamp_ns=1.5), r"frame 1: stamp_ns is of type float \(1.5\); give an integer"),
        (changed(stamp_ns=np.float32(2)), r"of seconds, round\(seconds \* 1e9\)"),
        (changed(stamp_ns=np.datetime64("2026-01-01")), r"int\(stamp.astype\('datetime64\[ns\]'\)"),
        (changed(stamp_ns=datetime.datetime(2026, 1, 1)), r"round\(stamp.timestamp\(\) \* 1e9\)"),
        (changed(stamp_ns=SimpleNamespace(sec=1, nanosec=2)), r"stamp.sec \* 10\*\*9"),
        ((good.stamp_ns, good.left, good.right), "frame 1 is of type tuple; give a StereoFrame"),
        (None, "frame 1 is None; give a StereoFrame"),
        (sfm.MonoFrame(good.stamp_ns, good.left), "one image only; give a StereoFrame"),
        (changed(left=good.left / 255), r"left image is float64; give .*255 \* image\)\.astype"),
        (changed(left=good.left.astype(int)), r"is int64; give .* image.astype\(np.uint16\)"),
        (changed(left=np.stack([good.left] * 3)), r"channels first; give image.transpose\(1, 2, 0\)"),
        (changed(left=np.stack([good.left] * 2, axis=2)), r"give \(h, w\), or colour with blue first"),
        (changed(left=np.hstack([good.left, good.right])), r"side by side: image\[:, :320\]"),
        (changed(right=None), "right image is None; give a NumPy array"),
        (changed(right=good.right.tolist()), r"of type list; give a NumPy array, such as np.asarray"),
        (changed(right=good.right[:-1]), "calibration says .*; give images of the .*, not cropped"),
        (changed(right=good.right[::2, ::2]), "K scales with the images"),
        (changed(right=good.right.T), r"give \(h, w\), not \(w, h\): image.T"),
    ]
    for frame, message in wrong:
        with pytest.raises(sfm.FrameError, match=message):
            engine.step(frame)
    with pytest.raises(sfm.FrameError, match="the frame is of type tuple; give a StereoFrame"):
        engine.prepare((1, good.left, good.right))
    small = sfm.Engine(rig(0.03, width=160, height=120))
    little = sfm.StereoFrame(good.stamp_ns, *(np.ascontiguousarray(image[::2, ::2]) for image in good.images))
    for prepared, message in (
        ([good.left, good.right], "prepared is of type list; give what `prepare` returned for this frame"),
        (small.prepare(little), "prepared has shape"),
        (sfm.Engine(rig(0.04)).prepare(frames[1]), "by an engine of another calibration"),
        (engine.prepare(frames[2]), f"prepared is of the frame with stamp {frames[2].stamp_ns} ns"),
    ):
        with pytest.raises(sfm.FrameError, match=message):
            engine.step(good, prepared)
    fresh = sfm.Engine(rig(0.03), sfm.Config())
    fresh.step(frames[0])
    assert bytes_of(fresh.step(good)) == bytes_of(engine.step(good))


def test_stamps_that_count_something_else_are_questioned_once(frames, caplog) -> None:
    engine = sfm.Engine(rig(0.03), sfm.Config())
    for count, frame in enumerate(frames[:3]):
        engine.step(dataclasses.replace(frame, stamp_ns=33 * count))
    assert [record.name for record in caplog.records] == ["stream_sfm"]
    assert "33 ns after the first one: stamps are nanoseconds" in caplog.text


def test_one_camera_says_that_it_does_not_know_the_readout(caplog) -> None:
    timed = dataclasses.replace(rig(0.03), timing=KnownTiming(0.0, 1e-4, 0.02, 1e-4))
    sfm.Engine(timed, sfm.Config(mono=True))
    assert "[timing] is not used with one camera" in caplog.text


def coloured(image: np.ndarray, channels: int) -> np.ndarray:
    """An image in colour that is `image` in grey, up to rounding."""
    return np.stack([image] * 3 + [np.full_like(image, 255)] * (channels - 3), axis=2)


def read_only(image: np.ndarray) -> np.ndarray:
    """In Fortran's order."""
    other = np.asfortranarray(image)
    other.flags.writeable = False
    return other


FORMS = {
    "h w 1": lambda image: image[:, :, None],
    "BGRA": lambda image: coloured(image, 4),
    "half of a wider one": lambda image: np.hstack([image, image])[:, image.shape[1] :],
    "16 bits h w 1": lambda image: image.astype(np.uint16)[:, :, None] << 8,
    "BGR of 16 bits": lambda image: coloured(image.astype(np.uint16) << 8, 3),
    "Fortran's, read-only": read_only,
}


@pytest.fixture(scope="module")
def of_plain_images(frames) -> list[bytes]:
    engine = sfm.Engine(rig(0.03), sfm.Config())
    return [bytes_of(engine.step(frame)) for frame in frames[:3]]


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_images_are_taken_in_the_forms_in_which_logs_have_them(frames, engine, of_plain_images, form) -> None:
    """The same pixels give the same estimates."""
    for frame, expected in zip(frames, of_plain_images, strict=False):
        other = sfm.StereoFrame(frame.stamp_ns, form(frame.left), form(frame.right))
        assert bytes_of(engine.step(other, engine.prepare(other))) == expected


def test_colour_is_blue_first() -> None:
    blue = np.zeros((2, 2, 3), np.uint8)
    blue[:, :, 0] = 200
    assert to_grey(blue).tolist() == [[23, 23], [23, 23]]  # 0.114 of it; of red it would be 0.299


@pytest.mark.parametrize(
    "arguments,message",
    [
        (("cal.toml",), r"the rig is of type str \('cal.toml'\); give a StereoRig .*from_calibration\('cal"),
        ((Path("cal.toml"),), r"from_calibration\('cal.toml'\)"),
        ((None,), "the rig is None; give a StereoRig"),
        ((sfm.StereoRig,), "the rig is the class StereoRig; give a StereoRig"),
        ((rig(), "settings.toml"), r"the configuration is of type str .*; give a Config, such as read_config"),
        ((rig(), {}), "the configuration is of type dict; give a Config"),
        ((rig(), sfm.Config), "the configuration is the class Config; give a Config"),
        ((sfm.MonoRig(rig().left),), r"a rig of one camera needs Config\(mono=True\)"),
    ],
)
def test_an_engine_of_something_else_says_what_was_given_and_what_is_wanted(arguments, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        sfm.Engine(*arguments)


K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
POSE = se3.exp([-0.1, 0, 0, 0, 0, 0])


def pair(*pose_and_refinement) -> sfm.StereoRig:
    return sfm.StereoRig(sfm.Camera(320, 240, K), sfm.Camera(320, 240, K), *pose_and_refinement)


@pytest.mark.parametrize(
    "make,message",
    [
        (lambda: sfm.Camera(K, 320, 240), r"size holds an array: give .* Camera\(width=640, height=480"),
        (lambda: sfm.Camera(320.5, 240, K), r"the camera's size holds 320.5"),
        (lambda: sfm.Camera(float("nan"), 240, K), r"the camera's size holds nan"),
        (lambda: sfm.Camera(320, 240, "K.txt"), r"the camera's K is 'K.txt': give an array of numbers"),
        (lambda: sfm.Camera(320, 240, K.T), r"is transposed, as MATLAB has it: .*; give K.T"),
        (lambda: sfm.Camera(320, 240, K / 320 * np.array([[1], [1], [320]])), "not fractions of the image"),
        (lambda: sfm.Camera(320, 240, K + np.array([[0, 2, 0], [0, 0, 0], [0, 0, 0]])), r"so that K\[0, 1\] is 0"),
        (lambda: sfm.Camera(320, 240, K, [0.1] * 8), "8 are those of rational_polynomial"),
        (lambda: sfm.Camera(320, 240, K, [0.1] * 12), "thin prism and tilt are not supported: rectify"),
        (lambda: pair((np.eye(3), [-0.1, 0, 0])), r"of rotation and translation it is \[\[R, t\], \[0, 1\]\]"),
        (lambda: pair(POSE.T), r"last row 0 0 0 1, got .*; it is transposed"),
        (lambda: pair(POSE, 0.5), r"refinement of the rig is of type float \(0.5\); give Refinement"),
        (lambda: sfm.StereoRig(sfm.Camera(320, 240, K), None, POSE), "right of the rig is None; give Camera"),
        (lambda: sfm.StereoRig.from_calibration(None), "the calibration is None; give a file, the files of left"),
        (lambda: sfm.StereoRig.from_calibration({}), "the calibration is of type dict; give a file"),
        (lambda: sfm.StereoRig.from_calibration([]), "the calibration is of type list; give a file"),
        (lambda: sfm.open_viewer("calibration.toml", "a.rrd"), "the rig is of type str; give a StereoRig"),
    ],
)
def test_cameras_and_rigs_of_something_else_say_what_is_wanted(make, message: str) -> None:
    with pytest.raises(sfm.ConfigError, match=message):
        make()


def test_a_second_thread_in_step_is_refused_and_the_first_is_not_disturbed(frames, engine) -> None:
    entered, go_on = threading.Event(), threading.Event()
    solve = engine.lane.estimator.step

    def slow(observations):
        entered.set()
        assert go_on.wait(60)
        return solve(observations)

    engine.step(frames[0])
    engine.lane.estimator.step = slow
    results = []
    first = threading.Thread(target=lambda: results.append(engine.step(frames[1])))
    first.start()
    assert entered.wait(60)
    with pytest.raises(sfm.StreamSfmError, match="while another thread is in it"):
        engine.step(frames[2])
    prepared = engine.prepare(frames[2], 2)  # which any thread may do at any time
    go_on.set()
    first.join()
    results.append(engine.step(frames[2], prepared))
    alone = sfm.Engine(rig(0.03), sfm.Config())
    assert [bytes_of(alone.step(f)) for f in frames[:3]][1:] == [bytes_of(e) for e in results]


@pytest.mark.parametrize("changed", [{}, {"method": "ekf"}, {"mono": True}], ids=str)
def test_a_copied_engine_goes_on_with_the_samebytes_of(frames, changed: dict[str, object]) -> None:
    engine = sfm.Engine(rig(0.03), sfm.Config(**changed))
    for frame in frames[:8]:
        engine.step(frame)
    copies = copy.copy(engine), copy.deepcopy(engine), pickle.loads(pickle.dumps(engine))
    went_on = [bytes_of(engine.step(frame)) for frame in frames[8:10]]
    for other in copies:
        assert [bytes_of(other.step(frame)) for frame in frames[8:10]] == went_on


def test_a_copy_within_a_step_is_refused(frames) -> None:
    """By the estimator here, as by another thread: half of the state is that of the previous frame."""
    engine = sfm.Engine(rig(0.03))
    engine.step(frames[0])
    step, refused = engine.lane.estimator.step, []

    def copying(observations: sfm.Observations) -> sfm.Solution:
        for attempt in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(EngineBusyError, match="between two steps"):
                attempt(engine)
            refused.append(attempt)
        return step(observations)

    engine.lane.estimator.step = copying
    engine.step(frames[1])
    assert len(refused) == 3


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int32, np.uint64])
def test_stamps_of_any_integer_type_are_the_same(frames, kind: type) -> None:
    """Differences of small types overflow."""
    ends = []
    for stamps in ([kind(5), kind(100)], [5, 100]):
        engine = sfm.Engine(rig(0.03))
        timed = [dataclasses.replace(frame, stamp_ns=ns) for ns, frame in zip(stamps, frames, strict=False)]
        ends.append([bytes_of(engine.step(frame)) for frame in timed])
    assert ends[0] == ends[1]


def test_a_bright_frame_that_is_prepared_but_not_stepped_changes_nothing(frames) -> None:
    """16-bit images are scaled by the brightest ones that were stepped, and a brighter one later scales the rest."""

    def deep(frame: sfm.StereoFrame, gain: int) -> sfm.StereoFrame:
        return sfm.StereoFrame(
            frame.stamp_ns, *(np.minimum(i.astype(np.uint16) * gain, 65535).astype(np.uint16) for i in frame.images)
        )

    plain, prepared, brighter = (sfm.Engine(rig(0.03)) for _ in range(3))
    for n, frame in enumerate(frames[:6]):
        dim = deep(frame, 16)
        prepared.prepare(deep(frames[n], 256), n)
        brighter_frame = deep(frame, 64 if n == 3 else 16)
        expected = plain.step(dim)
        assert bytes_of(prepared.step(dim, prepared.prepare(dim, n))) == bytes_of(expected)
        brighter.step(brighter_frame, brighter.prepare(brighter_frame))
    assert [engine.observer.state.grey_bits for engine in (plain, prepared, brighter)] == [12, 12, 14]


def test_a_baseline_that_is_hardly_in_metres_is_questioned(caplog) -> None:
    millimetres = rig().right_from_left.copy()
    millimetres[:3, 3] *= 1000
    sfm.Engine(rig())
    assert not caplog.messages
    sfm.Engine(dataclasses.replace(rig(), right_from_left=millimetres))
    assert "are these millimetres?" in caplog.messages[0]


def test_after_a_reset_an_engine_is_a_new_one_that_starts_at_the_given_pose() -> None:
    """All estimates are those of a new engine to the byte, moved by the given pose; covariances of the pose as well."""
    frames = Wall(2).frames(rig(), camera_path(6))
    engine, new = sfm.Engine(rig()), sfm.Engine(rig())
    for frame in frames:
        engine.step(frame)
    engine.reset()
    for frame in frames:
        assert np.array_equal(engine.step(frame).world_from_cam, new.step(frame).world_from_cam)
    start, new = se3.exp([1.0, -2, 3, 0.5, 1, -0.3]), sfm.Engine(rig())
    engine.reset(start)
    for frame in frames:
        moved, plain = engine.step(frame), new.step(frame)
        assert moved.frame_index == plain.frame_index and np.array_equal(moved.cov_pose, plain.cov_pose)
        assert np.allclose(moved.world_from_cam, start @ plain.world_from_cam, atol=1e-12)
        assert np.allclose(moved.points_in_world, se3.transform(start, plain.points_in_world), atol=1e-9)
        assert np.allclose(moved.window_world_from_cam, start @ plain.window_world_from_cam, atol=1e-12)
        assert np.array_equal(moved.points_in_cam, plain.points_in_cam)
        turned = start[:3, :3] @ plain.cov_points_in_world @ start[:3, :3].T
        assert np.allclose(moved.cov_points_in_world, turned, rtol=1e-6, atol=1e-12)
    with pytest.raises(sfm.ConfigError, match="world_from_cam holds no rotation"):
        engine.reset(2 * np.eye(4) - np.diag([0, 0, 0, 1]))
