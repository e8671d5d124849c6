"""Hostile messages and definitions in valid format: each costs its own frame, and nothing else."""

import base64
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.well_known import MessageEncoding, SchemaEncoding

import stream_sfm as sfm
from stream_sfm.logs.recording.ros import ros_decoder
from stream_sfm.run.replay import replay
from stream_sfm.system.outputs import RESULTS
from tests.helpers.stereo_logs import (
    PERIOD_NS,
    START_NS,
    Calib,
    LogWriter,
    Spec,
    encode,
    right_calib,
    scene,
    write_log,
    write_pair,
)

FAST = sfm.Config(method="frame-to-frame")
FRAMES, BAD = 6, 3
INFINITY = float("inf")
_BOMB = cv2.imencode(".png", np.zeros((16_000, 16_000), np.uint8))[1].tobytes()


def stamp(sec: Any) -> dict[str, Any]:
    return {"timestamp": {"sec": sec, "nsec": 0}}


def raw(**changed: Any) -> dict[str, Any]:
    sound = {"encoding": "mono8", "width": 96, "height": 64, "step": 96, "data": bytes(96 * 64)}
    fields = sound | changed
    return {"format": None} | fields | {"data": base64.b64encode(fields["data"]).decode()}


# what replaces one left image: the fields that differ, or the whole text; and the note about it
IMAGES: dict[str, tuple[dict[str, Any] | str, str]] = {
    "infinite stamp": (stamp(INFINITY), "cannot convert float infinity"),
    "stamp that is no number": (stamp(float("nan")), "cannot convert float NaN"),
    "stamp beyond 64 bits": (stamp(10**30), "a stamp of 1000000000000000000000000000000 s"),
    "stamp of another age": (stamp(9 * 10**9), "far from those of the images around them"),
    "stamp of a list": (stamp([1]), "not 'list'"),
    "a number of bytes for the bytes": ({"data": 2 * 10**9}, "data of type int"),
    "bytes that are none": ({"data": [1, 2, 300]}, "bytes must be in range"),
    "text that is no base64": ({"data": "{}"}, "Only base64 data is allowed"),
    "nested without end": ("[" * 100_000, "RecursionError"),
    "a list": ("[1, 2]", "the message lacks the field header"),
    "null": ("null", "the message lacks the field header"),
    "a number of 10 000 digits": ("1" * 10_000, "a message of 10000 bytes does not fit its schema"),
    "raw, of an unknown encoding": (raw(encoding="mono7"), "image encoding 'mono7' is not supported"),
    "raw, of a width of 400 digits": (raw(width=10**400), "the calibration is for 96×64"),
    "raw, with fewer bytes than it claims": (raw(data=bytes(96 * 60)), "5760 bytes"),
    "256 megapixels in 270 kB": ({"data": base64.b64encode(_BOMB).decode()}, "images are 16000×16000"),
    "another format in disguise": (
        {"data": base64.b64encode(cv2.imencode(".bmp", scene(3, 0))[1]).decode()}, "the header of an image is damaged"
    ),
}  # fmt: skip


def write(path: Path, replaced: dict[str, Any] | str, both_sides: bool = False) -> Path:
    """JSON images, of which the left one of frame `BAD` is `replaced`; on `both_sides` the right one too."""
    log = LogWriter(path)
    for n in range(FRAMES):
        time_ns = START_NS + n * PERIOD_NS
        if n != BAD:
            infos = (Calib(), right_calib()) if n == 0 else None
            write_pair(log, "json", time_ns, (scene(n, 0), scene(n, 1)), infos)
            continue
        sec, nsec = divmod(time_ns, 10**9)
        image = {"timestamp": {"sec": sec, "nsec": nsec}, "frame_id": "left", "format": "png"}
        image["data"] = base64.b64encode(encode(scene(n, 1), "png")[0]).decode()
        bad = replaced
        if isinstance(replaced, dict):
            bad = json.dumps({k: v for k, v in (image | replaced).items() if v is not None})
        for topic, text in zip(Spec.topics, (bad, bad if both_sides else json.dumps(image)), strict=True):
            log.add(topic, "foxglove.CompressedImage", ("json", "jsonschema"), b"", time_ns, text.encode())
    log.close()
    return path


@pytest.mark.parametrize("name", IMAGES)
def test_a_hostile_image_costs_its_frame(name, tmp_path):
    replaced, says = IMAGES[name]
    for both_sides in (False, True):
        log = sfm.open_log(write(tmp_path / "hostile.mcap", replaced, both_sides))
        good = [START_NS + n * PERIOD_NS for n in range(FRAMES) if n != BAD]
        assert [frame.stamp_ns for frame in log.frames()] == good and not log.stats.complete
        assert says in " ".join(log.stats.warnings)


