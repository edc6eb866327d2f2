"""Cooperative plans, which the leader of a mission keeps in its data pool for other robots to read."""

from __future__ import annotations

import threading
from typing import NamedTuple

import msgspec

from robocorba.errors.robots import InvalidPlan, StalePlan, UnknownPlan

MAX_PLANS, MAX_NAME, MAX_CONTENT = 100, 200, 1024 * 1024
#: All contents together, so that they fit into one message.
MAX_CONTENTS = 32 * 1024 * 1024


class Plan(NamedTuple):
    """A plan, in msgpack; `version` rises by one with each change."""

    name: str
    version: int
    content: bytes


class Plans:
    """By the name of their mission. Safe from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plans: dict[str, Plan] = {}

    def put(self, name: str, content: bytes, expected_version: int = 0) -> int:
        """Keep a plan instead of the version that its writer knows, 0 for a new plan; its new version.

        content: msgpack. Raises InvalidPlan, StalePlan."""
        if not 0 < len(name) <= MAX_NAME:
            raise InvalidPlan("name", f"has {len(name)} characters, not 1 to {MAX_NAME}")
        if not name.isprintable():  # a NUL, or half a character, could not be told to anybody
            raise InvalidPlan("name", f"{name!r} can't be printed")
        _check_content(content)
        with self._lock:
            known = self._plans.get(name)
            current = known.version if known else 0
            if expected_version != current:
                raise StalePlan(name, expected_version, current)
            if known is None and len(self._plans) >= MAX_PLANS:
                raise InvalidPlan("name", f"there are {MAX_PLANS} plans already; remove one")
            others = sum(len(plan.content) for plan in self._plans.values() if plan is not known)
            if others + len(content) > MAX_CONTENTS:
                raise InvalidPlan("content", f"all plans together would be more than {MAX_CONTENTS} bytes")
            self._plans[name] = Plan(name, current + 1, bytes(content))
            return current + 1

    def get(self, name: str) -> Plan:
        """Raises UnknownPlan."""
        with self._lock:
            if name not in self._plans:
                raise UnknownPlan(name)
            return self._plans[name]

    def all(self) -> list[Plan]:
        """By name."""
        with self._lock:
            return sorted(self._plans.values())

    def remove(self, name: str) -> None:
        """Raises UnknownPlan."""
        with self._lock:
            if self._plans.pop(name, None) is None:
                raise UnknownPlan(name)


def _check_content(content: bytes) -> None:
    if len(content) > MAX_CONTENT:
        raise InvalidPlan("content", f"has {len(content)} bytes, more than {MAX_CONTENT}")
    try:
        msgspec.msgpack.decode(content)
    except (ValueError, TypeError, RecursionError) as wrong:
        raise InvalidPlan("content", f"is not msgpack: {wrong}") from None
