"""`robocorba foxglove` and recordings for Foxglove beside 50 robots, 8 with lasers and 3 with arms.

    python -m bench.console.foxglove [--seconds S] [--recorded S] [--robots N]

A client subscribes to all topics of `robocorba foxglove` while all robots drive. Then the system is recorded twice at
the same time, compact and for Foxglove, and the compact recording is converted; both files are read by the mcap
package."""

from __future__ import annotations

import contextlib
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from bench.common.harness import folder_of_bench, progress, run
from bench.console.crowd import Clock, crowded_system
from robocorba.orb.naming import Address
from robocorba.simulation.recording import Recording
from testkit.foxglove_client import FoxgloveClient
from testkit.json_process import Cpu
from testkit.processes import ROBOCORBA
from testkit.report import at_least, at_most, bars, summarize

NAME = "console_foxglove"
#: Time before each measurement [s].
SETTLE_S = 3.0
STOP_LIMIT_S = 60.0


@contextlib.contextmanager
def watched(naming: Address) -> Iterator[tuple[int, FoxgloveClient]]:
    """A client of a live server: the server's process id, and the client, which reads in the background."""
    command = [ROBOCORBA, "foxglove", "--port", "0", "--naming", str(naming)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ended = threading.Event()
        try:
            with FoxgloveClient(process.stdout.readline().strip()) as client:
                reader = threading.Thread(target=client.until, args=(ended.is_set, float("inf")))
                reader.start()
                try:
                    yield process.pid, client
                finally:
                    ended.set()
                    reader.join()
        finally:
            process.terminate()
            process.wait(STOP_LIMIT_S)


def live(naming: Address, clock: Clock, seconds: float) -> dict[str, Any]:
    """Row of the live server beside one client."""
    with watched(naming) as (pid, client):
        time.sleep(SETTLE_S)
        since, cpu = len(clock.samples) - 1, Cpu([pid])
        before = {topic: len(found) for topic, found in client.messages.items()}
        time.sleep(seconds)
        row = {"pace": clock.pace(since), "cores": cpu.spent_s()[0] / seconds}
        counts = {topic: len(found) - before.get(topic, 0) for topic, found in client.messages.items()}
    poses = sorted(count / seconds for topic, count in counts.items() if topic.endswith("/pose"))
    return {"what": "live", **row, "/tf, 1/s": counts["/tf"] / seconds, "poses of a robot, 1/s": poses[len(poses) // 2]}


def recordings(naming: Address, clock: Clock, seconds: float, folder: Path) -> list[dict[str, Any]]:
    """Rows of both recordings, and of the converted one."""
    files = [folder / f"{name}.mcap" for name in ("compact", "foxglove", "converted")]
    since = len(clock.samples) - 1
    arguments = [str(files[0])], [str(files[1]), "--foxglove"]
    recorders = [
        subprocess.Popen(
            [ROBOCORBA, "record", *each, "--seconds", str(seconds), "--naming", str(naming)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for each in arguments
    ]
    assert [recorder.wait(seconds + STOP_LIMIT_S) for recorder in recorders] == [0, 0]
    pace = clock.pace(since)
    began = time.monotonic()
    subprocess.run([ROBOCORBA, "convert", *map(str, (files[0], files[2]))], check=True, stdout=subprocess.DEVNULL)
    convert_s = time.monotonic() - began
    compact = files[0].stat().st_size
    found = Recording(files[0])
    rows: list[dict[str, Any]] = [{"what": "compact", "kB/s": compact / found.duration_s / 1e3, "pace": pace}]
    for file in files[1:]:
        size = file.stat().st_size
        row = {"what": file.stem, "kB/s": size / found.duration_s / 1e3, "x compact": size / compact}
        rows.append({**row, "messages": messages(file)})
    rows[-1]["convert, x real time"] = found.duration_s / convert_s
    return rows


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


def measure(seconds: float = 60.0, recorded: float = 0.0, robots: int = 50) -> bool:
    with folder_of_bench() as folder, crowded_system(folder, robots) as (naming, clock, _):
        time.sleep(SETTLE_S)
        since = len(clock.samples) - 1
        time.sleep(seconds / 2)
        alone = clock.pace(since)
        rows: list[dict[str, Any]] = []
        for what in progress(("live", "recordings"), "measurements"):
            if what == "live":
                rows.append(live(naming, clock, seconds))
            else:
                rows += recordings(naming, clock, recorded or seconds, folder)
    shown, _, written, converted = rows
    marks = [
        at_most("live server, share of a core", shown["cores"], 0.2),
        at_least("updates of a robot each second, live", shown["poses of a robot, 1/s"], 15.0),
        at_least("pace beside that without viewers", shown["pace"] / alone, 0.98),
        at_most("recorded for Foxglove, x compact", written["x compact"], 3.0),
        at_most("converted, x compact", converted["x compact"], 3.0),
    ]
    picture = bars({row["what"]: row["kB/s"] for row in rows[1:]}, "kB/s")
    columns = list(dict.fromkeys(column for row in rows for column in row))
    table = [{column: row.get(column) for column in columns} for row in rows]
    return summarize(NAME, f"Foxglove beside {robots} robots", table, marks, picture)


if __name__ == "__main__":
    run(
        measure,
        seconds="of each measurement",
        recorded="length of the recordings [s]; 0: as the others",
        robots="on one floor",
    )
