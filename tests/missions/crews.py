"""Three robots on one floor whose missions have short limits, and how tests lead them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest

from robocorba.collision_avoidance.policy import GivingWayPolicy
from robocorba.missions.attempt import OnProgress
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.member import MemberPolicy
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import Approach
from robocorba.spatial.pose import Pose
from tests.control.places import Place
from tests.missions.places import Crew, Given
from tests.waits import patient

ROBOTS = {"A": Pose("L1", 7.0, 2.0), "B": Pose("L1", 7.0, 4.0), "C": Pose("L1", 1.0, 8.0)}
FAR = Approach(x=9.0, y=2.0, heading=0.0)
#: Shorter than usual, as the tests wait for them.
LEADING = patient(
    LeaderPolicy(
        agreement_timeout_s=6.0,
        max_retry_pause_s=0.5,
        offer_timeout_s=1.0,
        surplus_offer_timeout_s=0.3,
        member_timeout_s=1.5,
        step_grace_s=1.0,
        end_timeout_s=12.0,
        max_recoveries=0,
    )
)
RECOVERING = replace(LEADING, max_recoveries=2, recovery_timeout_s=15.0)
#: The arms stay where they begin.
TAKING_PART = patient(
    MemberPolicy(leader_timeout_s=1.5, end_order_timeout_s=3.0, final_state_s=0.5, driving_posture="home")
)
GIVING_WAY = GivingWayPolicy(max_search_s=2.0, blocked_by_parked_s=0.2, blocked_by_later_s=1.0)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("place"))
    yield place
    place.close()


@pytest.fixture
def crew(place: Place) -> Iterator[Crew]:
    crew = Crew(place, ROBOTS, LEADING, TAKING_PART, GIVING_WAY)
    yield crew
    crew.bus.disconnected = set()
    crew.close()


def near(name: str, dx: float, limit_s: float = 30.0) -> Approach:
    at = ROBOTS[name]
    return Approach(x=at.x + dx, y=at.y, heading=0.0, limit_s=limit_s)


def leading(
    crew: Crew,
    *planners: Given,
    name: str = "A",
    policy: LeaderPolicy = LEADING,
    on_progress: OnProgress = lambda plan, phases, is_ending: None,
) -> tuple[threading.Thread, list[MissionReport]]:
    """A mission in a thread of its own. planners: of its attempts, in turn."""
    reports: list[MissionReport] = []
    leader, left = crew.leader(name, policy, on_progress), iter(planners)
    thread = threading.Thread(target=lambda: reports.append(leader.lead("test", lambda: next(left))))
    thread.start()
    return thread, reports


def free(crew: Crew) -> bool:
    return all(agent.is_free for agent in crew.agents.values())


@pytest.fixture
def patient_crew(place: Place) -> Iterator[Crew]:
    """Whose missions end after a minute of silence."""
    waiting = MemberPolicy(leader_timeout_s=60.0, driving_posture="home")
    crew = Crew(place, ROBOTS, replace(LEADING, member_timeout_s=60.0), waiting, GIVING_WAY)
    yield crew
    crew.bus.disconnected = set()
    crew.close()
