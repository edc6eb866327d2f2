"""An operator's day in a real browser, by clicks and keys alone: draw a building, start robots, build, repair and run a
program, start and abort a mission, look back; and what the pages make of killed servers and of hostile names."""

from __future__ import annotations

import contextlib
import os
import re
import signal
from collections.abc import Iterator

import pytest

from robocorba.maps import native
from robocorba.maps.model import Building
from robocorba.testing.processes import Running, running_system

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytest.importorskip("playwright", reason="playwright, which moves the browser, is not installed")

from playwright.sync_api import Locator, expect

from robocorba.testing.browser import chromium
from tests.system.browser import Operator, operator

BROWSER = chromium()
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.slow,
    pytest.mark.skipif(not BROWSER, reason="there is no chromium on this machine"),
]

#: The ground of both floors [m].
CORNERS = ((0.0, 0.0), (10.0, 0.0), (10.0, 7.0), (0.0, 7.0))
#: Names that would run a script if a page took them for HTML, with quotes and letters from right to left.
TABLE = "<img src=x onerror=alert(1)> \"\u05d0\u0628'"
PROGRAM = "<img src=x onerror=alert(2)> '\u200f\""
#: Where robots begin on L1, and where one drives to on L2 [m].
START = {"R1": (3.5, 2.5), "R2": (1.0, 6.0)}
GOAL = (6.0, 3.0)
MODES = ("smoothed", "topological", "geometric")

#: Notes what the page's status says from now on.
SEE_STATUS = """() => {
  const status = document.querySelector(".console-status");
  window.seen = [];
  const observer = new MutationObserver(() => window.seen.push(status.textContent));
  observer.observe(status, { childList: true, characterData: true, subtree: true });
}"""


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
    with operator(BROWSER, system.record().console_address) as user:
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
    user.press("r")
    user.click_map(canvas, CORNERS[0], CORNERS[2])
    expect(element).to_have_text("area room 1")

    add_floor.click()
    expect(element).to_have_text("floor L2")
    expect(canvas).to_have_attribute("data-floor", "L2")
    user.click_map(canvas, CORNERS[0], CORNERS[2])
    expect(element).to_have_text("area room 1")
    user.press("l")
    user.click_map(canvas, (5.0, 5.5))
    expect(element).to_have_text("elevator E1")
    page.get_by_label("door time").fill("0.5")
    with page.expect_response("**/call/map_edit"):
        user.press("Enter")
    user.tab("L1")


def put_table(user: Operator) -> None:
    """A table with a hostile name."""
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    user.press("b")
    page.get_by_label("movable").first.check()
    user.click_map(canvas, (1.5, 3.75), (2.5, 4.5))
    expect(page.get_by_label("Panel").locator("h2")).to_have_text("object box 1")
    user.press("Escape")
    name = page.get_by_label("Panel").get_by_label("name", exact=True)
    name.fill("table\u200f")
    name.press("Enter")
    expect(page.locator(".map-message")).to_contain_text("U+200F")
    name.fill(TABLE)
    name.press("Enter")
    expect(page.get_by_label("Panel").locator("h2")).to_have_text(f"object {TABLE}")


def check_and_plan(user: Operator) -> None:
    """Roads, what is wrong with them, and a path by two clicks, from one floor to the other."""
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    for floor in ("L1", "L2"):
        user.tab(floor)
        user.press("Escape", "Escape")
        with page.expect_response("**/call/map_build_roads"):
            user.button("Generate roads").click()
        expect(page.get_by_text("roads generated")).to_be_visible()
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
    expect(paths).to_have_text([re.compile(rf"{mode}\d+\.\d+ m, \d+ points") for mode in MODES])
    user.press("Escape", "Escape")


# ---- monitor ----


