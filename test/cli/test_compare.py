"""The commands on surveys: kept, compared, and located on the aircraft."""

import csv
import io

import numpy as np
import pytest
import yaml
from survey_samples import COUNT, GROWN, pair

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.store import SurveyStore

AIRCRAFT = Pose.from_rpy((0.0, 0.1, -1.0), (12.0, -2.0, 3.0))
COLUMNS = {
    *('number', 'status', 'station_mm', 'buttock_line_mm', 'water_line_mm', 'length_mm'),
    *('width_mm', 'depth_mm', 'width_to_depth', 'clearance_mm', 'depth_growth_mm'),
    *('date_first_seen', 'limit', 'reference', 'number_before'),
}


@pytest.fixture
def kept(tmp_path):
    file = tmp_path / 'aircraft.sqlite'
    for survey in pair():
        SurveyStore(file).add(survey)
    return file


def refusal(capsys, *words):
    assert main([*map(str, words)]) == 2
    out, err = capsys.readouterr()
    assert out == '' and len(err.splitlines()) == 1
    return err


def points(path, later, wrong=0.0, line=False):
    """Four dents of the survey with their coordinates on the aircraft."""
    chosen = sorted(later.dents, key=lambda each: each.dent.position[0])
    chosen = [chosen[0], chosen[7], chosen[14], chosen[-1]]
    items = []
    for index, each in enumerate(chosen):
        place = chosen[0].dent.position + index * np.array([0.3, 0, 0])
        at = AIRCRAFT.apply(place if line else each.dent.position)
        item = {'name': f'p{index}', 'at': [float(v) * 1e3 for v in at]}
        item |= {'map': place.tolist()} if line else {'dent': each.number}
        items.append(item)
    items[1]['at'][0] += wrong * 1e3
    path.write_text(yaml.safe_dump({'points': items}))
    return path


def test_two_surveys_become_a_page_and_a_chart_on_the_aircraft(tmp_path, capsys, kept):
    assert main(['surveys', str(kept)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f'2024-10-04  before: {COUNT - 1} dents',
        f'2025-11-08  after: {COUNT - 2} dents',
    ]
    _, later = pair()
    words = ['compare', f'{kept}:before', f'{kept}:after', '--output', str(tmp_path / 'out')]
    words += ['--rules', 'shipped:example_rules.yaml']
    assert main([*words, '--points', str(points(tmp_path / 'points.yaml', later))]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first == f'1 grown, 1 new, 1 repaired, 1 not seen, {COUNT - 4} known'
    rows = list(csv.DictReader(io.StringIO((tmp_path / 'out/chart.csv').read_text())))
    assert rows[0].keys() >= COLUMNS and len(rows) == COUNT
    grown = rows[0]
    assert (grown['status'], grown['number']) == ('grown', str(GROWN))
    assert grown['date_first_seen'] == '2024-10-04' and grown['limit']
    (dent,) = [each.dent for each in later.dents if each.number == GROWN]
    place = [float(grown[f'{name}_mm']) for name in ('station', 'buttock_line', 'water_line')]
    np.testing.assert_allclose(place, AIRCRAFT.apply(dent.position) * 1e3, atol=0.01)
    assert 0.3 < float(grown['location_uncertainty_mm']) < 3
    page = (tmp_path / 'out/comparison.html').read_text()
    assert '1 grown, 1 new, 1 repaired' in page and 'Station, buttock line' in page


def test_each_wrong_input_is_one_sentence(tmp_path, capsys, kept):
    out = ('--output', tmp_path / 'out')
    both = f'{kept}:before', f'{kept}:after'
    assert 'FILE.sqlite:NAME' in refusal(capsys, 'compare', kept, both[1], *out)
    assert "has no survey 'x'" in refusal(capsys, 'compare', f'{kept}:x', both[1], *out)
    assert 'no such file' in refusal(capsys, 'compare', 'none:x', both[1], *out)
    assert 'give the earlier survey first' in refusal(capsys, 'compare', *both[::-1], *out)
    _, later = pair()
    file = tmp_path / 'points.yaml'

    def with_points():
        return refusal(capsys, 'compare', *both, *out, '--points', file)

    points(file, later, line=True)
    assert 'lie on a line' in with_points()
    points(file, later, wrong=0.1)
    assert 'contradict each other' in with_points()
    file.write_text(yaml.safe_dump({'points': [{'dent': 999, 'at': [1, 2, 3]}]}))
    assert 'has no such dent' in with_points()
    file.write_text(yaml.safe_dump({'unit': 'ft', 'points': []}))
    assert "unit is 'ft'" in with_points()
    assert not (tmp_path / 'out').exists()
