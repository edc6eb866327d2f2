"""Grid maps of the kinds in public path planning benchmarks, generated from a seed.

`cells[row, column]` is True where the cell is free. Row 0 is at the bottom: a cell covers x from column * cell_m to
(column + 1) * cell_m, and y from row * cell_m in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from robocorba.map_editor.model import Building, Floor, FloorMap, GeometricalMap, Wall
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Place

Cells: TypeAlias = NDArray[np.bool_]
#: Row and column of a cell.
Cell: TypeAlias = tuple[int, int]

FLOOR = "L1"
#: Share of the walls between rooms with a door in addition to those that connect all rooms.
EXTRA_DOORS = 0.3
#: Cellular automaton of the caves: initial share of occupied cells, number of generations.
CAVE_FILL, CAVE_GENERATIONS = 0.475, 5
#: Share of single occupied cells in a laser map (false returns).
SPECKLES = 0.002


def rooms(size: int, room: int, seed: int) -> Cells:
    """Square rooms of `room` cells, walls of one cell, doors of one cell; every room can be reached."""
    rng = np.random.default_rng(seed)
    return _rooms(size, room, 1, 1, rng)


def _rooms(size: int, room: int, wall: int, door: int, rng: np.random.Generator) -> Cells:
    """Rooms with walls and doors of that many cells."""
    pitch = room + wall
    cells = np.ones((size, size), np.bool_)
    for k in range(wall):
        cells[room + k :: pitch] = False
        cells[:, room + k :: pitch] = False
    count = -(-size // pitch)
    for lower, upper in _connected_pairs(count, EXTRA_DOORS, rng):
        (row, column), (_, next_column) = lower, upper
        low_row, low_column = row * pitch, column * pitch
        if next_column > column:
            high = min(low_row + room, size) - door
            if high >= low_row:
                at = int(rng.integers(low_row, high + 1))
                cells[at : at + door, low_column + room : low_column + pitch] = True
        else:
            high = min(low_column + room, size) - door
            if high >= low_column:
                at = int(rng.integers(low_column, high + 1))
                cells[low_row + room : low_row + pitch, at : at + door] = True
    return cells


def _connected_pairs(count: int, extra: float, rng: np.random.Generator) -> list[tuple[Cell, Cell]]:
    """Neighbours of a count x count lattice that are connected: a random spanning tree and a share of the others."""
    at = np.arange(count * count).reshape(count, count)
    pairs = np.concatenate(
        [np.column_stack([at[:, :-1].ravel(), at[:, 1:].ravel()]), np.column_stack([at[:-1].ravel(), at[1:].ravel()])]
    )
    weights = rng.random(len(pairs)) + 0.1  # csgraph reads a weight of 0 as no edge
    graph = sparse.coo_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(count**2, count**2))
    tree = csgraph.minimum_spanning_tree(graph).tocoo()
    chosen = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    chosen |= {(int(a), int(b)) for a, b in pairs[rng.random(len(pairs)) < extra]}
    return [(divmod(a, count), divmod(b, count)) for a, b in sorted(chosen)]


def maze(size: int, corridor: int, seed: int) -> Cells:
    """A maze without loops: corridors of `corridor` cells, walls of one cell, by random depth-first search."""
    rng = np.random.default_rng(seed)
    pitch = corridor + 1
    count = (size + 1) // pitch
    if count < 1:
        raise ValueError(f"a maze of {size} cells has no room for a corridor of {corridor}")
    cells = np.zeros((size, size), np.bool_)
    seen = np.zeros((count, count), np.bool_)
    stack: list[Cell] = [(0, 0)]
    seen[0, 0] = True
    cells[:corridor, :corridor] = True
    while stack:
        row, column = stack[-1]
        neighbours = [
            (r, c)
            for r, c in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1))
            if 0 <= r < count and 0 <= c < count and not seen[r, c]
        ]
        if not neighbours:
            stack.pop()
            continue
        r, c = neighbours[int(rng.integers(len(neighbours)))]
        seen[r, c] = True
        top, right = max(row, r) * pitch + corridor, max(column, c) * pitch + corridor
        cells[min(row, r) * pitch : top, min(column, c) * pitch : right] = True
        stack.append((r, c))
    return cells


def cave(size: int, seed: int) -> Cells:
    """Caves: random cells that a cellular automaton has smoothed."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((size, size)) < CAVE_FILL
    for _ in range(CAVE_GENERATIONS):
        around = ndimage.uniform_filter(occupied.astype(float), 3, mode="constant", cval=1.0) * 9
        occupied = around > 4.5
    return ~occupied


