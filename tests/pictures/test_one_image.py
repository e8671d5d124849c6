"""One camera delivered as both: recognised, reported, and over with its cause."""

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.pictures.one_image import OneImage
from stream_sfm.pictures.prepared import Delivered, Image, PreparedImages
from tests.helpers.places import ROOM

RNG = np.random.default_rng(0)
TEXTURE = RNG.integers(0, 256, (60, 80)).astype(np.uint8)


def nats(left: Image, right: Image) -> float | None:
    check = OneImage()
    return check.nats(
        PreparedImages.of(left, right, 0, delivered=Delivered.of(left, right, check.rules.spacing_px)), ()
    )


@pytest.mark.parametrize("noise", [0, 2])
def test_one_image_is_recognised_even_if_it_is_encoded_twice(noise: int) -> None:
    other = np.clip(TEXTURE.astype(int) + RNG.integers(-noise, noise + 1, TEXTURE.shape), 0, 255).astype(np.uint8)
    same, shifted = nats(TEXTURE, other), nats(TEXTURE, np.roll(TEXTURE, 1, axis=1))
    assert same is not None and shifted is not None and same > 20 and shifted < -20
    bare = np.full_like(TEXTURE, 90)
    assert nats(bare, bare) is None and nats(TEXTURE, TEXTURE[:30]) is None


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
