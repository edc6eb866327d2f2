"""The types of events that RoboCorba publishes, from which docs/make_schemas.py makes the schemas of their payloads."""

from __future__ import annotations

from typing import Any, get_type_hints

import msgspec

from robocorba.map_editor.sightings import ObstaclesSeen
from robocorba.map_editor.spatial.floor_format import FloorUpdateMap
from robocorba.missions.messages import KINDS
from robocorba.simulation.emergency_stops import StopEvent
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.system.names import SIGHTING_EVENT, STOP_EVENT


def event_types() -> list[tuple[str, str, str, Any]]:
    """Of each type: its name, what its source names, when it is published, and its payload: a class whose fields are
    the members of a msgpack map, or the name of the IDL struct that is sent instead.

    Programs publish more by the icon `say`, and clients what they like."""
    of_missions = {
        "call": ("leader", "twice a second while it looks for helpers"),
        "offer": ("robot", "in reply to a call"),
        "proposal": ("leader", "twice a second until the robot answers"),
        "answer": ("robot", "in reply to a proposal"),
        "make_way": ("leader", "twice a second until the robot has stepped aside"),
        "way_made": ("robot", "in reply to make_way"),
        "order": ("leader", "ten times a second from the first step to the end"),
        "state": ("robot", "ten times a second while it takes part"),
    }
    of_simulation = {
        "collision": "when a robot or what it carries hits something",
        "grip_lost": "when a robot loses what it holds",
        "boarding": "when a robot may enter a cabin",
        "ride_lost": "when a ride ends early",
        "reservation_over": "when the limit of reserved areas is reached",
        "placed": "when a robot or object is put somewhere else",
    }
    happened = simulation_payload()
    stop = "at an emergency stop, by the command and the simulation server"
    return [
        *((type, *of_missions[type.removeprefix("mission.")], payload) for type, payload in KINDS.items()),
        *((f"simulation.{kind}", "simulation", when, happened) for kind, when in of_simulation.items()),
        ("floor.changed", "floor", "after changes of a floor, at most ten times a second", FloorUpdateMap),
        (STOP_EVENT, "simulation, or empty", stop, StopEvent),
        (SIGHTING_EVENT, "robot", "when what it sees changes, and every 2 s", ObstaclesSeen),
        ("typed.floor_changed", "floor", "as floor.changed, for 30 s after publishTypedChanges", "TypedFloorUpdate"),
    ]


def simulation_payload() -> type[msgspec.Struct]:
    """The fields of SimulationEvent, a named tuple, as those of a map, in which None is left out."""
    defaults = SimulationEvent._field_defaults
    fields: list[Any] = [
        (name, hint, defaults[name]) if name in defaults else (name, hint)
        for name, hint in get_type_hints(SimulationEvent).items()
    ]
    return msgspec.defstruct(SimulationEvent.__name__, fields, namespace={"__doc__": SimulationEvent.__doc__})


def members(payload: Any) -> dict[str, str]:
    """Name and type of each member of a payload; those of an IDL struct are in its IDL."""
    if isinstance(payload, str):
        return {}
    _, definitions = msgspec.json.schema_components([payload], ref_template="{name}")
    found = {name: _type(schema) for name, schema in definitions[payload.__name__]["properties"].items()}
    return {"version": "1", **found} if payload in KINDS.values() else found


def _type(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(map(_type, schema["anyOf"]))
    if "items" in schema:
        return f"array of {_type(schema['items'])}"
    return str(schema.get("$ref") or schema.get("type") or "any")
