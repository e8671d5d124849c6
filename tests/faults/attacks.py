"""Hostile inputs of many kinds, made by a seed: damaged logs, definitions of messages, images, and texts.

Each attack puts files into a folder and gives the words of a command. Whatever they are, the command ends with the
exit code of a success or of a named error, prints nothing that a terminal obeys, and changes no file but its results.
"""

import contextlib
import io
import os
import random
import re
import shutil
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stream_sfm.cli.main import main
from tests.faults.damage import INDEXES, KINDS, damaged, whole_log
from tests.faults.fuzz import Trial
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.stereo_logs import CONTAINERS, START_NS, LogWriter, Spec, write_log
from tests.helpers.wall import rig

_FAST = ["--method", "frame-to-frame", "--max-frames", "4"]
_ODD_NUMBERS = (
    "-1", "0", "1", "2147483648", "4294967295", "18446744073709551616", "9" * 400, "1e400", "0x" + "f" * 300, "nan",
)  # fmt: skip
_ENCODINGS = (
    ("cdr", "ros2idl"), ("cdr", "ros2msg"), ("ros1", "ros1msg"), ("json", "jsonschema"), ("protobuf", "protobuf"),
)  # fmt: skip
_TYPES = (
    "sensor_msgs/msg/Image", "sensor_msgs/Image", "foxglove.CompressedImage", "p/msg/T", "tf2_msgs/msg/TFMessage",
)  # fmt: skip
_OTHER = b"a file of somebody else"


@dataclass
class Attack:
    """A command, and what it may change: names in the folder, and everything below those that are folders."""

    words: list[str]
    results: tuple[str, ...] = ("out",)


