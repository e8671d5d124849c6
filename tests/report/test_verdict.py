"""The verdict on a calibration: what fits, what is corrected, what is wrong, and what cannot be judged."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.frontend.learnt.rows import Rows
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.report.calibration import describe
from stream_sfm.report.verdict import UNSEEN, judged, rows_warning, verdict
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.terms import DELAY, FOCAL, TERMS, effects_of_turn

P = StereoProjection(300.0, 160.0, 160.0, 120.0, 0.1, 320, 240)


def rows(shift_px: float = 0.0, of_turn: bool = True) -> Rows:
    """Rows that differ by about `shift_px`, by a pitch or by lenses."""
    rng = np.random.default_rng(0)
    found = Rows.unknown(P, Config())
    for _ in range(10):
        left_px = rng.uniform((0, 0), (320, 240), (100, 2))
        by_lens = shift_px * np.sign(left_px[:, 0] - 160) * ((left_px[:, 1] - 120) / 60) ** 2
        by_turn = effects_of_turn(P, left_px)[:, 1, 0] * shift_px / 300
        difference_px = (by_turn if of_turn else by_lens) + 0.05 * rng.normal(size=100)
        found = found.learnt(left_px, difference_px, np.zeros(100))
    return found


def estimate(p_wrong: float = 0.01, std: float = 0.03, **errors: float) -> RigEstimate:
    """Errors by their term, each with the same σ in units of what counts, on which thirds of the run agree."""
    mean = np.array([errors.get(name.replace(" ", "_"), 0.0) for name in TERMS])
    cov = np.diag([std**2] * 13 + [1e-8] * (len(TERMS) - 13))
    return RigEstimate(mean, cov, p_wrong, mean, cov, np.ones(len(TERMS)), evidence=np.full(len(TERMS), 9.0))


def test_a_calibration_without_errors_fits_and_what_no_image_shows_is_said() -> None:
    found = verdict(P, estimate(), rows())
    assert found.fit == "fits" and found.text.startswith("fits the images to 0.0") and found.text.endswith(UNSEEN)


def test_a_focal_length_that_the_motion_does_not_show_is_said() -> None:
    unknown = estimate()
    unknown.cov_if_wrong[TERMS.index(FOCAL), TERMS.index(FOCAL)] = 0.6**2
    assert "does not show the focal length" in verdict(P, unknown, rows()).text
    assert "focal length" not in verdict(P, estimate(), rows()).text


@pytest.mark.parametrize("name", ["1", "xx", "radial 3", "radial difference"])
def test_lenses_and_disparity_that_are_wrong_are_corrected(name: str) -> None:
    """However small the error is, as long as it is more probable than none."""
    found = verdict(P, estimate(p_wrong=0.9, **{name.replace(" ", "_"): 0.4}), rows())
    assert found.fit == "corrected" and "fine for this run" in found.text


@pytest.mark.parametrize(("name", "size", "words"), [(FOCAL, 0.02, "focal length"), (DELAY, 0.008, "8.00")])
def test_a_certain_cause_is_wrong_and_named(name: str, size: float, words: str) -> None:
    found = verdict(P, estimate(**{name.replace(" ", "_"): size}), rows())
    assert found.fit == "wrong" and words in found.text and "refine" in found.text


def test_a_delay_that_the_calibration_contains_is_not_wrong() -> None:
    known = estimate(delay=0.008)
    assert verdict(P, replace(known, refined=known.mean), rows()).fit == "fits"


def test_rows_beyond_half_a_pixel_are_wrong_and_it_is_said_whether_a_turn_explains_them() -> None:
    turned, bent = rows(0.8), rows(0.8, of_turn=False)
    assert turned.rms_px > 0.5 and bent.rms_px > 0.5
    assert verdict(P, estimate(), turned).text == f"wrong: {rows_warning(turned)}"
    assert "which turns the right camera" in rows_warning(turned) and "lenses" in rows_warning(bent)
    assert rows_warning(rows(0.4)) == "" and verdict(P, estimate(), rows(0.4)).fit == "corrected"


def test_a_camera_that_hardly_moved_is_not_judged() -> None:
    still = replace(estimate(std=0.5, p_wrong=0.6), evidence=None)
    found = verdict(P, still, rows())
    assert found.fit == "not judged" and "carry it sideways" in found.text
    assert verdict(P, estimate(), Rows.unknown(P, Config())).fit == "not judged"
    assert judged({})["text"] == "not judged: no frame was tracked"


def test_a_refined_calibration_fits_with_its_refinement() -> None:
    """Nothing is left to correct; the numbers are of what the given calibration has wrong without it."""
    of_rig = estimate(p_wrong=1.0, **{"1": 0.25})
    found: dict[str, Any] = describe(P, replace(of_rig, refined=of_rig.mean), rows())
    assert found["disparity_rms_px"] == pytest.approx(0.25, abs=1e-9)
    assert found["verdict"] == "fits" and "with its refinement of 0.25 px" in found["text"]
    assert judged({"rig": found}) == {"fit": "fits", "text": found["text"]}
    further = replace(of_rig, refined=of_rig.mean - 0.5 * np.eye(len(TERMS))[0])
    assert describe(P, further, rows())["verdict"] == "corrected"
