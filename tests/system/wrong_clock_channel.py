"""An event channel on a machine whose system's clock is wrong, or is set while it runs: by the seconds that are in the
file CLOCK. Its monotonic clock is right.

libfaketime would do the same, but time.sleep fails with it (EINVAL, Python 3.11)."""

from __future__ import annotations

import os
import time
from pathlib import Path

from robocorba.servers import event_channel

_right, _file = time.time, Path(os.environ["CLOCK"])


def _wrong() -> float:
    return _right() + float(_file.read_text())


if __name__ == "__main__":
    time.time, time.time_ns = _wrong, lambda: int(_wrong() * 1e9)
    event_channel.main()
