"""Small maps of the ROS map_server for the tests."""

from __future__ import annotations

from pathlib import Path

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
