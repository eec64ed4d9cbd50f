"""``ftp-dent link-check``: whether the autopilot's link is fit to take off with."""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.navigation.link import Link
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.report import judge
from ftp_dent_ros.navigation.settings import Settings
from ftp_dent_ros.navigation.signing import read_key
from ftp_dent_ros.navigation.state import LinkState, Speaker

# Rates and round trips take as long to be known; seconds.
_SHORTEST, _WELL = 5.0, 2.0
# A pose as old as this has all been heard of that it depends on.
_SETTLED_NS = 500_000_000
# Answers, not streams.
_ANSWERS = ('TIMESYNC', 'COMMAND_ACK')
_TICK = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    default = Settings()
    parser.add_argument(
        'address',
        help='udpin:[HOST:]PORT (listens), udpout:HOST:PORT (sends first), tcp:HOST:PORT, or the '
        'path of a serial device',
    )
    parser.add_argument('--baud', type=int, default=921600, help='default: %(default)s')
    parser.add_argument(
        '--seconds', type=float, default=15.0, help='how long to wait; default: %(default)s'
    )
    parser.add_argument(
        '--rate', type=float, default=default.rate, help='poses a second; default: %(default)s'
    )
    parser.add_argument(
        '--system-id', type=int, default=0, help='of the autopilot; default: the first heard'
    )
    parser.add_argument('--component-id', type=int, default=1, help='default: %(default)s')
    parser.add_argument(
        '--position-source',
        choices=('gps', 'other'),
        default=default.position_source,
        help='as of the bridge; default: %(default)s',
    )
    parser.add_argument(
        '--maximum-clock-error',
        type=float,
        default=default.maximum_clock_error,
        metavar='SECONDS',
        help='as of the bridge; default: %(default)s',
    )
    parser.add_argument('--signing-key', default='', metavar='FILE', help='as of the bridge')


def run(arguments: argparse.Namespace) -> int:
    """Listen, say what was heard, and judge: 0 go, 1 no go."""
    if not 0 < arguments.seconds < math.inf:
        raise ConfigurationError(f'--seconds is {arguments.seconds:g}: give more than 0')
    settings = Settings(
        system_id=arguments.system_id,
        component_id=arguments.component_id,
        rate=arguments.rate,
        position_source=arguments.position_source,
        maximum_clock_error=arguments.maximum_clock_error,
    )
    key = read_key(arguments.signing_key) if arguments.signing_key else b''
    link = Link(arguments.address, arguments.baud, settings, signing_key=key)
    try:
        print(f'listening on {arguments.address} for up to {arguments.seconds:g} s', flush=True)
        state, tag = _watch(link, arguments.address, arguments.seconds)
        speakers = link.speakers()
    finally:
        link.close()
    verdict = judge(state, arguments.address)
    print('\n'.join(_who(state, speakers)))
    if state.vehicle.identity is not None:
        lines = _streams(state, speakers, arguments.rate)
        print('\n'.join([*lines, *_clock(state), *_gps(state), *_pose(tag)]))
    if verdict.severity != 'ok':
        print(f'\nNO GO: {verdict.text}')
        return 1
    if isinstance(tag, PoseError):
        print(f'\nNO GO: {tag}')
        return 1
    print('\nGO: the poses come, the clock is known and the estimator is ready')
    return 0


def _watch(link: Link, address: str, seconds: float) -> tuple[LinkState, Tag | PoseError]:
    """State and pose once all has been well for a while, or at the end."""
    begin = time.monotonic()
    heartbeat, well_since = begin, begin
    while True:
        now = time.monotonic()
        if now >= heartbeat:
            # As the bridge does; many an autopilot sends nothing before.
            link.send_heartbeat()
            heartbeat += 1.0
        state, tag = link.state(), _settled_tag(link)
        if judge(state, address).severity != 'ok' or isinstance(tag, PoseError):
            well_since = now
        if now - begin >= seconds or (now - well_since >= _WELL and now - begin >= _SHORTEST):
            return state, tag
        time.sleep(_TICK)


def _settled_tag(link: Link) -> Tag | PoseError:
    try:
        return link.tag_at(time.time_ns() - _SETTLED_NS)
    except PoseError as error:
        return error


