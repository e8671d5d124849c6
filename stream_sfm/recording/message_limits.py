"""Bounds on messages with repeated fields: each element of a byte or two becomes an object of about a hundred bytes.

The pixels of an image are one field of bytes and are not bounded here. JSON has no definition that says which fields
repeat, so its values are counted before it is parsed.
"""

import json
from collections.abc import Callable
from typing import Any

from ..inputs import LIMITS

Decoder = Callable[[bytes], Any]


def bounded(decoder: Decoder) -> Decoder:
    """A decoder for a definition with repeated fields; it raises ValueError for messages over the bound."""

    def decode(data: bytes) -> Any:
        if len(data) > LIMITS.small_bytes:
            raise ValueError(
                f"its definition has repeated fields, and it is over {LIMITS.small_bytes // 2**20} MiB"
            )
        return decoder(data)

    return decode


def decode_json(data: bytes) -> Any:
    """Parse JSON like `json.loads`. Raises ValueError for more values than any message has."""
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))  # an upper bound: text may contain them too
    if values > LIMITS.json_values:
        raise ValueError(f"up to {values} values")
    if len(data) > LIMITS.json_text_bytes and not data.isascii():
        raise ValueError("a long text that is not ASCII")
    return json.loads(data)
