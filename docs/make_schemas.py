"""Write the JSON schemas of events and documents into docs/schemas, from the classes that read and write them:
python docs/make_schemas.py

Payloads of events are msgpack maps with the same members."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from robocorba.commands.event_types import event_types
from robocorba.missions.messages import KINDS
from robocorba.missions.subplan import VERSION, StoredPlan
from robocorba.robot.programs import program
from robocorba.simulation.mission_record import MissionContent

FOLDER = Path(__file__).resolve().parent / "schemas"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: The payload of each type of events that is a msgpack map.
EVENTS: dict[str, Any] = {
    re.sub(r"^simulation\..*", "simulation.*", type): payload
    for type, _, _, payload in event_types()
    if not isinstance(payload, str)
}
#: The documents that missions store in the Omni database, and the plans in data pools.
DOCUMENTS: dict[str, Any] = {"mission_record": MissionContent, "plan": StoredPlan}


def schemas() -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and content of each file."""
    payloads, definitions = msgspec.json.schema_components(EVENTS.values(), ref_template="#/$defs/{name}")
    for kind in KINDS.values():  # the version is not a member of the class
        message = definitions[kind.__name__]
        message["properties"] = {"version": {"const": VERSION}, **message["properties"]}
        message["required"] = ["version", *message["required"]]
    events = dict(zip(EVENTS, payloads, strict=True))
    yield "events", _schema("Payloads of events, by their type", {"properties": events}, definitions)
    for name, kind in DOCUMENTS.items():
        (schema,), definitions = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
        yield name, _schema(name.replace("_", " "), schema, definitions)
    yield "program", program.schema()


def _schema(title: str, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> dict[str, Any]:
    for definition in definitions.values():
        if "description" in definition:
            definition["description"] = " ".join(definition["description"].split())
    return {"$schema": DIALECT, "title": title, **schema, "$defs": definitions}


def text(schema: Mapping[str, Any]) -> str:
    """The content of a file."""
    return msgspec.json.format(msgspec.json.encode(schema), indent=2).decode() + "\n"


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, schema in schemas():
        (FOLDER / f"{name}.json").write_text(text(schema))
