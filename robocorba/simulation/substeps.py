"""How finely a floor is stepped: so that no robot gets deep into an obstacle, whatever its size, speed and mass.

Chipmunk finds contacts after it has moved the bodies. A body may get as far into another one as it moves in a substep;
contacts then take away the velocity that leads further in, as well as their iterations can tell light bodies from heavy
ones."""

from __future__ import annotations

import math

import pymunk

#: Duration of a step [s].
STEP_S = 0.02
#: How far any body may get into an obstacle [m].
MAX_PENETRATION_M = 0.005
#: Chipmunk's default number of iterations.
ITERATIONS = 10


def max_penetration_m(radius_m: float) -> float:
    """How far a robot of this radius may get into an obstacle [m]."""
    return max(MAX_PENETRATION_M, 0.05 * radius_m)


def substeps_for(speed_m_s: float, reach_m: float) -> int:
    """The number of substeps of a floor by its fastest robot, and by the least distance that a body may move in a
    substep: 1 for a SmartPal, 40 for a robot of 10 m/s beside one with a radius of 5 cm."""
    return max(1, math.ceil(speed_m_s * STEP_S / reach_m - 1e-9))


class RobotMasses:
    """The masses of the robots on a floor. A robot that is much lighter than the heaviest one counts as a tenth of its
    mass, or iterations can't press a light one between a heavy one and a wall."""

    def __init__(self) -> None:
        #: Body, mass, and the mass that it counts as [kg].
        self._robots: dict[str, tuple[pymunk.Body, float, float]] = {}
        #: Iterations for the contacts of these robots.
        self.iterations = ITERATIONS

    def add(self, name: str, body: pymunk.Body, mass_kg: float) -> None:
        self._robots[name] = body, mass_kg, mass_kg

    def remove(self, name: str) -> None:
        self._robots.pop(name, None)

    def apply(self) -> list[str]:
        """Set the masses of the bodies, and the iterations; returns the robots whose mass has changed."""
        masses = [mass_kg for _, mass_kg, _ in self._robots.values()]
        least_kg = max(masses, default=0.0) / 10
        changed = []
        for name, (body, mass_kg, before_kg) in self._robots.items():
            counted_kg = max(mass_kg, least_kg)
            if counted_kg != before_kg:
                body.moment *= counted_kg / before_kg
                body.mass = counted_kg
                self._robots[name] = body, mass_kg, counted_kg
                changed.append(name)
        ratio = max(masses) / max(least_kg, min(masses)) if masses else 1.0
        self.iterations = max(ITERATIONS, math.ceil(8 * ratio))  # found by experiment
        return changed
