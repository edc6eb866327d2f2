"""A guarded system attacked as a stranger, an observer, a robot, a robot with its own file: nothing beyond the table.

    python -m bench.chaos.roles

Each of them calls every operation of every object that they reach, by open keys, by names, by answers of other objects
and by guessed keys, and all operations of other interfaces on the same objects. The table is robocorba/system/roles.py:
what it refuses must answer NO_PERMISSION, what it allows must not. No answer, event or command may contain a secret.
The robots also forge names, sensors, events and missions; docs/operations.md says which of that is possible. Afterwards
map, names, links, missions, robots and processes must be as before."""

from __future__ import annotations

from typing import Any

from bench.common.harness import folder_of_bench, progress, run
from robocorba.events.corba.event_client import Event, EventClient
from testkit.fuzzing.simulation_targets import end_missions
from testkit.intrusion.guarded_system import ONE_ROBOT, ROBOT, ROLES, GuardedSystem, forgeries, guarded_system
from testkit.intrusion.intruder import Findings
from testkit.report import at_least, at_most, summarize
from testkit.simulation import error_lines


def attack(system: GuardedSystem, who: str) -> Findings:
    intruder = system.intruder(who)
    intruder.attack(system.named(who, intruder))
    endpoints = {*system.endpoints.values(), str(system.running.naming)}
    own_key = system.own_key(who)
    open_keys = [*system.open_keys]
    if own_key:
        open_keys += [own_key, f"{own_key}/registry", f"{own_key}/RoboCorba", f"{own_key}/RoboCorba/Robots"]
    intruder.guess(endpoints, open_keys, own_key)
    return intruder.findings


def row(who: str, findings: Findings) -> dict[str, Any]:
    counts = findings.calls.values()
    return {
        "who": who,
        "operations called": findings.pairs,
        "refused": sum(refused for _, refused in counts),
        "answered": sum(answered for answered, _ in counts),
        "out of reach": findings.out_of_reach,
        "objects reached by answers": sum(findings.reached.values()),
        "of other interfaces": findings.strange_calls,
        "guessed keys": findings.guesses,
        "beyond the table": len(findings.more),
        "refused though allowed": len(findings.less),
        "secrets seen": len(findings.secrets),
        "unanswered": len(findings.unanswered),
    }


def main() -> bool:
    events: list[Event] = []
    with folder_of_bench() as folder, guarded_system(folder) as system:
        with EventClient(system.orb, "a") as client:
            client.subscribe(events.append)
            before = system.state()
            found = {who: attack(system, who) for who in progress(list(ROLES), "roles")}
            forged = [each for who in (ROBOT, ONE_ROBOT) for each in forgeries(system, who)]
            end_missions(system.fuzzed, "putMission", None)  # robots may write records
            after = system.state()
        texts = {"events": repr(events), "command lines": system.command_lines()}
        texts["printed by up"] = "\n".join(system.running.printed)
        for where, text in texts.items():
            for what, secret in system.secrets().items():
                if secret in text:
                    found[ROBOT].secrets.append(f"{where}: {what}")
        logged = error_lines(folder / "state")
    rows = [row(who, findings) for who, findings in found.items()]
    of = {"beyond the table": "more", "refused": "less", "secret": "secrets", "unanswered": "unanswered"}
    complaints = [
        f"{who}: {what}: {each}"
        for who, findings in found.items()
        for what, name in of.items()
        for each in getattr(findings, name)
    ]
    changed = [f"{key}: {before[key]} became {after[key]}" for key in before if before[key] != after[key]]
    wrong = [each for each in forged if not each.is_as_documented]
    for each in forged:
        print(f"{each.who}: {each.what}: {each.refusal or 'possible'}{'  (!)' if each in wrong else ''}")
    print(*complaints, *changed, *logged[:20], sep="\n")
    pairs = {who: float(findings.pairs) for who, findings in found.items()}
    marks = [
        at_least("pairs of operation and role", sum(pairs.values()) + sum(each["out of reach"] for each in rows), 500),
        *(
            at_most(what, sum(each[what] for each in rows), 0)
            for what in ("beyond the table", "refused though allowed", "secrets seen", "unanswered")
        ),
        at_most("forgeries that docs/operations.md says otherwise of", len(wrong), 0),
        at_most("things that changed", len(changed), 0),
        at_most("errors in logs", len(logged), 0),
    ]
    title = "A guarded system attacked by roles"
    more = {"forgeries": [each._asdict() for each in forged]}
    return summarize("chaos_roles", title, rows, marks, **more)


if __name__ == "__main__":
    run(main)
