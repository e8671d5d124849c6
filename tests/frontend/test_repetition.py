"""A turn in front of a wall of equal tiles, by more than half a tile per frame: the view does not show by how many."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from stream_sfm import Engine, FrameEstimate, open_log
from stream_sfm.geometry import se3
from stream_sfm.types import Status
from tests.helpers.places import ROOT
from tests.helpers.wall import Wall, rig
from tools.render.inertial import BMI160, measured

STEREO = rig()
TILE_M = 0.25  # 22 px
WIDE_TILE_M = 0.4  # 35 px: look-alikes are farther off than a patch is wide
TILED = ROOT.parent / "shared/logs/tiled.mcap"  # may be absent
POSES = [se3.exp([0, 0, 0, 0, 0.05 * k, 0]) for k in range(18)]  # 13 px per frame


def tiled_wall(same: float, tile_m: float = TILE_M) -> Wall:
    """A wall of tiles; the share `same` of the contrast is a print on every tile, the rest is different everywhere."""
    wall = Wall(4)
    n = round(tile_m / wall.TEXEL_M)
    count = wall.SIZE // n + 1
    prints = np.tile(wall.texture[:n, :n], (count, count))[: wall.SIZE, : wall.SIZE]
    wall.texture = np.rint(same * prints + (1 - same) * wall.texture).astype(np.uint8)
    return wall


def estimates(wall: Wall, frames: int = 5) -> list[FrameEstimate]:
    """The estimates of all frames but the first."""
    engine = Engine(STEREO)
    return [engine.step(wall.frame(STEREO, pose, k)) for k, pose in enumerate(POSES[:frames])][1:]


def errors_m(found: list[FrameEstimate]) -> np.ndarray:
    """The errors of the positions."""
    apart = [se3.log(se3.inverse(e.world_from_cam) @ pose) for e, pose in zip(found, POSES[1:], strict=False)]
    return np.linalg.norm(np.array(apart)[:, :3], axis=1)


def test_a_motion_that_may_be_off_by_a_tile_is_the_small_one_and_degraded() -> None:
    found = estimates(tiled_wall(same=1.0))
    assert all(e.status is Status.DEGRADED and "two rigid motions" in e.reason for e in found)
    assert errors_m(found).max() < 0.1 * TILE_M
    assert all(np.sqrt(np.trace(e.cov_pose[:3, :3])) > TILE_M for e in found)  # the other motion is covered


@pytest.mark.parametrize("same", [0.0, 0.6])
def test_a_wall_with_enough_unique_texture_causes_no_ambiguity(same: float) -> None:
    found = estimates(tiled_wall(same))
    assert all(e.status is Status.OK for e in found)
    assert errors_m(found).max() < 0.01


def test_a_unique_object_settles_the_earlier_motions() -> None:
    wall = tiled_wall(same=1.0)
    first = wall.SIZE // 2 + round(1.7 / wall.TEXEL_M)  # at the right end of the first image
    wall.texture[:, first:] = Wall(4).texture[:, first:]
    found = estimates(wall, 18)
    degraded = [e.status is Status.DEGRADED for e in found]
    settled = degraded.index(False)
    assert settled > 1 and not any(degraded[settled:])
    std_m = [float(np.sqrt(np.trace(e.cov_pose[:3, :3]))) for e in found]
    assert std_m[settled - 1] > TILE_M  # until points that begin then confirm it
    assert max(std_m[settled:]) < 0.02
    assert errors_m(found).max() < 0.02


@pytest.mark.parametrize("sticker_m", [0.2, 0.3])
def test_a_few_patches_that_look_different_settle_it_over_some_frames(sticker_m: float) -> None:
    """A sticker is in view from the start; three or four patches on it are too few in one frame."""
    wall = tiled_wall(same=1.0, tile_m=WIDE_TILE_M)
    n, first = round(sticker_m / wall.TEXEL_M), wall.SIZE // 2 + round(0.1 / wall.TEXEL_M)
    wall.texture[first : first + n, first : first + n] = Wall(7).texture[first : first + n, first : first + n]
    found = estimates(wall, 12)
    statuses = [e.status for e in found]
    settled = statuses.index(Status.OK)
    assert 1 <= settled <= 8 and all(status is Status.OK for status in statuses[settled:])
    assert errors_m(found).max() < 0.005
    assert max(float(np.sqrt(np.trace(e.cov_pose[:3, :3]))) for e in found[settled:]) < 0.02


def test_without_anything_unique_wide_tiles_stay_ambiguous() -> None:
    found = estimates(tiled_wall(same=1.0, tile_m=WIDE_TILE_M), 14)
    assert all(e.status is Status.DEGRADED for e in found)


@pytest.mark.skipif(not TILED.is_file(), reason="the log is not here")
def test_in_a_recording_a_sticker_ends_the_ambiguity_of_tiles() -> None:
    """Until then no frame is ok: what views share, such as a turn of the right camera, explains no second motion."""
    log = open_log(TILED)
    engine = Engine(log.rig)
    found = [engine.step(frame) for frame in islice(log.frames(), 13)][1:]
    ambiguous = ["two rigid motions" in e.reason for e in found]
    assert all(ambiguous[:3]) and not any(ambiguous[8:])
    assert all(e.status is not Status.OK for e in found[:3])


def test_predictions_by_samples_cover_the_other_motion_too() -> None:
    start_ns, wall = 10**9, tiled_wall(same=1.0)
    samples = measured(
        lambda t: se3.exp([0, 0, 0, 0, t, 0]), (-0.2, 0.3), np.array([0.0, 1.0, 0.0]), seed=3, start_ns=start_ns
    )
    engine, std_m = Engine(replace(STEREO, imu=BMI160.calibration)), []
    for k, pose in enumerate(POSES[:4]):
        frame = wall.frame(STEREO, pose, k)
        estimate = engine.step(replace(frame, stamp_ns=frame.stamp_ns + start_ns, imu=samples))
        if k:
            found = engine.predict(estimate.stamp_ns + 10_000_000)
            assert found is not None and estimate.inertial is not None
            covs = found.cov_pose, estimate.cov_pose, estimate.inertial.cov[:6, :6]
            std_m.append([float(np.sqrt(np.trace(cov[:3, :3]))) for cov in covs])
    assert all(min(stds) > TILE_M for stds in std_m)
