"""Run the benches of some or all subjects, each as a process: python -m bench [SUBJECT ...]

`python -m bench.SUBJECT.NAME --help` lists the options of one bench."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from bench.common.harness import NOT_MEASURED

#: By subject; their results are those of the pages.
BENCHES = {
    "planning": ("get_path", "large_building", "editing", "geometric"),
    "events": ("network --network paper", "network --network paper --leader all", "network", "channel", "advice"),
    "simulation": ("rays", "render", "headless", "robots", "sensors", "chaos"),
    "robots": (
        *("kinematics", "virtual_and_actual", "control", "stops", "protection", "perception", "kept_stops"),
        *("fleet", "fleet --robots 200 --stops 2"),
    ),
    "missions": (
        *("many", "network", "carry --seeds 1 --actual B", "carry --seeds 100"),
        *("faults --missions 20 --fault cut", "faults --missions 30 --fault ways"),
        *("faults --missions 50 --site door --fault servers", "faults --missions 20 --site storehouse --fault robots"),
        *("faults --missions 33 --site door --fault robots", "faults --missions 33 --site elevator --fault robots"),
        *("faults --missions 34 --fault robots", "faults"),
    ),
    "console": ("viewers", "foxglove", "ros2"),
    "starts": ("ready", "ready --rounds 1 --empty", "kills"),
    "chaos": ("roles",),
}
ROOT = Path(__file__).resolve().parents[1]


def main(subjects: list[str]) -> int:
    """Returns the exit code: 0 if every bench reached its marks, 1 if one did not, 2 for an unknown subject, 3 if one
    could not measure and the others reached theirs."""
    if {"--help", "-h"} & set(subjects):
        print(__doc__, *(f"{subject}: {', '.join(names)}" for subject, names in BENCHES.items()), sep="\n")
        return 0
    unknown = [subject for subject in subjects if subject not in BENCHES]
    if unknown:
        print(f"bench: unknown subject {', '.join(unknown)}; choose from {', '.join(BENCHES)}", file=sys.stderr)
        return 2
    failed, unmeasured = [], []
    for name in [f"{subject}.{name}" for subject in subjects or BENCHES for name in BENCHES[subject]]:
        print(f"== {name}", flush=True)
        code = subprocess.run([sys.executable, "-m", *f"bench.{name}".split()], cwd=ROOT).returncode
        if code:
            (unmeasured if code == NOT_MEASURED else failed).append(name)
    if failed:
        print(f"bench: {', '.join(failed)} failed or missed a mark, see above", file=sys.stderr)
    if unmeasured:
        print(f"bench: {', '.join(unmeasured)} could not measure, see above", file=sys.stderr)
    return 1 if failed else NOT_MEASURED if unmeasured else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
