"""``ftp-dent up``: the nodes of a configuration as processes that are kept running."""

from __future__ import annotations

import argparse
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ftp_dent_ros.cli import argument
from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.supervision import transport
from ftp_dent_ros.supervision.configuration import frozen, read_configuration
from ftp_dent_ros.supervision.processes import (
    Processes,
    ProcessLog,
    Program,
    keep_running,
    stop_event,
)
from ftp_dent_ros.supervision.transport import held_names

ARGUMENTS = (
    argument(
        'configuration',
        metavar='CONFIG.yaml',
        help='a ROS 2 parameter file whose nodes are run; a shipped one is '
        'shipped:simulation.yaml',
    ),
    argument(
        '--log-dir', type=Path, metavar='DIR', help="also write each node's log to DIR/NODE.log"
    ),
    argument(
        '--interface',
        default='',
        metavar='NAME|ADDRESS',
        help='the only network interface that ROS uses: lo for none but this computer; by default '
        'all, or lo where ROS_AUTOMATIC_DISCOVERY_RANGE is LOCALHOST',
    ),
    argument('--dry-run', action='store_true', help='print what would be started and end'),
)


def run(arguments: argparse.Namespace) -> int:
    """Run until SIGINT or SIGTERM: 0, or 2 if a node could not use its parameters."""
    entries = fitted(read_configuration(arguments.configuration))
    if arguments.dry_run:
        return _print([entry.program for entry in entries], arguments.interface)
    from ftp_dent_ros.ros.session import check_parameters, refuse_second

    check_parameters(entries)
    names = [entry.name for entry in entries]
    stopping = stop_event().is_set
    with (
        tempfile.TemporaryDirectory(prefix='ftp_dent_ros.') as folder,
        ProcessLog(names, folder=arguments.log_dir) as log,
        held_names(names),
        transport.profile(arguments.interface) as variables,
        transport.environment_of(variables),
        Processes(log.show) as processes,
    ):
        programs = [entry.program for entry in frozen(entries, Path(folder))]
        refuse_second(names)
        return keep_running(programs, processes, log.say, stopping)


def _print(programs: Sequence[Program], interface: str) -> int:
    with transport.profile(interface) as variables:
        for name, value in variables.items():
            print(f'{name}={shlex.quote(value)}')
    for program in programs:
        print(shlex.join(program.command))
    return 0
