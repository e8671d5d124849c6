"""Every profile, encoding and container gives the same frames; what is lost on the way is counted."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from stream_sfm import LogError, Selection, StereoRig, open_log
from stream_sfm.logs.recording.ground_truth import DepthImages
from stream_sfm.logs.recording.topics import choose_calibration, choose_pair
from tests.helpers.stereo_logs import (
    BASELINE_M,
    CONTAINERS,
    PERIOD_NS,
    START_NS,
    LogWriter,
    Spec,
    scene,
    write_image,
    write_log,
)


def check_frames(path, **kwargs):
    log = open_log(path, **kwargs)
    frames = list(log.frames())
    assert [f.stamp_ns for f in frames] == [START_NS + n * PERIOD_NS for n in range(12)]
    for n, frame in enumerate(frames):
        for side, image in enumerate((frame.left, frame.right)):
            assert image.dtype == np.uint8 and image.flags.c_contiguous
            np.testing.assert_array_equal(image, scene(n, side))
    assert log.stats.complete and log.stats.paired == 12 and not log.stats.warnings
    assert log.rig.baseline_m == pytest.approx(BASELINE_M)
    return log


def both_in_one(path, axis, encoding="png", container="zstd"):
    """A log with one topic, whose images hold both sides, and the rig of one of them."""
    log = LogWriter(path, **CONTAINERS[container])
    for n in range(12):
        both = np.concatenate([scene(n, 0), scene(n, 1)], axis)
        write_image(log, "ros2", "/stereo/image_raw", START_NS + n * PERIOD_NS, both, encoding)
    log.close()
    return open_log(write_log(path.with_name("pair.mcap"))).rig


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("encoding", "container"), [("png", "zstd"), ("mono8", "no index"), ("bgr8", "unchunked")])
def test_one_topic_whose_images_hold_both_sides(path, axis, encoding, container):
    rig = both_in_one(path, axis, encoding, container)
    check_frames(path, calibration=rig)
    (path.parent / "c.toml").write_text(rig.to_toml())
    check_frames(path, calibration=path.parent / "c.toml")


def test_one_topic_of_one_camera_is_still_refused(path):
    rig = both_in_one(path, 1)
    with pytest.raises(LogError, match="holds images of one camera only"):
        open_log(path)
    other = StereoRig(
        *(replace(camera, width=camera.width // 2) for camera in (rig.left, rig.right)), rig.right_from_left
    )
    with pytest.raises(LogError, match="holds images of one camera only"):
        open_log(path, calibration=other)


# device -> (left images, left calibration, other image topics), left and right named alike
DEVICES = {
    "EuRoC": ("/cam0/image_raw", "/cam0/camera_info", ()),
    "stereo_image_proc": (
        "/stereo/left/image_rect", "/stereo/left/camera_info",
        ("/stereo/left/image_raw", "/stereo/right/image_raw", "/stereo/left/image_rect_color",
         "/stereo/right/image_rect_color", "/stereo/left/image_mono", "/stereo/right/image_mono", "/stereo/disparity"),
    ),
    "image_transport": (
        "/stereo/left/image_rect/compressed", "/stereo/left/camera_info",
        ("/stereo/left/image_rect/compressedDepth", "/stereo/right/image_rect/compressedDepth"),
    ),
    "RealSense": (
        "/camera/infra1/image_rect_raw", "/camera/infra1/camera_info",
        ("/camera/color/image_raw", "/camera/depth/image_rect_raw", "/camera/aligned_depth_to_infra1/image_raw"),
    ),
    "RealSense, ROS 2": ("/camera/camera/infra1/image_rect_raw", "/camera/camera/infra1/camera_info", ()),
    "RealSense Viewer": (
        "/device_0/sensor_0/Infrared_1/image/data", "/device_0/sensor_0/Infrared_1/info/camera_info",
        ("/device_0/sensor_0/Depth_0/image/data", "/device_0/sensor_1/Color_0/image/data"),
    ),
    "RealSense T265": ("/camera/fisheye1/image_raw", "/camera/fisheye1/camera_info", ()),
    "ZED": (
        "/zed/zed_node/left/image_rect_color", "/zed/zed_node/left/camera_info",
        ("/zed/zed_node/left_raw/image_raw_color", "/zed/zed_node/right_raw/image_raw_color",
         "/zed/zed_node/rgb/image_rect_color", "/zed/zed_node/depth/depth_registered",
         "/zed/zed_node/confidence/confidence_map"),
    ),
    "ZED, grey": (
        "/zed/zed_node/left_gray/image_rect_gray", "/zed/zed_node/left_gray/camera_info",
        ("/zed/zed_node/left/image_rect_color", "/zed/zed_node/right/image_rect_color"),
    ),
    "ZED, 2025": (
        "/zed/zed_node/left/gray/rect/image", "/zed/zed_node/left/gray/rect/camera_info",
        ("/zed/zed_node/left/color/rect/image", "/zed/zed_node/right/color/rect/image"),
    ),
    "OAK": ("/oak/left/image_rect", "/oak/left/camera_info", ("/oak/rgb/image_raw", "/oak/stereo/image_raw")),
    "depthai": ("/depthai/left/image_raw", "/depthai/left/camera_info", ()),
    "MultiSense": (
        "/multisense/left/image_rect", "/multisense/left/image_rect/camera_info",
        ("/multisense/left/image_mono", "/multisense/right/image_mono", "/multisense/left/depth"),
    ),
    "Isaac": ("/front_stereo_camera/left/image_raw", "/front_stereo_camera/left/camera_info", ()),
    "KITTI": ("/kitti/camera_gray_left/image_raw", "/kitti/camera_gray_left/camera_info",
              ("/kitti/camera_color_left/image_raw", "/kitti/camera_color_right/image_raw")),
    "short": ("/left_image", "/left_camera_info", ()),
    "one word": ("/leftcam/image", "/leftcam/info", ()),
}  # fmt: skip


def other_side(topic: str) -> str:
    for left, right in (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"), ("fisheye1", "fisheye2"),
                        ("Infrared_1", "Infrared_2")):  # fmt: skip
        topic = topic.replace(left, right)
    return topic


@pytest.mark.parametrize("device", DEVICES)
def test_usual_topic_names(device):
    left, info, others = DEVICES[device]
    topics, infos = (left, other_side(left)), (info, other_side(info))
    choice = choose_pair(Path("log"), dict.fromkeys((*topics, *others), 1))
    assert (choice.left, choice.right) == topics
    inside = tuple(info.rsplit("/", 1)[0] + "/" for info in infos)
    of_others = {topic.rsplit("/", 1)[0] + "/camera_info" for topic in others if not topic.startswith(inside)}
    assert [choose_calibration(topic, side, {*infos, *of_others}) for side, topic in enumerate(topics)] == list(infos)


def test_selection_of_frames(path):
    log = open_log(write_log(path))
    numbers = lambda **k: [(f.stamp_ns - START_NS) // PERIOD_NS for f in log.frames(Selection(**k))]  # noqa: E731
    assert numbers(start_s=0.3, end_s=0.6) == [3, 4, 5, 6]
    assert numbers(stride=4) == [0, 4, 8]
    assert numbers(max_frames=2, start_s=0.5) == [5, 6]
    with pytest.raises(LogError, match=r"no frame lies after 50 s; the frames read span 1\.10 s"):
        numbers(start_s=50)
    assert (log.expected_frames, log.duration_s) == (12, pytest.approx(1.1))


def test_bytes_are_handed_on_as_recorded(path):
    log = open_log(write_log(path))
    for frame in log.frames(Selection(max_frames=3)):
        pair = frame.recorded
        assert pair.stamp_ns == frame.stamp_ns
        assert frame.pictures == (pair.left.data, pair.right.data)
        again = cv2.imdecode(np.frombuffer(pair.left.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(again, frame.left)


def test_ground_truth_and_depth(path):
    log = open_log(write_log(path, Spec(truth=True)))
    truth = log.ground_truth()
    np.testing.assert_allclose(truth.world_from_cam[:, 0, 3], 0.05 * np.arange(12), atol=1e-12)
    few = log.ground_truth(until_ns=int(truth.stamps_ns[3]) - 10**9)  # and those of a second more
    np.testing.assert_array_equal(few.stamps_ns, truth.stamps_ns[:4])
    stamp, depth = next(log.depths())
    assert stamp == START_NS and depth.dtype == np.float32
    assert np.isnan(depth[0, 0]) and depth[5, 5] == np.float32(2.0)
    assert open_log(write_log(path)).ground_truth() is None


def test_the_depth_image_of_a_stamp_is_found_while_stamps_ascend():
    """One image is held at a time, and none read ahead of need."""
    stamps_ns, read = (0, 500, 1_000_000_000, 3_000_000_000), []

    def images():
        for n, stamp in enumerate(stamps_ns):
            read.append(stamp)
            yield stamp, np.full((2, 2), n, np.float32)

    depths = DepthImages(images())
    asked = [500_000_000, 999_000_001, 1_000_000_000, 1_001_000_000, 1_001_000_001, 3_000_000_000, 9_000_000_000]
    for stamp, expected, last in zip(asked, [None, 2, 2, 2, None, 3, None], [2, 2, 2, 2, 3, 3, 3], strict=True):
        found = depths.at(stamp)
        assert (None if found is None else int(found[0, 0])) == expected
        assert read == list(stamps_ns[: last + 1])


def test_topics_can_be_named(path):
    write_log(path, Spec(topics=("/a/image", "/b/image"), info_topics=("/a/info", "/b/info")))
    check_frames(path, left="/a/image", right="/b/image")
    with pytest.raises(LogError, match=r": /c is not an image topic.*/a/image, /b/image"):
        open_log(path, left="/c")
    with pytest.raises(LogError, match="both /a/image"):
        open_log(path, left="/a/image", right="/a/image")


def test_a_topic_that_is_there_in_its_compressed_form_only_is_found(path):
    topics = ("/stereo/a/image_raw/compressed", "/stereo/b/image_raw/compressed")
    write_log(path, Spec(topics=topics, info_topics=("/stereo/a/camera_info", "/stereo/b/camera_info")))
    log = check_frames(path, left="/stereo/a/image_raw", right="/stereo/b/image_raw")
    assert (log.left_topic, log.right_topic) == topics
    assert open_log(path, left="/stereo/b/image_raw", mono=True).left_topic == topics[1]


def test_several_pairs_are_the_users_choice():
    pairs = [f"/{place}/{side}/image" for place in ("front", "rear") for side in ("left", "right")]
    with pytest.raises(LogError, match="/front/left/image and /front/right/image; /rear"):
        choose_pair(Path("log"), dict.fromkeys(pairs, 1))
