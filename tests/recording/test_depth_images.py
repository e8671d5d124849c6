"""The depth image of a frame is found by its stamp, with one image held at a time."""

import numpy as np

from stream_sfm.recording.ground_truth import DepthImages

STAMPS_NS = (0, 500, 1_000_000_000, 3_000_000_000)


def test_the_image_of_a_stamp_is_found_while_stamps_ascend():
    images = DepthImages((stamp, np.full((2, 2), n, np.float32)) for n, stamp in enumerate(STAMPS_NS))
    asked = [500_000_000, 999_000_001, 1_000_000_000, 1_001_000_000, 1_001_000_001, 3_000_000_000, 9_000_000_000]
    found = [images.at(stamp) for stamp in asked]
    assert [None if depth is None else int(depth[0, 0]) for depth in found] == [None, 2, 2, 2, None, 3, None]


def test_no_image_is_read_ahead_of_need():
    read = []

    def images():
        for stamp in STAMPS_NS:
            read.append(stamp)
            yield stamp, np.zeros((2, 2), np.float32)

    depths = DepthImages(images())
    assert not read
    depths.at(1_000_000_000)
    assert read == list(STAMPS_NS[:3])
