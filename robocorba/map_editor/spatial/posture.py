"""Postures of robots."""

from __future__ import annotations

from typing import NamedTuple


class Posture(NamedTuple):
    """Joint angles that a robot reported, in the order of its model [rad]. time: simulated [s]."""

    robot: str
    time: float
    joints: tuple[float, ...]
