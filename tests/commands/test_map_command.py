"""robocorba map: import, export, show and check, with what they print, write and refuse."""

from __future__ import annotations

import importlib
import runpy
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from robocorba.commands import command
from robocorba.commands import map as map_commands
from robocorba.console.map_files import downloads
from robocorba.map_editor import formats, native
from robocorba.map_editor.formats import read_map
from robocorba.map_editor.model import Building, ElementKind, Elevator, ElevatorDoor, Floor, PathEdge, PathNode
from robocorba.map_editor.samples import SAMPLES
from testkit.buildings import two_floors
from tests.map_editor.formats.rmf_files import small, written
from tests.map_editor.formats.ros_files import BLACK, GREY, WHITE, write_ros


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    native.save(two_floors(), "two.yaml")
    Path("small.building.yaml").write_bytes(written(small()))


def robocorba_map(*arguments: str) -> Result:
    return CliRunner().invoke(command(["map"]), ["map", *arguments])


def lines(result: Result) -> list[str]:
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


def refusal(*arguments: str) -> str:
    """The one line of a command that refuses."""
    result = robocorba_map(*arguments)
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)
    (line,) = result.output.splitlines()
    return line


def test_check_prints_a_summary_notes_and_warnings() -> None:
    there_and_back = two_floors().with_element("L1", PathEdge(name="out", a="lift1", b="east"))
    native.save(there_and_back, "sound.yaml")
    summary = "sound.yaml is valid: 2 floors, 1 walls, 5 nodes, 4 edges, 1 elevators"
    assert lines(robocorba_map("check", "sound.yaml")) == [summary]
    for sample in SAMPLES:
        (line,) = lines(robocorba_map("check", sample))
        assert line.startswith(f"{sample} is valid: ")
    odd = there_and_back.with_element("", Floor(name="roof", level=3, elevation=8.0))
    doors = (ElevatorDoor(floor="roof"),)
    native.save(odd.with_element("", Elevator(name="E2", at=(30.0, 0.0), size=(2.0, 2.0), doors=doors)), "odd.yaml")
    notes = lines(robocorba_map("check", "odd.yaml"))
    assert notes[0] == "note: elevator 'E2' serves only roof"
    assert notes[1].startswith("note: floor 'roof' has no nodes and edges")
    assert notes[2:] == [
        "warning: floors without an elevator to other floors (1): roof",
        "odd.yaml is valid, 1 warning: 3 floors, 1 walls, 5 nodes, 4 edges, 2 elevators",
    ]


def test_check_warns_of_blocked_edges_and_unreachable_nodes() -> None:
    door = two_floors().floors["L1"].geometrical.doors["d"]
    native.save(two_floors().with_element("L1", msgspec.structs.replace(door, locked=True)), "locked.yaml")
    blocked = "warning: blocked edges of L1 (1): west-east (locked door 'd' near 10, 5)"
    assert lines(robocorba_map("check", "locked.yaml")) == [
        blocked,
        "warning: nodes of L1 that are walled in for a robot of radius 0.40 m (1): west",
        "warning: nodes of L1 that can be left but not entered (1): east",
        "locked.yaml is valid, 3 warnings: 2 floors, 1 walls, 5 nodes, 3 edges, 1 elevators",
    ]
    assert lines(robocorba_map("import", "locked.yaml", "out.yaml"))[0] == blocked
    assert native.load("out.yaml") == native.load("locked.yaml")
    assert lines(robocorba_map("check", "two.yaml", "--radius", "0.7"))[-1].startswith("two.yaml is valid, 4 warnings")
    for radius in ("-1", "nan"):
        assert robocorba_map("check", "two.yaml", "--radius", radius).exit_code == 2


def test_wrong_files_are_named() -> None:
    text = "robocorba: 1\nname: x\nfloors:\n- name: L1\n  level: 1\n  elevation: 0\n  walls:\n"
    Path("wrong.yaml").write_text(text + "  - {name: w, from: [0, 0], to: [0, 0]}\n")
    for name, *more in (("check",), ("import", "out"), ("export", "out", "-f", "nav2"), ("show", "--picture", "out")):
        assert refusal(name, "wrong.yaml", *more) == (
            f"robocorba map {name}: wrong.yaml:8: floors[0].walls[0]: wall 'w' on L1: it has no length"
        )
        assert not Path("out").exists()
    Path("file.yaml").write_text("a: 1\n")
    assert refusal("check", "file.yaml").startswith("robocorba map check: file.yaml:1: neither a RoboCorba map")
    assert refusal("check", "nowhere.yaml") == "robocorba map check: nowhere.yaml: No such file or directory"


