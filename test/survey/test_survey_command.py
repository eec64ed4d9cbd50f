"""``ftp-dent survey`` on bags of flown skins."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from bag_samples import SECOND
from flown_skin import COLUMNS, ROWS, SPACING, FlownSkin, erring
from flown_surveys import START_NS, record
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.store import SurveyStore
from ftp_dent_ros.survey.unrolled import Unrolled


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
def test_flights_that_share_no_skin_lie_where_the_autopilot_says_or_are_refused(
    tmp_path, skin, capsys, placed
):
    bags = []
    for number, (name, start) in enumerate((('near', 0.0), ('far', 0.9))):
        poses = list(skin.flight(2, start=start))
        said = erring(poses, number) if placed in ('both', name) else [None] * 2
        start_ns = START_NS + number * 1000 * SECOND
        bags.append(str(record(tmp_path / name, skin, poses, said, (), start_ns)))
    status = main(['survey', *bags, '--output', str(tmp_path / 'out')])
    if placed == 'both':
        remarks = ' '.join(json.loads((tmp_path / 'out/survey.json').read_text())['remarks'])
        assert status == 0 and 'not one skin but 2 parts' in remarks
        assert 'only the autopilot tells how these lie' in remarks
        return
    assert status == 2 and 'far: has no poses, and shares no skin' in capsys.readouterr().err
    assert main(['survey', bags[1], '--output', str(tmp_path / 'out')]) == 0


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


def test_a_gap_between_passes_is_found_and_no_cell_too_many(skin):
    down = Rotation.from_euler('x', np.pi)
    poses = [Pose(down, np.array([0.0, y, 0.8])) for y in (-0.12, 0.12)]
    flat = FlownSkin(3)
    mosaic = Mosaic(
        Unrolled(np.zeros(3), *np.eye(3)[[0, 1, 2]], 1e6),
        np.array([-0.3, -0.4]),
        np.array([0.3, 0.4]),
    )
    for number, pose in enumerate(poses):
        mosaic.add(flat.seen(pose, number), pose, None)
    (gap,), _ = mosaic.gaps()
    assert gap.size[1] == pytest.approx(0.02, abs=0.0101)
    assert abs(gap.place[1]) < 0.01
    area = mosaic.measured().sum() * 1e-4
    assert area == pytest.approx(2 * COLUMNS * ROWS * SPACING**2, rel=0.03)


@pytest.mark.parametrize('radius', [1.0, -1.5, 1e9])
def test_unrolled_lengths_are_those_on_the_skin(radius):
    x, around = np.meshgrid(np.linspace(0, 2, 11), np.linspace(-0.2, 0.2, 21))
    angle = around / radius
    normals = np.stack([0 * x, np.sin(angle), np.cos(angle)], axis=-1).reshape(-1, 3)
    points = radius * (normals - [0, 0, 1]) + np.stack([x, 0 * x, 0 * x], axis=-1).reshape(-1, 3)
    skin = Unrolled.through(points, normals)
    place = skin.place(points).reshape(21, 11, 3)
    assert abs(place[-1, 0, 1] - place[0, 0, 1]) == pytest.approx(0.4, rel=0.02)
    assert np.ptp(place[..., 2]) < 5e-3