def start_robots(user: Operator) -> None:
    user.open("Monitor")
    page = user.page
    user.tab(re.compile("^L1"))  # the page shows the floor that was edited last
    canvas = page.get_by_label(re.compile("Floor L1"))
    processes = page.get_by_label("Processes")
    user.tab("Processes")
    processes.get_by_label("New robot").fill(TABLE)
    user.button("Start", processes).click()
    expect(processes.get_by_role("alert")).to_contain_text("<img src=x onerror=alert(1)>")
    for name, at in START.items():
        processes.get_by_label("New robot").fill(name)
        processes.get_by_label("channel").select_option("main")
        user.button(re.compile("Pick its place"), processes).click()
        user.click_map(canvas, at)
        expect(processes.get_by_text(re.compile(rf"{at[0]:.1f}\d, {at[1]:.1f}\d m"))).to_be_visible()
        user.button("Start", processes).click()
        expect(processes.get_by_role("row", name=f"robot_{name}")).to_be_visible()
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
    return user.page.locator(f".robot-table tr:has(td:first-child:text-is('{name}'))")


def fact(user: Operator, name: str) -> Locator:
    """A value of the selected robot, on the monitor or in 3D."""
    return user.page.locator(f".console-facts dt:text-is('{name}') + dd")


# ---- program ----


def build_program(user: Operator) -> None:
    """Every kind of icon once, with what each needs."""
    user.open("Program")
    page = user.page
    page.get_by_label("Robot", exact=True).select_option("R1")
    page.get_by_label("Name of the program").fill(PROGRAM)
    add(user, "mhand_posture", hand="left", posture="ready", seconds="0.5")
    add(user, "mhand_offset", hand="left", dz="0.05", seconds="0.5")
    add(user, "mhand_pose")
    user.button("As R1 stands").click()
    add(user, "mhand_joints")
    user.button("As R1 stands").click()
    add(user, "lumbar", lower="4", upper="4", seconds="0.5")
    add(user, "gripper", hand="left", action="open")
    add(user, "wait_until", kind="farther_than", sensor="front", distance="0.1", seconds="5")
    add(user, "stop_if_closer", sensor="front", distance="0.05")
    add(user, "mbase_by", ahead="0.25")
    select(user, "stop_if_closer")
    add(user, "repeat", times="2")
    add(user, "mbase_velocity", ahead="0.2", left="0", turn="0", seconds="0.5")
    select(user, "repeat")
    add(user, "branch", kind="result", result="done")
    add(user, "say", type="hello")
    select(user, "branch")
    add(user, "mbase_to", x="5", y="3")
    add(user, "move_table", table=TABLE)
    user.click_map(target_map(user), (7.5, 2.0))
    add(user, "hand_over", object=TABLE, taker="R2")
    add(user, "mbase_path")
    page.get_by_label("Target on the map").get_by_role("tab", name="L2").click()
    user.click_map(target_map(user), (CORNERS[1][0], 2.0))
    page.locator(".program-palette [data-icon=wait]").drag_to(
        card(user, "mhand_posture"), target_position={"x": 30, "y": 2}
    )
    set_fields(user, seconds="0.2")
    kinds = page.locator(".program-palette [data-icon]").evaluate_all("all => all.map((each) => each.dataset.icon)")
    built = page.locator(".icon-card").evaluate_all("all => all.map((each) => each.dataset.icon)")
    assert sorted(built) == sorted(kinds)
    assert built[0] == "wait"


def card(user: Operator, icon: str) -> Locator:
    """The card of an icon in the program."""
    return user.page.locator(f".icon-card[data-icon={icon}]")


def target_map(user: Operator) -> Locator:
    return user.page.get_by_label("Target on the map").locator("canvas")


def add(user: Operator, icon: str, **values: str) -> None:
    """Click an icon of the palette and fill its fields."""
    user.page.locator(f".program-palette [data-icon={icon}]").click()
    expect(card(user, icon)).to_have_attribute("aria-pressed", "true")
    set_fields(user, **values)


def set_fields(user: Operator, **values: str) -> None:
    form = user.page.locator(".icon-form")
    for name, value in values.items():
        field = form.get_by_label(re.compile(rf"^{name}\b"))
        if field.evaluate("field => field.tagName") == "SELECT":
            field.select_option(value)
        else:
            field.fill(value)


