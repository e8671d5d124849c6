"""Refining a calibration from logs, by the library and by the command line."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config, RigConfig
from stream_sfm.errors import ConfigError
from stream_sfm.geometry import se3
from stream_sfm.logs.recording.stereo_log import open_log
from stream_sfm.report.motions import MOTIONS, coverage, not_shown
from stream_sfm.rig_model.estimate import CERTAIN, RigEstimate
from stream_sfm.rig_model.terms import DELAY, FOCAL, TERMS, prior_std
from stream_sfm.run.held_back import worse
from stream_sfm.run.mending import focal_of, with_longer_focal, with_right_turned
from stream_sfm.run.refine import refine, timing_of
from stream_sfm.run.replay import replay
from stream_sfm.types import Selection
from tests.helpers.places import ROOM
from tests.helpers.wall_log import write_wall_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_wall_log(tmp_path_factory.mktemp("refine") / "wall.mcap", n=13, times=4)


def turned(rig: StereoRig, axis: int, degrees: float) -> StereoRig:
    turn = np.zeros(6)
    turn[3 + axis] = np.radians(degrees)
    return replace(rig, right_from_left=se3.exp(turn) @ rig.right_from_left)


def test_an_exact_calibration_stays_as_it_is(log: Path) -> None:
    """Held-back frames have no error that another part of the log could take away."""
    refined = refine([log])
    assert refined.rig.refinement is None and refined.rig.timing is None
    assert any("no refinement of disparity and lenses" in note for note in refined.notes)
    assert refined.after == refined.before


def test_several_logs_check_each_other_and_show_how_much_they_differ(log: Path) -> None:
    """A pitch that both have is mended; of the rest, each log is replayed with what the other one shows."""
    rig = turned(turned(open_log(log).stereo_rig, 0, 0.2), 1, 0.3)
    refined = refine([log, log], selection=Selection(max_frames=30), calibration=rig)
    assert len(refined.before) == len(refined.after) == 2
    assert refined.rig.refinement is not None
    assert "σ of the refinement contains how much the logs differ" in refined.notes
    for before, after in zip(refined.before, refined.after, strict=True):
        assert after.rows.rms_px < 0.3 * before.rows.rms_px  # the yaw moves rows as well, towards the corners
    # two logs that agree: the difference is smaller than the one that is assumed of a single log
    one = refine([log], calibration=rig).rig.refinement
    assert one is not None and refined.rig.refinement.std_px[0] < 1.01 * one.std_px[0]


def test_too_few_frames_cannot_be_checked(log: Path) -> None:
    refined = refine([log], selection=Selection(max_frames=20))
    assert refined.rig.refinement is None and any("too few frames" in note for note in refined.notes)


@pytest.mark.slow
def test_a_yaw_becomes_a_refinement_that_helps_held_back_frames() -> None:
    rig = turned(open_log(ROOM).stereo_rig, 1, 0.2)
    refined = refine([ROOM], selection=Selection(max_frames=60), calibration=rig)
    assert refined.rig.refinement is not None
    assert refined.rig.refinement.error_px[0] == pytest.approx(-1.42, abs=3 * refined.rig.refinement.std_px[0])
    before, after = refined.before[0], refined.after[0]
    assert after.found_px()[0] < 0.3 * before.found_px()[0]
    assert after.ate_m is not None and before.ate_m is not None and after.ate_m < 1.03 * before.ate_m
    assert (before.figures()["verdict"], after.figures()["verdict"]) == ("corrected", "fits")


@pytest.mark.slow
def test_a_certain_focal_length_is_written_to_both_cameras() -> None:
    exact = open_log(ROOM).stereo_rig
    refined = refine([ROOM], selection=Selection(max_frames=60), calibration=with_longer_focal(exact, 0.02))
    for camera, true in ((refined.rig.left, exact.left), (refined.rig.right, exact.right)):
        assert camera.K[0, 0] == pytest.approx(true.K[0, 0], rel=0.004)  # 3 σ
    assert "focal length" in refined.before[0].figures()["text"]
    assert refined.after[0].figures()["verdict"] == "fits"


def run_with(focal: float, std: float, evidence: float = 2 * CERTAIN) -> RigEstimate:
    mean, cov = np.zeros(len(TERMS)), np.diag(prior_std(RigConfig()) ** 2)
    at = TERMS.index(FOCAL)
    mean[at], cov[at, at] = focal, std**2
    sure = np.full(len(TERMS), evidence)
    return RigEstimate(mean, cov, 1.0, mean, cov, prior_std(RigConfig()), evidence=sure)


def test_a_focal_length_is_that_of_runs_that_are_certain_and_agree() -> None:
    assert focal_of([run_with(0.02, 1e-3)]) == pytest.approx((0.02, 1e-3))
    assert focal_of([run_with(0.02, 1e-3), run_with(0.0, 5e-3)]) == pytest.approx((0.02, 1e-3))
    both = focal_of([run_with(0.02, 1e-3), run_with(0.022, 1e-3)])
    assert both == pytest.approx((0.021, 0.002 / np.sqrt(2)))  # the scatter is larger than σ
    for runs in (
        [run_with(0.004, 1e-3)],
        [run_with(0.02, 1e-3, 1.0)],
        [run_with(0.02, 1e-3), run_with(0.03, 1e-3)],
    ):
        assert focal_of(runs) == (0.0, 0.0)


def test_a_turn_about_rectified_axes_keeps_the_centre_of_the_right_camera(log: Path) -> None:
    rig = turned(open_log(log).stereo_rig, 1, 3.0)
    after = with_right_turned(rig, np.array([1e-3, -2e-3]))
    centres = [se3.inverse(of.right_from_left)[:3, 3] for of in (rig, after)]
    assert np.allclose(*centres, atol=1e-12)
    by = se3.log(after.right_from_left @ se3.inverse(rig.right_from_left))[3:]
    assert np.linalg.norm(by) == pytest.approx(np.sqrt(5) * 1e-3)


def test_frames_are_worse_for_one_of_four_reasons() -> None:
    def run(ok: int = 10, found: tuple[str, ...] = (), std_m: float = 1.0, tracked: bool = True) -> SimpleNamespace:
        rig = SimpleNamespace(findings=lambda: list(found)) if tracked else None
        return SimpleNamespace(rig=rig, ok=ok, std_end_m=std_m)

    assert worse(run(), run(std_m=1.4)) == ""
    assert worse(run(found=("a",)), run(found=("b",))) == ""
    assert "nothing" in worse(run(), run(tracked=False))
    assert worse(run(), run(ok=9)) == "9 frames are good instead of 10"
    assert worse(run(), run(found=("it is late",))) == "it finds that it is late"
    assert "from 1 to 1.6 m" in worse(run(), run(std_m=1.6))


def test_what_no_motion_has_shown_is_named_with_the_motion_that_would() -> None:
    assumed = prior_std(RigConfig())
    blank = RigEstimate(0 * assumed, np.diag(assumed**2), 0.5, 0 * assumed, np.diag(assumed**2), assumed)
    assert len(not_shown([blank], Config())) == len(MOTIONS) and (coverage(blank, Config()) == 0).all()
    known = replace(blank, cov_if_wrong=np.diag((0.1 * assumed) ** 2))
    assert not_shown([blank, known], Config()) == [] and coverage(known, Config()) == pytest.approx(0.9)
    assert not_shown([], Config()) == []


def test_a_delay_that_is_certain_is_written_with_what_several_runs_know_of_it() -> None:
    """Two runs of one σ leave it at 0.71 of that; a readout that no run is certain of stays what is assumed.

    Where thirds of the runs do not agree, nothing is written; where the runs differ, their scatter is σ.
    """
    mean, cov = np.zeros(len(TERMS)), np.diag(prior_std(RigConfig()) ** 2)
    at = TERMS.index(DELAY)
    mean[at], cov[at, at] = 0.008, 0.0002**2
    sure = np.full(len(TERMS), 2 * CERTAIN)
    run = RigEstimate(mean, cov, 0.0, mean, cov, prior_std(RigConfig()), evidence=sure)
    timing = timing_of([run, run], Config())
    assert timing is not None and timing.mean == pytest.approx([0.008, 0.0])
    assert timing.std == pytest.approx([0.0002 / np.sqrt(2), RigConfig().std_readout_s])
    assert timing_of([replace(run, evidence=sure / 4)], Config()) is None
    late = replace(run, mean=mean + 0.002 * np.eye(len(TERMS))[at])
    timing = timing_of([run, late], Config())
    assert timing is not None and timing.std[0] == pytest.approx(0.002 / np.sqrt(2))
    mean[at] = 0.0005
    assert timing_of([run], Config()) is None


@pytest.mark.parametrize("config", [Config(rig=RigConfig(exact=True)), Config(method="ekf")])
def test_a_configuration_that_cannot_calibrate_is_refused(config: Config, log: Path) -> None:
    with pytest.raises(ConfigError, match=r"neither rig.exact nor the method \S+ refines"):
        refine([log], config)


def test_the_command_writes_a_calibration_that_a_replay_takes(log: Path, tmp_path: Path, cli) -> None:
    """Of a pitch of the right camera, which is taken out of it."""
    out, wrong, exact = tmp_path / "refined.toml", tmp_path / "wrong.toml", open_log(log).stereo_rig
    wrong.write_text(turned(exact, 0, 0.2).to_toml())
    found = cli("refine", log, "--calibration", wrong, "--out", out, "--json").json
    assert found["logs"][0]["log"] == str(log) and any("rows" in note for note in found["notes"])
    left = se3.log(StereoRig.from_calibration(out).right_from_left @ se3.inverse(exact.right_from_left))[3:]
    # rows are known to some hundredths of a pixel, of 320
    assert np.degrees(np.abs(left[[0, 2]])).max() < 0.02
    before, after = (found["logs"][0][name] for name in ("without", "with"))
    assert before["rows_rms_px"] > 0.5 and after["rows_rms_px"] < 0.1
    assert before["verdict"] == "wrong" != after["verdict"]
    last = [cli(command, log, "--calibration", out).out.splitlines()[-1] for command in ("inspect", "replay")]
    assert last[0] == last[1] == f"calibration: {after['text']}"
    assert any("rows" in warning for warning in replay(log, calibration=wrong).summary["warnings"])
