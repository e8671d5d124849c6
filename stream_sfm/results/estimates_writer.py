"""Writes `estimates.mcap`: all estimates of a run, as a bag that ROS 2, Foxglove, Rerun and PlotJuggler open.

`docs/formats.md` lists the topics. All are CDR, because ROS 2 plays no bag with mixed serialisations. Frames and axes
follow the settings `[ros]`, except in /stream_sfm/estimate, which has the pose of the left camera in the first one.

Metadata `stream_sfm` (software_version, schema_version, method) and `configuration` (config.toml); attachment
`calibration.toml`. All times of a message are the frame's stamp, its sequence the frame index; two runs differ
in /stream_sfm/timing only. A chunk is closed at the latest after half a second of log time or 20 frames, and the first
ones after 1, 2, 4 … frames, as a disk may soon be full. The file is moved to its name by `close`: a killed process
leaves all but the last chunk in `<name>.part`, which `read_estimates` reads.
"""

from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, cast

import mcap
from mcap.well_known import MessageEncoding, SchemaEncoding

from .. import __version__
from ..camera.rig import MonoRig, StereoRig
from ..config import Config, config_to_toml
from ..errors import OutputError
from ..geometry import Array
from ..logs.mcap_file.library import Writer
from ..system.files import PartFile, json_bytes
from ..types import Frame, FrameEstimate
from .estimate_messages import TOPICS, RosMessages, Stamped
from .own_messages import SCHEMA_VERSION
from .ros_messages import encode, schema_text

_CHUNK_NS = 500_000_000  # a chunk is closed after this much log time, which is the most that a killed process loses
_CHUNK_FRAMES = 20  # and after this many frames, at the latest
# Quality of service of /tf_static, without which late subscribers do not get the message. The numbers are those of
# ROS's enumerations: keep last, reliable, transient local, automatic. All versions of ROS 2 read them.
_LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


class EstimatesWriter:
    """A sink that writes estimates. Raises OutputError if the file cannot be written.

    `map_from_world`: that of a map of places, as in RosMessages.
    """

    def __init__(
        self,
        path: str | Path,
        rig: StereoRig | MonoRig,
        config: Config,
        map_from_world: Callable[[], Array] | None = None,
    ) -> None:
        self._messages = RosMessages(config.ros, map_from_world)
        self._file = PartFile(path)
        # a chunk size that 20 frames of 200 points do not reach
        self._writer = writer = Writer(cast(IO[Any], self._file), chunk_size=2**22)
        writer.start("ros2", library=f"stream_sfm {__version__}, mcap {mcap.__version__}")
        about = {"software_version": __version__, "schema_version": str(SCHEMA_VERSION), "method": config.method}
        writer.add_metadata("stream_sfm", about | {"unscaled": str(rig.unscaled).lower()})
        writer.add_metadata("configuration", {"config.toml": config_to_toml(config)})
        writer.add_attachment(0, 0, "calibration.toml", "application/toml", rig.to_toml().encode())
        topics = self._messages.topics
        schemas = {
            name: writer.register_schema(name, SchemaEncoding.ROS2, schema_text(name).encode())
            for name in dict.fromkeys(topics.values())
        }
        self._channels = {
            topic: writer.register_channel(
                topic, MessageEncoding.CDR, schemas[name], {"offered_qos_profiles": _quality(topic)}
            )
            for topic, name in topics.items()
        }
        writer.flush()
        self._counts = dict.fromkeys(topics, 0)
        self._times_ns = (2**63, 0)  # times of the first and the last message
        self._chunk_began_ns = self._frames_in_chunk = 0
        self._most_frames = 1  # of the current chunk
        self._closed = False

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append all messages of one frame."""
        if self._frames_in_chunk == 0:
            self._chunk_began_ns = estimate.stamp_ns
        self._add(estimate, self._messages.of(estimate))
        self._frames_in_chunk += 1
        since_ns = abs(estimate.stamp_ns - self._chunk_began_ns)
        if self._frames_in_chunk >= self._most_frames or since_ns >= _CHUNK_NS:
            self._writer.flush()
            self._frames_in_chunk, self._most_frames = 0, min(2 * self._most_frames, _CHUNK_FRAMES)

    def close(self) -> None:
        """Add the whole path, and the points still visible to the map; finish the file and move it into place."""
        if self._closed:
            return
        self._closed = True
        try:
            if (last := self._messages.last) is not None:
                self._add(last, self._messages.end())
            self._writer.finish()
        except OutputError:
            self._file.close()  # raises the same error
            raise
        self._file.close()

    def metadata(self) -> bytes:
        """Return the content of metadata.yaml, which makes the folder a ROS 2 bag: for `ros2 bag play`, and evo.

        It is written as JSON, which is also YAML.
        """
        first_ns, last_ns = self._times_ns
        of_all = {
            "starting_time": {"nanoseconds_since_epoch": first_ns},
            "duration": {"nanoseconds": last_ns - first_ns},
            "message_count": sum(self._counts.values()),
        }
        fields = ("name", "type", "serialization_format", "offered_qos_profiles")
        kinds = {topic: (topic, TOPICS[topic], "cdr", _quality(topic)) for topic in self._counts}
        counts = [
            {"topic_metadata": dict(zip(fields, kinds[topic], strict=True)), "message_count": count}
            for topic, count in self._counts.items()
        ]
        information = {
            "version": 5,  # of ROS 2 Humble; later ones read it
            "storage_identifier": "mcap",
            "relative_file_paths": [self._file.path.name],
            **of_all,
            "topics_with_message_count": counts,
            "compression_format": "",
            "compression_mode": "",
            "files": [{"path": self._file.path.name, **of_all}],
        }
        return json_bytes({"rosbag2_bagfile_information": information})

    def _add(self, estimate: FrameEstimate, messages: Stamped) -> None:
        stamp_ns = max(estimate.stamp_ns, 0)  # MCAP's times are unsigned
        topics, made = zip(*messages, strict=True)
        for topic, content in zip(topics, encode(made), strict=True):
            self._writer.add_message(self._channels[topic], stamp_ns, content, stamp_ns, estimate.frame_index)
            self._counts[topic] += 1
        first_ns, last_ns = self._times_ns
        self._times_ns = min(first_ns, stamp_ns), max(last_ns, stamp_ns)


def _quality(topic: str) -> str:
    return _LATCHED if topic == "/tf_static" else ""
