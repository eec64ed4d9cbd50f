"""Subscriptions that hear reliable and best-effort publishers alike (REP 2003)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions


class AnySubscription:
    """A reliable subscription that becomes a best-effort one when a publisher is no better.

    Best effort alone would hear both, and lose most of the large messages where the transport has
    no profile for them.

    Parameters
    ----------
    node : rclpy.node.Node
    message_type : type
    topic : str
    callback : callable
    qos : QoSProfile
        Reliable.
    overridable : QoSOverridingOptions
        Of the first subscription; who overrides it to best effort hears both anyway.
    """

    def __init__(
        self,
        node: Node,
        message_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        overridable: QoSOverridingOptions | None = None,
    ) -> None:
        self._node, self._type, self._topic, self._callback = node, message_type, topic, callback
        self._qos = qos
        self.is_best_effort = False
        self._subscription = node.create_subscription(
            message_type,
            topic,
            callback,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible),
            qos_overriding_options=overridable,
        )

    def _on_incompatible(self, event: Any) -> None:
        # Not here, amid the subscription's own event: it is destroyed.
        timer = self._node.create_timer(0.0, lambda: self._replace(timer))

    def _replace(self, timer: Any) -> None:
        self._node.destroy_timer(timer)
        if self.is_best_effort:
            return
        self.is_best_effort = True
        self._node.destroy_subscription(self._subscription)
        qos = QoSProfile(depth=self._qos.depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscription = self._node.create_subscription(
            self._type, self._topic, self._callback, qos
        )
        self._node.get_logger().info(
            f'{self._subscription.topic_name} is published with best effort, and is heard so'
        )
