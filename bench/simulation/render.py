"""Time to render a floor with 50 robots and 8 lasers, compared with matplotlib: python -m bench.simulation.render"""

from __future__ import annotations

import io
import math
import statistics

import numpy as np
import shapely

from bench.common.harness import run
from robocorba.map_editor.drawing import draw_floor
from robocorba.map_editor.geometry import free_space
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import fixed_obstacles, movables, object_outline
from robocorba.map_editor.samples import load_sample
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.picture import FloorPainter
from robocorba.simulation.robot_scans import LastScan
from robocorba.simulation.sensing.scan import LASER
from robocorba.simulation.sensing.visible_obstacles import VisibleObstacles
from testkit.report import at_most, summarize, summary, timed_ms

FLOOR, WIDTH_PX = "L1", 1200
ROBOTS, LASERS, RADIUS_M = 50, 8, 0.4
#: Different states of the floor, pictures of each, and pictures by matplotlib, which is slow.
STATES, ROUNDS, FEW = 30, 10, 5
MAX_MS = 30.0


def floor_states(building: Building) -> list[tuple[FloorView, list[LastScan]]]:
    """States of the floor: robots at free places, objects near their places on the map, and scans."""
    chance = np.random.default_rng(1)
    space = free_space(building, FLOOR, RADIUS_M)
    shapely.prepare(space)
    points = chance.uniform(space.bounds[:2], space.bounds[2:], (100 * ROBOTS * STATES, 2))
    free = points[shapely.contains_xy(space, points)][: ROBOTS * STATES].reshape(STATES, ROBOTS, 2)
    objects = [(name, item) for name, (item, floor) in movables(building).items() if floor == FLOOR]
    bodies = [Body(i, BodyKind.ROBOT, f"robot-{i}", RADIUS_M, (), 100.0) for i in range(ROBOTS)]
    for number, (name, item) in enumerate(objects, ROBOTS):
        bodies.append(Body(number, BodyKind.OBJECT, name, 1.0, tuple(object_outline(item).exterior.coords), 20.0))
    places = np.array([(*item.at, item.heading) for _, item in objects])
    scene = VisibleObstacles(fixed_obstacles(building, FLOOR))
    found = []
    for time in range(STATES):
        motions = np.zeros(len(bodies), MOTION)
        motions["number"] = range(len(bodies))
        poses = np.column_stack([free[time], chance.uniform(-math.pi, math.pi, ROBOTS)])
        poses = np.vstack([poses, places + chance.normal(0.0, 0.2, places.shape)])
        motions["x"], motions["y"], motions["heading"] = poses.T
        motions["vx"][:ROBOTS], motions["vy"][:ROBOTS] = np.cos(poses[:ROBOTS, 2]), np.sin(poses[:ROBOTS, 2])
        at = FLOOR if time % 2 else ""
        cabins = {name: ElevatorState(0.0, at, Doors.OPENING, 0.5, (), ()) for name in building.elevators}
        view = FloorView(FLOOR)
        view.apply(FloorUpdate(FLOOR, 0, 1, float(time), 1, bodies, [], motions, cabins))
        scans = scene.scan(poses[:LASERS], LASER)
        fans = [
            LastScan("R", float(time), Pose(FLOOR, *pose), LASER.first_rad, LASER.step_rad, distances)
            for pose, distances in zip(poses[:LASERS].tolist(), scans, strict=True)
        ]
        found.append((view, fans))
    return found


def by_matplotlib(building: Building) -> None:
    draw_floor(building, FLOOR, width_px=WIDTH_PX).save(io.BytesIO(), "PNG", compress_level=1)


def main() -> bool:
    building = load_sample("five-floors")
    painter, states = FloorPainter(building), floor_states(building)
    _, first_ms = timed_ms(painter.png, *states[0], WIDTH_PX, "")
    took: dict[str, list[float]] = {"ours": [], "matplotlib, without robots": []}
    for view, fans in states * ROUNDS:
        png, ms = timed_ms(painter.png, view, fans, WIDTH_PX, f"five-floors · {FLOOR}   {view.time:.2f} s")
        took["ours"].append(ms)
    for _ in range(FEW):
        took["matplotlib, without robots"].append(timed_ms(by_matplotlib, building)[1])
    columns = ("median ms", "p99 ms", "worst ms")
    rows = [{"by": what, "pictures": len(ms), **summary(ms, *columns)} for what, ms in took.items()]
    rows.append({"by": "ours, first of a floor", "pictures": 1, "median ms": first_ms})
    marks = [at_most("a picture, median ms", statistics.median(took["ours"]), MAX_MS)]
    title = f"{ROBOTS} robots and {LASERS} lasers, {WIDTH_PX} pixels wide, {len(png) / 1000:.0f} kB"
    return summarize("render", title, rows, marks, took, "ms")


if __name__ == "__main__":
    run(main)
