"""Hostile inputs of many kinds, made by a seed: damaged logs, definitions of messages, images, and texts.

Each attack puts files into a folder and gives the words of a command. Whatever they are, the command ends with the
exit code of a success or of a named error, prints nothing that a terminal obeys, and changes no file but its results.
Commands run in a worker that may hang, swell or die without taking the test along.
"""

import contextlib
import io
import multiprocessing
import os
import random
import re
import shutil
import signal
import struct
import zlib
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import cv2
import numpy as np

from stream_sfm.cli.main import main
from stream_sfm.errors import ExitCode
from stream_sfm.run.summary import peak_rss_mib
from tests.core.calls import attack as attack_of_core
from tests.faults.damage import INDEXES, KINDS, Whole, damaged, whole_log
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.stereo_logs import CONTAINERS, START_NS, LogWriter, Spec, write_log
from tests.helpers.wall import rig

MAX_WAIT_S = 120  # of waiting for nothing
MAX_RSS_MIB = 1024

_FAST = ["--method", "frame-to-frame", "--max-frames", "4"]
_RESULTS = ("out", "out.ply", "out.toml", "out.html")
_ODD_NUMBERS = (
    "-1", "0", "1", "2147483648", "4294967295", "18446744073709551616", "9" * 400, "1e400", "0x" + "f" * 300, "nan",
)  # fmt: skip
_ENCODINGS = (
    ("cdr", "ros2idl"), ("cdr", "ros2msg"), ("ros1", "ros1msg"), ("json", "jsonschema"), ("protobuf", "protobuf"),
)  # fmt: skip
_TYPES = (
    "sensor_msgs/msg/Image", "sensor_msgs/Image", "foxglove.CompressedImage", "p/msg/T", "tf2_msgs/msg/TFMessage",
)  # fmt: skip


def write_bags(folder: Path) -> list[Path]:
    """Bags of ROS 1, plain and compressed in two ways, and of ROS 2 in SQLite, plain and as a compressed file."""
    old, new = (messages_of(write_log(folder / f"for_bag_{p}.mcap", Spec(profile=p))) for p in ("ros1", "ros2"))
    bags = [write_bag1(folder / f"{c}.bag", old, c, 1 << 14) for c in ("none", "bz2", "lz4")]
    return bags + [write_bag2(folder / f"bag_{n}", new, compression=c) for n, c in enumerate((None, "file"))]


