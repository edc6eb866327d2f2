"""What pages ask the console to do: calls by name with JSON arguments, each translated to calls of CORBA objects."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, get_type_hints

from robocorba.console.arguments import InvalidArguments, checked
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent, order_all, robots

#: Timeout for finding a robot [s].
RESOLVE_TIMEOUT_S = 1.0
Operation = Callable[..., Any]


class Operations:
    """Operations by name: public methods of this class and of the parts that pages add."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
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
        """Emergency stop of all robots, at the same time; robots that did not confirm, with the reason."""
        answers = order_all(self._orb, robots(self._orb), RemoteAgent.stop)
        return {name: problem for name, problem in answers if problem}

    def stop(self, robot: str) -> None:
        """Emergency stop of a robot."""
        self._agent(robot).stop()

    def reset_stop(self, robot: str) -> None:
        """Let a stopped robot move again."""
        self._agent(robot).reset_stop()

    def _agent(self, robot: str) -> RemoteAgent:
        return RemoteAgent(self._orb, robot, RESOLVE_TIMEOUT_S)
