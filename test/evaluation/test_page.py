import re

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.evaluation.page import write_page
from ftp_dent_ros.evaluation.study import Entry, Figures, cases, steps


def test_the_page_holds_every_row_and_stands_alone(tmp_path):
    entries = []
    for case in cases(quick=True):
        for number, method in enumerate(case.methods):
            figures = Figures(1.0 / (1 + number), 0.1, 0.2, -0.3, 0.99, 0.123)
            entries.append(Entry(case, method, figures, 0, None))
    text = write_page(tmp_path, entries, True).read_text()
    assert not re.search(r'(src|href)="(?!data:)', text)
    for words in ('6.820 (7.174)', 'least squares', 'A, dynamic', 'phase map', 'quick run'):
        assert words in text
    assert text.count('<img') == 4
    assert text.count('class="ours"') == 2 + 4 + 4 + 8


def test_steps_are_counted():
    assert steps(quick=True) == sum(case.seeds * len(case.methods) for case in cases(quick=True))
    assert steps(quick=False) > 3 * steps(quick=True)


def test_an_output_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert main(['evaluate', '--quick', '--output', str(tmp_path / 'file' / 'x')]) == 2
    assert 'give another place' in capsys.readouterr().err
