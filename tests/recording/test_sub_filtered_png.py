"""The quick decoder of grey PNGs gives OpenCV's pixels, or leaves the image to OpenCV."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from stream_sfm.recording import sub_filtered_png

RNG = np.random.default_rng(0)


def png(image: np.ndarray, *flags: int) -> bytes:
    return cv2.imencode(".png", image, list(flags))[1].tobytes()


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def by_hand(
    rows: np.ndarray, filters: int, header: bytes = b"\x08\0\0\0\0", further: bytes = b"", more: int = 0
) -> bytes:
    """A PNG of differences (h, w) that are stored as they are, with a filter in front of each row."""
    stored = np.insert(rows, 0, filters, axis=1).tobytes() + bytes(more)
    size = struct.pack(">II", rows.shape[1], len(rows))
    data = chunk(b"IHDR", size + header) + further + chunk(b"IDAT", zlib.compress(stored)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + data


def differences(image: np.ndarray) -> np.ndarray:
    return np.diff(image, axis=1, prepend=np.uint8(0))  # modulo 256


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (7, 53), (240, 320), (376, 1241)])
def test_pixels_are_those_of_opencv(shape: tuple[int, int]) -> None:
    image = RNG.integers(0, 256, shape).astype(np.uint8)
    data = by_hand(differences(image), 1, further=chunk(b"tEXt", b"Software\0hand"))
    found = sub_filtered_png.decode(data)
    assert found is not None and np.array_equal(found, image)
    assert np.array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), image)


def test_what_opencv_writes_is_decoded() -> None:
    image = RNG.integers(0, 256, (40, 60)).astype(np.uint8)
    found = sub_filtered_png.decode(png(image, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB))
    assert found is not None and np.array_equal(found, image)


def test_other_images_are_left_to_opencv() -> None:
    grey = RNG.integers(0, 256, (40, 60)).astype(np.uint8)
    rows = RNG.integers(0, 256, (40, 60)).astype(np.uint8)
    assert sub_filtered_png.decode(by_hand(rows, 1)) is not None
    others = {
        "colour": png(np.dstack([grey] * 3)),
        "16 bits": png(grey.astype(np.uint16) * 257),
        "another filter": by_hand(rows, 2),
        "filters that change": by_hand(rows, np.r_[np.ones(20, int), 2 * np.ones(20, int)]),
        "interlaced": by_hand(rows, 1, header=b"\x08\0\0\0\1"),
        "transparent": by_hand(rows, 1, further=chunk(b"tRNS", b"\0\7")),
        "two bytes too many": by_hand(rows, 1, more=2),
        "a row too few": by_hand(rows, 1).replace(struct.pack(">II", 60, 40), struct.pack(">II", 60, 41)),
        "gigabytes in few bytes": by_hand(np.zeros((40, 60), np.uint8), 1, more=2**24),
    }
    assert [name for name, data in others.items() if sub_filtered_png.decode(data) is not None] == []


def test_every_flipped_byte_and_every_cut_is_noticed() -> None:
    data = by_hand(differences(RNG.integers(0, 256, (6, 7)).astype(np.uint8)), 1)
    assert sub_filtered_png.decode(data) is not None
    for at in range(8, len(data)):
        damaged = bytearray(data)
        damaged[at] ^= 0x10
        assert sub_filtered_png.decode(bytes(damaged)) is None, at
    for end in range(8, len(data) - 12):
        assert sub_filtered_png.decode(data[:end]) is None
