"""Runs a node as a process: ``python -m ftp_dent_ros.nodes NAME --ros-args ...``."""

from __future__ import annotations

import importlib
import sys
import traceback
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ftp_dent_ros.errors import FtpDentError, missing_package
from ftp_dent_ros.process import end_within
from ftp_dent_ros.supervision.processes import PATIENCE, ignore_signals, stop_event


def node_class(name: str) -> Any:
    """The class of a node: of `camera_capture`, ``CameraCapture`` in the module of its name."""
    module = importlib.import_module(f'ftp_dent_ros.nodes.{name}')
    return getattr(module, name.title().replace('_', ''))


def main() -> int:
    """Run the node that the program is named after until SIGINT, SIGTERM or SIGHUP.

    An exception of a callback is logged and the node goes on: a message from anywhere must not
    end it.

    Returns
    -------
    int
        Exit status: 0 after a signal, 2 if the parameters or arguments are wrong (one line on
        stderr).
    """
    with ExitStack() as ros:
        with ExitStack() as held:
            status = _run(ros, held)
        # Fast DDS may hold the interpreter for good as it destroys a participant: its issue 6513.
        end_within(PATIENCE, status)
        ignore_signals()
    return status


def _run(ros: ExitStack, held: ExitStack) -> int:
    """Run the node until it is to end, and return the exit status.

    What is to be ended goes on two stacks: what the node holds, and ROS, which ends last.
    """
    name, stop = Path(sys.argv[0]).name, stop_event()
    try:
        # Only now, for it takes long, and a signal meanwhile is no error.
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        from ftp_dent_ros.ros.node import ThreadedExecutor

        # Not rclpy's own handlers: they end the context while threads still publish.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        ros.callback(rclpy.try_shutdown)
        node = node_class(name)()
        ros.callback(node.destroy_node)
        held.callback(node.ending.close)
        node.start()
    except ModuleNotFoundError as error:
        print(f'{name}: {missing_package(error)}', file=sys.stderr)
        return 2
    except Exception as error:
        # Of ours, or rclpy's: of arguments, of a QoS override or of the environment.
        known = isinstance(error, (FtpDentError, RuntimeError))
        if not known and not type(error).__module__.startswith('rclpy'):
            raise
        print(f'{name}: {str(error).splitlines()[0]}', file=sys.stderr)
        return 2
    single = node.threads == 1
    executor = SingleThreadedExecutor() if single else ThreadedExecutor(node.threads)
    held.callback(executor.shutdown, 2.0)  # for a callback that waits
    executor.add_node(node)
    while rclpy.ok() and not stop.is_set():
        try:
            executor.spin_once(timeout_sec=0.2)
        except Exception as error:  # noqa: PERF203
            node.get_logger().error(
                f'unexpected {type(error).__name__}: {error}\n{traceback.format_exc()}'
            )
    return 0


if __name__ == '__main__':
    # What is left is the command line of the node's executable.
    del sys.argv[0]
    sys.exit(main())
