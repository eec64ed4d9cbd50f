"""Quality of service of the payload's topics.

Everything is reliable: with best effort most messages above half a megabyte are lost between
processes. Images and clouds keep the newest eight: a process of a busy computer stands still for
a second now and then, and what has been replaced before it was sent or taken is lost for good.
Nodes that are too slow leave out by themselves what is too old, and say so. What a node hears, and
the images and clouds that it publishes, can be changed by parameters ``qos_overrides.TOPIC...``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# Several, so that none of some changes in a row is lost to who is busy meanwhile, or comes late.
PATTERNS = QoSProfile(
    depth=5,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# What somebody asks for once: not what was asked before a restart.
LATCHED_INPUT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
IMAGES = QoSProfile(depth=8, reliability=ReliabilityPolicy.RELIABLE)
CLOUDS = QoSProfile(depth=8, reliability=ReliabilityPolicy.RELIABLE)
# The newest only: whoever is far away must not wait for older ones.
PREVIEWS = QoSProfile(depth=2, reliability=ReliabilityPolicy.RELIABLE)
POSES = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
DENTS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
DIAGNOSTICS = QoSProfile(depth=10)

# For `qos_overriding_options`: a camera driver of another make may publish best effort.
OVERRIDABLE = QoSOverridingOptions.with_default_policies()


def quality(reliable: bool, latched: bool, depth: int) -> QoSProfile:
    """Quality of service of a publisher or a subscription."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class AnySubscription:
    """A subscription to images, reliable unless a publisher is best effort (REP 2003).

    Best effort alone would hear both, and lose most of the large messages of reliable ones too.

    Parameters
    ----------
    node : rclpy.node.Node
    message_type : type
    topic : str
    callback : callable

    Attributes
    ----------
    is_best_effort : bool
        At the moment.
    lost : int
        Messages of a single publisher that did not come, by the holes in its count.
    """

    def __init__(
        self,
        node: Node,
        message_type: Any,
        topic: str,
        callback: Callable[[Any], None],
    ) -> None:
        self._node, self._type, self._topic, self._callback = node, message_type, topic, callback
        self.is_best_effort = False
        self.lost = 0
        self._last = 0
        self._subscription = node.create_subscription(
            message_type,
            topic,
            self._take,  # type: ignore[arg-type]  # rclpy gives the message's information too
            IMAGES,
            # Who overrides it to best effort hears both anyway.
            qos_overriding_options=OVERRIDABLE,
        )
        node.create_timer(0.5, self._follow, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _take(self, message: Any, info: Any) -> None:
        number = info['publication_sequence_number'] or 0
        if 0 < self._last < number and self._node.count_publishers(self._topic) == 1:
            self.lost += number - self._last - 1
        self._last = number
        self._callback(message)

    def _follow(self) -> None:
        name = self._subscription.topic_name
        offers = [each.qos_profile for each in self._node.get_publishers_info_by_topic(name)]
        best_effort = any(qos.reliability == ReliabilityPolicy.BEST_EFFORT for qos in offers)
        if not offers or best_effort == self.is_best_effort:
            return
        self.is_best_effort = best_effort
        self._node.destroy_subscription(self._subscription)
        policy = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        self._last = 0
        self._subscription = self._node.create_subscription(
            self._type,
            self._topic,
            self._take,  # type: ignore[arg-type]
            QoSProfile(depth=IMAGES.depth, reliability=policy),
        )
        how = 'with best effort, and may lose messages' if best_effort else 'reliably again'
        self._node.get_logger().info(f'{name} is heard {how}')
