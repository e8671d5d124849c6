"""docs/formats.md and the output of the commands agree: every key, topic and schema of one is in the other."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from stream_sfm.batch.replay_batch import replay_batch
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import read_config
from stream_sfm.run.compare import compare
from stream_sfm.run.replay import replay
from stream_sfm.types import Selection
from tests.helpers.places import ROOT
from tests.helpers.wall_log import write_wall_log

FEW = read_config(None, ["frontend.max_tracks=60"])
PAGE = (ROOT / "docs/formats.md").read_text(encoding="utf-8")


def tables(heading: str) -> list[list[list[str]]]:
    """The tables of a section: rows of cells, without their heads."""
    section = re.split(r"^## ", PAGE.split(f"\n## {heading}\n")[1], flags=re.MULTILINE)[0]
    found = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)
    return [[[c.strip() for c in row.strip("|\n").split("|")] for row in t.splitlines()[2:]] for t in found]


def names(table: list[list[str]]) -> set[str]:
    """What stands in backticks in the first column."""
    return {name for row in table for name in re.findall(r"`([^`]+)`", row[0])}


def paths(value: Any, where: str = "") -> Iterator[str]:
    """Dotted keys of all leaves."""
    if isinstance(value, dict) and (value or not where):
        for key, inner in value.items():
            yield from paths(inner, f"{where}.{key}" if where else key)
    else:
        yield where


def assert_same(documented: set[str], found: set[str]) -> None:
    """`*` stands for any key; a documented key also stands for all below it."""
    patterns = {name: re.compile(re.escape(name).replace(r"\*", r"[^.]+") + r"(\..*)?") for name in documented}
    unknown = {path for path in found if not any(p.fullmatch(path) for p in patterns.values())}
    missing = {name for name, p in patterns.items() if not any(p.fullmatch(path) for path in found)}
    assert not unknown, f"not in formats.md: {sorted(unknown)}"
    assert not missing, f"only in formats.md: {sorted(missing)}"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """40 frames, which are the fewest with ratios between methods."""
    return write_wall_log(tmp_path_factory.mktemp("formats") / "wall.mcap", n=21, times=2)


@pytest.fixture(scope="module")
def replayed(log):
    folder = log.parent / "run"
    replay(log, folder, FEW, Selection(max_frames=8), self_test=True, there_and_back=True)
    return folder


def test_summary(replayed):
    of_live = {"live"}  # which a replay has not; tests/recording/test_cameras.py has its summary
    found = set(paths(json.loads((replayed / "summary.json").read_bytes())))
    assert_same(names(tables("summary.json")[0]) - of_live, found)


def test_estimates(replayed):
    topics, keys = tables("estimates.mcap")
    with (replayed / "estimates.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        found = [[c.topic, c.message_encoding, summary.schemas[c.schema_id].name] for c in summary.channels.values()]
        assert sorted(found) == sorted([cell.strip("`") for cell in row[:3]] for row in topics)
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        last = {channel.topic: message for _, channel, _, message in decoded}
        assert set(last["/stream_sfm/estimate"].__slots__) == names(keys)
        timing = next(row[3] for row in topics if row[0] == "`/stream_sfm/timing`")
        assert all(f"`{key}`" in timing for key in last["/stream_sfm/timing"].__slots__)
        assert {m.name for m in reader.iter_metadata()} == {"stream_sfm", "configuration"}
        assert [a.name for a in reader.iter_attachments()] == ["calibration.toml"]
        assert reader.get_header().profile == "ros2"


def test_report(log, tmp_path):
    of_all, of_method = map(names, tables("report.json"))
    accuracy = {n.removeprefix("ground_truth.") for n in names(tables("summary.json")[0]) if "ground_truth." in n}
    methods = ("cross-frame", "frame-to-frame")
    compare(log, tmp_path, FEW, methods=methods, self_test=True)
    content = json.loads((tmp_path / "report.json").read_bytes())
    assert_same(of_all, set(paths(content)))
    with_folder = set(content["methods"]) - {"cross_frame_replayed"}  # which the first pass finds
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == with_folder
    for figures in content["methods"].values():
        assert set(figures) == of_method | accuracy - {"frames_ignored"}  # once per report


def test_batch(log, tmp_path):
    of_all, of_log = map(names, tables("batch.json, job.json"))
    content = replay_batch([log], tmp_path, selection=Selection(max_frames=3), workers=1)
    assert json.loads((tmp_path / "batch.json").read_bytes()) == json.loads(json.dumps(content))
    assert_same(of_all, set(paths(content)))
    assert set(json.loads((tmp_path / "wall/job.json").read_bytes())) == of_log
    assert set(content["logs"][0]) == of_log | {"summary"}


def test_the_calibration_that_is_shown_is_read():
    text = re.search(r"```toml\n(.*?)```", (ROOT / "docs/own-data.md").read_text(encoding="utf-8"), re.DOTALL)
    assert text
    rig = StereoRig.parse_calibration(text[1].encode(), "own-data.md")
    assert rig.baseline_m == pytest.approx(0.11)


def test_config_has_the_sections_that_are_named(cli):
    sections = re.findall(r"^\[(\w+)\]", cli("config").out, re.MULTILINE)
    text = PAGE.split("\n## config.toml\n")[1]
    assert re.findall(r"`\[(\w+)\]`", text.partition("Settings that few")[0]) == sections
