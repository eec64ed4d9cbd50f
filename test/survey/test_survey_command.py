"""``ftp-dent survey`` on bags of flown skins."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from bag_samples import SECOND
from dent_samples import make_dent
from flown_skin import COLUMNS, ROWS, SPACING, STATED, FlownSkin, erring
from flown_surveys import START_NS, record
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.dents.dent import Inspection
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.store import SurveyStore
from ftp_dent_ros.survey.unrolled import Unrolled, find_gaps


@pytest.fixture(scope='module')
def skin():
    return FlownSkin(21, dents=((0.05, 0.02, 0.03, 5e-4), (0.15, -0.04, 0.025, 3e-4)))


def test_a_flight_becomes_one_skin_with_each_dent_once(tmp_path, skin, capsys):
    poses = list(skin.flight(5))
    bag = record(tmp_path / 'flight', skin, poses, erring(poses, 21))
    store = tmp_path / 'aircraft.sqlite'
    words = ['survey', str(bag), '--output', str(tmp_path / 'out'), '--store', str(store)]
    assert main([*words, '--name', 'first']) == 0
    said = capsys.readouterr().out
    assert '5 clouds, joined by' in said and '2 dents' in said
    found = json.loads((tmp_path / 'out' / 'survey.json').read_text())
    assert found['frame_id'] == 'map' and len(found['poses']) == 5
    dents = sorted((d for d in found['dents'] if d['kind'] == 'dent'), key=lambda d: d['depth_mm'])
    assert [d['depth_mm'] for d in dents] == pytest.approx([0.3, 0.5], rel=0.1)
    apart = np.subtract(dents[0]['position'], dents[1]['position'])
    # Between their centres on the undented cylinder.
    true = np.hypot(0.1, 0.06)
    assert np.linalg.norm(apart) == pytest.approx(true, abs=5e-4)
    picture = cv2.imread(str(tmp_path / 'out' / 'skin.png'), cv2.IMREAD_UNCHANGED)
    assert (picture > 0).sum() * 4e-6 == pytest.approx(found['coverage']['area_m2'], rel=0.03)
    assert found['coverage']['gaps'] == []
    kept = SurveyStore(store).read('first')
    assert kept.taken_ns == START_NS
    # The skin about each dent, on a cylinder of 2 m, for the comparison with another survey.
    for each in kept.dents:
        heights = each.relief.heights
        assert np.isfinite(heights).mean() > 0.9
        assert -np.nanmin(heights) == pytest.approx(each.dent.depth.value, abs=1e-4)


def test_the_report_on_a_bag_shows_the_whole_skin(tmp_path, skin, capsys):
    poses = list(skin.flight(5))
    bag = record(tmp_path / 'flight', skin, poses, erring(poses, 21))
    words = ['inspect', str(bag), '--output', str(tmp_path / 'out')]
    assert main([*words, '--survey']) == 0
    found = json.loads((tmp_path / 'out' / 'dents.json').read_text())
    one, other = ([each[axis] for axis in 'xyz'] for each in found['dents'])
    assert np.linalg.norm(np.subtract(one, other)) == pytest.approx(np.hypot(0.1, 0.06), abs=5e-4)
    page = (tmp_path / 'out' / 'report.html').read_text()
    assert 'aria-label="Skin, unrolled"' in page and 'pairs of clouds, 0 left out' in page
    drawn = page[page.index('id="skin"') : page.index('The skin in three dimensions')]
    # Both dents in each of the three pictures.
    assert drawn.count('<polygon class="edge') == 6
    assert 'Signature' in drawn
    (tmp_path / 'cloud.ply').write_text('ply')
    words[1] = str(tmp_path / 'cloud.ply')
    assert main([*words, '--survey']) == 2
    assert 'is no bag' in capsys.readouterr().err


def test_what_a_bag_lacks_is_told_or_it_is_refused(tmp_path, skin, capsys):
    poses = list(skin.flight(3))
    no_skin = '3 of 3 clouds have no image of the skin'
    for name, stated, lacking, wanted in (
        ('poses', [None] * 3, {}, '3 of 3 clouds have no pose'),
        ('skin', poses, {'without': ('/skin',)}, no_skin),
        # One of another size is none of the cloud's.
        ('size', poses, {'rows': ROWS - 9}, no_skin),
    ):
        bag = record(tmp_path / name, skin, poses, stated, **lacking)
        assert main(['survey', str(bag), '--output', str(tmp_path / 'out')]) == 0
        remarks = json.loads((tmp_path / 'out' / 'survey.json').read_text())['remarks']
        assert any(wanted in text for text in remarks)
    bag = record(tmp_path / 'bare', skin, poses, [None] * 3, without=('/skin',))
    assert main(['survey', str(bag), '--output', str(tmp_path / 'out')]) == 2
    assert 'has neither poses nor images of the skin' in capsys.readouterr().err


@pytest.mark.parametrize('placed', ['both', 'near', 'none'])
def test_flights_that_share_no_skin_are_parts_wherever_they_lie(tmp_path, skin, placed):
    bags = []
    for number, (name, start) in enumerate((('near', 0.0), ('far', 0.9))):
        poses = list(skin.flight(2, start=start))
        said = erring(poses, number) if placed in ('both', name) else [None] * 2
        start_ns = START_NS + number * 1000 * SECOND
        bags.append(str(record(tmp_path / name, skin, poses, said, (), start_ns)))
    assert main(['survey', *bags, '--output', str(tmp_path / 'out')]) == 0
    frames = []
    for folder in ('out', 'out/part-2'):
        found = json.loads((tmp_path / folder / 'survey.json').read_text())
        assert 'not one skin but 2 parts' in found['remarks'][0]
        assert 'only the autopilot tells how these lie' in found['remarks'][0]
        frames.append(found['frame_id'])
    assert frames == [
        'survey' if placed == 'none' else 'map',
        'map' if placed == 'both' else 'survey',
    ]


def test_flights_that_nothing_ties_are_surveyed_each_by_itself(tmp_path, skin):
    """They show one skin, and their poses lie about where it is."""
    bags = []
    for number, off in enumerate(((0, 0, 0), (20.0, 0.3, 0))):
        poses = list(skin.flight(5 - number))
        said = [Pose(each.rotation, each.translation + off) for each in erring(poses, number)]
        start_ns = START_NS + number * 400 * 86_400 * SECOND
        bags.append(str(record(tmp_path / str(number), skin, poses, said, (), start_ns)))
    store = tmp_path / 'aircraft.sqlite'
    words = ['survey', *bags, '--output', str(tmp_path / 'out'), '--store', str(store)]
    assert main([*words, '--name', 'spring']) == 0
    for folder, clouds in (('out', 5), ('out/part-2', 4)):
        found = json.loads((tmp_path / folder / 'survey.json').read_text())
        assert len(found['poses']) == clouds
        depths = sorted(each['depth_mm'] for each in found['dents'])
        assert depths == pytest.approx([0.3, 0.5], rel=0.1)
        assert found['remarks'][0].startswith('the clouds are not one skin but 2 parts')
        assert found['remarks'][1].startswith('400 days are between')
    assert SurveyStore(store).names() == ('spring', 'spring, part 2')


def test_what_a_cloud_shows_that_only_its_pose_places_is_in_doubt(tmp_path, skin):
    """Its pose lies by 0.1 m, and without an image nothing tells."""
    poses = list(skin.flight(5))
    said = erring(poses, 1)
    said[2] = Pose(said[2].rotation, said[2].translation + np.array([0.1, 0.05, 0]))
    bag = record(tmp_path / 'flight', skin, poses, said, [('/skin', 2)])
    assert main(['survey', str(bag), '--output', str(tmp_path / 'out')]) == 0
    found = json.loads((tmp_path / 'out' / 'survey.json').read_text())
    sure = [each['depth_mm'] for each in found['dents'] if not each['reason']]
    assert sorted(sure) == pytest.approx([0.3, 0.5], rel=0.1)
    doubted = [each for each in found['dents'] if each['reason']]
    assert doubted and all('may be one of theirs' in each['reason'] for each in doubted)
    assert found['remarks'][0].startswith('1 of 5 clouds are tied')
    assert found['coverage']['gaps'] == []


def test_clouds_without_a_pose_are_used_and_counted(tmp_path, skin):
    poses = list(skin.flight(5))
    said = [pose if k % 2 else None for k, pose in enumerate(erring(poses, 2))]
    bag = record(tmp_path / 'flight', skin, poses, said)
    assert main(['survey', str(bag), '--output', str(tmp_path / 'out')]) == 0
    found = json.loads((tmp_path / 'out' / 'survey.json').read_text())
    assert len(found['poses']) == 5 and len(found['dents']) == 2
    area = (4 * 0.05 + COLUMNS * SPACING) * ROWS * SPACING
    assert found['coverage']['area_m2'] == pytest.approx(area, rel=0.06)
    assert found['remarks'][0].startswith('3 of 5 clouds have no pose')
    assert found['frame_id'] == 'map' and not (tmp_path / 'out' / 'part-2').exists()


def test_a_lap_is_one_step_as_long_as_it_was_seen(tmp_path):
    lapped = FlownSkin(35, dents=((0.1, -0.05, 0.03, 3e-4),), lap=(0.0, 1.2e-3))
    poses = [pose for _ in range(2) for pose in lapped.flight(6, y=-0.04)]
    bag = record(tmp_path / 'flight', lapped, poses, poses, covariance=STATED / 1e4)
    assert main(['survey', str(bag), '--output', str(tmp_path / 'out')]) == 0
    found = json.loads((tmp_path / 'out' / 'survey.json').read_text())['dents']
    (step,) = (each for each in found if each['kind'] == 'step')
    assert step['depth_mm'] == pytest.approx(1.2, abs=0.02)
    assert step['length_mm'] == pytest.approx(1e3 * (5 * 0.05 + COLUMNS * SPACING), abs=15)


def test_a_bag_of_another_rig_is_refused(tmp_path, skin, capsys):
    (pose,) = skin.flight(1)
    bags = [
        str(record(tmp_path / rig, skin, [pose], [pose], (), START_NS + number * SECOND, rig))
        for number, rig in enumerate(('one', 'other'))
    ]
    assert main(['survey', *bags, '--output', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert 'was measured by the rig other' in said and 'is of the rig one' in said
    words = ['survey', bags[0], '--rig', 'shipped:rig.yaml', '--output', str(tmp_path / 'out')]
    assert main(words) == 2
    assert 'was measured by the rig one' in capsys.readouterr().err
    assert main(['survey', bags[0], '--output', str(tmp_path / 'out')]) == 0
    assert json.loads((tmp_path / 'out' / 'survey.json').read_text())['rig'] == 'one'


def test_a_gap_between_passes_is_found_and_no_cell_too_many():
    down = Rotation.from_euler('x', np.pi)
    poses = [Pose(down, np.array([0.0, y, 0.8])) for y in (-0.12, 0.12)]
    flat, mosaic = FlownSkin(3), flat_mosaic()
    for number, pose in enumerate(poses):
        mosaic.add(flat.seen(pose, number), pose, None)
    (gap,), _ = mosaic.gaps()
    assert gap.size[1] == pytest.approx(0.02, abs=0.0101)
    assert abs(gap.place[1]) < 0.01
    assert mosaic.area == pytest.approx(2 * COLUMNS * ROWS * SPACING**2, rel=0.03)


def test_gaps_are_of_any_size_and_notches_in_the_rim_are_none():
    measured = np.zeros((90, 200), bool)
    measured[5:45, 5:195] = measured[65:85, 5:195] = True
    measured[20:23, 50:90] = measured[70, 100] = False
    # Of the rim.
    measured[5:8, 20:30] = measured[80:85, 120:140] = measured[5, 60] = False
    gaps, mask = find_gaps(measured, np.array([1.0, 2.0]))
    sizes = [gap.size.tolist() for gap in gaps]
    assert sizes == [pytest.approx(size) for size in ((1.9, 0.2), (0.4, 0.03), (0.01, 0.01))]
    np.testing.assert_allclose(gaps[0].place, [2.0, 2.55])
    assert mask.sum() == 190 * 20 + 40 * 3 + 1


def flat_mosaic():
    plane = Unrolled(np.zeros(3), *np.eye(3)[[0, 1, 2]], 1e6)
    return Mosaic(plane, np.array([-0.3, -0.4]), np.array([0.3, 0.4]))


def test_the_deviation_is_blank_on_a_step_and_where_clouds_contradict_each_other():
    pose = Pose(Rotation.from_euler('x', np.pi), np.array([0.0, 0.0, 0.8]))
    cloud, mosaic = FlownSkin(3).seen(pose, 1), flat_mosaic()
    for off in (0.0, 1e-4):
        deviation = np.full(cloud.points.shape[:2], 1e-5, np.float32)
        deviation[:, 100:] += off
        known = np.full_like(deviation, 1e-4)
        step = make_dent((-0.08, 0, 0.8), length=0.1, width=0.01, kind='step')
        mosaic.add(cloud, pose, Inspection((), (step,), (), deviation, known, known))
    shown = mosaic.deviation[mosaic.views > 0]
    np.testing.assert_allclose(shown[np.isfinite(shown)], 1e-5, rtol=1e-3)
    # Of the 170 columns of points.
    assert np.isfinite(shown).mean() == pytest.approx(100 / 170, abs=0.03)
    u, v = ((np.array([-0.08, 0.0]) - mosaic.low) / mosaic.pitch).astype(int)
    assert np.isnan(mosaic.deviation[v, u]) and np.isfinite(mosaic.deviation[v + 10, u])


@pytest.mark.parametrize('turn', [(0, 0, 0), (0.5 * np.pi, 0, 2.0), (0.1, 0.2, 4.0)])
@pytest.mark.parametrize(
    ('radius', 'taper', 'half'),
    [(1.9, 0.0, 1.5), (-1.5, 0.0, 0.3), (1.9, 0.12, 0.8), (1.9, 0.0, 0.11), (1e6, 0.0, 0.4)],
)
def test_lengths_on_the_map_are_those_on_the_skin(radius, taper, half, turn):
    """Of cylinders, a cone and a plane, whatever way they lie; with dents in them."""
    rng, pose = np.random.default_rng(3), Pose.from_rpy(turn, (5.0, -3.0, 1.0))
    true = Unrolled(np.zeros(3), *np.eye(3), radius, taper)
    flat = rng.uniform((-0.8, -half), (0.8, half), (3000, 2))
    height = 5e-6 * rng.normal(size=3000) - 2e-3 * (np.hypot(*(flat - 0.1).T) < 0.05)
    points = true.points(flat, height)
    np.testing.assert_allclose(true.place(points), np.column_stack([flat, height]), atol=1e-5)
    normals = true.points(flat, 1.0) - true.points(flat)
    skin = Unrolled.through(pose.apply(points), pose.rotation.apply(normals))
    place = skin.place(pose.apply(true.points(flat)))[:, :2]
    pairs = rng.integers(0, 3000, (5000, 2))
    on_skin, on_map = (
        np.linalg.norm(np.diff(each[pairs], axis=1)[:, 0], axis=-1) for each in (flat, place)
    )
    near = on_skin < 1
    assert np.abs(on_map - on_skin)[near].max() < 5e-4
    assert np.abs(skin.place(pose.apply(true.points(flat)))[:, 2]).max() < 1e-3
    # Seen from outside, and y is up as far as the skin stands.
    assert np.cross(skin.axis, skin.around) @ skin.normal == pytest.approx(1)
    assert skin.around[2] > -1e-6 or abs(skin.around[2]) < 0.1 * abs(skin.axis[2])
