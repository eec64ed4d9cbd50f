from __future__ import annotations

import threading

import pytest

from ftp_dent_ros.ros.node import NewestWorker


@pytest.mark.parametrize(
    ('room', 'dropped', 'left'),
    [(1, [None, 'second', 'third'], ['fourth']), (2, [None, None, 'second'], ['third', 'fourth'])],
)
def test_only_the_newest_wait(room, dropped, left):
    entered, leave, ended = (threading.Event() for _ in range(3))
    done = []

    def work(item):
        entered.set()
        assert leave.wait(60)
        done.append(item)
        if len(done) > len(left):
            ended.set()

    worker = NewestWorker(work, 'test', room)
    assert not worker.put('first')
    assert entered.wait(60)
    assert [worker.put(item) for item in ('second', 'third', 'fourth')] == dropped
    leave.set()
    assert ended.wait(60)
    worker.stop()
    assert done == ['first', *left]
