"""What a check of a program found."""

from __future__ import annotations

from typing import NamedTuple

from robocorba.errors.robots import InvalidProgram


class Finding(NamedTuple):
    """Something that can't be: `parameter` of the icon at a path such as icons[2].then[0], and what is wrong with it.
    Several parameters that are wrong together are told as `x, y, z`."""

    icon: str
    parameter: str
    what: str

    def __str__(self) -> str:
        return str(self.error())

    def error(self) -> InvalidProgram:
        """The same to raise."""
        return InvalidProgram(*self)


class Note(NamedTuple):
    """What could not be proved of an icon, or what was taken for granted; an empty path: of the program as a whole."""

    icon: str
    what: str

    def __str__(self) -> str:
        return f"{self.icon}: {self.what}" if self.icon else self.what


class Report:
    """Findings, the first one of each parameter, and notes, in the order in which they were met."""

    def __init__(self) -> None:
        self._findings: dict[tuple[str, str], Finding] = {}
        self._notes: dict[Note, None] = {}

    @property
    def findings(self) -> tuple[Finding, ...]:
        return tuple(self._findings.values())

    @property
    def notes(self) -> tuple[Note, ...]:
        return tuple(self._notes)

    @property
    def is_sound(self) -> bool:
        """Whether nothing was found."""
        return not self._findings

    def find(self, icon: str, parameter: str, what: str) -> None:
        """Add a finding."""
        self._findings.setdefault((icon, parameter), Finding(icon, parameter, what))

    def note(self, icon: str, what: str) -> None:
        """Add a note."""
        self._notes.setdefault(Note(icon, what))
