"""Deviation between a virtual and an actual robot that run the same program, in each tick and at the end.

    python -m bench.robots.virtual_and_actual --runs 3

The sample program both-floors runs in the sample building five-floors. Each run has its own servers, so that the
elevator starts on the same floor, and each actual run its own stand-in with another noise seed. Both robots record
every tick (`robocorba robot --record`). Ticks are compared icon by icon, at the same time since the icon began; a robot
that ends an icon first counts as staying there. A program that does not end done ends the bench."""

from __future__ import annotations

import contextlib
import csv
import itertools
import math
import tempfile
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from bench.common.harness import run
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState, ProgramResult
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import JOINTS, Side
from robocorba.robot.programs import program
from robocorba.robot.programs.icons import kind
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from testkit.actual_robot import running_stand_in
from testkit.processes import Launcher, drain, real_system
from testkit.report import PROGRESS, Mark, at_most, quantile, summarize, write_csv
from testkit.virtual_and_actual import BASE_M, HAND_M, TURNED_RAD, StateDifference, difference, robot_process

NAME, ROBOT = "virtual_and_actual", "A"
SAMPLES = Path(str(files("robocorba") / "samples"))
BUILDING, PROGRAM = SAMPLES / "five-floors.yaml", SAMPLES / "both-floors.json"
WHERE = ("--floor", "L1", "--at", "17,7.5,1.57", "--channel", "main")
#: Columns of the pose in a row of ticks.
PLACE = ("x", "y", "heading")
MM = 1000.0


class Part(NamedTuple):
    """An icon of a run. seconds (n,): since it began. places (n, 3): x, y [m], heading [rad]. joints (n, 18) [rad]."""

    icon: str
    seconds: Floats
    places: Floats
    joints: Floats

    def at(self, seconds: Floats) -> tuple[Floats, Floats]:
        """Interpolated places and joints; the last ones after the icon's end."""

        def read(columns: Floats) -> Floats:
            return np.stack([np.interp(seconds, self.seconds, column) for column in columns.T], axis=1)

        turning = self.places.copy()
        turning[:, 2] = np.unwrap(turning[:, 2])
        return read(turning), read(self.joints)


def main(runs: int = 3) -> bool:
    body = SmartPalBody()
    ends: list[StateDifference] = []
    parts: list[tuple[list[Part], list[Part]]] = []
    with tempfile.TemporaryDirectory() as folder, claimed_ports() as port, Orb(Address("127.0.0.1", port)) as orb:
        for number in range(1, runs + 1):
            with PROGRESS.status(f"run {number} of {runs}"):
                (virtual, virtual_parts), (actual, actual_parts) = (
                    one_run(Path(folder) / f"{number}-{adaptor}", port, orb, adaptor, number)
                    for adaptor in ("simulated", "smartpal")
                )
            ends.append(difference(virtual, actual, body))
            parts.append((virtual_parts, actual_parts))
    ticks = [tick for number, (one, other) in enumerate(parts, 1) for tick in compared(number, one, other, body)]
    write_csv(f"{NAME}_ticks", ticks)
    title = f"{PROGRAM.stem} on a virtual and on an actual robot, runs: {runs}; differences in mm and degrees"
    return summarize(NAME, title, rows(ticks, parts, ends), marks(ends), partial(draw, ticks))


# ---- a run ----


def one_run(folder: Path, port: int, orb: Orb, adaptor: str, seed: int) -> tuple[AgentState, list[Part]]:
    """The robot's last state, and the icons of its run."""
    folder.mkdir()
    with Launcher(folder) as launch, contextlib.ExitStack() as stack:
        running = real_system(launch, folder / "state", port, "--building", str(BUILDING)).wait_ready()
        drain(running.process)
        stack.callback(running.stop)
        arguments = [*WHERE, "--record", "ticks.csv"]
        if adaptor == "smartpal":
            actual = stack.enter_context(running_stand_in(folder, "--seed", str(seed), orb=orb))
            arguments += ["--adaptor", "smartpal", "--", "--naming", str(actual.naming)]
        robot = stack.enter_context(robot_process(folder, orb, ROBOT, *arguments))
        robot.robocorba("program", "run", str(PROGRAM), "--robot", ROBOT)
        state = robot.agent.state()
        assert (state.adaptor, state.program.result) == (adaptor, ProgramResult.DONE)
        return state, parts_of(folder / "ticks.csv")


def parts_of(file: Path) -> list[Part]:
    """The icons of one run, from its tick file; nested icons instead of the icons that contain them."""
    found: list[Part] = []
    with file.open(newline="") as lines:
        for (icon, _), rows in itertools.groupby(csv.DictReader(lines), lambda row: (row["icon"], row["icons_done"])):
            numbers = np.array([[float(row[name]) for name in ("time", *PLACE, *JOINTS)] for row in rows])
            if found and icon.startswith(f"{found[-1].icon}."):
                found.pop()  # the containing icon, before its first nested one
            found.append(Part(icon, numbers[:, 0] - numbers[0, 0], numbers[:, 1:4], numbers[:, 4:]))
    return found


# ---- differences ----


