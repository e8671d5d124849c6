"""Masks: there are no points in black parts of either image; files that do not fit are refused."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.rig import masked_by
from stream_sfm.cli.main import main
from stream_sfm.places.keyframes import _features
from stream_sfm.report.charts import masks
from tests.helpers.places import ROOM
from tests.helpers.wall import Wall, camera_path, rig

FRAMES = 12
BONNET_ROW = 160  # of 240: below it both cameras see the robot itself, which does not move in their images


def bonnet() -> np.ndarray:
    """A texture (h, w) that has a corner wherever one is sought."""
    return np.asarray(cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (240, 320), np.uint8), (0, 0), 2))


def frames() -> list[sfm.StereoFrame]:
    """A wall behind the robot's own bonnet, seen by both cameras as if 2 m away."""
    texture, found = cv2.equalizeHist(bonnet()), []
    for frame in Wall(4).frames(rig(), camera_path(FRAMES)):
        left, right = (image.copy() for image in frame.images)
        left[BONNET_ROW:], right[BONNET_ROW:, :-26] = texture[BONNET_ROW:], texture[BONNET_ROW:, 26:]
        found.append(replace(frame, left=left, right=right))
    return found


def mask(rows: slice = slice(BONNET_ROW, None), columns: slice = slice(None)) -> np.ndarray:
    seen = np.ones((240, 320), bool)
    seen[rows, columns] = False
    return seen


def png(grey: np.ndarray) -> bytes:
    return cv2.imencode(".png", grey.astype(np.uint8))[1].tobytes()


def views(engine: sfm.Engine) -> tuple[np.ndarray, list[sfm.FrameEstimate]]:
    """All views (n, 4) of a run, in rectified pixels, and its estimates."""
    found, estimates = [], []
    for frame in frames():
        estimates.append(engine.step(frame))
        assert engine.observations is not None
        found.append(engine.observations.z_px)
    return np.concatenate(found), estimates


def test_no_point_is_on_the_robot_itself_and_the_pose_is_the_cameras() -> None:
    errors_m = {}
    for masked in (False, True):
        engine = sfm.Engine(rig().masked(mask(), mask()) if masked else rig())
        z_px, estimates = views(engine)
        true = camera_path(FRAMES)[-1]
        errors_m[masked] = np.linalg.norm(estimates[-1].world_from_cam[:3, 3] - true[:3, 3])
        below = BONNET_ROW - engine.config.frontend.window_radius_px  # of a patch that reaches the bonnet
        on_robot = (z_px[:, 1] > below) | (z_px[:, 3] > below)
        assert len(z_px) > 500 and on_robot.any() != masked
    assert errors_m[True] < 0.01


def test_the_right_mask_leaves_views_of_the_left_camera_alone() -> None:
    """Where the right camera alone sees the robot, points are matched nowhere near, and others are as many as ever."""
    columns = slice(100, 180)
    engine = sfm.Engine(rig().masked(mask(), mask(slice(None), columns)))
    z_px, estimates = views(engine)
    right = z_px[np.isfinite(z_px[:, 2])]
    assert not ((right[:, 2] > 100) & (right[:, 2] < 179)).any() and len(right) > 500
    without = views(sfm.Engine(rig()))[0]
    assert ((without[:, 2] > 100) & (without[:, 2] < 179)).sum() > 200  # so the test above can fail
    assert estimates[-1].status == sfm.Status.OK


def test_masks_are_read_from_files_and_named_in_the_configuration(tmp_path: Path) -> None:
    paths = [tmp_path / "left.png", tmp_path / "right.png"]
    for path in paths:
        cv2.imwrite(str(path), 255 * mask().astype(np.uint8))
    config = sfm.Config(mask_left=str(paths[0]), mask_right=str(paths[1]))
    by_file, by_array = sfm.Engine(rig(), config), sfm.Engine(rig().masked(mask(), mask()))
    for frame in frames():
        one, other = by_file.step(frame), by_array.step(frame)
        assert np.array_equal(one.world_from_cam, other.world_from_cam)
    assert "33% masked" in repr(by_file.rig)
    assert sfm.read_config(None, [f"mask_left={paths[0]}"]).mask_left == str(paths[0])
    mono = sfm.MonoRig(rig().left).masked(paths[0])
    assert mono.left.mask is not None and not mono.left.mask[-1].any()


def test_the_command_line_and_the_viewer_and_the_page_have_them(tmp_path: Path) -> None:
    log = sfm.open_log(ROOM)
    seen = np.ones((log.rig.left.height, log.rig.left.width))
    seen[300:] = 0
    for name in ("left.png", "right.png"):
        (tmp_path / name).write_bytes(png(255 * seen))
    paths, out, rrd = (
        [str(tmp_path / name) for name in ("left.png", "right.png")],
        tmp_path / "run",
        tmp_path / "a.rrd",
    )
    options = ["--max-frames", "3", "-q", "--out", str(out), "--rrd", str(rrd)]
    assert main(["replay", str(ROOM), "--mask", *paths, *options]) == 0
    config = sfm.read_config(out / "config.toml")
    assert [config.mask_left, config.mask_right] == paths
    assert b"/left/mask" in rrd.read_bytes() and b"/right/mask" in rrd.read_bytes()
    left, right = masks(masked_by(config, log.rig))
    assert "mask of the left camera, 22 % of its image" in left and "mask of the right camera" in right


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot read the mask"),
        (b"GIF89a", "is not a PNG"),
        (png(np.ones((10, 20))), "is 20×10, but the images of its camera are 320×240"),
        (png(np.zeros((240, 320))), "leaves no pixel"),
        (png(np.ones((240, 320)))[:40], "is damaged"),
    ],
)  # fmt: skip
def test_files_that_are_no_masks_of_these_images_are_refused(tmp_path: Path, content: bytes | None, said: str) -> None:
    path = tmp_path / "mask.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(sfm.ConfigError, match=said):
        sfm.Engine(rig(), sfm.Config(mask_right=str(path)))


def test_masks_that_do_not_fit_are_refused() -> None:
    with pytest.raises(sfm.ConfigError, match=r"has shape \(24, 32\)"):
        rig().masked(np.ones((24, 32)))
    with pytest.raises(sfm.ConfigError, match="leaves hardly any of its image"):
        sfm.Engine(rig().masked(mask(slice(2, None))))


def test_places_are_not_described_by_the_robot() -> None:
    """A feature of the robot would be seen again at every place."""
    engine = sfm.Engine(rig().masked(mask(), mask()))
    z_px, _ = views(engine)
    last = frames()[-1]
    for valid, on_robot in ((mask(), False), (np.ones((240, 320), bool), True)):
        px = _features(last.images, engine.observer.projection, z_px[-100:], valid)[0]
        assert len(px) and (px[:, 1] > BONNET_ROW).any() == on_robot
