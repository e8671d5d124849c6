"""Folders of images become logs that read back unchanged; errors are named, and leave no file behind."""

import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.logs.importers import import_euroc, import_images, import_kitti
from stream_sfm.logs.recording.images import decode_grey
from stream_sfm.logs.sources.image_files import ImageFile
from tests.helpers.data_sets import camera_pair, write_kitti, write_picture


@pytest.mark.parametrize("model,d", [("plumb_bob", (-0.1, 0.01, 0, 0)), ("equidistant", (0.01, 0.001, 0, 0))])
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_image_folders_round_trip(tmp_path, model, d, suffix):
    camera = replace(camera_pair().left, D=d, distortion_model=model)
    rig = replace(camera_pair(), left=camera, right=camera)
    (tmp_path / "c.toml").write_text(rig.to_toml())
    files = [[write_picture(tmp_path / s / f"img_{n}{suffix}", suffix) for n in (1, 2, 10)] for s in ("l", "r")]
    globs = (str(tmp_path / "l" / "*"), str(tmp_path / "r" / "*"))
    import_images(*globs, tmp_path / "c.toml", tmp_path / "o.mcap", rate_hz=20)
    log = sfm.open_log(tmp_path / "o.mcap")
    pairs = list(log.pairs())
    assert [p.stamp_ns for p in pairs] == [0, 50_000_000, 100_000_000]
    assert [p.left.data for p in pairs] == [f.read_bytes() for f in files[0]]
    assert [p.right.data for p in pairs] == [f.read_bytes() for f in files[1]]
    assert np.allclose(log.rig.right_from_left, rig.right_from_left, atol=1e-9)
    assert log.rig.left.distortion_model == model and np.allclose(log.rig.left.D[:4], d)


def test_what_is_wrong_is_named_and_nothing_is_left(tmp_path):
    write_kitti(tmp_path / "00")
    out = tmp_path / "o.mcap"
    (tmp_path / "00/image_1/000001.png").write_bytes(b"no image")
    with pytest.raises(sfm.InputError, match=r"000001\.png is not a PNG"):
        import_kitti(tmp_path / "00", out)
    (tmp_path / "00/times.txt").write_text("0\n1\n")
    with pytest.raises(sfm.InputError, match=r"000002\.png"):
        import_kitti(tmp_path / "00", out)
    with pytest.raises(sfm.InputError, match="EuRoC"):
        import_euroc(tmp_path / "00", out)
    with pytest.raises(sfm.InputError, match="image_0 and image_1"):
        import_kitti(tmp_path, out)
    (tmp_path / "c.toml").write_text("")
    with pytest.raises(sfm.ConfigError, match=r"c\.toml"):
        import_images("a*", "b*", tmp_path / "c.toml", out)
    assert not list(tmp_path.glob("o.mcap*"))


@pytest.mark.parametrize("suffix", [".bmp", ".tif", ".tiff", ".pnm"])
@pytest.mark.parametrize("kind", ["grey", "deep", "colour"])
def test_images_that_no_log_holds_become_png_without_loss(tmp_path, suffix, kind, cli):
    if (suffix, kind) == (".bmp", "deep"):
        pytest.skip("BMP has 8 bits")
    rng, shape = np.random.default_rng(3), (48, 64, 3) if kind == "colour" else (48, 64)
    pictures = {}
    for side in ("left", "right"):
        (tmp_path / "r" / side).mkdir(parents=True)
        for n in range(2):
            top = 2**16 if kind == "deep" else 2**8
            pictures[side, n] = rng.integers(0, top, shape).astype(np.uint16 if kind == "deep" else np.uint8)
            cv2.imwrite(str(tmp_path / "r" / side / f"{n}{suffix}"), pictures[side, n])
    (tmp_path / "r/c.toml").write_text(camera_pair().to_toml())
    sides = ["--left", tmp_path / "r/left", "--right", tmp_path / "r/right", tmp_path / "o.mcap"]
    given = ["--calibration", tmp_path / "r/c.toml"]
    cli("import", "images", *(sides + given if kind == "grey" else given + sides))  # OUT is no image
    for log in (sfm.open_log(tmp_path / "r"), sfm.open_log(tmp_path / "o.mcap")):
        for n, pair in enumerate(log.pairs()):
            for side, message in (("left", pair.left), ("right", pair.right)):
                grey = pictures[side, n]
                if kind == "colour":
                    grey = cv2.cvtColor(grey, cv2.COLOR_BGR2GRAY)
                assert message.encoding == "png"
                assert abs(decode_grey(message).astype(int) - grey).max() <= (kind == "colour")
        assert len(list(log.frames())) == 2


