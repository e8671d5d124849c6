"""`stream-sfm`: parse, call, and turn errors into exit codes, which are in `errors.py`.

A command is a function beside this file: its signature is its options, its docstring its help. Heavy imports happen
in the functions, so that `--help` answers at once, and Cyclopts only where a command line is not plain (`quick.py`).
"""

import errno
import io
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from typing import TextIO

from ..errors import STUDY, ExitCode, StreamSfmError
from ..system import memory
from ..system.interrupts import termination_as_interrupt
from ..system.wording import printable
from .library_messages import filtered
from .printing import print_error
from .process import settle
from .quick import call_of
from .usage import hint, rewritten, usage_error

_NO_MEMORY = "the system refuses the memory that is needed: allow this process more (ulimit -v), or use smaller images"
# Errors of a full or failing disk, an exceeded quota or a closed terminal: not defects of the program.
_REFUSED_BY_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    settle()
    _open_missing_streams()
    words = rewritten(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    # a program that calls `main` keeps its descriptors; what asks for --debug wants to see everything
    own_process = argv is None and not debug
    with filtered(quiet=not {"-q", "--quiet"}.isdisjoint(words)) if own_process else nullcontext():
        return _main(words, debug)


def _main(words: list[str], debug: bool) -> int:
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal without σ, or odd file names, must not end a run
            stream.reconfigure(errors="backslashreplace")
    try:
        with _logging_to_stderr():
            return _run(words, debug)
    except BrokenPipeError:  # the reader of our output has gone, for example `| head`
        _discard(sys.stdout, sys.stderr)
        return ExitCode.DONE


def _open_missing_streams() -> None:
    """Open the null device in place of standard streams that the process was started without, as by `>&-`."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 for as long as the process lasts


def _discard(*streams: TextIO) -> None:
    """Redirect these streams to the null device, so that flushing them at exit cannot fail."""
    for stream in streams:
        with suppress(OSError, ValueError):  # a stream of a program that calls `main` may have no file
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _LogFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"problem: {printable(record.getMessage())}"


@contextmanager
def _logging_to_stderr() -> Iterator[None]:
    """Print what the library logs: problems that must be seen before the run ends."""
    logger, handler = logging.getLogger("stream_sfm"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(_LogFormatter())
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _run(words: list[str], debug: bool) -> int:
    """Run one command: the one place where errors become exit codes."""
    try:
        is_help, call = False, call_of(words)
        if call is None:
            from .app import build_app

            app = build_app(words)
            _, apps, rest = app.parse_commands(words)
            if apps[-1].default_command is None and not rest:  # nothing, or `import` alone
                app.help_print(words, console=app.error_console)
                return ExitCode.USAGE
            is_help, call = bool(rest) and set(rest) <= {"-h", "--help", "--version"}, partial(app, words)
        if not is_help and not memory.is_enough():
            print_error(_NO_MEMORY)
            return ExitCode.INPUT
        with termination_as_interrupt():
            code = call()
            sys.stdout.flush()
            return ExitCode.DONE if code is None else int(code)  # None: nothing to report, as of --help
    except BrokenPipeError:
        raise
    except (Exception, KeyboardInterrupt) as error:
        ended, message, advice = _reported(words, error)
        if debug:
            import traceback

            traceback.print_exception(error)
        print_error(message)
        if advice:
            print(advice, file=sys.stderr)
        return ended


def _reported(words: list[str], error: BaseException) -> tuple[int, str, str]:
    """Exit code, message and advice of an error."""
    # Cyclopts may not be loaded, and that is not to be done with the last memory or file
    if "cyclopts" in sys.modules and (usage := usage_error(words, error)):
        return ExitCode.USAGE, *usage
    match error:
        case StreamSfmError():
            return error.exit_code, str(error), hint(words, error)
        case KeyboardInterrupt():
            return ExitCode.INTERRUPTED, "interrupted", ""
        case ModuleNotFoundError(name=str(name)) if name.partition(".")[0] in STUDY:
            return ExitCode.USAGE, f"this needs the package {name}: pip install 'stream-sfm[study]'", ""
        case ModuleNotFoundError(name=str(name)) if not name.startswith("stream_sfm"):
            cure = "pip install --force-reinstall stream-sfm"
            return ExitCode.USAGE, f"the package {name} is missing, which stream-sfm needs: {cure}", ""
        case OSError(errno=errno.EMFILE | errno.ENFILE):
            return ExitCode.USAGE, "too many open files; raise the limit, for example by ulimit -n 256", ""
        case OSError() if error.errno in _REFUSED_BY_THE_DISK:
            _discard(sys.stdout)
            where = error.filename or "the standard output"
            return ExitCode.INPUT, f"cannot write {where}: {error.strerror}", ""
    if memory.is_refused(error):
        reason = f" ({error})" if str(error) else ""
        return ExitCode.INPUT, f"{_NO_MEMORY}{reason}; results so far are written", ""
    advice = "this is a defect of stream-sfm; please report it with the output of --debug"
    return ExitCode.DEFECT, f"{type(error).__name__}: {error}".splitlines()[0], advice


if __name__ == "__main__":
    sys.exit(main())
