"""What a wheel holds, and that it works outside the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from numba.core.caching import _CacheLocator

from robocorba import __version__
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.kernel_store import KernelStore, cache_folder, sources, store
from robocorba.system.settings import Address
from testkit.processes import Launcher, Running, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow(60), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[1]
#: Folders of the checkout that the package holds too.
OF_CHECKOUT = ("servers", "clients")
#: A module that must not be run.
STRANGER = "import sys\nsys.exit('a stranger was run')\n"
NOT_SOURCE = shutil.ignore_patterns(".*", "__pycache__", "build", "*.egg-info", "stubs", "results", "demo-output")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy without anything that was made before, as `pip install .` would do."""
    folder = tmp_path_factory.mktemp("package")
    shutil.copytree(ROOT, folder / "source", ignore=NOT_SOURCE)
    # Without isolation, so that no network is needed; setuptools is among the `dev` dependencies.
    own = ("--no-deps", "--no-build-isolation", "--disable-pip-version-check", "--wheel-dir", str(folder))
    run(sys.executable, "-m", "pip", "wheel", *own, str(folder / "source"))
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment of its own with the wheel; dependencies are those of this one, without the
    checkout, which only a .pth file leads to."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    python = str(folder / "bin" / "python")
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", str(wheel))
    found = subprocess.check_output([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], text=True)
    theirs = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (Path(found.strip()) / "dependencies.pth").write_text("\n".join(theirs))
    return folder / "bin"


@pytest.fixture(scope="module")
def compiled(installed: Path) -> Iterator[None]:
    """Kernels for the place of the wheel: copies of ours, since to compile them takes minutes of a processor."""
    (root,) = installed.parent.glob("lib/python*/site-packages/robocorba")
    ours, theirs = store().folder, KernelStore(root, cache_folder()).folder
    assert ours and theirs
    place_of = _CacheLocator.get_suitable_cache_subpath
    for file in {file.parent: file for file in sources(root)}.values():
        own = ours / place_of(str(ROOT / "robocorba" / file.relative_to(root)))
        if own.is_dir():
            shutil.copytree(own, theirs / place_of(str(file)))
    (theirs / "complete").touch()
    copies = {*theirs.rglob("*.nbc")}
    yield
    assert {*theirs.rglob("*.nbc")} == copies != set()
    shutil.rmtree(theirs)


def run(*command: str, **more: str) -> str:
    """What a command prints; it finds nothing by our environment."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, env={**clean, **more}, cwd="/", capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_holds_everything(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    sources = {file.relative_to(ROOT).as_posix() for file in (ROOT / "robocorba").rglob("*.py")}
    sources |= {
        f"robocorba/{file.relative_to(ROOT).as_posix()}" for of in OF_CHECKOUT for file in (ROOT / of).glob("*.py")
    }
    assert {name for name in sources if "/stubs/" not in name} - names == set()
    assert {name.split("/")[0] for name in names if not name.split("/")[0].endswith(".dist-info")} == {"robocorba"}
    assert {f"robocorba/idl/{file.name}" for file in (ROOT / "idl").glob("*.idl")} - names == set()
    assert {f"robocorba/samples/{file.name}" for file in (ROOT / "robocorba" / "samples").iterdir()} - names == set()
    static = ROOT / "robocorba" / "console" / "static"
    assert {f"robocorba/console/static/{file.name}" for file in static.iterdir()} - names == set()
    for stub in ("RoboCorba/__init__.py", "RoboCorba__POA/__init__.py", "map_editor_idl.py", "path_planner_idl.py"):
        assert f"robocorba/stubs/{stub}" in names
    assert [name for name in names if name.endswith(".pyc")] == []


def test_stubs_are_made_by_what_is_installed_beside_python(tmp_path: Path) -> None:
    """An environment that is used without being activated is not on PATH, nor need omniORB's programs be."""
    run(sys.executable, str(ROOT / "idl" / "make_stubs.py"), str(tmp_path / "stubs"), PATH=str(tmp_path))
    assert (tmp_path / "stubs" / "RoboCorba" / "__init__.py").is_file()


def test_it_is_the_wheel_that_runs(installed: Path, tmp_path: Path) -> None:
    """Also as a module beside others, but for a folder `robocorba`, which Python itself takes for the package."""
    assert run(str(installed / "robocorba"), "version").strip() == __version__
    where = run(str(installed / "python"), "-c", "import robocorba.stubs, robocorba.servers; print(robocorba.__file__)")
    assert Path(where.strip()).is_relative_to(installed.parent)
    for name in ("msgspec", "numpy", "typer"):
        (tmp_path / f"{name}.py").write_text(STRANGER)
    command = (str(installed / "python"), "-m", "robocorba", "version")
    assert subprocess.check_output(command, cwd=tmp_path, text=True, timeout=60).strip() == __version__


@pytest.mark.usefixtures("compiled")
def test_servers_run_outside_the_checkout_and_no_strangers(installed: Path, tmp_path: Path) -> None:
    """What `robocorba` starts comes from the package, whatever lies where the user happens to be, or in the state
    folder."""
    for folder in (tmp_path, tmp_path / "state"):
        for package in ("clients", "servers", "robocorba"):
            (folder / package).mkdir(parents=True)
            (folder / package / "__init__.py").write_text(STRANGER)
        for name in ("clients/robot", "servers/simulation", "numpy", "msgspec"):
            (folder / f"{name}.py").write_text(STRANGER)
    robocorba, plain = str(installed / "robocorba"), {"PYTHONPATH": ""}
    with claimed_ports() as port, Launcher(tmp_path) as launch:
        naming, place = f"127.0.0.1:{port}", ("L1", "3", "4", "L3", "10", "2")
        up = launch(robocorba, "up", "--state", "state", "--naming-port", str(port), **plain)
        running = Running(up, tmp_path / "state", Address("127.0.0.1", port)).wait_ready()
        found = read_json(run(robocorba, "status", "--state", str(tmp_path / "state"), "--json"))["processes"]
        names = ["omniNames", "map_editor", "simulation", "sensor_s1", "events_main"]
        assert [process["name"] for process in found] == names
        assert {process["state"] for process in found} == {"running"}
        client = run(str(installed / "python"), "-m", "robocorba.clients.get_path", *place, naming)
        assert "ELEVATOR_ENTRY E" in client and "GOAL" in client.splitlines()[-1]
        robot = launch(robocorba, "robot", "A", "--naming", naming, "--state", "state", **plain)
        assert robot.stdout is not None and robot.stderr is not None
        assert robot.stdout.readline() == "ready\n", robot.stderr.read()
        robot.terminate()
        robot.wait(60.0)
        assert running.stop() == 0
        assert running.left_behind() == []
