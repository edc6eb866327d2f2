"""The robot: its units, its dynamics, and the thread that advances them in real time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import numpy as np

from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.kinematics.smartpal import ARM_JOINTS, Side
from robocorba.robot.smartpal_stand_in.arm import Arm
from robocorba.robot.smartpal_stand_in.dynamics import STEP_S, Dynamics
from robocorba.robot.smartpal_stand_in.faults import Faults
from robocorba.robot.smartpal_stand_in.gripper import StandInGripper
from robocorba.robot.smartpal_stand_in.lumbar import StandInLumbar
from robocorba.robot.smartpal_stand_in.mobility import Mobility
from robocorba.robot.smartpal_stand_in.unit import Unit, UnitPolicy
from robocorba.system.background import Background, end_process

#: Interval at which the dynamics thread wakes [s].
WAKE_INTERVAL_S = 0.003
#: Lag behind real time that the thread makes up for; any lag beyond it is dropped [s].
MAX_LAG_S = 0.1
#: Steps between the checks of the units.
CHECK_EVERY = 5
_log = logging.getLogger(__name__)


class SmartPal:
    """All units and their dynamics. seed: of the encoders' noise. start: the pose that the odometry reports at power-up
    [m, rad]."""

    def __init__(
        self,
        seed: int = 0,
        start: Frame = (0.0, 0.0, 0.0),
        policy: UnitPolicy = UnitPolicy(),  # noqa: B008
    ) -> None:
        self.dynamics = Dynamics(seed)
        self.mobility = Mobility(self.dynamics, start)
        self.arms = {side: Arm(side, self.dynamics) for side in Side}
        self.grippers = {side: StandInGripper(side, self.dynamics, self.arms[side]) for side in Side}
        self.lumbar = StandInLumbar(self.dynamics)
        units: list[Unit] = [self.mobility, self.lumbar, *self.arms.values(), *self.grippers.values()]
        self.units = {unit.name: unit for unit in units}
        for unit in units:
            unit.policy = policy
        self.faults = Faults(self.units)
        self._steps = 0

    def warm_up(self) -> None:
        """Compile the kinematics kernels, which is slow the first time on a machine."""
        for arm in self.arms.values():
            joints = np.zeros(ARM_JOINTS)
            arm.kinematics.joints_at(arm.kinematics.pose(joints), arm.kinematics.redundancy(joints), joints)

    def step(self) -> None:
        """Advance all units and the dynamics by STEP_S."""
        state = self.dynamics.state
        for unit in self.units.values():
            unit.advance(state)
        if self._steps % CHECK_EVERY == 0:
            for unit in self.units.values():
                unit.check()
        self._steps += 1
        self.dynamics.step()


class RealTime:
    """Calls `step` once per STEP_S of real time, in its own thread, until it is closed."""

    def __init__(self, step: Callable[[], None]) -> None:
        self._step = step
        self._closing = threading.Event()
        self._thread = Background("dynamics", self._run, end_process)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closing.set()
        self._thread.wait_for_end()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._closing.wait(WAKE_INTERVAL_S):
            now = time.monotonic()
            due = max(due, now - MAX_LAG_S)
            try:
                while due <= now:
                    due += STEP_S
                    self._step()
            except Exception:  # keep the units running after a failed step
                _log.exception("a step of the dynamics failed")