def test_imports_are_native_maps_of_one_or_several_floors() -> None:
    *losses, last = lines(robocorba_map("import", "small.building.yaml", "out.yaml"))
    imported = read_map("small.building.yaml")
    assert losses == [f"import: {loss}" for loss in imported.losses] != []
    assert last.startswith("wrote out.yaml: 2 floors, ")
    assert native.load("out.yaml") == imported.building
    lines(robocorba_map("export", "two.yaml", "out.yaml", "-f", "ros"))
    listed = [
        f"- {{name: {name}, elevation: {height}, map: out-{name}.yaml}}" for name, height in (("L1", 0), ("L2", 4))
    ]
    Path("list.yaml").write_text("ros_maps: 1\nname: two\nfloors:\n" + "\n".join(listed))
    *_, last = lines(robocorba_map("import", "list.yaml", "joined.yaml"))
    assert last.startswith("wrote joined.yaml: 2 floors, ")


def test_import_takes_what_unknown_cells_and_specks_of_ros_maps_are() -> None:
    cells = np.full((60, 60), GREY)
    cells[10:50, 10:50] = WHITE
    cells[30, 12], cells[30, 30], cells[10:50, 10] = BLACK, BLACK, BLACK
    write_ros(Path(), cells, resolution=0.05, free_thresh=0.25)
    printed = lines(robocorba_map("import", "map.yaml", "out.yaml"))
    assert [line for line in printed if "of grey 205" in line and "--unknown free" in line]
    assert [line for line in printed if "specks: 1 of at most 0.05 m beside walls" in line and "--specks keep" in line]
    assert len(native.load("out.yaml").floors["map"].geometrical.objects) == 2
    lines(robocorba_map("import", "map.yaml", "out.yaml", "--force", "--unknown", "free", "--specks", "keep"))
    assert len(native.load("out.yaml").floors["map"].geometrical.objects) == 3
    lines(robocorba_map("import", "map.yaml", "out.yaml", "--force", "--specks", "all"))
    assert len(native.load("out.yaml").floors["map"].geometrical.objects) == 1


def test_import_generates_topological_maps_and_edges_between_given_nodes() -> None:
    bare = two_floors().with_element("L1", PathNode(name="in corner", at=(0.2, 0.2)))
    for name in bare.floors["L1"].topological.edges:
        bare = bare.without(ElementKind.EDGE, "L1", name)
    native.save(bare, "bare.yaml")
    lines(robocorba_map("import", "bare.yaml", "as-it-is.yaml"))
    assert native.load("as-it-is.yaml") == bare
    assert refusal("import", "bare.yaml", "x.yaml", "--topology", "--radius", "40").endswith(
        "no free space for a robot of radius 40 m"
    )
    assert lines(robocorba_map("check", "bare.yaml"))[0] == (
        "note: floor 'L1' has no edges; `robocorba map import --topology` generates them"
    )
    printed = lines(robocorba_map("import", "bare.yaml", "drawn.yaml", "--topology"))
    drawn = native.load("drawn.yaml")
    nodes, edges = drawn.floors["L1"].topological.nodes, drawn.floors["L1"].topological.edges
    assert printed[:2] == [
        f"L1: added {len(nodes) - 4} nodes and {len(edges)} edges, connected 3 of 4 nodes; "
        "unreachable for a robot of radius 0.4 m: in corner",
        "L2: topological map kept, it has 1 edges",
    ]
    assert bare.floors["L1"].topological.nodes.items() <= nodes.items()
    assert {"west", "east", "lift1"} <= {name for edge in edges.values() for name in (edge.a, edge.b)}
    assert drawn.floors["L2"] == bare.floors["L2"]
    assert lines(robocorba_map("check", "drawn.yaml"))[-1].startswith("drawn.yaml is valid, 2 warnings: ")
    native.save(two_floors(), "roads.yaml")
    lines(robocorba_map("import", "roads.yaml", "same.yaml", "--topology"))
    assert native.load("same.yaml") == two_floors()


