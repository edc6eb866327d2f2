"""How long an elevator takes: the one model behind every planned and simulated ride.

A robot that arrives at a landing does not know where the cabin is, so it is taken to
stand on any floor served with equal probability. From the call on:

    wait     the cabin travels to the landing (mean over the floors served), its doors open
    travel   doors close, the cabin travels at its speed, doors open

Driving in and out is part of the path, not of the ride.
"""

from __future__ import annotations

from typing import NamedTuple

from robocorba.maps.model import Building, Elevator


class Ride(NamedTuple):
    """A ride between two floors: mean seconds from the call until the doors are open, seconds from
    standing in the cabin until they are open again, and the height between the floors in m."""

    wait: float
    travel: float
    climb: float


def ride(building: Building, elevator: Elevator, origin: str, destination: str) -> Ride:
    """The ride from one floor that the elevator serves to another."""
    height = {name: building.floors[name].floor.elevation for name in {*elevator.floors(), origin, destination}}
    to_landing = [abs(height[name] - height[origin]) for name in elevator.floors()]
    wait = sum(to_landing) / len(to_landing) / elevator.speed + elevator.door_time
    climb = abs(height[destination] - height[origin])
    return Ride(wait, 2 * elevator.door_time + climb / elevator.speed, climb)
