"""Shows how the kernels are compiled at the first start on a machine."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as ProgressBar

from robocorba.system.kernel_store import store
from robocorba.system.printing import Console
from robocorba.system.supervision.compilation import Progress, compile_kernels

TITLE = "compiling kernels, once on this machine"
#: Interval between lines where there is no terminal [s].
LINE_INTERVAL_S = 10.0


def compile_with_progress(logs: Path) -> None:
    """Compile all kernels if this machine has not done so yet; show on stderr how far it is. See `compile_kernels`."""
    if store().is_complete:
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)  # the bar and the workers end in order
    console = Console(stderr=True)
    if not console.is_terminal:
        compile_kernels(lines(lambda line: console.print(line, soft_wrap=True)), logs)
        return
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}")
    with ProgressBar(*columns, console=console, transient=True) as bar:
        task = bar.add_task(TITLE, total=1.0, text="")
        compile_kernels(lambda progress: bar.update(task, completed=progress.share, text=str(progress)), logs)


def lines(write: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> Callable[[Progress], None]:
    """Writes a line at once, and then at intervals."""
    next_at = -float("inf")

    def report(progress: Progress) -> None:
        nonlocal next_at
        if clock() >= next_at:
            next_at = clock() + LINE_INTERVAL_S
            write(f"{TITLE}: {progress}")

    return report
