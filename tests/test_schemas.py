"""The JSON schemas in docs/schemas are those of the classes, and what is published is valid by them."""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.map_editor.spatial import floor_format
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate
from robocorba.missions import messages, subplan
from robocorba.simulation.corba.announcer import payload_of
from robocorba.simulation.mission_record import MissionContent, PhaseRecord
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.system import names
from tests.test_budget import modules

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

IDLE = subplan.SubPlan(
    "B", "helper", (subplan.Idle(), subplan.CallCabin(elevator="E", destination="2", party="m", size=2))
)
MEASURED = messages.MemberMeasurements(0.1, 0.001, [(1.0, 0.5)], 0.002)
MESSAGES: list[messages.Message] = [
    messages.Call(mission="m.1", leader="A", floor="L1", x=1.0, y=2.0, helpers=2),
    messages.Offer(mission="m.1", robot="B", leader="A", floor="L1", x=1.0, y=2.0),
    messages.Assignment(mission="m.1", leader="A", phases=("asking",), subplan=IDLE),
    messages.Answer(mission="m.1", robot="B", leader="A", accepts=False, reason="runs a program"),
    messages.MakeWay(mission="m.1", leader="A", robot="C", floor="L1", x=1.0, y=2.0),
    messages.WayMade(mission="m.1", robot="C", leader="A", is_done=True),
    messages.Order(mission="m.1", leader="A", step=1, received_states={"B": (1.0, 2.0)}),
    messages.MemberState(mission="m.1", robot="B", leader="A", measurements=MEASURED),
]


def test_the_schemas_are_those_of_the_classes() -> None:
    """Otherwise: python docs/make_schemas.py"""
    spec = importlib.util.spec_from_file_location("make_schemas", DOCS / "make_schemas.py")
    assert spec and spec.loader
    maker = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = maker
    spec.loader.exec_module(maker)
    found = {name: maker.text(content) for name, content in maker.schemas()}
    assert found == {file.stem: file.read_text() for file in (DOCS / "schemas").glob("*.json")}
    for name in found:
        jsonschema.Draft202012Validator.check_schema(schema(name))


def test_every_type_that_is_published_is_listed_with_the_members_of_its_schema() -> None:
    published = set(messages.KINDS)  # which type_of takes them from
    programs = [*(ROOT / "servers").glob("*.py"), ROOT / "clients" / "robot.py"]
    for tree in (*modules().values(), *(ast.parse(file.read_text()) for file in programs)):
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            name = getattr(call.func, "attr", getattr(call.func, "id", ""))
            if name == "SimulationEvent":
                published.add(f"simulation.{ast.literal_eval(call.args[2]).replace(' ', '_')}")
            elif re.match("_?(push|publish)", name):
                texts = [getattr(each, "value", vars(names).get(getattr(each, "id", ""))) for each in call.args]
                published |= {text for text in texts if isinstance(text, str) and "." in text}
    shown = CliRunner().invoke(command(["events"]), ["events", "types", "--json"]).output
    listed = {each["type"]: each["payload"] for each in msgspec.json.decode(shown)}
    assert listed.keys() == published
    assert listed.pop("typed.floor_changed") == "TypedFloorUpdate"
    events = schema("events")
    for type, found in listed.items():
        of_type = events["properties"][re.sub(r"simulation\..*", "simulation.*", type)]
        assert [*found] == [*events["$defs"][of_type["$ref"].rpartition("/")[2]]["properties"]]


def schema(name: str) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.json.decode((DOCS / "schemas" / f"{name}.json").read_bytes())
    return found


def check(type: str, payload: Any) -> None:
    """Raises jsonschema.ValidationError if it is not valid as the payload of such events."""
    events = schema("events")
    plain = msgspec.json.decode(msgspec.json.encode(payload))  # JSON has lists for tuples, and texts for bytes
    jsonschema.Draft202012Validator({"$defs": events["$defs"], **events["properties"][type]}).validate(plain)


@pytest.mark.parametrize("message", MESSAGES, ids=messages.type_of)
def test_messages_of_missions_are_valid(message: messages.Message) -> None:
    payload = messages.payload(message)
    check(messages.type_of(message), payload)
    for wrong in ({**payload, "version": 2}, {**payload, "mission": 7}, {}):
        with pytest.raises(jsonschema.ValidationError):
            check(messages.type_of(message), wrong)


def test_events_and_documents_are_valid() -> None:
    for event in (
        SimulationEvent(1.0, "L1", "collision", ("A", "table")),
        SimulationEvent(1.0, "L1", "boarding", ("A",), waited_s=3.0, longest_wait_s=20.0),
    ):
        check("simulation.*", payload_of(event))
    with pytest.raises(jsonschema.ValidationError):
        check("simulation.*", {"time": 1.0, "floor": "L1", "who": ["A"]})
    check("robot.stop", {"robots": ["A"], "reason": "fire"})
    came = [Body(1, BodyKind.OBJECT, "table", 0.7, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), 12.0)]
    elevators = {"E": ElevatorState(0.0, "L1", Doors.OPEN, 1.0, ("A",), ())}
    update = FloorUpdate("L1", WHOLE, 7, 1.5, 3, came, [2], np.zeros(1, MOTION), elevators)
    check("floor.changed", floor_format.as_map(update))
    plan = subplan.CooperativePlan("m.1", "move_table", "A", "table", ("asking", "riding"), (IDLE,))
    content = MissionContent(
        kind="move_table", about="table", leader="A", phases=(PhaseRecord("asking", 1.0),), begun=1.0, icon={}
    )
    for name, document in (
        ("mission_record", msgspec.json.decode(content.encode())),
        ("plan", msgspec.msgpack.decode(subplan.StoredPlan(plan, "riding").encode())),
    ):
        jsonschema.Draft202012Validator(schema(name)).validate(document)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.Draft202012Validator(schema(name)).validate({**document, "phase": 1, "kind": 1})
