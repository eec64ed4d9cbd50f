"""Messages of one stamp are put together, whatever of them is lost."""

from __future__ import annotations

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.nodes.matching import MessageMatcher
from ftp_dent_ros.ros.messages import make_header, stamp_to_ns

TYPES = {
    'c': ('cloud', PointCloud2),
    'p': ('pose', PoseWithCovarianceStamped),
    's': ('skin', Image),
}


@pytest.mark.parametrize(
    ('expects', 'sent', 'given'),
    [
        ((), 'c1 p1 p2 c2', '1 2'),
        (('skin',), 's1 c1 p1 c2 p2 s2', '1s 2s'),
        # A skin that is lost costs that alone, and order.
        (('skin',), 'c1 p1 s2 c2 p2', '1 2s'),
        # A cloud whose pose may still come holds up nothing.
        (('skin',), 's1 c1 s2 c2 p2 p1', '2s 1s'),
        # A skin that nobody is known to send yet is taken when it is there.
        ((), 's1 c1 p1', '1s'),
    ],
)
def test_what_belongs_together_comes_together(expects, sent, given):
    found = []
    matching = MessageMatcher(
        lambda item: found.append(
            f'{stamp_to_ns(item.cloud.header.stamp)}{"s" * bool(item.skin)}'
        ),
        lambda reason, _: pytest.fail(reason),
        lambda: expects,
    )
    for word in sent.split():
        part, message_type = TYPES[word[0]]
        matching.add(**{part: message_type(header=make_header(int(word[1:]), 'camera'))})
    assert found == given.split()


def test_without_poses_a_cloud_waits_for_its_skin_alone():
    found = []
    matching = MessageMatcher(
        lambda item: found.append((stamp_to_ns(item.cloud.header.stamp), bool(item.skin))),
        lambda reason, _: pytest.fail(reason),
        lambda: ('skin',),
        posed=False,
    )
    for part, stamp in (('c', 1), ('s', 1), ('c', 2), ('s', 3), ('c', 3)):
        name, message_type = TYPES[part]
        matching.add(**{name: message_type(header=make_header(stamp, 'camera'))})
    assert found == [(1, True), (2, False), (3, True)]


def test_what_stays_alone_is_given_up_with_its_reason():
    found, refused = [], []
    matching = MessageMatcher(
        found.append, lambda reason, _: refused.append(reason), lambda: ('skin',)
    )
    for stamp in range(1, 31):
        for part in ('cp', 'c', 'p', 's')[stamp % 4]:
            name, message_type = TYPES[part]
            matching.add(**{name: message_type(header=make_header(stamp, 'camera'))})
    # Twenty stamps, for ten more may wait.
    assert [stamp_to_ns(item.cloud.header.stamp) for item in found] == [4, 8, 12, 16, 20]
    assert refused == ['no pose', 'no cloud', 'no cloud'] * 5
