"""python -m bench.events.channel [latency|throughput|fanout|growth] [--quick]"""

from __future__ import annotations

import sys
from functools import partial

from bench.common.harness import run, skip
from bench.events.channel.growth import growth
from bench.events.channel.speed import fanout, latency, throughput
from testkit.peers import PEERS, installed


def main(*bench: str, quick: bool = False) -> bool:
    benches = {one.__name__: partial(one, quick) for one in (latency, throughput, fanout, growth)}
    if unknown := set(bench) - benches.keys():
        sys.exit(f"there is no bench {', '.join(unknown)}; there are {', '.join(benches)}")
    for name, peer in PEERS.items():
        if name not in installed():
            skip(name, f"{peer.missing()} is not installed")
    missed = [name for name in bench or benches if not benches[name]()]
    if missed:
        print(f"missed a mark, see above: {', '.join(missed)}", file=sys.stderr)
    return not missed


if __name__ == "__main__":
    run(main, bench="default: all", quick="fewer rounds")
