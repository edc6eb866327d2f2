"""The touch panel of a robot on a tablet: a real browser that only touches, a virtual and an actual robot, and a
console that asks for the PIN of the robot."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Result
from testkit.actual_robot import running_stand_in
from testkit.buildings import two_storeys
from testkit.missions import MissionSystem, RobotStart, missions
from testkit.processes import ROBOCORBA, Launcher, drain, eventually

pytest.importorskip("nicegui", reason="the console's packages are not installed")
pytest.importorskip("playwright", reason="playwright, which moves the browser, is not installed")
pytest.importorskip("axe_playwright_python", reason="axe, which looks for barriers on pages, is not installed")

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Locator, Page, expect

from testkit.browser import chromium, headless

BROWSER = chromium()
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.slow(140),
    pytest.mark.skipif(not BROWSER, reason="there is no chromium on this machine"),
]

#: Timeout of every wait, for busy machines [s].
LIMIT_S = 120.0
HOST, PASSWORD, PIN, QUESTION = "127.0.0.2", "open sesame", "471193", "hand is free?"
SCREENS = ((1280, 800), (800, 1280))
#: Least size of what is touched on these screens [px].
TARGET_PX = 72


class Tablet:
    """The panel as a person sees and touches it."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.text = page.locator(".panel-text")
        self.display = page.get_by_label("Display")

    def touch(self, name: str) -> None:
        self.button(name).tap()

    def button(self, name: str) -> Locator:
        return self.page.get_by_role("button", name=name, exact=True)

    def shows(self, kind: str, text: str) -> None:
        expect(self.text).to_have_text(text)
        expect(self.display).to_have_class(re.compile(rf"\bis-{kind}\b"))

    def choose(self, program: str) -> None:
        self.page.locator(".panel-program").tap()
        expect(self.page.get_by_role("option", name=program, exact=True)).to_be_visible()
        self.is_well_laid_out()
        self.page.get_by_role("option", name=program, exact=True).tap()
        expect(self.page.locator(".panel-program b")).to_have_text(program)

    def is_well_laid_out(self) -> None:
        """On both screens nothing is cut off or covers another thing, and all targets are large."""
        for width, height in SCREENS:
            self.page.set_viewport_size({"width": width, "height": height})
            boxes = []
            for button in self.page.get_by_role("button").or_(self.page.get_by_role("option")).all():
                if self.page.get_by_role("dialog").count() and not button.evaluate("b => b.closest('[role=dialog]')"):
                    continue
                box = button.bounding_box()
                assert box and min(box["width"], box["height"]) >= TARGET_PX, (button, box)
                boxes.append((box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]))
            for number, (left, top, right, bottom) in enumerate(boxes):
                assert left >= 0 and top >= 0 and right <= width and bottom <= height, boxes[number]
                for other in boxes[:number]:
                    assert right <= other[0] or left >= other[2] or bottom <= other[1] or top >= other[3]
        self.page.set_viewport_size({"width": SCREENS[0][0], "height": SCREENS[0][1]})


@contextlib.contextmanager
def console(place: MissionSystem, folder: Path) -> Iterator[str]:
    """The address of a console with a password, a PIN for A, and a folder of programs."""
    programs = folder / "programs"
    programs.mkdir()
    ProgramBuilder("ask").confirm(QUESTION, 600.0).mbase_by(ahead=0.1).write(programs / "ask.json")
    builder = ProgramBuilder("ask twice").confirm(QUESTION, 600.0, on_no="go_on")
    with builder.branch(Result("refused")):
        builder.confirm("really not?", 600.0)
    builder.write(programs / "ask twice.json")
    ProgramBuilder("long").mbase_velocity(0.0, 0.0, 0.3, 600.0).write(programs / "long.json")
    (folder / "password").write_text(PASSWORD)
    (folder / "pins").write_text(f"A {PIN}\n")
    with Launcher(folder) as launch:
        process = launch(
            *(ROBOCORBA, "console", "--host", HOST, "--port", "0", "--naming", str(place.orb.naming)),
            *("--password-file", str(folder / "password"), "--pin-file", str(folder / "pins")),
            *("--programs", str(programs), "--state", str(folder / "state")),
        )
        assert process.stdout
        address = process.stdout.readline().strip()
        assert process.stdout.readline() == "ready\n"
        drain(process)
        yield address.rstrip("/")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MissionSystem]:
    with missions(tmp_path_factory.mktemp("panel"), two_storeys(), "lab") as found:
        found.start({"A": RobotStart(3.0, 3.5, 0.0, "lab")})
        yield found


