"""An operator's day in a real browser, by clicks and keys alone: draw a building, start robots, build, repair and run a
program, start and abort a mission, look back; and what the pages make of killed servers and of hostile names."""

from __future__ import annotations

import contextlib
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from re import Pattern
from typing import Literal

import pytest

from robocorba.map_editor import native
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.processes import Running, eventually, running_system

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytest.importorskip("playwright", reason="playwright, which moves the browser, is not installed")

from playwright.sync_api import ConsoleMessage, Dialog, Locator, Page, expect

from testkit.browser import chromium, headless

BROWSER = chromium()
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.slow(220),
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

#: Whether places are apart from each other and from what stands at 0.2, 0; and who gets how many places of two robots,
#: and why not, where some are refused.
APART = """(a, i, all) => Math.hypot(a.x - 0.2, a.y) > 1
    && all.every((b, j) => i === j || Math.hypot(a.x - b.x, a.y - b.y) > 1.09)"""
TOGETHER = """drivesTogether([9, 1].map((x) => ({ name: x > 5 ? "A" : "B", at: { floor: "L1", x, y: 0 } })),
    { floor: "L1", x: 0, y: 0 }, [], async (robot, [goal]) => { if (%s) throw new Error("wall"); return []; })
    .then((drives) => drives.map(({ robot, goals, problem }) => [robot.name, goals.length, problem]))"""

#: A monitor with an idle robot on L1, which shows a floor; robots that are ordered, and how: C refuses.
JOG = "{ mayDrive: true, current: '%s', robot: { floor: 'L1', condition: 'idle' } }"
ORDERED = (
    """[{ name: "A" }, { name: "B" }, { name: "C" }], async (name) => { if (name !== "B") throw new Error(name); }"""
)

#: What pure functions of the pages answer: module, call, answer.
PURE = (
    ("target_ghost", "partAt([2, 0], [[-1, -1], [1, -1], [1, 1], [-1, 1]], { x: 0, y: 0, heading: 0 }, 24)", "tip"),
    ("texts", "durationText(3 * 3600 + 61)", "3 h 1 min"),
    ("texts", "whenText(0, new Date(3e9)).length > m.whenText(0, new Date(0)).length", True),
    ("jog_pad", "jogVelocity([0, 1, 0], Math.PI / 2, 0.2).ahead", 0.2),
    ("jog_pad", "jogVelocity([3, 4, 0], Math.PI, 0.5).left.toFixed(6)", "-0.400000"),
    ("monitor", f"default.computed.mayJog.call({JOG % 'L2'})", False),  # it is not seen there
    ("robot_panel", f"orderEach({ORDERED})", ["A: A", "C: C"]),
    ("drive_together", "placesAround({ x: 1, y: 2 }, [0.4, 0.3], []).length", 37),
    (
        "drive_together",
        f"placesAround({{ x: 0, y: 0 }}, [0.4, 0.3], [{{ x: 0.2, y: 0, radius: 0.3 }}]).every({APART})",
        True,
    ),
    ("drive_together", TOGETHER % "goal.x < 0.5", [["B", 1, ""], ["A", 1, ""]]),
    ("drive_together", TOGETHER % "true", [["B", 0, "wall"], ["A", 0, "wall"]]),
    ("happening_feed", "titled({ text: 'A runs mission (1.2' }, [{ name: '(1', kind: 'x', begun: 0 }]).mission", "(1"),
)

#: Timeout of every wait, for busy machines [s].
LIMIT_S = 120.0


