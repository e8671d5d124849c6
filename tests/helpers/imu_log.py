"""The log of a wall with the samples of an inertial unit, exact except for its noise."""

from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from stream_sfm.geometry import se3
from stream_sfm.inertial.samples import ImuSamples
from stream_sfm.logs.sources.profile import ProfileEncoder
from tests.helpers.wall_log import START_NS, write_wall_log
from tools.render.inertial import BMI160, measured

STEP = np.array([0.02, 0.004, 0.015, 0.002, -0.004, 0.003])  # of `camera_path`


def write_imu_log(folder: Path) -> tuple[Path, Path, ImuSamples]:
    """Write a log with samples and the same one without; the samples."""
    plain, path = write_wall_log(folder / "wall.mcap"), folder / "imu.mcap"
    encoder = ProfileEncoder(None)
    samples = measured(lambda t: se3.exp(STEP * t / 0.05), (-0.1, 0.7), np.array([0, 1.0, 0]), start_ns=START_NS)
    rows = np.concatenate([samples.gyro_rad_s, samples.accel_m_s2], axis=1)
    stored = [encoder.imu_mounting(int(samples.stamps_ns[0]), BMI160.calibration)]
    stored += map(encoder.imu_sample, samples.stamps_ns.tolist(), rows)
    mounting = stored[0].data.replace(b"left_camera_optical_frame", b"left")  # as the images of this log name it
    stored[0] = stored[0]._replace(data=mounting)
    with path.open("wb") as out, plain.open("rb") as source:
        writer, channels = Writer(out), {}
        writer.start()
        messages = [(m.log_time, 1, s, c, m.data) for s, c, m in make_reader(source).iter_messages()]
        messages += [(m.log_time_ns, 0, None, m.channel, m.data) for m in stored]
        for time_ns, _, schema, channel, data in sorted(messages, key=lambda item: item[:2]):
            if channel.topic not in channels:
                of = schema or channel
                name, kind = (of.name, of.encoding) if schema else (of.schema_name, of.schema_encoding)
                known = writer.register_schema(name, kind, schema.data if schema else of.definition)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, known)
            writer.add_message(channels[channel.topic], time_ns, data, time_ns)
        writer.finish()
    return path, plain, samples
