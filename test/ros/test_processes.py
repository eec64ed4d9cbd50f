"""What all nodes do alike as processes: start, report, end by a signal, refuse bad parameters."""

from __future__ import annotations

import signal

import pytest
from rclpy.parameter import Parameter

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.nodes.camera_capture import CameraCapture
from ftp_dent_ros.nodes.pattern_publisher import PatternPublisher
from ftp_dent_ros.nodes.reconstruction import Reconstruction
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern

NODES = {
    'pattern_publisher': {'period_px': 8},
    'camera_capture': {'device__path': '/dev/video99', 'rate': 5},
    'reconstruction': {},
}


def test_every_node_reports_and_ends_well_on_a_signal(ros, rig_file):
    processes = {name: ros.start(name, rig=rig_file, **given) for name, given in NODES.items()}
    states = [ros.diagnostics(name) for name in NODES]
    ros.until(lambda: all(state() for state in states))
    for process in processes.values():
        process.send(signal.SIGTERM)
    # Further signals must not spoil the end, however late they come.
    while processes['camera_capture'].alive:
        processes['camera_capture'].send(signal.SIGINT)
    for name, process in processes.items():
        assert process.wait() == 0, f'{name}: {process.output}'
        assert 'Traceback' not in process.output


def test_bad_parameters_are_one_clear_line_and_status_2(ros, rig_file):
    wrong = ros.start('reconstruction', rig=rig_file, stride=0)
    unparsed = ros.start('mavlink_bridge', '-p', 'rate')
    sentence = 'reconstruction: parameter stride is 0: give a whole number from 1 to'
    assert wrong.told(sentence), wrong.output
    # ROS itself has a line on what it cannot parse.
    assert unparsed.wait() == 2
    assert 'Traceback' not in unparsed.output and 'mavlink_bridge: ' in unparsed.output


@pytest.mark.parametrize(
    ('node', 'parameters', 'sentence'),
    [
        (PatternPublisher, {'rig': 'RIG'}, 'set the parameter pattern or period_px'),
        (
            PatternPublisher,
            {'rig': 'RIG', 'pattern': 'PATTERN'},
            'the pattern is 160x100, the projector 320x200',
        ),
        (PatternPublisher, {}, 'the size of the pattern is not known: set'),
        (Reconstruction, {'rig': 'BROKEN'}, 'camera.distortion_model'),
        (CameraCapture, {'source': 'files'}, 'no image files are named'),
        (CameraCapture, {'source': 'simulation'}, 'set the parameter rig'),
        (
            CameraCapture,
            {
                'source': 'simulation',
                'rig': 'RIG',
                'simulation.scene': 'shipped:scene.yaml',
                'simulation.ahead': 'nowhere',
            },
            'correct simulation.ahead',
        ),
        (CameraCapture, {'device.width': 0}, 'set rig, or device.width and device.height'),
        (CameraCapture, {'rig': 'RIG', 'device.fourcc': 'MJPEG'}, 'has not four characters'),
    ],
)
def test_what_is_wrong_with_a_parameter_is_said(
    ros, rig_file, tmp_path, node, parameters, sentence
):
    write_pattern(tmp_path / 'small.yaml', Pattern(160, 100, 8.0, 80.0))
    broken = tmp_path / 'broken.yaml'
    broken.write_text(rig_file.read_text().replace('plumb_bob', 'fisheye', 1))
    files = {'RIG': rig_file, 'PATTERN': tmp_path / 'small.yaml', 'BROKEN': broken}
    overrides = [
        Parameter(name, value=str(files[value]) if value in files else value)
        for name, value in parameters.items()
    ]
    made = node(context=ros.context, parameter_overrides=overrides)
    with pytest.raises(FtpDentError) as caught:
        made.start()
    made.destroy_node()
    assert sentence in str(caught.value)
