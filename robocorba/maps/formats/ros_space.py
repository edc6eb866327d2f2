"""Which cells of a picture are ground, which block, and what of the picture is left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from robocorba.maps.formats.grid import FREE, OCCUPIED, UNKNOWN
from robocorba.maps.formats.ros_picture import MapServerSettings
from robocorba.maps.formats.solids import EIGHT_NEIGHBOURS
from robocorba.maps.losses import Losses

#: Smallest free region that is kept beside the largest [m2]. A robot of 0.4 m radius takes 0.5 m2; with
#: twice that it can turn and leave. Laser rays through windows leave thousands of smaller ones.
MIN_FREE_REGION_M2 = 1.0
#: Largest side of a speck, something occupied or unknown within free space [m]: one cell of most laser maps.
#: Legs of tables are 3 to 6 cm thick.
MAX_SPECK_M = 0.05
#: Widest gap between a speck and a wall that it is taken for noise of [m], so a removed one
#: stood out from the wall by 0.10 m at most.
MAX_SPECK_GAP_M = 0.05
#: Regions left out that are named with their place, the largest first.
MAX_REGIONS_LISTED = 5
#: Which specks are removed.
SPECKS = ("keep", "walls", "all")
_SLACK = 1e-9


@dataclass(frozen=True)
class FloorCells:
    """A rectangle of the picture that holds the ground: its cells, what of them blocks, and its lower left corner."""

    cells: np.ndarray
    blocked: np.ndarray
    corner: np.ndarray


def remove_specks(cells: np.ndarray, settings: MapServerSettings, specks: str, losses: Losses) -> np.ndarray:
    """The cells with specks made free: those beside larger map_objects, or all of them (`specks` is one of SPECKS)."""
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
    taken = removed[labels]
    if taken.any():
        where = " beside walls" if specks == "walls" else ""
        losses.add(
            f"specks: {np.count_nonzero(removed)} of at most {MAX_SPECK_M:g} m{where}, "
            f"{settings.area_m2(int(np.count_nonzero(taken))):.3g} m2, are taken for noise and left out; "
            f"--specks keep keeps them"
        )
    if left := int(np.count_nonzero(small & ~removed)):
        losses.add(
            f"specks: {left} of at most {MAX_SPECK_M:g} m away from walls block, as legs of tables do; "
            f"--specks all removes them"
        )
    return np.where(taken, np.uint8(FREE), cells)


def crop_to_floor(cells: np.ndarray, settings: MapServerSettings, losses: Losses) -> FloorCells:
    """The rectangle around the known space that is kept. All but the kept free cells blocks in it.

    The largest free region is kept, and each of MIN_FREE_REGION_M2 or more; with each, the
    known cells that it is connected to."""
    regions, count = ndimage.label(cells == FREE)
    sizes = np.bincount(regions.ravel(), minlength=count + 1)
    sizes[0] = 0
    kept = settings.area_m2(1) * sizes >= MIN_FREE_REGION_M2 - _SLACK
    kept[int(np.argmax(sizes))] = True
    kept[0] = False
    ground = kept[regions]
    rows, columns = _around(ground, cells)
    part, blocked = cells[rows, columns], ~ground[rows, columns]

    small = (
        f"free space: {{n}} regions below {MIN_FREE_REGION_M2:g} m2 and apart from the others are left out and block"
    )
    _report_regions(small, np.where(ground, 0, regions), settings, losses)
    outside = cells == OCCUPIED
    outside[rows, columns] = False
    if outside.any():
        apart, _ = ndimage.label(outside, EIGHT_NEIGHBOURS)
        _report_regions("occupied space: {n} regions outside of the outline are left out", apart, settings, losses)
    if not ground.any():
        losses.add("the picture shows no free cell: the whole floor blocks; check negate and the thresholds")
    elif unknown := int(np.count_nonzero(part == UNKNOWN)):
        losses.add(f"unknown space: {settings.area_m2(unknown):.1f} m2 within the outline block")
    return FloorCells(part, blocked, np.array([columns.start, len(cells) - rows.stop]))


def _around(ground: np.ndarray, cells: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns that hold the ground and all known cells connected to it; without ground, all."""
    known, count = ndimage.label(cells != UNKNOWN, EIGHT_NEIGHBOURS)
    reached = np.zeros(count + 1, bool)
    reached[known[ground]] = True
    inside = reached[known] if ground.any() else np.ones(cells.shape, bool)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _report_regions(sentence: str, regions: np.ndarray, settings: MapServerSettings, losses: Losses) -> None:
    """Report regions that are left out, 0 standing for none: how many, how large, where the largest are."""
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
