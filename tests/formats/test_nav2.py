"""Route graphs for nav2_route: features, ids and ways as its loader reads them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from robocorba.errors.files import OutputError
from robocorba.errors.maps import MapFileError
from robocorba.maps.formats import write_map
from robocorba.maps.model import Building, Floor, FloorMap
from tests.formats.rmf_files import imported, small


def _graphs(tmp_path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    exported = write_map(imported(small()).building, tmp_path / "route.geojson", "nav2")
    return {path.name: json.loads(path.read_text()) for path in exported.files}, exported.losses


def test_one_file_for_each_floor_with_nodes_and_directed_edges(tmp_path: Path) -> None:
    graphs, _ = _graphs(tmp_path)
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


def test_ids_are_unique_over_nodes_edges_and_floors(tmp_path: Path) -> None:
    graphs, _ = _graphs(tmp_path)
    ids = [feature["properties"]["id"] for graph in graphs.values() for feature in graph["features"]]
    assert len(ids) == len(set(ids))
    assert all(isinstance(number, int) and number >= 0 for number in ids)


def test_elevators_are_metadata_of_nodes_and_a_loss(tmp_path: Path) -> None:
    graphs, losses = _graphs(tmp_path)
    cabins = [
        feature["properties"]["metadata"]["name"]
        for graph in graphs.values()
        for feature in graph["features"]
        if feature["properties"]["metadata"].get("elevator") == "lift"
    ]
    assert cabins == ["n10", "n1"]
    assert any(loss.startswith("elevators:") and "lift (L1, L2)" in loss for loss in losses)


def test_a_floor_without_edges_has_no_file(tmp_path: Path) -> None:
    building = Building("b", {"G": FloorMap(Floor(name="G", level=0, elevation=0.0))})
    exported = write_map(building, tmp_path / "g.geojson", "nav2")
    assert exported.files == {}
    assert exported.losses == ("floors without edges have no route graph, no file is written: G",)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", ["native", "openrmf", "ros", "nav2"])
def test_a_folder_that_is_not_there_is_named(format: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        write_map(imported(small()).building, tmp_path / "nowhere" / "x.yaml", format)


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="'svg' can't be written"):
        write_map(imported(small()).building, tmp_path / "x.svg", "svg")
