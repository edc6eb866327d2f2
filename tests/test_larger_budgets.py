"""State machines with more examples than the first half has time for: of faults that take three rules in a certain
order, the usual examples find few. `--hypothesis-seed=2` draws others."""

from __future__ import annotations

import pkgutil

import pytest
from hypothesis import seed, settings
from hypothesis.stateful import run_state_machine_as_test

pytestmark = [pytest.mark.full, pytest.mark.slow(40)]

#: Examples of each, 5 to 12 s of a processor.
EXAMPLES = {
    "events.test_federation_machine:FederationMachine": 150,
    "map_editor.test_proposals:ProposalMachine": 150,
    "missions.test_carry_agreement:Carry": 200,
    "missions.test_missions_under_faults:Missions": 25,
    "missions.test_succession_of_leaders:Succession": 400,
    "orb.test_pool_follower:Following": 40,
    "robot.test_alone:SharedStops": 500,
    "robot.test_emergency_stop:Stops": 150,
    "robot.test_program_runs:Runs": 40,
    "robot.test_uploads:Life": 40,
    "simulation.test_log_on:LogOn": 100,
    "simulation.test_map_edits:MapEdits": 75,
    "simulation.test_traffic:Traffic": 75,
}


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", EXAMPLES)
def test_a_machine_with_more_examples(name: str, request: pytest.FixtureRequest) -> None:
    number = int(request.config.getoption("--hypothesis-seed") or 1)
    machine = pkgutil.resolve_name(f"tests.{name}")
    larger = settings(machine.TestCase.settings, max_examples=EXAMPLES[name], derandomize=False, database=None)
    run_state_machine_as_test(seed(number)(type(machine.__name__, (machine,), {})), settings=larger)
