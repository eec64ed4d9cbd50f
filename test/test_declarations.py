"""Parameters of a configuration, checked before anything is started and without ROS."""

import shutil

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.nodes.settings import CameraCaptureSettings, fitted, read
from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.supervision.configuration import read_configuration


def fit(tmp_path, text):
    path = tmp_path / 'payload.yaml'
    path.write_text(text)
    return fitted(read_configuration(path))


@pytest.mark.parametrize(
    ('node', 'parameters', 'sentence'),
    [
        ('reconstruction', 'rigg: shipped:rig.yaml', 'no parameter rigg: did you mean rig?'),
        ('pattern_publisher', 'displayy: {enabled: true}', 'did you mean display.enabled?'),
        ('mavlink_bridge', 'adress: udpin:14550', 'no parameter adress: did you mean address?'),
        ('dent_inspector', 'zzz: 1', 'there are always, '),
        ('simulated_autopilot', 'start: 5', 'no parameter start: did you mean start_ns?'),
        ('simulated_autopilot', 'start_ns: soon', 'start_ns is .soon.: give a whole number'),
        ('simulated_autopilot', 'address: [1]', 'parameter address is'),
        ('mavlink_bridge', 'stride: 2', 'no parameter stride'),
        ('reconstruction', 'tau: 0', 'tau is 0: give a finite number above 0 to 1'),
        ('reconstruction', 'tau: [1]', 'parameter tau is .*: give a finite number'),
        ('reconstruction', 'method: fourier', 'give one of least-squares, '),
        ('camera_capture', 'rate: fast', "rate is 'fast': give a finite number"),
        ('reconstruction', 'rig: rig.yaml', 'parameter rig: .*rig.yaml: no such file'),
        ('dent_inspector', 'rules: shipped:my.yaml', 'no file of that name is shipped'),
        ('simulated_autopilot', 'scene: none.yaml', 'parameter scene: .*none.yaml: no such file'),
    ],
)
def test_what_is_wrong_with_a_parameter_is_one_sentence(tmp_path, node, parameters, sentence):
    with pytest.raises(ConfigurationError, match=sentence) as caught:
        fit(tmp_path, f'{node}:\n  ros__parameters:\n    {parameters}\n')
    assert str(caught.value).startswith(f'{tmp_path}/payload.yaml: {node}: ')


def test_what_is_for_all_nodes_needs_one_that_has_it(tmp_path):
    text = '/**: {{ros__parameters: {{{}: 2}}}}\nmavlink_bridge: {{ros__parameters: {{}}}}\n'
    fit(tmp_path, text.format('stride'))
    with pytest.raises(ConfigurationError, match='did you mean stride'):
        fit(tmp_path, text.format('strid'))


def test_what_ros_and_its_topics_declare_is_left_to_them(tmp_path):
    text = 'use_sim_time: true, qos_overrides./points.publisher.depth: 4'
    fit(tmp_path, f'reconstruction: {{ros__parameters: {{{text}}}}}')


def test_a_number_as_ros_reads_it(tmp_path):
    fit(tmp_path, 'dent_inspector: {ros__parameters: {smallest_depth: 1e-3}}')


def test_relative_paths_start_at_the_configuration(tmp_path, monkeypatch):
    folder = tmp_path / 'my drone'
    folder.mkdir()
    shutil.copy(config_folder() / 'rig.yaml', folder)
    monkeypatch.chdir(tmp_path)
    (entry,) = fit(folder, 'reconstruction: {ros__parameters: {rig: rig.yaml}}')
    assert entry.absolute == {'rig': str(folder / 'rig.yaml')}
    assert entry.program.command[-1] == f'rig:="{folder}/rig.yaml"'
    (entry,) = fit(folder, 'reconstruction: {ros__parameters: {rig: shipped:rig.yaml}}')
    assert entry.absolute == {}
    (entry,) = fit(folder, 'camera_capture: {ros__parameters: {files.path: images/*.png}}')
    assert entry.absolute == {'files.path': str(folder / 'images/*.png')}


def test_a_camera_without_a_rig_is_asked_for_the_size_that_the_page_promises():
    given = read(CameraCaptureSettings, Declarations({}))
    assert (given.width, given.height) == (1280, 720)
    genicam = Declarations({'source': 'genicam'})
    assert read(CameraCaptureSettings, genicam).asked().width == 0, 'its own'
