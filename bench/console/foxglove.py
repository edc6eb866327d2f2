"""`robocorba foxglove` and recordings for Foxglove beside 50 robots, 8 with lasers and arms.

    python -m bench.console.foxglove [--seconds S] [--recorded S] [--robots N]

A client subscribes to all topics of `robocorba foxglove` while all robots drive. Then the system is recorded twice at
the same time, compact and for Foxglove, and the compact recording is converted; both files are read by the mcap
package."""

from __future__ import annotations

import statistics
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from bench.common.harness import run
from bench.console.crowd import Crowd, crowded_system
from robocorba.simulation.recording import Recording
from testkit.foxglove_client import FoxgloveClient
from testkit.processes import ROBOCORBA
from testkit.report import at_least, at_most, summarize

#: Time before each measurement [s].
SETTLE_S = 3.0
STOP_LIMIT_S = 60.0


def live(crowd: Crowd, seconds: float) -> dict[str, Any]:
    """Row of the live server beside one client, which reads in the background."""
    server = crowd.place.launch(ROBOCORBA, "foxglove", "--port", "0", "--naming", str(crowd.place.orb.naming))
    assert server.stdout is not None
    ended = threading.Event()
    with FoxgloveClient(server.stdout.readline().strip()) as client:
        reader = threading.Thread(target=client.until, args=(ended.is_set, float("inf")))
        reader.start()
        time.sleep(SETTLE_S)
        before = {topic: len(found) for topic, found in client.messages.items()}
        row = crowd.measured(seconds, server.pid)
        counts = {topic: len(found) - before.get(topic, 0) for topic, found in client.messages.items()}
        ended.set()
        reader.join()
    server.terminate()
    server.wait(STOP_LIMIT_S)
    poses = statistics.median(count / seconds for topic, count in counts.items() if topic.endswith("/pose"))
    return {"what": "live", **row, "/tf, 1/s": counts["/tf"] / seconds, "poses of a robot, 1/s": poses}


def recordings(crowd: Crowd, seconds: float) -> list[dict[str, Any]]:
    """Rows of both recordings, and of the converted one."""
    compact, foxglove, converted = (
        crowd.place.folder / f"{name}.mcap" for name in ("compact", "foxglove", "converted")
    )
    more = ("--seconds", str(seconds), "--naming", str(crowd.place.orb.naming))
    arguments = (str(compact),), (str(foxglove), "--foxglove")
    recorders = [crowd.place.launch(ROBOCORBA, "record", *each, *more) for each in arguments]
    assert [recorder.wait(seconds + STOP_LIMIT_S) for recorder in recorders] == [0, 0]
    began = time.monotonic()
    subprocess.run([ROBOCORBA, "convert", str(compact), str(converted)], check=True, stdout=subprocess.DEVNULL)
    convert_s = time.monotonic() - began
    duration_s, size = Recording(compact).duration_s, compact.stat().st_size
    rows = [
        {"what": file.stem, "kB/s": file.stat().st_size / duration_s / 1e3, "x compact": file.stat().st_size / size}
        for file in (compact, foxglove, converted)
    ]
    for row, file in zip(rows[1:], (foxglove, converted), strict=True):
        row["messages"] = messages(file)
    return [*rows[:-1], {**rows[-1], "convert, x real time": duration_s / convert_s}]


def messages(file: Path) -> int:
    """Number of messages that foreign readers decode; raises if they can't."""
    factory, count = DecoderFactory(), 0
    with open(file, "rb") as opened:
        for schema, channel, message in make_reader(opened, validate_crcs=True).iter_messages():
            if channel.message_encoding == "protobuf":
                decode = factory.decoder_for(channel.message_encoding, schema)
                assert decode is not None
                decode(message.data)
            count += 1
    return count


def measure(seconds: float = 15.0, recorded: float = 0.0, robots: int = 50) -> bool:
    with crowded_system(robots) as crowd:
        time.sleep(SETTLE_S)
        alone = crowd.measured(seconds / 2)
        rows = [live(crowd, seconds), *recordings(crowd, recorded or seconds)]
    shown, _, written, converted = rows
    marks = [
        at_most("live server, share of a core", shown["cores"], 0.2),
        at_least("updates of a robot each second, live", shown["poses of a robot, 1/s"], 15.0),
        at_least("pace beside that without viewers", shown["pace"] / alone["pace"], 0.98),
        at_most("recorded for Foxglove, x compact", written["x compact"], 3.0),
        at_most("converted, x compact", converted["x compact"], 3.0),
    ]
    return summarize("console_foxglove", f"Foxglove beside {robots} robots", rows, marks)


if __name__ == "__main__":
    run(
        measure,
        seconds="of each measurement",
        recorded="length of the recordings [s]; 0: as the others",
        robots="on one floor",
    )
