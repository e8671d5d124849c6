"""Single images: channels in their order, 16 bits, padding, depth in metres."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from stream_sfm.camera.pixels import GreyScaler
from stream_sfm.logs.recording.images import (
    UndecodableImage,
    decode_depth_m,
    decode_grey,
    decode_plain_png,
    image_size,
)
from stream_sfm.logs.recording.messages import ImageMessage
from tests.helpers.stereo_logs import scene

RED, GREEN, BLUE = 200, 100, 50
LUMA = 0.299 * RED + 0.587 * GREEN + 0.114 * BLUE


def raw(encoding: str, pixels: np.ndarray, big_endian: bool = False, step: int = 0) -> ImageMessage:
    """A raw image of `pixels` (h, w) or (h, w, channels)."""
    height, width = pixels.shape[:2]
    return ImageMessage("/c", 0, "c", False, encoding, pixels.tobytes(), width, height, step, big_endian)


@pytest.mark.parametrize("order", ["rgb", "bgr", "rgba", "bgra"])
@pytest.mark.parametrize("bits", [8, 16])
def test_channels_are_taken_in_their_order(order, bits):
    scale = 1 if bits == 8 else 256
    values = {"r": RED, "g": GREEN, "b": BLUE, "a": 255}
    pixels = np.full((20, 30, len(order)), [scale * values[c] for c in order], f"<u{bits // 8}")
    assert decode_grey(raw(f"{order}{bits}", pixels))[5, 5] == pytest.approx(scale * LUMA, abs=scale)
    if bits == 16:
        swapped = pixels.astype(">u2")
        assert decode_grey(raw(f"{order}16", swapped, True))[5, 5] == pytest.approx(scale * LUMA, abs=scale)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_are_distinguished(pattern):
    values = [{"r": RED, "g": GREEN, "b": BLUE}[c] for c in pattern]
    pixels = np.tile(np.array(values, np.uint8).reshape(2, 2), (10, 15))
    # a whole grey level, and demosaicing rounds
    assert decode_grey(raw(f"bayer_{pattern}8", pixels))[8, 8] == pytest.approx(LUMA, abs=1.5)
    wide = (pixels.astype(np.uint16) * 256).astype("<u2")
    assert decode_grey(raw(f"bayer_{pattern}16", wide))[8, 8] == pytest.approx(256 * LUMA, abs=400)


@pytest.mark.parametrize(("suffix", "flags"), [(".png", []), (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95]), (".webp", [])])
def test_colour_files_become_grey_and_tell_their_size(suffix, flags):
    data = cv2.imencode(suffix, np.full((20, 30, 3), [BLUE, GREEN, RED], np.uint8), flags)[1].tobytes()
    message = ImageMessage("/c", 0, "c", True, suffix, data)
    assert decode_grey(message)[5, 5] == pytest.approx(LUMA, abs=2)
    assert image_size(message) == (30, 20)


def filtered_png(pixels: np.ndarray, filter: int) -> bytes:
    """A PNG of grey `pixels`, each row with that filter of the specification."""
    size = pixels.itemsize
    rows = pixels.astype(pixels.dtype.newbyteorder(">")).view(np.uint8).astype(int)
    left, up, corner = (
        np.pad(rows, ((d, 0), (s, 0)))[: len(rows), : rows.shape[1]] for d, s in ((0, size), (1, 0), (1, size))
    )
    guess = left + up - corner
    apart = np.stack([abs(guess - left), abs(guess - up), abs(guess - corner)])
    paeth = np.choose(apart.argmin(axis=0), [left, up, corner])
    predicted = (0 * rows, left, up, (left + up) // 2, paeth, 0 * rows)[filter]  # the last one does not exist
    filtered = np.insert((rows - predicted) % 256, 0, filter, axis=1).astype(np.uint8)
    header = struct.pack(">IIBBBBB", pixels.shape[1], len(pixels), 8 * size, 0, 0, 0, 0)
    chunks = (b"IHDR" + header, b"IDAT" + zlib.compress(filtered.tobytes()), b"IEND")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("filter", range(5))
def test_plain_pngs_have_the_pixels_that_were_put_in(kind, filter):
    pixels = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (23, 31)).astype(kind)
    decoded = decode_plain_png(filtered_png(pixels, filter))
    assert decoded is not None and decoded.dtype == kind
    assert (decoded == pixels).all()


def test_a_png_that_is_damaged_anywhere_is_left_to_the_other_decoder():
    pixels = np.random.default_rng(0).integers(0, 256, (9, 13)).astype(np.uint8)
    data = filtered_png(pixels, 4)
    assert decode_plain_png(filtered_png(pixels, 5)) is None  # no such filter
    for at in range(8, len(data)):  # the signature has been looked at before; the checksum of IEND is not needed
        for damaged in (data[:at], data[:at] + bytes([data[at] ^ 64]) + data[at + 1 :]):
            decoded = decode_plain_png(damaged)
            assert decoded is None or (decoded == pixels).all()


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_cameras_of_more_than_8_bits_lose_their_lowest_ones(bits):
    grey = scene(0, 0)
    grey[0, 0] = 255
    (scaled,) = GreyScaler().to_uint8(decode_grey(raw("mono16", grey.astype("<u2") << (bits - 8))))
    np.testing.assert_array_equal(scaled, grey)


def test_rows_may_be_padded_and_the_last_one_cut_short():
    grey = scene(0, 0)
    padded = np.pad(grey, ((0, 0), (0, 9))).tobytes()[:-9]
    message = ImageMessage("/c", 0, "c", False, "mono8", padded, grey.shape[1], grey.shape[0], grey.shape[1] + 9)
    np.testing.assert_array_equal(decode_grey(message), grey)
    with pytest.raises(UndecodableImage, match="bytes per row"):
        decode_grey(ImageMessage("/c", 0, "c", False, "mono8", padded[:-1], *grey.shape[::-1], grey.shape[1] + 9))


DEPTH_M = np.array([[0.0, 0.5], [2.0, 6.5]], np.float32)
KNOWN = DEPTH_M > 0


def check_depth(message: ImageMessage, tolerance_m: float) -> None:
    depth_m = decode_depth_m(message)
    assert depth_m.dtype == np.float32 and np.isnan(depth_m[~KNOWN]).all()
    np.testing.assert_allclose(depth_m[KNOWN], DEPTH_M[KNOWN], atol=tolerance_m)


def png(values: np.ndarray) -> bytes:
    return cv2.imencode(".png", values.astype(np.uint16))[1].tobytes()


MILLIMETRES, METRES = DEPTH_M * 1e3, np.where(KNOWN, DEPTH_M, np.nan)


@pytest.mark.parametrize(
    "message",
    [
        ImageMessage("/d", 0, "c", True, "png", png(DEPTH_M * 1e4)),  # tenths of millimetres: the log profile
        raw("16UC1", MILLIMETRES.astype("<u2")),
        raw("16UC1", MILLIMETRES.astype(">u2"), True),
        raw("32FC1", METRES.astype("<f4")),
        raw("32FC1", np.nan_to_num(METRES, nan=np.inf).astype(">f4"), True),
    ],
)
def test_depth_is_in_metres(message):
    check_depth(message, 1e-6)


def test_compressed_depth_of_ros():
    """As compressed_depth_image_transport writes it: millimetres, or inverse depth quantised to 16 bits."""
    header = struct.pack("<iff", 0, 0.0, 0.0)
    data = header + png(DEPTH_M * 1e3)
    check_depth(ImageMessage("/d", 0, "c", True, "16UC1; compressedDepth png", data), 1e-6)
    quantisation, farthest_m = 100.0, 10.0
    scale = quantisation * (quantisation + 1)
    shift = 1 - scale / farthest_m
    inverse = np.where(KNOWN, scale / np.maximum(DEPTH_M, 1e-3) + shift, 0)
    data = struct.pack("<iff", 0, scale, shift) + png(np.rint(inverse))
    check_depth(ImageMessage("/d", 0, "c", True, "32FC1; compressedDepth", data), 6.5**2 / scale)


@pytest.mark.parametrize(
    "message",
    [
        ImageMessage("/d", 0, "c", True, "16UC1; compressedDepth png", b"short"),
        ImageMessage("/d", 0, "c", True, "16UC1; compressedDepth rvl", struct.pack("<iff", 0, 0, 0) + b"rvl" * 9),
        ImageMessage("/d", 0, "c", True, "png", cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()),
        raw("32FC1", np.zeros((4, 4), np.uint8)),
    ],
)
def test_an_image_without_depth_says_so(message):
    with pytest.raises(UndecodableImage, match=r"/d|/c"):
        decode_depth_m(message)


@pytest.mark.parametrize("marker", [0x01, 0xD0])
def test_the_size_of_a_jpeg_is_the_one_it_decodes_to(marker):
    """Behind a marker without length, where a reader that expects one would be led to another size."""
    found = cv2.imencode(".jpg", scene(0, 0))[1].tobytes()
    led_to = 4 + struct.unpack_from(">H", found, 2)[0]
    lie = struct.pack(">BBHBHH", 0xFF, 0xC0, 11, 8, 10, 20) + bytes(6)
    data = (b"\xff\xd8\xff" + bytes([marker]) + found[2:]).ljust(led_to, b"\0") + lie
    height, width = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE).shape
    assert image_size(ImageMessage("/c", 0, "c", True, "jpeg", data)) == (width, height)
