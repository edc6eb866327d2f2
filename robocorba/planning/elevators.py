"""How long an elevator takes: the one model behind every planned and simulated ride.

A robot that arrives at a landing does not know where the cabin is, so it is taken to
stand on any floor served with equal probability. From the call on:

    wait     the cabin travels to the landing (mean over the floors served), its doors open
    travel   doors close, the cabin travels, doors open

Driving in and out is part of the path, not of the ride.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from robocorba.maps.model import Building, Elevator

#: Of a cabin, up and down, to its speed and back to rest; that of passenger elevators, and maps don't tell it.
ACCELERATION_M_S2 = 1.0


class Ride(NamedTuple):
    """A ride between two floors: mean seconds from the call until the doors are open, seconds from
    standing in the cabin until they are open again, and the height between the floors in m."""

    wait: float
    travel: float
    climb: float


def ride(building: Building, elevator: Elevator, origin: str, destination: str) -> Ride:
    """The ride from one floor that the elevator serves to another."""
    height = {name: building.floors[name].floor.elevation for name in {*elevator.floors(), origin, destination}}
    to_landing = [travel_time(elevator, height[name] - height[origin]) for name in elevator.floors()]
    wait = sum(to_landing) / len(to_landing) + elevator.door_time
    climb = abs(height[destination] - height[origin])
    return Ride(wait, 2 * elevator.door_time + travel_time(elevator, climb), climb)


def travel_time(elevator: Elevator, climb: float) -> float:
    """Seconds from rest to rest over `climb` m, up or down: to its speed, where the way is long enough, and back."""
    way = abs(climb)
    ramp = elevator.speed**2 / ACCELERATION_M_S2  # both ramps together
    if way >= ramp:
        return way / elevator.speed + elevator.speed / ACCELERATION_M_S2
    return 2 * math.sqrt(way / ACCELERATION_M_S2)


def travelled(elevator: Elevator, climb: float, seconds: float) -> float:
    """How far up (or down, negative) a cabin is that started so long ago on its way over `climb` m."""
    way, total = abs(climb), travel_time(elevator, climb)
    if seconds >= total:
        return climb
    speed = min(elevator.speed, math.sqrt(way * ACCELERATION_M_S2))
    ramp_s = speed / ACCELERATION_M_S2
    if seconds < ramp_s:
        done = ACCELERATION_M_S2 * seconds**2 / 2
    elif seconds < total - ramp_s:
        done = speed * (seconds - ramp_s / 2)
    else:
        done = way - ACCELERATION_M_S2 * (total - seconds) ** 2 / 2
    return math.copysign(done, climb)
