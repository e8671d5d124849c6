"""The results that two runs must have in common, to the byte."""

from pathlib import Path

from mcap.reader import make_reader


def estimate_messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    """Everything in an estimates.mcap apart from the time that it took."""
    with open(path, "rb") as stream:
        return [
            (channel.topic, m.log_time, m.sequence, m.data)
            for _, channel, m in make_reader(stream).iter_messages()
            if channel.topic != "/stream_sfm/timing"
        ]


def assert_same_results(one: Path, other: Path) -> None:
    """Two folders of replays hold the same estimates, trajectories and configuration."""
    for name in ("trajectory.tum", "trajectory.kitti", "trajectory.csv", "config.toml"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    first = estimate_messages(one / "estimates.mcap")
    assert first and first == estimate_messages(other / "estimates.mcap")
