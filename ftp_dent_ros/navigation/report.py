"""The link in words and figures that people read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ftp_dent_ros.navigation.link_state import LinkState

_ESTIMATOR = {
    'not ready': "the autopilot's estimator is not ready: wait until it knows its position",
    'awaited': 'the autopilot has not reported the state of its estimator yet',
    'silent': 'the autopilot has stopped reporting the state of its estimator',
}


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
    if vehicle.identity is None and state.refused:
        return Verdict(
            'error',
            'all messages are unsigned or signed with another key: check signing_key, and that '
            'the autopilot signs',
        )
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
    if vehicle.clock.answers == 0:
        return Verdict(
            'error', 'the autopilot does not answer TIMESYNC, so that no cloud can be tagged'
        )
    if not vehicle.clock.converged:
        return Verdict('warning', "the autopilot's clock is not known well enough yet")
    if vehicle.estimator in _ESTIMATOR:
        return Verdict('warning', _ESTIMATOR[vehicle.estimator])
    if vehicle.slow:
        names = ' and '.join(vehicle.slow)
        return Verdict('warning', f'too few {names} come; asked for again')
    return Verdict('ok', f'believing the autopilot {_name(vehicle.identity)}')


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
        'clock steps': str(clock.steps),
        'ahead of UTC of GPS (s)': _number(vehicle.utc_error, 1, 3),
        'clock restarts': str(clock.restarts),
        'reconnections': str(state.reconnections),
        'messages': str(vehicle.messages),
        'messages of others': str(vehicle.foreign),
        'messages in its name from elsewhere': str(state.impostors),
        'messages lost': str(vehicle.lost),
        'messages malformed': str(vehicle.malformed),
        'messages without the right signature': str(state.refused),
        'bytes that are no message': str(state.bad_bytes),
    }
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
