"""Orders to a robot from other systems: goals, and the program that runs after one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.control.agent_state import AgentCondition, AgentState, ProgramReport
from robocorba.corba.remote.robot_orders import GOAL, RobotOrders
from robocorba.errors.robots import IllegalOrder
from robocorba.motion.robot_state import RobotState
from robocorba.programs import program
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.spatial.pose import Pose
from robocorba.testing.processes import eventually

PATIENCE_S = 30.0
ROUND, OTHER = (program.dumps(ProgramBuilder(name).mbase_path("L1", 1.0, 2.0).program()) for name in ("round", "other"))


class Agent:
    """A robot's agent; drives end at once."""

    def __init__(self) -> None:
        self.loaded = ""
        #: Names of the programs that have run.
        self.ran: list[str] = []

    def state(self) -> AgentState:
        here = Pose("L1", 0.0, 0.0, 0.0)
        return AgentState("A", "simulated", AgentCondition.IDLE, "", here, RobotState(), 1.0, 0.0, ProgramReport())

    def program(self) -> str:
        return self.loaded

    def load(self, json: str) -> None:
        self.loaded = json

    def run(self) -> None:
        if not self.loaded:
            raise IllegalOrder("run", "has no program")
        self.ran.append(program.loads(self.loaded).name)


@pytest.fixture
def agent() -> Agent:
    return Agent()


@pytest.fixture
def orders(agent: Agent) -> Iterator[RobotOrders]:
    orders = RobotOrders("A", lambda: agent, lambda why: None)  # type: ignore[arg-type,return-value]
    yield orders
    orders.close()


def drive(orders: RobotOrders, agent: Agent) -> None:
    count = len(agent.ran)
    orders.drive_to(Pose("L1", 3.0, 4.0, 0.0))
    eventually(lambda: agent.ran[count:] == [GOAL], PATIENCE_S)


def test_after_a_goal_the_loaded_program_runs_not_the_goal_again(orders: RobotOrders, agent: Agent) -> None:
    orders.load(ROUND)
    drive(orders, agent)
    orders.run()
    orders.run()
    drive(orders, agent)
    drive(orders, agent)
    orders.run()
    assert agent.ran == [GOAL, "round", "round", GOAL, GOAL, "round"]


def test_a_program_that_was_loaded_elsewhere_counts_too(orders: RobotOrders, agent: Agent) -> None:
    orders.load(ROUND)
    agent.loaded = OTHER  # by the console
    drive(orders, agent)
    orders.run()
    agent.loaded = ROUND
    orders.run()
    assert agent.ran == [GOAL, "other", "round"]


def test_a_goal_alone_is_no_program(orders: RobotOrders, agent: Agent) -> None:
    drive(orders, agent)
    with pytest.raises(IllegalOrder, match="has loaded none, only driven to a goal"):
        orders.run()
    assert agent.ran == [GOAL]


def test_without_any_program_the_agent_says_so(orders: RobotOrders) -> None:
    with pytest.raises(IllegalOrder, match="has no program"):
        orders.run()
