import re

import pytest

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.evaluation.page import claims, write_pages
from ftp_dent_ros.evaluation.study import Entry, Figures, Study, Trial, cases, steps

NONE = Trial(Figures(*[float('nan')] * 4, 0.0, float('nan')), None, None)


@pytest.fixture(scope='module')
def study():
    """A study whose figures tell row and method."""
    entries = []
    for case in cases(quick=True):
        for number, method in enumerate(case.methods):
            figures = Figures(1.0 / (1 + number), 0.1, 0.2, -0.3, 0.99, 0.123)
            entries.append(Entry(case, method, figures, 0, NONE, (9.876, 5.432)))
    return Study(True, entries)


def test_the_pages_hold_every_row_and_stand_alone(study, tmp_path):
    html, markdown = write_pages(tmp_path / 'evaluation', study)
    text = html.read_text()
    assert not re.search(r'(src|href)="(?!data:)', text)
    for words in ('9.876 (5.432)', 'least squares', 'A, dynamic', 'phase map', 'quick run'):
        assert words in text
    assert text.count('<img') == 6
    rows = markdown.read_text()
    assert rows.count('| least squares |') == 3 + 4 + 4 + 8 + 1
    assert all((tmp_path / 'evaluation' / name).exists() for name in re.findall(r'\w+\.png', rows))


def test_claims_are_held_against_what_came_out(study):
    outcomes = dict(claims(study))
    assert len(outcomes) == 5
    assert all(outcome for outcome in outcomes.values())
    assert any('so, by a factor of 2.00' in outcome for outcome in outcomes.values())


def test_steps_are_counted():
    assert steps(quick=True) == sum(case.seeds * len(case.methods) for case in cases(quick=True))
    assert steps(quick=False) > 3 * steps(quick=True)


def test_an_output_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert main(['evaluate', '--quick', '--output', str(tmp_path / 'file' / 'x')]) == 2
    assert 'name another folder' in capsys.readouterr().err
