"""The two halves of the suite: `make test` shows that the system works, tests marked `full` are the rest."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: Words of the README that promise something, and the test in tests/system, of the first half, that keeps the
#: promise. A file of processes that keeps none of them is marked `full`.
PROMISES = {
    "make demo": "test_clients.py::test_the_demo_carries_the_table",
    "any CORBA client in any language can call": "test_map_editor.py::test_an_edit_is_seen_by_the_next_path",
    "naming service and all servers; prints `ready`; Ctrl-C stops them": "test_up.py::test_the_real_servers",
    "robocorba path": "test_clients.py::test_the_command_prints_and_draws",
    "robocorba robot A": "test_robot.py::test_pause_step_and_end_by_the_command",
    "an emergency stop": "test_robot.py::test_an_emergency_stop_by_the_command",
    "a fleet, in one table": "test_robot.py::test_one_dies_the_others_go_on_and_all_log_off",
    "robots, elevators and sensors, live": "test_watch_and_record.py::test_it_is_live_on_a_terminal",
    "prints the address of a page": "test_console.py::test_the_console_is_a_process_of_the_system",
    "edit the building": "test_map_editor.py::test_each_kind_is_created_read_changed_and_removed",
    "drives until its virtual laser measures": "test_clients.py::test_it_drives_until_something_is_near",
    "a laser scan": "test_simulation.py::test_many_scans_in_one_call_are_those_of_single_calls",
    "resolve the corbaname URI": "test_clients.py::test_a_bare_uri_and_the_stubs_suffice",
    "it forwards only events": "test_event_federation.py::test_an_uninterested_channel_receives_nothing",
    "client of OMG's event service": "test_event_channel.py::test_pulls_that_timed_out_lose_no_event",
    "subscribe_together": "test_event_channel.py::test_a_conjunction_delivers_its_events_together_within_the_window",
    "a server after kill -9": "test_references.py::test_a_reference_works_again_after_kill_9_and_a_start_by_hand",
    "one program on a virtual and on an actual robot": "test_smartpal.py::test_base_and_arms_go_where_they_shall",
    "Foxglove": "test_watch_and_record.py::test_recordings_for_foxglove",
}


def files() -> dict[str, ast.Module]:
    """Test modules by their path in tests/."""
    return {
        file.relative_to(ROOT / "tests").as_posix(): ast.parse(file.read_text())
        for file in (ROOT / "tests").rglob("test_*.py")
    }


def marks(module: ast.Module) -> tuple[set[str], set[str]]:
    """The marks of a whole module, and those of its single tests."""
    of_module: set[str] = set()
    for node in module.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            of_module |= set(re.findall(r"pytest\.mark\.(\w+)", ast.unparse(node.value)))
    decorators = [each for node in module.body for each in getattr(node, "decorator_list", ())]
    return of_module, set(re.findall(r"pytest\.mark\.(\w+)", " ".join(map(ast.unparse, decorators))))


@pytest.fixture(scope="module")
def modules() -> dict[str, ast.Module]:
    return files()


def test_each_promise_of_the_readme_has_a_test_with_real_processes_in_the_first_half(
    modules: dict[str, ast.Module],
) -> None:
    parts = re.split(r"^#+ (.+)\n", (ROOT / "README.md").read_text(), flags=re.MULTILINE)
    kept = set()
    for words, test in PROMISES.items():
        path, name = test.split("::")
        assert [node for node in modules[f"system/{path}"].body if getattr(node, "name", "") == name], test
        assert "full" not in marks(modules[f"system/{path}"])[0], test
        named = {title for title, text in zip(parts[1::2], parts[2::2], strict=True) if words in " ".join(text.split())}
        assert named, words
        kept |= named
    assert kept == set(parts[1::2])


def test_a_file_is_in_the_second_half_that_starts_processes_and_keeps_no_promise_or_has_larger_budgets(
    modules: dict[str, ast.Module],
) -> None:
    keeping = {"system/" + test.split("::")[0] for test in PROMISES.values()}
    for path, module in modules.items():
        of_module, of_tests = marks(module)
        assert "full" not in of_tests, f"{path}: whole files are marked"
        starts_processes = "system" in of_module | of_tests or path.startswith("system/")
        is_rest = starts_processes and path not in keeping
        assert ("full" in of_module) == (is_rest or path == "test_larger_budgets.py"), path