def city(size: int, seed: int) -> Cells:
    """Streets at random intervals; between them buildings of rectangles and turned rectangles, some with a yard."""
    rng = np.random.default_rng(seed)
    cells = np.ones((size, size), np.bool_)
    for low_row, high_row in _blocks(size, rng):
        for low, high in _blocks(size, rng):
            block = cells[low_row:high_row, low:high]
            for _ in range(int(rng.integers(1, 5))):
                _build(block, rng)
    return cells


def _blocks(size: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """First and last cells of blocks, with streets between them."""
    found, at = [], int(rng.integers(2, 7))
    while at < size - 6:
        end = min(at + int(rng.integers(16, 56)), size - 2)
        found.append((at, end))
        at = end + int(rng.integers(4, 12))
    return found


def _build(block: Cells, rng: np.random.Generator) -> None:
    """Put one building into a block."""
    height, width = block.shape
    if min(height, width) < 6:
        block[:] = False
        return
    size = rng.uniform(0.25, 0.9, 2) * (width, height)
    turn = float(rng.choice([0.0, 0.0, rng.uniform(0.0, np.pi)]))
    centre = rng.uniform(0.3, 0.7, 2) * (width, height)
    rows, columns = np.mgrid[:height, :width] + 0.5
    x, y = columns - centre[0], rows - centre[1]
    along = np.abs(x * np.cos(turn) + y * np.sin(turn)) / (size[0] / 2)
    across = np.abs(y * np.cos(turn) - x * np.sin(turn)) / (size[1] / 2)
    far = np.maximum(along, across)
    block[far <= 1.0] = False
    if rng.random() < 0.2 and size.min() > 14:
        block[far <= 0.5] = True  # an enclosed yard


def laser(size: int, seed: int) -> Cells:
    """A laser map: rooms at an angle to the grid, ragged walls, furniture, single false returns."""
    rng = np.random.default_rng(seed)
    drawn = int(size * 0.8)
    plan = _rooms(drawn, int(rng.integers(24, 40)), 3, int(rng.integers(6, 9)), rng)
    for _ in range(drawn * drawn // 1500):
        row, column = rng.integers(0, drawn, 2)
        height, width = rng.integers(1, 6, 2)
        plan[row : row + height, column : column + width] = False
    plan = np.pad(plan, 3)
    turned = ndimage.rotate(plan, float(rng.uniform(3.0, 15.0)), order=0, cval=False)
    cells = np.zeros((size, size), np.bool_)
    height, width = np.minimum(turned.shape, size)
    top, left = (turned.shape[0] - height) // 2, (turned.shape[1] - width) // 2
    low_row, low = (size - height) // 2, (size - width) // 2
    cells[low_row : low_row + height, low : low + width] = turned[top : top + height, left : left + width]
    at_wall = cells & ndimage.binary_dilation(~cells)
    cells[at_wall & (rng.random(cells.shape) < 0.15)] = False
    behind = ~cells & ndimage.binary_dilation(cells)
    cells[behind & (rng.random(cells.shape) < 0.15)] = True
    cells[rng.random(cells.shape) < SPECKLES] = False
    return cells


#: Maps by kind, from size in cells and seed.
KINDS: dict[str, Callable[[int, int], Cells]] = {
    "rooms of 8": lambda size, seed: rooms(size, 8, seed),
    "rooms of 16": lambda size, seed: rooms(size, 16, seed),
    "rooms of 32": lambda size, seed: rooms(size, 32, seed),
    "rooms of 64": lambda size, seed: rooms(size, 64, seed),
    "maze of 1": lambda size, seed: maze(size, 1, seed),
    "maze of 4": lambda size, seed: maze(size, 4, seed),
    "maze of 32": lambda size, seed: maze(size, 32, seed),
    "cave": cave,
    "city": city,
    "laser": laser,
}


def building_of(cells: Cells, cell_m: float, name: str = "grid") -> Building:
    """A building of one floor whose walls are the maximal straight borders between free and occupied cells.

    The outline is the rectangle of all cells. Walls enclose the occupied cells."""
    height, width = (float(count * cell_m) for count in cells.shape)
    vertical = [((x, low), (x, high)) for x, low, high in _borders(cells, cell_m)]
    horizontal = [((low, y), (high, y)) for y, low, high in _borders(cells.T, cell_m)]
    walls = {f"w{i}": Wall(name=f"w{i}", a=a, b=b) for i, (a, b) in enumerate([*vertical, *horizontal])}
    outline: tuple[XY, ...] = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
    floor = Floor(name=FLOOR, level=0, elevation=0.0, outline=outline)
    return Building(name, {FLOOR: FloorMap(floor, GeometricalMap(walls=walls))})


def _borders(cells: Cells, cell_m: float) -> list[tuple[float, float, float]]:
    """Borders between differing neighbours in a row: position across, and both ends along [m]."""
    differs = np.pad((cells[:, 1:] != cells[:, :-1]).T.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(differs, axis=1)
    column, first = np.nonzero(steps == 1)
    last = np.nonzero(steps == -1)[1]
    return list(zip(((column + 1) * cell_m).tolist(), (first * cell_m).tolist(), (last * cell_m).tolist(), strict=True))


def place_of(cell: Cell, cell_m: float) -> Place:
    """The centre of a cell."""
    row, column = cell
    return Place(FLOOR, (column + 0.5) * cell_m, (row + 0.5) * cell_m)


def random_cells(cells: Cells, count: int, seed: int) -> list[Cell]:
    """Free cells of the largest connected part of the map, so that each can be reached from each."""
    parts, found = ndimage.label(cells)
    largest = 1 + int(np.argmax(np.bincount(parts.ravel(), minlength=found + 1)[1:]))
    rows, columns = np.nonzero(parts == largest)
    chosen = np.random.default_rng(seed).integers(0, len(rows), count)
    return [(int(rows[i]), int(columns[i])) for i in chosen]


class OctileGraph:
    """Moves to the eight neighbours, diagonal ones only where both cells beside them are free too.

    A robot of a radius up to half a cell can drive all of them from centre to centre: its shortest path is never
    longer than the shortest here."""

    def __init__(self, cells: Cells, cell_m: float) -> None:
        self.shape = cells.shape
        at = np.arange(cells.size).reshape(cells.shape)
        square = cells[:-1, :-1] & cells[:-1, 1:] & cells[1:, :-1] & cells[1:, 1:]
        moves = [
            (cells[:, :-1] & cells[:, 1:], at[:, :-1], at[:, 1:], 1.0),
            (cells[:-1] & cells[1:], at[:-1], at[1:], 1.0),
            (square, at[:-1, :-1], at[1:, 1:], np.sqrt(2.0)),
            (square, at[:-1, 1:], at[1:, :-1], np.sqrt(2.0)),
        ]
        origin = np.concatenate([a[free] for free, a, _, _ in moves])
        target = np.concatenate([b[free] for free, _, b, _ in moves])
        length = np.concatenate([np.full(int(free.sum()), step * cell_m) for free, _, _, step in moves])
        self._graph = sparse.coo_matrix((length, (origin, target)), shape=(cells.size, cells.size)).tocsr()

    def lengths_from(self, cell: Cell) -> NDArray[np.float64]:
        """Length of the shortest path from a cell to every cell [m], infinite if there is none."""
        index = int(np.ravel_multi_index(cell, self.shape))
        return csgraph.dijkstra(self._graph, directed=False, indices=index).reshape(self.shape)
