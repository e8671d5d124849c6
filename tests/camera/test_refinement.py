"""A calibration with known errors: its file round-trips, and views are corrected by it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.camera.refinement import (
    DISPARITY,
    LENS_TERMS,
    PARTS,
    KnownTiming,
    Refinement,
    combine,
    disparity_rms_px,
)
from stream_sfm.camera.rig import StereoRig
from stream_sfm.camera.settings import SETTINGS
from stream_sfm.config import Config
from stream_sfm.errors import ConfigError
from stream_sfm.pipeline.engine import Engine
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


def run_of(rng: np.random.Generator, error: np.ndarray, prior_std: np.ndarray) -> tuple[Refinement, np.ndarray]:
    """A run with these errors, whose views measure combinations of them, and the prior σ that it has learnt."""
    a, std = rng.normal(size=(30, N)) / prior_std, prior_std * rng.uniform(0.5, 2, N)
    views = a @ error + rng.normal(size=30)
    cov = np.linalg.inv(a.T @ a + np.diag(std**-2))
    return Refinement(cov @ a.T @ views, cov), std


def test_a_single_log_is_a_measurement_of_what_another_one_will_have() -> None:
    """Against the dense joint Gaussian of the shared error, this log and the next one."""
    rng = np.random.default_rng(1)
    prior_std = rng.uniform(0.2, 2, N)
    run, std = run_of(rng, prior_std * rng.normal(size=N), prior_std)
    information = np.linalg.inv(run.cov_px2)
    views, weighted = information - np.diag(std**-2), information @ run.error_px
    shared = np.where(np.arange(N) < 6, SETTINGS.common_disparity, 1.0) * prior_std
    differ = (SETTINGS.logs_differ * prior_std) ** 2
    joint = np.kron(np.ones((2, 2)), np.diag(shared**2)) + np.kron(np.eye(2), np.diag(differ))  # this log, the next
    seen = np.linalg.inv(views)
    gain = joint[:, :N] @ np.linalg.inv(joint[:N, :N] + seen)
    mean, cov = gain @ seen @ weighted, joint - gain @ joint[:N]
    found = combine([run], np.array([std]), prior_std)
    assert np.allclose(found.error_px, mean[N:], rtol=1e-6, atol=1e-9)
    assert np.allclose(found.cov_px2, cov[N:, N:], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("differ", [0.05, 0.4, 1.5])
def test_the_scatter_of_logs_is_in_the_uncertainty_of_the_next_one(differ: float) -> None:
    """Over rigs whose logs differ by more or less than usual, χ² of a log that was not among the eight is that of N."""
    rng, prior_std, chi2 = np.random.default_rng(2), np.linspace(0.4, 5, N), []
    for _ in range(60):
        shared = prior_std * rng.normal(size=N)
        errors = shared + differ * prior_std * rng.normal(size=(9, N))
        runs, stds = zip(*(run_of(rng, error, prior_std) for error in errors[:-1]), strict=True)
        found = combine(runs, np.array(stds), prior_std)
        away = errors[-1] - found.error_px
        chi2.append(away @ np.linalg.solve(found.cov_px2, away) / N)
    # σ of a mean of 60 such values is 0.05. The two logs that are assumed leave τ² at a quarter of the guess at least:
    # with eight logs that hardly differ, σ is four times too large.
    low, high = {0.05: (0.05, 0.12), 0.4: (0.8, 1.3), 1.5: (0.8, 1.5)}[differ]
    assert low < np.mean(chi2) < high


def test_a_part_that_is_left_out_is_as_unknown_as_before() -> None:
    prior_std = np.linspace(0.4, 5, N)
    run, _ = run_of(np.random.default_rng(3), prior_std, prior_std)
    kept = run.only([DISPARITY], prior_std)
    assert (kept.error_px[:6] == run.error_px[:6]).all() and not kept.error_px[6:].any()
    assert (kept.cov_px2[:6, :6] == run.cov_px2[:6, :6]).all() and not kept.cov_px2[:6, 6:].any()
    assert kept.std_px[6:] == pytest.approx(prior_std[6:])
    assert (run.only(PARTS, prior_std).cov_px2[:6, :6] == run.cov_px2[:6, :6]).all()


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
