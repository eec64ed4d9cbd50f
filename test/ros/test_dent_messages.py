from __future__ import annotations

import numpy as np
import pytest
from dent_samples import make_dent
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.ros.dent_messages import (
    KINDS,
    dents_from_message,
    dents_to_markers,
    dents_to_message,
)
from ftp_dent_ros.ros.messages import cloud_from_message, stamp_to_ns


@pytest.fixture
def entries():
    dents = DentList()
    cut = make_dent((1.0, 2.0, 3.0), depth=1e-3, is_cut=True)
    dents.add(1, [make_dent((0.1, 0.2, 0.6)), cut, make_dent((9, 9, 9), -2e-3, kind='bump')])
    return dents.entries


def test_a_message_holds_each_dent_as_a_point_with_its_measurements(entries):
    message = dents_to_message(entries, 1_763_000_000_123_456_789, 'map')
    assert stamp_to_ns(message.header.stamp) == 1_763_000_000_123_456_789
    assert (message.header.frame_id, message.height, message.width) == ('map', 1, 3)
    dents = dents_from_message(message)
    assert [KINDS[kind] for kind in dents['kind']] == ['dent', 'dent', 'bump']
    np.testing.assert_allclose(dents['depth'], [2e-3, 1e-3, -2e-3], rtol=1e-6)
    np.testing.assert_allclose(dents['depth_uncertainty'], 10e-6, rtol=1e-6)
    np.testing.assert_allclose([dents[f'normal_{a}'][0] for a in 'xyz'], [0, 0, -1])
    assert dents['is_cut'].tolist() == [0, 1, 0] and dents['number'].tolist() == [1, 2, 3]
    assert np.isinf(dents['clearance'][2]) or dents['clearance'][2] > 1
    # Any reader of clouds finds the points.
    points = cloud_from_message(message).points[0]
    np.testing.assert_allclose(points[1], [1, 2, 3], atol=1e-6)


def test_markers_outline_each_dent_and_say_its_depth(entries):
    first, *others = dents_to_markers(entries, 5, 'map').markers
    assert first.action == Marker.DELETEALL
    texts = [marker.text for marker in others if marker.type == Marker.TEXT_VIEW_FACING]
    assert texts == ['1: 2.00 mm', '2: 1.00 mm', '3: -2.00 mm (bump)']
    lines = [marker for marker in others if marker.type == Marker.LINE_STRIP]
    assert len(lines) == 3
    assert all(line.points[0] == line.points[-1] and line.color.a == 1.0 for line in lines)
    assert all(marker.header.frame_id == 'map' for marker in others)
    assert len({(marker.ns, marker.id) for marker in others}) == len(others)


def test_another_cloud_is_no_message_of_dents():
    with pytest.raises(CloudError, match='holds no dents'):
        dents_from_message(PointCloud2())
