"""The areas that a leader has reserved at the simulation server.

A leader requests them before it looks for helpers, and keeps them until its mission ends. So a mission that waits for
areas keeps no robot from others, and missions do not wait for each other in a circle. After a fault its robots and what
they carried still stand in its areas: it exchanges them for those of its next attempt, without giving them back."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.simulation import InvalidReservation
from robocorba.map_editor.polygons import FloorArea
from robocorba.robot.session import BuildingSession, once_back
from robocorba.simulation.reservations import Reservation
from robocorba.system.backoff import Backoff


class LeaderAreas:
    """The areas of the mission that a robot leads. All methods raise SimulationError, RobotLost."""

    def __init__(self, session: BuildingSession) -> None:
        self._session = session

    def request(self, alternatives: Sequence[Sequence[FloorArea]], hold_s: float) -> int:
        """Request one of several alternatives, in place of what is reserved, for a time after the grant [s]. Returns
        its index."""
        if self._session.reservation() is not None:
            for index, areas in enumerate(alternatives):
                if self._session.exchange_areas(areas, hold_s / 2):
                    return index
            self._session.release_areas()
        return self._session.reserve_one_of(alternatives, hold_s)

    def state(self) -> Reservation | None:
        """The state of the request; None without a request, or once its grant has expired."""
        return self._session.reservation()

    def take_over(self, former: str, is_gone: Callable[[], bool]) -> bool:
        """Take over what is kept of a leader that fell silent, as soon as it is gone. Returns whether there was
        something. is_gone: whether it is logged off.
        Raises NotReachable."""
        with contextlib.suppress(InvalidReservation):
            Backoff(0.1, 0.1).poll(is_gone, 5.0)  # s, within which the lease of its robot ends
            self._session.take_over_areas(former)
            return True
        return False

    def release(self) -> None:
        """Give all areas back, once the server answers."""
        with contextlib.suppress(RoboCorbaError):
            once_back(self._session.release_areas)
