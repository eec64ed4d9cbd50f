"""The report's files; how the page looks is for eyes."""

import csv
import errno
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dent_samples import TrueInspector

from ftp_dent_ros import __version__
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.seen import SeenCloud
from ftp_dent_ros.dents.dent import Inspection
from ftp_dent_ros.dents.rules import Limit, Rules
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.inspecting import CloudInspector
from ftp_dent_ros.inspection.page import (
    on_grid,
    on_photograph,
    write_report,
)
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.simulation import Panel, Surface
from ftp_dent_ros.simulation.dents import Dent

CAMERA = Lens(160, 120, np.array([[200.0, 0, 79.5], [0, 200, 59.5], [0, 0, 1]]), np.zeros(5))
DENTS = (Dent(0.0, 0.0, 0.08, 0.06, 0.002), Dent(0.13, 0.05, 0.05, 0.04, 0.001))
SKIN = Surface(
    (Panel(Pose.from_rpy((0, 0.05, 0), (0, 0, 0.6)), (-1, 1, -1, 1), 2.0, dents=DENTS),)
)
RULES = Rules('Limits <of> mine', 'book 1', (Limit('depth_mm', maximum=1.5, reference='p. 3'),))


def cloud_of(surface, stride=1):
    rays = CAMERA.rays(CAMERA.pixel_grid(stride))
    points = (rays * surface.intersect(rays)[..., None]).astype(np.float32)
    return Cloud(points, np.ones(points.shape[:2], np.float32))


def survey(surface=SKIN, frames=1, **captured):
    clouds = CloudInspector(TrueInspector(surface), frames)
    photograph = np.full((120, 160, 3), 90, np.uint8)
    for number in range(frames):
        clouds.add(
            SeenCloud(f'cloud {number}', cloud_of(surface), photograph=photograph, **captured)
        )
    return clouds


@pytest.fixture(scope='module')
def report():
    return survey().report('a <photo>.png', ('rig.yaml', 'abc'), CAMERA)


def test_the_data_hold_what_an_inspector_asks_for(tmp_path, report):
    write_report(tmp_path, replace(report, rules=RULES))
    data = json.loads((tmp_path / 'dents.json').read_text())
    first, second = data['dents']
    assert first['depth_mm'] == pytest.approx(2.0, rel=1e-3)
    assert second['depth_mm'] == pytest.approx(1.0, rel=5e-3)
    assert first['depth_uncertainty_mm'] == pytest.approx(0.01)
    assert first['length_mm'] == pytest.approx(80 * 0.835, rel=1e-3)
    assert first['width_to_depth'] == pytest.approx(60 * 0.835 / 2, rel=5e-3)
    assert (first['verdict'], second['verdict']) == ('exceeds', 'within')
    assert [first[axis] for axis in 'xyz'] == pytest.approx([0, 0, 0.6], abs=1e-6)
    assert first['limits'][0]['reference'] == 'p. 3'
    for name in ('width', 'orientation', 'area', 'volume', 'model_length', 'clearance'):
        assert any(key.startswith(f'{name}_uncertainty') for key in first), name
    assert data['frame_id'] == 'camera_optical_frame'
    assert data['rig'] == {'file': 'rig.yaml', 'id': 'abc'}
    assert data['software'] == f'ftp_dent_ros {__version__}'
    assert re.fullmatch(r'20\d\d-.*Z', data['written'])
    rows = list(csv.DictReader(io.StringIO((tmp_path / 'dents.csv').read_text())))
    assert [float(row['depth_mm']) for row in rows] == [d['depth_mm'] for d in data['dents']]
    assert not list(tmp_path.glob('.*')), 'nothing is left beside the files'


def test_the_page_needs_nothing_but_itself(tmp_path, report):
    page = write_report(tmp_path, replace(report, rules=RULES)).read_text()
    assert all(re.match('data:|#', link) for link in re.findall(r'(?:src|href)="([^"]*)', page))
    assert 'http' not in re.sub(r'data:[^"]*', '', page)
    assert all(f'<{tag}' in page for tag in ('canvas', 'table', 'polygon', 'image'))
    assert 'a &lt;photo&gt;.png' in page and 'Limits &lt;of&gt; mine' in page
    assert '2 dents found' in page and 'rig.yaml, id abc' in page
    assert 'none: positions are relative to the camera' in page


