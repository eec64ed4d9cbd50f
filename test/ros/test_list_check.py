"""A list of dents is held against the true ones by places and sizes."""

from dataclasses import replace

import numpy as np
import pytest
from dent_samples import make_dent

from ftp_dent_ros.coding.messages import dents_from_message
from ftp_dent_ros.demonstration.appraisal import false_in_list
from ftp_dent_ros.dents.sightings import Sighting, listed
from ftp_dent_ros.ros.dent_messages import dents_to_message
from ftp_dent_ros.simulation.truth import TrueDent

NORMAL, AXIS = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
# An autopilot's, along each axis, metres.
DEVIATION = 0.07


def true(x, depth, length, width):
    nothing = np.zeros((0, 3))
    place = np.array([x, 0.0, 0.6])
    return TrueDent('dent', place, NORMAL, AXIS, depth, length, width, nothing, nothing)


TRUTH = (true(0.0, 2e-3, 0.06, 0.05), true(0.3, 1e-3, 0.03, 0.03))


def node_list(*dents):
    """As the node publishes it, the autopilot 5 cm off."""
    entries = []
    for number, dent in enumerate(dents, start=1):
        there = replace(dent, position=dent.position + 0.05 * AXIS)
        sighting = Sighting(number, there, np.eye(3) * DEVIATION**2)
        entries.append(listed(number, (sighting,)))
    return dents_from_message(dents_to_message(entries, 0, 'map'))


def as_measured(each, beside=0.0, **changes):
    sizes = {'depth': 1.02 * each.depth, 'length': each.length, 'width': each.width}
    return make_dent(each.position + beside * AXIS, **(sizes | changes))


BOTH = [as_measured(each) for each in TRUTH]


@pytest.mark.parametrize(
    'more, false',
    [
        ([], 0),
        # Its sizes, 10 cm beside it.
        ([as_measured(TRUTH[0], 0.1)], 0),
        # As near, and none of those that are there.
        ([as_measured(TRUTH[0], 0.1, depth=2e-4, length=0.02, width=0.02)], 1),
        ([as_measured(TRUTH[0], 0.05, depth=4e-3)], 1),
        # The other's sizes, out of its reach.
        ([as_measured(TRUTH[1], -0.45)], 1),
        # The rest of a cut one is not known.
        ([as_measured(TRUTH[1], -0.3, depth=4e-3, is_cut=True)], 0),
    ],
)
def test_what_is_no_true_dent_by_place_and_sizes_is_false(more, false):
    assert false_in_list(node_list(*BOTH, *more), TRUTH) == false


def test_without_true_dents_all_are_false_and_an_empty_list_has_none():
    assert false_in_list(node_list(*BOTH), ()) == 2
    assert false_in_list(node_list(), TRUTH) == 0
