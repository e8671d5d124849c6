"""Every example runs as its page says."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config import RigConfig
from tests.helpers.imu_log import write_imu_log
from tests.helpers.places import DEMO, LAB_LATERAL, ROOM, ROOT

pytestmark = pytest.mark.slow

FRAMES = 6
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
    for cell in json.loads(Path("tour.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]  # what they show is of who runs them
            exec(compile("".join(cell["source"]), "tour.ipynb", "exec"), names)
    matplotlib.use(backend)
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
    return runs


def check_fusion(example: str, runs: dict[Path, sfm.RunResults], folder: Path) -> None:
    """Without another sensor the end is as certain as the engine's, and as right; with one it is where that says."""
    fused = runpy.run_path(str(ROOT / "examples" / example))["fused"]
    for log, results in runs.items():
        truth = sfm.open_log(log).ground_truth()
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


def test_custom_sink() -> None:
    said = run("custom_sink.py", ROOM, "--limit", 0.0005)
    uncertain, frames = map(int, re.findall(r"^(\d+) frames", said, re.MULTILINE))
    assert 0 < uncertain < frames == 84  # σ grows from 0 beyond half a millimetre


def test_custom_estimator() -> None:
    said = run("custom_estimator.py", ROOM, "--max-frames", 30)
    errors_mm = dict(re.findall(r"^([\w -]+): 30 frames, position error (\S+) mm", said, re.MULTILINE))
    assert set(errors_mm) == {"dead reckoning", "cross-frame"}
    assert all(float(error) < 20 for error in errors_mm.values())  # of 1.5 m
