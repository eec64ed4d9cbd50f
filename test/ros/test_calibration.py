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
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.ros import photographer
from ftp_dent_ros.ros.messages import cloud_from_message
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED_INPUT
from ftp_dent_ros.simulation import Panel, Surface

BOARD = Board(7, 6, 0.03)
POSES = 4
LIGHT = {
    'reference_distance': 0.75,
    'exposure': 0.85,
    'projector_gamma': 1.8,
    'ambient': 0.03,
    'read_noise': 0.0,
    'full_well': 1e9,
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


def test_from_capture_to_the_first_true_cloud(ros, domain, rig, rig_file, tmp_path):
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
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
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