def select(user: Operator, icon: str) -> None:
    card(user, icon).click()
    expect(card(user, icon)).to_have_attribute("aria-pressed", "true")


def repair_program(user: Operator) -> None:
    """The checker refuses the angle of a joint and a goal in a wall. Missions, which take minutes, are taken out."""
    page = user.page
    expect(card(user, "lumbar")).to_have_class(re.compile("is-incomplete"))
    select(user, "lumbar")
    set_fields(user, lower="0")
    expect(page.locator(".program-verdict")).to_contain_text("not possible")
    expect(card(user, "mbase_path")).to_have_class(re.compile("is-refused"))
    select(user, "mbase_path")
    user.click_map(target_map(user), GOAL)
    for icon in ("move_table", "hand_over"):
        select(user, icon)
        user.press("Delete")
        expect(card(user, icon)).to_have_count(0)
    expect(page.locator(".program-verdict")).to_contain_text(re.compile(r"\bchecked\b"))


# ---- run ----


def run_program(user: Operator) -> None:
    """Icons are lit while they run; the robot is on its way when the user goes to another page."""
    user.button("Run").click()
    expect(user.page.locator(".icon-card.is-running")).to_have_count(1)
    expect(card(user, "mbase_path")).to_have_class(re.compile("is-running"))
    for icon in ("mhand_posture", "say", "mbase_velocity"):
        expect(card(user, icon)).to_have_class(re.compile("is-done"))


def watch_in_2d(user: Operator) -> None:
    """It leaves L1 with the elevator, and arrives on L2."""
    user.open("Monitor")
    page = user.page
    robot_row(user, "R1").click()
    expect(robot_row(user, "R1")).to_contain_text("running")
    expect(robot_row(user, "R1")).to_contain_text(PROGRAM)
    expect(fact(user, "speed")).not_to_contain_text("0.00 m/s")
    user.press("f")
    expect(page.get_by_label("Floors").get_by_role("tab", selected=True)).to_contain_text("L2")
    expect(robot_row(user, "R1")).to_contain_text("idle")
    expect(fact(user, "pose")).to_contain_text(f"L2: {GOAL[0]:.1f}")
    user.press("f", "0", "Escape")
    expect(robot_row(user, "R1")).to_have_attribute("aria-selected", "false")
    user.click_map(page.get_by_label(re.compile("Floor L2")), GOAL)
    expect(robot_row(user, "R1")).to_have_attribute("aria-selected", "true")


def watch_in_3d(user: Operator) -> None:
    """The camera goes to the robot: then a click in the middle of the picture is one on the robot."""
    user.open("3D")
    page = user.page
    robot = page.get_by_label("Robot", exact=True)
    robot.select_option("R1")
    expect(fact(user, "at")).to_contain_text(f"L2 {GOAL[0]:.1f}")
    user.button("Follow the robot").click()
    canvas = page.locator(".console-scene canvas")
    robot.select_option("none")
    expect(page.locator(".scene-facts")).to_have_count(0)
    canvas.click()
    expect(robot).to_have_value("R1")


# ---- missions, the past ----


def start_and_abort_mission(user: Operator) -> None:
    user.open("Missions")
    page = user.page
    form = page.get_by_role("form", name="Start a mission")
    form.get_by_label(re.compile("^leader")).select_option("R2")
    form.get_by_label(re.compile("^object")).select_option(f"{TABLE} (L1)")
    user.click_map(form.locator("canvas"), (7.5, 2.0))
    user.button("Start", form).click()
    row = page.locator(".missions-list tbody tr").first
    expect(row).to_contain_text("running")
    expect(row).to_contain_text(TABLE)
    expect(page.locator(".gantt-name", has_text="gathering")).to_be_visible()
    user.button("Abort").click()
    expect(row).to_contain_text("aborted")
    expect(page.locator(".missions-detail .missions-reason")).not_to_be_empty()
    user.button("Report").click()
    expect(page.locator(".mission-report")).to_contain_text("aborted")


