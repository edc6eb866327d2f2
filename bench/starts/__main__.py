"""All benches of starts, one after the other, with the same base: python -m bench.starts [--quick] [--long]

--quick: few rounds, and no start without kernels. --long: also a server that is stopped for a minute."""

from __future__ import annotations

import subprocess
import sys

from bench.common.harness import run
from bench.starts.systems import BASE
from testkit.json_process import ROOT


def measure(base: str = BASE, quick: bool = False, long: bool = False) -> bool:
    compared = ("--base", base)
    commands: list[tuple[str, ...]] = [
        ("ready", *compared, *(("--rounds", "3") if quick else ())),
        ("kills", *compared, *(("--rounds", "3") if quick else ())),
        ("memory", *compared),
        ("forks", *(("--forks", "20") if quick else ())),
    ]
    if not quick:
        commands.append(("ready", "--empty", *compared))
    if long:
        commands.append(("hangs", *compared))
    codes = []
    for name, *options in commands:
        print("==", name, *options, flush=True)
        codes.append(subprocess.run([sys.executable, "-m", f"bench.starts.{name}", *options], cwd=ROOT).returncode)
    return not any(codes)


if __name__ == "__main__":
    run(
        measure,
        base="commit to compare with, empty for none",
        quick="few rounds, no start without kernels",
        long="also hangs, which take a minute a server",
    )
