"""logs/room.mcap is what logs/README.md says, and its pictures, depth, poses and calibration agree.

The geometry is checked without the renderer: depth carries pixels of one image into another by calibration and
pose, and what is left between the two pictures must be noise, not a shift.
"""

import sys
from collections import defaultdict
from functools import cache

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.geometry import se3
from tests.helpers.places import ROOT

ROOM = ROOT / "logs" / "room.mcap"
FRAMES, DEPTHS, SECONDS = 84, 9, 9
GAIN_RIGHT = 0.98


@pytest.fixture(scope="module")
def log():
    """topic -> messages, and (topic, stamp) -> message."""
    by_topic = defaultdict(list)
    with ROOM.open("rb") as file:
        for _, channel, record, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            stamp_ns = message.timestamp.seconds * 10**9 + message.timestamp.nanos
            assert record.log_time == stamp_ns
            by_topic[channel.topic].append((stamp_ns, message))
    return dict(by_topic)


@pytest.fixture(scope="module")
def rig(log):
    """From K, D, R, P alone, as a reader of the log has to do it."""
    cameras, rectifying = [], []
    for side in ("left", "right"):
        message = log[f"/camera/{side}/calibration"][0][1]
        k = np.array(message.K).reshape(3, 3)
        cameras.append(Camera(message.width, message.height, k, tuple(message.D), message.distortion_model))
        rectifying.append(np.array(message.R).reshape(3, 3))
    p_right = np.array(log["/camera/right/calibration"][0][1].P).reshape(3, 4)
    r_left, r_right = rectifying
    pose = se3.from_rotation_translation(r_right.T @ r_left, r_right.T @ [p_right[0, 3] / p_right[0, 0], 0, 0])
    return StereoRig(*cameras, pose)


def decoded(message):
    return cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)


def poses(log):
    q = [m.pose.orientation for _, m in log["/ground_truth/pose"]]
    t = [m.pose.position for _, m in log["/ground_truth/pose"]]
    return se3.from_rotation_translation(
        se3.matrix_from_quat_xyzw([(a.x, a.y, a.z, a.w) for a in q]), [(a.x, a.y, a.z) for a in t]
    )


def lens(points_in_cam, camera: Camera):
    return cv2.projectPoints(points_in_cam, np.zeros(3), np.zeros(3), camera.K, np.array(camera.D))[0].reshape(
        -1, 2
    )


@cache
def raw_rays(width: int, height: int, k: tuple, d: tuple):
    """Rays (n, 2) of all raw pixels: OpenCV's lens turned round by Newton's method."""
    camera = Camera(width, height, np.reshape(k, (3, 3)), d)
    raw = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    rays = (raw - camera.K[:2, 2]) / camera.K[0, 0]
    for _ in range(8):
        rays += (raw - lens(np.c_[rays, np.ones(len(rays))], camera)) / camera.K[0, 0]
    assert np.abs(raw - lens(np.c_[rays, np.ones(len(rays))], camera)).max() < 1e-6
    return rays


def pixels_in(camera: Camera, target_from_left, left: Camera, depth_m):
    """Raw pixels of `camera` that see what the raw left pixels see, and their depth there."""
    rays = raw_rays(left.width, left.height, tuple(left.K.ravel()), left.D)
    points = np.c_[rays, np.ones(len(rays))] * depth_m.reshape(-1, 1)
    points = se3.transform(target_from_left, points)
    return lens(points, camera).reshape(*depth_m.shape, 2), points[:, 2].reshape(depth_m.shape)


def visible_twice(seen, depth_in_target, valid):
    """Pixels not hidden in the other view (z-buffer of 3×3 px splats), away from edges of depth."""
    h, w = valid.shape
    x, y = np.rint(seen[..., 0]).astype(int), np.rint(seen[..., 1]).astype(int)
    inside = valid & (x > 3) & (y > 3) & (x < w - 4) & (y < h - 4)
    nearest = np.full((h, w), np.inf)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            np.minimum.at(nearest, (y[inside] + dy, x[inside] + dx), depth_in_target[inside])
    front = inside.copy()
    front[inside] = depth_in_target[inside] < 1.03 * nearest[y[inside], x[inside]]
    steps = cv2.morphologyEx(depth_in_target.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((5, 5)))
    return cv2.erode((front & (steps < 0.3)).astype(np.uint8), np.ones((5, 5))).astype(bool)