def test_export_writes_a_file_for_each_floor_where_a_format_holds_one() -> None:
    ros = ("export", "two.yaml", "out.yaml", "-f", "ros", "--image", "png", "--resolution", "0.1")
    printed = lines(robocorba_map(*ros)) + lines(robocorba_map("export", "two.yaml", "out.geojson", "-f", "nav2"))
    assert "export: doors became gaps in the walls: L1 d" in printed
    assert lines(robocorba_map("export", "two.yaml", "same.yaml", "-f", "native")) == ["wrote same.yaml"]
    assert native.load("same.yaml") == two_floors()
    files = [line.removeprefix("wrote ") for line in printed if line.startswith("wrote ")]
    assert files == [*("out-L1.yaml", "out-L1.png", "out-L2.yaml", "out-L2.png"), *("out-L1.geojson", "out-L2.geojson")]
    assert all(Path(name).is_file() for name in files)
    with Image.open("out-L1.png") as picture:
        assert picture.size[0] >= 200  # 20 m
    assert "No such file or directory" in refusal("export", "two.yaml", "no/folder/out.yaml", "-f", "openrmf")
    result = robocorba_map("export", "two.yaml", "out.yaml", "-f", "dxf")
    assert result.exit_code == 2 and "dxf" in result.output


def test_show_draws_all_floors_or_one() -> None:
    (line,) = lines(robocorba_map("show", "two.yaml", "--picture", "all.png", "--width", "400"))
    assert line.startswith("wrote all.png: 2 floors, ")
    lines(robocorba_map("show", "two.yaml", "--picture", "one.png", "--width", "400", "--floor", "L1"))
    with Image.open("all.png") as everything, Image.open("one.png") as one:
        assert everything.size[0] == one.size[0] == 400
        assert everything.size[1] > one.size[1]
    result = robocorba_map("show", "two.yaml", "--floor", "L9")
    assert result.exit_code == 2 and "there are L1, L2" in " ".join(result.output.split())


OTHER_FORMAT = """
from robocorba.map_editor.formats.map_format import MapFormat
from robocorba.map_editor.losses import Exported, Imported
from robocorba.map_editor.model import Building

FORMAT = MapFormat(
    name="other",
    title="Other maps (.txt)",
    files="one",
    mark="an other map (other:)",
    recognises=lambda data: "other" in data,
    read=lambda file, options: Imported(Building(file.data["other"]), "other"),
    suffix=".txt",
    write=lambda building, path, resolution_m, image: Exported({path: building.name.encode()}),
)
"""


def test_a_format_is_added_by_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Import, export, help, the console and the manual's table take it from its module."""
    manual = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "make_formats.py"))
    page = manual["PAGE"].read_text()
    assert manual["with_table"](page) == page
    folder = tmp_path / "formats"
    folder.mkdir()
    (folder / "other_map.py").write_text(OTHER_FORMAT)
    Path("in.yaml").write_text("other: house\n")
    name = f"{formats.__name__}.other_map"
    with monkeypatch.context() as added:
        added.setattr(formats, "__path__", [*formats.__path__, str(folder)])
        added.setenv("COLUMNS", "300")
        importlib.reload(map_commands)
        lines(robocorba_map("import", "in.yaml", "out.yaml"))
        assert native.load("out.yaml") == Building("house")
        lines(robocorba_map("export", "in.yaml", "out.txt", "-f", "other"))
        assert Path("out.txt").read_text() == "house"
        shown = "\n".join(lines(robocorba_map("export", "--help")))
        assert "an other map (other:)" in shown and "other: Other maps (.txt)" in shown
        assert {"name": "other", "title": "Other maps (.txt)", "cells": False} in downloads()
        assert "| `other` | yes | yes | one |" in manual["with_table"](page)
    del sys.modules[name]
    importlib.reload(map_commands)
    assert "Other maps" not in "\n".join(lines(robocorba_map("export", "--help")))
