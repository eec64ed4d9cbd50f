import cv2
import numpy as np
import pytest

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.pattern.file import read_pattern, write_pattern
from ftp_dent_ros.pattern.pattern import Pattern


@pytest.mark.parametrize(
    ('pattern', 'words'),
    [
        (Pattern(640, 360, 10.0, 320.0), 'the red one at 320'),
        (Pattern(640, 360, 10.0, 320.0, code='contrast'), 'falls by 5% every 46.5 px'),
        (Pattern(360, 640, 10.0, 320.0, 'v', code='contrast', row_depth=0.0), 'level fringes'),
    ],
)
def test_a_pattern_is_drawn_and_read_back(tmp_path, capsys, pattern, words):
    write_pattern(tmp_path / 'told.yaml', pattern)
    drawn = tmp_path / 'pattern.png'
    assert main(['pattern', str(tmp_path / 'told.yaml'), '--output', str(drawn)]) == 0
    assert words in capsys.readouterr().out
    np.testing.assert_array_equal(cv2.imread(str(drawn))[..., ::-1], pattern.draw())
    assert main(['pattern', str(drawn), '--output', str(tmp_path / 'read.yaml')]) == 0
    assert read_pattern(tmp_path / 'read.yaml').draw().tobytes() == pattern.draw().tobytes()


@pytest.mark.parametrize(
    ('given', 'output', 'words'),
    [
        ('shipped:pattern.yaml', 'pattern.jpg', 'ends in .png or .yaml'),
        ('empty.png', 'pattern.yaml', 'not an image'),
        ('grey.png', 'pattern.yaml', 'no straight fringes'),
        ('missing.png', 'pattern.yaml', 'missing.png'),
    ],
)
def test_what_is_no_pattern_is_refused_with_its_name(tmp_path, capsys, given, output, words):
    (tmp_path / 'empty.png').touch()
    cv2.imwrite(str(tmp_path / 'grey.png'), np.full((90, 160, 3), 127, np.uint8))
    path = given if ':' in given else str(tmp_path / given)
    assert main(['pattern', path, '--output', str(tmp_path / output)]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / output).exists()
