"""A floor on which nothing moves is not stepped, and nobody can tell."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from robocorba.simulation import physics
from robocorba.simulation.physics import STILL_CHECK_STEPS, FloorPhysics, Limits

RADIUS_M = 0.4
WALLS = [shapely.LineString([(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0), (0.0, 0.0)])]


def floor_with(count: int) -> FloorPhysics:
    floor = FloorPhysics(WALLS, name="L1")
    for number in range(count):
        floor.add_robot(f"R{number}", (1.0 + number % 3 * 1.2, 1.0 + number // 3 * 1.2, 0.0), RADIUS_M, 127.0, Limits())
    floor.add_object("table", (6.0, 4.0, 0.2), shapely.box(-0.5, -0.3, 0.5, 0.3), 5.4)
    return floor


def run(floor: FloorPhysics, seed: int, steps: int) -> tuple[list[object], int]:
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
            floor.add_robot("R9", (7.0, 7.0, 1.0), RADIUS_M, 127.0, Limits())
        still += floor.is_still
        contacts, lost = floor.step()
        state = floor.snapshot
        seen.append((state.time, list(state.names), state.rows.tobytes(), list(contacts), list(lost)))
        contacts_begun += len(contacts)
    assert contacts_begun
    return seen, still


@pytest.mark.parametrize("seed", range(6))
def test_resting_changes_no_bit(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rested, still = run(floor_with(6), seed, 1200)
    monkeypatch.setattr(physics, "STILL_CHECK_STEPS", 10**9)
    stepped, never = run(floor_with(6), seed, 1200)
    assert rested == stepped
    assert never == 0
    assert still > 0


def test_a_floor_comes_to_rest_and_wakes_up() -> None:
    floor = floor_with(3)
    for _ in range(2 * STILL_CHECK_STEPS):
        floor.step()
    assert floor.is_still
    before = floor.snapshot
    floor.step()
    assert floor.snapshot.time > before.time
    assert floor.is_still
    floor.command("R0", 0.0, 0.0, 0.0)
    floor.step()
    assert floor.is_still
    floor.command("R0", 0.5, 0.0, 0.0)
    floor.step()
    assert not floor.is_still
    assert floor.row("R0")[3] > 0.0


def test_a_floor_with_a_grip_or_a_contact_is_not_still() -> None:
    floor = floor_with(1)
    floor.add_robot("near", (6.0, 4.9, 0.0), RADIUS_M, 127.0, Limits())
    floor.grip("near", "table", (6.0, 4.3), 200.0, 4.0)
    for _ in range(3 * STILL_CHECK_STEPS):
        floor.step()
    assert not floor.is_still
    floor.release("near")
    floor.add_robot("touching", (1.0, 1.0 + 2 * RADIUS_M - 0.0005, 0.0), RADIUS_M, 127.0, Limits())
    for _ in range(4 * STILL_CHECK_STEPS):
        floor.step()
    assert not floor.is_still
