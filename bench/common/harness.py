"""The frame of every bench: its command line, its progress, the system that it measures, and calls in turns."""

from __future__ import annotations

import argparse
import contextlib
import inspect
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, NoReturn, TypeVar

from rich.progress import track

from robocorba.map_editor import native
from robocorba.map_editor.model import Building
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit import report
from testkit.json_process import ProcessFailed
from testkit.processes import Launcher, Running, running_system
from testkit.report import PROGRESS, NotMeasured, timed_ms

T = TypeVar("T")
#: Exit code of a bench that could not measure.
NOT_MEASURED = 3
#: The rooms of robocorba/ that the benches of a subject measure, where they name no other paths as MEASURES.
ROOMS = {
    "planning": ("planning", "map_editor"),
    "robots": ("robot",),
    "missions": ("missions", "robot"),
    "starts": ("system", "orb"),
    "chaos": ("orb", "events", "simulation"),
}


def run(measure: Callable[..., bool], **texts: str) -> NoReturn:
    """Run a bench with an option for each parameter of `measure`, and exit with 0 if it returned True, 1 if it missed a
    mark, NOT_MEASURED if it raised NotMeasured.

    Types and defaults are those of the parameters. texts: help of an option; `A|B` gives its choices. Results of a run
    with other options than the default ones have them in their names."""
    parser = argparse.ArgumentParser(
        description=sys.modules[measure.__module__].__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, parameter in inspect.signature(measure, eval_str=True).parameters.items():
        text, option = texts.get(name, ""), f"--{name.replace('_', '-')}"
        choices = text.split("|") if "|" in text else None
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            parser.add_argument(name, nargs="*", help=text)
        elif parameter.annotation is bool:
            parser.add_argument(option, action="store_true", help=text)
        else:
            text += " (default: %(default)s)"
            kind, default = parameter.annotation, parameter.default
            parser.add_argument(option, type=kind, default=default, choices=choices, help=text)
    options = vars(parser.parse_args())
    positional = next((value for value in options.values() if isinstance(value, list)), [])
    named = {name: value for name, value in options.items() if not isinstance(value, list)}
    changed = {name: value for name, value in named.items() if value != parser.get_default(name)}
    report.run = report.Run(options, changed, measured_paths(sys.modules[measure.__module__]))
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(0 if measure(*positional, **named) else 1)
    except NotMeasured as reason:
        print(f"not measured: {reason}", file=sys.stderr)
        sys.exit(NOT_MEASURED)
    except (ProcessFailed, KeyboardInterrupt) as error:
        sys.exit(f"bench: {str(error) or 'stopped'}")


def measured_paths(bench: ModuleType) -> list[str]:
    """The bench itself, and what it measures."""
    subject = (bench.__spec__.name if bench.__spec__ else "").split(".")[1:2]
    rooms = [f"robocorba/{room}" for each in subject for room in ROOMS.get(each, (each,))]
    return [str(Path(str(bench.__file__)).relative_to(report.ROOT)), *getattr(bench, "MEASURES", rooms)]


def skip(what: str, why: str) -> None:
    """Note in the results what this run does not measure."""
    PROGRESS.print(f"not measured: {what}: {why}")
    if report.run:
        report.run.skipped.append(f"{what}: {why}")


def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterable[T]:
    """The items, with a progress bar on stderr."""
    return track(items, what, total, console=PROGRESS, transient=True)


@contextlib.contextmanager
def folder_of_bench() -> Iterator[Path]:
    """A folder for all files of a bench but its results."""
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder:
        yield Path(folder)


class System(NamedTuple):
    """A running `robocorba up` with its files in a folder of the bench, and this process's ORB."""

    folder: Path
    running: Running
    launch: Launcher
    orb: Orb

    def resolve(self, interface: str) -> Any:
        """The server that is bound by the name of its interface, such as PathPlanner."""
        return self.orb.resolve(interface, getattr(RoboCorba, interface))


@contextlib.contextmanager
def system(*options: str, building: Building | Path | None = None) -> Iterator[System]:
    """`robocorba up` with these options, on a building; without one on the sample."""
    with folder_of_bench() as folder:
        if isinstance(building, Building):
            native.save(building, folder / "building.yaml")
            building = folder / "building.yaml"
        on = () if building is None else ("--building", str(building))
        with running_system(folder, *on, *options) as (running, launch), Orb(running.naming) as orb:
            yield System(folder, running, launch, orb)


def alternately(turns: Iterable[Mapping[str, Callable[[], object]]]) -> dict[str, list[float]]:
    """The durations of each call [ms], which alternate so that a busy moment of the machine affects all of them."""
    took: defaultdict[str, list[float]] = defaultdict(list)
    for turn in turns:
        for name, call in turn.items():
            took[name].append(timed_ms(call)[1])
    return took


@contextlib.contextmanager
def sampled(call: Callable[[], T], interval_s: float) -> Iterator[list[tuple[float, T]]]:
    """The times [s, time.monotonic] and answers of a call that a thread repeats within the `with`."""
    samples: list[tuple[float, T]] = []

    def sample() -> None:
        answer = call()
        samples.append((time.monotonic(), answer))

    with contextlib.closing(Repeating("sampler", sample, interval_s).start()):
        yield samples
