"""From the box to the first true cloud, on a rig that the software has never seen."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numpy as np
import pytest
import yaml
from boards import random_pose
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.preflight import NO, OK, WARN, examine
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig, write_rig
from ftp_dent_ros.ros import photographer
from ftp_dent_ros.ros.messages import cloud_from_message
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED_INPUT
from ftp_dent_ros.simulation import Panel, Photometry, Surface, render

BOARD = Board(7, 6, 0.03)
POSES = 3
LIGHT = {
    'reference_distance': 0.75,
    'exposure': 0.85,
    'projector_gamma': 1.8,
    'ambient': 0.03,
    'read_noise': 0.0,
    'full_well': 1e9,
    'samples': 2,
}


def write_scene(path, pose, paint, extent):
    """A panel before a rig that stands still; the file is replaced, never half there."""
    scene = {
        'panels': [
            {
                'pose': {
                    'translation': pose.translation.tolist(),
                    'rpy': pose.rotation.as_euler('xyz').tolist(),
                },
                'extent': extent,
                'paint': paint,
            }
        ],
        'flight': {
            'middle': {'translation': [0, 0, 0], 'rpy': [0, 0, 0]},
            'length': 1e-6,
            'speed': 1e-6,
        },
        'camera': {'mount': {'translation': [0, 0, 0], 'rpy': [0, 0, 0]}, 'exposure_time': 0.003},
        'photometry': LIGHT,
    }
    aside = path.with_suffix('.new')
    aside.write_text(yaml.safe_dump(scene))
    os.replace(aside, path)


def show_board(path, pose):
    side = BOARD.square
    extent = [-1.5 * side, 7.5 * side, -1.5 * side, 6.5 * side]
    board = {'columns': 7, 'rows': 6, 'square': side}
    write_scene(path, pose, {'board': board}, extent)


def test_from_capture_to_the_first_true_cloud(ros, rig, rig_file, tmp_path):
    rng = np.random.default_rng(2)
    poses = iter([random_pose(BOARD, rig, distance, rng) for distance in (0.8, 0.7, 0.9) * 4])
    scene, pattern = tmp_path / 'scene.yaml', tmp_path / 'pattern.yaml'
    show_board(scene, next(poses))
    write_pattern(pattern, Pattern(320, 200, 10.0, 160.0))
    ros.start('pattern_publisher', pattern=pattern)
    camera = {'source': 'simulation', 'simulation.scene': scene, 'rate': 0.0}
    ros.start('camera_capture', rig=rig_file, **camera)

    folder = tmp_path / 'calibration'
    words = f'--board 7x6 --square 30 --baseline 200 --period 32 --steps 3 --poses {POSES}'
    capture = subprocess.Popen(
        [
            *(sys.executable, '-m', 'ftp_dent_ros.cli.main', 'calibrate', 'capture', str(folder)),
            *words.split(),
            *('--namespace', ros.namespace),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=(tmp_path / 'errors').open('w'),
        text=True,
    )
    watchdog = threading.Timer(240, capture.kill)
    watchdog.start()
    said = []
    for line in capture.stdout:
        said.append(line)
        if 'Enter takes it' in line:
            # One pose is held so that the board is half out of view.
            spoilt = len([each for each in said if 'Enter takes' in each]) == 2
            pose = next(poses)
            aside = np.array([0.25 * spoilt, 0, 0])
            show_board(scene, Pose(pose.rotation, pose.translation + aside))
            capture.stdin.write('\n')
            capture.stdin.flush()
    watchdog.cancel()
    assert capture.wait() == 0, ''.join(said) + (tmp_path / 'errors').read_text()
    text = ''.join(said)
    assert 'refused: no chessboard of 7x6' in text
    assert 'its left side away by 30 degrees' in text
    assert len(list(folder.glob('pose_*'))) == POSES

    found = tmp_path / 'found.yaml'
    assert main(['calibrate', 'solve', str(folder), '--output', str(found)]) == 0
    estimated = read_rig(found)
    assert estimated.record.rms_px['joint'] < 0.1
    assert np.linalg.norm(estimated.translation - rig.translation) < 3e-3

    pose = Pose.from_rpy((0.05, -0.1, 0.02), (0.0, 0.0, 0.75))
    extent = (-0.4, 0.4, -0.3, 0.3)
    write_scene(scene, pose, {'albedo': 0.8}, list(extent))
    ros.start('reconstruction', rig=found)
    clouds = ros.collect(PointCloud2, 'points', CLOUDS)
    reconstruction = ros.diagnostics('reconstruction')
    ros.until(lambda: (state := reconstruction()) and 'waiting for images' in state.message)

    def photographed():
        assert ros.call(Trigger, 'camera_capture/capture', Trigger.Request()).success
        return clouds

    # The camera may not know yet who listens to it: then another one is taken.
    ros.until(photographed)
    named = {pair.key: pair.value for pair in reconstruction().values}
    assert named['rig'] == estimated.id
    points = cloud_from_message(clouds[-1]).points.reshape(-1, 3).astype(float)
    points = points[np.isfinite(points).all(axis=1)]
    assert len(points) > 5000
    off = Surface((Panel(pose, extent),)).distance(points)
    assert np.abs(off).mean() < 1e-3


def test_two_at_once_are_told_of_each_other(ros, monkeypatch):
    ros.node.create_publisher(Image, 'projector/show', LATCHED_INPUT)
    monkeypatch.setattr(photographer, '_FORGOTTEN', 1.0)
    rig = photographer.Photographer(
        Node('calibration', namespace=ros.namespace, context=ros.context), threading.Event()
    )
    ros.until(lambda: ros.node.count_publishers('projector/show') == 2)
    with pytest.raises(CameraError, match='another program shows images'):
        rig.alone()
    rig.close()


# GO or NO GO, of a payload in simulation.

PATTERN = Pattern(320, 200, 10.0, 160.0)
SKIN = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.75]), (-1, 1, -1, 1)),))


def photograph(rig, image, **light):
    return render(rig, image, SKIN, Photometry(reference_distance=0.75, **light))


@pytest.mark.parametrize(
    ('light', 'flicker', 'name', 'verdict'),
    [
        ({}, 0, '', OK),
        ({'exposure': 3.0}, 0, 'exposure', NO),
        ({'exposure': 0.15}, 0, 'exposure', NO),
        ({'defocus_px': 3.0}, 0, 'focus', NO),
        ({'defocus_px': 1.8}, 0, 'focus', WARN),
        ({'exposure': 0.4, 'ambient': 0.8}, 0, 'ambient', WARN),
        ({}, 0.15, 'flicker', NO),
    ],
)
def test_each_fault_is_found_and_advised(rig, light, flicker, name, verdict):
    white, black = (
        photograph(rig, np.full((200, 320, 3), level, np.uint8), **light) for level in (254, 0)
    )
    fringes = photograph(rig, PATTERN.draw(), **light)
    several = [(fringes * (1 - flicker * (i % 2))).astype(np.uint8) for i in range(4)]
    reconstructor = Reconstructor(rig, PATTERN, Settings(stride=4))
    findings = {
        each.name: each
        for each in examine(rig, PATTERN, white, black, several, reconstructor, 0.01)
    }
    if name:
        assert findings[name].verdict == verdict, findings[name].text
        assert ': ' in findings[name].text
    else:
        assert {each.verdict for each in findings.values()} == {OK}, findings
        assert findings['distance'].text.startswith('0.75')
        assert 'mm a point, dents found from ' in findings['distance'].text


def test_a_payload_gets_go_and_a_wrong_rig_no_go(ros, rig, rig_file, tmp_path):
    scene, pattern = tmp_path / 'scene.yaml', tmp_path / 'pattern.yaml'
    wrong, config = tmp_path / 'wrong.yaml', tmp_path / 'payload.yaml'
    write_scene(scene, Pose.from_rpy((0, 0.1, 0), (0, 0, 0.75)), {'albedo': 0.8}, [-1, 1, -1, 1])
    write_pattern(pattern, PATTERN)
    by = Rotation.from_euler('x', 0.5, degrees=True).as_matrix()
    write_rig(
        wrong,
        type(rig)(rig.camera, rig.projector, by @ rig.rotation, by @ rig.translation),
    )
    camera = {'source': 'simulation', 'simulation.scene': str(scene), 'rate': 0.0}
    blocks = {
        'pattern_publisher': {'pattern': str(pattern)},
        'camera_capture': {**camera, 'rig': str(rig_file)},
        'reconstruction': {'rig': str(rig_file)},
    }
    for name, values in blocks.items():
        ros.start(name, **values)

    def preflight():
        entries = {
            f'{ros.namespace}/{name}': {'ros__parameters': values}
            for name, values in blocks.items()
        }
        config.write_text(yaml.safe_dump(entries))
        command = ros.command('preflight', config)
        return command.wait(240), command.output

    status, told = preflight()
    assert status == 0 and '\nGO\n' in told, told
    for name in ('exposure', 'focus', 'flicker', 'ambient', 'stripe', 'distance', 'clock', 'disk'):
        assert name in told
    blocks['reconstruction']['rig'] = wrong.name  # beside the configuration
    status, told = preflight()
    assert status == 1
    assert 'NO GO: rig: the rig does not hold: the projector has turned, pitch' in told
