"""Ground truth from a file equals the same poses in the log, in every format and for every frame."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from tests.helpers.data_sets import BODY_FROM_LEFT, numbers, write_euroc, write_euroc_truth
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, LogWriter, Spec, write_log, write_transform

RNG = np.random.default_rng(3)
POSES = se3.exp(RNG.normal(size=(12, 6)) * 0.4)
STAMPS_NS = [START_NS + n * PERIOD_NS for n in range(12)]


def seconds(stamp_ns):
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def tum(path, stamps=STAMPS_NS):
    rows = np.c_[POSES[:, :3, 3], se3.quat_xyzw_from_matrix(POSES[:, :3, :3])]
    lines = [f"{seconds(stamp)} {numbers(row)}\n" for stamp, row in zip(stamps, rows, strict=True)]
    path.write_text("# timestamp tx ty tz qx qy qz qw\n" + "".join(lines))
    return path


def kitti(path, stamped):
    stamps = map(seconds, STAMPS_NS)
    if not stamped:
        (path.parent / "times.txt").write_text("\n".join(stamps))
        stamps = [""] * len(POSES)
    path.write_text("\n".join(f"{s} {numbers(pose[:3])}" for s, pose in zip(stamps, POSES, strict=True)))
    return path


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "log.mcap", Spec(truth=True))


def check(log, truth, poses=POSES):
    found = sfm.open_log(log, ground_truth=truth).ground_truth()
    assert found.stamps_ns.tolist() == STAMPS_NS
    np.testing.assert_allclose(found.world_from_cam, poses, atol=1e-9)


def test_every_format(tmp_path, log):
    check(log, tum(tmp_path / "gt.txt"))
    check(log, kitti(tmp_path / "stamped.txt", True))
    check(log, kitti(tmp_path / "poses.txt", False))
    check(log, sfm.Trajectory(np.array(STAMPS_NS), POSES))


def test_an_offset_moves_the_stamps(tmp_path, log):
    path = tum(tmp_path / "gt.txt", stamps=[s - START_NS for s in STAMPS_NS])
    check(log, sfm.GroundTruthFile(path, offset_s=START_NS / 1e9))


def test_the_body_of_euroc_is_placed_by_its_sensor_file(tmp_path, log):
    write_euroc(tmp_path / "MH")
    mav = tmp_path / "MH" / "mav0"
    truth = write_euroc_truth(mav / "state_groundtruth_estimate0" / "data.csv", STAMPS_NS, POSES)
    check(log, truth, POSES @ BODY_FROM_LEFT)
    alone = write_euroc_truth(tmp_path / "data.csv", STAMPS_NS, POSES)
    check(log, sfm.GroundTruthFile(alone, mav / "cam0" / "sensor.yaml"), POSES @ BODY_FROM_LEFT)
    with pytest.raises(
        sfm.ConfigError, match=r"EuRoC's body, and .*cam0/sensor\.yaml is missing: name the frame"
    ) as caught:
        sfm.open_log(log, ground_truth=alone)
    assert caught.value.hint == ("ground_truth_frame",)


def test_the_poses_of_another_frame_are_carried_along_the_transforms_of_the_log(tmp_path):
    bag = tmp_path / "walk"
    bag.mkdir()
    write_log(bag / "walk_0.mcap")
    writer = LogWriter(bag / "walk_1.mcap")
    write_transform(writer, "foxglove", START_NS, "base_link", "left", BODY_FROM_LEFT)
    writer.close()
    path = tum(tmp_path / "gt.txt")
    check(bag, sfm.GroundTruthFile(path, "base_link"), POSES @ BODY_FROM_LEFT)
    check(bag, sfm.GroundTruthFile(path, "left"))
    with pytest.raises(sfm.ConfigError, match="from frame 'left' of the left camera to frame 'imu' of the ground"):
        sfm.open_log(bag, ground_truth=sfm.GroundTruthFile(path, "imu"))


def test_stamps_of_another_time_are_reported_with_the_offset_that_helps(tmp_path, log):
    path = tum(tmp_path / "gt.txt", stamps=[s - 1000 * 10**9 for s in STAMPS_NS])
    opened = sfm.open_log(log, ground_truth=path)
    list(opened.frames())
    opened.ground_truth()
    assert any("an offset of 1000.000 s would let both begin together" in w for w in opened.stats.warnings)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no pose"),
        ("1 2 3\n", "a line has 3 columns; supported are TUM"),
        ("1.0 0 0 0 0 0 0 9\n", "line 1: the quaternion .* is not of length 1"),
        ("1.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n", "line 2: its stamp is not later than the one before"),
        ("1.0 a 0 0 0 0 0 1\n", "line 1 is not `t x y z qx qy qz qw`"),
        (
            "1 0 0 0 0 1 0 0 0 0 1 0\n",
            "has no stamps: put one in front of each line, or a file times.txt beside it",
        ),
        ("5 2 0 0 0 0 1 0 0 0 0 1 0\n", "are not a rotation"),
    ],
)
def test_mistakes_are_named(tmp_path, log, text, words):
    path = tmp_path / "gt.txt"
    path.write_text(text)
    with pytest.raises(sfm.LogError, match=words) as caught:
        sfm.open_log(log, ground_truth=path)
    assert str(path) in str(caught.value)


def test_the_command_line_takes_it(tmp_path, log, cli):
    bare = write_log(tmp_path / "bare.mcap")
    path = tum(tmp_path / "gt.txt", stamps=[s - 10**9 for s in STAMPS_NS])
    options = ["--ground-truth", str(path), "--ground-truth-offset", "1", "--ground-truth-frame", "left"]
    out = ["--out", str(tmp_path / "out"), "--json", "-q", "--method", "frame-to-frame"]
    assert '"ground_truth"' in cli("replay", bare, *options, *out).out
    assert "cannot read poses" in cli("replay", bare, "--ground-truth", tmp_path / "none.txt", *out, code=3).err
