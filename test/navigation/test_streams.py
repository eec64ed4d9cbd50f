from __future__ import annotations

from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.requests import Stream, Streams

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED


class Autopilot:
    """Sends each message at the rate that it was asked for, or at the rate of somebody else."""

    def __init__(self, streams: Streams, result: int = ACCEPTED) -> None:
        self.streams, self.result = streams, result
        self.intervals: dict[str, float] = {}
        self.asked: list[tuple[float, str]] = []
        self.now = 0.0
        self._next: dict[str, float] = {}

    def run(self, seconds: float) -> Autopilot:
        end = self.now + seconds
        while self.now < end:
            request = self.streams.next_request(self.now)
            if request is not None:
                self.asked.append((round(self.now, 2), request.name))
                if self.result is not None:
                    self.streams.acknowledged(self.result)
                if self.result == ACCEPTED:
                    self.intervals[request.name] = request.interval_us / 1e6
            for name, interval in self.intervals.items():
                due = self._next.get(name, self.now)
                if self.now >= due - 1e-6:
                    self._next[name] = due + interval
                    self.streams.received(name, self.now)
            self.now += 0.005
        return self


def both() -> Streams:
    return Streams([Stream('ATTITUDE_QUATERNION', 50.0), Stream('LOCAL_POSITION_NED', 50.0)])


def test_intervals_are_whole_milliseconds() -> None:
    assert Stream('ATTITUDE_QUATERNION', 50.0).interval_us == 20_000
    assert Stream('ATTITUDE_QUATERNION', 30.0).interval_us == 33_000
    assert Stream('ATTITUDE_QUATERNION', 5000.0).interval_us == 1_000
    assert Stream('ATTITUDE_QUATERNION', 1.0).message_id == 31


def test_each_is_asked_for_once_while_it_comes() -> None:
    autopilot = Autopilot(both()).run(30)
    assert [name for _, name in autopilot.asked] == ['ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED']
    rates = autopilot.streams.rates(autopilot.now)
    assert all(45 < rate < 55 for rate in rates.values())


def test_only_one_is_open_at_a_time_and_an_unanswered_one_is_repeated() -> None:
    autopilot = Autopilot(both(), result=None).run(1.9)
    assert autopilot.asked == [(t, 'ATTITUDE_QUATERNION') for t in (0.0, 0.5, 1.0, 1.5)]
    autopilot.run(2.0)
    assert {name for _, name in autopilot.asked[4:]} == {'LOCAL_POSITION_NED'}


def test_what_another_client_slowed_down_is_asked_for_again_within_two_seconds() -> None:
    autopilot = Autopilot(both()).run(30)
    autopilot.asked.clear()
    autopilot.intervals['LOCAL_POSITION_NED'] = 0.2
    autopilot.run(10)
    assert [name for _, name in autopilot.asked] == ['LOCAL_POSITION_NED']
    assert autopilot.asked[0][0] < 32


def test_what_never_comes_is_asked_for_ever_more_slowly() -> None:
    streams = both()
    autopilot = Autopilot(streams)
    end = 60.0
    while autopilot.now < end:
        autopilot.run(0.005)
        autopilot.intervals.clear()
    times = [at for at, name in autopilot.asked if name == 'LOCAL_POSITION_NED']
    gaps = [after - before for before, after in pairwise(times)]
    assert gaps[0] < 3
    assert max(gaps) < 9
    assert len(times) < 12


def test_a_denied_rate_is_told_and_asked_for_again_unless_it_is_dispensable() -> None:
    wanted = [Stream('ATTITUDE_QUATERNION', 400.0), Stream('SYSTEM_TIME', 1.0, required=False)]
    autopilot = Autopilot(Streams(wanted), result=DENIED).run(10)
    assert autopilot.streams.denied() == ['ATTITUDE_QUATERNION']
    names = [name for _, name in autopilot.asked]
    assert names.count('SYSTEM_TIME') == 1
    assert names.count('ATTITUDE_QUATERNION') > 1
    autopilot.result = ACCEPTED
    autopilot.run(10)
    assert autopilot.streams.denied() == []


def test_slow_messages_are_given_the_time_that_they_need() -> None:
    autopilot = Autopilot(Streams([Stream('SYSTEM_TIME', 1.0)])).run(60)
    assert len(autopilot.asked) == 1


def test_an_acknowledgement_of_somebody_elses_is_no_harm() -> None:
    streams = both()
    streams.acknowledged(DENIED)
    assert streams.denied() == []
