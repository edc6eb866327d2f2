"""Shows how the kernels are compiled at the first start on a machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from rich.progress import BarColumn, Progress, TaskID, TextColumn

from robocorba.system.kernel_store import store
from robocorba.system.printing import Console
from robocorba.system.supervision.compilation import CompilationProgress, compile_kernels

TITLE = "compiling kernels, once on this machine"
#: Interval between lines where there is no terminal [s].
LINE_INTERVAL_S = 10.0


def compile_with_progress(logs: Path) -> None:
    """Compile all kernels if this machine has not done so yet; show on stderr how far it is. See `compile_kernels`."""
    if store().is_complete:
        return
    console = Console(stderr=True)
    if not console.is_terminal:
        compile_kernels(Lines(lambda line: console.print(line, soft_wrap=True)).report, logs)
        return
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}")
    with Progress(*columns, console=console, transient=True) as bar:
        task: TaskID | None = None

        def report(progress: CompilationProgress) -> None:
            nonlocal task
            if task is None:
                task = bar.add_task(TITLE, total=1.0, text="")
            bar.update(task, completed=progress.share, text=text_of(progress))

        compile_kernels(report, logs)


class Lines:
    """Writes a line at once, and then at intervals."""

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._write, self._clock = write, clock
        self._next_at = -float("inf")

    def report(self, progress: CompilationProgress) -> None:
        if self._clock() >= self._next_at:
            self._next_at = self._clock() + LINE_INTERVAL_S
            self._write(f"{TITLE}: {text_of(progress)}")


def text_of(progress: CompilationProgress) -> str:
    """Such as "45 of 136, about 20 s left"."""
    text = f"{progress.done} of {progress.of}"
    left = progress.seconds_left
    return text if left is None else f"{text}, about {max(left, 1.0):.0f} s left"
