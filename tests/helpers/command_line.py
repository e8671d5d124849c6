"""The command line in this process."""

import json
from collections.abc import Collection
from typing import Any, NamedTuple

import pytest

from stream_sfm.cli.main import main


class Said(NamedTuple):
    """What a command printed."""

    out: str
    err: str

    @property
    def json(self) -> Any:
        """Its whole standard output, which must be one JSON value."""
        return json.loads(self.out)


class CommandLine:
    """Calls commands as a user types them: `cli("replay", log, "--json").json`; none may show a traceback."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object, code: int | Collection[int] = 0) -> Said:
        """Run `stream-sfm WORDS…`, which must end with this exit code, or one of these."""
        self._capsys.readouterr()
        ended = main([str(word) for word in words])
        said = Said(*self._capsys.readouterr())
        assert ended in ({code} if isinstance(code, int) else code), said.err
        assert "Traceback" not in said.err and "is a defect" not in said.err, said.err
        return said
