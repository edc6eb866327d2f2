"""An operator's day in a real browser, by clicks and keys alone: draw a building, start robots, build, repair and run a
program, start and abort a mission, look back; and what the pages make of killed servers and of hostile names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from robocorba.maps import native
from robocorba.maps.model import Building
from robocorba.testing.processes import Running, running_system

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytest.importorskip("playwright", reason="playwright, which moves the browser, is not installed")

from playwright.sync_api import Locator, expect

from tests.system.browser import Operator, chromium, operator

BROWSER = chromium()
pytestmark = [
    pytest.mark.system,
    pytest.mark.slow,
    pytest.mark.skipif(not BROWSER, reason="there is no chromium on this machine"),
]

#: The ground of both floors [m].
CORNERS = ((0.0, 0.0), (10.0, 0.0), (10.0, 7.0), (0.0, 7.0))
#: Where robots begin on L1, and where one drives to on L2 [m].
START = {"R1": (1.5, 2.0), "R2": (1.5, 5.8)}
GOAL = (3.0, 1.5)
MODES = ("smoothed", "topological", "geometric")
#: A table whose name would run a script if a page took it for HTML, with a quote and letters from right to left.
TABLE = "<img src=x onerror=alert(1)> \"\u05d0\u0628'"


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("browser")
    native.save(Building("house"), folder / "house.yaml")
    options = ("--building", str(folder / "house.yaml"), "--console", "--console-port", "0")
    with running_system(folder, *options) as (running, _):
        yield running


@pytest.fixture(scope="module")
def user(system: Running) -> Iterator[Operator]:
    assert BROWSER
    line = next(line for line in system.printed if line.startswith("console\t"))
    with operator(BROWSER, line.split("\t")[-1]) as user:
        yield user


# ---- map ----


def draw_building(user: Operator) -> None:
    user.open("Map")
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    element = page.get_by_label("Panel").locator("h2")
    add_floor = user.button("Add a floor")

    add_floor.click()
    expect(element).to_have_text("floor L1")
    user.press("o")
    user.click_map(canvas, *CORNERS)
    user.press("Enter")
    expect(page.get_by_label("outline 4 x")).to_be_visible()
    user.press("0", "r")
    user.click_map(canvas, CORNERS[0], CORNERS[2])
    expect(element).to_have_text("wall w4")

    add_floor.click()
    expect(element).to_have_text("floor L2")
    expect(canvas).to_have_attribute("data-floor", "L2")
    user.click_map(canvas, CORNERS[0], CORNERS[2])
    expect(element).to_have_text("wall w4")
    user.press("l")
    user.click_map(canvas, (8.5, 5.5))
    expect(element).to_have_text("elevator E1")
    for floor in ("L2", "L1"):
        user.tab(floor)
        user.press("Escape", "Escape")
        user.button("Generate roads").click()
        expect(page.get_by_text("roads generated")).to_be_visible()


def put_table(user: Operator) -> None:
    """A table with a hostile name."""
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    user.press("b")
    page.get_by_label("movable").first.check()
    user.click_map(canvas, (2.5, 4.0), (3.5, 4.75))
    expect(page.get_by_label("Panel").locator("h2")).to_have_text("object item 1")
    user.press("Escape")
    name = page.get_by_label("Panel").get_by_label("name", exact=True)
    name.fill("table\u200f")
    name.press("Enter")
    expect(page.locator(".map-message")).to_contain_text("U+200F")
    name.fill(TABLE)
    name.press("Enter")
    expect(page.get_by_label("Panel").locator("h2")).to_have_text(f"object {TABLE}")


def check_and_plan(user: Operator) -> None:
    """The findings, then a path by two clicks, from one floor to the other."""
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    user.tab("Findings")
    user.button("Check all floors").click()
    expect(page.get_by_text("Nothing found: a robot reaches every node.")).to_be_visible()
    user.tab("L1")
    canvas.focus()
    user.press("t")
    user.click_map(canvas, START["R1"])
    user.tab("L2")
    expect(canvas).to_have_attribute("data-floor", "L2")
    user.click_map(canvas, GOAL)
    paths = page.get_by_label("Paths", exact=True).get_by_role("radio")
    expect(paths).to_have_text([re.compile(rf"{mode}\d+\.\d+ m, .* s, \d+ points") for mode in MODES])
    user.press("Escape", "Escape")


# ---- monitor ----


def start_robots(user: Operator) -> None:
    user.open("Monitor")
    page = user.page
    canvas = page.get_by_label(re.compile("Floor L1"))
    processes = page.get_by_label("Processes")
    user.tab("Processes")
    for name, at in START.items():
        processes.get_by_label("New robot").fill(name)
        processes.get_by_label("channel").select_option("main")
        user.button("first free place", processes).click()
        user.click_map(canvas, at)
        expect(user.button(re.compile(rf"{at[0]:.1f}\d, {at[1]:.1f}\d m"), processes)).to_be_visible()
        user.button("Start", processes).click()
        expect(processes.get_by_role("row", name=f"robot_{name}")).to_contain_text("starting")
    for name in START:
        expect(processes.get_by_role("row", name=f"robot_{name}")).to_contain_text("ready")
    user.tab("Robots")
    for name, at in START.items():
        expect(robot_row(user, name)).to_contain_text("idle")
        user.click_map(canvas, at)
        expect(robot_row(user, name)).to_have_attribute("aria-selected", "true")
        expect(fact(user, "pose")).to_have_text(re.compile(rf"L1: {at[0]:.1f}\d m, {at[1]:.1f}\d m, 0°"))


def robot_row(user: Operator, name: str) -> Locator:
    """The row of a robot in the monitor's table."""
    return user.page.locator(".robot-table tr").filter(has_text=name)


def fact(user: Operator, name: str) -> Locator:
    """A value of the selected robot, on the monitor or in 3D."""
    return user.page.locator(f".console-facts dt:text-is('{name}') + dd")


def test_story(user: Operator) -> None:
    draw_building(user)
    put_table(user)
    check_and_plan(user)
    start_robots(user)
    assert not user.troubles
