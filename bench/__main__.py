"""Run benches one after the other, each in a process of its own: python -m bench [NAME ...]"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

#: In this order where no name is given.
BENCHES = ("get_path", "large_building", "editing", "every_query", "geometric")
ROOT = Path(__file__).resolve().parents[1]


def main(names: list[str]) -> int:
    """Exit code: 0 if every bench reached what it has to, 1 if one did not, 2 for an unknown name."""
    unknown = [name for name in names if name not in BENCHES]
    if unknown:
        print(f"bench: there is no {', '.join(unknown)}; there are {', '.join(BENCHES)}", file=sys.stderr)
        return 2
    failed = []
    for name in names or BENCHES:
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, "-m", f"bench.{name}"], cwd=ROOT).returncode:
            failed.append(name)
    if failed:
        print(f"bench: {', '.join(failed)} failed or missed a mark, see above", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
