"""A map file of any kind is recognised by what it holds, a hostile one is refused with a typed error, nothing else; and
route graphs for nav2_route."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.files import OutputError
from robocorba.errors.maps import MapFileError
from robocorba.map_editor import validation
from robocorba.map_editor.formats import read_map, write_map
from robocorba.map_editor.losses import MAX_NAMES_LISTED, Losses
from robocorba.map_editor.model import Floor
from tests.map_editor.formats.hostile import HOSTILE, changed, places
from tests.map_editor.formats.rmf_files import imported, small, written
from tests.map_editor.formats.ros_files import LIST, written_list


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"a: 1\n", 1),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 1),
        (b"levels: {L1: {}}\nname: [\n", 3),
        (b"levels:\n  L1: &a {vertices: []}\n  L2: *a\n", 3),
        (b"image: x.png\nresolution: much\norigin: [0, 0, 0]\n", 2),
    ],
)
def test_what_is_no_map_is_refused(content: bytes, line: int, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(MapFileError) as caught:
        read_map(path)
    assert (caught.value.file, caught.value.line) == (str(path), line)
    with pytest.raises(MapFileError, match=r"absent\.yaml"):
        read_map(tmp_path / "absent.yaml")


@settings(max_examples=120, deadline=None)
@given(st.data(), st.booleans(), st.sampled_from([*HOSTILE, "x" * 1_000_000]))
def test_a_hostile_value_anywhere(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, is_ros: bool, change: Any
) -> None:
    folder = tmp_path_factory.mktemp("hostile")
    path, whole = (written_list(folder), LIST) if is_ros else (folder / "b.yaml", small())
    path.write_bytes(written(changed(whole, data.draw(st.sampled_from(list(places(whole)))), change)))
    try:
        result = read_map(path)
    except MapFileError as error:
        assert error.file.startswith(str(folder))
        assert error.line >= 1
        assert len(str(error)) < 2_000
    else:
        assert validation.problems(result.building) == []
        assert all(len(loss) < 5_000 for loss in result.losses)


def test_equal_losses_become_one_sentence() -> None:
    losses = Losses()
    for i in range(MAX_NAMES_LISTED + 3):
        losses.add("things: {n} left out: {names}", f"t{i}")
    losses.add("things: {n} left out: {names}", "t0")
    losses.add("once")
    shown = ", ".join(["t0 (x2)", *(f"t{i}" for i in range(1, MAX_NAMES_LISTED))])
    assert losses.sentences() == (f"things: {MAX_NAMES_LISTED + 4} left out: {shown} and 3 more", "once")


def test_one_file_for_each_floor_with_nodes_and_directed_edges(tmp_path: Path) -> None:
    building = imported(small()).building.with_element("", Floor(name="G", level=7, elevation=70.0))
    exported = write_map(building, tmp_path / "route.geojson", "nav2")
    graphs = {path.name: json.loads(path.read_text()) for path in exported.files}
    assert "floors without edges have no route graph, no file is written: G" in exported.losses
    assert sorted(exported.files) == sorted(tmp_path.iterdir())
    assert list(graphs) == ["route-L1.geojson", "route-L2.geojson"]
    graph = graphs["route-L1.geojson"]
    assert graph["type"] == "FeatureCollection"
    points = [feature for feature in graph["features"] if feature["geometry"]["type"] == "Point"]
    lines = [feature for feature in graph["features"] if feature["geometry"]["type"] == "MultiLineString"]
    assert len(points) + len(lines) == len(graph["features"])
    id_of = {point["properties"]["metadata"]["name"]: point["properties"]["id"] for point in points}
    ways = [(line["properties"]["startid"], line["properties"]["endid"]) for line in lines]
    start, middle, cabin = (id_of[name] for name in ("start", "n9", "n10"))
    assert sorted(ways) == sorted([(start, middle), (middle, start), (middle, cabin)])
    for line in lines:
        (a, b), *rest = line["geometry"]["coordinates"]
        assert not rest
        assert line["properties"]["cost"] == pytest.approx(math.dist(a, b))
    first = lines[0]["properties"]
    assert first["metadata"] == {"name": "start-n9", "abs_speed_limit": 0.5, "graphs": ["tiny", "1"]}
    assert first["overridable"] is True
    features = [feature for graph in graphs.values() for feature in graph["features"]]
    ids = [feature["properties"]["id"] for feature in features]
    assert len(ids) == len(set(ids)) and all(isinstance(number, int) and number >= 0 for number in ids)
    about = [feature["properties"]["metadata"] for feature in features]
    assert [each["name"] for each in about if each.get("elevator") == "lift"] == ["n10", "n1"]
    assert any(loss.startswith("elevators:") and "lift (L1, L2)" in loss for loss in exported.losses)
    with pytest.raises(OutputError, match="nowhere"):
        write_map(building, tmp_path / "nowhere" / "x.yaml", "ros")
    with pytest.raises(MapFileError, match="'svg' can't be written"):
        write_map(building, tmp_path / "x.svg", "svg")
