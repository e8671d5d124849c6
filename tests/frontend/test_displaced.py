"""One image on both sides: reported, and over with its cause; and poses after an uncertain one."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.config.image_rules import ImageRules
from stream_sfm.estimators.motion_model import Doubts, MotionModel
from stream_sfm.frontend.image_checks import are_one_image
from stream_sfm.geometry import se3
from tests.helpers.places import ROOM

RNG = np.random.default_rng(0)
TEXTURE = RNG.integers(0, 256, (60, 80)).astype(np.uint8)


def test_after_an_uncertain_pose_its_velocity_is_uncertain() -> None:
    model, nothing = MotionModel(sfm.Config().motion), np.zeros((6, 6))
    for n in range(3):
        model.add(n * 10**8, np.eye(4), nothing)
    step = np.array([0.1, 0, 0, 0, 0, 0])
    model.add(3 * 10**8, se3.exp(step), nothing, Doubts(misfit=True))
    for frames in (1, 2, 5):  # lost frames since then
        pose, cov = model.predict((3 + frames) * 10**8)
        np.testing.assert_allclose(pose[0, 3], 0.1 * (1 + frames))
        assert np.sqrt(cov[0, 0]) > pose[0, 3]


@pytest.mark.parametrize("noise", [0, 2])
def test_one_image_is_recognised_even_if_it_is_encoded_twice(noise: int) -> None:
    other = np.clip(TEXTURE.astype(int) + RNG.integers(-noise, noise + 1, TEXTURE.shape), 0, 255).astype(np.uint8)
    assert are_one_image(TEXTURE, other, ImageRules())
    assert not are_one_image(TEXTURE, np.roll(TEXTURE, 1, axis=1), ImageRules())
    assert not are_one_image(
        np.full_like(TEXTURE, 90), np.full_like(TEXTURE, 90), ImageRules()
    )  # a bare image: other checks report it


def test_while_both_sides_are_one_image_no_frame_is_ok() -> None:
    log, statuses = sfm.open_log(ROOM), []
    engine = sfm.Engine(log.rig)
    for n, frame in enumerate(log.frames(sfm.Selection(max_frames=24))):
        given = sfm.StereoFrame(frame.stamp_ns, frame.left, frame.left.copy()) if 8 <= n < 14 else frame
        estimate = engine.step(given)
        statuses.append(estimate.status)
        if 8 <= n < 14:
            assert estimate.reason
    assert "ok" not in statuses[8:14] and "ok" in statuses[18:]
