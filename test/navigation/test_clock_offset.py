"""The clock's estimate against clocks and links whose truth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.clock import MILLISECOND, SECOND, ClockOffset

START = 1_800_000_000 * SECOND
BOOT = START - 500 * SECOND  # the autopilot was switched on 500 s before


def steady(now: int) -> int:
    return now - BOOT


def stepping(at: int, by: int) -> Callable[[int], int]:
    return lambda now: now - BOOT + (by if now >= at else 0)


def clean() -> tuple[int, int]:
    return MILLISECOND // 5, MILLISECOND // 5


class Wire:
    """A clock that is asked every 100 ms over a link; `delays` gives one way and the other."""

    def __init__(self, vehicle: Callable[[int], int], delays: Callable[[], tuple[int, int]]):
        self.clock = ClockOffset()
        self.vehicle, self.delays = vehicle, delays
        self.now = START

    def run(self, seconds: float) -> Wire:
        for _ in range(round(10 * seconds)):
            ts1 = self.clock.request(self.now)
            assert ts1 == self.now
            there, back = self.delays()
            tc1 = self.vehicle(self.now + there)
            self.clock.answer(tc1, ts1, self.now + there + back)
            self.now += SECOND // 10
        return self

    def error(self, stamp: int) -> int:
        """Error of the boot time, checked to be within what the clock says of it."""
        boot, uncertainty = self.clock.boot_time(stamp)
        error = boot - self.vehicle(stamp)
        assert abs(error) <= uncertainty
        return error


def test_a_jittering_link_is_filtered_by_its_fastest_ways() -> None:
    rng = np.random.default_rng(5)

    def jittering() -> tuple[int, int]:
        # As measured on a busy link: mostly a few milliseconds, now and then a hundred.
        there, back = rng.gamma(1.0, 2.0, 2) + 0.1 + 100 * (rng.random(2) < 0.1)
        return int(there * MILLISECOND), int(back * MILLISECOND)

    wire = Wire(steady, jittering).run(10)
    stamps = range(START + 2 * SECOND, START + 9 * SECOND, 7 * MILLISECOND)
    errors = [abs(wire.error(stamp)) for stamp in stamps]
    assert np.median(errors) < 0.15 * MILLISECOND
    assert max(errors) < 0.5 * MILLISECOND
    assert wire.clock.steps == 0


@pytest.mark.parametrize('skew', [-50e-6, 50e-6, 150e-6])
def test_drift_is_followed(skew: float) -> None:
    wire = Wire(lambda now: int((now - BOOT) + skew * (now - START)), clean).run(60)
    stamps = range(wire.now - 5 * SECOND, wire.now - SECOND, 10 * MILLISECOND)
    assert max(abs(wire.error(stamp)) for stamp in stamps) < 0.2 * MILLISECOND
    assert wire.clock.steps == 0


def answers(wire: Wire, stamp: int) -> bool:
    """Whether a boot time is given, and then a right one."""
    try:
        assert abs(wire.error(stamp)) < MILLISECOND
    except PoseError as error:
        assert error.reason == 'clock stepped'
        return False
    return True


@pytest.mark.parametrize('by_ms', [-150, 20, 60])
def test_a_step_is_followed_and_nothing_is_said_of_the_time_around_it(by_ms: int) -> None:
    at = START + 3 * SECOND + 43 * MILLISECOND
    wire = Wire(stepping(at, by_ms * MILLISECOND), clean).run(6)
    assert wire.clock.steps == 1
    stamps = range(at - SECOND, at + SECOND, 4 * MILLISECOND)
    refused = [stamp for stamp in stamps if not answers(wire, stamp)]
    assert refused[0] <= at <= refused[-1]
    assert refused[-1] - refused[0] < 110 * MILLISECOND


def test_a_stamp_is_converted_only_between_two_exchanges() -> None:
    wire = Wire(steady, clean)
    with pytest.raises(PoseAwaitedError, match='does not answer TIMESYNC'):
        wire.clock.boot_time(START)
    wire.run(2)
    last_request = wire.now - SECOND // 10
    assert wire.error(last_request) == 0
    with pytest.raises(PoseAwaitedError) as later:
        wire.clock.boot_time(last_request + 1)
    assert later.value.reason == 'clock awaited'
    with pytest.raises(PoseError) as earlier:
        wire.clock.boot_time(START - SECOND)
    assert not isinstance(earlier.value, PoseAwaitedError)


def test_only_answers_to_its_own_requests_count_and_none_that_was_overtaken() -> None:
    clock = ClockOffset()
    first, ts1 = clock.request(START), clock.request(START + SECOND)
    assert first is not None and ts1 == START + SECOND
    later = ts1 + MILLISECOND
    clock.answer(0, ts1, later)  # a request of the vehicle's
    clock.answer(steady(later), ts1 + 1, later)  # an answer to somebody else
    assert clock.offset is None
    clock.answer(steady(later), ts1, later)
    assert clock.offset == pytest.approx(BOOT / SECOND, abs=1e-3)
    clock.answer(7 * SECOND, ts1, later)  # a second answer, from another clock
    clock.answer(7 * SECOND, first, later + MILLISECOND)  # one that was overtaken
    assert clock.offset == pytest.approx(BOOT / SECOND, abs=1e-3)
    assert (clock.steps, clock.restarts) == (0, 0)
