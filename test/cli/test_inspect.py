"""The command on a cloud and on a photograph; bags are tested where ROS is."""

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
from dent_samples import DENTED, noisy_cloud

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.ply import write_ply
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Photometry, Renderer
from ftp_dent_ros.simulation.truth import true_dents

TRUTH = true_dents(DENTED)


@pytest.fixture(scope='module')
def cloud():
    return noisy_cloud()


def inspected(folder, *words):
    assert main(['inspect', *map(str, words), '--output', str(folder)]) == 0
    assert (folder / 'report.html').stat().st_size > 10_000
    assert (folder / 'dents.csv').is_file()
    return json.loads((folder / 'dents.json').read_text())


def refusal(capsys, *words):
    assert main(['inspect', *map(str, words)]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.startswith('ftp-dent inspect: ') and len(err.splitlines()) == 1
    return err


def test_a_cloud_gives_its_dents_and_their_verdicts(tmp_path, capsys, cloud):
    write_ply(tmp_path / 'cloud.ply', cloud, 'camera_optical_frame')
    words = ('--rules', 'shipped:example_rules.yaml', '--rig', 'shipped:rig.yaml')
    data = inspected(tmp_path / 'out', tmp_path / 'cloud.ply', *words)
    assert [dent['depth_mm'] for dent in data['dents']] == pytest.approx([2, 1], abs=0.02)
    for dent, true in zip(data['dents'], TRUTH, strict=True):
        assert [dent[a] for a in 'xyz'] == pytest.approx(true.position, abs=5e-4)
        assert dent['length_mm'] == pytest.approx(true.length * 1e3, abs=1)
        assert dent['width_mm'] == pytest.approx(true.width * 1e3, abs=0.5)
    assert all(dent['verdict'] for dent in data['dents'])
    assert data['frame_id'] == 'camera_optical_frame' and len(data['rig']['id']) == 12
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == '2 dents, 0 others'
    deepest = data['dents'][0]
    assert lines[1].endswith(f'width {deepest["width_mm"]:.1f} mm: exceeds')


def test_the_report_repeats_the_rig_that_measured_the_cloud(tmp_path, capsys, cloud):
    rig = read_rig(find('shipped:rig.yaml'))
    path = tmp_path / 'cloud.ply'
    write_ply(path, cloud, 'camera_optical_frame', rig.id)
    assert inspected(tmp_path / 'out', path)['rig'] == {'file': None, 'id': rig.id}
    assert f'id {rig.id}' in (tmp_path / 'out/report.html').read_text()
    with_file = inspected(tmp_path / 'other', path, '--rig', 'shipped:rig.yaml')
    assert with_file['rig'] == {'file': 'rig.yaml', 'id': rig.id}
    capsys.readouterr()
    write_ply(path, cloud, 'camera_optical_frame', '0123456789ab')
    out = ('--output', tmp_path / 'no', '--rig', 'shipped:rig.yaml')
    assert 'was measured by the rig 0123456789ab' in refusal(capsys, path, *out)


def test_dents_smaller_than_asked_for_are_left_out(tmp_path, cloud):
    write_ply(tmp_path / 'cloud.ply', cloud, 'camera_optical_frame')
    data = inspected(tmp_path / 'out', tmp_path / 'cloud.ply', '--smallest-depth', '1.5')
    assert len(data['dents']) == 1 and data['smallest_depth_mm'] == pytest.approx(1.5)


def test_a_photograph_is_reconstructed_and_shown_with_its_dents(tmp_path):
    rig, pattern = read_rig(find('shipped:rig.yaml')), read_pattern(find('shipped:pattern.yaml'))
    light = Photometry(reference_distance=0.6)
    image = Renderer(rig, pattern.draw(), light).render(DENTED, np.random.default_rng(1))
    cv2.imwrite(str(tmp_path / 'photo.png'), image[..., ::-1])
    words = ('--rig', 'shipped:rig.yaml', '--pattern', 'shipped:pattern.yaml')
    data = inspected(tmp_path / 'out', tmp_path / 'photo.png', *words)
    assert data['dents'][0]['depth_mm'] == pytest.approx(2, abs=0.05)
    assert 'data:image/jpeg' in (tmp_path / 'out/report.html').read_text()


def test_each_wrong_input_is_one_sentence(tmp_path, capsys, cloud):
    out = ('--output', tmp_path / 'out')
    assert 'no such file' in refusal(capsys, tmp_path / 'none.ply', *out)
    (tmp_path / 'x.txt').write_text('x')
    assert 'neither a cloud' in refusal(capsys, tmp_path / 'x.txt', *out)
    (tmp_path / 'x.ply').write_text('x')
    assert 'not a PLY file' in refusal(capsys, tmp_path / 'x.ply', *out)
    (tmp_path / 'x.png').write_text('x')
    assert 'needs its rig and its pattern' in refusal(capsys, tmp_path / 'x.png', *out)
    empty = Cloud(np.full((60, 80, 3), np.nan, np.float32), np.zeros((60, 80), np.float32))
    write_ply(tmp_path / 'empty.ply', empty, 'camera_optical_frame')
    assert 'empty.ply' in refusal(capsys, tmp_path / 'empty.ply', *out)
    write_ply(tmp_path / 'cloud.ply', cloud, 'camera_optical_frame')
    (tmp_path / 'rules.yaml').write_text('limits: 3')
    rules = ('--rules', tmp_path / 'rules.yaml')
    assert 'limits is 3: give a list' in refusal(capsys, tmp_path / 'cloud.ply', *out, *rules)
    depth = ('--smallest-depth', '-1')
    said = refusal(capsys, tmp_path / 'cloud.ply', *out, *depth)
    assert said.endswith('--smallest-depth is -1: give 0.001 to 100\n')
    stride = ('--stride', '0')
    assert 'stride is 0' in refusal(capsys, tmp_path / 'cloud.ply', *out, *stride)
    taken = ('--output', tmp_path / 'x.txt')
    assert 'name a folder' in refusal(capsys, tmp_path / 'cloud.ply', *taken)
    assert not (tmp_path / 'out').exists()


def test_without_ros_clouds_and_photographs_are_inspected_all_the_same():
    code = (
        'import sys, importlib.abc\n'
        'class No(importlib.abc.MetaPathFinder):\n'
        '    def find_spec(self, name, path, target=None):\n'
        '        if name.split(".")[0] in ("rclpy", "sensor_msgs", "std_msgs", "mcap"):\n'
        '            raise ModuleNotFoundError(name, name=name)\n'
        'sys.meta_path.insert(0, No())\n'
        'import ftp_dent_ros.cli.inspect\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, env=os.environ)
    assert done.returncode == 0, done.stderr


def test_a_cloud_in_the_map_is_seen_from_its_outside(tmp_path, cloud):
    pose = Pose.from_rpy((0.4, 1.0, -2.0), (9, -4, 2))
    write_ply(tmp_path / 'map.ply', cloud.transformed(pose), 'map')
    data = inspected(tmp_path / 'out', tmp_path / 'map.ply')
    assert data['frame_id'] == 'map' and data['others'] == []
    assert [dent['depth_mm'] for dent in data['dents']] == pytest.approx([2, 1], abs=0.02)
    expected = pose.apply(TRUTH[0].position)
    assert [data['dents'][0][a] for a in 'xyz'] == pytest.approx(expected, abs=5e-4)
