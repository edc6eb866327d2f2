"""Take the pictures of the console in docs/images from a running system of its own (`make pictures`).

    python docs/make_pictures.py [FOLDER] [--browser PROGRAM]

It starts the building five-floors with three robots and the console on free ports, and takes each page in light and
dark, 1366 x 768, by Playwright. Exit code 1 with a reason where there is no browser."""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robocorba.clients.robot_processes import START_TIMEOUT_S, servers
from robocorba.corba.orb import Orb
from robocorba.corba.remote.supervisor import RemoteSupervisor
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import StartFailed
from robocorba.maps.samples import sample_path
from robocorba.names import SUPERVISOR
from robocorba.processes import ProcessPhase, RobotOrder
from robocorba.supervision.console import CONSOLE
from robocorba.supervision.folder import StateFolder
from robocorba.testing.processes import eventually

#: File and address of each page.
PAGES = {"monitor": "", "3d": "3d", "program": "program", "map": "map", "missions": "missions"}
ROBOTS = (RobotOrder("A", channel="lab"), RobotOrder("B", channel="lab"), RobotOrder("C", channel="hall"))
SIZE = {"width": 1366, "height": 768}
#: Together they let Chromium draw WebGL without a graphics card.
FLAGS = ["--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: Time for a page to show live data [ms].
SETTLED_MS = 6000


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent / "images", metavar="FOLDER")
    parser.add_argument("--browser", default=shutil.which("chromium"), metavar="PROGRAM", help="Chromium [chromium]")
    given = parser.parse_args()
    if given.browser is None:
        sys.exit("make pictures: Chromium is missing; on Debian: apt install chromium, or give --browser PROGRAM")
    given.folder.mkdir(parents=True, exist_ok=True)
    try:
        with running_console() as address:
            take(address, given.folder, given.browser)
    except RoboCorbaError as error:
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
            yield next(f"http://{process.endpoint}/" for process in record.processes if process.name == CONSOLE)


def take(address: str, folder: Path, browser: str) -> None:
    """Take each page in light and dark."""
    from playwright.sync_api import sync_playwright  # imported here: the rest needs no browser

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        for scheme in ("light", "dark"):
            settings: Any = {"viewport": SIZE, "color_scheme": scheme}
            page = chromium.new_page(**settings)
            for name, path in PAGES.items():
                page.goto(address + path)
                page.wait_for_timeout(SETTLED_MS)
                file = folder / f"console-{name}-{scheme}.png"
                page.screenshot(path=file)
                print(file)
            page.close()
        chromium.close()


if __name__ == "__main__":
    main()
