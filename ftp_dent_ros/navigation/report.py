"""The link in words and figures that people read."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ftp_dent_ros.navigation.settings import MOST_CLOCK_ERROR
from ftp_dent_ros.navigation.state import LinkState, VehicleState

# Exchanges after which a clock that is not known well will not be; seconds without an answer.
_SETTLED, _UNANSWERED = 30, 2.0
# What is proposed for maximum_clock_error: some more than the best uncertainty, in whole steps.
_MARGIN, _STEP = 1.2, 0.005

_ESTIMATOR = {
    'not ready': "the autopilot's estimator is not ready: wait until it knows its position",
    'awaited': 'the autopilot has not reported the state of its estimator yet',
    'silent': 'the autopilot has stopped reporting the state of its estimator',
}
_NO_REPORT = (
    'the autopilot does not report the state of its estimator (EKF_STATUS_REPORT, or '
    'ESTIMATOR_STATUS): nobody can say whether its pose is true, and no cloud is tagged'
)
_REFUSALS = {
    '': 'what it says is not signed, and signing_key is set: let the autopilot sign, or leave '
    'signing_key empty',
    'key': 'what it says is signed with another key: check signing_key',
    'time': 'what it says is signed with a time of the past, as after a restart without GPS time: '
    'wait until it has that',
}
_UNSIGNED = (
    'the autopilot signs what it says and takes nothing that is not signed: set signing_key'
)


@dataclass(frozen=True)
class Verdict:
    """One sentence on the link, and how bad it is."""

    severity: Literal['ok', 'warning', 'error']
    text: str


def judge(state: LinkState, address: str) -> Verdict:
    """The first thing that is wrong with the link, and what to do about it."""
    vehicle = state.vehicle
    if state.fault:
        return Verdict('error', state.fault)
    if not vehicle.is_alive and state.refusal is not None:
        return Verdict('error', f'the autopilot is not believed: {_REFUSALS[state.refusal]}')
    if vehicle.identity is None:
        return Verdict(
            'error',
            f'no autopilot heard on {address}: check that it is on and sends there, and system_id',
        )
    if not vehicle.is_alive:
        return Verdict('error', 'the autopilot has fallen silent: check its power and cable')
    if vehicle.denied:
        return Verdict(
            'error', f'the autopilot denies {" and ".join(vehicle.denied)}: lower the rate'
        )
    return (
        _clock_verdict(state)
        or _estimate_verdict(vehicle)
        or _stream_verdict(vehicle)
        or Verdict('ok', f'believing the autopilot {_name(vehicle.identity)}')
    )


def _clock_verdict(state: LinkState) -> Verdict | None:
    clock = state.vehicle.clock
    if clock.converged:
        return None
    if state.is_signing:
        return Verdict('error', _UNSIGNED)
    if clock.answers == 0:
        return Verdict(
            'error', 'the autopilot does not answer TIMESYNC, so that no cloud can be tagged'
        )
    if clock.silence is not None and clock.silence > _UNANSWERED:
        return Verdict(
            'error',
            f'the autopilot has not answered TIMESYNC for {clock.silence:.1f} s, so that no cloud '
            'can be tagged',
        )
    if clock.answers < _SETTLED or clock.least_round_trip is None:
        return Verdict('warning', "the autopilot's clock is not known well enough yet")
    quickest = clock.least_round_trip / 2
    if quickest <= clock.maximum_error:
        return Verdict(
            'warning',
            "the autopilot's clock and this computer's have stepped against each other: wait some "
            'seconds until the offset is known again, and let nothing set a clock in flight',
        )
    allowed = math.ceil(_MARGIN * quickest / _STEP) * _STEP
    advice = 'make the link quicker'
    if allowed <= MOST_CLOCK_ERROR:
        advice += f', or set maximum_clock_error to {allowed:.3f} (each tag tells what that costs)'
    return Verdict(
        'warning',
        f"the autopilot's clock is known to within {1e3 * quickest:.0f} ms at best, for the "
        f'quickest answers take {1e3 * clock.least_round_trip:.0f} ms: {advice}',
    )


def _estimate_verdict(vehicle: VehicleState) -> Verdict | None:
    if vehicle.estimator == 'not reported':
        return Verdict('error', _NO_REPORT)
    if vehicle.estimator in _ESTIMATOR:
        return Verdict('warning', _ESTIMATOR[vehicle.estimator])
    if vehicle.gps is not None and vehicle.gps.fault:
        return Verdict('error', f'{vehicle.gps.fault}: no cloud is tagged')
    if vehicle.estimator != 'ready':
        return Verdict('error', f'{vehicle.estimator_fault}: no cloud is tagged')
    if vehicle.gps is not None and vehicle.gps.age is None:
        return Verdict('warning', 'the autopilot has not reported a fix of GPS yet')
    return None


def _stream_verdict(vehicle: VehicleState) -> Verdict | None:
    if vehicle.rerated_by:
        return Verdict(
            'warning',
            f'some poses are missing: {vehicle.rerated_by} changes the rates of messages; they '
            'are asked for again at once each time',
        )
    if vehicle.slow:
        names = ' and '.join(vehicle.slow)
        return Verdict('warning', f'too few {names} come; asked for again')
    return None


def figures(state: LinkState) -> dict[str, str]:
    """All that is known of the link, by name, in the units that are in the names."""
    vehicle, clock = state.vehicle, state.vehicle.clock
    values = {
        'autopilot': vehicle.autopilot,
        'system/component': _name(vehicle.identity) if vehicle.identity else 'none',
        'silence (s)': _number(vehicle.silence, 1, 2),
        'pose age (ms)': _number(vehicle.pose_age, 1e3, 1),
        'estimator': vehicle.estimator,
        'estimator resets': str(vehicle.resets),
        'clock converged': str(clock.converged).lower(),
        'clock offset (s)': _number(clock.offset, 1, 6),
        'clock uncertainty (ms)': _number(clock.uncertainty, 1e3, 3),
        'round trip (ms)': _number(clock.round_trip, 1e3, 3),
        'least round trip (ms)': _number(clock.least_round_trip, 1e3, 3),
        'clock steps': str(clock.steps),
        'ahead of UTC of GPS (s)': _number(vehicle.utc_error, 1, 3),
        'clock restarts': str(clock.restarts),
        'reconnections': str(state.reconnections),
        'messages': str(vehicle.messages),
        'messages of others': str(vehicle.foreign),
        'messages in its name from elsewhere': str(state.impostors),
        'messages lost': str(vehicle.lost),
        'rates changed by others': str(vehicle.rerated),
        'messages malformed': str(vehicle.malformed),
        'messages without the right signature': str(state.refused),
        'bytes that are no message': str(state.bad_bytes),
    }
    if vehicle.gps is not None:
        gps = vehicle.gps
        values |= {
            'GPS fix': gps.fix,
            'GPS satellites': 'unknown' if gps.satellites is None else str(gps.satellites),
            'GPS within, across (m)': _number(gps.across, 1, 2),
            'GPS within, up (m)': _number(gps.up, 1, 2),
            'GPS fix age (s)': _number(gps.age, 1, 2),
            'estimate from GPS, across (m)': _number(gps.apart_across, 1, 2),
            'estimate from GPS, up (m)': _number(gps.apart_up, 1, 2),
        }
    if vehicle.above_ground is not None:
        values['range finder, down (m)'] = _number(vehicle.above_ground, 1, 2)
    if vehicle.origin is not None:
        values['origin (deg)'] = f'{vehicle.origin.latitude:.7f} {vehicle.origin.longitude:.7f}'
        values['origin above the sea (m)'] = f'{vehicle.origin.above_sea:.2f}'
        values['origin differs from GLOBAL_POSITION_INT (m)'] = _number(vehicle.origin_error, 1, 2)
    values.update({f'{name} (Hz)': f'{rate:.1f}' for name, rate in vehicle.rates.items()})
    return values


def _name(identity: tuple[int, int]) -> str:
    return f'{identity[0]}/{identity[1]}'


def _number(value: float | None, factor: float, digits: int) -> str:
    return 'unknown' if value is None else f'{factor * value:.{digits}f}'
