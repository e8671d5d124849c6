"""ROS bags of every kind with the messages of an MCAP log, written by rosbags."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage, Message


def messages_of(log: Path) -> list[Message]:
    """All messages of a log."""
    return list(LogFile(log).messages(Damage()))


def write_bag1(path: Path, messages: Sequence[Message], compression: str = "none", chunk_bytes: int = 2**20) -> Path:
    """A ROS 1 bag; `messages` are in ROS 1's encoding."""
    writer = Writer1(path)
    writer.chunk_threshold = chunk_bytes
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        _add(writer, messages)
    return path


def write_bag2(
    path: Path, messages: Sequence[Message], storage: str = "sqlite3", compression: str | None = None
) -> Path:
    """A ROS 2 bag, a folder; `messages` are in ROS 2's encoding."""
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression is not None:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        _add(writer, messages)
    return path


def _add(writer: Any, messages: Sequence[Message]) -> None:
    connections: dict[str, Any] = {}
    for channel, time_ns, data, *_ in messages:
        if channel.topic not in connections:
            more = {"rihs01": "RIHS01_" + "0" * 64} if isinstance(writer, Writer2) else {"md5sum": "0" * 32}
            name = channel.schema_name if "/msg/" in channel.schema_name else channel.schema_name.replace("/", "/msg/")
            definition = channel.definition.decode()
            connections[channel.topic] = writer.add_connection(channel.topic, name, msgdef=definition, **more)
        writer.write(connections[channel.topic], time_ns, data)
