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


def own_ports(pid: int) -> list[Path]:
    """Ports of Fast DDS in shared memory that a process holds as its own."""
    locks = {Path(target) for target in opened(pid) if target.endswith('_el')}
    return [lock.with_name(lock.name[:-3]) for lock in locks if 'fastrtps_port' in lock.name]
