"""Receiving the messages of many topics, as they are on the wire."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.recording.ros import quality, say
from ftp_dent_ros.recording.topic import (
    Message,
    Qos,
    RecordedTopic,
    find_definition,
    is_hidden,
    type_hash,
)

DISCOVERY_PERIOD_S = 0.1


class Recorder:
    """Subscribes to the topics wanted as they appear, and hands on what comes.

    Parameters
    ----------
    node : Node
        Spun by the caller.
    add_topic : callable
        Takes each topic before its first message.
    put : callable
        Takes each message.
    names : tuple of str
        Topics wanted in any case, absolute.
    everything : bool
        Whether all that are not hidden are wanted, too.

    Attributes
    ----------
    received, lost : int
        Messages that came, and those that did not: holes in the count of a topic's only
        publisher.
    """

    def __init__(
        self,
        node: Node,
        add_topic: Callable[[RecordedTopic], None],
        put: Callable[[Message], bool],
        names: tuple[str, ...],
        everything: bool,
    ) -> None:
        self.received = 0
        self.lost = 0
        self._node = node
        self._add_topic = add_topic
        self._put = put
        self._names, self._everything = names, everything
        # Of each topic that was met; None where ROS refuses it.
        self._subscriptions: dict[str, Subscription | None] = {}
        self._last_sequence: dict[str, int] = {}  # of topics with a single publisher
        self._types: dict[str, str] = {}
        self._disputed: set[str] = set()  # topics that somebody publishes with another type
        node.create_timer(DISCOVERY_PERIOD_S, self.discover)
        self.discover()

    def discover(self) -> None:
        """Subscribe to new topics, and anew where a new publisher would not be heard."""
        for name, _ in self._node.get_topic_names_and_types():
            wanted = name in self._names or (self._everything and not is_hidden(name))
            publishers = self._publishers(name) if wanted else []
            if not publishers:
                continue
            if len(publishers) > 1:
                self._last_sequence.pop(name, None)
            if name not in self._subscriptions:
                self._begin(name, publishers)
            subscription = self._subscriptions[name]
            if subscription is None:
                continue
            request = _request_for(publishers, subscription.qos_profile.depth)
            current = subscription.qos_profile
            if (
                request.reliability == ReliabilityPolicy.BEST_EFFORT != current.reliability
                or request.durability == DurabilityPolicy.VOLATILE != current.durability
            ):
                say(f'{name}: a publisher offers less than the others: recording what all offer')
                del self._subscriptions[name]
                self._node.destroy_subscription(subscription)
                self._subscribe(RecordedTopic(name, self._types[name]), request)

    def missing(self) -> list[str]:
        """Topics that were wanted by name and have not appeared."""
        return [name for name in self._names if name not in self._subscriptions]

    def _publishers(self, name: str) -> list[TopicEndpointInfo]:
        """Those of a topic's own type, which is the first that it was met with."""
        publishers = self._node.get_publishers_info_by_topic(name)
        types = list(dict.fromkeys(publisher.topic_type for publisher in publishers))
        if not types:
            return []
        own = self._types.setdefault(name, types[0])
        others = [each for each in types if each != own]
        if others and name not in self._disputed:
            say(f'{name}: {" and ".join(others)} are published too: only {own} is recorded')
            self._disputed.add(name)
        return [publisher for publisher in publishers if publisher.topic_type == own]

    def _begin(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        kind = self._types[name]
        announced = str(publishers[0].topic_type_hash)
        hash_ = announced if announced.startswith('RIHS') else type_hash(kind)
        topic = RecordedTopic(
            name=name,
            type=kind,
            type_hash=hash_,
            offered_qos=tuple(
                Qos(
                    ReliabilityPolicy(publisher.qos_profile.reliability).short_key,
                    DurabilityPolicy(publisher.qos_profile.durability).short_key,
                )
                for publisher in publishers
            ),
            definition=find_definition(kind, hash_),
        )
        if len(publishers) == 1:
            self._last_sequence[name] = 0
        # Messages that wait in DDS while this process is held up: few images and clouds, which
        # would fill the memory.
        large = any(line.startswith('uint8[] ') for line in topic.definition.splitlines())
        self._subscribe(topic, _request_for(publishers, 20 if large else 1000))

    def _subscribe(self, topic: RecordedTopic, request: QoSProfile) -> None:
        def take(data: bytes, info: dict[str, int | None]) -> None:
            received = info['received_timestamp'] or time.time_ns()
            published = info['source_timestamp'] or received
            sequence = info['publication_sequence_number'] or 0
            self._count(topic.name, sequence)
            self._put(
                Message(topic.name, topic.type, received, published, data, sequence & 0xFFFFFFFF)
            )

        try:
            self._subscriptions[topic.name] = self._node.create_subscription(
                message_class(topic.type),
                topic.name,
                take,  # type: ignore[arg-type]  # rclpy gives the message's information too
                request,
                raw=True,
            )
        except Exception as reason:  # an unknown type, or rclpy's own: a name that is not ROS's
            self._subscriptions[topic.name] = None
            say(f'{topic.name}: not recorded: {str(reason).splitlines()[0].rstrip(":")}')
            return
        self._add_topic(topic)
        say(f'recording {topic.name} [{topic.type}]')

    def _count(self, topic: str, sequence: int) -> None:
        self.received += 1
        last = self._last_sequence.get(topic)
        if last is not None:
            # A publisher that was started anew counts from 1.
            if 0 < last < sequence:
                self.lost += sequence - last - 1
            self._last_sequence[topic] = sequence


def _request_for(publishers: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """What a subscription must request to hear all publishers, and as much as they all offer."""
    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return quality(reliable, latched, depth)