def test_a_header_that_declares_gigabytes_is_refused(tmp_path):
    for name, data in (
        ("0.ppm", b"P6 # a camera\n60000 60000\n255\n" + bytes(40)),
        ("0.bmp", b"BM" + bytes(16) + struct.pack("<ii", 60000, 60000) + bytes(40)),
        ("0.tif", b"II*\0" + struct.pack("<IHHHIIHHII", 8, 2, 256, 4, 1, 60000, 257, 4, 1, 60000) + bytes(40)),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(sfm.LogError, match="this image of 60000×60000 pixels cannot be decoded"):
            ImageFile(0, tmp_path / name).read()


def _folders(tmp_path, left, right):
    """Images of these names on each side, and a calibration in millimetres."""
    (tmp_path / "c.toml").write_text(camera_pair(se3.exp([-120.0, 0, 0, 0, 0, 0])).to_toml())
    return [
        [str(write_picture(tmp_path / side / name)) for name in names] for side, names in (("l", left), ("r", right))
    ]


def test_images_are_given_as_a_folder_as_files_or_by_a_glob_that_the_shell_expands(tmp_path, cli):
    names = [f"{n}.png" for n in (1, 2, 10)]
    files = _folders(tmp_path, names, names)
    (tmp_path / "l" / "notes.txt").write_text("not an image")
    out = str(tmp_path / "o.mcap")
    calibration = ["--calibration", str(tmp_path / "c.toml")]
    for left, right in (files, ([str(tmp_path / "l")], [str(tmp_path / "r")])):
        said = cli("import", "images", "--left", *left, "--right", *right, *calibration, "--force", out).err
        assert said.count("120 m: are these millimetres?") == 1
        pairs = list(sfm.open_log(out).pairs())
        assert [p.left.data for p in pairs] == [(tmp_path / "l" / n).read_bytes() for n in names]
        assert [p.right.data for p in pairs] == [(tmp_path / "r" / n).read_bytes() for n in names]


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        # as many on both sides: in order of names, 1 would be paired with 2
        (["a_000.png", "a_001.png"], ["b_000.png", "b_002.png"], "2 of 2 left and 2 right .*a_001.png"),
        (["a.png", "b.png"], ["c.png"], "2 left and 1 right"),
    ],
)
def test_images_without_a_partner_are_named(tmp_path, left, right, words):
    _folders(tmp_path, left, right)
    with pytest.raises(sfm.InputError, match=words):
        import_images(str(tmp_path / "l"), str(tmp_path / "r"), tmp_path / "c.toml", tmp_path / "o.mcap")
    assert not (tmp_path / "o.mcap").exists()


def test_an_image_whose_partner_is_missing_keeps_its_place_in_time(tmp_path):
    """As where a camera dropped a frame; in order of names all that follow would be paired with their neighbours."""
    numbers = {"l": (7, 8, 9, 10, 12), "r": (7, 9, 10, 11, 12)}
    _folders(tmp_path, *([f"{side}_{n}.png" for n in found] for side, found in numbers.items()))
    stamps = tmp_path / "times.txt"
    stamps.write_text("".join(f"{n}.5\n" for n in range(7, 13)))
    done = import_images(str(tmp_path / "l"), str(tmp_path / "r"), tmp_path / "c.toml", tmp_path / "o.mcap", stamps)
    assert any("2 images have no partner" in warning for warning in done.warnings)
    pairs = list(sfm.open_log(tmp_path / "o.mcap").pairs())
    assert [p.stamp_ns for p in pairs] == [n * 10**9 + 5 * 10**8 for n in (7, 9, 10, 12)]
    for pair, n in zip(pairs, (7, 9, 10, 12), strict=True):
        assert pair.left.data == (tmp_path / "l" / f"l_{n}.png").read_bytes()
        assert pair.right.data == (tmp_path / "r" / f"r_{n}.png").read_bytes()
    stamps.write_text("1.0\n2.0\n")
    with pytest.raises(sfm.InputError, match="has 2 times for 6 pairs of images; give one line for each"):
        import_images(str(tmp_path / "l"), str(tmp_path / "r"), tmp_path / "c.toml", tmp_path / "p.mcap", stamps)


def test_images_of_another_size_or_kind_are_named(tmp_path):
    files = _folders(tmp_path, ["0.png", "1.png"], ["0.png", "1.png"])
    give = (str(tmp_path / "l"), str(tmp_path / "r"), tmp_path / "c.toml", tmp_path / "o.mcap")
    (tmp_path / "r" / "1.png").write_bytes(cv2.imencode(".png", np.zeros((24, 32), np.uint8))[1].tobytes())
    with pytest.raises(sfm.InputError, match=r"r/1\.png is 32×24, the calibration is for 64×48"):
        import_images(*give)
    (tmp_path / "r" / "1.png").write_bytes(b"GIF89a")
    with pytest.raises(sfm.InputError, match=r"r/1\.png is not a PNG, JPEG, WebP, BMP, TIFF or PNM image: convert"):
        import_images(*give)
    with pytest.raises(sfm.InputError, match=r"x\* matches no left image"):
        import_images(str(tmp_path / "x*"), *give[1:])
    with pytest.raises(sfm.ConfigError, match="both a left and a right image"):
        import_images(files[0], files[0], *give[2:])
    assert not list(tmp_path.glob("o.mcap*"))


def test_nothing_is_replaced_unless_it_is_allowed_and_never_an_input(tmp_path, cli):
    write_kitti(tmp_path / "00")
    out = tmp_path / "new" / "folder" / "00.mcap"
    command = ["import", "kitti", tmp_path / "00", out]
    cli(*command)
    out.write_bytes(b"mine")
    said = cli(*command, code=3).err
    assert "exists already" in said and said.endswith("hint: use --force\n") and out.read_bytes() == b"mine"
    cli(*command, "--force")
    assert out.stat().st_size > 1000  # bytes: six images
    image = tmp_path / "00" / "image_0" / "000000.png"
    before = image.read_bytes()
    with pytest.raises(sfm.OutputError, match="it is an input of this run"):
        import_kitti(tmp_path / "00", image, overwrite=True)
    assert image.read_bytes() == before