def residual_shift(reference, other, seen, keep):
    """Least-squares shift (2,), pixels, mean and robust spread of the residual, grey levels."""
    warped = cv2.remap(other.astype(np.float32), *np.moveaxis(seen.astype(np.float32), -1, 0), cv2.INTER_CUBIC)
    residual = warped - reference
    soft = cv2.GaussianBlur((warped + reference) / 2, (0, 0), 0.7)
    gx, gy = cv2.Sobel(soft, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(soft, cv2.CV_32F, 0, 1, scale=1 / 8)
    r, g = residual[keep].astype(float), np.stack([gx[keep], gy[keep]], axis=1).astype(float)
    spread = 1.4826 * np.median(np.abs(r - np.median(r)))
    usual = np.abs(r) < 6 * spread
    r, g = r[usual], g[usual]
    return np.linalg.solve(g.T @ g, g.T @ r), r.mean(), spread


def assert_no_shift(shifts):
    """Each frame to 0.015 px (a shift's own error is 0.002 to 0.005 px), the mean within its standard error."""
    shifts = np.array(shifts)
    standard_error = shifts.std(axis=0, ddof=1) / np.sqrt(len(shifts))
    assert np.abs(shifts).max() < 0.015
    assert np.all(np.abs(shifts.mean(axis=0)) < np.minimum(3.5 * standard_error, 0.005))


def with_depth(log):
    left, right = dict(log["/camera/left/image"]), dict(log["/camera/right/image"])
    stamps = [stamp for stamp, _ in log["/camera/left/image"]]
    for stamp, message in log["/ground_truth/depth"]:
        depth_m = decoded(message) * 1e-4
        yield stamps.index(stamp), depth_m, decoded(left[stamp]), decoded(right[stamp])


def test_topics_counts_and_size(log):
    counts = {topic: len(messages) for topic, messages in log.items()}
    assert counts == {
        "/camera/left/image": FRAMES,
        "/camera/right/image": FRAMES,
        "/camera/left/calibration": SECONDS,
        "/camera/right/calibration": SECONDS,
        "/ground_truth/pose": FRAMES,
        "/ground_truth/depth": DEPTHS,
    }
    # bytes: it is part of the checkout
    assert sum(path.stat().st_size for path in (ROOT / "logs").glob("*.mcap")) < 6e6
    stamps = np.array([stamp for stamp, _ in log["/camera/left/image"]])
    assert np.all(np.diff(stamps) == 100_000_000)
    for topic in ("/camera/right/image", "/ground_truth/pose"):
        assert [stamp for stamp, _ in log[topic]] == stamps.tolist()


def test_depth_carries_left_into_right(log, rig):
    """No shift between the left image and the right one warped by depth (measured: 0.0016 px in the mean)."""
    shifts = []
    for _, depth_m, left, right in with_depth(log):
        seen, depth_in_right = pixels_in(rig.right, rig.right_from_left, rig.left, depth_m)
        keep = visible_twice(seen, depth_in_right, depth_m > 0)
        shift, mean, spread = residual_shift(left.astype(np.float32), right / np.float32(GAIN_RIGHT), seen, keep)
        assert abs(mean) < 0.3  # grey levels
        assert spread < 5
        assert keep.mean() > 0.5
        shifts.append(shift)
    assert_no_shift(shifts)


@pytest.mark.parametrize("ahead", [1, 4])
def test_depth_and_pose_carry_a_frame_through_time(log, rig, ahead):
    """The same with a later left image, by the ground-truth poses."""
    images, world_from_cam = log["/camera/left/image"], poses(log)
    shifts = []
    for i, depth_m, left, _ in with_depth(log):
        if i + ahead >= FRAMES:
            continue
        later_from_left = se3.inverse(world_from_cam[i + ahead]) @ world_from_cam[i]
        seen, depth_later = pixels_in(rig.left, later_from_left, rig.left, depth_m)
        keep = visible_twice(seen, depth_later, depth_m > 0)
        later = decoded(images[i + ahead][1])
        shift, mean, spread = residual_shift(left.astype(np.float32), later, seen, keep)
        assert abs(mean) < 0.3  # grey levels
        assert spread < 6  # grey levels: noise of two images
        shifts.append(shift)
    assert_no_shift(shifts)


def test_the_renderer_still_makes_this_scene(log, rig):
    """The committed log is of the committed renderer: rig, path and depth agree, the picture resembles it."""
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import render
    finally:
        sys.path.remove(str(ROOT / "tools"))
    ours = render.room_rig()
    np.testing.assert_allclose(ours.right_from_left, rig.right_from_left, atol=1e-9)
    path = render.room_path()
    np.testing.assert_allclose(path, poses(log), atol=1e-9)
    scene = render.room_scene(texel_m=0.01)
    i, depth_m, left, _ = list(with_depth(log))[3]
    recording = render.Recording(scene, ours, 1, 1.0, lambda _: path[i], sensor=render.CLEAN)
    shot = recording.shot(0, seed=0)
    known = depth_m > 0
    assert known.mean() > 0.99  # no sky in a room
    np.testing.assert_allclose(shot.depth_m[known], depth_m[known], atol=6e-5)
    again = recording.shot(0, seed=0)
    np.testing.assert_array_equal(again.right, shot.right)
    assert np.corrcoef(shot.left.ravel(), left.ravel())[0, 1] > 0.5  # other texels, same furniture
