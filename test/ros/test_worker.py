from __future__ import annotations

import threading

import pytest

from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.node import NewestWorker


@pytest.mark.parametrize(
    ('room', 'dropped', 'left'), [(1, 2, ['fourth']), (2, 1, ['third', 'fourth'])]
)
def test_only_the_newest_wait(ros, room, dropped, left):
    entered, leave = threading.Event(), threading.Event()
    done = []

    def work(item):
        entered.set()
        assert leave.wait(60)
        done.append(item)

    diagnostics = Diagnostics(ros.node)
    worker = NewestWorker(diagnostics, work, 'nothing was done', room)
    assert worker.settle(0.0)
    worker.put('first')
    assert entered.wait(60)
    for item in ('second', 'third', 'fourth'):
        worker.put(item)
    assert diagnostics.recent('dropped') == dropped and len(worker) == 1 + room
    assert not worker.settle(0.0)
    leave.set()
    assert worker.settle(60)
    worker.stop()
    assert done == ['first', *left]


def test_what_cannot_be_done_ends_nothing(ros):
    diagnostics = Diagnostics(ros.node)
    worker = NewestWorker(diagnostics, lambda item: 1 / item, 'a number could not be inverted')
    for number in (0, 1):
        worker.put(number)
    worker.stop(finish=True)
    assert diagnostics.status().message.startswith('a number could not be inverted, by a defect')
