"""What grows with a flight and is published as a whole: in a thread that mostly rests.

A list of dents, the path of the cameras and the measured skin change with every cloud. They are
made of the newest state alone, once a second at most, and never for more than a twentieth of the
time: so a cloud costs no more the longer the flight is.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.node import NewestWorker

State = TypeVar('State')


class Drawing(Generic[State]):
    """Draws the newest state when it is time.

    Parameters
    ----------
    draw : callable
        Publishes a state.
    diagnostics : Diagnostics
        Of the node; takes what `draw` fails of.
    what : str
        Is drawn: ``'the list'``.
    """

    def __init__(self, draw: Callable[[State], None], diagnostics: Diagnostics, what: str) -> None:
        self._draw_state = draw
        self._ending = threading.Event()
        self._worker = NewestWorker(
            diagnostics, self._draw, f'{what} could not be drawn', room=1, counts=False
        )

    def show(self, state: State) -> None:
        """Show a state when it is time, unless a newer one comes before."""
        self._worker.put(state)

    def close(self) -> None:
        """End the thread, after a state that waits was shown."""
        self._ending.set()
        self._worker.stop(finish=True)

    def _draw(self, state: State) -> None:
        started = time.monotonic()
        try:
            self._draw_state(state)
        finally:
            self._ending.wait(max(1.0, 20 * (time.monotonic() - started)))
