"""What pages ask the console to do: calls by name with JSON arguments, each translated to calls of CORBA objects."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_type_hints

from robocorba.console.arguments import InvalidArguments, checked
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.corba.emergency_stop import StopAddresses, reset_robots, stop_robots
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.system.supervision.stop_addresses import stop_addresses

#: Timeout for finding an object that a page asks or asks for [s].
RESOLVE_TIMEOUT_S = 1.0
Operation = Callable[..., Any]


class Operations:
    """Operations by name: public methods of this class and of the parts that pages add."""

    def __init__(self, orb: Orb, state: Path | None = None) -> None:
        self._orb, self._state = orb, state
        self._known: dict[str, Operation] = {}
        self.add(self)

    def add(self, part: object) -> None:
        """Add the public methods of `part`. Raises ValueError for a name that another part has."""
        for name, _ in inspect.getmembers(type(part), inspect.isfunction):
            if not name.startswith("_") and name not in ("add", "call"):
                if name in self._known:
                    raise ValueError(f"two operations are called {name}")
                self._known[name] = getattr(part, name)

    def call(self, name: str, arguments: dict[str, Any]) -> Any:
        """The answer of an operation, as JSON types. Raises RoboCorbaError."""
        if name not in self._known:
            raise InvalidArguments(f"there is no operation {name[:80]!r}")
        operation = self._known[name]
        try:
            inspect.signature(operation).bind(**arguments)
        except TypeError as error:
            raise InvalidArguments(f"{name}: {error}") from None
        wanted = get_type_hints(operation)
        return operation(**{each: checked(each, value, wanted.get(each)) for each, value in arguments.items()})

    # ---- robots ----

    def stop_all(self) -> dict[str, str]:
        """Emergency stop of all robots, at the same time; robots that are not shown to stand, with the reason."""
        verdicts = stop_robots(self._orb, (), self._addresses())
        return {verdict.robot: verdict.text for verdict in verdicts if not verdict.stands and verdict.is_known}

    def stop(self, robot: str) -> None:
        """Emergency stop of a robot."""
        for verdict in stop_robots(self._orb, (robot,), self._addresses()):
            if not verdict.stands:
                raise NotReachable(verdict.text)

    def reset_all(self) -> dict[str, str]:
        """End the stop of all robots; robots that stay stopped, with the reason."""
        return {robot: problem for robot, problem in reset_robots(self._orb, (), self._addresses()) if problem}

    def _addresses(self) -> StopAddresses:
        return stop_addresses(self._state, self._orb.naming) if self._state else StopAddresses()

    def reset_stop(self, robot: str) -> None:
        """Let a stopped robot move again."""
        RemoteAgent(self._orb, robot, RESOLVE_TIMEOUT_S).reset_stop()
