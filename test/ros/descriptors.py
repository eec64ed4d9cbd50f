"""What a process has open."""

from __future__ import annotations

import contextlib
from pathlib import Path


def opened(pid: int) -> list[str]:
    """Targets of the descriptors of a process, which opens and closes others meanwhile."""
    targets = []
    for link in Path(f'/proc/{pid}/fd').iterdir():
        with contextlib.suppress(FileNotFoundError):
            targets.append(str(link.readlink()))
    return targets
