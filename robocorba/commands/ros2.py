"""robocorba ros2: robots, maps and scans as a node of ROS 2, and orders from there."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.bridges.ros2 import ros_node
from robocorba.commands.options import Naming, connected
from robocorba.commands.served_map import ServedMap, scanning, serve
from robocorba.commands.waiting import OUTAGE_LIMIT_S, StopSignal
from robocorba.console.corba.live_system import live_system
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.formats.floor_grid import DEFAULT_RESOLUTION_M
from robocorba.system.printing import echo

if TYPE_CHECKING:
    from robocorba.simulation.system_changes import SystemChanges


def ros2(
    robots: Annotated[str, typer.Option(metavar="A,B", help="Publish only these robots. Default: all.")] = "",
    domain: Annotated[
        int | None, typer.Option(metavar="N", min=0, max=232, help="ROS domain. Default: ROS_DOMAIN_ID, else 0.")
    ] = None,
    floor: Annotated[str, typer.Option(metavar="F", help="Floor to publish on /map. Default: the first.")] = "",
    resolution: Annotated[
        float, typer.Option(metavar="M", min=0.01, max=1.0, help="Cell size of maps [m].")
    ] = DEFAULT_RESOLUTION_M,
    scan_rate: Annotated[
        float, typer.Option(metavar="HZ", min=0.0, max=40.0, help="Laser scans per second of each robot; 0: none.")
    ] = 10.0,
    stamped: Annotated[bool, typer.Option("--stamped", help="Accept TwistStamped on cmd_vel, not Twist.")] = False,
    namespaced_tf: Annotated[
        bool, typer.Option("--namespaced-tf", help="Publish unprefixed frames on /ROBOT/tf, not prefixed ones on /tf.")
    ] = False,
    naming: Naming = None,
) -> None:
    """Publish the running system in ROS 2 and accept orders for robots, until Ctrl-C or SIGTERM.

    Needs rclpy and the standard messages of ROS 2 Jazzy or later in the same Python environment."""
    with connected("ros2", naming) as orb, contextlib.closing(ros_node(domain)) as node:
        from robocorba.bridges.ros2.frames import Frames
        from robocorba.bridges.ros2.node import RosTopics
        from robocorba.bridges.ros2.publisher import RosPublisher
        from robocorba.bridges.ros2.robot_interfaces import RobotInterfaces
        from robocorba.system.plain_names import names_in

        stop = StopSignal()
        system = live_system(orb, with_scans=scan_rate > 0.0)
        changes = system.begin(OUTAGE_LIMIT_S)
        served, frames = ServedMap(orb, changes), Frames(namespaced_tf)
        if floor and floor not in served.building.floors:
            raise UnknownFloor("map", floor, list(served.building.floors))
        publisher = RosPublisher(RosTopics(node), served.building, names_in(robots), floor, frames, resolution)
        publisher.publish(changes)
        with contextlib.ExitStack() as closing:
            closing.callback(system.close)
            interfaces = RobotInterfaces(orb, node, publisher, frames, stamped)
            closing.callback(interfaces.close)
            lasers = scanning(orb, system, lambda: publisher.places, scan_rate)
            if lasers:
                closing.callback(lasers.close)
            _, places = publisher.places
            interfaces.update(places)
            node.start()
            echo(f"ROS domain {node.domain}: {', '.join(sorted(places)) or 'no robots yet'}")

            def show(changes: SystemChanges) -> None:
                publisher.publish(changes)
                interfaces.update(publisher.places[1])

            serve(stop, system, served, lasers, show, publisher.set_building, interfaces.note)
