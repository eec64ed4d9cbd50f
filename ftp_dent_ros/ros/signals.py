"""Ending a command on a signal without breaking into what it is doing."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

# A terminal that is closed, or a lost ssh connection, sends the third one.
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def stop_on_signal() -> Iterator[threading.Event]:
    """Event that SIGINT, SIGTERM and SIGHUP set, instead of what they do otherwise.

    To be used in the main thread, with ``rclpy.init(signal_handler_options=NO)``: rclpy's own
    handlers would shut the context down before what has arrived is dealt with.
    """
    stop = threading.Event()
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    for number in _SIGNALS:
        # What `nohup` ignores stays ignored.
        if before[number] != signal.SIG_IGN or number != signal.SIGHUP:
            signal.signal(number, lambda *_: stop.set())
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
