"""Records say what their fields may be, and one sentence says which one is not so."""

from dataclasses import dataclass, field
from typing import Annotated

import pytest

from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.fields import Checked, Colour, Count, Fields, Limits, Numbers, Positive


@dataclass(frozen=True)
class Part(Checked):
    error = CloudError

    width: Positive
    count: Count = 3
    kind: Annotated[str, Limits(choices=('flat', 'bent'))] = 'flat'
    tint: Colour = (1.0, 1.0, 1.0)
    steps: Numbers = (0.1,)
    whole: bool = False


@dataclass(frozen=True)
class Whole(Checked):
    part: Part
    others: list = field(default_factory=list)


def read(**values):
    return Fields({'part': values}, 'file.yaml: ', CloudError).record(Whole).part


def test_a_record_is_read_by_its_types():
    assert read(width=1) == Part(1.0)
    assert read(width=2, count=0, kind='bent', tint=0.5, steps=[1, 2], whole=True) == Part(
        2.0, 0, 'bent', (0.5, 0.5, 0.5), (1.0, 2.0), True
    )


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({}, 'part.width is missing: add it'),
        ({'width': 1, 'depth': 2}, 'part.depth is unknown: remove it'),
        ({'width': 0}, 'part.width is 0: give a finite number above 0'),
        ({'width': True}, 'part.width is True: give a finite number'),
        ({'width': 1, 'count': 1.0}, 'part.count is 1.0: give a whole number from 0 on'),
        ({'width': 1, 'count': True}, 'part.count is True: give a whole number'),
        ({'width': 1, 'kind': 'round'}, "part.kind is 'round': give one of flat, bent"),
        ({'width': 1, 'tint': [1, -1, 1]}, 'part.tint is [1, -1, 1]: give one or 3 finite'),
        ({'width': 1, 'steps': []}, 'part.steps is []: give a list of finite numbers'),
        ({'width': 1, 'whole': 1}, 'part.whole is 1: give true or false'),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(values, said):
    with pytest.raises(CloudError) as refused:
        read(**values)
    assert str(refused.value).startswith(f'file.yaml: {said}')


def test_code_is_held_to_the_same():
    with pytest.raises(CloudError, match=r'^width is -1: give'):
        Part(-1)
    with pytest.raises(CloudError, match=r'^file.yaml: part is no mapping'):
        Fields({'part': 3}, 'file.yaml: ', CloudError).record(Whole)
