"""Transforms from a level's drawing (pixels, y down) to the building (metres, y up).

The reference level (named in the file, else the first) gets its scale from its
measurements and keeps its origin. Every other level is aligned with it by their common
fiducials: scale, rotation and translation by least squares.
"""

from __future__ import annotations

import cmath
import statistics
from dataclasses import dataclass

from robocorba.map_editor.formats.openrmf_file import Level
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.spatial.pose import XY


@dataclass(frozen=True)
class Alignment:
    """A similarity transform in complex numbers: metres = turn * (x - iy) + shift; x + iy if y is up in the file."""

    turn: complex
    shift: complex
    y_down: bool = True

    @property
    def rotation(self) -> float:
        """Radians counter-clockwise from the level's drawing to the building."""
        return cmath.phase(self.turn)

    def __call__(self, at: XY) -> XY:
        """A point of the file in metres."""
        found = self.turn * _up(at, self.y_down) + self.shift
        return (found.real, found.imag)


def metres(offset: XY) -> Alignment:
    """The alignment of levels that are drawn in metres: coordinates of the file less `offset`."""
    return Alignment(1 + 0j, -complex(*offset), y_down=False)


def align_levels(levels: list[Level], reference: Level, losses: Losses) -> dict[str, Alignment]:
    """The alignment of each level by name. Raises MapFileError for an impossible measurement."""
    own = {level.name: _measured_scale(level, losses) for level in levels}
    base = own[reference.name] or _scale_from_others(levels, reference, own)
    if not base:
        base = 0.05  # as in the format's own editor
        losses.add(f"scale: the file has no measurements, {base} m per pixel is assumed")
    aligned = {reference.name: Alignment(complex(base), 0j)}
    for level in levels:
        if level is not reference:
            aligned[level.name] = _align(level, reference, base, own[level.name], losses)
    return aligned


def _measured_scale(level: Level, losses: Losses) -> float | None:
    """Mean scale of a level's measurements [m per pixel], None if it has none."""
    scales = []
    for link in level.links["measurements"]:
        if "distance" not in link.params:
            raise link.item.error("a measurement without distance")
        distance = link.params["distance"].positive()
        pixels = abs(_up(level.vertices[link.a].at) - _up(level.vertices[link.b].at))
        if pixels < 1e-6:
            raise link.item.error("a measurement between two equal points")
        scales.append((distance / pixels, link.item.key))
    if not scales:
        return None
    middle = statistics.median(scale for scale, _ in scales)
    for scale, key in scales:
        if abs(scale / middle - 1) > 0.05:
            where = key.removeprefix("$.")
            losses.add(f"scale of {level.name}: {where} gives {scale:.5f} m per pixel, the median is {middle:.5f}")
    return statistics.fmean(scale for scale, _ in scales)


def _scale_from_others(levels: list[Level], reference: Level, own: dict[str, float | None]) -> float | None:
    """The reference level's scale from the first measured level that shares two fiducials with it."""
    for level in levels:
        scale = own[level.name]
        fit = _fit(_pairs(level, reference)) if scale else None
        if scale and fit:
            return scale / abs(fit[0])
    return None


def _align(level: Level, reference: Level, base: float, own: float | None, losses: Losses) -> Alignment:
    pairs = [(mine, base * theirs) for mine, theirs in _pairs(level, reference)]
    fit = _fit(pairs)
    if fit:
        turn, shift = fit
        worst = max(abs(turn * mine + shift - theirs) for mine, theirs in pairs)
        if worst > 0.1:
            losses.add(
                f"placement of {level.name}: its fiducials miss those of {reference.name} by up to {worst:.2f} m"
            )
        return Alignment(turn, shift)
    scale = complex(own or base)
    if pairs:
        mine, theirs = pairs[0]
        losses.add(
            f"placement: only one common fiducial with {reference.name}, no rotation is assumed: {{names}}", level.name
        )
        return Alignment(scale, theirs - scale * mine)
    losses.add(f"placement: no common fiducial with {reference.name}, equal origins are assumed: {{names}}", level.name)
    return Alignment(scale, 0j)


def _pairs(level: Level, reference: Level) -> list[tuple[complex, complex]]:
    """Positions of common fiducials in pixels, y up: in the level, in the reference level."""
    return [
        (_up(at), _up(reference.fiducials[name])) for name, at in level.fiducials.items() if name in reference.fiducials
    ]


def _fit(pairs: list[tuple[complex, complex]]) -> tuple[complex, complex] | None:
    """Least-squares turn and shift from the first to the second of each pair; None if they are undetermined."""
    if len(pairs) < 2:
        return None
    centre = sum(a for a, _ in pairs) / len(pairs)
    target = sum(b for _, b in pairs) / len(pairs)
    spread = sum(abs(a - centre) ** 2 for a, _ in pairs)
    cross = sum((a - centre).conjugate() * (b - target) for a, b in pairs)
    if spread < 1e-9 or abs(cross) < 1e-9:
        return None
    turn = cross / spread
    return turn, target - turn * centre


def _up(at: XY, y_down: bool = True) -> complex:
    return complex(at[0], -at[1] if y_down else at[1])


def reference_level(levels: list[Level], root: Item) -> Level:
    """The reference level for alignment. Raises MapFileError if the file names one that does not exist."""
    named = root.get("reference_level_name")
    if not named.level_name():
        return levels[0]
    for level in levels:
        if level.name == named.level_name():
            return level
    raise named.error(f"there is no level {named.text()!r}")