@pytest.fixture(scope="module")
def address(place: MissionSystem, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with console(place, tmp_path_factory.mktemp("console")) as found:
        yield found


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    assert BROWSER
    with headless(BROWSER) as found:
        yield found


@pytest.fixture
def tablet(address: str, browser: Browser) -> Iterator[Tablet]:
    """Nothing goes wrong in its browser but what the PIN does not open."""
    troubles: list[str] = []
    size = {"width": SCREENS[0][0], "height": SCREENS[0][1]}
    with browser.new_context(viewport=size, has_touch=True, locale="en-GB") as context:
        context.set_default_timeout(1000 * LIMIT_S)
        expect.set_options(timeout=1000 * LIMIT_S)
        page = context.new_page()
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
        yield Tablet(page)
    assert [each for each in troubles if " 401 " not in each] == []


def enter(tablet: Tablet, pin: str) -> None:
    for digit in pin:
        tablet.touch(digit)
    tablet.touch("Open")


def wait(agent: RemoteAgent, text: str) -> None:
    eventually(lambda: agent.display().text == text, LIMIT_S, text)


def test_a_person_at_the_robot(place: MissionSystem, address: str, tablet: Tablet) -> None:
    agent, page = place.agent("A"), tablet.page
    page.goto(f"{address}/panel/A")
    tablet.is_well_laid_out()
    enter(tablet, "123456")
    expect(page.get_by_role("alert")).to_have_text("The PIN is wrong.")
    enter(tablet, PIN)
    tablet.shows("waiting", "waiting for an order")
    tablet.is_well_laid_out()
    for path in ("/panel-call/panel_stop/B", "/call/stop_all", "/call/example_programs"):
        headers = {"Content-Type": "application/json"}
        assert page.request.post(address + path, data="{}", headers=headers).status == 401, path
    assert page.request.post(f"{address}/panel-call/stop_all/A", data={}).json()["error"].startswith("panels have no")

    tablet.choose("ask")
    tablet.touch("Start")
    tablet.shows("waiting", QUESTION)
    tablet.is_well_laid_out()
    assert agent.display().text == f"waiting for an answer: {QUESTION}"
    tablet.touch("Pause")
    wait(agent, f"paused, waiting for an answer: {QUESTION}")
    tablet.touch("Go on")
    wait(agent, f"waiting for an answer: {QUESTION}")
    tablet.touch("Yes")
    tablet.shows("waiting", "waiting for an order")
    assert agent.state().program[:2] == ("ask", agent.state().program.result.DONE)

    tablet.touch("Start")
    tablet.touch("No")
    tablet.shows("exceptional", f"ask failed: \u201c{QUESTION}\u201d was answered with no")
    tablet.touch("Start")
    tablet.shows("waiting", QUESTION)
    tablet.touch("End")
    tablet.shows("waiting", "waiting for an order")

    tablet.choose("long")
    tablet.touch("Start")
    tablet.shows("working", "mbase velocity (long)")
    tablet.touch("Stop")
    tablet.shows("exceptional", "stopped: emergency stop")
    tablet.is_well_laid_out()
    assert agent.state().condition.name == "STOPPED"
    tablet.touch("Reset")
    tablet.shows("waiting", "waiting for an order")

    # One answers by the command, too.
    tablet.choose("ask twice")
    tablet.touch("Start")
    tablet.shows("waiting", QUESTION)
    assert place.printed("program", "answer", "A") == f"A\t{QUESTION}\t?\n"
    assert place.printed("program", "answer", "A", "no") == f"A\t{QUESTION}\tno\n"
    tablet.shows("waiting", "really not?")
    place.printed("program", "answer", "A", "yes")
    tablet.shows("waiting", "waiting for an order")
    with pytest.raises(AssertionError, match="can't answer: the robot asks nothing"):
        place.printed("program", "answer", "A", "yes")


def test_the_work_model(place: MissionSystem, address: str, tablet: Tablet, tmp_path: Path) -> None:
    """Back to the actual robot with the arguments of before; two touches, and the person answers there too."""
    agent, page = place.agent("A"), tablet.page
    page.goto(f"{address}/panel/A")
    enter(tablet, PIN)
    models = page.get_by_label("Work model")
    with running_stand_in(tmp_path / "actual", orb=place.orb) as actual:
        agent.switch("smartpal", ["--naming", str(actual.naming)])
        expect(models.get_by_role("button", pressed=True)).to_have_text("actualsmartpal")
        models.get_by_role("button", name="virtual").tap()
        expect(models.get_by_role("button", pressed=True)).to_have_text("virtualsimulated")
        models.get_by_role("button", name="smartpal").tap()
        models.get_by_role("button", name="Sure?").tap()
        expect(models.get_by_role("button", pressed=True)).to_have_text("actualsmartpal")
        tablet.choose("ask")
        tablet.touch("Start the actual robot")
        tablet.shows("waiting", QUESTION)
        assert (agent.state().adaptor, agent.question().text) == ("smartpal", QUESTION)
        tablet.touch("Yes")
        tablet.shows("waiting", "waiting for an order")
        models.get_by_role("button", name="virtual").tap()
        expect(models.get_by_role("button", pressed=True)).to_have_text("virtualsimulated")
    models.get_by_role("button", name="corba").tap()
    models.get_by_role("button", name="Sure?").tap()
    expect(page.get_by_role("alert")).to_contain_text("RoboCorba/Adaptors/A is not reachable")


#: What differs on dark pages.
DARK = {"runOnly": {"type": "rule", "values": ["color-contrast"]}}


def barriers(page: Page, is_dark: bool) -> list[str]:
    """What axe-core finds on a page that keeps people from using it."""
    found = Axe().run(page, options=DARK if is_dark else None).response["violations"]
    severe = [each for each in found if each["impact"] in ("serious", "critical")]
    return [f"{page.url}: {each['id']}: {node['html']}" for each in severe for node in each["nodes"]]


def test_no_page_has_barriers(address: str, tablet: Tablet) -> None:
    page, found = tablet.page, list[str]()
    for path, label in (("/panel/A", "PIN of A"), ("", "Password")):
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.goto(address + path)
            expect(page.get_by_label(label)).to_be_visible()
            found += barriers(page, scheme == "dark")
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Log in").click()
    for path, text, tabs in (
        ("/?robot=A", "last news", ("Events", "Channels", "Processes")),
        ("/3d?robot=A", "waiting for an order", ()),
        ("/program?robot=A", "examples", ("Text", "Icon")),
        ("/map", "Select", ("Findings", "Seen", "Path", "Files", "Edits")),
        ("/missions", "object", ()),
        ("/panel/A", "waiting for an order", ()),
    ):
        for dark in ("no", "yes"):
            page.evaluate("dark => localStorage.setItem('robocorba-dark', dark)", dark)
            page.goto(address + path)
            expect(page.get_by_text(text).first).to_be_attached()
            if path.startswith("/program"):
                page.get_by_label("Open an example").select_option("example fetch")
                page.locator(".icon-card").first.click()
            found += barriers(page, dark == "yes")
            for tab in tabs:
                page.get_by_role("tab", name=tab).click()
                found += barriers(page, dark == "yes")
    assert found == []


def test_a_tap_on_the_chest_in_3d_opens_the_panel(place: MissionSystem, address: str, tablet: Tablet) -> None:
    page = tablet.page
    place.start({"B": RobotStart(1.0, 6.0, 0.0, "lab")})
    page.goto(f"{address}/panel/B")  # which has no PIN
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Log in").tap()
    tablet.shows("waiting", "waiting for an order")
    page.goto(f"{address}/3d?robot=B")
    follow = page.get_by_role("button", name="Follow the robot")
    expect(follow).to_have_attribute("aria-pressed", "true")
    canvas = page.locator(".console-scene canvas").first
    expect(page.locator(".scene-facts")).to_contain_text("waiting for an order")

    def opens() -> bool:
        """Somewhere about its middle, as it stands before the camera."""
        box = canvas.bounding_box()
        assert box
        for up in (0.4, 0.44, 0.48, 0.36, 0.52):
            page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + up * box["height"])
            with contextlib.suppress(AssertionError):
                expect(page).to_have_url(re.compile("/panel/B$"), timeout=1000)
                return True
        return False

    eventually(opens, LIMIT_S, "the panel opens")
    tablet.shows("waiting", "waiting for an order")
