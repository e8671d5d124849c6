"""The writer of the mcap library, without the 45 modules that would only look up its version: 15 ms."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

import mcap


@contextmanager
def _version_known() -> Iterator[None]:
    """Answer for `importlib.metadata`, which imports `email` and more, unless it is there."""
    answer = ModuleType("importlib.metadata")
    vars(answer).update(PackageNotFoundError=ImportError, version=lambda _: mcap.__version__)
    used = sys.modules.setdefault(answer.__name__, answer)
    try:
        yield
    finally:
        if used is answer:
            del sys.modules[answer.__name__]


with _version_known():
    from mcap.writer import CompressionType, Writer

__all__ = ["CompressionType", "Writer"]
