"""The whole payload flown once, and its bag replayed into another reconstruction."""

import json
import subprocess
import sys

import pytest
import yaml

pytest.importorskip('mcap', reason='the demonstration records a bag')

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.coding.messages import dents_from_message
from ftp_dent_ros.demonstration.flight import BOUNDS
from ftp_dent_ros.dents.dent import KINDS
from ftp_dent_ros.files import find
from ftp_dent_ros.recording.clouds import rig_id_of
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.ros.messages import stamp_to_ns

INPUTS = ('/projector/image_raw', '/camera/camera_info', '/camera/image_raw')


def ftp_dent(*words):
    command = [sys.executable, '-m', 'ftp_dent_ros.cli.main', *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope='module')
def flight(domain, tmp_path_factory):
    """Folder of a demonstration that stays where the skin has most of its dents."""
    folder = tmp_path_factory.mktemp('flight')
    scene = yaml.safe_load(find('shipped:scene.yaml').read_text())
    # Where the shipped one begins.
    middle = {'translation': [22.193, 3.2, 3.2], 'rpy': [0.0, 0.0, 0.6]}
    scene['flight'] |= {'length': 1.6, 'middle': middle}
    scene['photometry']['samples'] = 2  # rendered in half the time
    (folder / 'scene.yaml').write_text(yaml.safe_dump(scene))
    blocks = yaml.safe_load(find('shipped:simulation.yaml').read_text())
    blocks['camera_capture']['ros__parameters']['simulation.scene'] = 'scene.yaml'
    blocks['simulated_autopilot']['ros__parameters']['scene'] = 'scene.yaml'
    (folder / 'simulation.yaml').write_text(yaml.safe_dump(blocks))
    output = folder / 'demo'
    configuration = folder / 'simulation.yaml'
    words = ('demo', '--configuration', configuration, '--clouds', 3, '--output', output)
    done = ftp_dent(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    return output


def test_figures_are_within_their_bounds_and_files_are_there(flight):
    figures = json.loads((flight / 'summary.json').read_text())['figures']
    assert all(figures[name] <= bound for name, bound in BOUNDS.items())
    assert figures['tagged_clouds'] >= 3
    # The autopilot errs by centimetres, and the skin knows better.
    assert figures['map_mae_mm'] > 1 > 50 * figures['skin_mae_mm']
    assert figures['skin_parts'] <= figures['clouds'] / 2
    pictures = ('camera.png', 'view_3d.png')
    assert all((flight / name).stat().st_size > 10_000 for name in pictures)
    # Photographs were rendered ahead: the latency is the payload's own, and comes first.
    first, second, third, *_ = (flight / 'summary.txt').read_text().splitlines()
    assert first.startswith('exposure to tagged cloud') and figures['latency_median_ms'] < 3000
    assert second.startswith('dents in view') and third.startswith('largest error of a dent')
    assert not (flight / 'photographs').exists()
    assert not list(flight.parent.glob('.demo*'))


def test_it_ends_with_the_report_on_the_dents_that_are_there(flight):
    figures = json.loads((flight / 'summary.json').read_text())['figures']
    data = json.loads((flight / 'report/dents.json').read_text())
    assert figures['dents'] >= 1, 'the flight stays over dents'
    found = [*data['dents'], *data['others']]  # a crease is one of the others
    assert len(found) >= figures['dents']
    # 0.039 on a quiet machine, 0.053 once on a busy machine.
    assert figures['depth_error_mm'] < 0.08
    assert (data['frame_id'], data['rig']['file']) == ('map', 'rig.yaml')
    rig_id = read_rig(find('shipped:rig.yaml')).id
    assert data['rig']['id'] == rig_id_of(open_bag(flight / 'bag')) == rig_id
    assert len(data['frames']) == figures['clouds'] and data['refused'] == []
    sightings = [each['sightings'] for each in found]
    assert sum(sightings) >= figures['sightings'] - figures['sightings_missed'] > 0
    page = (flight / 'report/report.html').read_text()
    assert 'data:image/jpeg' in page
    drawn = page[page.index('id="skin"') : page.index('The skin in three dimensions')]
    assert 'Smallest dent that would have been found' in drawn and 'Signature' in drawn
    assert drawn.count('<polygon class="edge') >= 3 * len(found)
    # Clouds that all tell of each other's points are no measurements that could repeat.
    assert 'Repeatability' not in page
    # The node saw them in flight.
    *_, last = open_bag(flight / 'bag').messages(['/dents/list'])
    kinds = dents_from_message(deserialize_message(last.data, PointCloud2))['kind']
    assert KINDS.index('dent') in kinds


def test_its_bag_is_inspected_again_to_the_same_dents(flight, tmp_path):
    words = ('inspect', flight / 'bag', '--survey', '--output', tmp_path / 'out')
    done = ftp_dent(*words, '--rules', 'shipped:example_rules.yaml')
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith('report.html') and 'seen ' in done.stdout
    again = json.loads((tmp_path / 'out/dents.json').read_text())
    demo = json.loads((flight / 'report/dents.json').read_text())
    assert [d['depth_mm'] for d in again['dents']] == [d['depth_mm'] for d in demo['dents']]
    assert all(dent['verdict'] for dent in again['dents'])


def test_its_bag_gives_a_fresh_reconstruction_the_same_clouds_bit_for_bit(flight, ros):
    recorded = {
        stamp_to_ns(cloud.header.stamp): cloud
        for message in open_bag(flight / 'bag').messages(['/points'])
        for cloud in [deserialize_message(message.data, PointCloud2)]
    }
    clouds = ros.collect(PointCloud2, 'points')
    state = ros.diagnostics('reconstruction')
    blocks = yaml.safe_load((flight / 'payload.yaml').read_text())
    ros.start('reconstruction', **blocks['reconstruction']['ros__parameters'])
    ros.met_by('reconstruction')
    remaps = [f'{name}:={ros.namespace}{name}' for name in INPUTS]
    words = ['replay', flight / 'bag', '--topics', *INPUTS, '--remap', *remaps]
    # Most of it is the time in which the payload came to life.
    words += ['--rate', 3, '--wait-for-subscribers']
    bag = open_bag(flight / 'bag')
    command = [sys.executable, '-m', 'ftp_dent_ros.cli.main', *map(str, words)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as replay:
        # Clouds are taken as they come: a reader that does not loses them.
        ros.until(lambda: replay.poll() is not None, 600)
        assert replay.returncode == 0, replay.stderr.read()

    def accounted_for():
        values = {pair.key: pair.value for pair in (state().values if state() else ())}
        return len(clouds) + sum(int(values.get(name, 0)) for name in ('dropped', 'refused'))

    # A machine that others use may leave photographs out, and tells of it, but never change one.
    ros.until(lambda: accounted_for() >= bag.message_counts['/camera/image_raw'])
    same = {stamp_to_ns(cloud.header.stamp): cloud for cloud in clouds}
    assert same.keys() & recorded.keys()
    for stamp in same.keys() & recorded.keys():
        assert same[stamp] == recorded[stamp]


def test_the_bag_holds_every_topic_of_the_design(flight):
    names = {topic.name for topic in open_bag(flight / 'bag').topics}
    expected = {*INPUTS, '/projector/camera_info', '/points', '/tagged/points', '/tagged/pose'}
    expected |= {'/dents', '/dents/list', '/dents/markers'}
    assert expected | {'/mavlink/pose', '/diagnostics'} <= names


@pytest.mark.parametrize('content', ['file', 'folder'])
def test_what_is_no_demonstration_is_not_replaced(domain, tmp_path, capsys, content):
    output = tmp_path / 'mine'
    if content == 'folder':
        output.mkdir()
    precious = output / 'precious' if content == 'folder' else output
    precious.write_text('mine')
    assert main(['demo', '--output', str(output)]) == 2
    assert 'name another folder' in capsys.readouterr().err
    assert precious.read_text() == 'mine'


def test_a_configuration_without_a_simulation_is_refused(domain, tmp_path, capsys):
    words = ['demo', '--configuration', 'shipped:payload.yaml', '--output', str(tmp_path / 'x')]
    assert main(words) == 2
    assert 'has no simulated_autopilot' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
