"""`read_results` and `trajectory.csv` contain the estimates."""

import csv
import shutil
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config import RosConfig
from stream_sfm.geometry import se3
from stream_sfm.record import about
from stream_sfm.results.folder import ResultFolder
from stream_sfm.results.frames import fixed_axis_covariance
from stream_sfm.results.own_messages import DEFINITIONS, ESTIMATE
from stream_sfm.results.trajectory_files import frame_table
from tests.results.test_estimates import estimate, rig

FRAMES = 9
ROBOT = RosConfig(base_frame="base_link", camera_x_m=1.0, camera_yaw_deg=30)


@pytest.fixture(scope="module")
def estimates() -> list[sfm.FrameEstimate]:
    return [estimate(i, points=0 if i == 3 else 5) for i in range(FRAMES)]


@pytest.fixture(scope="module", params=[RosConfig(), ROBOT], ids=["camera", "robot"])
def run(request: pytest.FixtureRequest, tmp_path_factory, estimates) -> sfm.RunResults:
    folder = ResultFolder(tmp_path_factory.mktemp("run"), rig(), sfm.Config(ros=request.param))
    for e in estimates:
        folder.write(e, None)
    folder.close()
    folder.write_summary({"frames": {"estimated": FRAMES}})
    return sfm.read_results(folder.path)


def test_what_describes_a_field_puts_it_into_messages_and_tables() -> None:
    message = DEFINITIONS[ESTIMATE].split("\n")
    for described in fields(sfm.FrameEstimate):
        says = about(described).says
        where = message.index(f"# {says}") if says else 0
        assert not says or message[where + 1].split()[1] == described.name
        assert not about(described).column or described.name in frame_table([])


def test_poses_are_those_of_the_run(run: sfm.RunResults, estimates) -> None:
    assert len(run) == len(run.trajectory) == FRAMES
    assert run.stamps_ns.tolist() == [e.stamp_ns for e in estimates]
    assert np.array_equal(run.world_from_cam, [e.world_from_cam for e in estimates])
    assert np.array_equal(run.cov_pose, [e.cov_pose for e in estimates])
    assert run.statuses.tolist() == ["initialising", *(FRAMES - 1) * ["ok"]]
    assert run.reasons[0] == "first frame" and run.summary == {"frames": {"estimated": FRAMES}}


def test_points_are_in_the_camera_of_their_frame(run: sfm.RunResults, estimates) -> None:
    points = run.points
    assert np.unique(points.frame_indices).tolist() == [0, 1, 2, 4, 5, 6, 7, 8]
    for e in estimates:
        mine = points.frame_indices == e.frame_index
        assert points.track_ids[mine].tolist() == e.track_ids.tolist()
        assert np.allclose(points.points[mine], e.points_in_cam, rtol=1e-6)  # float32, here and below
        assert np.allclose(points.cov_points[mine], e.cov_points, rtol=1e-5, atol=1e-9)


def test_points_of_the_map_are_in_the_world_whatever_the_frames(run: sfm.RunResults, estimates) -> None:
    last = estimates[-1]
    live = np.isin(run.map_points.track_ids, last.track_ids)
    assert np.allclose(run.map_points.points[live], last.points_in_world, atol=1e-5)  # float32
    assert np.allclose(run.map_points.cov_points[live], last.cov_points_in_world, atol=1e-6)  # float32


def test_the_table_has_rotations_and_sigmas_along_the_axes_of_the_world(run: sfm.RunResults, estimates) -> None:
    for i, e in enumerate(estimates):
        sigma = np.sqrt(np.diag(fixed_axis_covariance(e.world_from_cam[:3, :3], e.cov_pose)))
        names = [*(f"sigma_{a}_m" for a in "xyz"), *(f"sigma_r{a}_rad" for a in "xyz")]
        assert np.allclose([run.table[name][i] for name in names], sigma, rtol=1e-12)
        assert run.table["sigma_m"][i] == pytest.approx(np.sqrt(np.trace(e.cov_pose[:3, :3])))
    quats = np.stack([run.table[f"q{axis}"] for axis in "xyzw"], axis=1)
    assert np.allclose(se3.matrix_from_quat_xyzw(quats), run.world_from_cam[:, :3, :3], atol=1e-12)


def test_the_csv_is_the_table(run: sfm.RunResults) -> None:
    with open(run.folder / "trajectory.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == list(run.table)
    for name, column in run.table.items():
        said = [row[name] for row in rows]
        if column.dtype.kind == "f":
            assert np.allclose(np.array(said, dtype=float), column, rtol=1e-11, equal_nan=True)  # twelve digits
        else:
            assert said == [str(value) for value in column.tolist()]


def test_a_frame_without_a_covariance_has_no_sigma(tmp_path: Path) -> None:
    folder = ResultFolder(tmp_path, rig(), sfm.Config())
    folder.write(replace(estimate(0), cov_pose=np.full((6, 6), np.inf), nis_dof=0), None)
    folder.close()
    table = sfm.read_results(tmp_path).table
    assert np.isnan(
        [table["sigma_x_m"][0], table["sigma_rz_rad"][0], table["sigma_m"][0], table["nis_per_dof"][0]]
    ).all()


def test_pandas_makes_a_table_with_times(run: sfm.RunResults, monkeypatch: pytest.MonkeyPatch) -> None:
    pandas = pytest.importorskip("pandas")
    frame, read = run.to_pandas(), pandas.read_csv(run.folder / "trajectory.csv")
    assert list(frame.columns) == list(run.table) == list(read.columns)
    assert frame.index[1] == pandas.Timestamp(int(run.stamps_ns[1]))
    assert np.allclose(read["x_m"], frame["x_m"]) and (read["status"] == frame["status"].to_numpy()).all()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sfm.ConfigError, match="pip install pandas, or use `table`"):
        run.to_pandas()


def test_a_killed_run_gives_what_it_has_written(run: sfm.RunResults, tmp_path: Path) -> None:
    shutil.copy(run.folder / "estimates.mcap", tmp_path / "estimates.mcap.part")
    left = sfm.read_results(tmp_path)
    assert len(left) == FRAMES and left.summary == {} and left.config == sfm.Config()


def test_folders_without_results_are_refused_with_the_way_out(run: sfm.RunResults, tmp_path: Path) -> None:
    with pytest.raises(sfm.InputError, match="is not a folder: give the one that a run has written"):
        sfm.read_results(tmp_path / "nowhere")
    with pytest.raises(sfm.InputError, match=r"holds no results \(estimates.mcap\)$"):
        sfm.read_results(tmp_path)
    for method in ("ekf", "cross_frame"):
        shutil.copytree(run.folder, tmp_path / method)
    with pytest.raises(sfm.InputError, match="it holds the results cross_frame, ekf: give one of these"):
        sfm.read_results(tmp_path)
