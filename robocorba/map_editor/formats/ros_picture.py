"""Reads a map_server file and its picture: each cell is free, occupied or unknown."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from robocorba.map_editor.element_rules import MAX_NUMBER
from robocorba.map_editor.formats.grid import FREE, MAX_CELLS, OCCUPIED, UNKNOWN
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.geometry import to_floor_frame
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.pictures import open_picture
from robocorba.map_editor.spatial.pose import XY

#: Default thresholds: those of ROS 1, for which a grey of 205 is neither free nor occupied.
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
#: Grey of unknown cells that map_saver writes in mode trinary. Its occupancy probability, 0.1961, is below
#: the free_thresh of 0.25 that nav2's map_saver writes with it.
UNKNOWN_SHADE = 205
#: Maximum size of a picture's file [bytes]: 8 for each of MAX_CELLS, as 16 bits take as text.
MAX_FILE_BYTES = 8 * MAX_CELLS


@dataclass(frozen=True)
class MapServerSettings:
    """The settings in a map_server file. `resolution` is the side of a cell [m], `yaw` in rad."""

    resolution: float
    origin: XY
    yaw: float
    negate: bool
    occupied_above: float
    free_below: float
    mode: str

    def to_map_frame(self, points: np.ndarray) -> tuple[XY, ...]:
        """Convert points from cells (from the lower left corner) to the map frame [m]."""
        return tuple((x, y) for x, y in to_floor_frame(points * self.resolution, self.origin, self.yaw).tolist())

    def to_cells(self, points: np.ndarray) -> np.ndarray:
        """Convert points from the map frame [m] to cells (from the lower left corner)."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y = (points - np.array(self.origin)).T
        return np.column_stack([cos * x + sin * y, cos * y - sin * x]) / self.resolution

    def area_m2(self, cells: int) -> float:
        """The area of a number of cells."""
        return cells * self.resolution**2


def read_settings(root: Item) -> MapServerSettings:
    """The settings of a map_server file. Raises MapFileError with line and key."""
    origin = root.need("origin").items()
    if len(origin) not in (2, 3):
        raise root.need("origin").error("expected [x, y, yaw]")
    occupied, free = root.get("occupied_thresh"), root.get("free_thresh")
    occupied_above, free_below = occupied.number(OCCUPIED_ABOVE), free.number(FREE_BELOW)
    if not 0 <= free_below < occupied_above <= 1:
        raise (free if free.value is not None else occupied).error("expected 0 <= free_thresh < occupied_thresh <= 1")
    resolution = root.need("resolution").positive()
    if not 1e-3 <= resolution <= 10:
        raise root.need("resolution").error("expected metres per cell, from 0.001 to 10")
    negate, mode = root.get("negate"), root.get("mode")
    if negate.value not in (None, 0, 1):
        raise negate.error("expected 0 or 1")
    if mode.value not in (None, "trinary", "scale", "raw"):
        raise mode.error("expected trinary, scale or raw")
    return MapServerSettings(
        resolution=resolution,
        origin=(origin[0].number(), origin[1].number()),
        yaw=origin[2].number() if len(origin) == 3 else 0.0,
        negate=bool(negate.value),
        occupied_above=occupied_above,
        free_below=free_below,
        mode=mode.value or "trinary",
    )


def read_cells(
    root: Item, settings: MapServerSettings, unknown_is_free: bool, absolute_paths: bool, losses: Losses
) -> np.ndarray:
    """FREE, OCCUPIED or UNKNOWN for each cell of the picture. Raises MapFileError with line and key.

    In mode trinary, cells of UNKNOWN_SHADE are unknown regardless of the thresholds.
    `unknown_is_free` makes all unknown cells free. `absolute_paths`: as of `named_file`."""
    image = root.need("image")
    picture = _picture(named_file(image, "a picture", absolute_paths), image)
    rows, columns = picture.shape[:2]
    corners = settings.to_map_frame(np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]))
    if any(abs(value) > MAX_NUMBER for corner in corners for value in corner):
        raise root.need("origin").error(f"the picture reaches beyond {MAX_NUMBER:g} m from 0, 0")
    cells = _classified(picture, settings)
    unknown = _saved_as_unknown(picture, settings) & (cells == FREE)
    if count := int(np.count_nonzero(unknown)):
        cells[unknown] = UNKNOWN
        if not unknown_is_free:
            losses.add(
                f"unknown cells: {count} of grey {UNKNOWN_SHADE} ({settings.area_m2(count):.1f} m2) are below "
                f"free_thresh {settings.free_below:g} but count as blocked, since map_saver writes unknown cells "
                f"in this grey; --unknown free makes them free"
            )
    if unknown_is_free and (count := int(np.count_nonzero(cells == UNKNOWN))):
        cells[cells == UNKNOWN] = FREE
        losses.add(f"unknown cells: {count} ({settings.area_m2(count):.1f} m2) count as free, as requested")
    return cells


