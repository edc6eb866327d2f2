"""Small Open-RMF files for the tests."""

from __future__ import annotations

from typing import Any

import yaml

from robocorba.map_editor.formats import Imported, openrmf
from robocorba.map_editor.formats.map_format import ReadOptions
from robocorba.map_editor.yaml_file import parse_yaml


def small() -> dict[str, Any]:
    """A level of 10 m x 5 m at 0.05 m a pixel with two rooms and a lift; another one above, drawn at half the size.

    The upper drawing is turned by 90 degrees as well."""
    return {
        "name": "small",
        "coordinate_system": "reference_image",
        "graphs": {0: {"name": "tiny"}},
        "levels": {
            "L1": {
                "elevation": 0,
                "drawing": {"filename": "L1.png"},
                "fiducials": [[0, 0, "nw"], [200, 0, "ne"], [0, 100, "sw"]],
                "vertices": [
                    *([x, y, 0, ""] for x, y in ((0, 0), (200, 0), (200, 100), (0, 100))),
                    *([100, y, 0, ""] for y in (0, 40, 60, 100)),
                    [50, 50, 0, "start", {"is_charger": [4, True]}],
                    [150, 50, 0, ""],
                    [180, 50, 0, "", {"lift_cabin": [1, "lift"]}],
                ],
                "walls": [[0, 1, {"texture_height": [3, 3.5]}], [1, 2, {}], [2, 3, {}], [3, 0, {}], [4, 5, {}], [6, 7]],
                "doors": [[5, 6, {"name": [1, "door"], "type": [1, "double_sliding"]}]],
                "lanes": [
                    [8, 9, {"bidirectional": [4, True], "graph_idx": [2, 0], "speed_limit": [3, 0.5]}],
                    [8, 9, {"bidirectional": [4, True], "graph_idx": [2, 1], "speed_limit": [3, 0.5]}],
                    [9, 10, {"bidirectional": [4, False], "graph_idx": [2, 0]}],
                ],
                "measurements": [[0, 1, {"distance": [3, 10.0]}], [0, 3, {"distance": [3, 5.0]}]],
                "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}],
                "models": [{"model_name": "Chair", "name": "c", "x": 1, "y": 1, "yaw": 0, "z": 0, "static": True}] * 3,
            },
            "L2": {
                "elevation": 4,
                # A point (x, y) of L1's drawing is (50 - y / 2, x / 2) here.
                "fiducials": [[50, 0, "nw"], [50, 100, "ne"], [0, 0, "sw"], [7, 7, "other"]],
                "vertices": [[25, 75, 0, ""], [25, 90, 0, "", {"lift_cabin": [1, "lift"]}]],
                "lanes": [[0, 1, {"bidirectional": [4, True]}]],
            },
        },
        "lifts": {
            "lift": {
                "x": 180,
                "y": 50,
                "yaw": 0,
                "width": 1.6,
                "depth": 1.4,
                "reference_floor_name": "L1",
                "lowest_floor": "L1",
                "highest_floor": "L2",
                "doors": {"west": {"x": -0.85, "y": 0.1, "width": 1.0, "motion_axis_orientation": 1.5708}},
                "level_doors": {"L1": ["west"], "L2": ["west"]},
            }
        },
    }


class _Plain(yaml.CSafeDumper):
    """Writes shared parts out each time: map files have no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def written(data: Any) -> bytes:
    """Data as a YAML file."""
    return yaml.dump(data, Dumper=_Plain, sort_keys=False).encode()


def imported(data: Any) -> Imported:
    """What the importer makes of data, written as YAML first."""
    return openrmf.read(parse_yaml(written(data), "test.building.yaml"), ReadOptions())
