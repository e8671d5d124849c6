"""What a run says of itself."""

import subprocess
import sys
from pathlib import Path

import pytest

_ONE_AFTER_ANOTHER = """
import subprocess, sys
import numpy as np
from stream_sfm.pipeline.statistics import peak_rss_mib
large = np.ones(100_000_000)
small = "from stream_sfm.pipeline.statistics import peak_rss_mib; print(peak_rss_mib())"
print(peak_rss_mib(), flush=True)
subprocess.run([sys.executable, "-c", small], check=True)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory of a process is read from /proc")
def test_the_memory_of_a_run_is_its_own_and_not_that_of_the_process_that_started_it():
    done = subprocess.run([sys.executable, "-c", _ONE_AFTER_ANOTHER], capture_output=True, text=True, check=True)
    large, small = (float(line) for line in done.stdout.split())
    assert large > 100e6 * 8 / 2**20 and small < 400
