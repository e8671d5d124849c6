"""The schemas and channels that a log describes, as far as they stay within what a log can need.

They are kept while the log is read, and a compressed chunk of some kilobytes can hold a hundred megabytes of them.
"""

from copy import copy

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from .records import BrokenRecord, parse

_MAX_ONE_BYTES = 8 * 2**20
_MAX_ALL_BYTES = 64 * 2**20
_OBJECT_BYTES = 256  # that each takes in memory besides its own; all 2·65535 that MCAP has numbers for fit


class TooMuch(BrokenRecord):
    """Nothing is wrong with the record but its size."""


class Definitions:
    """`schemas` and `channels` by id. The metadata of channels is of no use here and left out."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._bytes = 0

    def copy(self) -> "Definitions":
        """With dictionaries of its own."""
        other = copy(self)
        other.schemas, other.channels = dict(self.schemas), dict(self.channels)
        return other

    def learn(self, opcode: int, body: bytes | memoryview) -> None:
        """Take one record of a schema or a channel; one that is known already costs nothing.

        Raises BrokenRecord where it is damaged, TooMuch where it is too large.
        """
        if len(body) > _MAX_ONE_BYTES:
            raise TooMuch(f"a schema or channel of {len(body) / 2**20:.0f} MiB")
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema.read, body)
            if self.schemas.get(schema.id) != schema:
                self._charge(len(body))
                self.schemas[schema.id] = schema
        else:
            channel = parse(Channel.read, body)
            channel.metadata = {}
            if self.channels.get(channel.id) != channel:
                self._charge(len(body))
                self.channels[channel.id] = channel

    def _charge(self, size_bytes: int) -> None:
        if self._bytes + size_bytes + _OBJECT_BYTES > _MAX_ALL_BYTES:
            raise TooMuch(f"schemas and channels of more than {_MAX_ALL_BYTES // 2**20} MiB altogether")
        self._bytes += size_bytes + _OBJECT_BYTES
