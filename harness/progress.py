"""What a sweep shows while it runs: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import time
from collections import Counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from harness.store import Outcome

LINE_EVERY_S = 20.0


class Report:
    """A context manager that a sweep reports to. `statuses` counts the outcomes."""

    def __init__(self, console: Console) -> None:
        self.statuses: Counter[str] = Counter()
        self._console = console
        self._last_line_s = float("-inf")
        self._bar = Progress(
            TextColumn("{task.fields[left]}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
            console=console,
            transient=True,
            refresh_per_second=2,  # drawing must not disturb the measurement
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Report:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def running(self, label: str, done: int, total: int, left_s: float | None) -> None:
        left = "" if left_s is None else f"{duration(left_s)} left"
        self._bar.update(self._task, completed=done, total=total, description=label, left=left)
        now = time.monotonic()
        if not self._console.is_terminal and now - self._last_line_s >= LINE_EVERY_S:
            self._last_line_s = now
            line = ", ".join(filter(None, [f"{done} of {total} trials", left, f"now {label}"]))
            self._console.print(line, highlight=False, soft_wrap=True)

    def finished(self, label: str, outcome: Outcome) -> None:
        self.statuses[outcome.status] += 1
        if outcome.status != "ok":
            colour = "yellow" if outcome.status == "unsupported" else "red"
            line = f"{label}: {outcome.status}: {outcome.reason}"
            self._console.print(line, style=colour, markup=False, highlight=False, soft_wrap=True)


def duration(seconds: float) -> str:
    """`45 s`, `3 min 20 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02} s" if minutes else f"{rest} s"