def look_back(user: Operator) -> None:
    """The moments before the mission and before the program, when the robot was still on L1, and back to now."""
    user.open("Monitor")
    page = user.page
    user.tab("Events")
    events, note = page.get_by_label("Events", exact=True), page.locator(".scene-note")
    user.button(re.compile("mission .* has begun"), events).click()
    expect(note).to_contain_text("past")
    user.button(re.compile("R1 runs .*<img"), events).click()
    expect(page.locator(".time-text")).to_contain_text("ago")
    user.tab(re.compile("^L1"))
    user.tab("Robots")
    user.press("Escape")
    canvas = page.get_by_label(re.compile("Floor L1"))
    expect(canvas).to_have_attribute("data-floor", "L1")
    user.click_map(canvas, START["R1"])
    expect(robot_row(user, "R1")).to_have_attribute("aria-selected", "true")
    user.button("Live").click()
    expect(note).to_have_count(0)
    expect(page.locator(".time-text")).to_contain_text("now")


# ---- killed servers ----


@contextlib.contextmanager
def killed(user: Operator, system: Running, server: str) -> Iterator[None]:
    """Kill a server; the page says so. At the end of the `with` it is there again: the page has gone on by itself."""
    page = user.page
    page.evaluate(SEE_STATUS)
    os.kill(system.pid(server), signal.SIGKILL)
    page.wait_for_function("() => window.seen.some((text) => /answer|reachable/.test(text))")
    yield
    expect(page.locator(".console-status")).to_contain_text("robots")
    assert page.evaluate("() => window.seen.length"), "the page was loaded again"


def kill_map_editor(user: Operator, system: Running) -> None:
    """Not even a half-drawn wall is lost."""
    user.open("Map")
    page = user.page
    canvas = page.get_by_label(re.compile("Map of floor"))
    expect(canvas).to_have_attribute("data-floor", "L1")
    user.press("w")
    user.click_map(canvas, (4.0, 0.0))
    with killed(user, system, "map_editor"):
        pass
    expect(page.locator(".console-overlay")).to_have_count(0)
    user.click_map(canvas, (4.0, 1.0))
    user.press("Enter")
    expect(page.get_by_label("Panel").locator("h2")).to_have_text("wall w5")


def kill_simulation(user: Operator, system: Running) -> None:
    """The robots log on again, and are where they were."""
    user.open("Monitor")
    robot_row(user, "R1").click()
    before = fact(user, "pose").text_content()
    assert before
    with killed(user, system, "simulation"):
        pass
    for name in START:
        expect(robot_row(user, name)).to_contain_text("idle")
    expect(fact(user, "pose")).to_have_text(before)


def kill_console(user: Operator, system: Running) -> None:
    """What was typed stays."""
    user.tab("Processes")
    field = user.page.get_by_label("New robot")
    field.fill("R3")
    with killed(user, system, "console"):
        pass
    expect(field).to_have_value("R3")
    expect(user.page.get_by_role("row", name="console")).to_contain_text("ready")


# ---- tests ----


def test_an_operator_draws_a_building(user: Operator) -> None:
    with user.telling():
        draw_building(user)
        put_table(user)
        check_and_plan(user)
    assert not user.troubles


def test_the_operator_programs_robots(user: Operator) -> None:
    """In the building of the test above."""
    with user.telling():
        start_robots(user)
        build_program(user)
        repair_program(user)
        run_program(user)
    assert not user.troubles


def test_the_operator_watches_and_looks_back(user: Operator) -> None:
    """The robots of the test above."""
    with user.telling():
        watch_in_2d(user)
        watch_in_3d(user)
        start_and_abort_mission(user)
        look_back(user)
    assert user.page.locator("img[src=x]").count() == 0
    assert not user.troubles


def test_pages_outlive_killed_servers(user: Operator, system: Running) -> None:
    """On the building and with the robots of the tests above."""
    with user.telling():
        kill_map_editor(user, system)
        kill_simulation(user, system)
    assert not user.troubles
    kill_console(user, system)
    assert all(re.search("net::ERR_|WebSocket", trouble) for trouble in user.troubles)
