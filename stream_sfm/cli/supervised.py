"""`python -m stream_sfm.cli.supervised replay …`: the command, in a process that ends when its parent does.

When the other end of standard input closes, on purpose or because that process was killed, the replay is ended as
by SIGTERM: after the frame in hand, everything written.
"""

import os
import signal
import sys
import threading

from .main import main


def _end_with_the_starter() -> None:
    while os.read(sys.stdin.fileno(), 1):  # not sys.stdin.read: it would hold a lock that the exit waits for
        pass
    signal.raise_signal(signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_end_with_the_starter, daemon=True).start()
    sys.exit(main(sys.argv[1:]))