def test_a_report_without_dents_says_so(tmp_path):
    flat = Surface((replace(SKIN.panels[0], dents=()),))
    page = write_report(tmp_path, survey(flat).report('x'))
    text = page.read_text()
    assert 'No dents found' in text and 'dents of 0.1 mm depth and 10 mm width' in text
    assert json.loads((tmp_path / 'dents.json').read_text())['dents'] == []
    header = (tmp_path / 'dents.csv').read_text().splitlines()
    assert len(header) == 1
    write_report(tmp_path / 'other', survey().report('x'))
    assert (tmp_path / 'other/dents.csv').read_text().splitlines()[0] == header[0]


def test_a_cloud_with_nothing_measured_is_still_a_report(tmp_path):
    nothing = np.full((20, 30), np.nan, np.float32)

    def inspect(cloud, **_):
        return Inspection((), (), (), nothing, nothing, nothing)

    clouds = CloudInspector(inspect)
    empty = Cloud(np.full((20, 30, 3), np.nan, np.float32), np.zeros((20, 30), np.float32))
    clouds.add(SeenCloud('empty', empty))
    report = clouds.report('x')
    assert len(report.frames) == 1 and report.refused == ()
    assert 'No dents' in write_report(tmp_path, report).read_text()


def test_many_clouds_show_the_maps_of_those_alone_that_show_a_dent_best(tmp_path):
    pose = Pose.from_rpy((0, 0, 0), (1, 2, 3))
    covariance = np.diag([1e-4] * 3 + [1e-6] * 3)
    clouds = survey(frames=4, pose=pose, vehicle=pose, covariance=covariance)
    report = clouds.report('flight', camera=CAMERA)
    assert [len(entry.sightings) for entry in report.dents] == [4, 4]
    assert sum(frame.view is not None for frame in report.frames) == 1
    np.testing.assert_allclose(report.dents[0].dent.position, [1, 2, 3.6], atol=1e-6)
    page = write_report(tmp_path, report).read_text()
    assert page.count('Photograph with the dents drawn in') == 1
    assert 'within ± 20 mm' in page
    frames = json.loads((tmp_path / 'dents.json').read_text())['frames']
    assert [frame['pose']['position'] for frame in frames] == [[1, 2, 3]] * 4
    assert frames[0]['pose']['covariance'][0] == 1e-4


@pytest.mark.parametrize('stride', [1, 2])
def test_outlines_are_drawn_where_the_camera_sees_them(stride):
    clouds = CloudInspector(TrueInspector(SKIN))
    pose = Pose.from_rpy((0.3, -0.2, 1.0), (5, 6, 7))
    photograph = np.zeros((120, 160, 3), np.uint8)
    clouds.add(SeenCloud('x', cloud_of(SKIN, stride), pose=pose, photograph=photograph))
    report = clouds.report('x')
    view = report.frames[0].view
    outline = report.dents[0].dent.outline
    place = on_grid(outline, view)
    true = CAMERA.project(pose.inverse().apply(outline))
    np.testing.assert_allclose(on_photograph(outline, place, view, CAMERA), true, atol=1e-6)
    # Without a rig the cloud's grid tells, but for the depth of the dent.
    np.testing.assert_allclose(on_photograph(outline, place, view, None), true, atol=0.5)
    np.testing.assert_allclose(place * stride, true, atol=0.5)


def test_a_full_disk_leaves_no_file_of_a_report(tmp_path, report, monkeypatch):
    write = Path.write_text

    def full(path, text, *args, **options):
        if path.suffix == '.html':
            write(path, text[:100])
            raise OSError(errno.ENOSPC, 'No space left on device')
        return write(path, text, *args, **options)

    monkeypatch.setattr(Path, 'write_text', full)
    with pytest.raises(ConfigurationError, match='the report cannot be written'):
        write_report(tmp_path / 'out', report)
    assert list((tmp_path / 'out').iterdir()) == []
