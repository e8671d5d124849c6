"""Rectification: the rectified pair shows what the physical cameras saw; impossible rigs are refused."""

import numpy as np
import pytest

from stream_sfm.camera.lens import project_into_image, rays_of
from stream_sfm.camera.models import Camera
from stream_sfm.camera.rectification import Rectifier
from stream_sfm.camera.rig import MonoRig, StereoRig
from stream_sfm.camera.settings import SETTINGS
from stream_sfm.errors import ConfigError
from stream_sfm.geometry import se3
from tests.helpers.wall import rig


def test_rectifier_of_a_rectified_pair_touches_nothing() -> None:
    stereo = rig()
    rectifier = Rectifier(stereo)
    image = np.arange(320 * 240, dtype=np.uint32).astype(np.uint8).reshape(240, 320)
    left, right = rectifier.rectify(image, image)
    assert left is image and right is image
    assert rectifier.valid.all()
    assert np.allclose(rectifier.rect_from_cam, np.eye(3))
    assert rectifier.projection.f_px == pytest.approx(260.0)
    assert rectifier.projection.cx_left_px == pytest.approx(stereo.left.K[0, 2])


def test_rectified_rays_agree_with_the_physical_cameras() -> None:
    """A point projected by the physical cameras and one projected by the rectified pair are the same image point."""
    stereo = rig(vergence_rad=0.06)
    rectifier = Rectifier(stereo)
    points = np.random.default_rng(0).uniform((-0.5, -0.5, 2), (0.5, 0.5, 4), (30, 3))
    z = rectifier.projection.project(points @ rectifier.rect_from_cam.T)
    assert np.allclose(z[:, 1], z[:, 3])
    # paint a spot where a physical camera sees a point, rectify it, and look where it lands
    grid_v, grid_u = np.mgrid[:240, :320]
    for side, in_camera in enumerate((points, se3.transform(stereo.right_from_left, points))):
        camera = list(stereo.cameras.values())[side]
        for (u, v), landed in zip(project_into_image(camera, in_camera[:5]), z[:, 2 * side :], strict=False):
            spot = (255 * np.exp(-((grid_u - u) ** 2 + (grid_v - v) ** 2) / 18)).astype(np.uint8)
            moved = rectifier.rectify(spot, spot)[side].astype(float)
            centre = np.array([(moved * grid_u).sum(), (moved * grid_v).sum()]) / moved.sum()
            assert np.allclose(centre, landed[:2], atol=0.15)  # px: the centre of a spot that is resampled


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_rows_of_views_are_those_of_the_cameras_own_images(model: str) -> None:
    """Of images whose grey values are their rows, rectified; NaN where a side is not seen."""
    stereo = rig(vergence_rad=0.06)
    bent = Camera(320, 240, stereo.left.K, (-0.05, 0.01, 0.002, -0.001), model)
    rectifier = Rectifier(StereoRig(bent, bent, stereo.right_from_left))
    own = np.repeat(np.arange(240, dtype=np.uint8)[:, None], 320, axis=1)
    left, right = rectifier.rectify(own, own)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(60, 260, 9), np.arange(60, 180, 9)))
    rows = rectifier.rows_of(np.stack([u, v, u, v], axis=1).astype(float))
    expected = (np.stack([left[v, u], left[v, u], right[v, u], right[v, u]], axis=1) + 0.5) / 240 - 0.5
    assert np.abs(rows - expected).max() < 0.51 / 240  # grey values are whole rows
    one_side = rectifier.rows_of(np.array([[80.0, 90.0, np.nan, np.nan]]))
    assert np.isnan(one_side[0]).tolist() == [False, False, True, True]


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_a_longer_focal_length_moves_views_as_cameras_see_points_that_have_it(model: str) -> None:
    """Of cameras that converge and bend, a thousandth longer: to a hundredth of that; the row is that of the left."""
    stereo, longer = rig(vergence_rad=0.06), 1e-3
    sides = [
        [Camera(320, 240, c.K * [[k], [k], [1]] + np.outer([1, 1, 0], [0, 0, 1]) * (1 - k) * c.K, d, model) for k in ks]
        for c, d, ks in (
            (stereo.left, (-0.05, 0.01, 0.002, -0.001), (1, 1 + longer)),
            (stereo.right, (-0.05, 0.01, 0.002, -0.001), (1, 1 + longer)),
        )
    ]
    rectifier = Rectifier(StereoRig(sides[0][0], sides[1][0], stereo.right_from_left))
    points = np.random.default_rng(0).uniform((-0.8, -0.5, 2), (0.8, 0.5, 4), (40, 3))
    turns = rectifier.rect_from_cam, rectifier.rect_from_cam @ stereo.right_from_left[:3, :3].T
    z_px = rectifier.projection.project(points @ rectifier.rect_from_cam.T)
    moved = rectifier.by_focal(z_px) * longer
    assert (moved[:, 3] == moved[:, 1]).all()
    for side, in_camera in enumerate((points, se3.transform(stereo.right_from_left, points))):
        calibrated, true = sides[side]
        rays = rays_of(calibrated, project_into_image(true, in_camera)) @ turns[side].T
        columns = rectifier.projection.f_px * rays[:, :2] / rays[:, 2:]
        columns += [
            (rectifier.projection.cx_left_px, rectifier.projection.cx_right_px)[side],
            rectifier.projection.cy_px,
        ]
        expected = columns - z_px[:, 2 * side : 2 * side + 2]
        assert np.abs(moved[:, 2 * side] - expected[:, 0]).max() < 0.01 * 320 * longer
        if side == 0:
            assert np.abs(moved[:, 1] - expected[:, 1]).max() < 0.01 * 320 * longer
    assert np.abs(moved[:, 2] - moved[:, 0]).max() > 2 * longer  # far from zero: the middles are apart


