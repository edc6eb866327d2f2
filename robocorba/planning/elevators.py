"""The model of elevator times for every planned and simulated ride.

A planned ride does not know where the cabin is: the cabin is on any floor served with equal probability. From the call
on:

    wait     the cabin travels to the landing (mean over the floors served), its doors open
    travel   doors close, the cabin travels, doors open

Driving into and out of the cabin is part of the path, not of the ride.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from robocorba.map_editor.model import Building, Elevator

#: Acceleration and deceleration of a cabin [m/s^2]: typical of passenger elevators, as maps do not contain it.
ACCELERATION_M_S2 = 1.0


class RideEstimate(NamedTuple):
    """A ride between two floors: mean seconds from the call until the doors are open, seconds from boarding until
    they are open again, and the height between the floors [m]."""

    wait: float
    travel: float
    climb: float


def ride(building: Building, elevator: Elevator, origin: str, destination: str) -> RideEstimate:
    """The ride between two floors that the elevator serves."""
    height = {name: building.floors[name].floor.elevation for name in {*elevator.floors(), origin, destination}}
    to_landing = [travel_time(elevator, height[name] - height[origin]) for name in elevator.floors()]
    wait = sum(to_landing) / len(to_landing) + elevator.door_time
    climb = abs(height[destination] - height[origin])
    return RideEstimate(wait, 2 * elevator.door_time + travel_time(elevator, climb), climb)


def travel_time(elevator: Elevator, climb: float) -> float:
    """Seconds from rest to rest over `climb` [m], up or down, with ACCELERATION_M_S2 up to the elevator's speed."""
    distance_m = abs(climb)
    ramp = elevator.speed**2 / ACCELERATION_M_S2  # acceleration and deceleration together
    if distance_m >= ramp:
        return distance_m / elevator.speed + elevator.speed / ACCELERATION_M_S2
    return 2 * math.sqrt(distance_m / ACCELERATION_M_S2)


def travelled(elevator: Elevator, climb: float, seconds: float) -> float:
    """Height [m], negative downwards, that a cabin has covered `seconds` after it started to travel over `climb`
    [m]."""
    distance_m, total = abs(climb), travel_time(elevator, climb)
    if seconds >= total:
        return climb
    speed = min(elevator.speed, math.sqrt(distance_m * ACCELERATION_M_S2))
    ramp_s = speed / ACCELERATION_M_S2
    if seconds < ramp_s:
        done = ACCELERATION_M_S2 * seconds**2 / 2
    elif seconds < total - ramp_s:
        done = speed * (seconds - ramp_s / 2)
    else:
        done = distance_m - ACCELERATION_M_S2 * (total - seconds) ** 2 / 2
    return math.copysign(done, climb)
