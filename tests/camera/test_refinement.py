"""A calibration with known errors: its file round-trips, and views are corrected by it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.camera.refinement import LENS_TERMS, KnownTiming, Refinement, combine, disparity_rms_px
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config
from stream_sfm.engine import Engine
from stream_sfm.errors import ConfigError
from tests.helpers.wall import Wall, camera_path, rig

N = len(LENS_TERMS)


def _errors(error_px: dict[str, float]) -> np.ndarray:
    return np.array([error_px.get(term, 0.0) for term in LENS_TERMS])


def test_a_refined_calibration_is_read_back_unchanged(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    a = rng.normal(size=(N, N))
    refinement = Refinement(rng.normal(size=N), a @ a.T + np.eye(N))
    path = tmp_path / "refined.toml"
    path.write_text(replace(rig(), refinement=refinement).to_toml())
    back = StereoRig.from_calibration(path).refinement
    assert back is not None
    assert (back.error_px == refinement.error_px).all() and (back.cov_px2 == refinement.cov_px2).all()


def _rows(matrix: np.ndarray) -> str:
    return f"[{','.join(f'{chr(10)}{row}' for row in matrix.tolist())}]"


def test_what_is_known_of_the_timing_is_written_and_read(tmp_path: Path) -> None:
    path, timing = tmp_path / "rig.toml", KnownTiming(0.0081, 2e-4, -0.019, 1e-3)
    path.write_text(replace(rig(), timing=timing).to_toml())
    assert StereoRig.from_calibration(path).timing == timing
    for was, put, complaint in (
        ("std_delay_s = 0.0002", "std_delay_s = 0", "std_delay_s"),
        ("delay_s = 0.0081", "delay_s = 8.1", "seconds"),
        ("readout_s = -0.019\n", "", "readout_s"),
    ):
        text = path.read_text().replace(f"\n{was}", f"\n{put}", 1)
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(ConfigError, match=complaint):
            StereoRig.from_calibration(tmp_path / "bad.toml")


@pytest.mark.parametrize(
    ("section", "complaint"),
    [
        ("error_px = [0.1, 0.2]", f"error_px must be {N} numbers"),
        (f"error_px = {[0.0] * N}", f"covariance_px2 must be {N}×{N} numbers"),
        (f"error_px = {[0.0] * N}\ncovariance_px2 = {_rows(-np.eye(N))}", "not positive definite"),
        ("errors = 3", "unknown key 'errors'"),
    ],
)
def test_what_is_not_a_refinement_is_named(tmp_path: Path, section: str, complaint: str) -> None:
    path = tmp_path / "refined.toml"
    path.write_text(f"{rig().to_toml()}\n[refinement]\n{section}\n")
    with pytest.raises(ConfigError, match=complaint):
        StereoRig.from_calibration(path)


def test_independent_runs_are_put_together_as_measurements_with_one_prior_in_place_of_theirs() -> None:
    rng = np.random.default_rng(1)
    prior_std = rng.uniform(0.2, 2, N)
    priors_std = np.array([[0.5], [1.5], [1.0]]) * prior_std
    joint, weighted, each = np.diag(prior_std**-2), np.zeros(N), []
    for std in priors_std:
        a = rng.normal(size=(N, N))
        information, mean = a @ a.T, rng.normal(size=N)
        cov = np.linalg.inv(information + np.diag(std**-2))
        each.append(Refinement(cov @ information @ mean, cov))
        joint, weighted = joint + information, weighted + information @ mean
    together = combine(each, priors_std, prior_std)
    assert np.allclose(together.error_px, np.linalg.solve(joint, weighted), rtol=1e-9, atol=1e-12)
    assert np.allclose(together.cov_px2, np.linalg.inv(joint), rtol=1e-9)


def test_the_field_s_size_is_that_over_the_image() -> None:
    assert disparity_rms_px(_errors({"1": 0.3, "radial 3": 9.0})) == pytest.approx(0.3)
    # a grid of finite steps
    assert disparity_rms_px(_errors({"x": 0.3})) == pytest.approx(0.3 / np.sqrt(3), rel=0.06)


def test_a_known_error_is_taken_out_of_all_views() -> None:
    """A wrong principal point, with a refinement that says so, gives the trajectory of the right calibration."""
    wall, right = Wall(3), rig()
    k = right.right.K.copy()
    k[0, 2] += 0.4  # the calibration expects right views 0.4 px further right than they are
    wrong = StereoRig(right.left, Camera(right.right.width, right.right.height, k), right.right_from_left)
    error = _errors({"1": -0.4})
    refined = replace(wrong, refinement=Refinement(error, 1e-6 * np.eye(N)))
    frames = wall.frames(right, camera_path(5))
    last = {}
    for name, used in (("right", right), ("wrong", wrong), ("refined", refined)):
        engine = Engine(used, Config())
        for frame in frames:
            last[name] = engine.step(frame).world_from_cam[:3, 3]
    apart = {name: np.linalg.norm(last[name] - last["right"]) for name in ("wrong", "refined")}
    assert apart["refined"] < 0.2 * apart["wrong"]  # the views are those of a shift that is resampled
