"""The memory of a separate process."""

import subprocess
import sys


def peaks_mib(code: str, *arguments: object) -> list[float]:
    """Run `code`, which must succeed; the largest memory up to each call of its `peak()`, and at its end, MiB."""
    # not ru_maxrss: a process inherits that of the one that started it
    head = "import sys\nfrom stream_sfm.run.summary import peak_rss_mib\n"
    head += "def peak(): print('peak', peak_rss_mib(), flush=True)\n"
    command = [sys.executable, "-c", f"{head}{code}\npeak()", *map(str, arguments)]
    done = subprocess.run(command, start_new_session=True, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    return [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("peak ")]
