"""An MCAP file as a source."""

from pathlib import Path

from ..mcap_file.log_file import LogFile
from .source import Contents, Source


class McapSource(LogFile, Source):
    """The messages of one MCAP file, in file order. Arguments and errors as of `LogFile`."""

    format = "MCAP"

    def __init__(self, path: str | Path, descriptor: int | None = None) -> None:
        super().__init__(path, descriptor)
        header = self.header()
        self.profile, self.library = (header.profile, header.library) if header else (None, None)

    @property
    def indexed(self) -> bool:
        """See `Source`."""
        return self.index is not None

    def contents(self) -> Contents | None:
        """From the index, where there is one that can be trusted."""
        if (index := self.index) is None:
            return None
        known = index.definitions
        channels = [(known.channel(n), index.counts.get(n, 0) if index.counts else None) for n in known.channels]
        return Contents(channels, index.start_ns, index.end_ns)

    def drop_unverified_index(self) -> bool:
        """See `Source`: where a recording seems unusable, such an index may be the cause."""
        if self.index is None or self.index.checksummed:
            return False
        self.index = None
        self.damage.note("its index is not used: it carries no checksum, and by it the log cannot be used")
        return True
