"""What the sensors of virtual and actual robots see, in the console and `robocorba watch`; without viewers none is
asked. And how the console sends a program to the computer of an actual one."""

from __future__ import annotations

import contextlib
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.claimed_ports import claimed_ports
from testkit.actual_robot import running_stand_in
from testkit.browser import chromium, headless
from testkit.buildings import two_floors, with_all
from testkit.processes import eventually, read_json, running_system
from testkit.virtual_and_actual import RobotProcess, robot_process

pytest.importorskip("nicegui", reason="the console's packages are not installed")
client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
pytestmark = [pytest.mark.system, pytest.mark.slow(100), pytest.mark.full]

PATIENCE_S = 120.0
#: Where the actual robot begins, and its radius; the front of the chair before it [m].
AT, RADIUS_M, CHAIR_X = (2.5, 5.5, 0.0), 0.4, 4.5


class Place(NamedTuple):
    """A virtual robot V, and the actual one A before a chair that no map has."""

    orb: Orb
    address: str
    virtual: RobotProcess

    def scan_rate(self) -> float:
        """Scans per second of all virtual sensors."""
        server = self.orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        return sum(sensor.load.scanRate for sensor in server.sensors())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    folder = tmp_path_factory.mktemp("scans")
    for name in ("system", "V", "A"):
        (folder / name).mkdir()
    native.save(two_floors(), folder / "building.yaml")
    chair = MapObject(name="chair", shape=BoxShape(size=(0.5, 0.5)), at=(CHAIR_X + 0.25, AT[1]))
    native.save(with_all(two_floors(), [("L1", chair)]), folder / "world.yaml")
    world = ("--world", str(folder / "world.yaml"), "--world-at", *map(str, AT), "--range-noise", "0.005")
    building = ("--building", str(folder / "building.yaml"))
    with contextlib.ExitStack() as stack:
        console = ("--console", "--console-port", "0")
        running, _ = stack.enter_context(running_system(folder / "system", *building, *console))
        orb = stack.enter_context(Orb(running.naming))
        orb.accept_calls()
        stand_in = stack.enter_context(running_stand_in(folder / "robot", *world, orb=orb))

        def robot(name: str, at: str, *more: str) -> RobotProcess:
            where = ("--floor", "L1", "--at", at, "--protect", "off")
            return stack.enter_context(robot_process(folder / name, orb, name, *where, *more))

        robot("A", ",".join(map(str, AT)), "--adaptor", "smartpal", "--", "--naming", str(stand_in.naming))
        virtual = robot("V", "8.0,1.0")
        yield Place(orb, running.record().console_address, virtual)


def test_a_page_sees_the_sensors_of_all_robots_and_nobody_is_asked_for_nobody(place: Place) -> None:
    eventually(lambda: place.scan_rate() == 0.0, PATIENCE_S, "that nobody scans")
    last: dict[str, Any] = {}
    times: dict[str, list[float]] = {}
    with client.connect(place.address.replace("http", "ws") + "live") as page:
        page.send(json.dumps({"watch": ["L1"], "scans": ["L1"]}))
        began = time.monotonic()
        while len(times) < 4 or min(map(len, times.values())) < 20:
            assert time.monotonic() < began + PATIENCE_S, {key: len(each) for key, each in times.items()}
            message = page.recv(timeout=PATIENCE_S)
            for scan in json.loads(message).get("scans", {}).get("scans", ()) if isinstance(message, str) else ():
                times.setdefault(scan["key"], []).append(scan["time"])
                last[scan["key"]] = scan
        # Ten times a second, and one more in which each begins; the thread's pauses may be a little short.
        assert max(map(len, times.values())) <= 11.0 * (time.monotonic() - began) + 2
    assert sorted(times) == ["A/laser", "A/proximity", "V/laser", "V/proximity"]
    assert all(each == sorted(each) for each in times.values())
    assert [last[key]["virtual"] for key in ("A/laser", "V/laser")] == [False, True]
    hits, ranges = np.array(last["A/laser"]["hits"]), np.array(last["A/laser"]["ranges"])
    bearings = np.radians(np.arange(-90, 91))
    at_chair = np.abs(ranges * np.cos(bearings) - (CHAIR_X - AT[0])) < 0.1
    at_chair &= np.abs(ranges * np.sin(bearings)) < 0.25
    assert at_chair.sum() > 10
    assert (hits == 2).tolist() == at_chair.tolist()
    assert 2 not in last["V/laser"]["hits"]
    eventually(lambda: place.scan_rate() == 0.0, PATIENCE_S, "that nobody scans any more")


