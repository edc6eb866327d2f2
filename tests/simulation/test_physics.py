"""Physics of one floor: limits, walls, pushing, carrying, reproducibility, rest."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymunk.batch
import pytest
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon, box

from robocorba.simulation import bodies, physics
from robocorba.simulation.physics import STEP_S, FloorPhysics, Limits
from robocorba.simulation.static_parts import MAX_CHANGES, static_parts

RADIUS_M = 0.4
TABLE = shapely.box(-0.5, -0.3, 0.5, 0.3)


def robot(
    floor: FloorPhysics, name: str, x: float, y: float, heading: float = 0.0, limits: Limits | None = None
) -> None:
    floor.add_robot(name, (x, y, heading), RADIUS_M, 127.0, limits or Limits())


def run(floor: FloorPhysics, seconds: float) -> list[tuple[str, str]]:
    return [contact for _ in range(round(seconds / STEP_S)) for contact in floor.step().contacts]


def test_a_robot_keeps_its_limits() -> None:
    floor = FloorPhysics()
    limits = Limits(0.8, 0.5, 1.0, 0.7)
    robot(floor, "A", 0.0, 0.0, limits=limits)
    floor.command("A", 3.0, 4.0, 9.0)
    before = np.zeros(3)
    for _ in range(150):
        floor.step()
        velocity = np.array(floor.state()["A"][3:])
        assert math.hypot(*(velocity - before)[:2]) <= 1.0 * STEP_S + 1e-9
        assert abs(velocity[2] - before[2]) <= 0.7 * STEP_S + 1e-9
        assert math.hypot(*velocity[:2]) <= 0.8 + 1e-9
        before = velocity
    assert before[2] == pytest.approx(0.5)
    assert math.hypot(*before[:2]) == pytest.approx(0.8, abs=0.02)


def test_the_other_robots_keep_their_commands_after_a_removal() -> None:
    floor = FloorPhysics()
    for number in range(5):
        robot(floor, f"R{number}", 0.0, 3.0 * number)
        floor.command(f"R{number}", 1.0, 0.0, 0.0)
        floor.command(f"R{number}", 0.1 * (number + 1), 0.0, 0.0)  # the last one before a step counts
        floor.step()
    run(floor, 1.0)
    floor.remove("R1")
    with pytest.raises(KeyError):
        floor.remove("R1")
    floor.command("R1", 1.0, 0.0, 0.0)  # too late, and not for its successor
    robot(floor, "R1", 5.0, 3.0)
    run(floor, 1.0)
    speeds = {name: row[3] for name, row in floor.state().items()}
    assert speeds == pytest.approx({"R0": 0.1, "R1": 0.0, "R2": 0.3, "R3": 0.4, "R4": 0.5}, abs=1e-9)
    with pytest.raises(KeyError):
        robot(floor, "R1", 0.0, 0.0)


def test_robots_that_have_left_leave_no_buffers(monkeypatch: pytest.MonkeyPatch) -> None:
    """pymunk never frees the arrays of a buffer."""
    made: list[object] = []

    class Buffer(pymunk.batch.Buffer):
        def __init__(self) -> None:
            super().__init__()
            made.append(self)

    monkeypatch.setattr(bodies, "Buffer", Buffer)
    floor = FloorPhysics()
    before = len(made)
    for _ in range(50):
        robot(floor, "R", 1.0, 1.0)
        floor.step()
        floor.remove("R")
        floor.step()
    assert len(made) == before


def test_an_edit_changes_only_the_obstacles_that_differ() -> None:
    walls = [LineString([(x, 0), (x, 1)]) for x in range(1000)]
    floor = FloorPhysics([*walls, box(0, 5, 1, 6)])
    edited = static_parts([*walls[1:], box(0, 5, 1, 6), LineString([(-9, 0), (-9, 1)])])
    changes = list(floor.changes_to(edited))
    assert [(len(removed), len(added)) for removed, added in changes] == [(1, 0), (0, 1)]
    for change in changes:
        floor.change_obstacles(change)
    assert list(floor.changes_to(edited)) == []
    assert floor.touching(0.0, 0.5, 0.1) is None
    large = FloorPhysics().changes_to(static_parts(walls[: 2 * MAX_CHANGES + 1]))
    assert [len(added) for _, added in large] == [MAX_CHANGES, MAX_CHANGES, 1]
    assert floor.touching(-9.0, 0.5, 0.1) == floor.touching(1.0, 0.5, 0.1) == floor.touching(0.5, 5.5, 0.1) == ""


def test_static_polygons_are_solid() -> None:
    corner = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)])
    floor = FloorPhysics([corner, Polygon(), MultiPolygon([box(9, 0, 12, 3), Point(10, 8).buffer(1)])])
    assert floor.touching(0.5, 3.0, 0.1) == floor.touching(10.5, 1.5, 0.1) == floor.touching(10, 8, 0.1) == ""
    assert floor.touching(2.5, 2.5, 1.4) is None
    robot(floor, "A", 2.5, 2.5)
    floor.command("A", -1.0, 0.0, 0.0)
    run(floor, 4.0)
    assert floor.state()["A"][:2] == pytest.approx((1.0 + RADIUS_M, 2.5), abs=0.01)


def carriers(force_n: float = 300.0, payload_kg: float = 4.0) -> FloorPhysics:
    """A table of 12 kg with a robot at three of its sides, each holding its edge."""
    floor = FloorPhysics()
    floor.add_object("T1", (0.0, 0.0, 0.0), TABLE, 12.0)
    for name, x, y, heading in (("A", 1.1, 0.0, math.pi), ("B", -1.1, 0.0, 0.0), ("C", 0.0, -0.9, math.pi / 2)):
        robot(floor, name, x, y, heading)
    for name, at in (("A", (0.5, 0.0)), ("B", (-0.5, 0.0)), ("C", (0.0, -0.3))):
        floor.grip(name, "T1", at, force_n, payload_kg)
    return floor


def drive(floor: FloorPhysics, vx: float, vy: float) -> None:
    """Command all three the same velocity [m/s] on the floor."""
    for name in "ABC":
        heading = floor.state()[name][2]
        ahead = vx * math.cos(heading) + vy * math.sin(heading)
        floor.command(name, ahead, -vx * math.sin(heading) + vy * math.cos(heading), 0.0)


def test_three_robots_carry_a_table_that_one_could_not() -> None:
    floor = carriers()
    for _ in range(250):
        drive(floor, 0.3, 0.2)
        step = floor.step()
        assert not step.lost
        assert not step.contacts  # carriers may overlap with what they hold
    state = floor.state()
    assert state["T1"][:2] == pytest.approx((1.45, 0.96), abs=0.06)
    assert state["T1"][2] == pytest.approx(0.0, abs=0.02)
    for name, hand in (("A", (0.5, 0.0)), ("B", (-0.5, 0.0)), ("C", (0.0, -0.3))):
        x, y, heading = state[name][:3]
        away = math.hypot(x - state["T1"][0] - hand[0], y - state["T1"][1] - hand[1])
        assert away == pytest.approx(0.6, abs=0.02), name
        assert heading == pytest.approx({"A": math.pi, "B": 0.0, "C": math.pi / 2}[name], abs=0.02)


def in_robot_frame(floor: FloorPhysics, robot: str, item: str) -> tuple[float, float, float]:
    state = floor.state()
    (x, y, heading), (ox, oy, turn) = state[robot][:3], state[item][:3]
    dx, dy = ox - x, oy - y
    cos, sin = math.cos(heading), math.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(turn - heading, math.tau)


@pytest.mark.parametrize(("mass_kg", "others", "is_firm"), [(2.0, "", True), (9.0, "", False), (2.0, "B", True)])
def test_a_robot_that_carries_an_object_alone_holds_its_heading(mass_kg: float, others: str, is_firm: bool) -> None:
    """Also once the other robot that held it has gone."""
    floor = FloorPhysics()
    floor.add_object("T1", (0.0, 0.0, 0.0), TABLE, mass_kg)
    for name, side in (("A", -1.0), ("B", 1.0))[: 1 + len(others)]:
        robot(floor, name, 1.1 * side, 0.0, 0.0 if side < 0.0 else math.pi)
        floor.grip(name, "T1", (0.5 * side, 0.0), 200.0, 4.0)
    run(floor, 0.5)
    for name in others:
        floor.remove(name)
    before = in_robot_frame(floor, "A", "T1")
    floor.command("A", 0.1, 0.2, 0.5)
    run(floor, 3.0)
    off = np.subtract(in_robot_frame(floor, "A", "T1"), before)
    assert (math.hypot(*off[:2]) < 0.002 and abs(off[2]) < 0.002) == is_firm


def test_a_grip_slips_if_its_force_is_too_small() -> None:
    floor = carriers(force_n=5.0)
    lost: set[str] = set()
    floor.command("A", -1.0, 0.0, 0.0)  # away from the others
    for _ in range(200):
        lost |= set(floor.step().lost)
    assert "A" in lost
    assert floor.held("A") is None
    for name in "AB":
        floor.release(name)
    floor.grip("B", "T1", (-0.5, 0.0), 300.0, 4.0)


def test_a_pushed_or_released_table_stops_and_what_is_held_can_be_removed() -> None:
    floor = carriers()
    for _ in range(100):
        drive(floor, 0.5, 0.0)
        floor.step()
    for name in "ABC":
        floor.release(name)
        floor.command(name, -0.5, 0.0, 0.0)
    before = floor.state()["T1"]
    run(floor, 1.0)
    after = floor.state()["T1"]
    assert math.dist(before[:2], after[:2]) < 0.05
    assert after[3:] == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    floor.command("A", 0.5, 0.0, 0.0)
    assert {"A", "T1"} in [set(contact) for contact in run(floor, 4.0)]
    assert math.dist(after[:2], floor.state()["T1"][:2]) > 0.2, "it is pushed"
    floor.command("A", -0.5, 0.0, 0.0)
    run(floor, 2.0)
    assert floor.state()["T1"][3] == pytest.approx(0.0, abs=1e-6)
    floor = carriers()
    floor.remove("A")
    run(floor, 0.5)
    floor.remove("T1")
    run(floor, 0.5)
    assert floor.held("B") is floor.held("C") is None
    for item in ("T1", "C"):
        with pytest.raises(KeyError):
            floor.grip("B", item, (0.0, 0.0), 300.0, 4.0)


# ---- the same in each run; and where nothing moves a floor is not stepped, without a difference ----


def floor_with(count: int) -> FloorPhysics:
    floor = FloorPhysics([shapely.box(0.0, 0.0, 8.0, 8.0).exterior], name="L1")
    for number in range(count):
        robot(floor, f"R{number}", 1.0 + number % 3 * 1.2, 1.0 + number // 3 * 1.2)
    floor.add_object("table", (6.0, 4.0, 0.2), TABLE, 5.4)
    return floor


def play(floor: FloorPhysics, seed: int, steps: int) -> tuple[list[object], int]:
    """What a floor shows while its robots drive, collide, push, stand, come and go, and for how many steps it rests."""
    chance = np.random.default_rng(seed)
    seen: list[object] = []
    still = contacts_begun = 0
    for step in range(steps):
        moment = step % 150
        if moment < 40 and step % 10 == 0:
            for number in range(6):
                ahead, left, turn = chance.uniform(-1.5, 1.5, 3).tolist()
                floor.command(f"R{number}", ahead, left, turn, 0.25)
        if moment in (90, 120):
            floor.command("R1", 0.0, -0.0, 0.0, 0.5)
        if step == 260:
            floor.close_door("door", shapely.LineString([(5.0, 0.0), (5.0, 2.0)]))
        if step == 410:
            floor.remove("R5")
            floor.open_door("door")
        if step == 560:
            robot(floor, "R9", 7.0, 7.0, 1.0)
        still += floor.is_still
        contacts, lost = floor.step()
        state = floor.snapshot
        seen.append((state.time, list(state.names), state.rows.tobytes(), list(contacts), list(lost)))
        contacts_begun += len(contacts)
    assert contacts_begun
    return seen, still


def trajectory(seed: int) -> str:
    """A hash of what a floor shows in 24 s."""
    return hashlib.sha256(repr(play(floor_with(6), seed, 1200)).encode()).hexdigest()


def test_the_same_commands_give_the_same_trajectory_bit_for_bit_in_any_process() -> None:
    here = trajectory(3)
    assert here == trajectory(3)
    assert here != trajectory(4)
    program = "from tests.simulation.test_physics import trajectory; print(trajectory(3))"
    there = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[2], capture_output=True, text=True
    )
    assert there.stdout.strip() == here


@pytest.mark.parametrize("seed", range(2))
def test_resting_changes_no_bit(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rested, still = play(floor_with(6), seed, 1200)
    monkeypatch.setattr(physics, "STILL_CHECK_STEPS", 10**9)
    stepped, never = play(floor_with(6), seed, 1200)
    assert rested == stepped
    assert never == 0
    assert still > 0
