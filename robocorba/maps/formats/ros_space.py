"""Selects the free and blocked cells of a picture: removes specks, small regions and the surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from robocorba.maps.formats.grid import FREE, OCCUPIED, UNKNOWN
from robocorba.maps.formats.ros_picture import MapServerSettings
from robocorba.maps.formats.solids import EIGHT_NEIGHBOURS
from robocorba.maps.losses import Losses

#: Minimum area of a free region that is kept beside the largest one [m2]. A robot of 0.4 m radius covers 0.5 m2
#: and can turn and leave in twice that. Laser beams through windows leave thousands of smaller regions.
MIN_FREE_REGION_M2 = 1.0
#: Maximum side of a speck, an occupied or unknown region in free space [m]: one cell of most laser maps.
#: Table legs are 3 to 6 cm thick.
MAX_SPECK_M = 0.05
#: Maximum gap between a wall and a speck that counts as its noise [m]. A removed speck extends
#: at most 0.10 m from the wall.
MAX_SPECK_GAP_M = 0.05
#: Removed regions that are listed with their position, the largest first.
MAX_REGIONS_LISTED = 5
#: Which specks are removed.
SPECKS = ("keep", "walls", "all")
_SLACK = 1e-9


@dataclass(frozen=True)
class FloorCells:
    """The rectangle of the picture that contains the floor: its cells, which of them block, its lower left corner."""

    cells: np.ndarray
    blocked: np.ndarray
    corner: np.ndarray


def remove_specks(cells: np.ndarray, settings: MapServerSettings, specks: str, losses: Losses) -> np.ndarray:
    """The cells with specks made free: those beside larger regions, or all (`specks` is one of SPECKS)."""
    largest = int(MAX_SPECK_M / settings.resolution + _SLACK)
    if specks == "keep" or largest < 1:
        return cells
    labels, count = ndimage.label(cells != FREE, EIGHT_NEIGHBOURS)
    small = np.zeros(count + 1, bool)
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        small[number] = max(rows.stop - rows.start, columns.stop - columns.start) <= largest
    removed = small
    if specks == "walls":
        gap = int(MAX_SPECK_GAP_M / settings.resolution + _SLACK)
        larger = (labels > 0) & ~small[labels]
        beside = np.zeros(count + 1, bool)
        beside[labels[ndimage.binary_dilation(larger, EIGHT_NEIGHBOURS, iterations=gap + 1)]] = True
        removed = small & beside
    removed_cells = removed[labels]
    if removed_cells.any():
        where = " beside walls" if specks == "walls" else ""
        losses.add(
            f"specks: {np.count_nonzero(removed)} of at most {MAX_SPECK_M:g} m{where}, "
            f"{settings.area_m2(int(np.count_nonzero(removed_cells))):.3g} m2, are removed as noise; "
            f"--specks keep keeps them"
        )
    if left := int(np.count_nonzero(small & ~removed)):
        losses.add(
            f"specks: {left} of at most {MAX_SPECK_M:g} m away from walls are kept, as table legs; "
            f"--specks all removes them"
        )
    return np.where(removed_cells, np.uint8(FREE), cells)


def crop_to_floor(cells: np.ndarray, settings: MapServerSettings, losses: Losses) -> FloorCells:
    """The rectangle around the known space. All cells in it block, except those of the kept free regions.

    The largest free region is kept, and each of at least MIN_FREE_REGION_M2, with the known
    cells that are connected to it."""
    regions, count = ndimage.label(cells == FREE)
    sizes = np.bincount(regions.ravel(), minlength=count + 1)
    sizes[0] = 0
    kept = settings.area_m2(1) * sizes >= MIN_FREE_REGION_M2 - _SLACK
    kept[int(np.argmax(sizes))] = True
    kept[0] = False
    ground = kept[regions]
    rows, columns = _around(ground, cells)
    part, blocked = cells[rows, columns], ~ground[rows, columns]

    small = f"free space: {{n}} separate regions below {MIN_FREE_REGION_M2:g} m2 count as blocked"
    _report_regions(small, np.where(ground, 0, regions), settings, losses)
    outside = cells == OCCUPIED
    outside[rows, columns] = False
    if outside.any():
        apart, _ = ndimage.label(outside, EIGHT_NEIGHBOURS)
        _report_regions("occupied space: {n} regions outside the outline are left out", apart, settings, losses)
    if not ground.any():
        losses.add("the picture has no free cell, the whole floor is blocked; check negate and the thresholds")
    elif unknown := int(np.count_nonzero(part == UNKNOWN)):
        losses.add(f"unknown space: {settings.area_m2(unknown):.1f} m2 within the outline count as blocked")
    return FloorCells(part, blocked, np.array([columns.start, len(cells) - rows.stop]))


def _around(ground: np.ndarray, cells: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns that contain the ground and all known cells connected to it; all without ground."""
    known, count = ndimage.label(cells != UNKNOWN, EIGHT_NEIGHBOURS)
    reached = np.zeros(count + 1, bool)
    reached[known[ground]] = True
    inside = reached[known] if ground.any() else np.ones(cells.shape, bool)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _report_regions(sentence: str, regions: np.ndarray, settings: MapServerSettings, losses: Losses) -> None:
    """Report removed regions (0: no region): their number, their area and the positions of the largest."""
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    lost = np.flatnonzero(sizes)
    if not len(lost):
        return
    largest = lost[np.argsort(-sizes[lost], kind="stable")][:MAX_REGIONS_LISTED]
    middles = np.array(ndimage.center_of_mass(regions > 0, regions, largest))
    middles = np.column_stack([middles[:, 1] + 0.5, len(regions) - middles[:, 0] - 0.5])
    places = [
        f"{settings.area_m2(int(sizes[region])):.2g} m2 at ({x:.2f}, {y:.2f})"
        for region, (x, y) in zip(largest, settings.to_map_frame(middles), strict=True)
    ]
    more = f" and {len(lost) - len(places)} more" if len(lost) > len(places) else ""
    losses.add(
        f"{sentence.replace('{n}', str(len(lost)))}, "
        f"{settings.area_m2(int(sizes.sum())):.2f} m2 in all: {', '.join(places)}{more}"
    )
