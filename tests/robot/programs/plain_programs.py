"""Programs as plain data, for hypothesis: valid ones, and those with one thing wrong that is known."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from hypothesis import assume
from hypothesis import strategies as st

from robocorba.robot.programs.program import MAX_NESTING, schema
from tests.robot.programs import json_schema

SCHEMA = schema()
#: The parameters of the icon of a tag.
PARAMETERS = {
    node["properties"]["icon"]["enum"][0]: list(node["properties"])
    for node in SCHEMA["$defs"].values()
    if "icon" in node.get("properties", {})
}
PROGRAMS: st.SearchStrategy[dict[str, Any]] = json_schema.values(SCHEMA, SCHEMA)
#: Values of which each is wrong for some parameters.
VALUES = (
    *(True, None, {}, "", "x", "x" * 201, "a\nb", "mbase_path ", [], [0.0] * 6, [9.0] * 7),
    *(1.5, -1e9, 1e9, math.nan, math.inf, -math.inf),
)


class Malformed(NamedTuple):
    """A program as JSON, and which parameter of which icon is wrong in it."""

    text: str
    icon: str
    parameter: str


def plain_icons(program: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every icon with its path."""
    return _inside("icons", program["icons"])


def _inside(at: str, icons: list[dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, icon in enumerate(icons):
        path = f"{at}[{number}]"
        yield path, icon
        for name in ("icons", "then", "otherwise"):
            if name in icon:
                yield from _inside(f"{path}.{name}", icon[name])


@st.composite
def malformed(draw: st.DrawFn) -> Malformed:
    """A valid program with one thing made wrong."""
    program = copy.deepcopy(draw(PROGRAMS))
    path, icon = draw(st.sampled_from(list(plain_icons(program))))
    name = draw(st.sampled_from([*PARAMETERS[icon["icon"]], "wings"]))
    fault = draw(st.sampled_from(["value"] * 6 + ["missing", "twice"]))
    if fault == "twice":
        icon["MARK"] = 0
        return Malformed(json.dumps(program).replace('"MARK": 0', '"icon": "wait"'), path, "icon")
    if name in ("icons", "then", "otherwise") and draw(st.booleans()):
        icon[name] = [{"icon": "wait", "seconds": 1.0}]
        for _ in range(MAX_NESTING):
            icon[name] = [{"icon": "repeat", "times": 2, "icons": icon[name]}]
        levels = MAX_NESTING - path.count("[")
        return Malformed(json.dumps(program), f"{path}.{name}[0]" + ".icons[0]" * (levels - 1), "icons")
    value = draw(st.sampled_from(VALUES))
    if fault == "missing":
        icon.pop(name, None)
    else:
        icon[name] = value
    is_no_json = fault == "value" and isinstance(value, float) and not math.isfinite(value)
    assume(is_no_json or json_schema.problems(SCHEMA, program))
    return Malformed(json.dumps(program), path, name)
