"""To be told to stop by a signal, without being broken into."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# A terminal that is closed, or a lost ssh connection, sends the third one.
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def stop_event() -> threading.Event:
    """Event that SIGINT, SIGTERM and SIGHUP set from now on, however often they come.

    To be called in the main thread. A SIGHUP that `nohup` lets be ignored stays ignored.
    """
    stop = threading.Event()
    for number in _SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: stop.set())
    return stop


@contextmanager
def stop_event_meanwhile() -> Iterator[threading.Event]:
    """As `stop_event`, until the end of the ``with`` block."""
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield stop_event()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
