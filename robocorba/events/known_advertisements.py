"""Which advertisements both ends of a session have, so that a renewal carries only new ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from robocorba.events.federation import Advertisement


class KnownAdvertisements:
    """Of one session."""

    def __init__(self) -> None:
        self._versions: dict[str, int] = {}
        #: The last sequence of which the other end had everything: most renewals compare nothing else.
        self._complete: Sequence[Advertisement] | None = None

    def missing(self, advertisements: Sequence[Advertisement]) -> list[Advertisement]:
        """Those that the other end neither has nor has sent. The sequence must not be changed afterwards."""
        if advertisements is self._complete:
            return []
        missing = [entry for entry in advertisements if self._versions.get(entry.name, 0) < entry.version]
        if not missing:
            self._complete = advertisements
        return missing

    def add(self, advertisements: Iterable[Advertisement]) -> None:
        """The other end has received these, or has sent them."""
        self._versions.update((entry.name, entry.version) for entry in advertisements)
