"""Every kind of picture of a ROS map against map_server's own rule, pixel by pixel; and regions of cells become few
simple polygons that cover them and exceed them by half a cell at most."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image

from robocorba.map_editor.formats.grid import FREE, OCCUPIED, UNKNOWN
from robocorba.map_editor.formats.ros_picture import MapServerSettings, read_cells, read_settings
from robocorba.map_editor.formats.solids import MAX_RING_POINTS, solids
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.yaml_file import read_yaml

#: Greys around all thresholds of the tests, and opacities.
SHADES, OPACITIES = (0, 51, 85, 128, 170, 190, 205, 206, 254, 255), (0, 128, 255)
_GREY = np.repeat(np.array(SHADES, np.uint8), len(OPACITIES)).reshape(5, -1)
_OPACITY = np.tile(np.array(OPACITIES, np.uint8), len(SHADES)).reshape(5, -1)
#: A pixel as map_server's library delivers it: red, green, blue and opacity from 0 to 1.
Pixel = tuple[float, float, float, float]


def _picture(kind: str) -> tuple[Image.Image, dict[str, Any]]:
    """A picture and how it is saved: with the opacity of `_pixels`, of single shades or of each pixel."""
    grey, opacity, inverse = (Image.fromarray(each) for each in (_GREY, _OPACITY, 255 - _GREY))
    if kind.startswith("P"):
        picture = Image.fromarray(np.arange(_GREY.size, dtype=np.uint8).reshape(_GREY.shape)).convert("P")
        picture.putpalette([value for shade in _GREY.flat for value in (shade, shade, 255 - shade)])
        return picture, {"transparency": bytes(_OPACITY.flatten())} if "opacity" in kind else {}
    mode, *transparent = kind.split(" with ")
    picture = {
        "1": grey.point(lambda value: 255 * (value > 128)).convert("1"),
        "L": grey,
        "LA": Image.merge("LA", (grey, opacity)),
        "RGB": Image.merge("RGB", (grey, grey, inverse)),
        "RGBA": Image.merge("RGBA", (grey, inverse, grey, opacity)),
        "I;16": Image.fromarray(_GREY.astype(np.uint16) * 257),
    }[mode]
    shade = {"L": 190, "RGB": (190, 190, 65), "I;16": 190 * 257}.get(mode)
    return picture, {"transparency": shade} if transparent else {}


def _pixels(kind: str) -> tuple[Callable[[int, int], Pixel], bool]:
    """The pixel at a row and column, and whether the file has opacities: known here without reading the file."""
    mode, *transparent = kind.split(" with ")
    grey, full = _GREY / 255, np.ones(_GREY.shape)
    bits = (_GREY > 128).astype(float)
    colours = {"1": (bits, bits, bits), "P": (grey, grey, 1 - grey), "RGB": (grey, grey, 1 - grey)}
    colours["RGBA"] = grey, 1 - grey, grey
    if mode in ("LA", "RGBA", "P") and (transparent or mode != "P"):
        opacity = _OPACITY / 255
    else:
        opacity = np.where(_GREY == 190, 0.0, 1.0) if transparent else full
    channels = (*colours.get(mode, (grey, grey, grey)), opacity)
    return lambda row, column: tuple(float(each[row, column]) for each in channels), opacity is not full  # type: ignore[return-value]


KINDS = ("1", "L", "L with a transparent grey", "LA", "P", "P with opacity", "RGB", "RGB with a transparent colour")
KINDS += ("RGBA", "I;16", "I;16 with a transparent grey")


def _map_server(pixel: Pixel, has_opacity: bool, settings: MapServerSettings) -> int:
    """nav2_map_server's loader: opacity counts as a fourth colour in mode trinary only, and only if the file has it."""
    colours = list(pixel[:3])
    if settings.mode == "trinary" and has_opacity:
        colours.append(pixel[3])
    shade = sum(colours) / len(colours)
    if settings.mode == "raw":
        percent = math.floor(shade * 255 + 0.5)
        if percent > 100:
            return UNKNOWN
        probability = percent / 100
    else:
        probability = shade if settings.negate else 1 - shade
    if settings.mode == "scale" and pixel[3] < 1:
        return UNKNOWN
    if settings.mode == "trinary" and not settings.negate and all(abs(c - 205 / 255) < 1e-9 for c in pixel[:3]):
        return UNKNOWN if probability <= settings.occupied_above else OCCUPIED  # our rule for map_saver's grey
    if probability > settings.occupied_above:
        return OCCUPIED
    return FREE if probability < settings.free_below else UNKNOWN


@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_picture_reads_as_map_server_reads_it(kind: str, mode: str, negate: int, tmp_path: Path) -> None:
    picture, options = _picture(kind)
    picture.save(tmp_path / "map.png", **options)
    path = tmp_path / "map.yaml"
    path.write_text(
        f"image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: {negate}\nmode: {mode}\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    root = Item(file := read_yaml(path), "$", file.data)
    settings = read_settings(root)
    found = read_cells(root, settings, False, False, Losses())
    pixel, has_opacity = _pixels(kind)
    rows, columns = _GREY.shape
    expected = [
        [_map_server(pixel(row, column), has_opacity, settings) for column in range(columns)] for row in range(rows)
    ]
    assert found.tolist() == expected


REGIONS = arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=11))


def _squares(region: np.ndarray) -> shapely.Geometry:
    """The cells of a region as squares."""
    row, column = np.nonzero(region)
    up = len(region) - 1 - row
    return shapely.union_all(shapely.box(column, up, column + 1, up + 1))


def _polygons(region: np.ndarray, max_points: int = MAX_RING_POINTS) -> list[shapely.Polygon]:
    return [shapely.Polygon(solid.points) for solid in solids(region, max_points)[0]]


@settings(max_examples=40, deadline=None)
@given(REGIONS, st.sampled_from([8, MAX_RING_POINTS, MAX_RING_POINTS]))
def test_any_region_is_covered_by_simple_polygons(region: np.ndarray, max_points: int) -> None:
    polygons, cells = _polygons(region, max_points), _squares(region)
    assert all(polygon.is_valid and polygon.area > 0 for polygon in polygons)
    assert all(len(polygon.exterior.coords) - 1 <= max_points for polygon in polygons)
    union = shapely.union_all(polygons)
    assert cells.difference(union).area < 1e-9
    assert union.difference(cells.buffer(0.5 + 1e-9)).area < 1e-9


def test_a_grid_of_rooms_is_a_few_combs_and_what_is_diagonal_is_straight() -> None:
    region = np.ones((81, 81), bool)
    for row in range(8):
        for column in range(8):
            region[row * 10 + 1 : row * 10 + 10, column * 10 + 1 : column * 10 + 10] = False
    polygons = _polygons(region)
    assert len(polygons) == 9
    assert shapely.union_all(polygons).equals(_squares(region))
    row, column = np.indices((40, 40))
    (staircase,) = _polygons((row > column) & (row < 38) & (column > 1))
    assert len(staircase.exterior.coords) <= 7
    (diagonal,) = _polygons(np.pad(np.eye(20, dtype=bool), 2))
    assert (diagonal.area, len(diagonal.exterior.coords)) == (pytest.approx(20 + 19), 7)


def test_a_diagonal_passage_of_one_cell_keeps_its_width() -> None:
    """A robot that fits through the cells fits between the polygons."""
    region = np.ones((16, 16), bool)
    for i in range(15):
        region[i, i] = region[i, i + 1] = False
    free = shapely.box(0, 0, 16, 16).difference(shapely.union_all(_polygons(region)))
    assert free.equals(_squares(~region))
