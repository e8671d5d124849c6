"""The sink: loops closed in a run, live and replayed, lost and found, with bounds."""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.evaluation.association import truth_of_frames
from stream_sfm.geometry import se3
from stream_sfm.logs.mcap_file.log_writer import MessageWriter
from stream_sfm.logs.mcap_file.message import Channel, Message
from stream_sfm.motion import Motion
from stream_sfm.places.place_map import PlaceMap
from stream_sfm.types import FrameEstimate, StereoFrame
from tests.helpers.places import ROOM
from tests.helpers.wall import rig

gtsam = pytest.importorskip("gtsam", reason="GTSAM is not installed: the extra [map]")
from stream_sfm.places.map_file import load_map, save_map  # noqa: E402

PERIOD_NS = 100_000_000
SET_DOWN, AGAIN = 20, 14  # the frame of the room where a second engine begins, and how many it gets
Run = list[tuple[FrameEstimate, StereoFrame]]


@dataclass(frozen=True)
class Room:
    """The sample log, every second frame there and the others back; and some frames more with an engine of their own.

    `truth` (n, 4, 4) and `truth_again`: poses in the first camera of all.
    """

    rig: sfm.StereoRig
    run: Run
    truth: np.ndarray
    again: Run
    truth_again: np.ndarray


@pytest.fixture(scope="module")
def room() -> Room:
    log = sfm.open_log(ROOM)
    frames, poses = list(log.frames()), log.ground_truth()
    assert poses is not None and isinstance(log.rig, sfm.StereoRig)
    truth = truth_of_frames(np.array([frame.stamp_ns for frame in frames]), poses)
    order = [*range(0, len(frames), 2), *range(1, len(frames), 2)[::-1]]
    again = list(range(SET_DOWN, SET_DOWN + AGAIN))
    first = se3.inverse(truth[0])
    run, other = (estimated([frames[k] for k in rows], log.rig) for rows in (order, again))
    return Room(log.rig, run, first @ truth[order], other, first @ truth[again])


def estimated(frames: list[StereoFrame], stereo: sfm.StereoRig) -> Run:
    engine, run = sfm.Engine(stereo), []
    for k, frame in enumerate(frames):
        timed = sfm.StereoFrame(k * PERIOD_NS, frame.left, frame.right)
        run.append((engine.step(timed), timed))
    return run


def drifting(run: Run, turn_rad: float = 0.004) -> Run:
    """The same run of an odometry that turns too far in every frame, and says that it may."""
    odom = [run[0][0].world_from_cam]
    for (before, _), (estimate, _) in pairwise(run):
        motion = se3.inverse(before.world_from_cam) @ estimate.world_from_cam
        odom.append(odom[-1] @ motion @ se3.exp([0, 0, 0, 0, turn_rad, 0]))
    drifted = []
    for k, (estimate, frame) in enumerate(run):
        relative = estimate.relative
        if relative is not None:
            apart = (k - relative.frame_indices)[:, None, None]
            motions = se3.inverse(np.array([odom[i] for i in relative.frame_indices])) @ odom[k]
            cov = relative.cov + apart**2 * np.diag([1e-6] * 3 + [turn_rad**2] * 3)
            relative = replace(relative, frame_from_newest=motions, cov=cov, common_jacobian=None)
        drifted.append((replace(estimate, world_from_cam=odom[k], relative=relative, common=None), frame))
    return drifted


def mapped(room: Room, run: Run | None = None, **settings: object) -> PlaceMap:
    """A map of a run, as it is in the end."""
    places = PlaceMap(room.rig, wait=True, **settings)  # type: ignore[arg-type]
    located_after(places, run or room.run)
    places.close()
    assert not places.problem
    return places


def located_after(places: PlaceMap, run: Run) -> list[bool]:
    """Whether the map has known where the camera is, after each frame."""
    located = []
    for estimate, frame in run:
        places.write(estimate, frame)
        places._settle(True)
        located.append(places.located)
    return located


def path_of(run: Run) -> sfm.Trajectory:
    return sfm.Trajectory(np.array([e.stamp_ns for e, _ in run]), np.array([e.world_from_cam for e, _ in run]))


def test_loops_take_the_drift_away(room: Room) -> None:
    run = drifting(room.run)
    places = mapped(room, run)
    assert len(places.loops) >= 3
    trajectory = path_of(run)
    corrected = places.corrected(trajectory)
    before, after = (np.linalg.norm((t.world_from_cam - room.truth)[:, :3, 3], axis=1) for t in (trajectory, corrected))
    assert before[-1] > 0.1 and after[-1] < before[-1] / 20
    assert np.sqrt((after**2).mean()) < np.sqrt((before**2).mean()) / 3
    end = places.world_from_odom @ run[-1][0].world_from_cam
    assert np.allclose(end, corrected.world_from_cam[-1], atol=1e-9)


