"""Edge cases of the dialects: broken definitions, foreign encodings, video of every kind."""

import json

import pytest
from rosbags.typesys import Stores, get_typestore

from stream_sfm import LogError
from stream_sfm.camera.calibration.document import make_camera
from stream_sfm.logs.mcap_file.message import Channel, Message
from stream_sfm.logs.recording.messages import MessageDecoder, UndecodableMessage, kind_of
from stream_sfm.logs.recording.ros import ros_decoder
from tests.helpers import idl
from tests.helpers.stereo_logs import ROS1, ROS2


def message(name: str, schema_encoding: str, definition: str, encoding: str, data: bytes = b"") -> Message:
    return Message(Channel("/left/image", encoding, name, schema_encoding, definition.encode()), 0, data)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("foxglove.CompressedVideo", "video"), ("foxglove_msgs/msg/CompressedVideo", "video"),
        ("ffmpeg_image_transport_msgs/msg/FFMPEGPacket", "video"), ("theora_image_transport/Packet", "video"),
        ("sensor_msgs/Image", "image"), ("foxglove_msgs/msg/RawImage", "image"),
        ("tf2_msgs/msg/TFMessage", "transform"), ("my_msgs/msg/Image", ""), ("sensor_msgs/msg/PointCloud2", ""),
    ],
)  # fmt: skip
def test_kinds_are_recognised_by_package_and_name(name, kind):
    assert kind_of(name) == kind


IMAGE2, IMAGE1 = "sensor_msgs/msg/Image", "sensor_msgs/Image"


@pytest.mark.parametrize(
    "broken",
    [
        message(IMAGE2, "ros2msg", "std_msgs/Header header\nuint32 height", "cdr"),  # Header is not described
        message(IMAGE2, "ros2msg", "no field at all !!", "cdr"),
        message(IMAGE2, "ros2idl", idl.definition(IMAGE2)[:-60], "cdr"),
        message(IMAGE2, "ros2idl", "", "cdr"),
        message(IMAGE1, "ros1msg", ROS1[IMAGE1].replace("MSG: std_msgs/Header", ""), "ros1"),
        message("sensor_msgs/x: int\nimport os/Image", "ros2msg", "uint32 height", "cdr"),  # not a name of a type
        message("foxglove.RawImage", "protobuf", "not a descriptor", "protobuf"),
    ],
)
def test_a_definition_that_cannot_be_read_is_named(broken):
    with pytest.raises(LogError, match=r"topic /left/image: its schema .* cannot be read") as caught:
        MessageDecoder("log.mcap").image(broken)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("encoding", "schema_encoding"), [("cbor", ""), ("flatbuffer", "flatbuffer"), ("cdr", "omgidl")]
)
def test_other_encodings_are_named_with_what_is_read(encoding, schema_encoding):
    with pytest.raises(LogError, match="are not supported; supported are protobuf, json, cdr with ros2msg or ros2idl"):
        MessageDecoder("log.mcap").image(message("foxglove.RawImage", schema_encoding, "", encoding))


@pytest.mark.parametrize(
    ("name", "schema_encoding", "definition", "encoding"),
    [
        (IMAGE2, "ros2msg", ROS2[IMAGE2], "cdr"),
        (IMAGE2, "ros2idl", idl.definition(IMAGE2), "cdr"),
        (IMAGE2, "ros2msg", ROS2[IMAGE2].replace("\n", "\r\n"), "cdr"),
        (IMAGE1, "ros1msg", ROS1[IMAGE1], "ros1"),
    ],
)
def test_bytes_that_do_not_fit_cost_one_message(name, schema_encoding, definition, encoding):
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 40, b"\xff" * 64):
        with pytest.raises(UndecodableMessage, match="does not fit its schema"):
            MessageDecoder("log.mcap").image(message(name, schema_encoding, definition, encoding, data))


def test_a_distortion_model_that_is_null_does_not_drop_the_coefficients():
    """It became the text "None", which was taken for a lens without distortion."""
    content = {
        "timestamp": {"sec": 1, "nsec": 0}, "frame_id": None, "width": 640, "height": 480, "distortion_model": None,
        "D": [-0.3, 0.1, 0.0, 0.0], "K": [500, 0, 320, 0, 500, 240, 0, 0, 1], "R": [], "P": [],
    }  # fmt: skip
    sent = message("foxglove.CameraCalibration", "jsonschema", "{}", "json", json.dumps(content).encode())
    decoded = MessageDecoder("a.mcap").calibration(sent)
    assert decoded.distortion_model == decoded.frame_id == ""
    camera = make_camera((640, 480), decoded.K, decoded.distortion_model, decoded.D)
    assert camera.distortion_model == "plumb_bob" and camera.D == (-0.3, 0.1, 0.0, 0.0)


def test_either_end_of_a_number_may_be_first_in_cdr() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    point = store.types["geometry_msgs/msg/Point"](1.5, -2.0, 1e9)
    definition, _ = store.generate_msgdef("geometry_msgs/msg/Point", ros_version=2)
    decode = ros_decoder("cdr", "ros2msg", "geometry_msgs/msg/Point", definition.encode())
    assert decode is not None
    for little in (True, False, True):
        found = decode(bytes(store.serialize_cdr(point, "geometry_msgs/msg/Point", little_endian=little)))
        assert (found.x, found.y, found.z) == (1.5, -2.0, 1e9)
