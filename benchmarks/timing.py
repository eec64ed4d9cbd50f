"""Processor time of other processes."""

from __future__ import annotations

import os
from pathlib import Path


def processor_time(pid: int) -> float:
    """Seconds of the processor that another process has used so far."""
    text = Path(f'/proc/{pid}/stat').read_text()
    user, system = text.rpartition(')')[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf('SC_CLK_TCK')
