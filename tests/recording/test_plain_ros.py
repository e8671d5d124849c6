"""The reader of plain ROS 2 messages, with rosbags' as second opinion."""

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stream_sfm.recording.plain_ros import plain_decoder
from stream_sfm.recording.ros import ros_decoder
from stream_sfm.results import cdr, ros_messages

INFO = "sensor_msgs/msg/CameraInfo"
INFO_TEXT = """\
# a camera
std_msgs/Header header
uint32 height  # rows
uint32 width
uint8 LARGEST=9
string distortion_model
float64[] d
float64[9] k
Region roi
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/Region
uint32 x_offset 0
bool do_rectify
int16[] rows
float32 scale 1.5
"""


def info(model: str, d: list[float], rows: list[int]) -> bytes:
    """A message of INFO, written by hand."""
    data = bytearray()

    def put(form: str, *values: Any) -> None:
        data.extend(bytes(-len(data) % struct.calcsize(form[-1])) + struct.pack("<" + form, *values))

    def put_text(text: str) -> None:
        put("I", len(text) + 1)
        data.extend(text.encode() + b"\0")

    put("i", 7)
    put("I", 8)
    put_text("left")
    put("I", 480)
    put("I", 752)
    put_text(model)
    put("I", len(d))
    if d:
        put(f"{len(d)}d", *d)
    put("9d", *range(9))
    put("I", 3)
    put("?", True)
    put("I", len(rows))
    if rows:
        put(f"{len(rows)}h", *rows)
    put("f", 2.5)
    return b"\0\1\0\0" + bytes(data)


def transforms(n: int) -> bytes:
    """A list of transforms."""
    head = ros_messages.header(1_700_000_000_123_456_789, "map")
    pose = ros_messages.pose_of(np.eye(4))
    return cdr.encode(ros_messages.transforms(*[(head, f"camera_{i}", pose) for i in range(n)]))


MESSAGES = {
    INFO: (INFO_TEXT, [info("plumb_bob", [0.1, -0.2], [1, -2, 3]), info("", [], []), info("fisheye", [1.0], [5])]),
    ros_messages.TRANSFORMS: (
        cdr.schema_text(ros_messages.TRANSFORMS),
        [transforms(0), transforms(1), transforms(3)],
    ),
}


def plain(name: str) -> Any:
    """The reader under test; big-endian messages go to rosbags."""
    definition = MESSAGES[name][0].encode()
    decode = plain_decoder(name, definition, lambda: ros_decoder("cdr", "ros2msg", name, definition))
    assert decode is not None
    return decode


def values(message: Any) -> Any:
    """A message as nested lists of numbers and texts."""
    if isinstance(message, np.ndarray):
        return [str(message.dtype), *message.tolist()]
    if isinstance(message, list):
        return [values(one) for one in message]
    if isinstance(message, SimpleNamespace) or hasattr(message, "__dataclass_fields__"):
        fields = {key: one for key, one in vars(message).items() if not key.startswith("_") and not key.isupper()}
        return {key: values(one) for key, one in fields.items()}
    return message


@pytest.mark.parametrize("name", MESSAGES)
def test_messages_are_read_as_rosbags_reads_them(name: str) -> None:
    text, messages = MESSAGES[name]
    by_rosbags = ros_decoder("cdr", "ros2msg", name, text.encode())
    assert by_rosbags is not None
    for data in messages:
        assert values(plain(name)(data)) == values(by_rosbags(data))
    assert plain(INFO)(MESSAGES[INFO][1][0]).roi.rows.tolist() == [1, -2, 3]


@pytest.mark.parametrize("name", MESSAGES)
def test_bytes_that_do_not_fit_are_refused_or_read_without_harm(name: str) -> None:
    rng, decode = np.random.default_rng(3), plain(name)
    refused = 0
    for n in range(600):
        data = bytearray(MESSAGES[name][1][n % 3])
        if n % 2:
            del data[int(rng.integers(4, len(data))) :]
        else:
            at = rng.integers(4, len(data), 3)
            for k in at:
                data[k] = int(rng.integers(256))
        try:
            decode(bytes(data))
        except (ValueError, struct.error):
            refused += 1
    assert refused > 300  # nearly all that are cut, and some of the others


@pytest.mark.parametrize(
    "text",
    [
        "Unknown a\n",
        "string<=10 a\n",
        "string[] a\n",
        "uint8[<=4] a\n",
        "wstring a\n",
        "int32 a\nint32 a\n",
        "uint8[0] a\n",
        "CameraInfo a\n",
        "# nothing\n",
        "uint32 a\n=====\nuint32 b\n",
    ],
)
def test_what_is_not_plain_is_left_to_rosbags(text: str) -> None:
    assert plain_decoder(INFO, text.encode(), lambda: None) is None


def test_a_list_longer_than_its_message_ends_with_the_bytes() -> None:
    data = bytearray(transforms(1))
    data[4:8] = b"\xff\xff\xff\xff"
    with pytest.raises((ValueError, struct.error)):
        plain(ros_messages.TRANSFORMS)(bytes(data))


def test_messages_in_the_other_byte_order_are_read_by_rosbags() -> None:
    text = b"uint32 a\n"
    name = "some_msgs/msg/Number"
    decode = plain_decoder(name, text, lambda: ros_decoder("cdr", "ros2msg", name, text))
    assert decode is not None
    assert decode(b"\0\0\0\0\0\0\0\5").a == decode(b"\0\1\0\0\5\0\0\0").a == 5