def test_where_there_is_no_drift_the_map_does_no_harm(room: Room) -> None:
    places = mapped(room)
    poses = places.poses()
    assert places.loops and poses.cov_pose is not None
    rows = np.searchsorted([e.stamp_ns for e, _ in room.run], poses.stamps_ns)
    error = se3.log(se3.inverse(poses.world_from_cam) @ room.truth[rows])[1:]
    assert np.sqrt((error[:, :3] ** 2).sum(axis=1).mean()) < 0.002
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(poses.cov_pose[1:]), error)
    assert nees.mean() < 12  # twice what is expected of one run: its keyframes are not independent


def test_the_same_frames_give_the_same_map(room: Room) -> None:
    one, other = mapped(room), mapped(room)
    assert one.loops == other.loops
    assert np.array_equal(one.poses().world_from_cam, other.poses().world_from_cam)


def test_live_nothing_waits_and_every_keyframe_is_finished(room: Room) -> None:
    places = PlaceMap(room.rig)
    for estimate, frame in room.run:
        places.write(estimate, frame)
        assert len(places._jobs) <= 2
    places.close()
    assert len(places.poses()) >= 2


def test_lost_and_found(room: Room) -> None:
    """Put down elsewhere, the camera is in its own world until it has seen enough of the old one."""
    run, last = room.run, room.run[-1][0]
    lost = replace(last, status=sfm.Status.LOST, relative=None, common=None)
    shift, shift_ns = last.frame_index + 2, last.stamp_ns + 2 * PERIOD_NS
    carried: Run = [(replace(lost, frame_index=shift - 1, stamp_ns=shift_ns - PERIOD_NS), run[-1][1])]
    for estimate, frame in room.again:
        relative = estimate.relative
        if relative is not None:
            relative = replace(relative, frame_indices=relative.frame_indices + shift)
        moved = replace(
            estimate, frame_index=estimate.frame_index + shift, stamp_ns=estimate.stamp_ns + shift_ns,
            window_frame_indices=estimate.window_frame_indices + shift, relative=relative,
        )  # fmt: skip
        carried.append((moved, frame))
    places = PlaceMap(room.rig, wait=True)
    located_after(places, run)
    located = located_after(places, carried)
    places.close()
    assert not located[1] and located[10]
    end = places.world_from_odom @ carried[-1][0].world_from_cam
    assert np.linalg.norm(se3.log(se3.inverse(end) @ room.truth_again[-1])[:3]) < 0.01


def test_memory_is_bounded(room: Room) -> None:
    places = mapped(room, max_keyframes=20)
    assert 17 <= len(places.poses()) <= 20
    assert np.isfinite(places.poses().world_from_cam).all()


def test_a_map_of_many_keyframes_that_nothing_links_is_bounded_as_any_other(room: Room, tmp_path: Path) -> None:
    """Each in a world of its own, and many more than are kept."""
    mapped(room, room.run[:12]).save(tmp_path / "room.mcap")
    rectifier = PlaceMap(room.rig)._rectifier
    keyframes, state = load_map(tmp_path / "room.mcap", rectifier.projection, rectifier.rect_from_cam)
    numbers, rows = list(range(300)), np.arange(300) % len(keyframes)
    alone = replace(
        state, numbers=numbers, segments=numbers, homes=numbers, poses=state.poses[rows], covs=state.covs[rows],
        links={}, loops=[],
    )  # fmt: skip
    copies = [keyframes[row] for row in rows]
    save_map(tmp_path / "alone.mcap", rectifier.projection, rectifier.rect_from_cam, copies, alone)
    places = mapped(room, room.run[:30], known=tmp_path / "alone.mcap", max_keyframes=100)
    assert len(places) <= 100 and len(places.poses()) > 2
    assert np.isfinite(places.poses().world_from_cam).all()


def test_a_second_run_goes_on_in_a_saved_map(room: Room, tmp_path: Path) -> None:
    first = mapped(room)
    first.save(tmp_path / "room.mcap")
    places = PlaceMap(room.rig, wait=True, known=tmp_path / "room.mcap")
    assert len(places) == len(first)
    located = located_after(places, room.again)
    places.close()
    assert not places.problem and not located[0] and located[10] and places.loops
    error = se3.log(se3.inverse(places.corrected(path_of(room.again)).world_from_cam) @ room.truth_again)
    assert np.linalg.norm(error[:, :3], axis=1).max() < 0.01
    assert len(places.poses()) == len(places) - len(first)
    places.save(tmp_path / "room.mcap")  # extended, in place
    assert len(PlaceMap(room.rig, known=tmp_path / "room.mcap")) == len(places)


