"""Surveyed test points: their file, whose axes they are in, and errors that are what poses and pixels make them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.evaluation.survey_errors import SurveyErrors
from stream_sfm.evaluation.surveyed_points import SurveyedPoints, read_surveyed_points
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array
from stream_sfm.observer import Observer
from stream_sfm.pipeline.surveyed import SurveyCheck
from stream_sfm.types import Trajectory
from tests.helpers.surveyed import survey, write_points

LENS = (-0.2, 0.05, 0.001, -0.0005)
TURNED = se3.from_rotation_translation(
    se3.exp_so3([0.004, -0.05, 0.01]), [-0.2, 0.003, -0.002]
)  # converging cameras
CAMERA = sfm.Camera(640, 480, np.array([[500.0, 0, 322], [0, 501, 237], [0, 0, 1]]), LENS)
RIG = sfm.StereoRig(CAMERA, CAMERA, TURNED)
EXACT = sfm.Config(rig=sfm.RigConfig(exact=True))
PERIOD_NS = 100_000_000


def path(frames: int) -> Array:
    """Forward along an arc, from a place that is not the origin."""
    step = se3.exp([0.01, 0.002, 0.05, 0.002, 0.03, -0.001])
    poses = [se3.exp([3.0, 1.0, -2.0, 0.1, 1.2, -0.3])]
    for _ in range(frames - 1):
        poses.append(poses[-1] @ step)
    return np.array(poses)


def trajectory(world_from_cam: Array, cov: Array | None = None) -> Trajectory:
    stamps = 10**18 + np.arange(len(world_from_cam)) * PERIOD_NS
    return Trajectory(stamps, world_from_cam, cov)


def compared(points: SurveyedPoints, estimate: Trajectory, truth: Trajectory | None = None) -> SurveyErrors:
    found, warnings = SurveyCheck(points, Observer(RIG, EXACT), EXACT).compare({"x": estimate}, truth, None)
    assert not warnings, warnings
    return found["x"]


@pytest.mark.parametrize("world", ["survey", "first camera", "ground truth"])
def test_right_poses_have_no_error_in_whatever_axes_the_points_are(world: str) -> None:
    true = path(12)
    points = survey(RIG, true, world=world)
    estimate = trajectory(se3.inverse(true[0]) @ true, np.tile(1e-8 * np.eye(6), (12, 1, 1)))
    found = compared(points, estimate, trajectory(true))
    assert found.tied_to == (0 if world == "survey" else None)
    assert len(found.frames) > 200 and len(found.pair_frames) > 1000
    # undoing the lens is iterative, to some thousandths of a pixel: at 3 m 0.1 mm
    assert np.abs(found.error_px).max() < 0.02 and np.abs(found.error_m).max() < 1e-3
    assert np.abs(found.pair_error_m).max() < 1e-3


def test_errors_are_as_large_as_their_sigma_says() -> None:
    """Each frame has its own error of the pose; one sighting and one pair of each are independent of the others."""
    frames, std_px = 600, 0.3
    rng = np.random.default_rng(5)
    true = np.tile(np.eye(4), (frames, 1, 1))
    true[1:] = se3.exp(rng.normal(size=(frames - 1, 6)) * 0.02)
    points = survey(RIG, true[:6], std_px=std_px)
    rows = points.point_rows[points.frames == 0][:2]
    assert len(rows) == 2
    left = se3.transform(se3.inverse(true)[:, None], points.positions_m[rows][None, :, None])[:, :, 0].reshape(
        -1, 3
    )
    pixels = [
        np.array([*seen(RIG.left, x[None])[0], *seen(RIG.right, se3.transform(TURNED, x[None]))[0]]) for x in left
    ]
    z = np.array(pixels) + std_px * rng.normal(size=(2 * frames, 4))
    many = replace(
        points,
        point_rows=np.tile(rows, frames),
        frames=np.repeat(np.arange(frames), 2),
        stamps_ns=np.zeros(2 * frames, np.int64),
        left_px=z[:, :2],
        right_px=z[:, 2:],
    )
    half = np.diag([0.004, 0.006, 0.005, 0.002, 0.001, 0.003])
    half[4, 0] = 0.001
    estimate = true @ se3.exp(-rng.normal(size=(frames, 6)) @ half.T)
    found = compared(many, trajectory(estimate, np.tile(half @ half.T, (frames, 1, 1))))
    first = slice(0, None, 2)
    for nees, dof in ((found.nees, 3), (found.nees_px, 2)):
        assert nees[first].mean() == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / frames))
    pairs = (found.pair_error_m / found.pair_sigma_m) ** 2
    assert len(pairs) == frames
    assert pairs.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / frames))
    assert found.figures()["position_error_over_sigma"] == pytest.approx(1, abs=0.1)


def seen(camera: sfm.Camera, points: Array) -> Array:
    from stream_sfm.camera.lens import project_into_image

    return project_into_image(camera, points)


def test_drift_shows_in_the_world_and_in_the_image_but_not_in_distances() -> None:
    true = path(20)
    own = se3.inverse(true[0]) @ true
    drifting = own @ se3.exp(np.arange(20)[:, None] * np.array([0.001, 0, 0, 0, 0.0002, 0]))
    points, right, wrong = survey(RIG, true), trajectory(own), trajectory(drifting)
    figures = compared(points, wrong).figures()
    assert figures["last_position_rms_m"] == pytest.approx(0.019, rel=0.5)
    travelled_m = np.linalg.norm(np.diff(drifting[:, :3, 3], axis=0), axis=1).sum()
    percent = 100 * figures["last_position_rms_m"] / travelled_m
    assert figures["last_position_percent"] == pytest.approx(percent, rel=1e-6)
    assert figures["image_rms_px"] > 2
    assert figures["distance_rms_m"] == pytest.approx(compared(points, right).figures()["distance_rms_m"])
    assert figures["position_error_over_sigma"] is None  # nothing is known about the covariance


def test_stamps_serve_like_frames_and_what_is_in_no_frame_is_counted() -> None:
    true = path(8)
    estimate = trajectory(se3.inverse(true[0]) @ true)
    points = survey(RIG, true)
    stamped = replace(
        points, frames=np.full_like(points.frames, -1), stamps_ns=estimate.stamps_ns[points.frames] + 400_000
    )
    np.testing.assert_array_equal(compared(stamped, estimate).error_px, compared(points, estimate).error_px)
    short = trajectory(estimate.world_from_cam[:7])
    found, warnings = SurveyCheck(points, Observer(RIG, EXACT), EXACT).compare({"x": short}, None, None)
    absent = int((points.frames == 7).sum())
    assert found["x"].absent == absent > 0
    assert warnings == [
        f"test points: {absent} sightings are in no frame of the run: frames count from 0, stamps are those of left "
        "images"
    ]


def test_points_of_one_camera_are_compared_in_the_image_alone() -> None:
    true = path(6)
    points = survey(RIG, true)
    alone = replace(points, right_px=np.full_like(points.right_px, np.nan))
    figures = compared(alone, trajectory(se3.inverse(true[0]) @ true)).figures()
    assert figures["image_rms_px"] < 0.02
    assert figures["position_rms_m"] is None and figures["distance_rms_m"] is None
    assert figures["last_frame"] is None


def test_what_cannot_be_compared_is_said() -> None:
    true = path(6)
    estimate = trajectory(se3.inverse(true[0]) @ true)
    for points, words in (
        (survey(RIG, true, world="ground truth"), "those of the ground truth, and no frame of the run has any"),
        (
            replace(
                survey(RIG, true, world="survey"), right_px=np.full((len(survey(RIG, true).frames), 2), np.nan)
            ),
            "no frame of the run shows 3 points, not on a line, in both images",
        ),
        (replace(survey(RIG, true), frames=survey(RIG, true).frames + 100), "is in a frame of the run"),
    ):
        found, warnings = SurveyCheck(points, Observer(RIG, EXACT), EXACT).compare({"x": estimate}, None, None)
        assert not found and len(warnings) == 1 and words in warnings[0]


def test_points_that_the_rig_cannot_have_seen_are_refused() -> None:
    points = survey(RIG, path(6))
    with pytest.raises(
        sfm.ConfigError, match=r"sighting 0 of 'p\d+': the left pixel .* is outside of the image, wh"
    ):
        SurveyCheck(replace(points, left_px=points.left_px + 2000), Observer(RIG, EXACT), EXACT)
    swapped = replace(points, left_px=points.right_px, right_px=points.left_px)
    with pytest.raises(sfm.ConfigError, match="meet behind the cameras; are they exchanged"):
        SurveyCheck(swapped, Observer(RIG, EXACT), EXACT)


def test_a_file_is_what_it_was_written_from(tmp_path: Path) -> None:
    points = survey(RIG, path(6), world="survey", std_px=0.2)
    read = read_surveyed_points(write_points(tmp_path / "points.toml", points))
    assert (read.names, read.world, read.std_px) == (points.names, "survey", 0.2)
    for name in ("positions_m", "point_rows", "frames", "left_px", "right_px"):
        np.testing.assert_array_equal(getattr(read, name), getattr(points, name))


GOOD = """
std_px = 0.4
[points]
a = [1.0, 2, 3]
[[seen]]
point = "a"
frame = 3
left = [10, 20]
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("std_px = 0.4", "std_pixel = 0.4", r"unknown setting 'std_pixel'; did you mean std_px\?"),
        ("std_px = 0.4", "std_px = 0", "std_px is 0; give the σ of a pixel coordinate, above 0"),
        ("std_px = 0.4", 'world = "hall"', "invalid enum value 'hall' at world"),
        ("a = [1.0, 2, 3]", "a = [1.0, 2]", r"of length 3.* at points\[...\]; a point is name = \[x, y, z\]"),
        ("a = [1.0, 2, 3]", "a = [1.0, nan, 3]", "coordinates must be finite"),
        ('point = "a"', 'point = "b"', r"sighting 0 of 'b': there is no point of this name in \[points\]"),
        ("frame = 3", "", "give its frame, or stamp_ns of its left image; one of the two"),
        ("frame = 3", "frame = 3\nstamp_ns = 4", "one of the two"),
        ("frame = 3", "frame = -3", "whole numbers of 0 or more"),
        ("left = [10, 20]", "left = [10, inf]", "pixels must be finite"),
        ("left = [10, 20]", "", r"missing required field `left` at seen\[0\]"),
        ("[[seen]]", "[seen]", "seen"),
        ("[points]", "[points", "are not TOML"),
    ],
)
def test_errors_in_a_file_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    file = tmp_path / "points.toml"
    file.write_text(GOOD)
    assert read_surveyed_points(file).std_px == 0.4
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(sfm.ConfigError, match=words) as caught:
        read_surveyed_points(file)
    assert str(file) in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(sfm.ConfigError, match=r"cannot read test points .*none\.toml: No such file"):
        read_surveyed_points(tmp_path / "none.toml")
