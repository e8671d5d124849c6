"""A batch takes recordings of every kind, each folder that is one as one log, and does again only what has changed."""

import json
from pathlib import Path

import pytest

from stream_sfm.cli.main import main
from tests.batch.running import NEEDS_PROC
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.stereo_logs import Spec, write_log

pytestmark = NEEDS_PROC


def run(logs: Path, out: Path) -> dict[str, dict[str, object]]:
    assert main(["batch", str(logs), "--out", str(out), "-q", "--method", "frame-to-frame", "--workers", "2"]) == 0
    content = json.loads((out / "batch.json").read_text())
    assert content["complete"]
    return {log["name"]: log for log in content["logs"]}


def test_bags_of_both_kinds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs = tmp_path / "logs"
    (logs / "deep").mkdir(parents=True)
    log1 = write_log(tmp_path / "1.mcap", Spec(profile="ros1"))
    log2 = write_log(tmp_path / "2.mcap", Spec(profile="ros2"))
    write_bag1(logs / "old.bag", messages_of(log1))
    bag = write_bag2(logs / "deep" / "walk", messages_of(log2))
    found = run(logs, tmp_path / "out")
    assert {name: log["status"] for name, log in found.items()} == dict.fromkeys(("old", "deep-walk"), "done")
    frames = [log["summary"]["frames"]["estimated"] for log in found.values()]  # type: ignore[index]
    assert frames == [12, 12]
    assert all(log["reused"] for log in run(logs, tmp_path / "out").values())
    (bag / "metadata.yaml").write_text((bag / "metadata.yaml").read_text() + "\n")
    assert [name for name, log in run(logs, tmp_path / "out").items() if not log["reused"]] == ["deep-walk"]