def test_where_two_rooms_are_the_same_neither_is_taken_for_it(room: Room, tmp_path: Path) -> None:
    """A saved map with a copy of its room next door: every view fits twice."""
    mapped(room).save(tmp_path / "room.mcap")
    places = PlaceMap(room.rig)
    projection, turn = places._rectifier.projection, places._rectifier.rect_from_cam
    keyframes, state = load_map(tmp_path / "room.mcap", projection, turn)
    n = state.numbers[-1] + 1
    next_door = se3.exp([8, 0, 0, 0, 0, 0]) @ state.poses
    to_next = Motion(se3.inverse(state.poses[-1]) @ next_door[0], 1e-4 * np.eye(6))
    links = state.links | {(n + a, n + b): link for (a, b), link in state.links.items()}
    twice = replace(
        state, links=links | {(state.numbers[-1], n + state.numbers[0]): to_next},
        numbers=[*state.numbers, *(n + number for number in state.numbers)], segments=2 * state.segments,
        homes=2 * state.homes, poses=np.concatenate([state.poses, next_door]),
        covs=np.concatenate([state.covs, state.covs]), loops=[],
    )  # fmt: skip
    save_map(tmp_path / "twice.mcap", projection, turn, 2 * keyframes, twice)
    for known, found in (("room.mcap", True), ("twice.mcap", False)):
        places = mapped(room, room.again, known=tmp_path / known)
        assert bool(places.loops) == found == places.located


