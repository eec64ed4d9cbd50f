import copy
import dataclasses
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.files import config_folder, find
from ftp_dent_ros.rig.calibration_record import CalibrationRecord
from ftp_dent_ros.rig.rig import Lens, read_rig, write_rig


def lens_fields(width, height, focal, distortion=(0.0, 0.0, 0.0, 0.0, 0.0)):
    matrix = [focal, 0.0, width / 2, 0.0, focal + 3.0, height / 2, 0.0, 0.0, 1.0]
    return {
        'image_width': width,
        'image_height': height,
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': matrix},
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': {'rows': 1, 'cols': 5, 'data': list(distortion)},
    }


def rig_fields():
    angle = 0.3
    c, s = math.cos(angle), math.sin(angle)
    return {
        'camera': lens_fields(640, 480, 900.0, (-0.2, 0.08, 1e-3, -2e-3, 0.01)),
        'projector': lens_fields(640, 360, 1000.0),
        'extrinsics': {
            'rotation': {'rows': 3, 'cols': 3, 'data': [c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c]},
            'translation': [-0.2, 0.01, 0.05],
        },
    }


@pytest.fixture
def path(tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text(yaml.safe_dump(rig_fields()))
    return path


def test_projects_like_opencv(path):
    lens = read_rig(path).camera
    points = np.random.default_rng(1).uniform((-0.3, -0.2, 0.5), (0.3, 0.2, 1.5), (200, 3))
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), lens.camera_matrix, lens.distortion
    )
    np.testing.assert_allclose(lens.project(points), expected[:, 0], atol=1e-9)


def test_rays_invert_project_to_the_corners(path):
    lens = read_rig(path).camera
    pixels = lens.pixel_grid(stride=13)
    rays = lens.rays(pixels)
    assert rays.shape == (37, 50, 3)
    assert np.all(rays[..., 2] == 1)
    np.testing.assert_allclose(lens.project(rays), pixels, atol=1e-9)


def test_write_then_read_gives_the_same_bits(path, tmp_path):
    rig = read_rig(path)
    write_rig(tmp_path / 'again.yaml', rig)
    again = read_rig(tmp_path / 'again.yaml')
    for name in ('rotation', 'translation'):
        assert np.array_equal(getattr(again, name), getattr(rig, name))
    for ours, theirs in ((again.camera, rig.camera), (again.projector, rig.projector)):
        assert (ours.width, ours.height) == (theirs.width, theirs.height)
        assert np.array_equal(ours.camera_matrix, theirs.camera_matrix)
        assert np.array_equal(ours.distortion, theirs.distortion)
    assert [file.name for file in tmp_path.iterdir()].count('again.yaml') == 1
    assert not list(tmp_path.glob('.again*'))


def changed(keys, value):
    data = copy.deepcopy(rig_fields())
    block = data
    for key in keys[:-1]:
        block = block[key]
    if value is None:
        del block[keys[-1]]
    else:
        block[keys[-1]] = value
    return data


@pytest.mark.parametrize(
    ('keys', 'value', 'said'),
    [
        (('extrinsics', 'rotation', 'data'), [1, 0, 0, 0, 1, 0, 0, 0, 1.01], 'not a rotation'),
        (('extrinsics', 'rotation', 'data'), [1, 0, 0, 0, 1, 0, 0, 0, -1], 'not a rotation'),
        (('extrinsics', 'rotation', 'data'), [1, 0, 0, 0, 1, 0, 0, 0, math.nan], 'finite'),
        (('extrinsics', 'translation'), [0.0, 0.0, 0.0], 'baseline'),
        (('camera', 'camera_matrix', 'data'), [0.0] * 9, 'focal'),
        (('camera', 'camera_matrix', 'data'), [900, 5, 320, 0, 900, 240, 0, 0, 1], 'f_x, 0, c_x'),
        (('camera', 'camera_matrix', 'rows'), 2, 'rows: 3'),
        (('camera', 'distortion_model'), 'equidistant', 'only plumb_bob'),
        (('camera', 'distortion_coefficients', 'data'), [-3.0, 0, 0, 0, 0], 'fold'),
    ],
)
def test_impossible_values_are_refused(tmp_path, keys, value, said):
    path = tmp_path / 'rig.yaml'
    path.write_text(yaml.safe_dump(changed(keys, value)))
    with pytest.raises(RigError, match=said):
        read_rig(path)


