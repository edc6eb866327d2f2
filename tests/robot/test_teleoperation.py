"""Teleoperation: how long an order holds, and what ends it."""

from __future__ import annotations

import itertools
import math
from unittest.mock import MagicMock

import numpy as np
import pytest

from robocorba.errors.robots import IllegalOrder
from robocorba.robot.agent import ControlAgent
from robocorba.robot.agent_state import AgentCondition, ProgramResult
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, RobotState, Velocity
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.teleoperation import LINGER_S, Teleoperation
from tests.clock import Clock
from tests.robot.places import eventually

WAITING = ProgramBuilder("waiting").wait(60.0).program()


def state(velocity: Velocity = ZERO_VELOCITY) -> RobotState:
    return RobotState(0.0, 0.0, 0.0, 0.0, velocity, np.zeros(18), np.zeros(18))


def test_an_order_holds_until_it_expires_or_the_next_one_and_the_last_ends_once_the_base_stands() -> None:
    clock = Clock()
    motion = Teleoperation(MagicMock(), clock)
    wanted = []
    for velocity, passed_s in (((0.1, 0.0, 0.0), 0.4), ((0.0, 0.2, 0.3), 0.4), (None, 0.2)):
        assert velocity is None or motion.order(velocity, 0.5)
        clock.now += passed_s
        command = motion.command(state(), 0.0)
        assert command
        wanted.append(command.velocity)
    assert wanted == [(0.1, 0.0, 0.0), (0.0, 0.2, 0.3), ZERO_VELOCITY]
    clock.now += LINGER_S
    braking = motion.command(state((0.05, 0.0, 0.0)), 0.0)
    assert braking and braking.velocity == ZERO_VELOCITY
    assert motion.command(state(), 0.0) is None
    assert not motion.order((0.1, 0.0, 0.0), 0.5)


def test_the_robot_drives_while_orders_come(agent: ControlAgent) -> None:
    start = agent.state.at
    orders = itertools.count()

    def has_driven() -> bool:
        agent.drive((0.2, 0.0, 0.0), 2.0)
        next(orders)
        return agent.state.at.x > start.x + 0.1

    eventually(has_driven, "driven")
    assert next(orders) > 1
    during = agent.state
    assert (during.condition, during.program.name) == (AgentCondition.RUNNING, "teleoperation")
    agent.drive((0.0, 0.0, 0.0), 0.1)
    eventually(lambda: agent.state.condition is AgentCondition.IDLE, "ended")
    after = agent.state
    assert after.program.result is ProgramResult.DONE
    assert math.hypot(*after.actor.velocity) < 0.01


def test_what_ends_it_and_what_does_not_run_beside_it(agent: ControlAgent) -> None:
    turn = (0.0, 0.0, 0.1)
    agent.load(WAITING)
    agent.run()
    with pytest.raises(IllegalOrder, match="runs a program"):
        agent.drive(turn, 5.0)
    agent.abort()
    eventually(lambda: agent.state.condition is AgentCondition.IDLE, "aborted")
    agent.drive(turn, 5.0)
    with pytest.raises(IllegalOrder, match="runs a program"):
        agent.run()
    agent.abort()
    eventually(lambda: agent.state.condition is AgentCondition.IDLE, "aborted")
    assert agent.state.program.result is ProgramResult.ABORTED
    agent.stop()
    with pytest.raises(IllegalOrder, match="is stopped"):
        agent.drive(turn, 5.0)
    agent.reset_stop()