def _picture(path: Path, item: Item) -> np.ndarray:
    """The picture as rows x columns x channels of 8 or 16 bits. A fourth channel is the opacity."""
    try:
        if not path.is_file():
            raise item.error("there is no picture of that name")
        if (size := path.stat().st_size) > MAX_FILE_BYTES:
            raise item.error(f"the picture has {size} bytes, at most {MAX_FILE_BYTES} can be read")
        with open_picture(path, ("PPM", "PNG", "BMP")) as picture:
            columns, rows = picture.size
            if columns * rows > MAX_CELLS:
                raise item.error(f"{columns} x {rows} cells are too many, at most {MAX_CELLS} can be read")
            return _channels(picture)
    except Image.DecompressionBombError:
        raise item.error(f"too many cells, at most {MAX_CELLS} can be read") from None
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, struct.error, zlib.error) as error:  # Pillow's
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise item.error(f"unreadable picture: {reason or 'unknown format or damaged'}") from None


def named_file(item: Item, what: str, absolute_paths: bool) -> Path:
    """The file that a value names: in the folder of its own file or below, or with `absolute_paths` anywhere by an
    absolute path. Raises MapFileError for any other name."""
    if not isinstance(item.value, str) or not item.value:
        raise item.error(f"expected the name of {what}")
    item.text()  # checks it; the file may have another spelling of the same characters
    named = Path(item.value)
    if ".." in named.parts or (named.is_absolute() and not absolute_paths):
        where = "in the folder of the file or below" + (", or have an absolute path" if absolute_paths else "")
        raise item.error(f"{what} must lie {where}, not at {item.text()[:200]!r}")
    return Path(item.file.name).parent / named


def _channels(picture: Image.Image) -> np.ndarray:
    """Grey, or red, green and blue; behind them the opacity only if the file has one. map_server takes a grey with
    opacity as three colours, which matters where it averages them."""
    if picture.mode in ("I", "I;16", "I;16B"):
        grey = np.asarray(picture).astype(np.uint16)
        if "transparency" not in picture.info:
            return grey[:, :, None]
        opacity = np.where(grey == picture.info["transparency"], 0, 65535).astype(np.uint16)
        return np.dstack([grey, grey, grey, opacity])
    if picture.has_transparency_data:
        mode = "RGBA"
    else:
        mode = {"1": "L", "P": "RGB", "CMYK": "RGB"}.get(picture.mode, picture.mode)
    values = np.asarray(picture.convert(mode))
    if values.dtype != np.uint8:
        raise ValueError(f"pictures of mode {picture.mode} are not supported")
    return values.reshape(*values.shape[:2], -1)


def _classified(picture: np.ndarray, settings: MapServerSettings) -> np.ndarray:
    """FREE, OCCUPIED or UNKNOWN for each cell, by the rules of map_server for each mode."""
    found, rows = np.full(picture.shape[:2], UNKNOWN, np.uint8), 256  # at a time, which bounds the memory
    for row in range(0, len(picture), rows):
        block = picture[row : row + rows].astype(np.float32) / np.iinfo(picture.dtype).max
        opaque = np.ones(block.shape[:2], bool)
        if settings.mode != "trinary" and block.shape[2] == 4:
            opaque, block = block[:, :, -1] == 1, block[:, :, :-1]
        shade = block.mean(axis=2)
        if settings.mode == "raw":
            probability = np.round(shade * 255) / 100
            opaque = probability <= 1
        else:
            probability = shade if settings.negate else 1 - shade
        part = found[row : row + rows]
        part[opaque & (probability < settings.free_below)] = FREE
        part[opaque & (probability > settings.occupied_above)] = OCCUPIED
    return found


def _saved_as_unknown(picture: np.ndarray, settings: MapServerSettings) -> np.ndarray:
    """The cells with exactly map_saver's grey of unknown cells. None in other modes than trinary."""
    if settings.mode != "trinary" or settings.negate:
        return np.zeros(picture.shape[:2], bool)
    shade = UNKNOWN_SHADE * (np.iinfo(picture.dtype).max // 255)
    return (picture[:, :, :3] == shade).all(axis=2)
