"""`metadata.yaml`, which makes the folder of a run a ROS 2 bag: `ros2 bag play DIR`, and evo reads the folder."""

import json
from collections.abc import Mapping
from pathlib import Path

from ..files import json_bytes

NAME = "metadata.yaml"


def bag_metadata(file: str, topics: Mapping[str, tuple[str, str, int]], first_ns: int, last_ns: int) -> bytes:
    """Return the content for one MCAP file; `topics`: type, quality of service and number of messages of each.

    It is written as JSON, which is YAML as well.
    """
    times = {
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "duration": {"nanoseconds": last_ns - first_ns},
    }
    of_all = times | {"message_count": sum(messages for _, _, messages in topics.values())}
    fields = ("name", "type", "serialization_format", "offered_qos_profiles")
    counts = [
        {"topic_metadata": dict(zip(fields, (topic, kind, "cdr", quality), strict=True)), "message_count": messages}
        for topic, (kind, quality, messages) in topics.items()
    ]
    information = {
        "version": 5,  # of ROS 2 Humble; later ones read it
        "storage_identifier": "mcap",
        "relative_file_paths": [file],
        **of_all,
        "topics_with_message_count": counts,
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": file, **of_all}],
    }
    return json_bytes({"rosbag2_bagfile_information": information})


def may_be_written(path: Path, file: str) -> bool:
    """Whether `path` does not exist or is of an earlier run; the metadata of another bag must not be replaced."""
    try:
        content = json.loads(path.read_bytes())
        return bool(content["rosbag2_bagfile_information"]["relative_file_paths"] == [file])
    except FileNotFoundError:
        return True
    except (OSError, ValueError, KeyError, TypeError):
        return False
