"""Small maps of the ROS map_server for the tests."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

BLACK, GREY, WHITE = 0, 205, 254


def write_ros(folder: Path, cells: np.ndarray, name: str = "map", **settings: object) -> Path:
    """A map file with a picture; `cells` as grey values, 0.1 m each; settings that are None are left out."""
    Image.fromarray(cells.astype(np.uint8)).save(folder / f"{name}.png")
    said = {"image": f"{name}.png", "resolution": 0.1, "origin": [0.0, 0.0, 0.0], "negate": 0}
    said |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in {**said, **settings}.items() if value is not None}))
    return path


LIST: dict[str, Any] = {
    "ros_maps": 1,
    "name": "lab",
    "floors": [
        {"name": "L1", "level": 1, "elevation": 0.0, "map": "ground.yaml"},
        {"name": "L2", "level": 2, "elevation": 3.5, "height": 3.2, "map": "up/first.yaml"},
    ],
    "elevators": [
        {
            "name": "E1",
            "at": [9.0, 3.0],
            "size": [1.8, 1.8],
            "doors": [{"floor": "L1", "side": "left", "width": 1.2}, {"floor": "L2", "side": "left", "width": 1.2}],
        }
    ],
}


def written_list(folder: Path, **change: Any) -> Path:
    """A list of two floors of 8 m x 6 m; the elevator's shaft is black and unknown, the door closed."""
    cells = np.full((60, 120), GREY)
    cells[:, :80] = BLACK
    cells[1:-1, 1:-1][:, :78] = WHITE
    cells[18:42, 79:102] = BLACK
    cells[22:38, 82:98] = GREY
    (folder / "up").mkdir(exist_ok=True)
    write_ros(folder, cells, "ground")
    # The upper picture is larger: its origin says where it lies in the frame of the building.
    write_ros(folder / "up", np.pad(cells, 10, constant_values=GREY), "first", origin=[-1.0, -1.0, 0.0])
    path = folder / "lab.yaml"
    path.write_text(yaml.safe_dump({**copy.deepcopy(LIST), **change}, sort_keys=False))
    return path
