"""Findings for the maintainer of a map: what robots can't do in a valid building, and what is probably drawn wrong.

A finding is not a broken rule: the building can be served, and the finding disappears with its cause.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import shapely
from shapely import Polygon

from robocorba.errors.maps import InvalidElement, UnknownElement
from robocorba.errors.places import near
from robocorba.map_editor.collisions import TOUCH_M, Collision, blockages
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.geometry import bounds
from robocorba.map_editor.model import KIND_OF, Building, ElementKind, Elevator
from robocorba.map_editor.plan_defects import plan_defects
from robocorba.map_editor.reachability import Reachability
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.map_editor.time_limit import no_limit


def findings(
    building: Building, radius_m: float = SMARTPAL_RADIUS_M, check_time: Callable[[], None] = no_limit
) -> list[Finding]:
    """Blocked nodes and edges, all that a robot of `radius_m` can't reach, and defects of the plans. `check_time` is
    called often, and may raise an error to end the work."""
    found = _of_roads(building, radius_m, check_time)
    for floor in building.floors:
        for finding in plan_defects(building, floor, radius_m):
            check_time()
            found.append(finding)
    return found


def _of_roads(building: Building, radius_m: float, check_time: Callable[[], None]) -> list[Finding]:
    """Blocked nodes and edges, and all that a robot of `radius_m` can't reach, floor by floor."""
    reach = Reachability(building, radius_m, check_time)
    found = list(blocked(building))
    for floor in building.floors:
        check_time()
        found += _nodes(building, floor, reach)
    found += _in_other_units(building)
    return found + list(_floors(building, reach)) + list(_elevators(building, reach))


def floor_findings(
    building: Building, floor: str, radius_m: float, check_time: Callable[[], None] = no_limit
) -> list[Finding]:
    """The findings of one floor and of the elevators that serve it, which are placed on it.

    Raises UnknownElement, InvalidElement for the radius."""
    if floor not in building.floors:
        raise UnknownElement(ElementKind.FLOOR.value, "", floor)
    if not 0.05 <= radius_m <= 5.0:
        reason = f"the radius of the robot must be from 0.05 to 5 m, not {radius_m:g}"
        raise InvalidElement(ElementKind.FLOOR.value, "", floor, reason)
    found = []
    for finding in _of_roads(building, radius_m, check_time):
        if finding.kind is ElementKind.ELEVATOR:
            if floor in building.elevators[finding.name].floors():
                found.append(finding._replace(where=(floor, *finding.where[1:])))
        elif finding.where[0] == floor:
            found.append(finding)
    return [*found, *plan_defects(building, floor, radius_m)]


def blocked(building: Building) -> Iterator[Finding]:
    """The nodes and edges that a wall, an object or a locked door blocks."""
    for floor in building.floors:
        by_element: dict[tuple[ElementKind, str], list[Collision]] = {}
        for collision in blockages(building, floor):
            key = KIND_OF[type(collision.element)], collision.element.name
            by_element.setdefault(key, []).append(collision)
        for (kind, name), collisions in by_element.items():
            x, y = collisions[0].at()
            causes = ", ".join(dict.fromkeys(collision.cause for collision in collisions))
            yield Finding(
                kind,
                floor,
                name,
                (floor, x, y),
                "blocked: " + "; ".join(collision.reason for collision in collisions),
                f"blocked {kind.value}s of {floor} ({{n}}): {{names}}",
                f"{name} ({causes} {near(x, y)})",
            )


def summaries(found: Iterable[Finding]) -> tuple[str, ...]:
    """One sentence for each kind of finding on a floor, with the number and names of its subjects."""
    # Imported here: the formats take 0.3 s to load, and a server must restart quickly.
    from robocorba.map_editor.losses import Losses

    kinds = Losses()
    for finding in found:
        kinds.add(finding.summary, finding.subject)
    return kinds.sentences()


