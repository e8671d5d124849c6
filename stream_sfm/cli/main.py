"""`stream-sfm`: parse, call, and turn errors into exit codes; each command is a module beside this one.

The exit codes are in `errors.py`. Heavy imports happen in the commands, so that `--help` answers at once.
"""

import argparse
import errno
import gc
import io
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TextIO

from .. import __version__
from ..errors import ExitCode, StreamSfmError
from ..interrupts import termination_as_interrupt
from ..wording import printable
from . import batch, calibrate, calibration, compare, config, import_, inspect, recover, replay, simulate, surface
from .arguments import add_debug
from .completion import complete
from .error_lines import hint, print_error
from .parser import Parser

# Python's collector looks for cycles, of which we make hardly any; by default imports alone call it 150 times.
_ALLOCATIONS_PER_COLLECTION = 100_000

# What a disk, a quota or a terminal that is gone says to whom writes: no defect of the program.
_REFUSED_BY_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)

COMMANDS = (replay, batch, compare, surface, inspect, import_, recover, calibrate, calibration, simulate, config)


def build_parser() -> Parser:
    """The parser with all commands."""
    parser = Parser(
        prog="stream-sfm",
        usage="stream-sfm COMMAND [options]",
        description="Estimate camera motion and local 3-D structure, with covariances, from stereo recordings.",
        epilog="Exit codes: 0 success; 1 internal error (a defect of stream-sfm); 2 wrong usage or configuration; "
        "3 input unreadable, unsuitable or only partly read; 130 interrupted, with all results so far written.",
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    for command in COMMANDS:
        command.add_parser(subparsers)
    general = parser.add_argument_group("general")
    add_debug(general)
    general.add_argument(
        "--version", action="version", version=f"stream-sfm {__version__}", help="print the version"
    )
    general.add_argument("-h", "--help", action="help", help="show this help and exit")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # One thread for small matrices and some hundred small patches: waiting threads cost more than they save, and the
    # numbers are the same on every machine. Left and right are decoded in threads of their own.
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        os.environ.setdefault(variable, "1")
    gc.set_threshold(_ALLOCATIONS_PER_COLLECTION)
    _open_missing_streams()
    for stream in (
        sys.stdout,
        sys.stderr,
    ):  # a terminal without σ, or a file name that is not text, must not end a run
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    parser = build_parser()
    complete(parser)
    try:
        args = parser.parse(argv)
    except SystemExit as stop:  # --help, --version and usage errors, already printed
        return stop.code if isinstance(stop.code, int) else ExitCode.DONE
    if args.command is None:
        parser.print_help(sys.stderr)
        return ExitCode.USAGE
    try:
        with _logging_to_stderr():
            return _run(args)
    except BrokenPipeError:  # the reader of our output has gone, for example `| head`
        _discard(sys.stdout, sys.stderr)
        return ExitCode.DONE


def _open_missing_streams() -> None:
    """Give a process that was started without an output or an input, as by `>&-`, one that leads nowhere."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 for as long as the process lasts


def _discard(*streams: TextIO) -> None:
    """Let what is still to be written to these streams lead nowhere, so that nothing fails at the exit."""
    for stream in streams:
        with suppress(OSError, ValueError):  # a stream of a program that calls `main` may have no file
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _LogFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"problem: {printable(record.getMessage())}"


@contextmanager
def _logging_to_stderr() -> Iterator[None]:
    """Show what the library logs, which are problems that cannot wait for the end of a run."""
    logger, handler = logging.getLogger("stream_sfm"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(_LogFormatter())
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _run(args: argparse.Namespace) -> int:
    try:
        with termination_as_interrupt():
            code: int = args.run(args)
            sys.stdout.flush()
            return code
    except StreamSfmError as error:
        return _failed(args, error, error.exit_code, str(error), hint(error, args))
    except KeyboardInterrupt as error:
        return _failed(args, error, ExitCode.INTERRUPTED, "interrupted")
    except BrokenPipeError:
        raise
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("stream_sfm"):
            return _defect(args, error)
        text = (
            f"the package {error.name} is missing, which stream-sfm needs: pip install --force-reinstall stream-sfm"
        )
        return _failed(args, error, ExitCode.USAGE, text)
    except OSError as error:
        if error.errno not in _REFUSED_BY_THE_DISK:
            return _defect(args, error)
        _discard(sys.stdout)
        where = f"{error.filename}" if error.filename else "the standard output"
        return _failed(args, error, ExitCode.INPUT, f"cannot write {where}: {error.strerror}")
    except Exception as error:
        return _defect(args, error)


def _defect(args: argparse.Namespace, error: Exception) -> int:
    text = f"{type(error).__name__}: {error}".splitlines()[0]
    advice = "this is a defect of stream-sfm; please report it with the output of --debug"
    return _failed(args, error, ExitCode.DEFECT, text, advice)


def _failed(args: argparse.Namespace, error: BaseException, code: int, message: str, advice: str = "") -> int:
    if args.debug:
        import traceback

        traceback.print_exception(error)
    print_error(message)
    if advice:
        print(advice, file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
