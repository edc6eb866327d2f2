"""python -m bench.events.channel [latency|throughput|stalled|fanout|memory|all] [--quick] [--minutes N]"""

from __future__ import annotations

import argparse
import importlib
import sys

BENCHES = ("latency", "throughput", "stalled", "fanout")


def main() -> int:
    """Exit code: 0 if every mark was reached, 1 if one was missed."""
    parser = argparse.ArgumentParser(prog="python -m bench.events.channel", description=__doc__)
    parser.add_argument("bench", nargs="?", choices=(*BENCHES, "memory", "all"), default="all")
    parser.add_argument("--quick", action="store_true", help="fewer rounds, less accurate figures")
    parser.add_argument("--minutes", type=float, default=60.0, help="duration of the bench `memory`")
    options = parser.parse_args()
    missed = []
    for name in BENCHES if options.bench == "all" else (options.bench,):
        bench = importlib.import_module(f"bench.events.channel.{name}")
        if not (bench.run(options.minutes) if name == "memory" else bench.run(options.quick)):
            missed.append(name)
    if missed:
        print(f"missed a mark, see above: {', '.join(missed)}", file=sys.stderr)
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
