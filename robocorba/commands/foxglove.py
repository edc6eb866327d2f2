"""robocorba foxglove: shows the running system in Foxglove."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.commands.options import Naming, State, administrator, connected, only_for
from robocorba.commands.served_map import ServedMap
from robocorba.commands.waiting import OUTAGE_LIMIT_S, RETRY_TIMEOUT_S, StopSignal
from robocorba.console.corba.live_system import LiveSystem, live_system
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import displays
from robocorba.simulation.corba.remote_administrator import RemoteAdministrator
from robocorba.simulation.corba.remote_simulation import simulation_server
from robocorba.system.extras import require_extra
from robocorba.system.printing import echo
from robocorba.system.repeating import Repeating

if TYPE_CHECKING:
    from robocorba.bridges.foxglove.live import LiveServer

#: Interval between looks at the system while somebody watches, and otherwise [s].
WATCHED_S, IDLE_S = 0.05, 0.5
#: Timeout of a call of the simulation server [s].
CALL_TIMEOUT_S = 2.0


def foxglove(
    context: typer.Context,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="PORT", min=0, max=65535, help="Port; 0: any free one.")] = 8765,
    scans: Annotated[bool, typer.Option("--scans/--no-scans", help="Show scans of robots' sensors.")] = True,
    steer: Annotated[
        bool, typer.Option("--steer", help="Let Foxglove pause and pace the simulation. Needs the state folder.")
    ] = False,
    state: State = None,
    naming: Naming = None,
) -> None:
    """Show the running system in Foxglove, until Ctrl-C or SIGTERM."""
    only_for("--steer", steer, context, "state")
    with connected("foxglove", naming, state=state) as orb:
        require_extra("foxglove", "frames for Foxglove")
        from robocorba.bridges.foxglove.live import LiveServer

        steering = administrator(orb, state) if steer else None
        system = live_system(orb, with_scans=scans)
        changes = system.begin(OUTAGE_LIMIT_S)
        time_s, served = max((update.time for update in changes.updates), default=0.0), ServedMap(orb, changes)
        stop = StopSignal()
        with (
            contextlib.closing(system),
            contextlib.closing(LiveServer(host, port, served.building, steer, time_s)) as server,
        ):
            server.publisher.publish(changes)
            echo(f"ws://{host}:{server.port}")
            SystemInFoxglove(orb, system, served, steering, scans).serve(server, stop)


class SystemInFoxglove:
    """Publishes the running system on a server. administrator: None if clients may not steer the simulation.
    with_scans: with the scans of sensors, while somebody watches."""

    def __init__(
        self,
        orb: Orb,
        system: LiveSystem,
        served: ServedMap,
        administrator: RemoteAdministrator | None,
        with_scans: bool,
    ) -> None:
        self._orb, self._system, self._served, self._administrator = orb, system, served, administrator
        self._with_scans = with_scans
        self._simulation = simulation_server(orb, RETRY_TIMEOUT_S, CALL_TIMEOUT_S)
        self._state_at_s = 0.0
        self._playback: tuple[bool, float] | None = None

    def serve(self, server: LiveServer, stop: StopSignal) -> None:
        """Until stopped; while the system does not answer, clients see why."""
        with contextlib.closing(Repeating("displays", lambda: self._ask_displays(server), 1.0).start()):
            self._follow(server, stop)

    def _follow(self, server: LiveServer, stop: StopSignal) -> None:
        problem, pause_s = "", 0.0
        while not stop.wait(pause_s):
            began = time.monotonic()
            try:
                self._look(server)
                found = ""
            except RoboCorbaError as error:
                found = str(error)
            if found != problem:
                problem = found
                server.report_problem(problem)
            interval_s = WATCHED_S if server.is_watched else IDLE_S
            # On a slow machine 10 ms are left for the system itself.
            pause_s = max(0.01, began + interval_s - time.monotonic())

    def _ask_displays(self, server: LiveServer) -> None:
        if server.is_watched:
            with contextlib.suppress(NotReachable):  # the last ones stay
                server.publisher.displays = displays(self._orb)

    def _look(self, server: LiveServer) -> None:
        self._system.with_scans = self._with_scans and server.is_watched
        changes = self._system.follow(RETRY_TIMEOUT_S)
        server.publisher.publish(changes)
        server.tick()
        if building := self._served.after(changes):
            server.publisher.set_building(building)
        if self._administrator:
            self._steer(server, self._administrator)

    def _steer(self, server: LiveServer, administrator: RemoteAdministrator) -> None:
        for request in server.requests():
            try:
                if request.is_paused:
                    administrator.pause()
                else:
                    if request.pace > 0.0:
                        administrator.set_pace(request.pace)
                    administrator.resume()
            finally:  # as it is, where that was refused
                self._report_playback(server, request.id)
        if time.monotonic() >= self._state_at_s:
            self._state_at_s = time.monotonic() + 0.5
            self._report_playback(server)

    def _report_playback(self, server: LiveServer, request: str = "") -> None:
        state = self._simulation.call(lambda simulation: simulation._get_state())
        playback = bool(state.paused), float(state.pace)
        if request or playback != self._playback:
            self._playback = playback
            server.report_playback(*playback, request)
