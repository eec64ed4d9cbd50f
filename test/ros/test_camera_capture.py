from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from ftp_dent_ros.ros.messages import image_from_message, lens_from_message, stamp_to_ns


@pytest.fixture
def photographs(tmp_path, rig):
    """A folder of three photographs whose red levels are 50, 100 and 150."""
    folder = tmp_path / 'photographs'
    folder.mkdir()
    for number, level in enumerate((50, 100, 150)):
        image = np.full((rig.camera.height, rig.camera.width, 3), (10, 20, level), np.uint8)
        cv2.imwrite(str(folder / f'{number}.png'), image)
    return folder


def red(message: Image) -> int:
    return int(image_from_message(message)[0, 0, 0])


def test_files_are_published_with_their_camera_info(ros, rig, rig_file, photographs):
    images = ros.collect(Image, 'camera/image_raw')
    infos = ros.collect(CameraInfo, 'camera/camera_info')
    process = ros.start(
        'camera_capture', source='files', files__path=photographs, rig=rig_file, rate=10
    )

    def both():
        told = [info.header for info in infos]
        return [image for image in images if image.header in told]

    # Who is met a moment later by the one than by the other misses some of it.
    ros.until(lambda: len(both()) >= 7)
    levels = [red(message) for message in images]
    assert set(pairwise(levels)) == {(50, 100), (100, 150), (150, 50)}
    assert images[0].header.frame_id == 'camera_optical_frame'
    stamps = [stamp_to_ns(message.header.stamp) for message in images]
    assert stamps == sorted(set(stamps))
    assert abs(stamps[-1] - ros.node.get_clock().now().nanoseconds) < 60e9
    lens = lens_from_message(infos[0])
    np.testing.assert_array_equal(lens.camera_matrix, rig.camera.camera_matrix)
    assert process.stop() == 0


def test_photographs_on_demand_then_at_a_rate_until_there_are_no_more(ros, photographs):
    images = ros.collect(Image, 'camera/image_raw')
    infos = ros.collect(CameraInfo, 'camera/camera_info')
    state = ros.diagnostics('camera_capture')
    once = {'files__path': photographs, 'files__loop': False}
    ros.start('camera_capture', source='files', rate=50, continuous=False, **once)
    state.says('waiting for a call of ~/capture')
    ros.met_by('camera_capture')
    assert images == []

    def capture():
        return ros.call(Trigger, 'camera_capture/capture', Trigger.Request())

    response = capture()
    assert response.success
    ros.until(lambda: images and infos)
    stamp = images[0].header.stamp
    assert response.message == f'photograph taken at {stamp.sec}.{stamp.nanosec:09d}'
    assert infos[0].k[0] == 0.0, 'no rig: uncalibrated'
    state.shows('images', 1)
    parameters = [Parameter('continuous', value=True).to_parameter_msg()]
    request = SetParameters.Request(parameters=parameters)
    (result,) = ros.call(SetParameters, 'camera_capture/set_parameters', request).results
    assert result.successful
    state.says('all images have been published')
    # What it says may overtake what it shows.
    ros.until(lambda: len(images) == 3)
    assert [red(message) for message in images] == [50, 100, 150]
    response = capture()
    assert not response.success and 'no more images' in response.message


def test_wrong_files_are_refused_and_nothing_is_read_while_nobody_listens(
    ros, photographs, rig_file
):
    (photographs / '0.png').write_bytes(b'this is no image')
    cv2.imwrite(str(photographs / '1.png'), np.zeros((10, 10, 3), np.uint8))
    process = ros.start(
        'camera_capture', source='files', files__path=photographs, rig=rig_file, rate=5
    )
    state = ros.diagnostics('camera_capture')
    state.says('idle: nobody subscribes to the images')
    assert state.value('images') is None and state.value('refused') == '0'
    images = ros.collect(Image, 'camera/image_raw')
    ros.until(lambda: len(images) >= 2)
    assert {red(message) for message in images} == {150}
    assert '0.png: empty, damaged or not an image' in process.output
    ros.until(lambda: int(state.value('refused')) >= 2)
    assert state().level == DiagnosticStatus.WARN


def test_a_missing_camera_is_an_error_and_the_node_goes_on_trying(ros):
    state = ros.diagnostics('camera_capture')
    process = ros.start(
        'camera_capture', device__path='/dev/video99', device__width=640, device__height=480
    )
    state.says('/dev/video99 does not exist: plug the camera in')
    assert (state().level, state().hardware_id) == (DiagnosticStatus.ERROR, '/dev/video99')
    response = ros.call(Trigger, 'camera_capture/capture', Trigger.Request())
    assert not response.success and '/dev/video99 does not exist' in response.message
    assert process.alive
    assert process.stop() == 0
