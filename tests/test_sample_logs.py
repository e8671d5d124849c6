"""The logs in logs/ agree with logs/README.md and with the renderer.

That its pictures agree with its depth and its poses is seen in tests/dense/ and tests/test_odometry.py.
"""

from itertools import islice, pairwise

import numpy as np
import pytest
from mcap.reader import make_reader

import stream_sfm as sfm
from tests.helpers.places import DEMO, ROOM, ROOT
from tools import render

FRAMES, DEPTHS, SECONDS = 84, 9, 9


def test_topics_counts_and_size():
    with ROOM.open("rb") as file:
        summary = make_reader(file).get_summary()
    counts = {c.topic: summary.statistics.channel_message_counts[i] for i, c in summary.channels.items()}
    of_cameras = {"image": FRAMES, "calibration": SECONDS}
    assert counts == {"/ground_truth/pose": FRAMES, "/ground_truth/depth": DEPTHS} | {
        f"/camera/{side}/{name}": n for side in ("left", "right") for name, n in of_cameras.items()
    }
    # bytes: it is part of the checkout
    assert all(path.stat().st_size < 6e6 for path in (ROOT / "logs").glob("*.mcap"))
    log = sfm.open_log(ROOM)
    stamps = np.array([pair.stamp_ns for pair in log.pairs()])
    assert np.all(np.diff(stamps) == 100_000_000) and log.ground_truth().stamps_ns.tolist() == stamps.tolist()


def test_the_renderer_still_makes_this_scene():
    """The committed log is of the committed renderer: rig, path and depth agree, the picture resembles it."""
    log, ours, path = sfm.open_log(ROOM), render.room_rig(), render.room_path()
    np.testing.assert_allclose(ours.right_from_left, log.rig.right_from_left, atol=1e-9)
    np.testing.assert_allclose(path, log.ground_truth().world_from_cam, atol=1e-9)
    stamp_ns, depth_m = list(log.depths())[3]
    i, left = next((i, frame.left) for i, frame in enumerate(log.frames()) if frame.stamp_ns == stamp_ns)
    recording = render.Recording(render.room_scene(texel_m=0.01), ours, 1, 1.0, lambda _: path[i], sensor=render.CLEAN)
    shot = recording.shot(0, seed=0)
    known = np.isfinite(depth_m)
    assert known.mean() > 0.99  # no sky in a room
    np.testing.assert_allclose(shot.depth_m[known], depth_m[known], atol=6e-5)  # half of what a digit is worth
    np.testing.assert_array_equal(recording.shot(0, seed=0).right, shot.right)
    assert np.corrcoef(shot.left.ravel(), left.ravel())[0, 1] > 0.5  # other texels, same furniture


def test_the_demo_is_of_this_renderer_and_its_calibration_is_a_little_wrong():
    log, frames, rate_hz = sfm.open_log(DEMO), 180, 20.0
    np.testing.assert_allclose(render.room_path(frames, rate_hz), log.ground_truth().world_from_cam, atol=1e-9)
    assert len(list(log.pairs())) == frames and len(list(log.depths())) == 3
    ours = render.demo_rigs(seed=7)
    np.testing.assert_allclose(ours[0].right_from_left, log.rig.right_from_left, atol=1e-9)
    assert 1e-5 < np.abs(ours[1].right_from_left - log.rig.right_from_left).max() < 1e-3


@pytest.mark.slow
def test_successive_poses_of_the_demo_err_no_more_than_the_motion_between_them() -> None:
    """Its rig is found on the way: were each pose corrected by what the newest frames say of it, it would be 1.33."""
    log = sfm.open_log(DEMO)
    truth, engine = log.ground_truth(), sfm.Engine(log.rig)
    assert truth is not None
    true = dict(zip(truth.stamps_ns.tolist(), truth.world_from_cam, strict=True))
    estimates = [engine.step(frame) for frame in islice(log.frames(), 80)]
    of_poses, of_motions = [], []
    for before, now in pairwise(estimates[10:]):
        assert now.relative is not None
        back = np.linalg.inv(true[now.stamp_ns]) @ true[before.stamp_ns]
        of_poses.append(back @ np.linalg.inv(before.world_from_cam) @ now.world_from_cam)
        of_motions.append(back @ now.relative.frame_from_newest[-1])
    apart = [np.linalg.norm(np.array(e)[:, :3, :3] - np.eye(3)) for e in (of_poses, of_motions)]
    assert apart[0] < 1.15 * apart[1]
