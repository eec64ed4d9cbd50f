"""GO or NO GO, of a payload in simulation."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from test_calibration import write_scene

from ftp_dent_ros.calibration.preflight import NO, OK, WARN, examine
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import write_rig
from ftp_dent_ros.simulation import Panel, Photometry, Surface, render

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


def test_a_payload_gets_go_and_a_wrong_rig_no_go(ros, domain, rig, rig_file, tmp_path):
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
        config.write_text(
            yaml.safe_dump(
                {
                    f'{ros.namespace}/{name}': {'ros__parameters': values}
                    for name, values in blocks.items()
                }
            )
        )
        return subprocess.run(
            [sys.executable, '-m', 'ftp_dent_ros.cli.main', 'preflight', str(config)],
            capture_output=True,
            text=True,
            timeout=240,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
        )

    done = preflight()
    assert done.stdout.endswith('\nGO\n'), done.stdout + done.stderr
    assert done.returncode == 0
    for name in ('exposure', 'focus', 'flicker', 'ambient', 'stripe', 'distance', 'clock', 'disk'):
        assert name in done.stdout
    blocks['reconstruction']['rig'] = wrong.name  # beside the configuration
    done = preflight()
    assert done.returncode == 1
    assert 'NO GO: rig: the rig does not hold: the projector has turned, pitch' in done.stdout
