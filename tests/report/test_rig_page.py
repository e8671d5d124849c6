"""The page of a rig, from replays of a small log, as `inspect --report` writes it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stream_sfm.camera.refinement import LENS_TERMS, Refinement
from stream_sfm.config import Config
from stream_sfm.logs.recording.stereo_log import open_log
from stream_sfm.report.motions import MOTIONS
from stream_sfm.report.rig_page import over_image, render_rig
from stream_sfm.rig_model.terms import TERMS
from stream_sfm.run.looks import calibrations, look
from tests.helpers.wall_log import write_wall_log

CHOSEN = {"left": None, "right": None, "calibration": None, "rate_hz": None}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_wall_log(tmp_path_factory.mktemp("page") / "wall.mcap", n=13, times=2)


def test_a_page_has_maps_terms_and_motions_of_each_calibration(log: Path, tmp_path: Path, cli) -> None:
    rig = open_log(log).stereo_rig
    n = len(LENS_TERMS)
    refined = tmp_path / "refined.toml"
    refined.write_text(replace(rig, refinement=Refinement(np.zeros(n), 0.01 * np.eye(n))).to_toml())
    page = tmp_path / "rig.html"
    text = cli("inspect", log, "--calibration", refined, "--report", page).out.splitlines()[-1]
    html = page.read_text()
    assert "<h2>Terms, before</h2>" in html and "<h2>Terms, after</h2>" in html
    assert html.count("<svg") == 6  # rows, disparity and coverage of both
    assert all(html.count(f"{term}, ") >= 2 for term in TERMS) and all(name in html for name, _, _ in MOTIONS)
    assert text.removeprefix("calibration: ").split(";")[0] in html


def test_without_a_refinement_there_is_one_run_and_equal_runs_give_equal_bytes(log: Path) -> None:
    pages = []
    for _ in range(2):
        ((title, rig),) = calibrations(str(log), CHOSEN)
        run = look(open_log(log, calibration=rig), Config(), None)
        assert run.seen.sum() > 100 and title == "calibration"
        pages.append(render_rig("log", [run.as_run(title)], Config()))
    assert pages[0] == pages[1] and "<h2>Terms</h2>" in pages[0]


def test_before_a_refinement_is_the_calibration_of_the_log(log: Path) -> None:
    rig = open_log(log).stereo_rig
    k = rig.left.K.copy()
    k[0, 0] += 1.0
    given = replace(rig, left=replace(rig.left, K=k))
    (_, before), (_, after) = calibrations(str(log), CHOSEN | {"calibration": given})
    assert before.to_toml() == rig.to_toml() and after.to_toml() == given.to_toml()


def test_a_map_is_pale_where_its_uncertainty_is_large() -> None:
    values, std = np.array([[2.0, -2.0, 1.0]]), np.array([[0.1, 4.0, 0.1]])
    drawn = over_image("map", values, std, "px")
    assert re.findall(r"--(c\d)\)\" fill-opacity=\"([\d.]+)", drawn) == [
        ("c1", "1.00"),
        ("c2", "0.50"),
        ("c1", "0.50"),
    ]
    assert "−2.00" in drawn
