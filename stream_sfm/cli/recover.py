"""`stream-sfm recover`: what can be read of a damaged MCAP file, as a new one."""

import argparse
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..mcap_file.recover import Recovered


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "recover",
        run,
        summary="copy what can be read of a damaged MCAP file",
        description="Copy every message that can be read, of all topics and with unchanged bytes, into a new MCAP file "
        "with an index, and say what was lost. `replay` and the other commands read damaged logs as they are; a "
        "recovered one is for programs that do not. If something was lost, the exit code is 3.",
        usage="LOG OUT.mcap [options]",
    )
    parser.add_argument("log", metavar="LOG", help="the damaged MCAP file")
    parser.add_argument("out", metavar="OUT.mcap", help="the file to write")
    result = parser.add_argument_group("result")
    result.add_argument("--force", dest="overwrite", action="store_true", help="replace OUT.mcap if it exists")
    arguments.add_general(parser, json="what was copied, as one JSON object,", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Recover and report."""
    from ..mcap_file.recover import recover
    from .printing import print_json, print_notes

    recovered = recover(args.log, args.out, overwrite=args.overwrite)
    if args.json:
        numbers = {"attachments": recovered.attachments, "metadata": recovered.metadata}
        report = {"out": str(recovered.path), "complete": recovered.complete, "messages": recovered.messages}
        print_json(report | numbers | {"warnings": recovered.warnings})
    else:
        print_notes("warning", recovered.warnings)
        if not args.quiet:
            _print_table(recovered)
    return ExitCode.DONE if recovered.complete else ExitCode.INPUT


def _print_table(recovered: "Recovered") -> None:
    from rich.markup import escape

    from .printing import cleaned, facts_table, stdout_console

    total = sum(recovered.messages.values())
    lost = "nothing was lost" if recovered.complete else "what was damaged is lost"
    print(cleaned(f"{recovered.path}: {total} messages; {lost}"))
    table = facts_table()
    for topic, count in recovered.messages.items():
        table.add_row(escape(cleaned(topic)), str(count))
    for kind, count in (("attachments", recovered.attachments), ("metadata records", recovered.metadata)):
        if count:
            table.add_row(kind, str(count))
    stdout_console().print(table)
