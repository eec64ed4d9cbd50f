"""The side of recording that speaks ROS: topics into a bag, a bag onto topics."""

from __future__ import annotations

import sys

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ftp_dent_ros.errors import printable


def say(text: str) -> None:
    """Tell the user a line."""
    print(printable(text), file=sys.stderr, flush=True)


def quality(reliable: bool, latched: bool, depth: int) -> QoSProfile:
    """Quality of service of a publisher or a subscription."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
