"""What a run says of itself."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.report.records import RunRecord
from tests.helpers.wall import Wall, camera_path, rig

_ONE_AFTER_ANOTHER = """
import subprocess, sys
import numpy as np
from stream_sfm.run.summary import peak_rss_mib
large = np.ones(50_000_000)
small = "from stream_sfm.run.summary import peak_rss_mib; print(peak_rss_mib())"
print(peak_rss_mib(), flush=True)
subprocess.run([sys.executable, "-c", small], check=True)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory of a process is read from /proc")
def test_the_memory_of_a_run_is_its_own_and_not_that_of_the_process_that_started_it():
    done = subprocess.run([sys.executable, "-c", _ONE_AFTER_ANOTHER], capture_output=True, text=True, check=True)
    large, small = (float(line) for line in done.stdout.split())
    assert large > 50e6 * 8 / 2**20 and small < 300  # MiB; a process with NumPy takes some tens


@pytest.mark.parametrize(("first", "said"), [(2, False), (12, True)])
def test_a_correction_on_the_way_says_from_which_frame_on_and_what_it_means(first: int, said: bool):
    engine, statistics = sfm.Engine(rig()), RunRecord("cross-frame", disparity_at_1m_px=60.0)
    for frame in Wall(1).frames(rig(), camera_path(14)):
        estimate = engine.step(frame)
        found = estimate.rig
        if found is not None:
            mean = np.zeros(len(found.mean))
            mean[0] = 0.3
            found = replace(found, mean=mean, p_wrong=float(estimate.frame_index >= first))
        statistics.add(replace(estimate, rig=found))
    warnings = statistics.warnings()
    assert len(warnings) == said
    if said:
        assert warnings[0].startswith("from frame 12 on, a calibration error of 0.30 px of disparity is corrected")
        assert "distances of 10 m are off by 5.0%" in warnings[0]