def _nodes(building: Building, floor: str, reach: Reachability) -> Iterator[Finding]:
    """Nodes of a floor that a robot can't reach or can't leave."""
    nodes, robot = building.floors[floor].topological.nodes, _robot(reach)

    def finding(name: str, reason: str, kind: str, subject: str = "") -> Finding:
        where, summary = (floor, *nodes[name].at), f"nodes of {floor} {kind} ({{n}}): {{names}}"
        return Finding(ElementKind.NODE, floor, name, where, reason, summary, subject or name)

    for name, cause in reach.too_close(floor).items():
        yield finding(name, f"{robot} does not fit: {cause}", f"where {robot} does not fit", f"{name} ({cause})")
    for name in reach.walled_in(floor):
        yield finding(name, f"it is walled in for {robot}", f"that are walled in for {robot}")
    for name in reach.isolated(floor):
        yield finding(name, "it has no edge", "without an edge")
    for (first, *more), cause in reach.separate_parts(floor):
        reason = f"{robot} can't drive between it{_count_of(more)} and the rest of {floor}: {cause}"
        subject = f"{first}{_count_of(more)} {near(*nodes[first].at)} ({cause})"
        yield finding(first, reason, f"not connected with the rest of it for {robot}", subject)
    for direction, names in reach.one_way(floor).items():
        for name in names:
            yield finding(name, f"it can be {direction}", f"that can be {direction}")


def _count_of(more: list[str]) -> str:
    return f" with {len(more)} more" if more else ""


def _in_other_units(building: Building) -> Iterator[Finding]:
    """Floors that are larger than any building."""
    for floor, entry in building.floors.items():
        outline = entry.floor.outline
        plan = Polygon(outline) if outline else shapely.box(*bounds(building, floor))
        if plan.area > 1e6:  # m²; the largest buildings have about 1 km², and hardly a floor has less than 5 m²
            unit = "millimetres" if plan.area * 1e-6 >= 5.0 else "centimetres"
            reason = f"it is {plan.area * 1e-6:,.0f} km² large: is it drawn in {unit} instead of metres?"
            where, summary = (floor, plan.centroid.x, plan.centroid.y), "very large floors ({n}): {names}"
            yield Finding(ElementKind.FLOOR, "", floor, where, reason, summary, f"{floor} ({reason[6:]})")


def _floors(building: Building, reach: Reachability) -> Iterator[Finding]:
    """Floors without a connection to the others."""
    if len(building.floors) < 2:
        return
    between = (elevator.floors() for elevator in building.elevators.values())
    served = {floor for floors in between if len(floors) > 1 for floor in floors}
    for floor in building.floors:
        x0, y0, x1, y1 = bounds(building, floor)
        where = (floor, (x0 + x1) / 2, (y0 + y1) / 2)
        if floor not in served:
            summary = "floors without an elevator to other floors ({n}): {names}"
            reason = "no elevator leads from it to another floor"
            yield Finding(ElementKind.FLOOR, "", floor, where, reason, summary, floor)
        elif reach.is_cut_off(floor):
            reason = f"no elevator connects its roadmap with other floors for {_robot(reach)}"
            summary = f"floors that no elevator connects with the others for {_robot(reach)} ({{n}}): {{names}}"
            yield Finding(ElementKind.FLOOR, "", floor, where, reason, summary, floor)


def _elevators(building: Building, reach: Reachability) -> Iterator[Finding]:
    """Elevators that a robot can't enter on any floor."""
    for name, elevator in building.elevators.items():
        cause = _closed(elevator, building, reach)
        if cause:
            where = (elevator.floors()[0], *elevator.at)
            reason = f"{_robot(reach)} can't enter it: {cause}"
            summary = f"elevators that {_robot(reach)} can't enter ({{n}}): {{names}}"
            yield Finding(ElementKind.ELEVATOR, "", name, where, reason, summary, f"{name} ({cause})")


def _closed(elevator: Elevator, building: Building, reach: Reachability) -> str:
    """Why a robot can't enter an elevator. Empty if it can, or if no served floor has a roadmap."""
    if reach.enters(elevator.name) or not any(building.floors[floor].topological.edges for floor in elevator.floors()):
        return ""
    widest = max(door.width for door in elevator.doors)
    if widest < 2 * (reach.radius_m - TOUCH_M):
        return f"its widest door is {widest:.2f} m wide, {2 * reach.radius_m:.2f} m needed"
    if not reach.stops(elevator.name):
        return "no path node stands in its cabin"
    return "no edge into its cabin is free and wide enough"


def _robot(reach: Reachability) -> str:
    return f"a robot of radius {reach.radius_m:.2f} m"
