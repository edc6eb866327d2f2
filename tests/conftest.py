"""What the whole suite shares."""

from __future__ import annotations

import functools
import gc
import itertools
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from robocorba.planning.planner import PathPlanner
from robocorba.system.supervision.compilation import compile_kernels
from robocorba.system.supervision.compile_worker import STEPS

pytest_plugins = ("tests.failures", "tests.skips")

# The same examples in each run, so that it says the same on every machine; `--hypothesis-profile random` looks for
# new ones. How long examples take to make says something of the machine and its load, nothing of what is tested.
register = functools.partial(
    hypothesis.settings.register_profile, deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
register("suite", derandomize=True)
register("random")
hypothesis.settings.load_profile("suite")


def pytest_configure(config: pytest.Config) -> None:
    """Each worker is a session of its own, as the processes are that it starts. Linux shares processors among sessions:
    in one with all other workers, a robot within a test waits for seconds on a busy machine, and loses its lease."""
    if hasattr(config, "workerinput"):
        os.setsid()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files of the other half are not even imported, by any worker; whole files are marked."""
    half = {"full": False, "not full": True}.get(config.getoption("markexpr"))
    if half is None or not collection_path.name.startswith("test_") or collection_path.suffix != ".py":
        return None
    return ("pytest.mark.full" in collection_path.read_text()) is half or None


#: Files whose tests share nothing, not even a fixture that takes long: workers get their tests one by one.
SINGLE_TESTS = (
    "test_larger_budgets.py",
    "test_building_option.py",
    "test_proposals.py",
    "test_up.py",
    "test_up_subnets.py",
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """As `--dist loadfile`, in the order of the tests, but what waits behind a long one is short."""
    from xdist.scheduler import LoadScopeScheduling  # imported here: without it all tests run in this process

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return nodeid if file.endswith(SINGLE_TESTS) else file

        def _reschedule(self, node: Any) -> None:
            """A worker begins a test when it has the one after it: behind its first one that is the shortest file."""
            units = self.assigned_work[node].values()
            if self.workqueue and self._pending_of(self.assigned_work[node]) > 1:
                return
            if self.workqueue and not any(any(unit.values()) for unit in units):
                self.workqueue.move_to_end(next(reversed(self.workqueue)), last=False)
            super()._reschedule(node)

    return Scheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that wait for real processes come first, the longest ones before the others, so that no worker is left
    alone with one of them at the end."""

    def seconds(item: pytest.Item) -> float:
        mark = item.get_closest_marker("slow")
        return float((*mark.args, 60.0)[0]) if mark else 0.0

    items.sort(key=lambda item: (-seconds(item), item.get_closest_marker("system") is None))


def pytest_collection_finish() -> None:
    """Tests and what they import stay to the end: looking for garbage among them takes a tenth of the suite's time."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.fixture(scope="session", autouse=True)
def sigint() -> None:
    """Shells let what they start in the background ignore Ctrl-C, and it would be ignored by all that tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def patient_planners() -> Iterator[None]:
    """Planners of this process have a minute for a query by default, as a busy machine needs. Tests of the limit set
    their own, and processes that tests start have that of the product."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PathPlanner.__init__, "__defaults__", (0, 60.0))
        yield


@pytest.fixture(scope="session", autouse=True)
def kernels(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compile once what servers and robots use, and load it, before any test's clock runs."""
    assert compile_kernels(lambda progress: None, tmp_path_factory.mktemp("compilation"))
    for load in itertools.chain(*STEPS):
        load()
