"""What all nodes of the payload have: settings, diagnostics, and the time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any, Generic, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile

from ftp_dent_ros.nodes.settings import OF_NODES, names_of_all, read
from ftp_dent_ros.ros.diagnostics import Diagnostics, Verdict
from ftp_dent_ros.ros.node import NewestWorker
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import OVERRIDABLE

Settings = TypeVar('Settings')


class PayloadNode(Node, Generic[Settings]):
    """A node of the package, with its parameters read and its state on ``/diagnostics``.

    It is named after its module. Where `start` fails, the node can still be destroyed.

    Parameters
    ----------
    **options
        Of `rclpy.node.Node`.
    """

    given: Settings
    #: Of its executor: more than one for a node with a callback that waits.
    threads = 1

    def __init__(self, **options: Any) -> None:
        self._executable = self.__module__.rpartition('.')[2]
        super().__init__(self._executable, **options)
        #: Ends what the node holds (threads, devices, sockets), the last one first.
        self.ending = ExitStack()

    def start(self) -> None:
        """Read the parameters, and begin to work.

        Raises
        ------
        ConfigurationError
            A parameter is wrong.
        """
        self.settings = Parameters(self)
        self.given = read(OF_NODES[self._executable], self.settings)
        self.settings.close(names_of_all)
        self.diagnostics = Diagnostics(self, self._judge)
        self._set_up()

    def destroy_node(self) -> None:
        """End what the node holds first."""
        self.ending.close()
        super().destroy_node()

    def now_ns(self) -> int:
        """ROS time, nanoseconds."""
        return self.get_clock().now().nanoseconds

    def hear(
        self,
        kind: Any,
        topic: str,
        take: Callable[[Any], None],
        qos: QoSProfile,
        reason: str = '',
        **options: Any,
    ) -> None:
        """Subscribe to a topic; what `take` raises is logged and ends nothing.

        `reason` is that of `Diagnostics.guarded`.
        """

        def guarded(message: Any) -> None:
            with self.diagnostics.guarded(f'{topic} could not be taken', reason):
                take(message)

        self.create_subscription(
            kind, topic, guarded, qos, qos_overriding_options=OVERRIDABLE, **options
        )

    def worker(
        self, work: Callable[[Any], None], what: str, finish: bool = False, **options: Any
    ) -> NewestWorker[Any]:
        """A `NewestWorker` of the node's, which ends with it, after what waits if asked to."""
        made = NewestWorker(self.diagnostics, work, what, **options)
        self.ending.callback(made.stop, finish)
        return made

    def _set_up(self) -> None:
        """Make publishers, subscriptions and workers."""
        raise NotImplementedError

    def _judge(self) -> Sequence[Verdict]:
        """What the node knows of its state; see `Diagnostics`."""
        raise NotImplementedError
