"""Exposures that change: each template is compared by the gain of its own frame."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config.point_rules import TemplateRules
from tests.helpers.front_end import SteppedFrontEnd
from tests.helpers.wall import Wall, camera_path, rig

RADIUS_PX, SPACING_PX, STD_GREY = 8, 2, 1.0
CORNERS = np.stack(np.meshgrid(range(30, 290, 20), range(30, 210, 20)), axis=2).reshape(-1, 2)
SLOTS, FACING = np.arange(len(CORNERS)), np.tile(np.eye(3, 2), (len(CORNERS), 1, 1))
CUT = [
    (1.0, 0.0),
    (0.5, 20.0),
    (0.7, 5.0),
    (0.4, 0.0),
    (0.85, 10.0),
]  # gain and offset of the images with templates
NOW = 0.6, 8.0


def seen(scene: np.ndarray, gain: float, offset: float) -> np.ndarray:
    return (gain * scene + offset).astype(np.float32)


def test_templates_of_many_exposures_are_worth_the_same() -> None:
    """The deviation of grey differences is that of the noise, in grey values of each template."""
    rng = np.random.default_rng(3)
    scene = Wall(1).image(rig().left, np.eye(4)).astype(float)
    noise = [STD_GREY * rng.normal(size=scene.shape) for _ in (*CUT, NOW)]
    now, before = seen(scene, *NOW) + noise[-1].astype(np.float32), (0.9, -4.0)  # the last image
    exposures, patches = [], []
    for (gain, offset), cut_noise in zip(CUT, noise[:-1], strict=True):
        stored = np.zeros((len(CORNERS), 41, 41), np.float32)
        core.store_patches(stored, seen(scene, gain, offset) + cut_noise.astype(np.float32), CORNERS, SLOTS)
        patches.append(core.warp_patches(stored, SLOTS, FACING, RADIUS_PX, SPACING_PX, TemplateRules()))
        of_last = before[0] / gain, before[1] - before[0] / gain * offset
        exposures.append(np.tile(of_last, (len(CORNERS), 1)))
    inverse, information, level = (np.concatenate(parts) for parts in zip(*patches, strict=True))
    starts = np.tile(CORNERS, (len(CUT), 1)).astype(float)
    _, found, errors, exposure = core.align_patches(
        now, starts, inverse, information, level, np.concatenate(exposures), RADIUS_PX, SPACING_PX, TemplateRules()
    )
    gain = NOW[0] / before[0]
    assert exposure[0] == pytest.approx(gain, rel=0.03)
    last, mean = np.median(seen(scene, *before)), np.median(seen(scene, *NOW))
    assert exposure[0] * last + exposure[1] == pytest.approx(mean, abs=0.5)
    for k, (gain, _) in enumerate(CUT):
        of_cut = slice(k * len(CORNERS), (k + 1) * len(CORNERS))
        expected = STD_GREY * np.hypot(1, gain / NOW[0])  # noise of both images
        assert found[of_cut].mean() > 0.9
        assert np.median(errors[of_cut][found[of_cut]]) == pytest.approx(expected, rel=0.15)


def test_a_track_knows_its_exposure_since_it_began() -> None:
    """After exposures that differ from frame to frame, and otherwise in either camera."""
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
