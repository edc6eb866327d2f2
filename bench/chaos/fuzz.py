"""Every operation of the IDL with nonsense, beside a client that does nothing wrong.

    python -m bench.chaos.fuzz [--inputs 1000] [--seconds 60] [--only NAME] [--seed 1]

Arguments are made from the type descriptors of the stubs: NaN, infinities, extreme integers, empty, huge and
ill-formed texts, nested anys, huge sequences, nil and foreign references, enumerators that don't exist, messages that
end too early, and plausible values from the running system, so that calls get deep. Right are an answer, an exception
of the operation, and the system exceptions in testkit.fuzzing.calls. Operations that end their object get a
fresh one for each call; destroy and pull are not called. `seconds` ends the calls of one operation early, such as
those that analyse the whole building."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.chaos.beside import Complaints, beside
from bench.common.harness import folder_of_bench, progress, run
from testkit.fuzzing.calls import Tally, Target, call_many
from testkit.fuzzing.fuzzed_system import FuzzedSystem, fuzzed_system
from testkit.fuzzing.operations import Operation, operations
from testkit.fuzzing.targets import targets
from testkit.report import at_most, bars, summarize
from testkit.simulation import error_lines


def _calls(system: FuzzedSystem, only: str) -> Iterator[tuple[Target, Operation]]:
    for target in targets(system):
        for operation in operations(target.interface):
            if operation.name not in target.omitted and only in f"{target.name}.{operation.name}":
                yield target, operation


def _row(name: str, tallies: list[Tally]) -> dict[str, Any]:
    counts = [(outcome, count) for tally in tallies for outcome, count in tally.outcomes.items()]
    system = {"BAD_PARAM", "DATA_CONVERSION", "MARSHAL"}
    return {
        "interface": name,
        "operations": len(tallies),
        "calls": sum(tally.calls for tally in tallies),
        "answers": sum(count for outcome, count in counts if outcome == "success"),
        "refused by the ORB": sum(count for outcome, count in counts if outcome in system),
        "other exceptions": sum(count for outcome, count in counts if outcome != "success" and outcome not in system),
        "faults": sum(len(tally.faults) for tally in tallies),
        "longest call, s": max(tally.slowest_s for tally in tallies),
    }


def main(inputs: int = 1000, seconds: float = 60.0, only: str = "", seed: int = 1) -> bool:
    by_target: dict[str, list[Tally]] = {}
    faults: list[str] = []
    complain = Complaints()
    with folder_of_bench() as folder, fuzzed_system(folder) as system:
        with beside(system.running.naming, ("a", "B", "3,3", "6,5"), complain) as bystander:
            everything = list(_calls(system, only))
            bystander.begin()
            for target, operation in progress(everything, "operations"):
                where = bystander.complain.beside = f"{target.name}.{operation.name}"
                tally = call_many(target, operation, inputs, seed, system.seen, seconds)
                by_target.setdefault(target.name, []).append(tally)
                faults += [f"{where}: {what} for {arguments}" for what, arguments in tally.faults.items()]
                if tally.calls < inputs:
                    print(f"{where}: {tally.calls} calls in {seconds:g} s")
                bystander.look()
        ended, logged = system.ended(), error_lines(folder / "state") + error_lines(folder / "actual" / "state")
    print(*faults, *logged[:50], sep="\n")
    complain.print_rest()
    rows = [_row(each, tallies) for each, tallies in by_target.items()]
    marks = [
        at_most("calls that raised UNKNOWN or another fault", sum(row["faults"] for row in rows), 0),
        at_most("processes that ended", len(ended), 0),
        at_most("errors in logs", len(logged), 0),
        at_most("failed calls of another client", complain.count, 0),
        *bystander.marks(),
    ]
    title = f"{len(everything)} operations with {inputs} inputs each"
    return summarize("chaos_fuzz", title, rows, marks, bars(bystander.longest, "longest call of another client, s"))


if __name__ == "__main__":
    run(
        main,
        inputs="for each operation",
        seconds="at most for each operation",
        only="only operations whose interface or name has this text",
        seed="of the inputs",
    )
