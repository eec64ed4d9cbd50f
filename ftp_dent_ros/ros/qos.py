"""Quality of service of the payload's topics.

Everything is reliable: with best effort most messages above half a megabyte are lost between
processes. Images and clouds keep the newest eight: a process of a busy computer stands still for
a second now and then, and what has been replaced before it was sent or taken is lost for good,
untold. Nodes that are too slow leave out by themselves what is too old, and tell. Each can be
changed by parameters named ``qos_overrides.TOPIC...`` where the topic is made with `OVERRIDABLE`.
"""

from __future__ import annotations

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
