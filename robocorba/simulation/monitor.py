"""The monitor: renders a floor of the running simulation for the 2D simulator.

Drawing libraries are imported with the first picture, so that they do not delay a restart after a crash."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import InvalidPicture
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.floor_update import BodyKind, FloorView
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.system.extras import require_extra
from robocorba.system.lazy_property import lazy_property

if TYPE_CHECKING:
    from robocorba.simulation.picture import FloorPainter


class Monitor:
    """Renders the simulation of a building. Thread-safe."""

    def __init__(self, agent: ManagementAgent, building: Building) -> None:
        self._agent, self._building = agent, building

    @lazy_property
    def _painter(self) -> FloorPainter:
        from robocorba.simulation.picture import FloorPainter

        return FloorPainter(self._building)

    def forget_unused(self) -> None:
        """Drop what no picture has needed for a minute."""
        if "_painter" in vars(self):
            self._painter.forget_unused()

    def png(self, floor: str, width_px: int) -> bytes:
        """Render a floor in its current state. Raises UnknownFloor; InvalidPicture, also without the extra films."""
        try:
            require_extra("films", "pictures of the simulation")
        except ServiceError as error:
            raise InvalidPicture("server", str(error)) from None
        database = self._agent.database
        view = FloorView(floor)
        view.apply(database.floor(floor))
        # Scans of the last second of simulated time.
        scans = [scan for scan in database.last_scans(floor) if scan.time >= view.time - 1.0]
        robots = sum(body.kind is BodyKind.ROBOT for body in view.bodies.values())
        count = f"{robots} robot{'s' * (robots != 1)}"
        caption = f"{self._building.name} · {floor} · {view.time:.1f} s · {count}"
        return self._painter.png(view, scans, width_px, caption)
