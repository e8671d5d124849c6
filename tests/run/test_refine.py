"""Refining a calibration from logs, by the library and by the command line."""

from pathlib import Path

import numpy as np
import pytest

from stream_sfm.camera.refinement import LENS_TERMS
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config, RigConfig
from stream_sfm.errors import ConfigError
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.terms import DELAY, TERMS, prior_std
from stream_sfm.run.refine import refine, timing_of
from stream_sfm.run.replay import replay
from tests.helpers.wall_log import write_wall_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_wall_log(tmp_path_factory.mktemp("refine") / "wall.mcap", n=8)


def test_an_exact_calibration_stays_as_it_is_within_its_uncertainty(log: Path) -> None:
    refined = refine([log])
    refinement = refined.rig.refinement
    assert refinement is not None
    assert refinement.error_px @ np.linalg.solve(refinement.cov_px2, refinement.error_px) < 42  # χ² of 13, 1e-4
    assert (refinement.std_px <= prior_std(RigConfig())[: len(LENS_TERMS)]).all()


def test_several_logs_tell_more_than_one(log: Path) -> None:
    one, two = (refine(logs).rig.refinement for logs in ([log], [log, log]))
    assert one is not None and two is not None
    # less than one; 0.71 were the logs independent of the prior
    assert (two.std_px <= one.std_px).all() and two.std_px[0] < 0.9 * one.std_px[0]


def test_a_delay_that_is_certain_is_written_with_what_several_runs_know_of_it() -> None:
    """Two runs of one σ leave it at 0.71 of that; a readout that no run is certain of stays what is assumed."""
    mean, cov = np.zeros(len(TERMS)), np.diag(prior_std(RigConfig()) ** 2)
    at = TERMS.index(DELAY)
    mean[at], cov[at, at] = 0.008, 0.0002**2
    run = RigEstimate(mean, cov, 0.0, mean, cov, prior_std(RigConfig()))
    timing = timing_of([run, run], Config())
    assert timing is not None and timing.mean == pytest.approx([0.008, 0.0])
    assert timing.std == pytest.approx([0.0002 / np.sqrt(2), RigConfig().std_readout_s])
    mean[at] = 0.0005
    assert timing_of([run], Config()) is None


@pytest.mark.parametrize("config", [Config(rig=RigConfig(exact=True)), Config(method="ekf")])
def test_a_configuration_that_cannot_calibrate_is_refused(config: Config, log: Path) -> None:
    with pytest.raises(ConfigError, match=r"neither rig.exact nor the method \S+ refines"):
        refine([log], config)


def test_the_command_writes_a_calibration_that_a_replay_takes(log: Path, tmp_path: Path, cli) -> None:
    out = tmp_path / "refined.toml"
    found = cli("refine", log, "--out", out, "--json").json
    assert StereoRig.from_calibration(out).refinement is not None
    assert found["logs"][0]["log"] == str(log)
    assert "px of disparity" in cli("inspect", log, "--calibration", out).out
    summary = replay(log, calibration=out).summary
    assert not summary["rig"]["applied"] and "refined" in summary["rig"]["text"]