def test_watch_says_what_is_nearest_and_who_sees_it(place: Place) -> None:
    def seen() -> dict[str, tuple[float | None, str]]:
        rows = read_json(place.virtual.robocorba("watch", "--json"))["robots"]
        return {row["name"]: (row["nearest"], row["nearest_is"]) for row in rows}

    found = eventually(lambda: (rows := seen()) and all(kind for _, kind in rows.values()) and rows, PATIENCE_S)
    assert found["A"] == (pytest.approx(1.0, abs=0.001), "actual")  # nothing within reach of its proximity sensors
    assert found["V"] == (pytest.approx(1.0 - RADIUS_M, abs=0.01), "virtual")  # the wall at its side
    line = next(line for line in place.virtual.robocorba("watch", "--once").splitlines() if line.startswith("A\t"))
    assert "\t1.00\tactual\t" in line


@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_pages_tell_actual_sensors_from_virtual_ones_and_mark_what_no_map_has(place: Place) -> None:
    sync = pytest.importorskip("playwright.sync_api", reason="playwright, which moves the browser, is not installed")
    sync.expect.set_options(timeout=PATIENCE_S * 1000.0)
    with headless(chromium() or "") as browser:
        page, troubles = browser.new_page(), list[str]()
        page.set_default_timeout(PATIENCE_S * 1000.0)
        page.on("pageerror", lambda error: troubles.append(str(error)))
        for robot, fact in (("A", r"actual: nearest .* in no map"), ("V", r"virtual: nearest 1\.\d\d m")):
            page.goto(f"{place.address}?robot={robot}")
            sync.expect(page.get_by_label(f"Robot {robot}", exact=True)).to_contain_text(re.compile(fact))
            legend = page.get_by_label("Rays of sensors")
            for kind in ("laser", "proximity", "sensor of an actual robot", "virtual sensor", "in no map"):
                sync.expect(legend).to_contain_text(kind)
        sync.expect(page.get_by_label("Proximity [m]")).to_have_text(re.compile(r"free.*free.*0\.60"))
        page.get_by_role("button", name="Lasers and proximity").click()
        sync.expect(page.get_by_label("Rays of sensors")).to_have_count(0)
        assert troubles == []


@pytest.mark.skipif(not chromium(), reason="there is no chromium on this machine")
def test_a_program_goes_to_the_computer_of_a_robot(place: Place, tmp_path: Path) -> None:
    """A virtual robot checks it. The form shows what it has found, and remembers the address."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright, which moves the browser, is not installed")
    from tests.system.test_console_in_browser import operator

    with (
        running_stand_in(tmp_path / "robot", orb=place.orb) as robot,
        claimed_ports() as port,
        operator(chromium() or "", place.address) as user,
        user.telling(),
    ):
        alone = ("--agent-only", "--endpoint", f"127.0.0.1:{port}", "--adaptor", "smartpal")
        where = ("--floor", "L1", "--at", "4.9,8.0,0", *alone, "--", "--naming", str(robot.naming))
        with robot_process(tmp_path, place.orb, "U", *where):
            user.open("Program")
            page, host = user.page, "Host of the robot's computer"
            page.get_by_label("Robot", exact=True).select_option("V")
            page.get_by_label("Name of the program").fill("wave")
            user.add("mhand_posture", hand="left", posture="carry")
            user.button("Upload").click()
            sync.expect(user.button("Test")).to_be_disabled()
            page.get_by_label(host).fill("127.0.0.1")
            page.get_by_label("Port of the robot's computer").fill(str(port))
            user.button("Test").click()
            panel = page.get_by_label("Upload to the robot's computer")
            sync.expect(panel).to_contain_text("U answers: adaptor smartpal, no range sensors, waiting for an order")
            user.button(re.compile("^Upload and run")).click()
            sync.expect(panel).to_contain_text("U has upload 1 and runs it")

            def is_reported() -> bool:
                user.button("Test").click()
                with contextlib.suppress(AssertionError):
                    sync.expect(panel).to_contain_text("wave: done, 1 icon done", timeout=2000.0)
                    return True
                return False

            eventually(is_reported, PATIENCE_S, "the report")
            page.reload()
            user.button("Upload").click()
            sync.expect(page.get_by_label(host)).to_have_value("127.0.0.1")
            user.button("Switch to actual").click()
            sync.expect(page.get_by_label("Host of the robot's naming service")).to_have_value("")
            sync.expect(page.get_by_label("Adaptor", exact=True)).to_have_value("smartpal")
            page.get_by_label("Adaptor", exact=True).select_option("corba")
            sync.expect(page.get_by_label("Reference of the adaptor")).to_be_visible()
            assert not user.troubles