def parts(fields: str, part: str) -> str:
    """A definition of an image that has parts of this kind."""
    return f"{fields}\n{'=' * 80}\nMSG: sensor_msgs/Part\n{part}\n"


def idl(members: str = "long a;", constant: str = "long A = 1", before: str = "") -> str:
    """A definition of an image as OMG IDL."""
    constants = f"module Image_Constants {{ const {constant}; }};"
    return f"module sensor_msgs {{ {before} module msg {{ {constants} struct Image {{ {members} }}; }}; }};"


ROS1, ROS2, IDL = SchemaEncoding.ROS1, SchemaEncoding.ROS2, SchemaEncoding.ROS2IDL
DEFINITIONS: dict[str, tuple[str, str]] = {  # schema encoding, definition
    "code generated for each of many strings": (ROS2, "string[3000000] a\n"),
    "code generated for each of many messages": (ROS2, parts("Part[3000000] a", "uint8 b")),
    "an endless list of nothing": (ROS1, parts("Part[] a", "# empty")),
    "an endless list of empty arrays": (ROS1, parts("Part[] a", "uint8[0] b")),
    "a type within itself": (ROS2, "Image a\n"),
    "a very long definition": (ROS2, "".join(f"uint8 a{i}\n" for i in range(20_000))),
    "a negative length": (ROS1, "uint8[-1] data\n"),
    "a length of many digits": (ROS1, "uint8[99999999999999999999] data\n"),
    "a length of gigabytes": (ROS2, "uint8[4294967295] data\n"),
    "code in a constant": (ROS2, "string A='''+open('{out}', 'w').name+'''\nuint8 a\n"),
    "code in a field": (ROS2, "uint8 a=open('{out}','w')\n"),
    "IDL: many strings": (IDL, idl("string a[3000000];")),
    "IDL: a constant of gigabytes": (IDL, idl(constant="long A = 1 << 100000000000")),
    "IDL: brackets without end": (IDL, idl(constant="long A = " + "(" * 9000)),
    "IDL: brackets in brackets": (IDL, idl(constant="long A = " + "(" * 15 + "1" + ")" * 15)),  # took an hour
    "IDL: brackets behind a comment": (IDL, '// "\n' + idl(constant="long A = ((((((1))))))") + '\n// "'),
    "IDL: products": (IDL, idl(before="const long B = B * B; " * 40)),
    "IDL: digits": (IDL, idl(constant="long A = " + "9" * 5000)),
    "IDL: sequences in sequences": (IDL, idl("sequence<" * 12 + "long" + ">" * 12 + " a;")),
    "IDL: code in a constant": (IDL, idl(constant="string A = \"'''+open('{out}','w').name+'''\"")),
}  # fmt: skip


@pytest.mark.parametrize("name", DEFINITIONS)
def test_a_hostile_ros_definition_is_refused_and_never_run(name, tmp_path):
    encoding, text = DEFINITIONS[name]
    written = tmp_path / "written by the log"
    message = MessageEncoding.ROS1 if encoding == ROS1 else MessageEncoding.CDR
    schema = "sensor_msgs/Image" if encoding == ROS1 else "sensor_msgs/msg/Image"
    try:
        ros_decoder(message, encoding, schema, text.replace("{out}", str(written)).encode())
    except Exception as error:
        assert not isinstance(error, MemoryError)
    else:
        assert "code" in name  # what is a mere text is no harm
    assert not written.exists()


@pytest.mark.parametrize(
    "name", ["sensor_msgs/msg/A:\n  pass\nopen('{out}', 'w')\nclass B/Image", "../../Image", "Image"]
)
def test_a_hostile_schema_name_is_never_run(name, tmp_path):
    written = tmp_path / "written by the log"
    with pytest.raises(Exception):  # noqa: B017  what its library raises; the caller makes a LogError of it
        ros_decoder("cdr", "ros2msg", name.replace("{out}", str(written)), b"uint8 a\n")
    assert not written.exists()


def test_topics_never_become_paths(tmp_path):
    up = "/../../../outside/%2e%2e/~/$(touch x)`touch x`\\..\\"
    spec = Spec(topics=(f"{up}/left", f"{up}/right"), info_topics=(f"{up}/left/info", f"{up}/right/info"))
    log = write_log(tmp_path / "log.mcap", spec)
    out = tmp_path / "a" / "b" / "c" / "out"
    assert replay(log, out, FAST).summary["frames"]["estimated"] == 12
    assert sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()) == [
        *(f"a/b/c/out/{name}" for name in sorted(RESULTS)),
        "log.mcap",
    ]
