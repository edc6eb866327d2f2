"""Run the benches of some or all subjects, each as a process: python -m bench [SUBJECT ...]

`python -m bench.SUBJECT.NAME --help` lists the options of one bench."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

BENCHES = {
    "planning": ("get_path", "large_building", "editing", "geometric"),
    "events": ("network", "channel", "chaos"),
    "simulation": ("rays", "render", "headless", "robots", "sensors", "chaos", "attacks"),
    "robots": ("kinematics", "virtual_and_actual", "control", "stops", "fleet"),
    "missions": ("carry", "network", "many", "elevators", "chaos", "ways", "survival", "partition"),
    "console": ("viewers", "returns", "foxglove", "ros2"),
    "starts": ("ready", "kills", "memory", "forks"),
    "chaos": ("fuzz", "roles", "guarded_cost"),
}
ROOT = Path(__file__).resolve().parents[1]


def main(subjects: list[str]) -> int:
    """Returns the exit code: 0 if every bench reached its marks, 1 if one did not, 2 for an unknown subject."""
    unknown = [subject for subject in subjects if subject not in BENCHES]
    if unknown:
        print(f"bench: unknown subject {', '.join(unknown)}; choose from {', '.join(BENCHES)}", file=sys.stderr)
        return 2
    failed = []
    for name in [f"{subject}.{name}" for subject in subjects or BENCHES for name in BENCHES[subject]]:
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, "-m", f"bench.{name}"], cwd=ROOT).returncode:
            failed.append(name)
    if failed:
        print(f"bench: {', '.join(failed)} failed or missed a mark, see above", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