def test_a_map_of_nothing_known_goes_on_as_any_other(room: Room, tmp_path: Path) -> None:
    """What is kept says the same as what was saved, to the bit."""
    first = mapped(room, room.run[:30])
    first.save(tmp_path / "a.mcap")
    PlaceMap(room.rig, known=tmp_path / "a.mcap").save(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_files_that_are_no_map_are_refused(room: Room, tmp_path: Path) -> None:
    path = tmp_path / "room.mcap"
    mapped(room, room.run[:12]).save(path)
    whole = path.read_bytes()
    with pytest.raises(sfm.InputError, match="another calibration"):
        PlaceMap(rig(), known=path)
    with pytest.raises(sfm.InputError, match="No such file"):
        PlaceMap(room.rig, known=tmp_path / "none.mcap")
    with pytest.raises(sfm.InputError, match=r"not a file that PlaceMap\.save has written"):
        PlaceMap(room.rig, known=ROOM)
    rng = np.random.default_rng(0)
    for k in range(40):
        damaged = bytearray(whole)
        if k % 2:
            del damaged[int(rng.integers(1, len(whole))) :]
        else:
            damaged[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:  # what a file's index says twice may go
            assert len(PlaceMap(room.rig, known=path)) >= 1
        except sfm.InputError as error:
            assert "room.mcap" in str(error)


def test_a_map_whose_content_does_not_fit_is_refused(room: Room, tmp_path: Path) -> None:
    mapped(room, room.run[:12]).save(tmp_path / "room.mcap")
    places = PlaceMap(room.rig)
    rectifier = places._rectifier
    keyframes, state = load_map(tmp_path / "room.mcap", rectifier.projection, rectifier.rect_from_cam)
    assert len(keyframes) > 1
    numbers, wrong = state.numbers, np.full((4, 4), np.nan)
    fewer = dict(list(state.links.items())[1:])
    cases = [
        (keyframes, replace(state, poses=np.full_like(state.poses, np.nan)), "not finite"),
        (keyframes, replace(state, poses=2 * state.poses), "not a rigid motion"),
        (keyframes, replace(state, covs=-np.ones_like(state.covs)), "not positive definite"),
        (keyframes, replace(state, numbers=numbers[::-1]), "not numbered in order"),
        (keyframes, replace(state, homes=[9] * len(numbers)), "keyframe without a segment"),
        (keyframes, replace(state, links=fewer, loops=[]), "no motion connects its keyframe"),
        (keyframes, replace(state, links={(0, 99): Motion(np.eye(4), np.eye(6))}), "which are not two keyframes"),
        ([replace(keyframes[0], patches=b"x"), *keyframes[1:]], state, "keyframe 0 does not fit together"),
        ([replace(keyframes[0], points=keyframes[0].points[1:]), *keyframes[1:]], state, "does not fit together"),
        ([replace(keyframes[0], odom_from_cam=wrong), *keyframes[1:]], state, "not finite"),
    ]
    for frames, graph, reason in cases:
        save_map(tmp_path / "wrong.mcap", rectifier.projection, rectifier.rect_from_cam, frames, graph)
        with pytest.raises(sfm.InputError, match=reason):
            PlaceMap(room.rig, known=tmp_path / "wrong.mcap")


@pytest.mark.parametrize("head", [[1, 2], None, "map", {"schema_version": [1]}, {}])
def test_a_map_with_another_head_is_refused(head: object, tmp_path: Path) -> None:
    projection = PlaceMap(rig())._rectifier.projection
    with MessageWriter(tmp_path / "odd.mcap") as file:
        channel = Channel("/places/map", "msgpack", "MapRecord", "jsonschema", b"{}")
        file.write(Message(channel, 0, msgspec.msgpack.encode(head)))
    with pytest.raises(sfm.InputError, match=r"odd\.mcap cannot be used as a map"):
        load_map(tmp_path / "odd.mcap", projection, np.eye(3))


def fails(*_: object, **__: object) -> None:
    """As GTSAM does, which says more than a line."""
    raise RuntimeError("\nIndeterminate linear system\ndetected")


def test_where_gtsam_gives_up_the_run_goes_on(
    room: Room, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    places = PlaceMap(room.rig, wait=True)
    monkeypatch.setattr(places._graph, "add", fails)
    located_after(places, room.run[:3])
    places.close()
    assert places.problem == "the map ends at frame 1: Indeterminate linear system"
    assert places.problem in caplog.text  # of the first frame with points


def test_a_map_without_a_solution_keeps_the_poses_of_the_engine(
    room: Room, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("stream_sfm.places.graph.PoseGraph._by_common", fails)
    found = sfm.replay(ROOM, tmp_path, selection=sfm.Selection(max_frames=12), loops=True)
    assert found.summary["map"]["problem"] == "the map has no solution: Indeterminate linear system"
    places = PlaceMap(room.rig, wait=True)
    located_after(places, room.run[:12])
    places.close()
    poses = places.poses()
    assert len(poses) and poses.cov_pose is not None and (np.linalg.eigvalsh(poses.cov_pose[1:]) > 0).all()


@pytest.mark.parametrize(("unknown", "segments"), [(1, 1), (8, 2)], ids=["one frame", "the whole window"])
def test_motions_that_are_not_known_end_a_segment_where_no_other_leads_round_them(
    room: Room, unknown: int, segments: int
) -> None:
    """Rotations of σ 1 rad, as where the motion of a body may be the camera's; the world is as uncertain then."""
    run, large = list(room.run[:24]), np.diag([0.2**2] * 3 + [1.0] * 3)
    for k in range(8, len(run)):
        estimate, frame = run[k]
        if k < 8 + unknown:
            assert estimate.relative is not None
            relative = replace(estimate.relative, cov=estimate.relative.cov + large)
            estimate = replace(estimate, status=sfm.Status.DEGRADED, relative=relative)
        run[k] = replace(estimate, cov_pose=estimate.cov_pose + (large if unknown > 1 else 0.0)), frame
    places = mapped(room, run)
    assert len(set(places._graph.segments.tolist())) == segments
    cov = places.poses().cov_pose
    assert cov is not None and (cov[-1, 3, 3] > 0.9) == (segments == 2)


def test_a_replay_writes_what_follows_from_its_loops(room: Room, tmp_path: Path) -> None:
    few = sfm.Selection(max_frames=12)
    plain, with_loops = (sfm.replay(ROOM, tmp_path / str(loops), selection=few, loops=loops) for loops in (0, 1))
    assert with_loops.summary["map"]["keyframes"] >= 1
    assert with_loops.summary["map"]["ground_truth"]["frames_compared"] == 12
    assert with_loops.out_dir is not None and plain.out_dir is not None
    assert len(sfm.read_results(with_loops.out_dir).trajectory) == 12
    lines = (with_loops.out_dir / "trajectory_map.tum").read_text().splitlines()
    same = (with_loops.out_dir / "trajectory.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [line.split()[0] for line in same]
    assert (plain.out_dir / "trajectory.tum").read_text().splitlines() == same  # the engine does not know the map
    assert "map" not in plain.summary and not (plain.out_dir / "trajectory_map.tum").exists()


def test_a_map_that_cannot_be_written_costs_no_results(room: Room, tmp_path: Path) -> None:
    few, nowhere = sfm.Selection(max_frames=6), tmp_path / "none" / "map.mcap"
    with pytest.raises(sfm.OutputError, match=r"map\.mcap"):
        sfm.replay(ROOM, tmp_path / "out", selection=few, save_map=nowhere)
    results = sfm.read_results(tmp_path / "out")
    assert len(results.trajectory) == 6 and (tmp_path / "out" / "summary.json").exists()


def test_requirements_of_a_map_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(sfm.ConfigError, match="pair of cameras"):
        PlaceMap(sfm.MonoRig(rig().left))  # type: ignore[arg-type]
    monkeypatch.setattr("stream_sfm.places.graph.gtsam", None)
    with pytest.raises(sfm.ConfigError, match=r"pip install gtsam, or this package with its extra \[map\]"):
        PlaceMap(rig())