class Ammunition:
    """What attacks are made of, prepared once."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self.log = write_log(folder / "log.mcap", Spec(left=tuple(range(4)), right=tuple(range(4))))
        numbers = {"left": tuple(range(5)), "right": tuple(range(5))}
        self.logs = [
            whole_log(write_log(folder / f"{profile}.mcap", Spec(profile, encoding, **numbers), **container))
            for profile, encoding, container in (
                ("foxglove", "png", CONTAINERS["unchunked"]),
                ("ros2", "mono8", CONTAINERS["zstd"]),
                ("json", "jpeg", CONTAINERS["lz4"]),
                ("ros1", "mono8", CONTAINERS["no index"]),
            )
        ]
        self.png = bytes(cv2.imencode(".png", self._picture)[1])
        self.images = [self.png] + [
            bytes(cv2.imencode(kind, self._picture, flags)[1])
            for kind, flags in ((".jpg", []), (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]), (".webp", []))
        ]
        self.calibration = rig().to_toml()
        old, new = (messages_of(write_log(folder / f"for_bag_{p}.mcap", Spec(profile=p))) for p in ("ros1", "ros2"))
        self.bags = [write_bag1(folder / f"{c}.bag", old, c, 1 << 14) for c in ("none", "bz2", "lz4")]
        self.bags += [write_bag2(folder / f"bag_{n}", new, compression=c) for n, c in enumerate((None, "file"))]
        self.run = folder / "run"
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            main(["replay", str(self.log), "--out", str(self.run), "-q", *_FAST])

    @property
    def _picture(self) -> np.ndarray:
        return np.random.default_rng(0).integers(0, 255, (64, 96), np.uint8)


def _command(rng: random.Random, log: str, folder: Path) -> list[str]:
    """A command that reads a log."""
    out = str(folder / "out")
    commands = (
        ["inspect", log],
        ["inspect", log, "--json"],
        ["replay", log, "--out", out, *_FAST],
        ["replay", log, "--out", out, *_FAST, "--json"],
        ["recover", log, f"{out}/recovered.mcap"],
        ["surface", log, "--out", f"{out}.ply", "--max-frames", "2"],
        ["batch", log, "--out", out, *_FAST],
    )
    return rng.choices(commands, (8, 2, 8, 2, 4, 1, 0.02))[0]


def logs(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """Logs of every container that are damaged in one of many ways."""
    index, kind = rng.choice(list(INDEXES)), rng.choice(list(KINDS))
    data, _ = damaged(rng.choice(ammunition.logs), index, kind, rng.randrange(2**32))
    (folder / "log.mcap").write_bytes(data)
    return Attack(_command(rng, str(folder / "log.mcap"), folder), ("out", "out.ply"))


def definitions(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """Schemas that a parser could choke on: brackets, products, lengths, modules, types of types."""
    tokens = (
        *_ODD_NUMBERS, *"()[]{}<>;=*+-,:", "<<", "::", "sequence<", "string<", "struct S {", "module m {", "]",
        "const long A =", "long", "A", "A * A", "#", "//", "/*", '"', "\n", "string name", "Header header", "union",
        "@default(value=", "uint8[] data\n", "uint8[", "uint32 height\n", "================\nMSG: ", "enum", " ",
        "sensor_msgs/Image", "\t",
    )  # fmt: skip
    text = "".join(rng.choices(tokens, k=int(2 ** rng.uniform(1, 11))))
    if rng.random() < 0.3:
        text = rng.choice(("(", "[", "{", "sequence<", "module m {", "A * ")) * int(2 ** rng.uniform(2, 16)) + text
    encodings, name = rng.choice(_ENCODINGS), rng.choice(_TYPES)
    log = LogWriter(folder / "log.mcap")
    for n in range(2):
        for topic in (*Spec.topics, *Spec.info_topics):
            log.add(topic, name, encodings, text.encode("utf-8", "replace"), START_NS + n, rng.randbytes(40))
    log.close()
    return Attack(_command(rng, str(folder / "log.mcap"), folder), ("out", "out.ply"))


def _changed_image(rng: random.Random, image: bytes) -> bytes:
    data = bytearray(image)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(min(len(data), rng.choice((40, 200, len(data)))))
        how = rng.randrange(5)
        if how == 0:
            data[at] = rng.randrange(256)
        elif how == 1:
            data[at : at + 4] = rng.choice((0, 1, 2**16, 2**27, 2**31 - 1, 2**32 - 1)).to_bytes(
                4, rng.choice(("big", "little"))
            )
        elif how == 2:
            del data[at:]
            data = data or bytearray(b"x")
        elif how == 3:
            data[at:at] = data[at : at + rng.randrange(1, 60)] * rng.choice((1, 2, 5000))
        else:
            kind = rng.choice((b"IHDR", b"IDAT", b"PLTE", b"iCCP", b"zTXt", b"acTL", b"IEND", b"eXIf"))
            content = rng.randbytes(rng.choice((0, 4, 13, 300)))
            length = rng.choice((len(content), 2**31 - 1, 2**20))
            crc = zlib.crc32(kind + content)
            data[at:at] = struct.pack(">I", length) + kind + content + struct.pack(">I", crc)
    return bytes(data)


def images(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """Compressed images whose chunks, segments and sizes are wrong, in a folder of images that is replayed."""
    for side in ("left", "right"):
        (folder / "log" / side).mkdir(parents=True)
        for n in range(3):
            image = rng.choice(ammunition.images) if rng.random() < 0.2 else ammunition.png
            data = _changed_image(rng, image) if n == 1 or rng.random() < 0.1 else image
            (folder / "log" / side / f"{n:03d}.png").write_bytes(data)
    (folder / "log" / "calibration.toml").write_text(
        ammunition.calibration.replace("width = 320", "width = 96")
        .replace("height = 240", "height = 64")
        .replace("260.0", "80.0")
        .replace("159.5", "47.5")
        .replace("119.5", "31.5")
    )
    return Attack(_command(rng, str(folder / "log"), folder), ("out", "out.ply"))


def texts(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """Settings and calibrations of nested brackets, huge numbers, repeated keys and aliases."""
    tokens = (
        *_ODD_NUMBERS, "[", "]", "{", "}", "=", ".", ",", "\n", '"', "'", "#", "a", "[[", "]]", "[left]\n", "[right]\n",
        "width = ", "K = ", "&a ", "*a", "<<: ", "- ", ": ", "  ", "%YAML:1.0\n---\n", "!!opencv-matrix", "<a>", "</a>",
        "cam0:\n", "inf", "true", "null", "window.frames = ", "robust.min_inliers = ", "\ufeff", "\0", "é",
    )  # fmt: skip
    soup = "".join(rng.choices(tokens, k=int(2 ** rng.uniform(1, 12))))
    if rng.random() < 0.3:
        soup = rng.choice(("x = ", "")) + rng.choice(tokens) * int(2 ** rng.uniform(2, 17)) + soup
    text = ammunition.calibration
    if rng.random() < 0.5:
        numbers = list(re.finditer(r"-?\d+(\.\d+)?", text))
        for match in sorted(rng.sample(numbers, 2), key=lambda m: -m.start()):
            text = text[: match.start()] + rng.choice(_ODD_NUMBERS) + text[match.end() :]
        soup = text if rng.random() < 0.7 else text + soup
    path = folder / rng.choice(("x.toml", "x.yaml", "x.xml", "calib.txt", "x.json"))
    path.write_bytes(soup.encode("utf-8", "replace"))
    log = str(shutil.copy(ammunition.log, folder / "log.mcap"))
    out = str(folder / "out")
    return Attack(
        rng.choice(
            [
                ["replay", log, "--out", out, "--calibration", str(path), *_FAST],
                ["inspect", log, "--calibration", str(path)],
                ["replay", log, "--out", out, "--config", str(path), *_FAST],
                ["config", "--set", soup[:20_000].replace("\0", "")],
                ["convert-calibration", str(path), "--out", f"{out}.toml"],
                ["replay", log, "--out", out, "--ground-truth", str(path), *_FAST],
            ]
        ),
        ("out", "out.toml"),
    )


def _damage(rng: random.Random, place: Path) -> None:
    """Change bytes of a file, or of one of the files of a folder, put others in, or take some out."""
    path = rng.choice(sorted(p for p in (place, *place.rglob("*")) if p.is_file()))
    data = bytearray(path.read_bytes())
    for _ in range(rng.choice((1, 1, 3, 20))):
        at, length = rng.randrange(len(data) + 1), rng.choice((1, 4, 16, 200, 5000))
        part = rng.choice((b"", rng.randbytes(length), bytes(length), data[at : at + length] * 2))
        data[at : at + rng.choice((0, length))] = rng.choice((part, rng.choice(_ODD_NUMBERS).encode()))
    path.write_bytes(data)


def bags(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """ROS 1 and SQLite bags, whole or compressed, of which one file is damaged, metadata.yaml included."""
    bag = rng.choice(ammunition.bags)
    place = folder / bag.name
    if bag.is_dir():
        shutil.copytree(bag, place)
    else:
        shutil.copy(bag, place)
    _damage(rng, place)
    return Attack(_command(rng, str(place), folder), ("out", "out.ply"))


def results(rng: random.Random, ammunition: Ammunition, folder: Path) -> Attack:
    """Folders of results of which one file is damaged."""
    place = shutil.copytree(ammunition.run, folder / "run")
    _damage(rng, place)
    out = str(folder / "out")
    return Attack(
        rng.choice(
            [
                ["evaluate", str(place)],
                ["evaluate", str(place), "--json", "--out", f"{out}.html"],
                ["inspect", str(place / "estimates.mcap")],
                [
                    "replay",
                    str(ammunition.log),
                    "--out",
                    out,
                    "--ground-truth",
                    str(place / "trajectory.tum"),
                    *_FAST,
                ],
                ["replay", str(ammunition.log), "--out", out, "--config", str(place / "config.toml"), *_FAST],
            ]
        ),
        ("out", "out.html"),
    )


ATTACKS = {f.__name__: f for f in (logs, definitions, images, texts, bags, results)}


def attacked(kind: str, folder: Path) -> Trial:
    """Commands under the attacks of one kind."""
    ammunition = Ammunition(folder / "ammunition")
    field = folder / "field"

    def trial(seed: int) -> tuple[int, str]:
        shutil.rmtree(field, ignore_errors=True)
        field.mkdir()
        (field / "other").write_bytes(_OTHER)
        (folder / "beside").write_bytes(_OTHER)
        attack = ATTACKS[kind](random.Random(f"{kind} {seed}"), ammunition, field)
        return _run(attack, folder)

    return trial


def _run(attack: Attack, folder: Path) -> tuple[int, str]:
    """The exit code of a command, and what is wrong with what it has printed or changed."""
    field = folder / "field"
    before = _everything(folder, field, attack.results)
    printed, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors), contextlib.chdir(field):
        code = main(attack.words)
    said = errors.getvalue()
    if code not in (0, 2, 3) or "Traceback" in said or "defect" in said:
        return code, f"exit code {code} of {attack.words}: {said[-500:]}"
    if obeyed := {c for c in printed.getvalue() + said if not c.isprintable() and c != "\n"}:
        return code, f"{attack.words} printed {obeyed}"
    after = _everything(folder, field, attack.results)
    if after != before:
        changed = [name for name in before.keys() | after.keys() if before.get(name) != after.get(name)]
        return code, f"{attack.words} changed {changed}"
    return code, ""


def _everything(folder: Path, field: Path, results: tuple[str, ...]) -> dict[str, object]:
    """What every file is and holds, apart from results."""
    free = [field / name for name in results]
    found: dict[str, object] = {}
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not _below(Path(place, name), free)]
        for name in (*folders, *files):
            path = Path(place, name)
            if not _below(path, free):
                status = path.lstat()
                content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
                found[str(path)] = status.st_mode, zlib.crc32(content), len(content)
    return found


def _below(path: Path, free: list[Path]) -> bool:
    return any(path in (place, place.with_name(place.name + ".part")) or place in path.parents for place in free)
