"""What all parts of the console have in common that follow the running system."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from robocorba.errors.base import RoboCorbaError
from robocorba.system.repeating import Repeating


class Following(Repeating):
    """Reads news of a part of the running system in a thread of its own, from `start` to `close`.

    changed: called in that thread when there is news. problem: why that part does not answer, empty while it does; a
    change of it is news."""

    def __init__(
        self, name: str, every_s: float | Callable[[], float], changed: Callable[[], None], problem: str = ""
    ) -> None:
        super().__init__(name, self.follow, every_s)
        self._changed, self.problem = changed, problem

    def follow(self) -> None:
        """Read news once."""
        try:
            has_changed, problem = self._read_news(), ""
        except RoboCorbaError as error:
            has_changed, problem = False, str(error)
        if has_changed or problem != self.problem:
            self.problem = problem
            self._changed()

    @abstractmethod
    def _read_news(self) -> bool:
        """Whether anything has changed. Raises RoboCorbaError."""
