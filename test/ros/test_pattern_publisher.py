from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.ros.messages import image_from_message, stamp_to_ns
from ftp_dent_ros.ros.qos import LATCHED

PATTERN = Pattern(320, 200, 10.0, 150.0)


@pytest.fixture
def pattern_file(tmp_path):
    path = tmp_path / 'pattern.yaml'
    write_pattern(path, PATTERN)
    return path


@pytest.mark.parametrize('has_rig', [True, False])
def test_whoever_comes_late_still_gets_the_pattern(ros, rig_file, rig, pattern_file, has_rig):
    given = {'rig': rig_file} if has_rig else {'period_px': 12.5}
    process = ros.start('pattern_publisher', pattern=pattern_file, **given)
    ros.until(ros.diagnostics('pattern_publisher'))
    images = ros.collect(Image, 'projector/image_raw', LATCHED)
    infos = ros.collect(CameraInfo, 'projector/camera_info', LATCHED)
    ros.until(lambda: images and infos)
    image = image_from_message(images[0])
    pattern = PATTERN if has_rig else replace(PATTERN, period_px=12.5)
    np.testing.assert_array_equal(image, pattern.draw())
    assert images[0].header == infos[0].header
    assert images[0].header.frame_id == 'projector_optical_frame'
    assert (infos[0].width, infos[0].height) == (320, 200)
    matrix = rig.projector.camera_matrix.ravel() if has_rig else np.zeros(9)
    np.testing.assert_array_equal(infos[0].k, matrix)
    assert process.stop() == 0


def test_the_pattern_of_a_rig_alone_changes_while_it_runs(ros, rig_file):
    ros.start('pattern_publisher', rig=rig_file, period_px=8)
    images = ros.collect(Image, 'projector/image_raw', LATCHED)
    ros.until(lambda: images)
    assert pattern_from_image(image_from_message(images[0])) == Pattern(320, 200, 8.0, 159.5)

    def change(**values):
        parameters = [Parameter(key, value=value) for key, value in values.items()]
        request = SetParameters.Request(
            parameters=[item.to_parameter_msg() for item in parameters]
        )
        return ros.call(SetParameters, 'pattern_publisher/set_parameters', request).results[0]

    asked_ns = ros.node.get_clock().now().nanoseconds
    assert change(period_px=16.0).successful
    ros.until(lambda: len(images) == 2)
    ahead_ns = stamp_to_ns(images[1].header.stamp) - asked_ns
    assert ahead_ns >= 200_000_000, 'it is told of before it is shown'
    assert change(period_px=16.0).successful, 'no change, and not published again'
    assert pattern_from_image(image_from_message(images[1])) == Pattern(320, 200, 16.0, 159.5)
    refused = change(period_px=100.0)
    assert not refused.successful
    assert 'period_px is 100.0: give 3 to 80' in refused.reason
    assert change(stripe_center_px=100.0).successful
    ros.until(lambda: len(images) == 3)
    last = pattern_from_image(image_from_message(images[2]))
    assert last == Pattern(320, 200, 16.0, 100.0), 'the refused period left nothing behind'
    assert not change(code='colour').successful
    assert change(code='contrast').successful
    ros.until(lambda: len(images) == 4)
    coded = pattern_from_image(image_from_message(images[3]))
    assert coded == Pattern(320, 200, 16.0, 164.0, code='contrast')
