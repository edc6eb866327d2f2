"""What has changed in the running system since the last look, for recorders and viewers."""

from __future__ import annotations

from typing import NamedTuple

from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.mission_record import MissionState
from robocorba.simulation.robot_scans import RobotScan


class SystemChanges(NamedTuple):
    """Updates of all floors, also of those without changes, and new postures, scans and states of missions."""

    updates: list[FloorUpdate]
    postures: list[Posture]
    scans: list[RobotScan]
    missions: list[MissionState]
