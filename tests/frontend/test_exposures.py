"""Exposures that change: each template is compared with the gain since its own frame."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.frontend.templates import TemplateRules
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, camera_path, rig

RADIUS_PX, SPACING_PX, STD_GREY = 8, 2, 1.0
CORNERS = np.stack(np.meshgrid(range(30, 290, 20), range(30, 210, 20)), axis=2).reshape(-1, 2)
CUT = [(1.0, 0.0, 90), (0.5, 20.0, 60), (0.7, 5.0, 30), (0.4, 0.0, 20), (0.85, 10.0, 8)]  # gain, offset, templates
LAST, NOW = (0.9, -4.0), (0.6, 8.0)  # gains and offsets of two images


def test_templates_of_many_exposures_have_the_same_error() -> None:
    """The deviation of grey differences is that of the noise, in grey values of each template."""
    rng = np.random.default_rng(3)
    scene = Wall(1).image(rig().left, np.eye(4)).astype(float)

    def noisy(gain: float, offset: float) -> np.ndarray:
        return (gain * scene + offset + STD_GREY * rng.normal(size=scene.shape)).astype(np.float32)

    patches, before, starts = [], [], []
    for gain, offset, count in CUT:
        points, slots = CORNERS[:count], np.arange(count)
        stored = np.zeros((count, 41, 41), np.float32)
        core.store_patches(stored, noisy(gain, offset), points, slots)
        facing = np.tile(np.eye(3, 2), (count, 1, 1))
        patches.append(core.warp_patches(stored, slots, facing, RADIUS_PX, SPACING_PX, TemplateRules()))
        before.append(np.tile([LAST[0] / gain, LAST[1] - LAST[0] / gain * offset], (count, 1)))
        starts.append(points.astype(float))
    given = np.concatenate(starts), *map(np.concatenate, zip(*patches, strict=True)), np.concatenate(before)
    _, found, errors, exposures, _ = core.align_patches(noisy(*NOW), *given, RADIUS_PX, SPACING_PX, TemplateRules())
    of_frames = np.cumsum([0] + [count for *_, count in CUT])
    for (gain, offset, _), first, end in zip(CUT, of_frames[:-1], of_frames[1:], strict=True):
        there = found[first:end]
        (gain_now, offset_now), *others = exposures[first:end][there]
        assert (others == np.array([gain_now, offset_now])).all()
        assert gain_now == pytest.approx(NOW[0] / gain, rel=0.05)
        middle = gain * np.median(scene) + offset
        assert gain_now * middle + offset_now == pytest.approx(NOW[0] * np.median(scene) + NOW[1], abs=0.5)
        expected = STD_GREY * np.hypot(1, gain / NOW[0])  # noise of both images
        assert there.mean() > 0.9
        assert np.median(errors[first:end][there]) == pytest.approx(expected, rel=0.2)


def test_changes_smaller_than_one_of_the_exposure_leave_templates_unchanged() -> None:
    """Patches have more contrast than their templates, and images are slightly brighter."""
    rng = np.random.default_rng(4)
    scene = cv2.GaussianBlur(Wall(1).image(rig().left, np.eye(4)).astype(np.float32), (0, 0), 1.5)
    slots, stored = np.arange(len(CORNERS)), np.zeros((len(CORNERS), 41, 41), np.float32)
    core.store_patches(stored, scene, CORNERS, slots)
    facing, before = np.tile(np.eye(3, 2), (len(CORNERS), 1, 1)), np.tile([0.7, 3.0], (len(CORNERS), 1))
    patches = core.warp_patches(stored, slots, facing, RADIUS_PX, SPACING_PX, TemplateRules())
    coarse = cv2.GaussianBlur(scene, (0, 0), 12)
    sharper = 1.02 * (0.7 * (coarse + 1.3 * (scene - coarse)) + 3.0) + rng.normal(size=scene.shape)
    given = CORNERS.astype(float), *patches, before
    image = sharper.astype(np.float32)
    _, found, _, exposures, _ = core.align_patches(image, *given, RADIUS_PX, SPACING_PX, TemplateRules())
    assert found.mean() > 0.9
    assert (exposures == before).all()


def test_a_track_knows_its_exposure_since_it_began() -> None:
    """Exposures differ from frame to frame, and between the cameras."""
    gains = [1.0, 0.6, 0.9, 0.5, 0.45, 0.8, 1.0, 0.7]
    stereo, wall, front = rig(), Wall(3), SteppedFrontEnd(rig())
    begun: dict[int, int] = {}
    for n, (pose, gain) in enumerate(zip(camera_path(len(gains)), gains, strict=True)):
        frame = wall.frame(stereo, pose, n)
        left, right = (np.rint(g * i).astype(np.uint8) for g, i in ((gain, frame.left), (0.5, frame.right)))
        front.step(replace(frame, left=left, right=right))
        tracks = front.state.tracks
        for i in tracks.ids.tolist():
            begun.setdefault(i, n)
        expected = gain / np.array([gains[begun[i]] for i in tracks.ids.tolist()])
        assert tracks.exposures[:, 0] == pytest.approx(expected, rel=0.05)
        assert (np.abs(tracks.exposures[:, 1]) < 5.0).all()
    assert len(set(begun.values())) > 2
    assert sum(begun[i] == 0 for i in tracks.ids.tolist()) > 30
