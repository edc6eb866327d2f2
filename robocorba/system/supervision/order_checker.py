"""Whether a robot can be started as ordered."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from robocorba.errors.base import FieldError
from robocorba.errors.simulation import InvalidChoice
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.robot import model_switcher
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.registry import Description
from robocorba.system.names import CHANNELS
from robocorba.system.processes import RobotOrder


def checked(orb: Orb, order: RobotOrder, timeout_s: float = 2.0) -> RobotOrder:
    """The order, checked against the running system; a placed robot gets its floor by name. timeout_s: to ask for
    floors, and for channels [s]. Raises InvalidChoice, NotReachable."""
    check_order(order, model_switcher.installed())
    floors = RemoteDatabase(orb, timeout_s).floors() if order.floor or order.at else []
    return checked_places(order, floors, orb.names(CHANNELS, timeout_s) if order.channel else [])


def check_order(order: RobotOrder, adaptors: Collection[str]) -> None:
    """Check what needs no system. adaptors: those that are installed. Raises InvalidChoice."""
    try:
        Description(order.name, Pose(order.floor, *(order.at or (0.0, 0.0, 0.0))))
    except FieldError as error:
        raise InvalidChoice(error.field, error.reason) from None
    if order.adaptor not in adaptors:
        raise InvalidChoice("adaptor", f"{order.adaptor[:80]!r} is not installed; there are {', '.join(adaptors)}")
    arguments = order.adaptor_arguments
    if len(arguments) > 64 or sum(map(len, arguments)) > 4096:
        raise InvalidChoice("adaptorArguments", "more than 64 with 4096 characters in all")


def checked_places(order: RobotOrder, floors: Sequence[str], channels: Sequence[str]) -> RobotOrder:
    """The order with the name of its floor, if it has one. Raises InvalidChoice for an unknown floor or channel."""
    if order.floor and order.floor not in floors:
        raise InvalidChoice("onFloor", f"there is no floor {order.floor[:80]!r}; there are {_some(floors)}")
    if order.channel and order.channel not in channels:
        raise InvalidChoice("channel", f"there is no channel {order.channel[:80]!r}; there are {_some(channels)}")
    if order.at is None or order.floor:
        return order
    if not floors:
        raise InvalidChoice("onFloor", "the building has no floor")
    return replace(order, floor=floors[0])


def _some(names: Sequence[str]) -> str:
    return ", ".join(name[:60] for name in names[:10]) or "none"
