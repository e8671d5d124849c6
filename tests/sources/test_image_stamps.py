"""Stamps of image files: in their names, or in a table beside them."""

from pathlib import Path

import pytest

import stream_sfm as sfm
from stream_sfm.logs.sources.image_sets import open_images
from tests.helpers.data_sets import camera_pair, write_image_folders

STAMPS_NS = [1_540_820_845_123_456_789 + n * 50_000_000 for n in range(3)]


def stamps_of(folder: Path, names: list[str]) -> tuple[list[int], list[int], list[str]]:
    write_image_folders(folder, names)
    source = open_images(str(folder / "left"), str(folder / "right"), None, path=folder)
    left, right = ([image.stamp_ns for image in side] for side in source.images)
    return left, right, source.notes


@pytest.mark.parametrize(
    ("name", "head", "line"),
    [
        ("left.csv", "#timestamp [ns],filename\n", "{ns},{n}.png"),
        ("left/data.csv", "timestamp,filename\n", "{ns},{n}.png"),
        ("left_images.txt", "# id timestamp image_name\n", "{n} {s}.{part:09d} left/{n}.png"),
        ("images.txt", "", "{n}\t{us}\t{n}"),
        ("stamps.csv", "frame;timestamp_ns;file\n", "{n};{ns};{n}.png"),
    ],
)
def test_a_table_that_lists_the_images_has_their_stamps(tmp_path: Path, name: str, head: str, line: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    rows = [
        line.format(n=f"{n:04d}", ns=ns, us=ns // 1000, s=ns // 10**9, part=ns % 10**9)
        for n, ns in enumerate(STAMPS_NS)
    ]
    (tmp_path / name).write_text(head + "\n".join(rows))
    left, right, (note,) = stamps_of(tmp_path, [f"{n:04d}.png" for n in range(3)])
    expected = [ns // 1000 * 1000 for ns in STAMPS_NS] if "{us}" in line else STAMPS_NS
    assert left == right == expected and str(tmp_path / name) in note


def test_a_table_of_the_left_images_is_for_both_sides(tmp_path: Path) -> None:
    for side in ("l", "r"):
        write_image_folders(tmp_path, [f"{side}_{n}.png" for n in range(3)], (side,))
    (tmp_path / "times.csv").write_text("\n".join(f"{ns},l_{n}.png" for n, ns in enumerate(STAMPS_NS)))
    source = open_images(str(tmp_path / "l"), str(tmp_path / "r"), None, path=tmp_path)
    assert [[image.stamp_ns for image in side] for side in source.images] == [STAMPS_NS] * 2


@pytest.mark.parametrize("line", ["{n} {n}.png", "9 {n}.png", "{ns},other.png", "a {n}.png"])
def test_another_table_says_nothing_about_time(tmp_path: Path, line: str) -> None:
    """It counts the images, has one number for all, lists others, or has no number."""
    (tmp_path / "table.txt").write_text("\n".join(line.format(n=n, ns=ns) for n, ns in enumerate(STAMPS_NS)))
    left, _, (note,) = stamps_of(tmp_path, [f"{n}.png" for n in range(3)])
    assert left == [0, 100_000_000, 200_000_000] and "no stamps and no rate" in note


@pytest.mark.parametrize(
    ("form", "unit_ns"),
    [("img_CAMERA1_{s}.{us:06d}_left.png", 1000), ("{ns}.png", 1), ("frame{ms}.png", 1_000_000)],
)
def test_names_may_contain_their_stamps(tmp_path: Path, form: str, unit_ns: int) -> None:
    names = [form.format(ns=ns, ms=ns // 10**6, s=ns // 10**9, us=ns % 10**9 // 1000) for ns in STAMPS_NS]
    left, right, notes = stamps_of(tmp_path, names)
    assert left == right == [ns // unit_ns * unit_ns for ns in STAMPS_NS] and not notes


def test_a_serial_number_in_all_names_is_no_stamp(tmp_path: Path) -> None:
    left, _, (note,) = stamps_of(tmp_path, [f"1234567890123_{n}.png" for n in range(3)])
    assert left == [0, 100_000_000, 200_000_000] and "no stamps" in note


def test_images_of_cameras_with_stamps_of_their_own_are_paired(tmp_path: Path) -> None:
    names = [[f"{ns + late_ns}.png" for ns in STAMPS_NS] for late_ns in (0, 700_000)]
    for side, of_side in zip(("left", "right"), names, strict=True):
        write_image_folders(tmp_path, of_side, (side,))
    log = sfm.open_log(tmp_path, calibration=camera_pair())
    assert [pair.stamp_ns for pair in log.pairs()] == STAMPS_NS and log.stats.complete
    for name in names[1]:
        (tmp_path / "right" / name).rename(tmp_path / "right" / f"{int(name[:-4]) + 10**10}.png")
    with pytest.raises(sfm.LogError, match="of different times: are they of one recording"):
        sfm.open_log(tmp_path, calibration=camera_pair())