def _gps(state: LinkState) -> list[str]:
    gps = state.vehicle.gps
    if gps is None:
        return []
    satellites = 'unknown' if gps.satellites is None else gps.satellites
    lines = [f'GPS          {gps.fix}, {satellites} satellites']
    if gps.across is not None and gps.up is not None:
        lines[0] += f', to within {gps.across:.1f} m across and {gps.up:.1f} m up'
    if gps.apart_across is not None and gps.apart_up is not None:
        lines.append(
            f'             the estimate is {gps.apart_across:.1f} m across and '
            f'{abs(gps.apart_up):.1f} m up from it'
        )
    return lines


def _pose(tag: Tag | PoseError) -> list[str]:
    if isinstance(tag, PoseError):
        return [f'pose         none: {tag}']
    east, north, up = tag.pose.translation
    ahead = tag.pose.rotation.apply([1.0, 0.0, 0.0])
    heading = np.degrees(np.arctan2(ahead[0], ahead[1])) % 360
    deviations = np.sqrt(np.diag(tag.covariance))
    across, above = 1e3 * deviations[:2].max(), 1e3 * deviations[2]
    return [
        f'pose         {north:.2f} m north, {east:.2f} m east, {up:.2f} m up, heading '
        f'{heading:.0f} degrees',
        f'             to within {across:.0f} mm across, {above:.0f} mm up and '
        f'{np.degrees(deviations[3:].max()):.1f} degrees, without the mount',
        '             and without what GPS, barometer and compass wander over minutes',
    ]


def _who(state: LinkState, speakers: list[Speaker]) -> list[str]:
    lines = ['', 'on the link']
    for speaker in speakers:
        is_believed = (speaker.system, speaker.component) == state.vehicle.identity
        what = ', '.join(filter(None, [speaker.kind, speaker.autopilot])) or 'no heartbeat'
        count = sum(speaker.counts.values())
        mark = '  <- believed' if is_believed else ''
        lines.append(
            f'  {speaker.system:3d}/{speaker.component:<3d}  {what:32} {count:6d} messages{mark}'
        )
    if not speakers:
        lines.append('  nobody')
    if state.refused:
        lines.append(f'  {state.refused} messages without the right signature')
    if state.bad_bytes:
        lines.append(f'  {state.bad_bytes} pieces that are no message')
    return lines


def _streams(state: LinkState, speakers: list[Speaker], rate: float) -> list[str]:
    vehicle = state.vehicle
    (ours,) = (s for s in speakers if (s.system, s.component) == vehicle.identity)
    lines = ['', 'streams (Hz)']
    for name in sorted(vehicle.rates.keys() | ours.counts.keys()):
        note = ''
        if name in vehicle.denied:
            note = 'denied'
        elif name in vehicle.slow:
            note = f'too few: {rate:g} are wanted'
        measured = vehicle.rates[name] if name in vehicle.rates else ours.rate(name)
        if name not in _ANSWERS and (note or name in ours.counts):
            lines.append(f'  {name:28}{measured:6.1f}  {note}'.rstrip())
    total = vehicle.lost + vehicle.messages
    share = 100 * vehicle.lost / total
    return [*lines, f'  {vehicle.lost} of {total} messages lost ({share:.1f} %)', '']


def _clock(state: LinkState) -> list[str]:
    vehicle, clock = state.vehicle, state.vehicle.clock
    lines = [f'estimator    {vehicle.estimator}']
    if clock.offset is None:
        return [*lines, 'clock        not known: TIMESYNC is not answered']
    booted = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(clock.offset))
    lines += [
        f'clock        {"known" if clock.converged else "not known well"}, to within '
        f'{_ms(clock.uncertainty)}, round trip {_ms(clock.round_trip)}',
        f'             offset {clock.offset:.6f} s: booted on {booted}',
    ]
    if vehicle.utc_error is not None:
        way = 'ahead of' if vehicle.utc_error > 0 else 'behind'
        lines.append(
            f'             this computer is {abs(vehicle.utc_error):.3f} s {way} the time of GPS'
        )
    return lines


def _ms(seconds: float | None) -> str:
    return 'unknown' if seconds is None else f'{1e3 * seconds:.1f} ms'
