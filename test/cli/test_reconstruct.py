import os
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.cloud.ply import read_ply
from ftp_dent_ros.pattern.file import read_pattern, write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig, write_rig
from ftp_dent_ros.simulation import Panel, Photometry, Renderer, Surface

PATTERN = Pattern(320, 240, 8.0, 160.0)
SKIN = Surface((Panel(Pose.from_rpy((0, 0.05, 0), (0, 0, 0.65)), (-0.09, 0.09, -0.09, 0.09)),))


def lens(focal):
    return Lens(320, 240, np.array([[focal, 0, 160.0], [0, focal, 119], [0, 0, 1]]), np.zeros(5))


@pytest.fixture(scope='module')
def photograph():
    turn = Rotation.from_euler('y', 0.3).as_matrix()
    rig = Rig(lens(450.0), lens(470.0), turn, np.array([-0.2, 0.005, 0.03]))
    light = Photometry(reference_distance=0.65)
    return rig, Renderer(rig, PATTERN.draw(), light).render(SKIN)


@pytest.fixture
def folder(tmp_path, photograph):
    rig, image = photograph
    write_rig(tmp_path / 'rig.yaml', rig)
    write_pattern(tmp_path / 'pattern.yaml', PATTERN)
    write_image(tmp_path / 'image.png', image)
    return tmp_path


def write_image(path, rgb):
    assert cv2.imwrite(str(path), rgb[..., ::-1] if rgb.ndim == 3 else rgb)


def words(folder, image='image.png', output='cloud.ply', rig='rig.yaml', pattern='pattern.yaml'):
    return [
        'reconstruct',
        str(folder / image),
        *('--rig', str(folder / rig)),
        *('--pattern', str(folder / pattern)),
        *('--output', str(folder / output)),
    ]


def run(*arguments):
    command = [sys.executable, '-m', 'ftp_dent_ros.cli.main', *arguments]
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1'}
    return subprocess.run(command, capture_output=True, text=True, env=environment)


def refused(folder, capfd, *options, **names):
    """The one line on stderr with which the command refuses what it is given."""
    before = sorted(folder.rglob('*'))
    assert main([*words(folder, **names), *options]) == 2
    said = capfd.readouterr()
    assert said.out == ''
    assert said.err.startswith('ftp-dent reconstruct: ')
    assert said.err.count('\n') == 1
    assert sorted(folder.rglob('*')) == before
    return said.err


def test_a_photograph_becomes_a_cloud(folder):
    done = run(*words(folder))
    assert (done.returncode, done.stderr) == (0, '')
    cloud, frame_id, _ = read_ply(folder / 'cloud.ply')
    assert frame_id == 'camera_optical_frame'
    off = np.abs(SKIN.distance(cloud.points[cloud.valid]))
    assert off.mean() < 1e-4
    first, second, third, fourth, fifth = done.stdout.splitlines()
    assert first.startswith(f'{folder}/cloud.ply: {cloud.valid.sum()} points, ')
    assert second.startswith('depth 0.65')
    assert third.startswith('standard uncertainty 0.0')
    assert fourth.endswith('of the lit area has points') and float(fourth.split('%')[0]) > 95
    assert fifth.endswith('could not be checked'), 'no rim of the frame is in view'
    assert not list(folder.glob('.*'))


def test_the_options_reach_the_reconstruction(folder, photograph, capsys):
    options = '--method direct --unwrapping estrada --tau 0.7 --stride 2'
    assert main([*words(folder), *options.split()]) == 0
    cloud, *_ = read_ply(folder / 'cloud.ply')
    rig, pattern = read_rig(folder / 'rig.yaml'), read_pattern(folder / 'pattern.yaml')
    expected = Reconstructor(rig, pattern, Settings('direct', 'estrada', 0.7, 2))
    np.testing.assert_array_equal(
        cloud.points, expected.reconstruct(np.ascontiguousarray(photograph[1])).points
    )
    assert cloud.points.shape == (120, 160, 3)


GREY = np.full((240, 320, 3), 90, np.uint8)


@pytest.mark.parametrize(
    ('pixels', 'said'),
    [
        (0 * GREY, 'no part of the image shows fringes'),
        (0 * GREY + 255, 'clipped'),
        (GREY[..., 0], 'is grey, and the stripe that numbers the fringes is red'),
        (GREY[:100], "320x100, the rig's camera 320x240"),
    ],
    ids=['black', 'white', 'grey', 'cropped'],
)
def test_bad_photographs_are_refused(folder, capfd, pixels, said):
    write_image(folder / 'bad.png', pixels)
    assert said in refused(folder, capfd, image='bad.png')


def raw(rgb):
    mosaic = rgb[..., 1].copy()
    mosaic[::2, ::2], mosaic[1::2, 1::2] = rgb[::2, ::2, 0], rgb[1::2, 1::2, 2]
    return mosaic.astype(np.uint16) << 4


