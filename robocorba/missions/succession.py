"""Who leads a mission when its leader is gone: the members of its record, in turn."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.missions.member import DEFAULT_POLICY, MemberPolicy
from robocorba.missions.recorder import MissionRecords
from robocorba.simulation.mission_record import decoded
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


class Succession:
    """Lets a robot lead missions whose leaders have fallen silent, when it is its turn.

    leads: whether a robot answers that it leads a mission; False if it does not answer. May take seconds. can_lead:
    whether this robot can lead a mission now. lead: has it begin to lead a mission, by its cooperative icon, unless its
    term is not this one any more or its leader answers; raises RobotError."""

    def __init__(
        self,
        robot: str,
        records: MissionRecords,
        leads: Callable[[str, str], bool],
        can_lead: Callable[[str], bool],
        lead: Callable[[str, dict[str, Any], int], None],
        policy: MemberPolicy = DEFAULT_POLICY,
    ) -> None:
        self._robot, self._records, self._leads = robot, records, leads
        self._can_lead, self._lead, self._policy = can_lead, lead, policy
        self._lock = threading.Lock()
        self._waiting: dict[str, Background] = {}
        self._closing = threading.Event()

    def begin(self, mission: str, term: int) -> None:
        """The leader of `term` has fallen silent, and the robot has ended its part or holds an object. Does not
        block."""
        with self._lock:
            if self._closing.is_set() or mission in self._waiting:
                return
            # If it fails, the next robot takes its turn.
            thread = Background("succession", partial(self._run, mission, term), lambda reason: None)
            self._waiting[mission] = thread
            thread.start()

    def close(self) -> None:
        self._closing.set()
        with self._lock:
            threads = list(self._waiting.values())
        for thread in threads:
            thread.wait_for_end()

    def _run(self, mission: str, term: int) -> None:
        began = time.monotonic()
        try:
            while time.monotonic() - began < self._policy.succession_limit_s and not self._closing.is_set():
                try:
                    if self._is_over(mission, term, time.monotonic() - began):
                        return
                except NotReachable as error:
                    _log.info("mission %s: %s", mission, error)
                self._closing.wait(self._policy.record_interval_s)
            _log.info(
                "mission %s: this robot has not taken it over within %g s", mission, self._policy.succession_limit_s
            )
        finally:
            with self._lock:
                del self._waiting[mission]

    def _is_over(self, mission: str, term: int, waited_s: float) -> bool:
        """Lead the mission if it is this robot's turn. True if there is nothing more to do. Raises NotReachable."""
        try:
            content = decoded(self._records.mission(mission).document)
        except UnknownMission:
            return True
        if content is None or not content.is_running or content.term != term or content.icon is None:
            return True
        successors = content.successors()
        if self._robot not in successors:
            return True
        if waited_s < successors.index(self._robot) * self._policy.turn_s or not self._can_lead(mission):
            return False
        if self._leads(content.leader, mission):  # it has lost this robot only, or comes back
            return False
        _log.warning("mission %s: its leader %s is silent; %s takes it over", mission, content.leader, self._robot)
        try:
            self._lead(mission, content.icon, term)
        except RobotError as error:
            _log.warning("mission %s: %s can't lead it: %s", mission, self._robot, error)
            return False
        return True
