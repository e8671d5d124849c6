"""What tools/bench.py counts: calls of the core and of functions, and files that a step or a frame enters."""

import os
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

WARM_UP = 10  # frames not counted in times
_WINDOW = "estimators/window/"
# Rooms whose `__init__.py` says enough to understand a step.
DOORS = ("pictures", "rig_model", "frontend/second_motions", "frontend/learnt", _WINDOW + "unknowns")
DOORS += (_WINDOW + "inertia", _WINDOW + "reported")


class AfterFrame:
    """A sink that calls a function with each estimate, when it has been written."""

    def __init__(self, call: Callable[[Any], None]) -> None:
        self._call = call

    def write(self, estimate: Any, frame: Any) -> None:
        """Call it."""
        self._call(estimate)

    def close(self) -> None:
        """Nothing is open."""


def run_calls(path: str, overrides: list[str]) -> dict[str, Any]:
    """How often a step calls the compiled core, and functions of the package in Python; the most frequent of both.

    A generator counts each time it goes on, a comprehension not at all. And how many files a step enters, `to_read` not
    counting those behind DOORS, and a frame in `replay`.
    """
    import stream_sfm
    from stream_sfm import Engine, Selection, core, open_log, read_config

    package = os.path.dirname(stream_sfm.__file__)
    of_core: Counter[str] = Counter()
    of_python: Counter[str] = Counter()
    files: set[str] = set()

    def counted(name: str, function: Any) -> Any:
        def inner(*args: Any, **named: Any) -> Any:
            of_core[name] += 1
            return function(*args, **named)

        return inner

    def see(stack: FrameType, event: str, _: Any) -> None:
        code = stack.f_code
        if event == "call" and code.co_filename.startswith(package) and not code.co_name.startswith("<"):
            of_python[f"{Path(code.co_filename).stem}.{code.co_name}"] += 1
            files.add(os.path.relpath(code.co_filename, package))

    stages = {name: each for name, each in vars(core).items() if type(each).__name__ == "nb_func"}
    for name, each in stages.items():
        setattr(core, name, counted(name, each))
    log = open_log(path)
    frames = list(log.frames(Selection(max_frames=WARM_UP + 50)))
    engine = Engine(log.rig, read_config(None, overrides))
    for n, frame in enumerate(frames):
        if n == WARM_UP:
            of_core.clear()
            sys.setprofile(see)
        engine.step(frame)
    sys.setprofile(None)
    stepped = max(1, len(frames) - WARM_UP)
    counts = {"core": of_core, "python": of_python}
    return {
        name: {"a_frame": c.total() / stepped, "most": {k: v / stepped for k, v in c.most_common(30)}}
        for name, c in counts.items()
    } | {
        "step": {"entered": len(files), "to_read": sum(os.path.dirname(f) not in DOORS for f in files)},
        "files": files_entered(path, overrides),
    }


def files_entered(path: str, overrides: list[str]) -> dict[str, float]:
    """How many files of the package a frame enters in `replay`: mean of what is called between two written estimates.

    A file is `entered` if one of its functions is called, in any thread, and is `on_the_way` if one of these calls a
    function of another file: the others are helpers, at which a reader need not look.
    """
    import stream_sfm
    from stream_sfm import Selection, read_config, replay

    package = os.path.dirname(stream_sfm.__file__)
    entered: set[str] = set()
    on_the_way: set[str] = set()
    counts: list[tuple[int, int]] = []

    def see(stack: FrameType, event: str, _: Any) -> None:
        name, caller = stack.f_code.co_filename, stack.f_back
        if event == "call" and name.startswith(package):
            entered.add(name)
            if caller is not None and caller.f_code.co_filename not in (name, __file__):
                on_the_way.add(caller.f_code.co_filename)

    def next_frame(_: Any) -> None:
        counts.append((len(entered), len(entered & on_the_way)))
        entered.clear()
        on_the_way.clear()

    selection = Selection(max_frames=WARM_UP + 50)
    with tempfile.TemporaryDirectory() as folder:
        threading.setprofile(see)
        sys.setprofile(see)
        replay(path, folder, read_config(None, overrides), selection, sinks=[AfterFrame(next_frame)])
        sys.setprofile(None)
    means = np.mean(counts[WARM_UP:], axis=0)
    return {"entered": float(means[0]), "on_the_way": float(means[1])}
