from __future__ import annotations

import threading

from ftp_dent_ros.ros.worker import NewestWorker


def test_only_the_newest_waits():
    entered, leave, done = threading.Event(), threading.Event(), []

    def work(item):
        entered.set()
        assert leave.wait(60)
        done.append(item)

    worker = NewestWorker(work, 'test')
    assert not worker.put('first')
    assert entered.wait(60)
    assert [worker.put(item) for item in ('second', 'third', 'fourth')] == [False, True, True]
    entered.clear()
    leave.set()
    assert entered.wait(60)
    worker.stop()
    assert done == ['first', 'fourth']
