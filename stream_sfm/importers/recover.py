"""Copies what can be read of a damaged MCAP file into a new one."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import LogError
from ..inputs import LIMITS
from ..mcap_file.message import Damage
from ..recording.log_writer import MessageWriter
from ..sources.mcap import McapSource
from .data_sets import check_free


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was copied to `path`: messages by topic, attachments and metadata records.

    `complete`: nothing was lost, as far as the file tells; `warnings` say what is wrong with it, and where.
    """

    path: Path
    messages: dict[str, int]
    attachments: int = 0
    metadata: int = 0
    complete: bool = True
    warnings: list[str] = field(default_factory=list)


def recover(log: str | Path, out: str | Path, *, overwrite: bool = False) -> Recovered:
    """Copy every readable message, attachment and metadata record of an MCAP file to `out`, in the order of the file.

    The messages are not decoded: their bytes, times and sequence numbers, and the definitions of their channels, are
    those of the log. `out` appears when it is whole; its folder is made if need be. `overwrite`: a file that is there
    may be replaced, but not the log. Raises LogError where the log has no readable message, and OutputError.
    """
    out, source = Path(out), McapSource(log)
    check_free(out, [source.path], overwrite)
    damage, counts = Damage(), Counter[str]()
    with MessageWriter(out, compressed=True, profile=source.profile or "") as copy:
        for message in source.messages(damage):
            copy.write(message)
            counts[message.channel.topic] += 1
        if not counts:
            raise LogError("; ".join([f"{source.path} has no message that can be read", *damage.notes[:3]]))
        attachments = metadata = 0
        for attachment in source.attachments(damage, LIMITS.record_bytes):
            copy.attach(attachment)
            attachments += 1
        for record in source.metadata(damage):
            copy.add_metadata(record)
            metadata += 1
    return Recovered(out, dict(sorted(counts.items())), attachments, metadata, damage.complete, damage.notes)