def compared(run: int, virtual: list[Part], actual: list[Part], body: SmartPalBody) -> list[dict[str, Any]]:
    """A row for each tick of the robot that took longer for an icon."""
    found, began_s = [], 0.0
    kinds = {path: kind(icon) for path, icon in program.icons_with_paths(program.load(PROGRAM))}
    for one, other in zip(virtual, actual, strict=True):
        assert one.icon == other.icon
        seconds = max(one, other, key=lambda part: float(part.seconds[-1])).seconds
        (places, joints), (other_places, other_joints) = one.at(seconds), other.at(seconds)
        for row in range(len(seconds)):
            turned = math.remainder(places[row, 2] - other_places[row, 2], math.tau)
            beside = np.hypot(*(one.places[:, :2] - other_places[row, :2]).T).min()
            hands = {side: _hand_mm(body, side, joints[row], other_joints[row]) for side in Side}
            found.append(
                {
                    "run": run,
                    "icon": one.icon,
                    "kind": kinds[one.icon],
                    "program_s": round(began_s + seconds[row], 4),
                    "icon_s": round(seconds[row], 4),
                    **{f"virtual_{name}": round(value, 6) for name, value in zip(PLACE, places[row], strict=True)},
                    **{f"actual_{name}": round(value, 6) for name, value in zip(PLACE, other_places[row], strict=True)},
                    "base_mm": round(math.dist(places[row, :2], other_places[row, :2]) * MM, 3),
                    "beside_way_mm": round(float(beside) * MM, 3),
                    "turned_deg": round(abs(math.degrees(turned)), 4),
                    "left_hand_mm": round(hands[Side.LEFT], 3),
                    "right_hand_mm": round(hands[Side.RIGHT], 3),
                    "joint_deg": round(math.degrees(np.abs(joints[row] - other_joints[row]).max()), 4),
                }
            )
        began_s += float(seconds[-1])
    return found


def _hand_mm(body: SmartPalBody, side: Side, joints: Floats, other: Floats) -> float:
    return math.dist(body.hand(side, joints).position, body.hand(side, other).position) * MM


def rows(
    ticks: list[dict[str, Any]], parts: list[tuple[list[Part], list[Part]]], ends: list[StateDifference]
) -> list[dict[str, Any]]:
    """A row for each icon over all runs, and one for the final states."""
    found = []
    for number, icon in enumerate(dict.fromkeys(tick["icon"] for tick in ticks)):
        here = [tick for tick in ticks if tick["icon"] == icon]
        virtual, actual = ([float(part[number].seconds[-1]) for part in each] for each in zip(*parts, strict=True))
        found.append(
            {
                "icon": f"{icon.replace('icons', '').replace('.', '')} {here[0]['kind']}",
                "ticks": len(here),
                "s virtual": quantile(virtual, 0.5),
                "s actual": quantile(actual, 0.5),
                **_spread("base", [tick["base_mm"] for tick in here]),
                "beside way most": max(tick["beside_way_mm"] for tick in here),
                "turned most": max(tick["turned_deg"] for tick in here),
                **_spread("hand", [max(tick["left_hand_mm"], tick["right_hand_mm"]) for tick in here]),
            }
        )
    last = {
        "icon": "at the end",
        "ticks": len(ends),
        **_spread("base", [end.base_m * MM for end in ends]),
        "turned most": max(math.degrees(end.turned_rad) for end in ends),
        **_spread("hand", [max(end.hands_m.values()) * MM for end in ends]),
    }
    return [*found, {column: last.get(column) for column in found[0]}]


def _spread(what: str, values: list[float]) -> dict[str, float]:
    return {f"{what} p50": quantile(values, 0.5), f"{what} p99": quantile(values, 0.99), f"{what} most": max(values)}


def marks(ends: list[StateDifference]) -> list[Mark]:
    base_m, hand_m = (max(end.base_m for end in ends), max(max(end.hands_m.values()) for end in ends))
    turned_deg = math.degrees(max(end.turned_rad for end in ends))
    return [
        at_most("bases at the end, mm", base_m * MM, BASE_M * MM),
        at_most("headings at the end, degrees", turned_deg, math.degrees(TURNED_RAD)),
        at_most("hands at the end, mm", hand_m * MM, HAND_M * MM),
    ]


def draw(ticks: list[dict[str, Any]], axes: Axes) -> None:
    """Plot the first run over time, with a line where each icon begins."""
    ticks = [tick for tick in ticks if tick["run"] == 1]
    seconds = [tick["program_s"] for tick in ticks]
    for name in ("base_mm", "beside_way_mm", "left_hand_mm", "right_hand_mm"):
        axes.plot(seconds, [max(tick[name], 0.01) for tick in ticks], label=name, linewidth=0.8)
    for tick in ticks:
        if tick["icon_s"] == 0.0:
            axes.axvline(tick["program_s"], color="grey", linewidth=0.5, alpha=0.6)
    axes.set(yscale="log", xlabel="s since the program began", ylabel="mm between virtual and actual")
    axes.legend(fontsize="small")


if __name__ == "__main__":
    run(main)
