"""``ftp-dent ground``: the payload's topics on the ground, over a thin link."""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import queue
import sys
from pathlib import Path

from ftp_dent_ros.cli import argument
from ftp_dent_ros.errors import ConfigurationError, InputError
from ftp_dent_ros.ground.link import GroundLink, Security, endpoints, make_keys
from ftp_dent_ros.ground.protocol import Item
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.supervision import transport
from ftp_dent_ros.supervision.processes import (
    Processes,
    ProcessLog,
    Program,
    keep_running,
    stop_event,
)

_QUEUE = 64  # items that wait to be shown


ARGUMENTS = (
    argument(
        'address',
        nargs='?',
        metavar='ADDRESS',
        help='HOST or HOST:PORT of the downlink, with tcp/ before it where no datagrams pass',
    ),
    argument('--keys', type=Path, metavar='DIR', help='keys of the link'),
    argument('--open', action='store_true', help='use the link without keys beyond this machine'),
    argument('--name', default='payload', help='name of the payload'),
    argument('--station', default='', help="name of this ground (default: the machine's)"),
    argument(
        '--interface',
        default='',
        metavar='NAME|ADDRESS',
        help='the only network interface that ROS uses here: lo for this computer alone, so that '
        'ROS says nothing over the radio (default: all)',
    ),
    argument(
        '--web',
        nargs='?',
        const='127.0.0.1:8080',
        default='',
        metavar='HOST:PORT',
        help="serve a page for browsers, and Foxglove's WebSocket (default: 127.0.0.1:8080); "
        'works without ROS too',
    ),
    argument('--make-keys', type=Path, metavar='DIR', help='make the keys of a link, and end'),
)


def run(arguments: argparse.Namespace) -> int:
    """Run until SIGINT or SIGTERM."""
    if arguments.make_keys is not None:
        return _make_keys(arguments.make_keys)
    if arguments.address is None:
        raise ConfigurationError("the drone's address is missing: give HOST or HOST:PORT")
    endpoints(arguments.address, Security(arguments.keys, arguments.open), 'ground')
    if importlib.util.find_spec('rclpy') is not None:
        return _run_node(arguments)
    if arguments.web:
        return _run_page(arguments)
    raise ConfigurationError(
        'needs rclpy, which is not here: see "Install" in the README, or watch without ROS '
        'with --web'
    )


def _run_page(arguments: argparse.Namespace) -> int:
    """The page alone: this machine has no ROS."""
    from ftp_dent_ros.ground.page.server import PageServer

    stop = stop_event()
    items: queue.Queue[Item] = queue.Queue(_QUEUE)
    security = Security(arguments.keys, arguments.open)
    link = GroundLink('ground', arguments.address, security, arguments.name)
    with (
        contextlib.closing(Station(link, items.put, arguments.station)) as station,
        contextlib.closing(PageServer(arguments.web, station)) as page,
    ):
        print(f'what comes is shown at {page.url} (no ROS here: no topics)', flush=True)
        print(f'for Foxglove it is at {page.foxglove_url}', flush=True)
        while not stop.is_set():
            if change := station.change():
                print(change, flush=True)
            with contextlib.suppress(queue.Empty):
                try:
                    page.take(items.get(timeout=0.2))
                except InputError as error:
                    print(error, file=sys.stderr, flush=True)
    return 0


def _make_keys(folder: Path) -> int:
    for path in make_keys(folder):
        print(path)
    print(
        'Copy authority.pem, drone.pem and drone.key to the drone, and authority.pem, ground.pem '
        'and ground.key to each ground. Whoever has the .key files can use the link.'
    )
    return 0


def _run_node(arguments: argparse.Namespace) -> int:
    given = {
        'address': arguments.address,
        'keys': str(arguments.keys.resolve()) if arguments.keys else '',
        'open': arguments.open,
        'name': arguments.name,
        'station': arguments.station,
        'web': arguments.web,
    }
    words = ['--ros-args']
    for name, value in given.items():
        words += ['-p', f'{name}:={json.dumps(value)}']
    program = Program(
        'ground_station', (sys.executable, '-m', 'ftp_dent_ros.nodes', 'ground_station', *words)
    )
    stopping = stop_event().is_set
    with (
        transport.profile(arguments.interface) as variables,
        transport.environment_of(variables),
        ProcessLog([program.name]) as log,
        Processes(log.show) as processes,
    ):
        return keep_running([program], processes, log.say, stopping)