class Operator:
    """A user who only clicks, types and looks. `troubles` holds what went wrong in the browser: exceptions, console
    errors, dialogs."""

    def __init__(self, page: Page, address: str) -> None:
        self.page, self.address = page, address
        self.troubles: list[str] = []
        page.on("pageerror", lambda error: self.troubles.append(f"exception: {error}"))
        page.on("console", self._note)
        page.on("dialog", self._dismiss)

    def _note(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.troubles.append(f"console: {message.text} {message.location.get('url', '')}")

    def _dismiss(self, dialog: Dialog) -> None:
        self.troubles.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    # ---- anywhere ----

    def another_page(self) -> Page:
        """In the same browser, as of another person."""
        assert self.page.context.browser
        page = self.page.context.browser.new_page(locale="en-GB")
        page.set_default_timeout(1000 * LIMIT_S)
        return page

    def open(self, title: str) -> None:
        """Open a page by the navigation; the first one by the address."""
        if self.page.url == "about:blank":
            self.page.goto(self.address)
        self.page.get_by_label("Pages").get_by_role("link", name=title).click()
        expect(self.page.get_by_label("Pages").locator("[aria-current=page]")).to_contain_text(title)
        expect(self.page.locator(".console-status")).to_contain_text("robots")

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def button(self, name: str | Pattern[str], within: Locator | None = None) -> Locator:
        where = within or self.page.locator("body")
        return where.get_by_role("button", name=name, exact=isinstance(name, str))

    def tab(self, name: str | Pattern[str]) -> None:
        """Choose a tab."""
        chosen = self.page.get_by_role("tab", name=name)
        chosen.click()
        expect(chosen).to_have_attribute("aria-selected", "true")

    @contextlib.contextmanager
    def telling(self) -> Iterator[None]:
        """Print what is on the page if the test fails within the `with`."""
        try:
            yield
        except BaseException:
            print(self.page.url, self.troubles, self.page.locator("body").aria_snapshot(), sep="\n")
            raise

    # ---- maps ----

    @property
    def map(self) -> Locator:
        """The canvas of the page Map."""
        return self.page.get_by_label(re.compile("Map of floor"))

    def pixel(self, canvas: Locator, x: float, y: float) -> tuple[float, float]:
        """Where a point of the floor [m] is on a canvas [px]."""
        expect(canvas).to_have_attribute("data-scale", re.compile(r"\d"))
        self.page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
        box = canvas.bounding_box()
        assert box is not None
        scale = float(canvas.get_attribute("data-scale") or "")
        centre_x, centre_y = map(float, (canvas.get_attribute("data-centre") or "").split())
        return box["width"] / 2 + (x - centre_x) * scale, box["height"] / 2 - (y - centre_y) * scale

    def click_map(
        self, canvas: Locator, *points: tuple[float, float], button: Literal["left", "right"] = "left"
    ) -> None:
        """Click points of the shown floor [m]."""
        for x, y in points:
            px, py = self.pixel(canvas, x, y)
            canvas.click(position={"x": px, "y": py}, button=button)

    def drag_map(self, canvas: Locator, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag from one point of the shown floor to another one [m]."""
        (x0, y0), (x1, y1) = (self.pixel(canvas, *point) for point in (begin, end))
        canvas.drag_to(canvas, source_position={"x": x0, "y": y0}, target_position={"x": x1, "y": y1})

    # ---- map ----

    def floor(self, name: str) -> None:
        """Show a floor on the page Map."""
        self.tab(name)
        expect(self.map).to_have_attribute("data-floor", name)

    def draw_building(self) -> None:
        self.open("Map")
        element = self.page.get_by_label("Panel").locator("h2")
        add_floor = self.button("Add a floor")

        add_floor.click()
        expect(element).to_have_text("floor L1")
        self.press("o")
        self.click_map(self.map, *CORNERS)
        self.press("Enter")
        expect(self.page.get_by_label("outline 4 x")).to_be_visible()
        self.press("r")
        self.click_map(self.map, CORNERS[0], CORNERS[2])
        expect(element).to_have_text("area room 1")

        add_floor.click()
        expect(element).to_have_text("floor L2")
        expect(self.map).to_have_attribute("data-floor", "L2")
        self.click_map(self.map, CORNERS[0], CORNERS[2])
        expect(element).to_have_text("area room 1")
        self.press("l")
        self.click_map(self.map, (5.0, 5.5))
        expect(element).to_have_text("elevator E1")
        self.page.get_by_label("door time").fill("0.5")
        with self.page.expect_response("**/call/map_edit"):
            self.press("Enter")
        self.floor("L1")

    def put_table(self) -> None:
        """A table with a hostile name."""
        self.press("b")
        self.page.get_by_label("movable").first.check()
        self.click_map(self.map, (1.5, 3.75), (2.5, 4.5))
        expect(self.page.get_by_label("Panel").locator("h2")).to_have_text("object box 1")
        self.press("Escape")
        name = self.page.get_by_label("Panel").get_by_label("name", exact=True)
        name.fill("table\u200f")
        name.press("Enter")
        expect(self.page.locator(".map-message")).to_contain_text("U+200F")
        name.fill(TABLE)
        name.press("Enter")
        expect(self.page.get_by_label("Panel").locator("h2")).to_have_text(f"object {TABLE}")

    def check_and_plan(self) -> None:
        """Roads, what is wrong with them, and a path by two clicks, from one floor to the other."""
        for floor in ("L1", "L2"):
            self.floor(floor)
            self.press("Escape", "Escape")
            with self.page.expect_response("**/call/map_build_roads"):
                self.button("Generate roads").click()
            expect(self.page.get_by_text("roads generated")).to_be_visible()
        self.tab("Findings")
        self.button("Check all floors").click()
        expect(self.page.get_by_text("Nothing found: a robot reaches every node.")).to_be_visible()
        self.floor("L1")
        self.map.focus()
        self.press("t")
        self.click_map(self.map, START["R1"])
        self.floor("L2")
        self.click_map(self.map, GOAL)
        paths = self.page.get_by_label("Paths", exact=True).get_by_role("radio")
        expect(paths).to_have_text([re.compile(rf"{mode}\d+\.\d+ m, \d+ points") for mode in MODES])
        self.press("Escape", "Escape")

    def type_while_another_edits(self, editor: RoboCorba.MapEditor) -> None:
        """Nobody overwrites unseen what another one has set meanwhile."""
        self.open("Map")
        self.floor("L1")
        self.click_map(self.map, (5.5, 6.0))
        field = self.page.get_by_label("door time")
        field.fill("0.50")  # as it was
        self.press("Enter")
        field.fill("1.3")
        record = editor.read(e1 := RoboCorba.ElementId(RoboCorba.ELEVATOR_ELEMENT, "", "E1"))
        record.value.anElevator.doorTime = 1.5
        editor.change("", record.value, record.changedAt)
        expect(self.page.get_by_text(re.compile("somebody: .*E1")).first).to_be_visible()
        self.press("Enter")
        note = self.page.locator(".map-note")
        expect(note).to_have_text("Somebody has set this to 1.5 while you typed 1.3. Type it again to set it.")
        for typed in ("1.3", "1.35"):  # the second before the first is answered
            field.fill(typed)
            self.press("Enter")
        eventually(lambda: editor.read(e1).value.anElevator.doorTime == 1.35, what="the value")
        expect(note).to_have_count(0)

    # ---- monitor ----

    def start_robots(self) -> None:
        self.open("Monitor")
        self.tab(re.compile("^L1"))  # the page shows the floor that was edited last
        canvas = self.page.get_by_label(re.compile("Floor L1"))
        processes = self.page.get_by_label("Processes")
        self.tab("Processes")
        processes.get_by_label("New robot").fill(TABLE)
        self.button("Start", processes).click()
        expect(processes.get_by_role("alert")).to_contain_text("<img src=x onerror=alert(1)>")
        for name, at in START.items():
            processes.get_by_label("New robot").fill(name)
            processes.get_by_label("channel").select_option("main")
            self.button(re.compile("Pick its place"), processes).click()
            self.click_map(canvas, at)
            expect(processes.get_by_text(re.compile(rf"{at[0]:.1f}\d, {at[1]:.1f}\d m"))).to_be_visible()
            self.button("Start", processes).click()
            expect(processes.get_by_role("row", name=f"robot_{name}")).to_be_visible()
        for name in START:
            expect(processes.get_by_role("row", name=f"robot_{name}")).to_contain_text("ready")
        self.tab("Robots")
        for name, at in START.items():
            expect(self.robot_row(name)).to_contain_text("waiting for an order")
            self.click_map(canvas, at)
            expect(self.robot_row(name)).to_have_attribute("aria-selected", "true")
            expect(self.fact("pose")).to_have_text(re.compile(rf"L1: {at[0]:.1f}\d m, {at[1]:.1f}\d m, 0°"))

    def drive_here(self) -> None:
        """The selected robot patrols, until it drives elsewhere; where it can't, the monitor says why."""
        canvas, note = self.page.get_by_label(re.compile("Floor L1")), self.page.locator(".drive-note")
        self.press("d")
        expect(note).to_contain_text("click where R2 is to drive")
        self.click_map(canvas, (2.5, 6.0), (2.5, 5.0))
        expect(note).to_have_text(re.compile(r"R2: 2\.[45] m, about \d+ s"))
        self.click_map(canvas, (0.1, 3.0))
        expect(note).to_contain_text("is not free")
        self.button("Undo", note).click()
        self.button("Patrol", note).click()
        expect(self.fact("icon")).to_contain_text("inside 2")
        self.press("d")
        self.click_map(canvas, (1.0, 5.0))
        self.button("Drive", note).click()
        expect(self.fact("result")).to_have_text("done")
        expect(self.fact("pose")).to_have_text(re.compile(r"L1: (0\.9|1\.0)\d m, (4\.9|5\.0)\d m"))
        self.click_map(canvas, (0.1, 3.0), button="right")
        expect(note).to_contain_text("is not free")
        self.press("Escape")
        expect(note).to_have_count(0)

    def drive_together(self) -> None:
        """Several selected robots get places side by side, and stop together. How far they come depends on the machine:
        R1 is put back."""
        note, names = self.page.locator(".drive-note"), ("R1", "R2")
        self.robot_row("R1").click()
        self.robot_row("R2").click(modifiers=["Shift"])
        self.press("d")
        self.click_map(self.page.get_by_label(re.compile("Floor L1")), (2.5, 5.5))
        expect(note).to_contain_text(re.compile(r"R2: \d\.\d m, about \d+ s; R1: \d\.\d m"))
        self.button("Drive", note).click()
        for name in names:
            expect(self.robot_row(name)).to_contain_text("drive here")
        for button, state in (("Stop", "stopped"), ("Release", "waiting")):
            self.button(f"{button} 2 robots").click()
            for name in names:
                expect(self.robot_row(name)).to_contain_text(state)
        self.press("Escape")
        x, y = START["R1"]
        place = f"{{ body: 'R1', floor: 'L1', x: {x}, y: {y} }}"
        self.page.evaluate(f"async () => (await import('/static/live.js')).call('place', {place})")
        self.robot_row("R1").click()
        expect(self.fact("pose")).to_contain_text(f"L1: {x:.2f} m, {y:.2f} m")

    def drive_by_hand(self) -> None:
        """For as long as a key or a button is held, and the page is open."""
        self.robot_row("R2").click()
        speed = self.fact("speed")
        other = self.another_page()
        other.goto(f"{self.address}?robot=R2")
        expect(other.locator(".robot-table [aria-selected=true]")).to_contain_text("R2")
        for page, let_go in ((self.page, lambda: self.page.keyboard.up("ArrowRight")), (other, other.close)):
            page.bring_to_front()
            page.keyboard.press("j")
            expect(page.locator(".jog-stick")).to_be_visible()
            self.hold(lambda page=page: page.keyboard.down("ArrowRight"), r"0\.[1-9]\d m/s")
            let_go()
            expect(speed).to_contain_text("0.00 m/s")
        self.button(re.compile("Q")).hover()
        self.hold(self.page.mouse.down, "turning -?[1-9]")
        self.page.mouse.up()
        expect(speed).to_contain_text("turning 0")
        self.press("Escape")

    def hold(self, press: Callable[[], object], speed: str) -> None:
        """Press until the robot has a speed. A key that is down repeats; a browser that is busy may lose the focus."""

        def is_driving() -> bool:
            press()
            return re.search(speed, self.fact("speed").inner_text()) is not None

        eventually(is_driving, LIMIT_S, speed)

    def robot_row(self, name: str) -> Locator:
        """The row of a robot in the monitor's table."""
        return self.page.locator(f".robot-table tr:has(td:first-child:text-is('{name}'))")

    def fact(self, name: str) -> Locator:
        """A value of the selected robot, on the monitor or in 3D."""
        return self.page.locator(f".console-facts dt:text-is('{name}') + dd")

    # ---- program ----

    def build_program(self) -> None:
        """Every kind of icon once, with what each needs."""
        self.open("Program")
        self.page.get_by_label("Robot", exact=True).select_option("R1")
        self.page.get_by_label("Name of the program").fill(PROGRAM)
        self.add("mhand_posture", hand="left", posture="ready", seconds="0.5")
        self.add("mhand_offset", hand="left", dz="0.05", seconds="0.5")
        self.add("mhand_pose")
        self.button("As R1 stands").click()
        self.add("mhand_joints")
        self.button("As R1 stands").click()
        self.add("lumbar", lower="4", upper="4", seconds="0.5")
        self.add("gripper")
        expect(self.card("gripper")).to_contain_text("close, left hand")
        self.add("wait_until", kind="farther_than", sensor="front", distance="0.1", seconds="5")
        self.add("confirm", question="free?", seconds="1", on_no="go_on")
        self.add("stop_if_closer", sensor="front", distance="0.05")
        self.add("mbase_by", ahead="0.25")
        self.select("stop_if_closer")
        self.add("repeat")
        expect(self.card("repeat")).to_contain_text("2 times")
        self.add("mbase_velocity", ahead="0.2", left="0", turn="0", seconds="0.5")
        self.select("repeat")
        self.add("branch", kind="result", result="done")
        self.add("say", type="hello")
        self.select("branch")
        self.add("mbase_to", x="5", y="3")
        self.add("move_table", table=TABLE)
        self.click_map(self.target_map(), (7.5, 2.0))
        self.add("hand_over", object=TABLE, taker="R2")
        self.add("mbase_path")
        expect(self.card("mbase_path")).to_contain_text(re.compile(r"L1 3\.\d+, 2\.\d+"))
        upper = self.page.get_by_label("Target on the map").get_by_role("tab", name="L2")
        upper.click()
        expect(upper).to_have_attribute("aria-selected", "true")
        self.click_map(self.target_map(), (CORNERS[1][0], 2.0))
        self.page.locator(".program-palette [data-icon=wait]").drag_to(
            self.card("mhand_posture"), target_position={"x": 30, "y": 2}
        )
        expect(self.card("wait")).to_have_attribute("aria-pressed", "true")
        self.set_fields(seconds="0.2")
        kinds = self.page.locator(".program-palette [data-icon]").evaluate_all(
            "all => all.map((each) => each.dataset.icon)"
        )
        built = self.page.locator(".icon-card").evaluate_all("all => all.map((each) => each.dataset.icon)")
        assert sorted(built) == sorted(kinds)
        assert built[0] == "wait"

    def card(self, icon: str) -> Locator:
        """The card of an icon in the program."""
        return self.page.locator(f".icon-card[data-icon={icon}]")

    def target_map(self) -> Locator:
        return self.page.get_by_label("Target on the map").locator("canvas")

    def add(self, icon: str, **values: str) -> None:
        """Click an icon of the palette and fill its fields."""
        self.page.locator(f".program-palette [data-icon={icon}]").click()
        expect(self.card(icon)).to_have_attribute("aria-pressed", "true")
        self.set_fields(**values)

    def set_fields(self, **values: str) -> None:
        form = self.page.locator(".icon-form")
        for name, value in values.items():
            field = form.get_by_label(re.compile(rf"^{name.replace('_', ' ')}\b"))
            if field.evaluate("field => field.tagName") == "SELECT":
                field.select_option(value)
            else:
                field.fill(value)

    def select(self, icon: str) -> None:
        self.card(icon).click()
        expect(self.card(icon)).to_have_attribute("aria-pressed", "true")

    def repair_program(self) -> None:
        """The checker refuses the angle of a joint and a goal in a wall. Missions take minutes; they are removed."""
        expect(self.card("lumbar")).to_have_class(re.compile("is-incomplete"))
        self.select("lumbar")
        self.set_fields(lower="0")
        expect(self.page.locator(".program-verdict")).to_contain_text("not possible")
        expect(self.card("mbase_path")).to_have_class(re.compile("is-refused"))
        self.select("mbase_path")
        self.click_map(self.target_map(), GOAL)
        for icon in ("move_table", "hand_over"):
            self.select(icon)
            self.press("Delete")
            expect(self.card(icon)).to_have_count(0)
        expect(self.page.locator(".program-verdict")).to_contain_text(re.compile(r"\bchecked\b"))

    # ---- run ----

    def run_program(self) -> None:
        """Icons are lit while they run. Simulated time is paused in another tab while the robot is on its way, slowly:
        it must not be at the elevator before."""
        monitor = self.another_page()
        monitor.goto(self.address)
        pause = monitor.get_by_role("button", name="Pause time")
        expect(pause).to_be_enabled()
        pace = monitor.get_by_label("Pace of simulated time")
        pace.select_option("time 0.25x")
        self.button("Run").click()
        expect(self.page.locator(".icon-card.is-running")).to_have_count(1)
        expect(self.card("mbase_path")).to_have_class(re.compile("is-running"))
        resume, refusal = (
            monitor.get_by_role("button", name="Resume time"),
            monitor.locator(".simulation-bar .is-problem"),
        )
        pause.click()
        expect(resume.or_(refusal)).to_be_visible()
        if refusal.is_visible():  # a server that has too much to do asks to try again
            pause.click()
        expect(resume).to_be_visible()
        pace.select_option("time 1x")
        monitor.close()
        for icon in ("mhand_posture", "say", "mbase_velocity"):
            expect(self.card(icon)).to_have_class(re.compile("is-done"))

    def watch_in_2d(self) -> None:
        """It leaves L1 with the elevator, and arrives on L2."""
        self.open("Monitor")
        self.robot_row("R1").click()
        expect(self.robot_row("R1")).to_contain_text(PROGRAM)
        expect(self.fact("state")).to_contain_text("whose time stands")
        self.button("Resume time").click()
        expect(self.fact("speed")).not_to_contain_text("0.00 m/s")
        self.press("f")
        expect(self.page.get_by_label("Floors").get_by_role("tab", selected=True)).to_contain_text("L2")
        expect(self.robot_row("R1")).to_contain_text("waiting for an order")
        expect(self.fact("pose")).to_contain_text(f"L2: {GOAL[0]:.1f}")
        self.press("f", "0", "Escape")
        expect(self.robot_row("R1")).to_have_attribute("aria-selected", "false")
        self.click_map(self.page.get_by_label(re.compile("Floor L2")), GOAL)
        expect(self.robot_row("R1")).to_have_attribute("aria-selected", "true")

    def watch_in_3d(self) -> None:
        """The camera goes to the robot: then a click in the middle of the picture is one on the robot."""
        self.open("3D")
        robot = self.page.get_by_label("Robot", exact=True)
        follow = self.button("Follow the robot")

        def is_hit() -> bool:
            robot.select_option("R1")
            expect(self.fact("at")).to_contain_text(f"L2 {GOAL[0]:.1f}")
            if follow.get_attribute("aria-pressed") == "false":
                follow.click()
            expect(follow).to_have_attribute("aria-pressed", "true")
            robot.select_option("none")
            expect(self.page.locator(".scene-facts")).to_have_count(0)
            self.page.locator(".console-scene canvas").click()
            with contextlib.suppress(AssertionError):
                expect(robot).to_have_value("R1", timeout=1000.0)
                return True
            return False  # the floor, and with it the camera, has not come yet

        eventually(is_hit, LIMIT_S, "a click on the robot")

    # ---- missions, the past ----

    def start_and_abort_mission(self) -> None:
        self.open("Missions")
        form = self.page.get_by_role("form", name="Start a mission")
        canvas, verdict = form.locator("canvas"), form.locator(".mission-verdict")
        form.get_by_label("Floors").get_by_role("tab", name="L1").click()
        self.click_map(canvas, (2.0, 4.1))
        expect(form.get_by_label(re.compile("^object"))).to_have_value(TABLE)
        self.drag_map(canvas, (2.0, 4.1), (9.9, 2.0))
        expect(verdict).to_contain_text("is not free for the object")
        expect(self.button("Start anyway", form)).to_be_visible()
        self.drag_map(canvas, (9.8, 2.0), (7.4, 2.0))
        self.press("q")
        expect(form.get_by_label(re.compile("^heading"))).to_have_value("15")
        expect(verdict).to_contain_text("R2 leads, R1 helps")
        self.button("Start", form).click()
        row = self.page.locator(".missions-list tbody tr").first
        expect(row).to_contain_text("running")
        expect(row).to_contain_text(TABLE)
        expect(self.page.locator(".gantt-name", has_text="gathering")).to_be_visible()
        self.button("Abort").click()
        expect(row).to_contain_text("aborted")
        expect(self.page.locator(".missions-standing")).to_contain_text("stands at L1")
        self.button("Again").click()
        expect(form.get_by_label(re.compile("^heading"))).to_have_value("15")
        self.button("Report").click()
        expect(self.page.locator(".mission-report")).to_contain_text("aborted")

    def look_back(self) -> None:
        """The moments before the mission and before the program, when the robot was still on L1, and back to now."""
        self.open("Monitor")
        self.tab("Events")
        events, note = self.page.get_by_label("Events", exact=True), self.page.locator(".scene-note")
        clock = self.page.locator(".past-note strong")
        events.get_by_label("Search events").fill("carry")
        expect(events.locator("li")).to_have_count(1)
        self.button(re.compile("earlier of this mission"), events).click()
        self.button(re.compile("Carry .* has begun"), events).click()
        expect(clock).to_contain_text(re.compile(r"past: \d"))
        before = str(clock.text_content())
        events.get_by_label("Search events").fill("")
        self.button(re.compile("R1 runs .*<img"), events).last.click()
        # The address changes at once, the floor with its moment when the console has answered.
        expect(clock).not_to_have_text(before)
        expect(self.page.locator(".time-text")).to_contain_text("ago")
        self.page.wait_for_url(re.compile("robot=R1.*at="))
        moment = str(clock.text_content())
        with contextlib.closing(self.another_page()) as linked:
            linked.goto(self.page.url)
            expect(linked.locator(".past-note strong")).to_have_text(moment)
            expect(linked.locator(".robot-table [aria-selected=true]")).to_contain_text("R1")
        self.tab(re.compile("^L1"))
        self.tab("Robots")
        self.press("Escape")
        canvas = self.page.get_by_label(re.compile("Floor L1"))
        expect(canvas).to_have_attribute("data-floor", "L1")
        self.click_map(canvas, START["R1"])
        expect(self.robot_row("R1")).to_have_attribute("aria-selected", "true")
        self.button("Live").click()
        expect(note).to_have_count(0)
        expect(self.page.locator(".time-text")).to_contain_text("now")

    # ---- killed servers ----

    @contextlib.contextmanager
    def killed(self, system: Running, server: str) -> Iterator[None]:
        """Kill a server; the page says so. At the end of the `with` it is back: the page has gone on by itself."""
        self.page.evaluate(SEE_STATUS)
        os.kill(system.pid(server), signal.SIGKILL)
        self.page.wait_for_function("() => window.seen.some((text) => /answer|reachable/.test(text))")
        yield
        expect(self.page.locator(".console-status")).to_contain_text("robots")
        assert self.page.evaluate("() => window.seen.length"), "the page was loaded again"

    def kill_map_editor(self, system: Running) -> None:
        """Not even a half-drawn wall is lost."""
        self.open("Map")
        expect(self.map).to_have_attribute("data-floor", "L1")
        self.press("w")
        self.click_map(self.map, (4.0, 0.0))
        with self.killed(system, "map_editor"):
            pass
        expect(self.page.locator(".console-overlay")).to_have_count(0)
        self.click_map(self.map, (4.0, 1.0))
        self.press("Enter")
        expect(self.page.get_by_label("Panel").locator("h2")).to_have_text("wall w5")

    def kill_simulation(self, system: Running) -> None:
        """The robots log on again, and are where they were."""
        self.open("Monitor")
        self.robot_row("R1").click()
        expect(self.robot_row("R1")).to_have_attribute("aria-selected", "true")
        expect(self.robot_row("R1")).to_contain_text("waiting for an order")
        expect(self.fact("speed")).to_contain_text("0.00 m/s")
        expect(self.fact("pose")).to_have_text(re.compile(r"L[12]: \d"))
        before = str(self.fact("pose").text_content())
        with self.killed(system, "simulation"):
            pass
        for name in START:
            expect(self.robot_row(name)).to_contain_text("waiting for an order")
        expect(self.fact("pose")).to_have_text(before)

    def kill_console(self, system: Running) -> None:
        """What was typed stays."""
        self.tab("Processes")
        field = self.page.get_by_label("New robot")
        field.fill("R3")
        with self.killed(system, "console"):
            pass
        expect(field).to_have_value("R3")
        expect(self.page.get_by_role("row", name="console")).to_contain_text("ready")


@contextlib.contextmanager
def operator(program: str, address: str) -> Iterator[Operator]:
    """A browser with one page."""
    with headless(program) as browser:
        page = browser.new_page(viewport={"width": 1366, "height": 768}, locale="en-GB")
        page.set_default_timeout(1000 * LIMIT_S)
        expect.set_options(timeout=1000 * LIMIT_S)
        yield Operator(page, address)


# ---- the day ----


#: Each goes on from where the one before ended.
STEPS: tuple[Callable[[Operator], None], ...] = (
    *(Operator.draw_building, Operator.put_table, Operator.check_and_plan, Operator.start_robots),
    *(Operator.drive_here, Operator.drive_together, Operator.drive_by_hand),
    *(Operator.build_program, Operator.repair_program, Operator.run_program, Operator.watch_in_2d),
    *(Operator.watch_in_3d, Operator.start_and_abort_mission, Operator.look_back),
)


@pytest.mark.timeout(1800)
def test_an_operators_day(tmp_path: Path) -> None:
    assert BROWSER
    native.save(Building("house"), tmp_path / "house.yaml")
    options = ("--building", str(tmp_path / "house.yaml"), "--console", "--console-port", "0")
    with (
        running_system(tmp_path, *options) as (system, _),
        operator(BROWSER, system.record().console_address) as user,
        user.telling(),
    ):
        for step in STEPS:
            step(user)
            assert not user.troubles, step
        with Orb(system.naming) as orb:
            editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
            user.type_while_another_edits(editor)
        assert not user.troubles
        assert user.page.locator("img[src=x]").count() == 0
        user.kill_map_editor(system)
        user.kill_simulation(system)
        assert not user.troubles
        user.kill_console(system)
        assert all(re.search("net::ERR_|WebSocket", trouble) for trouble in user.troubles)
        for module, call, answer in PURE:
            script = f"async () => {{ const m = await import('/static/{module}.js'); return m.{call}; }}"
            assert user.page.evaluate(script) == answer, call
