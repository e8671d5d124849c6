"""No useless run succeeds silently: problems that make results worthless are reported, with exit code 3."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inspection import calibration_check
from stream_sfm.inspection.overview import inspect_log
from stream_sfm.report.records import RunRecord
from stream_sfm.types import StereoFrame
from tests.helpers.stereo_logs import START_NS, LogWriter, Spec, infos_of, write_pair
from tests.helpers.wall import PERIOD_NS, Wall, camera_path, rig

STEREO = rig()


@pytest.fixture(scope="module")
def frames() -> list[StereoFrame]:
    return Wall(5).frames(STEREO, camera_path(8))


def write(path: Path, frames: list[StereoFrame], baseline_m: float = STEREO.baseline_m, stamped: bool = True) -> Path:
    """A log of these frames, with the calibration of the wall's rig except for the baseline."""
    log = LogWriter(path)
    for i, frame in enumerate(frames):
        time = log.clock_ns = START_NS + i * PERIOD_NS
        infos = infos_of(STEREO, baseline_m) if i == 0 else None
        write_pair(log, "ros2", time if stamped else 0, frame.images, infos, "mono8")
    log.close()
    return path


def swapped(frames: list[StereoFrame]) -> list[StereoFrame]:
    return [StereoFrame(f.stamp_ns, f.right, f.left) for f in frames]


def test_a_camera_that_is_knocked_on_the_way_is_a_warning(tmp_path) -> None:
    knocked = replace(STEREO, right_from_left=se3.exp([0, 0, 0, 0, -1e-3, 0]) @ STEREO.right_from_left)
    seen = [Wall(5).frame(knocked if k >= 10 else STEREO, pose, k) for k, pose in enumerate(camera_path(16))]
    (warning,) = sfm.replay(write(tmp_path / "a.mcap", seen)).summary["warnings"]
    assert warning.startswith("from frame 10 on the right camera is turned against the left one")
    assert "was a camera knocked" in warning and "distances of 10 m would be off by 5." in warning


def test_exchanged_cameras_are_named_while_the_run_starts_and_at_its_end(frames, tmp_path, cli) -> None:
    log = write(tmp_path / "a.mcap", swapped(frames))
    errors = cli("replay", log, "--out", tmp_path / "out", code=3).err.splitlines()
    assert errors[0].startswith("problem: ") and errors[-1].startswith("stream-sfm: ")
    assert all("a.mcap: the images are swapped" in line for line in (errors[0], errors[-1]))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["frames"]["estimated"] == 8 and "swapped" in summary["problems"][0]
    for command in (["inspect", str(log)], ["compare", str(log), "--methods", "ekf", "--out", str(tmp_path / "c")]):
        output = cli(*command, code=3)
        assert "the images are swapped" in " ".join((output.out + output.err).split())


def test_corners_are_matched_only_if_frames_are_not_followed_well(frames, tmp_path, monkeypatch) -> None:
    matched: list[object] = []
    known = calibration_check.matched_corners
    monkeypatch.setattr(calibration_check, "matched_corners", lambda *images: matched.append(1) or known(*images))
    sfm.replay(write(tmp_path / "good.mcap", frames[:2]), None)
    assert not matched
    sfm.replay(write(tmp_path / "exchanged.mcap", swapped(frames)), None)
    assert len(matched) == 5  # the first frame, then four together


def test_the_surface_of_exchanged_cameras_is_questioned(frames, tmp_path) -> None:
    log = write(tmp_path / "a.mcap", swapped(frames))
    for frame in (0, None):
        assert sfm.surface(write(tmp_path / "b.mcap", frames), frame).warnings == []
    assert "the images are swapped" in sfm.surface(log).warnings[0]


def test_a_run_that_is_lost_from_the_start_says_why(frames, tmp_path, cli) -> None:
    log = write(tmp_path / "a.mcap", [StereoFrame(f.stamp_ns, 0 * f.left, 0 * f.right) for f in frames])
    assert "a.mcap: tracking was lost in every frame: " in cli("replay", log, "--out", tmp_path / "out", code=3).err
    assert "image is black" in json.loads((tmp_path / "out" / "summary.json").read_text())["problems"][0]
    assert len(np.loadtxt(tmp_path / "out" / "trajectory.tum")) == 8, "what there is, is written"


def test_a_single_frame_is_enough_only_if_it_was_asked_for(frames, tmp_path, cli) -> None:
    log = write(tmp_path / "a.mcap", frames[:1])
    assert "only one stereo frame" in cli("replay", log, "--out", tmp_path / "out", "-q", code=3).err
    log = write(tmp_path / "b.mcap", frames)
    cli("replay", log, "--out", tmp_path / "out", "-q", "--max-frames", "1")


@pytest.mark.parametrize("baseline_m, asks", [(110.0, "are these millimetres?"), (1e-4, "are these another unit?")])
def test_a_baseline_that_is_hardly_in_metres_is_questioned(baseline_m, asks, frames, tmp_path) -> None:
    log = write(tmp_path / "a.mcap", frames, baseline_m)
    for warnings in (inspect_log(log)["warnings"], sfm.replay(log).summary["warnings"]):
        assert [w for w in warnings if f"{baseline_m:.4g} m" in w and asks in w]


def test_images_without_stamps_get_the_times_at_which_they_were_recorded(frames, tmp_path) -> None:
    stamped = sfm.replay(write(tmp_path / "a.mcap", frames))
    result = sfm.replay(write(tmp_path / "b.mcap", frames, stamped=False))
    assert np.array_equal(result.trajectory.stamps_ns, stamped.trajectory.stamps_ns)
    assert np.array_equal(result.trajectory.world_from_cam, stamped.trajectory.world_from_cam)
    (warning,) = result.summary["warnings"]
    assert "have no stamps" in warning and Spec.topics[0] in warning


_ONE_AFTER_ANOTHER = """
import subprocess, sys
import numpy as np
from stream_sfm.run.summary import peak_rss_mib
large = np.ones(50_000_000)
small = "from stream_sfm.run.summary import peak_rss_mib; print(peak_rss_mib())"
print(peak_rss_mib(), flush=True)
subprocess.run([sys.executable, "-c", small], check=True)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory of a process is read from /proc")
def test_the_memory_of_a_run_is_its_own_and_not_that_of_the_process_that_started_it():
    done = subprocess.run([sys.executable, "-c", _ONE_AFTER_ANOTHER], capture_output=True, text=True, check=True)
    large, small = (float(line) for line in done.stdout.split())
    assert large > 50e6 * 8 / 2**20 and small < 300  # MiB; a process with NumPy takes some tens


@pytest.mark.parametrize(("first", "said"), [(2, False), (12, True)])
def test_a_correction_on_the_way_says_from_which_frame_on_and_what_it_means(first: int, said: bool):
    engine, statistics = sfm.Engine(rig()), RunRecord("cross-frame", disparity_at_1m_px=60.0)
    for frame in Wall(1).frames(rig(), camera_path(14)):
        estimate = engine.step(frame)
        found = estimate.rig
        if found is not None:
            mean = np.zeros(len(found.mean))
            mean[0] = 0.3
            found = replace(found, mean=mean, p_wrong=float(estimate.frame_index >= first))
        statistics.add(replace(estimate, rig=found))
    warnings = statistics.warnings()
    assert len(warnings) == said
    if said:
        assert warnings[0].startswith("from frame 12 on, a calibration error of 0.30 px of disparity is corrected")
        assert "distances of 10 m are off by 5.0 %" in warnings[0]
