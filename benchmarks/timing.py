"""Functions timed in turn, so that what else the machine does falls on all of them alike."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np


def durations(
    work: Mapping[str, Callable[[], Any]],
    repetitions: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, list[float]]:
    """Seconds that each function takes, each time, after one call to warm up."""
    for function in work.values():
        function()
    taken: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(repetitions):
        for name, function in work.items():
            start = clock()
            function()
            taken[name].append(clock() - start)
    return taken


def show(taken: Mapping[str, list[float]]) -> None:
    """A line a function: its median, and that over the first one's, the yardstick's."""
    yardstick = float(np.median(next(iter(taken.values()))))
    for name, values in taken.items():
        median, least = float(np.median(values)), min(values)
        print(
            f'  {name:30}{1e3 * median:8.1f} ms {median / yardstick:8.1f} x, '
            f'at least {1e3 * least:.1f} ms'
        )


def processor_time(pid: int) -> float:
    """Seconds of the processor that another process has used so far."""
    text = Path(f'/proc/{pid}/stat').read_text()
    user, system = text.rpartition(')')[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf('SC_CLK_TCK')
