"""Surveyed test points of logs/room.mcap, made from its ground truth: in the summary, on the pages, and printed."""

import json
from pathlib import Path

import numpy as np
import pytest

from stream_sfm.cli.main import main
from stream_sfm.recording import open_log
from tests.helpers.places import ROOM
from tests.helpers.surveyed import survey, write_points

FRAMES = 30
STD_PX = 0.1


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = open_log(ROOM)
    truth = log.ground_truth()
    assert truth is not None
    found = survey(log.stereo_rig, truth.world_from_cam[:FRAMES], world="survey", std_px=STD_PX)
    return write_points(tmp_path_factory.mktemp("points") / "points.toml", found)


def arguments(points: Path, out: Path) -> list[str]:
    return [str(ROOM), "--max-frames", str(FRAMES), "--test-points", str(points), "--out", str(out)]


def test_a_replay_is_compared_with_them(points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", *arguments(points, tmp_path)]) == 0
    printed = capsys.readouterr().out
    found = json.loads((tmp_path / "summary.json").read_text())["test_points"]
    assert found["absent"] == 0 and found["tied_to_frame"] == 0 and found["sightings"] > 500
    # the pose is right within fractions of a millimetre, so pixels have the noise of both coordinates, and of the tie
    assert found["image_rms_px"] == pytest.approx(np.sqrt(2) * STD_PX, rel=0.3)
    assert found["image_error_over_sigma"] < 1.2
    # what the pose adds to the error of a triangulated point is small beside that
    assert found["position_rms_m"] < 2 * found["distance_rms_m"]
    assert len(found["by_frame"]) == FRAMES - 1 and len(found["seen"]) == found["sightings"]
    assert f"{found['sightings']} sightings, {found['position_rms_m']:.4f} m RMS in the world" in printed
    page = (tmp_path / "report.html").read_text()
    for title in ("Position in the world (WC)", "Distances between the points (CC)", "Position in the left image"):
        assert title in page
    assert "Frame 0 ties the axes of the survey to the run" in page


def test_methods_are_compared_at_them(points: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    methods = ["--methods", "cross-frame,frame-to-frame"]
    assert main(["compare", *arguments(points, tmp_path), *methods, "--max-frames", "12"]) == 0
    warned = capsys.readouterr()
    assert "test points, cross-frame: " in warned.out and "px RMS in the image" in warned.out
    assert "sightings are in no frame of the run" in warned.err
    content = json.loads((tmp_path / "report.json").read_text())
    for key, method in content["methods"].items():
        summary = json.loads((tmp_path / key / "summary.json").read_text())["test_points"]
        assert {k: v for k, v in summary.items() if k not in ("by_frame", "seen")} == method["test_points"]
    of = [content["methods"][key]["test_points"] for key in ("cross_frame", "frame_to_frame")]
    assert of[0]["distance_rms_m"] == of[1]["distance_rms_m"]  # no pose is part of it
    assert of[0]["image_rms_px"] != of[1]["image_rms_px"]
    page = (tmp_path / "report.html").read_text()
    assert '<section id="test-points">' in page and 'href="#test-points"' in page


def test_a_wrong_file_ends_before_anything_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "points.toml"
    file.write_text("[points]\na = [1, 2]\n")
    assert main(["replay", *arguments(file, tmp_path / "out")]) == 2
    assert str(file) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["replay", str(ROOM), "--mono", "--test-points", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "two cameras" in capsys.readouterr().err
