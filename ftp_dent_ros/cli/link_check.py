"""``ftp-dent link-check``: whether the autopilot's link is fit to take off with."""

from __future__ import annotations

import argparse
import time
from contextlib import closing

import numpy as np

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.link import Link, LinkState, Roster
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.settings import VehicleSettings
from ftp_dent_ros.navigation.signing import read_key

# Rates and round trips take as long to be known; seconds.
_SHORTEST, _WELL = 5.0, 2.0
# A pose as old as this has all been heard of that it depends on.
_SETTLED_NS = 500_000_000


ARGUMENTS = (
    argument(
        'address',
        help='udpin:[HOST:]PORT (listens), udpout:HOST:PORT (sends first), tcp:HOST:PORT, or the '
        'path of a serial device',
    ),
    argument('--baud', type=int, default=921600, help='default: %(default)s'),
    argument(
        '--seconds',
        type=number('--seconds', 0, 86400),
        default=15.0,
        help='how long to wait; default: %(default)s',
    ),
    argument(
        '--rate',
        type=float,
        default=VehicleSettings.rate,
        help='poses a second; default: %(default)s',
    ),
    argument(
        '--system-id', type=int, default=0, help='of the autopilot; default: the first heard'
    ),
    argument('--component-id', type=int, default=1, help='default: %(default)s'),
    argument(
        '--position-source',
        choices=('gps', 'other'),
        default=VehicleSettings.position_source,
        help='as of the bridge; default: %(default)s',
    ),
    argument(
        '--maximum-clock-error',
        type=float,
        default=VehicleSettings.maximum_clock_error,
        metavar='SECONDS',
        help='as of the bridge; default: %(default)s',
    ),
    argument('--signing-key', default='', metavar='FILE', help='as of the bridge'),
)


def run(arguments: argparse.Namespace) -> int:
    """Listen, say what was heard, and judge: 0 go, 1 no go."""
    names = 'system_id', 'component_id', 'rate', 'position_source', 'maximum_clock_error'
    settings = VehicleSettings(**{name: getattr(arguments, name) for name in names})
    key = read_key(arguments.signing_key) if arguments.signing_key else b''
    with closing(Link(arguments.address, arguments.baud, settings, signing_key=key)) as link:
        print(f'listening on {arguments.address} for up to {arguments.seconds:g} s', flush=True)
        state, tag = _watch(link, arguments.seconds)
        speakers = link.speakers()
    print('\n'.join(_who(state, speakers)))
    if state.identity is not None:
        lines = [f'  {name:44}{value}' for name, value in state.figures.items()]
        print('\n'.join(['', 'the link', *lines, *_pose(tag)]))
    if state.verdict.severity != 'ok':
        print(f'\nNO GO: {state.verdict.text}')
        return 1
    print('\nGO: the poses come, the clock is known and the estimator is ready')
    return 0


def _watch(link: Link, seconds: float) -> tuple[LinkState, Tag | PoseError]:
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
        if state.verdict.severity != 'ok' or isinstance(tag, PoseError):
            well_since = now
        if now - begin >= seconds or (now - well_since >= _WELL and now - begin >= _SHORTEST):
            return state, tag
        time.sleep(0.1)


def _settled_tag(link: Link) -> Tag | PoseError:
    try:
        return link.tag_at(time.time_ns() - _SETTLED_NS)
    except PoseError as error:
        return error


def _pose(tag: Tag | PoseError) -> list[str]:
    if isinstance(tag, PoseError):
        return ['', f'pose         none: {tag}']
    east, north, up = tag.pose.translation
    ahead = tag.pose.rotation.apply([1.0, 0.0, 0.0])
    heading = np.degrees(np.arctan2(ahead[0], ahead[1])) % 360
    deviations = np.sqrt(np.diag(tag.covariance))
    across, above = 1e3 * deviations[:2].max(), 1e3 * deviations[2]
    return [
        '',
        f'pose         {north:.2f} m north, {east:.2f} m east, {up:.2f} m up, heading '
        f'{heading:.0f} degrees',
        f'             to within {across:.0f} mm across, {above:.0f} mm up and '
        f'{np.degrees(deviations[3:].max()):.1f} degrees, without the mount',
        '             and without what GPS, barometer and compass wander over minutes',
    ]


def _who(state: LinkState, speakers: Roster) -> list[str]:
    lines = ['', 'on the link']
    for identity, speaker in sorted(speakers.items()):
        mark = '  <- believed' if identity == state.identity else ''
        system, component = identity
        heard = f'{speaker.kind:32} {speaker.messages:6d} messages'
        lines.append(f'  {system:3d}/{component:<3d}  {heard}{mark}')
    return lines if speakers else [*lines, '  nobody']