@pytest.mark.parametrize(
    ('of', 'suffix', 'options', 'said'),
    [
        (lambda rgb: rgb.astype(np.uint16) * 257, '.png', [], 'rgb16 (tell by --encoding'),
        (raw, '.tif', ['--encoding', 'bayer_rggb12'], 'bayer_rggb12 (as given)'),
        (lambda rgb: raw(rgb) << 4, '.png', ['--encoding', 'bayer_rggb16'], 'bayer_rggb16 (as'),
        (lambda rgb: raw(rgb) >> 4, '.png', ['--encoding', 'bayer_rggb8'], 'bayer_rggb8 (as'),
    ],
)
def test_other_photographs_are_taken_for_what_they_are(
    folder, photograph, capfd, of, suffix, options, said
):
    pixels = of(photograph[1])
    name = f'other{suffix}'
    write_image(folder / name, pixels if pixels.max() > 255 else pixels.astype(np.uint8))
    assert main([*words(folder, image=name), *options]) == 0
    assert f'{name}: taken for {said}' in capfd.readouterr().out
    cloud, *_ = read_ply(folder / 'cloud.ply')
    assert np.abs(SKIN.distance(cloud.points[cloud.valid])).mean() < 5e-4


@pytest.mark.parametrize(
    ('pixels', 'encoding', 'said'),
    [
        (GREY, 'bayer_rggb8', 'three levels of 8 bits a pixel, which is not bayer_rggb8'),
        (GREY[..., 0], 'bayer_rggb12', 'one level of 8 bits a pixel, which is not bayer_rggb12'),
        (GREY[..., 0], 'yuv', "the encoding is 'yuv': give mono, rgb or bayer_"),
        (GREY[..., 0].astype(np.uint16) * 50, 'bayer_rggb12', 'level 4500, more than 12 bits'),
    ],
)
def test_an_encoding_that_the_file_cannot_have_is_refused(folder, capfd, pixels, encoding, said):
    write_image(folder / 'bad.png', pixels)
    assert said in refused(folder, capfd, '--encoding', encoding, image='bad.png')


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('none.png', 'cannot be read (No such file'),
        ('rig.yaml', 'not a photograph'),
        ('text.png', 'not an image'),
        ('folder.png', 'cannot be read (Is a directory)'),
    ],
)
def test_what_is_no_photograph_is_refused(folder, capfd, name, said):
    (folder / 'text.png').write_text('fringes')
    (folder / 'folder.png').mkdir()
    assert said in refused(folder, capfd, image=name)


def test_a_pattern_that_does_not_fit_is_refused(folder, capfd):
    for changes, said in (
        ({'width': 640}, 'the pattern is 640x240, the projector 320x240'),
        ({'axis': 'v'}, 'use a pattern with the axis u'),
    ):
        write_pattern(folder / 'bad.yaml', replace(PATTERN, **changes))
        assert said in refused(folder, capfd, pattern='bad.yaml')
        (folder / 'bad.yaml').unlink()


@pytest.mark.parametrize('name', ['rig', 'pattern'])
def test_files_that_are_no_calibration_are_refused(folder, capfd, name):
    assert 'no such file' in refused(folder, capfd, **{name: 'none.yaml'})
    (folder / 'torn.yaml').write_text('camera: [1, 2\n')
    assert 'not valid YAML in line' in refused(folder, capfd, **{name: 'torn.yaml'})


def test_an_output_that_cannot_be_written_is_refused(folder, capfd):
    assert 'ends in .ply' in refused(folder, capfd, output='cloud.xyz')
    assert 'cannot be written' in refused(folder, capfd, output='image.png/cloud.ply')


def test_options_out_of_range_are_refused(folder, capfd):
    assert 'tau is 0.0' in refused(folder, capfd, '--tau', '0')
    assert 'stride is' in refused(folder, capfd, '--stride', '17')


def test_the_skin_is_written_beside_the_cloud(folder, photograph):
    rig, image = photograph
    assert main([*words(folder), '--skin', str(folder / 'skin.png')]) == 0
    written = cv2.imread(str(folder / 'skin.png'), cv2.IMREAD_UNCHANGED)
    expected = Reconstructor(rig, PATTERN).measure(image, skin=True).cloud.skin
    np.testing.assert_array_equal(written, expected)


def test_a_photograph_without_a_point_is_refused_and_nothing_is_written(
    folder, capfd, monkeypatch
):
    measure = Reconstructor.measure

    def measure_nothing(self, *given):
        measurement = measure(self, *given)
        nothing = np.full_like(measurement.cloud.points, np.nan)
        return replace(measurement, cloud=replace(measurement.cloud, points=nothing))

    monkeypatch.setattr(Reconstructor, 'measure', measure_nothing)
    assert 'gives no point' in refused(folder, capfd)
