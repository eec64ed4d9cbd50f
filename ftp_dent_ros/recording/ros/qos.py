"""Between rclpy and bags: quality of service as a bag writes it."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from ftp_dent_ros.recording.topic import Qos


def qos_from_profile(profile: QoSProfile) -> Qos:
    """A profile as a bag writes it."""
    return Qos(
        history=HistoryPolicy(profile.history).short_key,
        depth=profile.depth,
        reliability=ReliabilityPolicy(profile.reliability).short_key,
        durability=DurabilityPolicy(profile.durability).short_key,
        deadline=profile.deadline.nanoseconds,
        lifespan=profile.lifespan.nanoseconds,
        liveliness=LivelinessPolicy(profile.liveliness).short_key,
        liveliness_lease_duration=profile.liveliness_lease_duration.nanoseconds,
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def request_for(offers: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """What a subscription must request to hear all publishers, and as much as they all offer.

    Reliable and transient local if all of them are; the other policies do not keep messages back.
    """
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offer_for(recorded: Sequence[Qos], depth: int) -> QoSProfile:
    """What a publisher must offer in the place of those that were recorded.

    The same, where they all offered the same; otherwise the most that one of them offered of
    reliability and durability, so that every subscription that heard one of them hears this one.
    """
    if not recorded:
        return QoSProfile(depth=depth)
    first = recorded[0]
    reliable = any(qos.reliability == 'reliable' for qos in recorded)
    latched = any(qos.durability == 'transient_local' for qos in recorded)
    profile = QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    if all(_timing(qos) == _timing(first) for qos in recorded):
        profile.deadline = Duration(nanoseconds=first.deadline)
        profile.lifespan = Duration(nanoseconds=first.lifespan)
        profile.liveliness_lease_duration = Duration(nanoseconds=first.liveliness_lease_duration)
        if first.liveliness == 'manual_by_topic':
            profile.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
    return profile


def _timing(qos: Qos) -> tuple[object, ...]:
    return qos.deadline, qos.lifespan, qos.liveliness, qos.liveliness_lease_duration