def test_exchanged_cameras_are_refused_with_a_cure() -> None:
    stereo = rig()
    with pytest.raises(ConfigError, match="exchange left and right"):
        Rectifier(StereoRig(stereo.right, stereo.left, se3.inverse(stereo.right_from_left)))


@pytest.mark.parametrize(
    "translation, where", [((0, -0.1, 0), "below"), ((0, 0.1, 0), "above"), ((0, 0, -0.1), "in front of")]
)
def test_a_pair_that_is_not_side_by_side_is_refused_for_this_reason(translation, where) -> None:
    camera = rig().left
    pose = se3.from_rotation_translation(np.eye(3), np.array(translation, dtype=float))
    with pytest.raises(ConfigError, match=f"stands 0.100 m {where} the left one, not beside it"):
        Rectifier(StereoRig(camera, camera, pose))


def test_a_lens_that_leaves_next_to_nothing_is_refused() -> None:
    camera = Camera(320, 240, rig().left.K, (100.0, 100.0, 100.0, 100.0))
    with pytest.raises(ConfigError, match="leave no image"):
        _ = Rectifier(StereoRig(camera, camera, rig().right_from_left)).valid


@pytest.mark.parametrize("d", [(0.0, 0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1000.0, 0.0, 0.0), (0.0, 0.0, 1e300, 0.0, 0.0)])
def test_a_lens_without_a_solution_is_refused_and_no_defect(d) -> None:
    """As when k3 stands where p1 belongs: OpenCV finds no ray for a pixel."""
    camera = Camera(320, 240, rig().left.K, d)
    with pytest.raises(ConfigError, match="leave no image: they must be of these cameras, in OpenCV's order"):
        _ = Rectifier(StereoRig(camera, camera, rig().right_from_left)).valid


def test_lens_models_have_the_names_that_others_give_them() -> None:
    k = rig().left.K
    assert Camera(320, 240, k, (0.1, 0, 0, 0), "radtan").distortion_model == "plumb_bob"
    assert Camera(320, 240, k, (0.1, 0, 0, 0), "Fisheye").distortion_model == "equidistant"
    assert Camera(320, 240, k, None).D == ()


def test_fisheye_and_strong_distortion_keep_the_middle() -> None:
    k = np.array([[260.0, 0, 159.5], [0, 260.0, 119.5], [0, 0, 1]])
    lenses = (("equidistant", (0.01, -0.002, 0.0, 0.0)), ("equidistant", ()), ("plumb_bob", (-0.35, 0.15, 0, 0)))
    for model, d in lenses:
        camera = Camera(320, 240, k, d, model)
        rectifier = Rectifier(StereoRig(camera, camera, rig().right_from_left))
        assert rectifier.valid[120, 160]
        assert rectifier.valid.mean() > 0.7
        assert 0.5 * 260 < rectifier.projection.f_px < 259  # a lens that bends is never taken for a pinhole


def test_one_camera_keeps_its_axes_and_gets_a_virtual_right_one() -> None:
    camera = rig().left
    rectifier = Rectifier(MonoRig(camera))
    p = rectifier.projection
    assert p.virtual_right and p.baseline_m == SETTINGS.virtual_baseline and p.cx_left_px == p.cx_right_px
    assert np.array_equal(rectifier.rect_from_cam, np.eye(3))
    image = np.zeros((camera.height, camera.width), np.uint8)
    assert len(rectifier.rectify(image)) == 1
    assert not Rectifier(rig()).projection.virtual_right
