"""The robot: its units on its dynamics, and the thread in which its time passes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import numpy as np

from robocorba.kinematics.smartpal import ARM_JOINTS, Side
from robocorba.smartpal.arm import Arm
from robocorba.smartpal.dynamics import STEP_S, Dynamics
from robocorba.smartpal.faults import Faults
from robocorba.smartpal.gripper import Gripper
from robocorba.smartpal.lumbar import Lumbar
from robocorba.smartpal.mobility import Mobility
from robocorba.smartpal.unit import Unit
from robocorba.smartpal.way import Place

#: The thread wakes so often, s. Time that it is behind by more is lost, s.
WAKE_S, MOST_BEHIND_S = 0.003, 0.1
#: Units look after themselves once in so many steps.
CHECK_EVERY = 5
_log = logging.getLogger(__name__)


class SmartPal:
    """start: where its odometry says that it stands at power-up, m and rad."""

    def __init__(self, seed: int = 0, start: Place = (0.0, 0.0, 0.0)) -> None:
        self.dynamics = Dynamics(seed)
        self.mobility = Mobility(self.dynamics, start)
        self.arms = {side: Arm(side, self.dynamics) for side in Side}
        self.grippers = {side: Gripper(side, self.dynamics, self.arms[side]) for side in Side}
        self.lumbar = Lumbar(self.dynamics)
        units: list[Unit] = [self.mobility, self.lumbar, *self.arms.values(), *self.grippers.values()]
        self.units = {unit.name: unit for unit in units}
        self.faults = Faults(self.units)
        self._steps = 0

    def warm_up(self) -> None:
        """Compile what kinematics needs, which takes a while the first time on a machine."""
        for arm in self.arms.values():
            standing = np.zeros(ARM_JOINTS)
            arm.kinematics.joints_at(arm.kinematics.place(standing), arm.kinematics.redundancy(standing), standing)

    def step(self) -> None:
        """Let STEP_S pass."""
        seen = self.dynamics.seen
        for unit in self.units.values():
            unit.advance(seen)
        if self._steps % CHECK_EVERY == 0:
            for unit in self.units.values():
                unit.check()
        self._steps += 1
        self.dynamics.step()


class RealTime:
    """Steps once for each STEP_S of real time, in a thread of its own, until it is closed."""

    def __init__(self, step: Callable[[], None]) -> None:
        self._step = step
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dynamics", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._closing.wait(WAKE_S):
            now = time.monotonic()
            due = max(due, now - MOST_BEHIND_S)
            try:
                while due <= now:
                    due += STEP_S
                    self._step()
            except Exception:  # one fault must not let all units hang
                _log.exception("a step of the dynamics failed")
