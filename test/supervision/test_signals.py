import os
import signal

import pytest

from ftp_dent_ros.supervision.processes import stop_event_meanwhile

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.mark.parametrize('number', SIGNALS)
def test_signals_are_noted_and_break_into_nothing(number):
    given = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        before = [signal.getsignal(each) for each in SIGNALS]
        with stop_event_meanwhile() as stop:
            assert not stop.is_set()
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)
            assert stop.is_set()
        assert [signal.getsignal(each) for each in SIGNALS] == before
    finally:
        signal.signal(signal.SIGHUP, given)


def test_what_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_event_meanwhile() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)
