"""A free robot's task to step aside for a mission of others."""

from __future__ import annotations

import time

from robocorba.errors.base import RoboCorbaError
from robocorba.missions.messages import MakeWay, WayMade
from robocorba.robot.agent_state import IconBegun, ProgramReport, ProgramResult
from robocorba.robot.execution_control import Aborted
from robocorba.robot.robot import Robot


class MakingWay:
    """A task of a control agent: drives to the place that the leader of a mission has asked for."""

    def __init__(self, request: MakeWay, robot: Robot) -> None:
        self.request, self._robot = request, robot
        self._began = time.monotonic()
        self.report = ProgramReport(f"way for mission {request.of}", icon="steps[0]", kind="stepping aside")

    def begun(self, first: int) -> list[IconBegun]:
        """Steps that have begun, from number `first`."""
        return [IconBegun(0, self.report.icon, "stepping aside", 0.0)][first:]

    def run(self) -> None:
        """Drive there. An error is in the report."""
        request = self.request
        result, reason = ProgramResult.DONE, ""
        try:
            self._robot.drive_path(request.floor, request.x, request.y, around_obstacles=True)
        except Aborted as error:
            result, reason = ProgramResult.ABORTED, str(error)
        except RoboCorbaError as error:
            result, reason = ProgramResult.FAILED, str(error)
        except Exception as error:
            result, reason = ProgramResult.FAILED, f"{type(error).__name__}: {error}"
            raise
        finally:
            seconds = time.monotonic() - self._began
            done = int(result is ProgramResult.DONE)
            self.report = self.report._replace(result=result, reason=reason, icons_done=done, seconds=seconds)

    def is_for(self, request: MakeWay) -> bool:
        """Whether a request is this one again."""
        own = self.request
        return (own.mission, own.floor, own.x, own.y) == (request.mission, request.floor, request.x, request.y)

    @property
    def is_running(self) -> bool:
        return self.report.result is ProgramResult.NO_RESULT

    @property
    def answer(self) -> WayMade:
        """How far it is."""
        request, report = self.request, self.report
        is_done = report.result is ProgramResult.DONE
        return WayMade(
            mission=request.mission, robot=request.robot, leader=request.leader, is_done=is_done, reason=report.reason
        )
