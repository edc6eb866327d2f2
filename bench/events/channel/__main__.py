"""python -m bench.events.channel [latency|throughput|stalled|fanout|memory|all] [--quick] [--minutes N]"""

from __future__ import annotations

import importlib
import sys

from bench.common.harness import run

BENCHES = ("latency", "throughput", "stalled", "fanout")


def main(*bench: str, quick: bool = False, minutes: float = 60.0) -> bool:
    names = BENCHES if bench in ((), ("all",)) else bench
    if unknown := set(names) - {*BENCHES, "memory"}:
        sys.exit(f"there is no bench {', '.join(unknown)}; there are {', '.join(BENCHES)}, memory, all")
    modules = {name: importlib.import_module(f"bench.events.channel.{name}") for name in names}
    missed = [n for n, module in modules.items() if not module.measure(minutes if n == "memory" else quick)]
    if missed:
        print(f"missed a mark, see above: {', '.join(missed)}", file=sys.stderr)
    return not missed


if __name__ == "__main__":
    run(main, bench="default: all but memory", quick="fewer rounds", minutes="duration of the bench `memory`")
