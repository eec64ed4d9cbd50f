"""The aircraft's frame from points: as exact as it says, and refused where it cannot be."""

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.aircraft_frame import ReferencePoint, aircraft_frame

TRUE = Pose.from_rpy((0.02, -0.01, 2.2), (12.0, -1.5, 2.5))
PLACES = np.array([[0.0, 0, 0], [1.5, 0.1, 0], [0.6, 0.1, 0.9], [1.4, 0.2, 1.0], [0.2, 0.1, 0.7]])


def points(rng, count=3, noise=1e-3):
    return [
        ReferencePoint(
            f'rivet {k}',
            place + rng.normal(0, 3e-4, 3),
            TRUE.apply(place) + rng.normal(0, noise, 3),
            np.hypot(noise, 3e-4),
        )
        for k, place in enumerate(PLACES[:count])
    ]


def test_three_points_of_a_millimetre_give_places_near_them_to_what_is_stated():
    rng = np.random.default_rng(3)
    errors, stated = [], []
    for _ in range(300):
        frame = aircraft_frame(points(rng))
        place = PLACES[:3].mean(axis=0) + rng.uniform(-0.3, 0.3, 3)
        there, covariance = frame.place(place)
        off = there - TRUE.apply(place)
        errors.append(np.linalg.solve(np.linalg.cholesky(covariance), off))
        stated.append(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    assert max(stated) < 1.5e-3
    np.testing.assert_allclose(np.std(errors), 1.0, atol=0.1)


@pytest.mark.parametrize(
    ('count', 'said'),
    [
        (2, '2 reference points'),
        (3, 'contradict each other'),
        (4, 'contradict each other'),
        (5, 'without rivet 1, which is .* mm off'),
    ],
)
def test_too_few_points_or_a_wrong_one_are_told_and_it_is_named_where_others_tell(count, said):
    rng = np.random.default_rng(2)
    given = points(rng, count)
    wrong = given[1]
    given[1] = ReferencePoint(wrong.name, wrong.in_map, wrong.on_aircraft + 0.05, 1e-3)
    with pytest.raises(ConfigurationError, match=said):
        aircraft_frame(given)
