"""robocorba openrtm: robots as RT components, for tools and components of OpenRTM."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Collection
from functools import partial
from typing import Annotated

import typer

from robocorba.commands.options import Naming, connected
from robocorba.commands.reporting import reporting
from robocorba.commands.rt_objects import RtComponent, RtObjects
from robocorba.commands.served_map import ServedMap, scanning, serve
from robocorba.commands.waiting import OUTAGE_LIMIT_S, StopSignal
from robocorba.console.corba.live_system import LiveSystem, live_system
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import ServiceError
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.corba.robot_orders import RobotOrders
from robocorba.simulation.sensing.continuous_scans import ContinuousScans
from robocorba.simulation.system_changes import SystemChanges
from robocorba.simulation.system_view import RobotPlace, SystemView
from robocorba.system.plain_names import PlainNames, names_in
from robocorba.system.printing import echo, line
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address, RoleNaming

#: Interval between looks at the states of robots of active components, and at connected ports [s].
STATES_S, PORTS_S = 0.5, 5.0
#: Listen on all addresses.
_EVERYWHERE = {"endPoint": "giop:tcp::"}


def openrtm(
    robots: Annotated[str, typer.Option(metavar="A,B", help="Offer only these robots. Default: all.")] = "",
    to: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Naming service of OpenRTM. Default: that of the system.")
    ] = "",
    scan_rate: Annotated[
        float, typer.Option(metavar="HZ", min=0.0, max=40.0, help="Laser scans per second of each robot; 0: none.")
    ] = 10.0,
    naming: Naming = None,
) -> None:
    """Offer each robot as an OpenRTM component, until Ctrl-C or SIGTERM: pose, floor and ranges out, velocity in."""
    with reporting("openrtm"):
        tools = Address.parse(to, "--to") if to else None
    with connected("openrtm", naming, None if tools is None or tools.is_loopback else _EVERYWHERE) as orb:
        if tools is None and isinstance(orb.naming, RoleNaming):
            raise ServiceError("a guarded naming service binds no components: give --to")
        system = live_system(orb, with_scans=scan_rate > 0.0)
        changes = system.begin(OUTAGE_LIMIT_S)
        served = ServedMap(orb, changes)
        stop = StopSignal()
        with contextlib.ExitStack() as closing:
            closing.callback(system.close)
            names = closing.enter_context(contextlib.closing(orb.names_elsewhere(tools or orb.naming)))
            components = RobotComponents(orb, RtObjects(orb, names), names_in(robots))
            closing.callback(components.close)
            shown = SystemInOpenRtm(system, served, components, scan_rate)
            lasers = scanning(orb, system, lambda: shown.places, scan_rate)
            if lasers:
                closing.callback(lasers.close)
            shown.show(changes)
            echo(f"{tools or orb.naming}: {', '.join(sorted(components.names)) or 'no robots yet'}")
            shown.serve(stop, lasers)


class RobotComponents:
    """The components of the robots that are there, until `close`. wanted: names of robots; None for all."""

    def __init__(self, orb: Orb, objects: RtObjects, wanted: Collection[str] | None) -> None:
        self._orb, self._objects, self._wanted = orb, objects, wanted
        self._instance_names = PlainNames()
        self._made: dict[str, tuple[RtComponent, AgentOrders]] = {}
        self._states = Repeating("states", self._check_states, STATES_S).start()
        self._ports = Repeating("ports", self._check_ports, PORTS_S).start()

    @property
    def names(self) -> list[str]:
        """Names under which components are bound."""
        return [f"{made.component.name}.rtc" for made, _ in self._made.values()]

    def wants(self, robot: str) -> bool:
        return self._wanted is None or robot in self._wanted

    def show(self, places: dict[str, RobotPlace]) -> None:
        """Robots by name; components come and go with them."""
        for robot in self._made.keys() - places.keys():
            self._remove(robot)
        now_s = time.monotonic()
        for robot, place in places.items():
            if robot not in self._made:
                orders = AgentOrders(self._orb, robot)
                made = self._objects.make(self._instance_names[robot], robot, orders)
                self._made = {**self._made, robot: (made, orders)}  # for the other thread
            self._made[robot][0].component.show(now_s, place.time_s, place)

    def show_scans(self, changes: SystemChanges, rate_hz: float) -> None:
        for scan in changes.scans:
            if found := self._made.get(scan.robot):
                found[0].component.show_scan(scan, rate_hz)

    def close(self) -> None:
        self._states.close()
        self._ports.close()
        for robot in list(self._made):
            self._remove(robot)

    def _remove(self, robot: str) -> None:
        made, orders = self._made[robot]
        self._made = {name: each for name, each in self._made.items() if name != robot}
        self._objects.remove(made)
        orders.close()

    def _check_states(self) -> None:
        for made, orders in self._made.values():
            life_cycle = made.component.life_cycle
            if life_cycle.is_active and (problem := orders.problem()):
                _warn(f"{made.component.name}: {problem}")
                life_cycle.fail(problem)

    def _check_ports(self) -> None:
        for made, _ in self._made.values():
            made.component.disconnect_lost()


class AgentOrders:
    """Orders of a component to its robot's control agent (robocorba.bridges.openrtm.robot_component.Orders)."""

    def __init__(self, orb: Orb, robot: str) -> None:
        self._orders = RobotOrders(robot, partial(RemoteAgent, orb, robot, 1.0), _warn)
        self.drive, self.close = self._orders.drive, self._orders.close

    def reset_stop(self) -> None:
        if self._orders.order(RemoteAgent.state).condition is AgentCondition.STOPPED:
            self._orders.order(RemoteAgent.reset_stop)

    def problem(self) -> str:
        """Why the robot can't be driven by velocities; empty if it can, or is busy with a program."""
        try:
            state = self._orders.order(RemoteAgent.state)
        except RoboCorbaError as error:
            return str(error)
        return f"emergency stop: {state.reason}" if state.condition is AgentCondition.STOPPED else ""


class SystemInOpenRtm:
    """Shows the running system in components. places: a simulated time [s], and robots by name; replaced, not changed,
    since another thread reads it."""

    def __init__(self, system: LiveSystem, served: ServedMap, components: RobotComponents, scan_rate_hz: float) -> None:
        self._system, self._served, self._components = system, served, components
        self._scan_rate_hz = scan_rate_hz
        self._view = SystemView(served.building)
        self.places: tuple[float, dict[str, RobotPlace]] = (0.0, {})

    def serve(self, stop: StopSignal, lasers: ContinuousScans | None) -> None:
        """Until stopped; warns while the system does not answer."""

        def set_building(building: Building) -> None:
            self._view.building = building

        serve(stop, self._system, self._served, lasers, self.show, set_building, _warn)

    def show(self, changes: SystemChanges) -> None:
        """Raises UpdateMismatch."""
        before_s = self._view.time_s
        self._view.apply(changes.updates)
        places = {place.name: place for place in self._view.robots() if self._components.wants(place.name)}
        self.places = self._view.time_s, places
        if self._view.time_s != before_s:
            self._components.show(places)
        self._components.show_scans(changes, self._scan_rate_hz)


def _warn(problem: str) -> None:
    """Say that there is a problem; without a text that it has ended."""
    line(f"robocorba openrtm: {problem or 'the system answers again'}", err=True)
