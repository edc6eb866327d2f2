"""Cooperative plans, which the leader of a mission stores in its data pool for other robots to read."""

from __future__ import annotations

import threading
from typing import NamedTuple

import msgspec

from robocorba.errors.robots import InvalidPlan, StalePlan, UnknownPlan
from robocorba.map_editor.element_rules import name_violations

#: Maximum number of plans.
MAX_PLANS = 100
#: Maximum size of one plan's content [bytes].
MAX_CONTENT = 1024 * 1024
#: Maximum size of all contents [bytes], so that one CORBA message holds them.
MAX_CONTENTS = 32 * 1024 * 1024


class Plan(NamedTuple):
    """A plan, encoded as msgpack; each change increments `version`."""

    name: str
    version: int
    content: bytes


class Plans:
    """Plans by the names of their missions. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plans: dict[str, Plan] = {}

    def put(self, name: str, content: bytes, expected_version: int = 0) -> int:
        """Store a plan and return its new version.

        content: msgpack. expected_version: the version that this one replaces, 0 for a new plan. Raises InvalidPlan;
        StalePlan where the stored version differs."""
        for reason in name_violations("it", name):
            raise InvalidPlan("name", reason)
        if len(content) > MAX_CONTENT:
            raise InvalidPlan("content", f"has {len(content)} bytes, more than {MAX_CONTENT}")
        try:
            msgspec.msgpack.decode(content)
        except (ValueError, TypeError, RecursionError) as error:
            raise InvalidPlan("content", f"is not msgpack: {error}") from None
        with self._lock:
            stored = self._plans.get(name)
            current = stored.version if stored else 0
            if expected_version != current:
                raise StalePlan(name, expected_version, current)
            if stored is None and len(self._plans) >= MAX_PLANS:
                raise InvalidPlan("name", f"the data pool already holds {MAX_PLANS} plans; remove one")
            others = sum(len(plan.content) for plan in self._plans.values() if plan is not stored)
            if others + len(content) > MAX_CONTENTS:
                raise InvalidPlan("content", f"all plans together would exceed {MAX_CONTENTS} bytes")
            self._plans[name] = Plan(name, current + 1, bytes(content))
            return current + 1

    def get(self, name: str) -> Plan:
        """The plan of this name. Raises UnknownPlan."""
        with self._lock:
            if name not in self._plans:
                raise UnknownPlan(name)
            return self._plans[name]

    def all(self) -> list[Plan]:
        """All plans, sorted by name."""
        with self._lock:
            return sorted(self._plans.values())

    def remove(self, name: str) -> None:
        """Remove a plan. Raises UnknownPlan."""
        with self._lock:
            if self._plans.pop(name, None) is None:
                raise UnknownPlan(name)
