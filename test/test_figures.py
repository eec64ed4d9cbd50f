"""The gate tells what is worse, and nothing else."""

import copy

import pytest
from against import common, equal, report
from sizes import sizes


def a_run(seed=1, mae=(0.010, 0.012, 0.011, 0.013), found=(1.0, 1.0, 1.0, 1.0)):
    rows = {
        f'photographs/{kind}/stripe': {'mae_mm': list(mae), 'found': list(found)}
        for kind in ('clean', 'dirt')
    }
    return {'seed': seed, 'part': False, 'rows': rows, 'sizes': {}, 'speeds': {'inspect': 20.0}}


def test_the_same_is_equal_and_not_worse():
    lines, well = report(a_run(), a_run())
    assert well
    assert lines[0] == 'equal: 4 of 4 figures'


def test_fewer_draws_of_the_same_seed_are_compared_with_the_same():
    short = a_run(mae=(0.010, 0.012), found=(1.0, 1.0))
    assert equal(*common(short['rows'], a_run()['rows'], same=True)) == (4, 4)
    assert report(short | {'part': True}, a_run())[1]


@pytest.mark.parametrize(
    'change', [{'mae': (0.030, 0.032, 0.031, 0.033)}, {'found': (0.5, 0.5, 0.5, 0.5)}]
)
@pytest.mark.parametrize('seed', [1, 2])
def test_what_is_worse_by_more_than_the_scatter_is_told(change, seed):
    lines, well = report(a_run(seed, **change), a_run())
    assert not well
    assert sum(line.startswith('worse') for line in lines) == 3  # and their mean


def test_scatter_is_not_worse():
    assert report(a_run(2, mae=(0.012, 0.013, 0.011, 0.014)), a_run())[1]
    assert report(a_run(mae=(0.011, 0.012, 0.012, 0.013)), a_run())[1]


def test_what_is_refused_or_slower_is_told():
    refused, slow = copy.deepcopy(a_run()), a_run() | {'speeds': {'inspect': 40.0}}
    before = copy.deepcopy(a_run())
    for run, value in ((before, 0.0), (refused, 1.0)):
        run['rows']['photographs/clean/stripe'] = {'refusals': [value] * 4}
    assert not report(refused, before)[1]
    assert not report(slow, a_run())[1]


def test_sizes_count_what_a_reader_holds_in_mind(tmp_path):
    room = tmp_path / 'package' / 'room'
    room.mkdir(parents=True)
    for folder in (room, room.parent):
        (folder / '__init__.py').write_text('"""A document."""\n')
    (room / 'one.py').write_text('_MOST = 3.5\n\n\ndef f(a):\n    return a < _MOST and a > 1\n')
    (room / 'two.py').write_text('from package.room.one import f\n\nprint(f(2))\n')
    assert sizes(tmp_path / 'package')['room'] == {
        'modules': 3,
        'statements': 4,
        'choices': 3,
        'numbers': 1,
        'constants': 1,
        'wide': 0,
        'single': 1,
    }