def test_the_camera_s_response_is_read_and_kept(path, tmp_path):
    rig = read_rig(path)
    assert rig.response is None
    curve = np.linspace(0, 1, 17) ** 2.2
    write_rig(tmp_path / 'again.yaml', replace(rig, response=curve))
    again = read_rig(tmp_path / 'again.yaml')
    np.testing.assert_array_equal(again.response, curve)
    assert again.id == rig.id


@pytest.mark.parametrize(
    ('curve', 'said'),
    [
        (2.2, 'is 2.2: give a list of finite numbers'),
        ([0.0], 'does not rise from 0 to 1'),
        ([0.0, 0.6, 0.5, 1.0], 'does not rise from 0 to 1'),
        ([0.0, 255.0], 'does not rise from 0 to 1'),
    ],
)
def test_a_response_that_is_none_is_refused(tmp_path, curve, said):
    fields = rig_fields()
    fields['camera']['response'] = curve
    (tmp_path / 'rig.yaml').write_text(yaml.safe_dump(fields))
    with pytest.raises(RigError, match=rf'camera\.response {said}'):
        read_rig(tmp_path / 'rig.yaml')


def test_a_record_goes_with_its_numbers(tmp_path):
    rig = read_rig(config_folder() / 'rig.yaml')
    assert rig.record is None
    covariance = np.diag(np.arange(24) * 1e-6)
    record = CalibrationRecord(
        rig.id,
        '2026-01-02T03:04:05Z',
        'a tool',
        'a board',
        7,
        {'camera': 0.1},
        {},
        (0.5, 1.0),
        covariance,
    )
    path = tmp_path / 'rig.yaml'
    write_rig(path, replace(rig, record=record))
    read = read_rig(path)
    assert read.id == rig.id
    assert read.record.rms_px == {'camera': 0.1}
    np.testing.assert_allclose(read.record.covariance, covariance, rtol=1e-8)
    text = path.read_text()
    for before, after, words in (
        ('1702.4', '1702.5', 'were changed after the calibration'),
        ('poses: 7', 'poses: many', 'calibration.poses'),
        ('tool: a tool', 'tool: []', 'calibration.tool'),
        ('rms_px: {camera: 0.1}', 'rms_px: {lens: 0.1}', 'calibration.rms_px'),
        ('[camera.f_x', '[camera.f', 'calibration.covariance'),
    ):
        assert before in text
        path.write_text(text.replace(before, after, 1))
        with pytest.raises(RigError, match=words):
            read_rig(path)


RIG = read_rig(find('shipped:rig.yaml'))


def with_matrix(lens: Lens, **changed: float) -> Lens:
    places = {'f_x': (0, 0), 'f_y': (1, 1), 'c_x': (0, 2), 'c_y': (1, 2)}
    matrix = lens.camera_matrix.copy()
    for name, value in changed.items():
        matrix[places[name]] = value
    return dataclasses.replace(lens, camera_matrix=matrix)


def beside(centre, axis, degrees):
    """The shipped lenses, the projector at `centre` of the camera's frame and turned."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return dataclasses.replace(RIG, rotation=turn, translation=-turn @ np.array(centre))


@pytest.mark.parametrize(
    ('rig', 'words'),
    [
        (
            dataclasses.replace(RIG, translation=1e3 * RIG.translation),
            'seems to be in millimetres',
        ),
        (dataclasses.replace(RIG, translation=1e-3 * RIG.translation), 'baseline of 0.000247'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, f_x=8.0, f_y=8.0)), 'in pixels'),
        (dataclasses.replace(RIG, projector=with_matrix(RIG.projector, f_x=1e6)), 'in pixels'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, f_y=500.0)), 'focal lengths 1702'),
        (dataclasses.replace(RIG, camera=with_matrix(RIG.camera, c_x=-9e3)), 'principal point'),
        (beside((0.25, 0, 0), 'y', 180), 'turn the projector away'),
        (beside((0.25, 0, 0), 'y', -60), 'turn the projector away'),
        (beside((0, 0.02, 0.25), 'x', 4), 'behind or before the camera'),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, rig, words):
    write_rig(tmp_path / 'rig.yaml', rig)
    with pytest.raises(RigError, match=words) as caught:
        read_rig(tmp_path / 'rig.yaml')
    assert str(caught.value).startswith(f'{tmp_path}/rig.yaml: ')
