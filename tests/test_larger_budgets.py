"""State machines with more examples than the first half has time for: of faults that take three rules in a certain
order, the usual examples find few. `--hypothesis-seed=2` draws others."""

from __future__ import annotations

import pkgutil

import pytest
from hypothesis import seed, settings
from hypothesis.stateful import run_state_machine_as_test

pytestmark = [pytest.mark.full, pytest.mark.slow(40)]

#: Examples of each, 4 to 10 s of a processor.
EXAMPLES = {
    "events.test_federation_machine:FederationMachine": 75,
    "map_editor.test_proposals:ProposalMachine": 75,
    "missions.test_carry_agreement:Carry": 100,
    "missions.test_missions_under_faults:Missions": 15,
    "missions.test_succession_of_leaders:Succession": 200,
    "orb.test_pool_follower:Following": 20,
    "robot.test_alone:SharedStops": 200,
    "robot.test_emergency_stop:Stops": 75,
    "robot.test_program_runs:Runs": 20,
    "robot.test_uploads:Life": 20,
    "simulation.test_log_on:LogOn": 50,
    "simulation.test_map_edits:MapEdits": 40,
    "simulation.test_traffic:Traffic": 40,
}


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", EXAMPLES)
def test_a_machine_with_more_examples(name: str, request: pytest.FixtureRequest) -> None:
    number = int(request.config.getoption("--hypothesis-seed") or 1)
    machine = pkgutil.resolve_name(f"tests.{name}")
    larger = settings(machine.TestCase.settings, max_examples=EXAMPLES[name], derandomize=False, database=None)
    run_state_machine_as_test(seed(number)(type(machine.__name__, (machine,), {})), settings=larger)