class Ammunition:
    """What attacks are made of, each prepared once, where it is needed."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self.log = write_log(folder / "log.mcap", Spec(left=tuple(range(4)), right=tuple(range(4))))
        picture = np.random.default_rng(0).integers(0, 255, (64, 96), np.uint8)
        self.images = [bytes(cv2.imencode(kind, picture)[1]) for kind in (".png", ".jpg", ".webp")]
        self.images.append(bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1]))
        self.calibration = rig().to_toml()

    @cached_property
    def logs(self) -> list[Whole]:
        numbers = {"left": tuple(range(5)), "right": tuple(range(5))}
        return [
            whole_log(write_log(self._folder / f"{profile}.mcap", Spec(profile, encoding, **numbers), **container))
            for profile, encoding, container in (
                ("foxglove", "png", CONTAINERS["unchunked"]),
                ("ros2", "mono8", CONTAINERS["zstd"]),
                ("json", "jpeg", CONTAINERS["lz4"]),
                ("ros1", "mono8", CONTAINERS["no index"]),
            )
        ]

    @cached_property
    def bags(self) -> list[Path]:
        return write_bags(self._folder)

    @cached_property
    def run(self) -> Path:
        folder = self._folder / "run"
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            main(["replay", str(self.log), "--out", str(folder), "-q", *_FAST])
        return folder


def _command(rng: random.Random, log: str, folder: Path) -> list[str]:
    """A command that reads a log."""
    out = str(folder / "out")
    commands = (
        ["inspect", log], ["inspect", log, "--json"], ["replay", log, "--out", out, *_FAST],
        ["replay", log, "--out", out, *_FAST, "--json"], ["recover", log, f"{out}/recovered.mcap"],
        ["surface", log, "--out", f"{out}.ply", "--max-frames", "2"], ["batch", log, "--out", out, *_FAST],
    )  # fmt: skip
    return rng.choices(commands, (8, 2, 8, 2, 4, 1, 0.02))[0]


def logs(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
    """Logs of every container that are damaged in one of many ways."""
    index, kind = rng.choice(list(INDEXES)), rng.choice(list(KINDS))
    data, _ = damaged(rng.choice(ammunition.logs), index, kind, rng.randrange(2**32))
    (folder / "log.mcap").write_bytes(data)
    return _command(rng, str(folder / "log.mcap"), folder)


def definitions(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
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
    return _command(rng, str(folder / "log.mcap"), folder)


def changed(rng: random.Random, data: bytes) -> bytes:
    """Bytes changed, inserted, doubled or taken out, numbers made extreme, chunks of PNG put in, the end missing."""
    for _ in range(rng.choice((1, 1, 3, 20))):
        at = rng.randrange(min(len(data), rng.choice((40, 200, 2**30))) + 1)
        length = rng.choice((1, 4, 16, 200, 5000))
        number = rng.choice((0, 1, 2**16, 2**27, 2**31 - 1, 2**32 - 1)).to_bytes(4, rng.choice(("big", "little")))
        kind = rng.choice((b"IHDR", b"IDAT", b"PLTE", b"iCCP", b"zTXt", b"acTL", b"IEND", b"eXIf"))
        chunk = struct.pack(">I", rng.choice((length, 2**31 - 1))) + kind + rng.randbytes(length)
        same, odd = data[at : at + length], rng.choice(_ODD_NUMBERS).encode()
        chunk += struct.pack(">I", zlib.crc32(chunk[4:]))
        part = rng.choice((b"", rng.randbytes(length), bytes(length), 2 * same, number, odd, chunk))
        data = data[:at] + part + data[at + rng.choice((*(0, len(part)) * 4, length, 2**30)) :]
    return data


def images(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
    """Compressed images whose chunks, segments and sizes are wrong, in a folder of images that is replayed."""
    for side in ("left", "right"):
        (folder / "log" / side).mkdir(parents=True)
        for n in range(3):
            image = rng.choice(ammunition.images) if rng.random() < 0.2 else ammunition.images[0]
            data = changed(rng, image) if n == 1 or rng.random() < 0.1 else image
            (folder / "log" / side / f"{n:03d}.png").write_bytes(data)
    (folder / "log" / "calibration.toml").write_text(rig(width=96, height=64).to_toml())
    return _command(rng, str(folder / "log"), folder)


def texts(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
    """Settings and calibrations of nested brackets, huge numbers, repeated keys and aliases."""
    tokens = (
        *_ODD_NUMBERS, "[", "]", "{", "}", "=", ".", ",", "\n", '"', "'", "#", "a", "[[", "]]", "[left]\n", "[right]\n",
        "width = ", "K = ", "&a ", "*a", "<<: ", "- ", ": ", "  ", "%YAML:1.0\n---\n", "!!opencv-matrix", "<a>", "</a>",
        "cam0:\n", "inf", "true", "null", "window.frames = ", "rules.robust.min_inliers = ", "\ufeff", "\0", "é",
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
    return rng.choice(
        [
            ["replay", log, "--out", out, "--calibration", str(path), *_FAST],
            ["inspect", log, "--calibration", str(path)],
            ["replay", log, "--out", out, "--config", str(path), *_FAST],
            ["config", "--set", soup[:20_000].replace("\0", "")],
            ["convert-calibration", str(path), "--out", f"{out}.toml"],
            ["replay", log, "--out", out, "--ground-truth", str(path), *_FAST],
        ]
    )


def _damage(rng: random.Random, place: Path) -> None:
    """Change a file, or one of the files of a folder."""
    path = rng.choice(sorted(p for p in (place, *place.rglob("*")) if p.is_file()))
    path.write_bytes(changed(rng, path.read_bytes()))


def bags(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
    """ROS 1 and SQLite bags, whole or compressed, of which one file is damaged, metadata.yaml included."""
    bag = rng.choice(ammunition.bags)
    place = folder / bag.name
    if bag.is_dir():
        shutil.copytree(bag, place)
    else:
        shutil.copy(bag, place)
    _damage(rng, place)
    return _command(rng, str(place), folder)


def results(rng: random.Random, ammunition: Ammunition, folder: Path) -> list[str]:
    """Folders of results of which one file is damaged."""
    place = shutil.copytree(ammunition.run, folder / "run")
    _damage(rng, place)
    out = str(folder / "out")
    return rng.choice(
        [
            ["evaluate", str(place)],
            ["evaluate", str(place), "--json", "--out", f"{out}.html"],
            ["inspect", str(place / "estimates.mcap")],
            ["replay", str(ammunition.log), "--out", out, "--ground-truth", str(place / "trajectory.tum"), *_FAST],
            ["replay", str(ammunition.log), "--out", out, "--config", str(place / "config.toml"), *_FAST],
        ]
    )


_COMMANDS = {f.__name__: f for f in (logs, definitions, images, texts, bags, results)}
_CORE = "core"  # calls of the compiled core, whose process must not die
_CALLS_PER_SEED = 20
ATTACKS = (*_COMMANDS, _CORE)


def _attack_core(rng: random.Random) -> str:
    """What is wrong with some calls of the compiled core: an error that is not one of arguments."""
    try:
        for _ in range(_CALLS_PER_SEED):
            attack_of_core(rng)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


class _Worker:
    """What one process attacks with, and where."""

    def __init__(self, kind: str, folder: Path) -> None:
        # image libraries write there what they think of damaged images
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        self.kind, self.folder = kind, folder
        if kind != _CORE:
            self.ammunition = Ammunition(folder / "ammunition")
        (folder / "beside").write_bytes(b"a file of somebody else")

    def attack(self, seed: int) -> tuple[int, str]:
        """The exit code of a command, and what is wrong with what it has printed or changed."""
        if self.kind == _CORE:
            return ExitCode.DONE, _attack_core(random.Random(f"core {seed}"))
        field = self.folder / "field"
        shutil.rmtree(field, ignore_errors=True)
        field.mkdir()
        words = _COMMANDS[self.kind](random.Random(f"{self.kind} {seed}"), self.ammunition, field)
        before, printed, errors = self._others(), io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors), contextlib.chdir(field):
            code = main(words)
        said, after = errors.getvalue(), self._others()
        if code not in (0, 2, 3) or "Traceback" in said or "defect" in said:
            return code, f"exit code {code} of {words}: {said[-500:]}"
        if obeyed := {c for c in printed.getvalue() + said if not c.isprintable() and c != "\n"}:
            return code, f"{words} printed {obeyed}"
        changed = [str(path) for path in before.keys() | after.keys() if before.get(path) != after.get(path)]
        return code, f"{words} changed {changed}" if changed else ""

    def _others(self) -> dict[Path, tuple[int, int]]:
        """What every file is and holds, apart from results."""
        found = {}
        for path in self.folder.rglob("*"):
            first, *inside = path.relative_to(self.folder).parts
            if first != "field" or not inside or inside[0].removesuffix(".part") not in _RESULTS:
                content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
                found[path] = path.lstat().st_mode, zlib.crc32(content)
        return found


_worker = cache(_Worker)  # of this process


def _attack(kind: str, folder: Path, max_cpu_seconds: float, seed: int) -> tuple[int, float, str]:
    worker = _worker(kind, folder)
    # The default of both signals ends the process, also inside a library that does not come back.
    signal.setitimer(signal.ITIMER_PROF, max_cpu_seconds)
    signal.alarm(MAX_WAIT_S)
    code, problem = worker.attack(seed)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.alarm(0)
    rss_mib = peak_rss_mib() or 0.0
    return code, rss_mib, problem or (f"{rss_mib:.0f} MiB" if rss_mib > MAX_RSS_MIB else "")


@dataclass
class Outcome:
    """What so many inputs came to. `failures`: seed -> what went wrong; `exit_codes` of the others."""

    tried: int = 0
    failures: dict[int, str] = field(default_factory=dict)
    exit_codes: Counter[int] = field(default_factory=Counter)
    peak_rss_mib: float = 0.0


def fuzz(kind: str, first: int, count: int, folder: Path, max_cpu_seconds: float) -> Outcome:
    """Attack with the seeds `first` … `first + count − 1`.

    A seed that kills the worker is a failure; a new worker goes on with the next.
    """
    outcome, pool = Outcome(count), None
    server = multiprocessing.get_context("forkserver")  # not a fork of this one: its memory is to be its own
    server.set_forkserver_preload(["tests.faults.attacks"])  # with everything imported
    for seed in range(first, first + count):
        pool = pool or ProcessPoolExecutor(1, server)
        try:
            code, rss_mib, problem = pool.submit(_attack, kind, folder, max_cpu_seconds, seed).result()
        except BrokenProcessPool:
            outcome.failures[seed], pool = "the worker died, or did not come back", None
            continue
        outcome.peak_rss_mib = max(outcome.peak_rss_mib, rss_mib)
        if problem:
            outcome.failures[seed] = problem
        else:
            outcome.exit_codes[code] += 1
    if pool is not None:
        pool.shutdown()
    return outcome
