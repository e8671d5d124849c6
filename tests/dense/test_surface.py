"""Dense stereo and surfaces: they match the truth within σ, edges stay open, and files can be read."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from stream_sfm import Camera, StereoRig, import_images, open_log
from stream_sfm.camera.rectification import Rectifier
from stream_sfm.dense import voxels
from stream_sfm.dense.disparity import DenseStereo, DisparityMap, refine
from stream_sfm.dense.fusion import Fusion
from stream_sfm.dense.mesh import Mesh, mesh_of_frame, write_ply
from stream_sfm.dense.rules import DenseRules
from stream_sfm.dense.surface import surface
from stream_sfm.evaluation.structure import structure_errors
from stream_sfm.geometry import se3
from stream_sfm.geometry.stereo import StereoProjection
from tests.helpers.places import ROOM
from tests.helpers.wall import Wall, rig

PAIR = StereoProjection(200.0, 79.5, 70.5, 59.5, 0.2, 160, 120)  # its infinity lies at a disparity of 9 px
GREY = np.full((120, 160, 3), 128, np.uint8)


def texture(height: int, width: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(height, width))
    soft = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return 128 + 40 * soft / soft.std()


def shifted(image: np.ndarray, disparity_px: float) -> np.ndarray:
    """What the right camera sees of a frontal texture, disparity in pixels of the images."""
    matrix = np.array([[1, 0, -disparity_px], [0, 1, 0.0]])
    return cv2.warpAffine(image, matrix, image.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def noisy(image: np.ndarray, rng: np.random.Generator, std: float) -> np.ndarray:
    return np.clip(np.rint(image + rng.normal(scale=std, size=image.shape)), 0, 255).astype(np.uint8)


def plane_map(depth_m: np.ndarray | float, std_px: float = 0.1) -> DisparityMap:
    disparity = np.broadcast_to(PAIR.f_px * PAIR.baseline_m / np.asarray(depth_m), (120, 160)).astype(np.float32)
    return DisparityMap(disparity.copy(), np.full((120, 160), std_px, np.float32), 0.0)


@pytest.mark.parametrize("vergence_rad", [0.0, 0.05])
def test_a_slanted_wall_is_where_it_is_and_sigma_says_how_well(vergence_rad):
    stereo, wall = rig(vergence_rad), Wall(3)
    left = wall.image(stereo.left, np.eye(4), noise=6)
    right = wall.image(stereo.right, se3.inverse(stereo.right_from_left), noise=6)
    rectifier = Rectifier(stereo)
    rules = DenseRules(std_bias_px=0.0)  # these images have no error but noise
    found = DenseStereo(rectifier.projection, rules, rectifier.valid).match(*rectifier.rectify(left, right))
    assert np.isfinite(found.disparity_px).mean() > 0.85  # the rest is what the right camera does not see
    picture = np.zeros((*found.disparity_px.shape, 3), np.uint8)
    mesh = mesh_of_frame(rectifier.projection, found, picture, 1.0)
    points = mesh.vertices.astype(float) @ rectifier.rect_from_cam
    normal, offset = wall.world_from_wall[:3, 2], wall.world_from_wall[:3, 2] @ wall.world_from_wall[:3, 3]
    length = np.linalg.norm(points, axis=1)
    along_ray = (points @ normal - offset) / (points @ normal / length)
    ratio = np.abs(along_ray) / mesh.std_m
    assert np.median(np.abs(along_ray)) < 0.02  # a tenth of a pixel is 17 mm here
    assert 0.45 < np.median(ratio) < 1.0  # 0.67 if consistent; neighbours share their noise
    assert np.percentile(ratio, 95) < 2.5  # 1.96 if consistent
    towards_camera = np.sign(-offset) * normal @ rectifier.rect_from_cam.T
    assert np.median(mesh.normals @ towards_camera) > 0.9  # noise of neighbouring pixels tilts their triangles


def test_sigma_of_the_subpixel_step_is_that_of_monte_carlo():
    """30 trials of the same scene with other noise, a disparity between two whole pixels.

    That smoothed noise is shared by 4π smoothing² pixels is exact for coarse texture and generous for fine one.
    """
    scene, true = texture(120, 160, 2), 21.4
    rng = np.random.default_rng(3)
    rules = DenseRules(std_start_px=100.0)  # from the images alone, as σ says
    inner = (slice(20, 100), slice(40, 140))
    errors, claimed = [], []
    for _ in range(30):
        left, right = noisy(scene, rng, 4), noisy(shifted(scene, true), rng, 4)
        start = np.full(scene.shape, np.float32(np.rint(true)))
        disparity, std = refine(left, right, start, rules)
        errors.append(disparity[inner] - true)
        claimed.append(std[inner])
    scatter, sigma = np.std(errors, axis=0), np.mean(claimed, axis=0)
    assert 0.65 < np.median(scatter / sigma) < 1.1  # 1 is exact; see above
    assert abs(np.mean(errors)) < 0.02  # no preference for whole pixels


def test_a_step_is_not_bridged_and_nothing_floats_between():
    near, far = 40.0 / 24, 40.0 / 10  # disparities of 24 and 10 px, seen 9 px further apart in the images
    rng = np.random.default_rng(5)
    front, back = texture(120, 160, 6), texture(120, 160, 7)
    left, right = back.copy(), shifted(back, 10 + 9)
    left[30:90, 70:120] = front[30:90, 70:120]
    right[30:90, 70 - 33 : 120 - 33] = front[30:90, 70:120]
    stereo = DenseStereo(PAIR, DenseRules(), np.ones(left.shape, bool))
    found = stereo.match(noisy(left, rng, 1), noisy(right, rng, 1))
    mesh = mesh_of_frame(PAIR, found, GREY, 1.0)
    depths = mesh.vertices[:, 2]
    on_near, on_far = np.abs(depths - near) < 0.1, np.abs(depths - far) < 0.4
    assert on_near.sum() > 2000 and on_far.sum() > 5000  # of 3000 and 16 200, less what windows at edges lose
    assert (on_near | on_far).mean() > 0.995  # a few mismatches are too small a patch to be recognised
    assert np.ptp(depths[mesh.faces], axis=1).max() < 0.5 < far - near  # no triangle joins the two
    hidden = found.disparity_px[35:85, 58:68]  # of the background, seen by the left camera alone
    assert np.isnan(hidden).mean() > 0.7  # its rim is matched as far as the windows reach


def test_a_sphere_comes_out_whole():
    grid = np.stack(np.meshgrid(*[np.arange(-14, 15)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    keys = np.sort(voxels.keys_of(grid + 0.5, 1.0))
    cells = voxels.cells_of(keys)
    radius = np.linalg.norm(cells, axis=1)
    points, faces, normals, attributes = voxels.isosurface(keys, radius - 10.3, radius[:, None])
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert mesh.is_watertight
    # Positive: faces look outwards. Chords of one voxel at a radius of ten cut off 1 %.
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 10.3**3, rel=0.02)
    outwards = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert np.einsum("ni,ni->n", outwards, normals).min() > 0.99  # within 8°, one voxel at that radius
    assert np.abs(attributes[:, 0] - 10.3).max() < 1  # voxels


RULES = DenseRules()


def fused(frames: int, cov_position: np.ndarray, voxel_m: float, rules: DenseRules = RULES) -> tuple[Fusion, Mesh]:
    """A frontal wall 2 m ahead, seen with noise of 0.2 px from a camera that moves sideways."""
    rng, fusion = np.random.default_rng(8), Fusion(PAIR, rules, voxel_m)
    for i in range(frames):
        true = plane_map(2.0, std_px=0.2)
        smooth = cv2.GaussianBlur(rng.normal(size=true.disparity_px.shape), (0, 0), 3)
        noise = 0.2 * smooth / smooth.std()
        found = DisparityMap(true.disparity_px + noise.astype(np.float32), true.std_noise_px, 0.0)
        fusion.add(found, GREY, se3.exp([0.01 * i, 0, 0, 0, 0, 0]), cov_position)
    return fusion, fusion.mesh()


def test_a_fused_wall_gets_better_with_frames_and_sigma_says_so():
    few, many = (fused(n, np.zeros((3, 3)), voxel_m=0.02)[1] for n in (4, 16))
    for mesh, limit in ((few, 0.010), (many, 0.006)):  # one frame: 0.2 px is 20 mm
        error = np.abs(mesh.vertices[:, 2] - 2.0)
        assert np.median(error) < limit
        assert 0.4 < np.median(error / mesh.std_m) < 1.1  # 0.67 if consistent
        assert np.median(mesh.normals[:, 2]) < -0.9  # towards the camera, except for noise
    assert np.median(few.std_m) / np.median(many.std_m) == pytest.approx(2, rel=0.1)  # √(16/4)


def test_what_frames_share_does_not_average_out():
    cov = np.diag([0, 0, 0.03**2])
    _, mesh = fused(16, cov, voxel_m=0.02)
    assert np.median(mesh.std_m) == pytest.approx(0.03, rel=0.05)  # noise adds 5 mm in square


def test_voxels_stay_within_their_number():
    fusion, mesh = fused(4, np.zeros((3, 3)), 0.01, DenseRules(max_voxels=10_000))
    assert fusion.voxel_m == pytest.approx(0.04)  # 1.6 m × 1.2 m, five layers
    assert len(fusion) <= 10_000
    assert len(mesh.faces) > 500  # of 2400 triangles of 4 cm
    assert np.median(np.abs(mesh.vertices[:, 2] - 2.0)) < 0.02  # half a voxel


def test_ply_is_read_back_by_another_library_and_a_name_cannot_add_lines_to_its_header(tmp_path: Path):
    colours = np.random.default_rng(9).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    mesh = mesh_of_frame(PAIR, plane_map(2.0), colours, 1.0)
    write_ply(tmp_path / "a.ply", mesh, "log\nelement vertex 99\r\n: axes")
    assert b"\ncomment log\\nelement vertex 99\\r\\n: axes\n" in (tmp_path / "a.ply").read_bytes()
    back = trimesh.load(tmp_path / "a.ply", process=False)
    np.testing.assert_array_equal(back.vertices.astype(np.float32), mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_array_equal(back.visual.vertex_colors[:, :3], mesh.colours)
    np.testing.assert_allclose(back.vertex_normals, mesh.normals, atol=1e-6)
    np.testing.assert_array_equal(back.metadata["_ply_raw"]["vertex"]["data"]["std_m"].ravel(), mesh.std_m)
    assert not (tmp_path / "a.ply.part").exists()


def test_room_against_its_depth():
    log = open_log(ROOM)
    mesh = surface(log, 0).mesh
    points = mesh.vertices.astype(float)
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    cov = mesh.std_m.astype(float)[:, None, None] ** 2 * ray[:, :, None] * ray[:, None, :]
    found = structure_errors(log.rig.left, points, cov, next(log.depths())[1])
    ratio = np.abs(found.errors_m) / found.sigmas_m
    assert len(found.errors_m) > 120_000  # of 196 608 pixels
    assert np.median(np.abs(found.errors_m)) < 0.02  # measured 0.014; a tenth of a pixel is 28 mm at 4.3 m
    assert 0.3 < np.median(ratio) < 0.8  # 0.67 if consistent; σ has a part for errors that a render does not have
    assert np.percentile(ratio, 95) < 2.4  # 1.96 if consistent


def colour_log(path: Path, bgr: np.ndarray) -> Path:
    """A log of one frame: this image in both cameras, the right one shifted by 12 px."""
    height, width = bgr.shape[:2]
    camera = Camera(width, height, np.array([[200.0, 0, width / 2], [0, 200.0, height / 2], [0, 0, 1]]))
    calibration, sides = path.with_suffix(".toml"), {"l.png": bgr, "r.png": np.roll(bgr, -12, axis=1)}
    calibration.write_text(StereoRig(camera, camera, se3.exp([-0.2, 0, 0, 0, 0, 0])).to_toml())
    for name, image in sides.items():
        cv2.imwrite(str(path.with_name(name)), image)
    import_images(*(str(path.with_name(name)) for name in sides), calibration, path)
    return path


def test_colours_are_those_of_the_camera(tmp_path: Path):
    grey = np.clip(texture(120, 160, 11), 0, 255)
    orange = np.stack([0.1 * grey, 0.5 * grey, grey], axis=-1).astype(np.uint8)  # blue, green, red
    log = open_log(colour_log(tmp_path / "c.mcap", orange))
    red, green, blue = surface(log, 0).mesh.colours.mean(axis=0)
    assert green == pytest.approx(0.5 * red, rel=0.03) and blue == pytest.approx(0.1 * red, rel=0.1)  # whole levels


def test_surface_writes_a_mesh(wall_log: Path, tmp_path: Path, cli):
    said = cli("surface", wall_log, "--out", tmp_path / "a.ply", "--all", "--max-frames=5", "--json").json
    assert said["complete"] and said["frames"] == {"read": 5, "used": 5} and said["voxel_m"] > 0
    mesh = trimesh.load(tmp_path / "a.ply", process=False)
    assert len(mesh.vertices) == said["vertices"] > 1000  # of 76 800 pixels
    plane = Wall(5).world_from_wall
    apart = (mesh.vertices - plane[:3, 3]) @ plane[:3, 2]
    assert np.median(np.abs(apart)) < 0.01  # a tenth of a pixel is 17 mm in one frame


def test_a_cut_log_still_gives_a_surface_and_3(wall_log: Path, tmp_path: Path, cli):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(wall_log.read_bytes()[: wall_log.stat().st_size * 7 // 10])
    said = cli("surface", cut, "--out", tmp_path / "a.ply", "--all", code=3)
    assert "read in part only" in said.err and "frames" in said.out
    assert len(trimesh.load(tmp_path / "a.ply", process=False).faces) > 1000  # of 76 800 pixels
    said = cli("surface", cut, "--out", tmp_path / "b.ply", "--frame", "11", code=3)
    assert "frame 11 could not be read" in said.err


@pytest.mark.parametrize(
    "arguments, code, says",
    [
        (["--frame", "12"], 2, "has no frame 12: the last one is 11"),
        (["--frame", "-1"], 2, "a whole number of at least 0"),
        (["--frame", "1", "--all"], 2, "exclude each other"),
        (["--out", "surface.obj"], 2, "must end in .ply"),
        (["--out", "nowhere/surface.ply"], 3, "the folder nowhere does not exist"),
    ],
)
def test_wrong_use_is_reported_and_nothing_written(arguments, code, says, wall_log, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    said = cli("surface", wall_log, "--out", "a.ply", *arguments, code=code)
    assert says in said.err and said.out == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("which", [["--frame", "0"], ["--all"]])
def test_nothing_to_be_seen_is_3_with_what_to_do(which: list[str], tmp_path: Path, cli):
    log = colour_log(tmp_path / "black.mcap", np.zeros((120, 160, 3), np.uint8))
    said = cli("surface", log, "--out", tmp_path / "a.ply", *which, code=3).err
    assert "black.mcap" in said and "no surface was found" in said and "inspect" in said
    assert not (tmp_path / "a.ply").exists()
