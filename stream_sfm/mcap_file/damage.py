"""What one reading of a file met: how far it came, and what could not be read."""

from dataclasses import dataclass, field

_MAX_NOTES = 20  # of one reading; a hostile file could give one per record


@dataclass(slots=True)
class Damage:
    """`complete` becomes false once anything was lost; `notes` say for people what and where."""

    complete: bool = True
    bytes_read: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        """Record that something was lost; a repeated note is kept once."""
        self.complete = False
        self.note(note)

    def note(self, note: str) -> None:
        """Record that something is wrong that has cost nothing."""
        if len(self.notes) < _MAX_NOTES and note not in self.notes:
            self.notes.append(note)
