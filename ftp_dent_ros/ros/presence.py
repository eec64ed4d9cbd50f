"""Whether nodes of some names run already, in a graph that is about to get them."""

from __future__ import annotations

import time
from collections.abc import Collection

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ros.qos import DIAGNOSTICS
from ftp_dent_ros.ros.session import session

# In which participants on one network find each other, seconds: 0.2 but on a busy machine.
_DISCOVERY = 2.0
# A node that lives tells its state every second; DDS goes on naming a killed one for 20. For as
# long a name that is found is listened for.
_SIGN_OF_LIFE = 3.0


def refuse_second(names: Collection[str]) -> None:
    """Refuse to start nodes whose names are in use: two cameras would feed one reconstruction.

    Parameters
    ----------
    names : collection of str
        Fully qualified, without the leading slash.

    Raises
    ------
    ConfigurationError
        One of them lives.
    """
    for name in sorted(alive(names)):
        raise ConfigurationError(
            f'a node of the name {name} runs already in this domain: end it, or take another '
            'namespace or ROS_DOMAIN_ID'
        )


def alive(names: Collection[str]) -> set[str]:
    """Those of the names whose nodes live, as far as that shows within a few seconds."""
    wanted, heard = set(names), set[str]()
    with session('presence') as (node, stop):

        def listen(message: DiagnosticArray) -> None:
            heard.update(status.name for status in message.status)

        node.create_subscription(DiagnosticArray, '/diagnostics', listen, DIAGNOSTICS)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        start = time.monotonic()
        longest = _DISCOVERY
        try:
            while not stop.is_set() and time.monotonic() < start + longest:
                executor.spin_once(timeout_sec=0.1)
                if heard & wanted:
                    break
                found = node.get_node_names_and_namespaces()
                if wanted & {f'{namespace}/{name}'.strip('/') for name, namespace in found}:
                    longest = _SIGN_OF_LIFE
        finally:
            executor.shutdown()
        if stop.is_set():
            raise KeyboardInterrupt
    return heard & wanted
