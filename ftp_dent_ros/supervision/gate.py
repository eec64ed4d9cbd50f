"""A gate before which processes wait, with all that they need imported already.

Most of a node's start is Python's imports. They are made while it is looked whether the node may
run at all.
"""

from __future__ import annotations

import os
from types import TracebackType

_VARIABLE = 'FTP_DENT_ROS_GATE'


class Gate:
    """Shut at first; whoever is started with its variables and descriptor can `wait` for it.

    Attributes
    ----------
    descriptor : int
        To be inherited.
    variables : dict
        To be added to the environment.
    """

    def __init__(self) -> None:
        self.descriptor, self._ours = os.pipe()
        self.variables = {_VARIABLE: str(self.descriptor)}

    def open(self, count: int) -> None:
        """Let so many processes pass."""
        os.write(self._ours, bytes(count))

    def __enter__(self) -> Gate:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        os.close(self.descriptor)
        os.close(self._ours)


def wait() -> bool:
    """Wait for the gate that this process was started before; whether it was opened.

    At once where there is none. Nothing but its own end comes through meanwhile: call it before
    signals are handled.
    """
    descriptor = os.environ.pop(_VARIABLE, '')
    if not descriptor:
        return True
    with os.fdopen(int(descriptor), 'rb', buffering=0) as gate:
        return bool(gate.read(1))
