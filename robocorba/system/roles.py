"""Who may call which operation in a guarded system (`robocorba up --guarded`).

The only place that knows: `robocorba.orb.guard` asks it once for each object and role. An operation that is not
listed is for servers only; a test checks that all operations of the IDL are listed.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum


class Role(IntEnum):
    """In the order of the IDL's enumerators."""

    OBSERVER = 0
    ROBOT = 1
    OPERATOR = 2
    ADMINISTRATOR = 3
    SERVER = 4


Roles = frozenset[Role]

EVERYBODY: Roles = frozenset(Role)
#: Robots, and administrators, who may do all that users may do.
ROBOTS: Roles = frozenset({Role.ROBOT, Role.ADMINISTRATOR, Role.SERVER})
OPERATORS: Roles = frozenset({Role.OPERATOR, Role.ADMINISTRATOR, Role.SERVER})
#: All but observers: those who publish events.
PUBLISHERS: Roles = ROBOTS | OPERATORS
SERVERS: Roles = frozenset({Role.SERVER})

#: Interfaces of objects without a name. Their reference is the right to call all of their operations, and the operation
#: that returns it, such as registerRobot or openSession, decides who may have it.
BY_REFERENCE = frozenset(
    {
        *("DataPool", "EditSession", "Transaction", "RobotSession", "SimulationAdministrator", "Supervisor"),
        *("CallbackRoute", "EventConsumer", "EventGateway", "GatewayFeed", "IdempotentEventConsumer", "NameRegistry"),
        *("PeerFeed", "PeerGateway"),
        *("EventProxyPullSupplier", "EventProxyPushConsumer", "EventProxyPushSupplier"),
        *("RobotSensors", "SensorRegistration", "StopTarget"),
        *("SmartPalFaults",),  # of the stand-in, in the robot's own naming service
    }
)


def _rules(*rules: tuple[Roles, str]) -> dict[str, Roles]:
    return {operation: roles for roles, operations in rules for operation in operations.split()}


#: For each interface of objects with a name, the roles that may call each operation.
RULES: Mapping[str, Mapping[str, Roles]] = {
    "PathPlanner": _rules((EVERYBODY, "_get_release _get_mapVersion getPath findPaths defaultRequest")),
    "MapEditor": _rules(
        (EVERYBODY, "_get_release _get_buildingName _get_currentVersion floors elements read changesSince editsSince"),
        (EVERYBODY, "readElements readChanges readFacts proposals"),
        (EVERYBODY, "check checkFloor exportMap getUnderlay"),
        (PUBLISHERS, "propose"),
        (
            OPERATORS,
            "create change setFact remove rename undo redo begin openSession importMap setUnderlay buildTopologicalMap",
        ),
        (OPERATORS, "rejectProposal"),
    ),
    "OmniDatabase": _rules(
        (EVERYBODY, "_get_release floors getFloor floorChanges typedFloorChanges publishTypedChanges lastScans"),
        (EVERYBODY, "scansSince postures reservations elevators missions mission"),
        (ROBOTS, "putMission"),
        (OPERATORS, "removeMission"),
    ),
    "SimulationServer": _rules(
        (EVERYBODY, "_get_release _get_state _get_stopOfAll clients sensors renderFloor"),
        (ROBOTS, "registerRobot"),
        (OPERATORS, "stopRobots stopStates endStopOfAll"),
        (SERVERS, "registerSensor reportSensor reportScans"),
    ),
    "VirtualSensor": _rules(
        (EVERYBODY, "_get_release _get_load scan scanMany laser proximity"), (SERVERS, "forRobot dismiss")
    ),
    "MissionControl": _rules(
        (EVERYBODY, "_get_release missionsSince mission leaders report"), (OPERATORS, "start abort")
    ),
    "RobotAgent": _rules(
        (EVERYBODY, "_get_release _get_name _get_state _get_program _get_channel _get_pool _get_path _get_mission"),
        (EVERYBODY, "_get_display _get_question _get_linkPoses _get_sensors iconsFrom adaptors reports"),
        (OPERATORS, "checkProgram loadProgram run pause resume step answer abort stop resetStop drive"),
        (OPERATORS, "fingerprint upload"),
        (OPERATORS, "startMission leadMission abortMission switchAdaptor setSpeedCap"),
    ),
    "RobotAdaptor": _rules((EVERYBODY, "read"), (ROBOTS, "start stop write")),
    "SensingAdaptor": _rules((EVERYBODY, "read rangeSensors ranges readings"), (ROBOTS, "start stop write")),
    "EventChannel": _rules(
        (EVERYBODY, "_get_release _get_name state traffic subscribe for_consumers routeBack"),
        (PUBLISHERS, "supply for_suppliers"),
        (OPERATORS, "unsubscribe"),
        # The address of a peer may contain the key of another guarded system.
        (frozenset({Role.ADMINISTRATOR, Role.SERVER}), "peers addPeer removePeer destroy"),
        (SERVERS, "joinGateway joinPeer"),
    ),
}

#: Operations whose first argument is the name of something that lasts and that others may have made, such as a durable
#: subscription, which a second subscriber takes over: the roles that may give one.
NAMED: Mapping[tuple[str, str], Roles] = {("EventChannel", "subscribe"): OPERATORS}


def may_call(role: Role, interface: str, operation: str) -> bool:
    """Whether a role may call an operation of a named object. interface: without module, such as MapEditor."""
    return role in RULES.get(interface, {}).get(operation, SERVERS)


def may_name(role: Role, interface: str, operation: str) -> bool:
    """Whether the first argument of an operation may be other than empty."""
    return role in NAMED.get((interface, operation), EVERYBODY)
