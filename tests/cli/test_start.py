"""What starting a replay does not load: each of these takes milliseconds that a short replay would notice."""

import ast
import importlib.metadata
import subprocess
import sys
from pathlib import Path

from stream_sfm.logs.mcap_file import library

NOT_LOADED = (
    # of other packages: another parser, tables, pages, and what NumPy, mcap or a short word of ours would pull in
    *("cyclopts", "attrs", "rich", "markupsafe", "jinja2", "ruamel", "threadpoolctl", "rerun", "scipy"),
    *("email", "importlib.metadata", "numpy.ma", "numpy.random", "numpy.fft", "numpy.polynomial", "multiprocessing"),
    # of our own: commands and runs of another kind
    *("stream_sfm.cli.app", "stream_sfm.cli.summaries", "stream_sfm.cli.compare", "stream_sfm.viewer"),
    *("stream_sfm.batch", "stream_sfm.places", "stream_sfm.simulation", "stream_sfm.dense.surface"),
    *("stream_sfm.report.pages", "stream_sfm.report.svg", "stream_sfm.run.self_test", "stream_sfm.run.compare"),
    *("stream_sfm.estimators.baselines", "stream_sfm.logs.importers"),
    *("stream_sfm.results.estimates_reader", "stream_sfm.logs.sources.data_sets", "stream_sfm.logs.sources.rosbag2"),
)


def test_a_plain_replay_loads_nothing_that_it_does_not_use(wall_log: Path, tmp_path: Path) -> None:
    words = ["replay", str(wall_log), "--max-frames", "4", "-q", "--out", str(tmp_path / "out")]
    script = f"import sys; from stream_sfm.cli.main import main; assert not main({words})\nprint(list(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=1800, check=True)
    loaded = set(ast.literal_eval(done.stdout.splitlines()[-1]))
    assert {"stream_sfm.run.replay", "mcap.writer", "numpy"} <= loaded
    assert (unused := sorted(loaded & set(NOT_LOADED))) == [], unused


def test_the_writer_of_mcap_leaves_the_metadata_of_packages_as_they_are() -> None:
    script = (
        f"import {library.__name__}, importlib.metadata as m, mcap.writer as w\nprint(m.version('mcap'), w.__version__)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=1800, check=True)
    assert done.stdout.split() == 2 * [importlib.metadata.version("mcap")]
