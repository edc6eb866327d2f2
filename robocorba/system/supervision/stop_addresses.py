"""Where the running system of a state folder stops robots, without its naming service."""

from __future__ import annotations

from pathlib import Path

from robocorba.errors.services import ServiceError
from robocorba.orb.guard import Guard
from robocorba.orb.orb import CONTEXT
from robocorba.robot.corba.emergency_stop import StopAddresses
from robocorba.simulation.emergency_stops import ALL, read_records
from robocorba.system.names import CHANNELS, STOPS
from robocorba.system.roles import Role
from robocorba.system.settings import Address, RoleNaming
from robocorba.system.state_folder import StateFolder
from robocorba.system.supervision.access import Access


def stop_addresses(state: Path, naming: Address) -> StopAddresses:
    """From the state folder, if the system that runs there has this naming service; else nothing is known."""
    try:
        record = StateFolder(state).read_record()
    except ServiceError:
        return StopAddresses()
    if record is None or record.naming != str(naming) or not record.is_alive:
        return StopAddresses()
    places = {
        name.removeprefix(f"{CONTEXT}/"): process.endpoint for process in record.processes for name in process.names
    }
    channels = {
        name.removeprefix(f"{CHANNELS}/"): place for name, place in places.items() if name.startswith(f"{CHANNELS}/")
    }
    try:
        guard = Guard(Access.read(state).key(Role.SERVER).encode()) if isinstance(naming, RoleNaming) else None
    except ServiceError:
        return StopAddresses()
    targets = {name: record for name, record in read_records(state / STOPS).items() if name != ALL}
    return StopAddresses(places.get("SimulationServer", ""), channels, targets, guard)
