"""The robot: its units, its dynamics, and the thread that advances them in real time."""

from __future__ import annotations

import time

import numpy as np

from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.kinematics.smartpal import ARM_JOINTS, LUMBAR, Side
from robocorba.robot.smartpal_stand_in.arm import Arm
from robocorba.robot.smartpal_stand_in.axes import PositionUnit, StandInGripper
from robocorba.robot.smartpal_stand_in.dynamics import STEP_S, Dynamics
from robocorba.robot.smartpal_stand_in.faults import Faults
from robocorba.robot.smartpal_stand_in.mobility import Mobility
from robocorba.robot.smartpal_stand_in.unit import Unit, UnitPolicy


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
        self.lumbar = PositionUnit("Lumbar", self.dynamics, LUMBAR)
        units: list[Unit] = [self.mobility, self.lumbar, *self.arms.values(), *self.grippers.values()]
        self.units = {unit.name: unit for unit in units}
        for unit in units:
            unit.policy = policy
        self.faults = Faults(self.units)
        self._steps = 0
        #: The real time at which the next step is due [s].
        self._due: float | None = None

    def warm_up(self) -> None:
        """Compile the kinematics kernels, which is slow the first time on a machine."""
        for arm in self.arms.values():
            joints = np.zeros(ARM_JOINTS)
            arm.kinematics.joints_at(arm.kinematics.pose(joints), arm.kinematics.redundancy(joints), joints)

    def catch_up(self) -> None:
        """Make the steps that are due in real time since the first call. A lag of more than 0.1 s is dropped."""
        now = time.monotonic()
        due = now if self._due is None else max(self._due, now - 0.1)
        while due <= now:
            due = self._due = due + STEP_S
            self.step()

    def step(self) -> None:
        """Advance all units and the dynamics by STEP_S, and check the units in every fifth step."""
        state = self.dynamics.state
        for unit in self.units.values():
            unit.advance(state)
        if self._steps % 5 == 0:
            for unit in self.units.values():
                unit.check()
        self._steps += 1
        self.dynamics.step()
