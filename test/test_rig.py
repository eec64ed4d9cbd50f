import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.files import find
from ftp_dent_ros.rig.calibration_record import CalibrationRecord
from ftp_dent_ros.rig.rig import Lens, read_rig, write_rig

RIG = read_rig(find('shipped:rig.yaml'))
# Stronger than that of the shipped one.
LENS = replace(RIG.camera, distortion=np.array([-0.2, 0.08, 1e-3, -2e-3, 0.01]))


def test_projects_like_opencv():
    points = np.random.default_rng(1).uniform((-0.3, -0.2, 0.5), (0.3, 0.2, 1.5), (200, 3))
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), LENS.camera_matrix, LENS.distortion
    )
    np.testing.assert_allclose(LENS.project(points), expected[:, 0], atol=1e-9)


def test_rays_invert_project_to_the_corners():
    pixels = LENS.pixel_grid(stride=13)
    rays = LENS.rays(pixels)
    assert rays.shape == (56, 99, 3)
    assert np.all(rays[..., 2] == 1)
    np.testing.assert_allclose(LENS.project(rays), pixels, atol=1e-9)


def test_write_then_read_gives_the_same_bits_and_the_response(tmp_path):
    curve = np.linspace(0, 1, 17) ** 2.2
    for rig in (RIG, replace(RIG, camera=LENS, response=curve)):
        write_rig(tmp_path / 'again.yaml', rig)
        again = read_rig(tmp_path / 'again.yaml')
        assert again.id == rig.id
        for name in ('rotation', 'translation', 'response'):
            np.testing.assert_array_equal(getattr(again, name), getattr(rig, name))
        for ours, theirs in ((again.camera, rig.camera), (again.projector, rig.projector)):
            assert (ours.width, ours.height) == (theirs.width, theirs.height)
            assert np.array_equal(ours.camera_matrix, theirs.camera_matrix)
            assert np.array_equal(ours.distortion, theirs.distortion)
    assert [file.name for file in tmp_path.iterdir()] == ['again.yaml']


TURN = ('extrinsics', 'rotation', 'data')
MATRIX = ('camera', 'camera_matrix', 'data')
RESPONSE = ('camera', 'response')


@pytest.mark.parametrize(
    ('keys', 'value', 'said'),
    [
        (TURN, [1, 0, 0, 0, 1, 0, 0, 0, 1.01], 'not a rotation'),
        (TURN, [1, 0, 0, 0, 1, 0, 0, 0, -1], 'not a rotation'),
        (TURN, [1, 0, 0, 0, 1, 0, 0, 0, math.nan], 'finite'),
        (('extrinsics', 'translation'), [0.0, 0.0, 0.0], 'baseline'),
        (MATRIX, [0.0] * 9, 'focal'),
        (MATRIX, [900, 5, 320, 0, 900, 240, 0, 0, 1], 'f_x, 0, c_x'),
        (('camera', 'camera_matrix', 'rows'), 2, 'rows: 3'),
        (('camera', 'distortion_model'), 'equidistant', 'only plumb_bob'),
        (('camera', 'distortion_coefficients', 'data'), [-3.0, 0, 0, 0, 0], 'fold'),
        (RESPONSE, 2.2, r'camera\.response is 2\.2: give a list of finite numbers'),
        (RESPONSE, [0.0], r'camera\.response does not rise from 0 to 1'),
        (RESPONSE, [0.0, 0.6, 0.5, 1.0], r'camera\.response does not rise from 0 to 1'),
        (RESPONSE, [0.0, 255.0], r'camera\.response does not rise from 0 to 1'),
    ],
)
def test_impossible_values_are_refused(tmp_path, keys, value, said):
    path = tmp_path / 'rig.yaml'
    data = block = yaml.safe_load(find('shipped:rig.yaml').read_text())
    for key in keys[:-1]:
        block = block[key]
    block[keys[-1]] = value
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(RigError, match=said):
        read_rig(path)


def test_a_record_goes_with_its_numbers(tmp_path):
    assert RIG.record is None
    covariance = np.diag(np.arange(24) * 1e-6)
    record = CalibrationRecord(
        RIG.id,
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
    write_rig(path, replace(RIG, record=record))
    read = read_rig(path)
    assert read.id == RIG.id
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


def with_matrix(lens: Lens, **changed: float) -> Lens:
    places = {'f_x': (0, 0), 'f_y': (1, 1), 'c_x': (0, 2), 'c_y': (1, 2)}
    matrix = lens.camera_matrix.copy()
    for name, value in changed.items():
        matrix[places[name]] = value
    return replace(lens, camera_matrix=matrix)


def beside(centre, axis, degrees):
    """The shipped lenses, the projector at `centre` of the camera's frame and turned."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return replace(RIG, rotation=turn, translation=-turn @ np.array(centre))


@pytest.mark.parametrize(
    ('rig', 'words'),
    [
        (replace(RIG, translation=1e3 * RIG.translation), 'seems to be in millimetres'),
        (replace(RIG, translation=1e-3 * RIG.translation), 'baseline of 0.000247'),
        (replace(RIG, camera=with_matrix(RIG.camera, f_x=8.0, f_y=8.0)), 'in pixels'),
        (replace(RIG, projector=with_matrix(RIG.projector, f_x=1e6)), 'in pixels'),
        (replace(RIG, camera=with_matrix(RIG.camera, f_y=500.0)), 'far from each'),
        (replace(RIG, camera=with_matrix(RIG.camera, c_x=-9e3)), 'principal point'),
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
