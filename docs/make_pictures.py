"""Take the pictures of the console in docs/pictures from a running system of its own, and the film of the demo's carry
(`make pictures`).

    python -m docs.make_pictures [FOLDER] [--browser PROGRAM]

It starts the building five-floors with three robots and the console on free ports, and takes each page, 1366 x 768,
by Playwright. Then it runs the demo, and makes a short animated WebP of its film. Exit code 1 with a reason where there
is no browser, or the demo fails."""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import av

from robocorba.clients.robot_processes import START_TIMEOUT_S, servers
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import StartFailed
from robocorba.map_editor.samples import sample_path
from robocorba.orb.orb import Orb
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.names import SUPERVISOR
from robocorba.system.processes import ProcessPhase, RobotOrder
from robocorba.system.state_folder import StateFolder
from testkit.browser import chromium, headless
from testkit.processes import eventually

SIZE = {"width": 1366, "height": 768}
#: Time for a page to show live data [ms].
SETTLED_MS = 5000
#: Length of the animated film of the demo [s], and its pictures per second.
FILM_S, FILM_FPS = 13, 10
ROBOTS = (
    RobotOrder("A", channel="lab", floor="L1", at=(30.0, 9.2, 0.0)),
    RobotOrder("B", channel="lab", floor="L1", at=(36.0, 9.5, 0.0)),
    RobotOrder("C", channel="hall", floor="L1", at=(25.5, 4.0, 0.0)),
)


class View(NamedTuple):
    """A page to take. prepare, select: scripts that are run before the waiting time, and before each picture."""

    path: str
    prepare: str = ""
    select: str = ""
    settled_ms: int = 0
    schemes: tuple[str, ...] = ("light",)


#: A call of one of the console's operations.
_CALL = """async (name, given) => (await fetch("/call/" + name, {method: "POST", body: JSON.stringify(given),
    headers: {"Content-Type": "application/json"}})).json()"""
_PROGRAM = """(x1, y1, x2, y2) => JSON.stringify({format: 1, name: "patrol", robot: "SmartPal",
    icons: [{icon: "repeat", times: 50, icons: [
    {icon: "mhand_posture", hand: "both", posture: "reach"},
    {icon: "mbase_path", floor: "L1", x: x1, y: y1, speed: 0.4},
    {icon: "mhand_posture", hand: "both", posture: "tuck"}, {icon: "mbase_path", floor: "L1", x: x2, y: y2}]}]})"""
_PATROL = f"""async () => {{ const call = {_CALL}, program = {_PROGRAM};
    await call("run_program", {{robot: "A", program: program(26, 9.3, 33, 9.3)}});
    await call("run_program", {{robot: "B", program: program(37, 14, 36, 10)}}); }}"""
_CARRY = f"""async () => {{ const call = {_CALL};
    for (const robot of ["A", "B", "C"]) await call("abort_program", {{robot}});
    for (let tries = 0; ; tries++) {{  // until C has ended its program
        const {{error}} = await call("start_mission", {{leader: "C", icon: {{icon: "move_table", table: "cafe-table-1",
            to: {{floor: "L1", x: 28.5, y: 5.0, heading: 0}}}}}});
        if (!error) return;
        if (tries === 60) throw new Error(error);
        await new Promise((again) => setTimeout(again, 500));
    }} }}"""
_ASK = f"""async () => {{ const call = {_CALL};
    const ask = {{icon: "confirm", question: "hand is free?", seconds: 600}};
    await call("run_program", {{robot: "C", program: JSON.stringify({{name: "hand", icons: [ask]}})}}); }}"""
_CLICK = "text => [...document.querySelectorAll('tr, td')].find(each => each.textContent.includes(text))?.click()"
_OPEN = """() => { const choice = document.querySelector("select.program-examples");
    choice.value = "example fetch"; choice.dispatchEvent(new Event("change")); }"""
VIEWS = {
    "monitor": View("", _PATROL, f"() => ({_CLICK})('B')", 4000),
    "3d": View("3d?robot=B", settled_ms=SETTLED_MS, schemes=("light", "dark")),
    "panel": View("panel/C", _ASK),
    "map": View("map"),
    "missions": View("missions", _CARRY, f"() => ({_CLICK})('cafe-table-1')", 70_000),
    "program": View("program", select=_OPEN),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent / "pictures", metavar="FOLDER")
    parser.add_argument("--browser", default=chromium(), metavar="PROGRAM", help="Chromium [chromium]")
    given = parser.parse_args()
    if given.browser is None:
        sys.exit("make pictures: Chromium is missing; on Debian: apt install chromium, or give --browser PROGRAM")
    given.folder.mkdir(parents=True, exist_ok=True)
    try:
        with running_console() as address:
            take(address, given.folder, given.browser)
        with tempfile.TemporaryDirectory(prefix="robocorba-demo-") as demo:
            subprocess.run([sys.executable, "-m", "robocorba.clients.demo", demo], check=True)
            shorten(Path(demo) / "mission.mp4", given.folder / "carry.webp")
    except (RoboCorbaError, subprocess.CalledProcessError) as error:
        sys.exit(f"make pictures: {error}")


@contextlib.contextmanager
def running_console() -> Iterator[str]:
    """A system with robots and console inside the `with`; yields the console's address. Raises StartFailed."""
    with tempfile.TemporaryDirectory(prefix="robocorba-pictures-") as folder:
        state = Path(folder)
        options = ("--building", str(sample_path("five-floors")), "--subnets", "lab,hall")
        with servers(state, *options, "--console", "--console-port", "0") as naming, Orb(naming) as orb:
            supervisor = RemoteSupervisor(orb, state / SUPERVISOR)
            for order in ROBOTS:
                supervisor.start_robot(order)

            def are_ready() -> bool:
                robots = [process for process in supervisor.processes() if process.robot]
                for robot in robots:
                    if robot.phase is ProcessPhase.ENDED:
                        raise StartFailed(f"{robot.name}: {robot.problem}")
                return all(robot.phase is ProcessPhase.READY for robot in robots)

            eventually(are_ready, START_TIMEOUT_S, "the robots started")
            record = StateFolder(state).read_record()
            assert record is not None
            yield record.console_address


def take(address: str, folder: Path, browser: str) -> None:
    """Take each page."""
    with headless(browser) as started:
        page = started.new_page(viewport=SIZE)
        for name, view in VIEWS.items():
            page.goto(address + view.path)
            if view.prepare:
                page.evaluate(view.prepare)
            page.wait_for_timeout(view.settled_ms)
            for scheme in view.schemes:
                page.emulate_media(color_scheme=scheme)
                page.evaluate(
                    "scheme => localStorage.setItem('robocorba-dark', scheme === 'dark' ? 'yes' : 'no')", scheme
                )
                page.reload()
                page.wait_for_timeout(SETTLED_MS)
                if view.select:
                    page.evaluate(view.select)
                    page.wait_for_timeout(SETTLED_MS)
                file = folder / f"console-{name}-{scheme}.png"
                page.screenshot(path=file)
                print(file)


def shorten(film: Path, file: Path) -> None:
    """Write a film as an animated WebP of FILM_S in time lapse."""
    with av.open(str(film)) as video:
        pictures = [frame.to_image() for frame in video.decode(video=0)]
    count = FILM_S * FILM_FPS
    first, *others = [pictures[index * (len(pictures) - 1) // (count - 1)] for index in range(count)]
    first.save(file, save_all=True, append_images=others, duration=1000 // FILM_FPS, loop=0, quality=60, method=6)
    print(file)


if __name__ == "__main__":
    main()
