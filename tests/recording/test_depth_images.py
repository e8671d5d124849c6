"""The depth image of a frame is found by its stamp, with one image held at a time and none read ahead of need."""

import numpy as np

from stream_sfm.recording.ground_truth import DepthImages

STAMPS_NS = (0, 500, 1_000_000_000, 3_000_000_000)


def test_the_image_of_a_stamp_is_found_while_stamps_ascend():
    read = []

    def images():
        for n, stamp in enumerate(STAMPS_NS):
            read.append(stamp)
            yield stamp, np.full((2, 2), n, np.float32)

    depths = DepthImages(images())
    asked = [500_000_000, 999_000_001, 1_000_000_000, 1_001_000_000, 1_001_000_001, 3_000_000_000, 9_000_000_000]
    for stamp, expected, last in zip(asked, [None, 2, 2, 2, None, 3, None], [2, 2, 2, 2, 3, 3, 3], strict=True):
        found = depths.at(stamp)
        assert (None if found is None else int(found[0, 0])) == expected
        assert read == list(STAMPS_NS[: last + 1])
