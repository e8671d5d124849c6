"""Every example runs as its page says."""

import json
import re
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import stream_sfm as sfm
from stream_sfm.config import RigConfig
from stream_sfm.types import RelativeMotions
from tests.helpers.imu_log import write_imu_log
from tests.helpers.places import DEMO, LAB_LATERAL, ROOM, ROOT
from tests.results.test_estimates import estimate

pytestmark = pytest.mark.slow

FRAMES = 6
BLACK = range(40, 52)  # frames of the demo without a picture, across which the window reaches
EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("*.py"))


def run(example: str, *arguments: object) -> str:
    """What the example prints."""
    command = [sys.executable, ROOT / "examples" / example, *arguments]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_listed_and_tested() -> None:
    rows = re.findall(r"^\| `(\w+\.py)`", (ROOT / "examples/README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == EXAMPLES
    tested = {name.removeprefix("test_") + ".py" for name in globals() if name.startswith("test_")}
    assert set(EXAMPLES) <= tested


def test_live(tmp_path: Path) -> None:
    """Without a rig, from the log that the repository has."""
    out, shown = tmp_path / "run", tmp_path / "live.rrd"
    said = run("live.py", ROOM, "--no-view", "--rrd", shown, "--out", out, "--max-frames", FRAMES)
    assert f"{FRAMES} frames" in said and "ok" in said.splitlines()[-2] and " m/s" in said
    assert shown.stat().st_size > 1000  # bytes
    assert len(sfm.read_results(out).stamps_ns) == FRAMES


def test_inertial(tmp_path: Path) -> None:
    log, without, _ = write_imu_log(tmp_path)
    said = run("inertial.py", log, "--dark", 6, 9)
    assert said.count("dead-reckoned by the IMU") == 3 and "(predicted)" in said
    command = [sys.executable, str(ROOT / "examples/inertial.py"), str(without)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert done.returncode and "no inertial samples" in done.stderr


def test_tour(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cells of the notebook, one after the other, as Jupyter runs them in its folder."""
    import matplotlib

    monkeypatch.chdir(ROOT / "examples")
    backend = matplotlib.get_backend()
    matplotlib.use("agg")
    names: dict[str, Any] = {}
    shown: list[str] = []
    for cell in json.loads(Path("tour.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            shown += [kind for output in cell["outputs"] for kind in output["data"]]
            exec(compile("".join(cell["source"]), "tour.ipynb", "exec"), names)
    matplotlib.use(backend)
    assert shown.count("image/png") == 2 and shown.count("text/plain") == 5  # who reads it sees what it shows
    assert names["errors_m"].max() < 0.01 and names["odometry"].twist is not None
    assert names["sigmas_m"][-1] > names["errors_m"][-1]


def test_places() -> None:
    pytest.importorskip("gtsam")
    said = re.search(r"located after (\d+) frames", run("places.py", ROOM))
    assert said is not None and int(said[1]) <= 20


def test_read_results(tmp_path: Path) -> None:
    sfm.replay(ROOM, tmp_path, selection=sfm.Selection(max_frames=FRAMES))
    said = run("read_results.py", tmp_path)
    assert f"{FRAMES} poses" in said and "in view in the last frame" in said
    pytest.importorskip("pandas")
    assert "sigma_m" in said and "ok" in said


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, sfm.RunResults]:
    """Runs over rendered logs, of which only the demo's baseline and axes are not exact."""
    exact, runs = sfm.Config(rig=RigConfig(std_baseline=0.0, std_axes_rad=0.0)), {}
    for log in filter(Path.exists, (ROOM, LAB_LATERAL, DEMO)):
        folder = tmp_path_factory.mktemp(log.stem)
        sfm.replay(log, folder, sfm.Config() if log == DEMO else exact)
        runs[log] = sfm.read_results(folder)
    runs[DEMO.with_stem("black")] = with_black_frames(tmp_path_factory.mktemp("black"), BLACK)
    return runs


def with_black_frames(folder: Path, black: range, frames: int | None = None) -> sfm.RunResults:
    """The run over the demo with some frames black."""
    log = sfm.open_log(DEMO)
    engine = sfm.Engine(log.rig)
    with sfm.ResultFolder(folder, log.rig, engine.config) as results:
        for k, frame in enumerate(log.frames(sfm.Selection(max_frames=frames))):
            images = [np.zeros_like(image) if k in black else image for image in frame.images]
            shown = sfm.StereoFrame(frame.stamp_ns, *images)
            results.write(engine.step(shown), shown)
    return sfm.read_results(folder)


def check_fusion(example: str, runs: dict[Path, sfm.RunResults], folder: Path) -> None:
    """Without another sensor the end is as certain as the engine's, and as right; with one it is where that says."""
    fused = runpy.run_path(str(ROOT / "examples" / example))["fused"]
    for log, results in runs.items():
        truth = sfm.open_log(log if log.exists() else DEMO).ground_truth()
        assert truth is not None
        first, last = (truth.world_from_cam[truth.stamps_ns == results.stamps_ns[k]][0] for k in (0, -1))
        true = np.linalg.inv(first) @ last
        end, pose, cov = fused(results, {}, 1.0)
        apart = np.linalg.inv(pose) @ true
        error = np.r_[apart[:3, 3], apart[2, 1], apart[0, 2], apart[1, 0]]
        nees, engine = error @ np.linalg.solve(cov, error), results.cov_pose[-1]
        assert end == len(results) - 1
        assert nees < 12 and (nees > 2 or log == ROOM)  # there σ counts more than is wrong, the engine's as well
        # own errors of successive motions share structure, which the engine knows: added up they are up to 0.4 larger
        assert np.trace(engine[:3, :3]) / 1.3**2 < np.trace(cov[:3, :3]) < np.trace(engine[:3, :3]) * 1.5**2
    results, path = runs[ROOM], folder / "fixes.tum"
    there = results.world_from_cam[-1, :3, 3] + (0.1, 0, 0)
    stamp_s = f"{results.stamps_ns[-1] // 10**9}.{results.stamps_ns[-1] % 10**9:09d}"
    x, y, z = results.world_from_cam[5, :3, 3]
    at_five_s = f"{results.stamps_ns[5] // 10**9}.{results.stamps_ns[5] % 10**9:09d} {x} {y} {z}"
    path.write_text(
        f"{at_five_s}\n1.5 0 0 0\n# of a σ far below the odometry's\n{stamp_s} {' '.join(map(str, there))}\n"
    )
    said = run(example, results.folder, "--positions", path, "--std", 1e-4)
    found = re.search(r"is at \[(\S+), (\S+), (\S+)\] m, σ (\S+) mm", said)
    assert "2 of 3 positions" in said
    assert found is not None and np.abs(np.array(found.groups()[:3], float) - there).max() < 1e-3
    assert float(found[4]) < 0.3


def test_fuse_gtsam(runs: dict[Path, sfm.RunResults], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gtsam", reason="needs gtsam: pip install gtsam")
    monkeypatch.syspath_prepend(ROOT / "examples")  # as for a script that is started there
    check_fusion("fuse_gtsam.py", runs, tmp_path)


def test_fuse_ekf(runs: dict[Path, sfm.RunResults], tmp_path: Path) -> None:
    check_fusion("fuse_ekf.py", runs, tmp_path)


def test_a_run_that_begins_a_new_map_is_fused_with_what_another_sensor_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """45 frames are missing, and the camera turns by 60° meanwhile: positions afterwards say where it goes on."""
    run, truth = with_black_frames(tmp_path, range(60, 105), 140), sfm.open_log(DEMO).ground_truth()
    assert truth is not None and "initialising" in run.statuses[1:]
    ekf = runpy.run_path(str(ROOT / "examples/fuse_ekf.py"))["fused"]
    end, pose, cov = ekf(run, {}, 1.0)
    assert end == 139 and np.sqrt(np.trace(cov[:3, :3])) > 0.5  # metres: of a motion that was not seen
    in_first = np.linalg.inv(truth.world_from_cam[0]) @ truth.world_from_cam
    rng = np.random.default_rng(4)
    draws = [
        {int(run.stamps_ns[k]): in_first[k, :3, 3] + 0.02 * rng.normal(size=3) for k in (111, 120, 129, 138)}
        for _ in range(12)
    ]
    with pytest.raises(sfm.ConfigError, match=r"the rotation is unknown.*use fuse_gtsam"):
        ekf(run, draws[0], 0.02)
    pytest.importorskip("gtsam", reason="needs gtsam: pip install gtsam")
    monkeypatch.syspath_prepend(ROOT / "examples")  # as for a script that is started there
    gtsam, squares = runpy.run_path(str(ROOT / "examples/fuse_gtsam.py"))["fused"], []
    for fixes in draws:
        _, pose, cov = gtsam(run, fixes, 0.02)
        xi = sfm.se3_log(sfm.se3_inverse(pose) @ in_first[139])
        squares.append(xi @ np.linalg.solve(cov, xi))
        assert np.sqrt(np.trace(cov[:3, :3])) < 0.2
    assert 2 < np.mean(squares) < 12  # 6 expected; the errors of the odometry are the same in each draw


def test_mavlink_odometry() -> None:
    """North-east-down, on numbers: a vehicle that faces east drives forwards, climbs and turns to the right."""
    module = runpy.run_path(str(ROOT / "examples/mavlink_odometry.py"))
    east = sfm.se3_exp([0, 0, 0, 0, 0, np.pi / 2])  # z is down: a positive turn is to the right
    east[:3, 3] = 10, 20, -5
    mounted = sfm.se3_exp([0.3, 0.1, -0.2, 0, -0.2, 0]) @ module["FRD_FROM_CAM"]  # looks 0.2 rad downwards
    messages = module["MavlinkOdometry"](mounted, east)
    step = sfm.se3_exp([0.5, 0, -0.1, 0, 0, 0.05])  # of the body: forwards, upwards, to the right
    in_cam = sfm.se3_inverse(mounted) @ step @ mounted
    std, cov = np.array([1e-2, 2e-2, 3e-2, 1e-3, 2e-3, 3e-3]), np.zeros((6, 6))
    cov[np.diag_indices(6)] = std**2
    first = replace(estimate(0), world_from_cam=np.eye(4), cov_pose=np.zeros((6, 6)))
    fields = messages.fields(first)
    assert (fields["x"], fields["y"], fields["z"]) == pytest.approx((10, 20, -5), abs=1e-9)
    assert fields["q"] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]) and np.isnan(fields["vx"])
    relative = RelativeMotions(np.array([0]), in_cam[None], cov[None])
    moved = replace(estimate(1), world_from_cam=in_cam, cov_pose=cov, relative=relative)
    fields = messages.fields(moved)
    assert fields["time_usec"] == moved.stamp_ns // 1000 and fields["reset_counter"] == 0 and fields["quality"] == 100
    position = np.array([fields[name] for name in "xyz"]) - (10, 20, -5)
    assert position == pytest.approx([0, 0.5, -0.1], abs=0.02)  # forwards is to the east, and up is −z
    assert [fields[name] for name in ("vx", "vy", "vz")] == pytest.approx([5, 0, -1], abs=1e-6)  # of the body, in 0.1 s
    assert [fields[name] for name in ("rollspeed", "pitchspeed", "yawspeed")] == pytest.approx([0, 0, 0.5], abs=1e-6)
    yaw = 2 * np.arctan2(fields["q"][3], fields["q"][0])
    assert yaw == pytest.approx(np.pi / 2 + 0.05, abs=1e-6)
    rng, sample = np.random.default_rng(0), []
    for xi in rng.normal(size=(4000, 6)) * std / 10:  # a tenth, so that nothing bends
        other = east @ mounted @ in_cam @ sfm.se3_exp(xi) @ sfm.se3_inverse(mounted)
        true = east @ step
        sample.append(np.r_[other[:3, 3] - true[:3, 3], sfm.se3_log(with_rotation(other @ sfm.se3_inverse(true)))[3:]])
    expected = 100 * np.cov(np.array(sample).T)[np.triu_indices(6)]
    stated, scale = np.array(fields["pose_covariance"]), np.sqrt(np.diag(100 * np.cov(np.array(sample).T)))
    tolerance = 5 * np.outer(scale, scale)[np.triu_indices(6)] * np.sqrt(2 / 4000)
    assert stated.shape == (21,) and (np.abs(stated - expected) < tolerance).all()
    anew = replace(estimate(2), status=sfm.Status.INITIALISING)
    assert messages.fields(anew)["reset_counter"] == 1
    said = run("mavlink_odometry.py", ROOM, "--max-frames", 3).splitlines()
    assert len(said) == 3 and said[-1].endswith("100 %") and said[0].startswith("1760000000000000 us")


def with_rotation(pose: np.ndarray) -> np.ndarray:
    """The rotation of a pose alone."""
    turned = np.eye(4)
    turned[:3, :3] = pose[:3, :3]
    return turned


def test_custom_sink() -> None:
    """Uncertain in the beginning, before the points are known well, and no longer: the alarm ends."""
    said = run("custom_sink.py", ROOM, "--limit", 0.005)
    uncertain, frames = map(int, re.findall(r"^(\d+) frames", said, re.MULTILINE))
    assert 0 < uncertain < 10 < frames == 84


def test_foxglove_layout(tmp_path: Path) -> None:
    """Its topics and fields are those of a run."""
    sfm.replay(ROOM, tmp_path, selection=sfm.Selection(max_frames=FRAMES))
    with (tmp_path / "estimates.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        known = {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}
    layout = (ROOT / "examples/foxglove-layout.json").read_text(encoding="utf-8")
    paths = re.findall(r'"(/stream_sfm/\w+)(?:\.(\w+))?"', layout)
    assert len(paths) > 10
    for topic, field in paths:
        assert topic in known and (not field or hasattr(known[topic], field)), (topic, field)
    panels = json.loads(layout)
    assert set(re.findall(r'"(?:first|second)": "([^"]+)"', layout)) == set(panels["configById"])


def test_custom_estimator() -> None:
    said = run("custom_estimator.py", ROOM, "--max-frames", 30)
    errors_mm = dict(re.findall(r"^([\w -]+): 30 frames, position error (\S+) mm", said, re.MULTILINE))
    assert set(errors_mm) == {"dead reckoning", "cross-frame"}
    assert all(float(error) < 20 for error in errors_mm.values())  # of 1.5 m
