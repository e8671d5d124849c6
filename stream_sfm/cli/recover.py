"""`stream-sfm recover`: what can be read of a damaged MCAP file, as a new one."""

from ..errors import ExitCode
from ..wording import printable
from . import options


def recover(
    log: options.Log,
    out: options.NewLog,
    /,
    *,
    force: options.Force = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Copy what can be read of a damaged MCAP file.

    Copies every message that can be read, of all topics and with unchanged bytes, into a new MCAP file with an index,
    and says what was lost. `replay` and the other commands read damaged logs as they are; a recovered one is for
    programs that do not. If something was lost, the exit code is 3.

    Args:
        log: the damaged MCAP file
    """
    from ..importers.recover import recover as recover_file
    from .printing import print_json, print_notes
    from .tables import print_table

    done = recover_file(log, out, overwrite=force)
    others = {"attachments": done.attachments, "metadata": done.metadata}
    if json:
        report = {"out": str(done.path), "complete": done.complete, "messages": done.messages}
        print_json(report | others | {"warnings": done.warnings})
    else:
        print_notes("warning", done.warnings)
        if not quiet:
            lost = "nothing was lost" if done.complete else "what was damaged is lost"
            print(printable(f"{done.path}: {sum(done.messages.values())} messages; {lost}"))
            records = {"attachments": done.attachments, "metadata records": done.metadata}
            counts = [*done.messages.items(), *((kind, count) for kind, count in records.items() if count)]
            print_table([(name, str(count)) for name, count in counts])
    return ExitCode.DONE if done.complete else ExitCode.INPUT
