"""``ftp-dent up``: the nodes of a configuration as processes that are kept running."""

from __future__ import annotations

import argparse
import importlib.util
import shlex
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ros import transport
from ftp_dent_ros.ros.configuration import read_configuration
from ftp_dent_ros.ros.process_log import ProcessLog
from ftp_dent_ros.ros.processes import Processes, Program
from ftp_dent_ros.ros.signals import stop_event

WRONG_PARAMETERS = 2  # the exit status of a node that cannot use what it was given
OTHER_PARTICIPANTS = 3  # a recorder and two viewers, for the share of the shared memory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'configuration',
        metavar='CONFIG.yaml',
        help='a ROS 2 parameter file whose nodes are run; a shipped one (payload.yaml, '
        'simulation.yaml) is found by its name',
    )
    parser.add_argument(
        '--log-dir', type=Path, metavar='DIR', help="also write each node's log to DIR/NODE.log"
    )
    parser.add_argument(
        '--dry-run', action='store_true', help='print what would be started and end'
    )


def run(arguments: argparse.Namespace) -> int:
    """Run until SIGINT or SIGTERM: 0, or 2 if a node could not use its parameters."""
    entries = read_configuration(arguments.configuration)
    programs = [entry.program for entry in entries]
    with transport.profile(len(entries) + OTHER_PARTICIPANTS) as variables:
        if arguments.dry_run:
            for name, value in variables.items():
                print(f'{name}={shlex.quote(value)}')
            for program in programs:
                print(shlex.join(program.command))
            return 0
        if importlib.util.find_spec('rclpy') is None:
            raise ConfigurationError('needs rclpy, which is not here: see "Install" in the README')
        stopping = stop_event().is_set
        with ProcessLog([each.name for each in programs], folder=arguments.log_dir) as log:
            colours = {'RCUTILS_COLORIZED_OUTPUT': '1' if log.coloured else '0'}
            with Processes(log.show, {**colours, **variables}) as processes:
                return keep_running(programs, processes, log.say, stopping)


def keep_running(
    programs: Sequence[Program],
    processes: Processes,
    say: Callable[[str], None],
    stopping: Callable[[], bool],
    first_delay: float = 1.0,
    longest_delay: float = 30.0,
) -> int:
    """Start programs and restart those that die, until `stopping` or none is left to run.

    The delay before a restart doubles each time, and starts anew after a minute of running.

    Returns
    -------
    int
        0, or 2 if a program ended with that status: it is not started again.
    """
    due = dict.fromkeys(programs, 0.0)  # when to start, on the monotonic clock
    delays = dict.fromkeys(programs, first_delay)
    status = 0
    while not stopping():
        for program in [each for each, when in due.items() if when <= time.monotonic()]:
            del due[program]
            processes.start(program)
        for end in processes.ended(timeout=0.2):
            if end.status == WRONG_PARAMETERS:
                say(f'{end}: it cannot run with what it was given, so it is not restarted')
                status = WRONG_PARAMETERS
                continue
            delay = first_delay if end.seconds > 60.0 else delays[end.program]
            delays[end.program] = min(2.0 * delay, longest_delay)
            due[end.program] = time.monotonic() + delay
            say(f'{end}: restarting it in {delay:g} s')
        if not due and not processes.names:
            say('no node is left to run')
            return status
    say('stopping')
    for name, code in processes.stop().items():
        if code == -signal.SIGKILL:
            say(f'{name} did not end when asked to, and was killed')
    say('stopped')
    return status
