"""What happens in the simulated building, as it is published."""

from __future__ import annotations

from typing import NamedTuple


class SimulationEvent(NamedTuple):
    """An event of the simulation; its fields are the published payload.

    kind: "collision", "grip lost", "boarding", "ride lost", "reservation over" or "placed". who: names of the robots
    and objects involved. waited_s, longest_wait_s: of a robot that may board, since its call, and the upper bound of
    that time when it called; None for other events."""

    time: float
    floor: str
    kind: str
    who: tuple[str, ...]
    reason: str = ""
    waited_s: float | None = None
    longest_wait_s: float | None = None
