from __future__ import annotations

import threading

from ftp_dent_ros.capture.source import Pace


class Clock:
    now = 50.0

    def __call__(self):
        return self.now


def test_deadlines_are_regular_however_long_the_work_takes():
    clock = Clock()
    pace = Pace(2.0, clock)
    reached = []
    for work in (0.1, 0.4, 0.0, 0.3):
        assert pace.wait(0.0)
        reached.append(clock.now)
        clock.now += work
        assert not pace.wait(0.0), 'not due yet'
        clock.now = reached[-1] + 0.5
    assert reached == [50.0, 50.5, 51.0, 51.5]
    assert pace.missed == 0


def test_deadlines_that_the_work_outlasts_are_missed_and_counted():
    clock = Clock()
    pace = Pace(2.0, clock)
    assert pace.wait(0.0)
    clock.now += 1.6
    assert pace.wait(0.0), 'the one at 50.5 is late but taken'
    assert pace.missed == 2, 'those at 51.0 and 51.5 are left out'
    assert not pace.wait(0.0)
    clock.now = 52.0
    assert pace.wait(0.0)


def test_with_patience_deadlines_are_made_up_for():
    clock = Clock()
    pace = Pace(2.0, clock, patience=1.0)
    assert pace.wait(0.0)
    clock.now += 2.25
    late = []
    while pace.wait(0.0):
        late.append(pace.late)
    assert late == [1.25, 0.75, 0.25]
    assert pace.missed == 1, 'that at 50.5 is too long ago'


def test_a_rest_misses_nothing():
    clock = Clock()
    pace = Pace(2.0, clock)
    clock.now += 100
    pace.restart()
    assert pace.wait(0.0)
    assert (pace.missed, pace.wait(0.0)) == (0, False)


def test_without_a_rate_nothing_falls_due():
    clock = Clock()
    pace = Pace(0.0, clock)
    clock.now += 1e9
    assert not pace.wait(0.001)
    pace.restart()
    assert not pace.wait(0.001)


def test_stopping_ends_the_waiting():
    pace = Pace(0.001)
    assert pace.wait(0.0)
    results = []
    waiter = threading.Thread(target=lambda: results.append(pace.wait(600.0)))
    waiter.start()
    pace.stop()
    waiter.join(timeout=60)
    assert results == [False]
