"""Time to render a floor with 50 robots and 8 lasers, compared with encoding alone and with matplotlib.

python -m bench.simulation.render
"""

from __future__ import annotations

import io
import math
import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from PIL import Image

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
from testkit.report import at_most, distribution, summarize, summary, timed_ms

FLOOR, WIDTH_PX = "L1", 1200
ROBOTS, LASERS, RADIUS_M = 50, 8, 0.4
#: Different states of the floor, and pictures of each.
STATES, ROUNDS = 30, 10
#: Rounds with matplotlib; it is slow.
FEW = 5
MAX_MS = 30.0


def floor_states(building: Building) -> list[tuple[FloorView, list[LastScan]]]:
    """States of the floor: robots at free places, objects near their places on the map, and scans."""
    chance = np.random.default_rng(1)
    space = free_space(building, FLOOR, RADIUS_M)
    shapely.prepare(space)
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
        poses = np.column_stack([_free(space, ROBOTS, chance), chance.uniform(-math.pi, math.pi, ROBOTS)])
        poses = np.vstack([poses, places + chance.normal(0.0, 0.2, places.shape)])
        motions["x"], motions["y"], motions["heading"] = poses.T
        speed = chance.uniform(0.0, 1.0, ROBOTS)
        motions["vx"][:ROBOTS] = speed * np.cos(poses[:ROBOTS, 2])
        motions["vy"][:ROBOTS] = speed * np.sin(poses[:ROBOTS, 2])
        cabins = {
            name: ElevatorState(0.0, FLOOR if time % 2 else "", Doors.OPENING, 0.5, (), ())
            for name in building.elevators
        }
        view = FloorView(FLOOR)
        view.apply(FloorUpdate(FLOOR, 0, 1, float(time), 1, bodies, [], motions, cabins))
        scans = scene.scan(poses[:LASERS], LASER)
        fans = [
            LastScan("R", float(time), Pose(FLOOR, *pose), LASER.first_rad, LASER.step_rad, distances)
            for pose, distances in zip(poses[:LASERS].tolist(), scans, strict=True)
        ]
        found.append((view, fans))
    return found


def _free(space: shapely.Geometry, count: int, chance: np.random.Generator) -> np.ndarray:
    x0, y0, x1, y1 = space.bounds
    points = chance.uniform((x0, y0), (x1, y1), (100 * count, 2))
    return points[shapely.contains_xy(space, points)][:count]


def encode(picture: Image.Image) -> int:
    """Encode a picture as FloorPainter does; return its size [bytes]."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=1)
    return buffer.tell()


def main() -> bool:
    building = load_sample("five-floors")
    painter, states = FloorPainter(building), floor_states(building)
    png, first_ms = timed_ms(painter.png, *states[0], WIDTH_PX, "")
    took: dict[str, list[float]] = {}

    def measure(what: str, call: Callable[..., Any], *arguments: object) -> Any:
        answer, ms = timed_ms(call, *arguments)
        took.setdefault(what, []).append(ms)
        return answer

    for round_ in range(ROUNDS):
        for view, fans in states:
            caption = f"five-floors · {FLOOR}   {round_ + view.time:.2f} s   {ROBOTS} robots   1234 events/s"
            png = measure("ours", painter.png, view, fans, WIDTH_PX, caption)
            picture = Image.open(io.BytesIO(png))
            picture.load()
            measure("encoding alone", encode, picture)
            if view.time == 0:
                measure("encoding true colours", encode, picture.convert("RGB"))
        if round_ < FEW:
            measure("matplotlib, without robots", lambda: encode(draw_floor(building, FLOOR, width_px=WIDTH_PX)))
    columns = ("median ms", "p99 ms", "worst ms")
    rows = [{"by": what, "pictures": len(ms), **summary(ms, *columns)} for what, ms in took.items()]
    rows.append({"by": "ours, first of a floor", "pictures": 1, **dict.fromkeys(columns), "median ms": first_ms})
    marks = [at_most("a picture, median ms", statistics.median(took["ours"]), MAX_MS)]
    title = f"{ROBOTS} robots and {LASERS} lasers, {WIDTH_PX} pixels wide, {len(png) / 1000:.0f} kB"
    draw = distribution(took, "milliseconds", "share of pictures that took less")
    return summarize("render", title, rows, marks, draw)


if __name__ == "__main__":
    run(main)
