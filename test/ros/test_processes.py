"""What all nodes do alike as processes: start, report, end by a signal, refuse bad parameters."""

from __future__ import annotations

import signal

import pytest

from ftp_dent_ros.pattern import Pattern, write_pattern

NODES = ('pattern_publisher', 'camera_capture', 'reconstruction')


def parameters_of(name, rig_file):
    return {
        'pattern_publisher': {'period_px': 8},
        'camera_capture': {'device__path': '/dev/video99', 'rate': 5},
        'reconstruction': {},
    }[name] | {'rig': rig_file}


@pytest.mark.parametrize('with_signal', [signal.SIGINT, signal.SIGTERM])
def test_every_node_reports_and_ends_well_on_a_signal(ros, rig_file, with_signal):
    processes = {name: ros.start(name, **parameters_of(name, rig_file)) for name in NODES}
    states = [ros.diagnostics(name) for name in NODES]
    ros.until(lambda: all(state() for state in states))
    for name, process in processes.items():
        assert process.stop(with_signal) == 0, f'{name}: {process.output}'
        assert 'Traceback' not in process.output


def test_a_second_signal_does_not_spoil_the_end(ros, rig_file):
    process = ros.start('camera_capture', **parameters_of('camera_capture', rig_file))
    ros.until(ros.diagnostics('camera_capture'))
    process.send(signal.SIGINT)
    process.send(signal.SIGTERM)
    assert process.stop(signal.SIGINT) == 0
    assert 'Traceback' not in process.output


def test_bad_parameters_are_one_clear_line_and_status_2(ros, rig_file, tmp_path):
    small = tmp_path / 'small.yaml'
    write_pattern(small, Pattern(160, 100, 8.0, 80.0))
    broken = tmp_path / 'broken.yaml'
    broken.write_text(rig_file.read_text().replace('plumb_bob', 'fisheye', 1))
    cases = [
        ('pattern_publisher', {}, 'set the parameter pattern or rig'),
        ('pattern_publisher', {'rig': rig_file}, 'set the parameter pattern or period_px'),
        ('pattern_publisher', {'rig': rig_file, 'pattern': small}, 'the pattern is 160x100'),
        ('pattern_publisher', {'rig': 'nowhere.yaml', 'period_px': 8}, 'nowhere.yaml'),
        ('reconstruction', {'rig': broken}, 'camera.distortion_model'),
        ('reconstruction', {'method': 'fourier'}, "parameter method is 'fourier'"),
        ('reconstruction', {'stride': 0}, 'parameter stride is 0'),
        ('reconstruction', {'tau': 'slow'}, "parameter tau is 'slow'"),
        ('camera_capture', {'source': 'webcam'}, "parameter source is 'webcam'"),
        ('camera_capture', {'source': 'files'}, 'no image files are named'),
        ('camera_capture', {'source': 'files', 'files__path': tmp_path / 'x'}, 'no image there'),
        ('camera_capture', {'source': 'simulation'}, 'set the parameter rig'),
        ('camera_capture', {'source': 'device'}, 'set rig, or device.width'),
        ('camera_capture', {'rig': rig_file, 'device__fourcc': 'MJPEG'}, 'pixel format'),
    ]
    for start in range(0, len(cases), 4):
        group = cases[start : start + 4]
        processes = [ros.start(name, **parameters) for name, parameters, _ in group]
        for process, (name, _, sentence) in zip(processes, group, strict=True):
            assert process.wait() == 2, process.output
            lines = process.output.strip().splitlines()
            assert len(lines) == 1 and lines[0].startswith(f'{name}: '), process.output
            assert sentence in lines[0]


def test_arguments_that_ros_cannot_parse_are_status_2(ros):
    process = ros.start('reconstruction', '-p', 'rate')
    assert process.wait() == 2
    assert 'Traceback' not in process.output and 'reconstruction: ' in process.output
