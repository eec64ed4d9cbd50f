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
    """A subscription as reliable and as latched as all publishers of its topic offer.

    One that asks for more does not hear all of them; best effort alone hears all, and loses most
    of the large messages of reliable ones too.

    Parameters
    ----------
    node : rclpy.node.Node
    message_type : type
    topic : str
    callback : callable
        Takes a message and rclpy's information on it.
    depth : int
        Messages that may wait.
    **options
        Of `rclpy.node.Node.create_subscription`.

    Attributes
    ----------
    lost : int
        Messages of a single publisher that did not come, by the holes in its count.
    """

    def __init__(
        self,
        node: Node,
        message_type: Any,
        topic: str,
        callback: Callable[[Any, Any], None],
        depth: int = IMAGES.depth,
        **options: Any,
    ) -> None:
        self._node, self._callback, self._depth = node, callback, depth
        self._given = message_type, topic, self._take
        self.lost = 0
        self._last = 0
        self._offered = self._offers() or (True, False)
        self._options = options
        self._subscription = node.create_subscription(
            *self._given,  # type: ignore[arg-type]  # rclpy gives the message's information too
            quality(*self._offered, depth),
            # Who overrides it to best effort hears all anyway.
            qos_overriding_options=OVERRIDABLE,
            **options,
        )
        node.create_timer(0.5, self._follow, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def is_best_effort(self) -> bool:
        """At the moment."""
        return not self._offered[0]

    def _take(self, message: Any, info: Any) -> None:
        number = info['publication_sequence_number'] or 0
        missed = number - self._last - 1
        if self._last and missed > 0 and self._node.count_publishers(self._given[1]) == 1:
            self.lost += missed
        self._last = number
        self._callback(message, info)

    def _offers(self) -> tuple[bool, bool] | None:
        """Whether all publishers are reliable, and whether all are latched; None without any."""
        name = self._node.resolve_topic_name(self._given[1])
        offers = [each.qos_profile for each in self._node.get_publishers_info_by_topic(name)]
        reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offers)
        latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offers)
        return (reliable, latched) if offers else None

    def _follow(self) -> None:
        offered = self._offers()
        if offered is None or offered == self._offered:
            return
        self._offered, self._last = offered, 0
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._node.create_subscription(
            *self._given,  # type: ignore[arg-type]
            quality(*offered, self._depth),
            **self._options,
        )
        how = 'reliably' if offered[0] else 'with best effort, and may lose messages'
        self._node.get_logger().info(f'{self._subscription.topic_name} is heard {how} from now on')
