"""The parameters of survey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.parameters import Declarations


@dataclass(frozen=True, eq=False)
class SurveyParameters:
    """What survey was given; the covariance, shape (6, 6), is of poses that state none."""

    map_frame: str
    queue_size: int
    unstated: NDArray[np.float64]


def declare(parameters: Declarations) -> SurveyParameters:
    """Declare them."""
    deviations = [
        parameters.declare(
            f'unstated.{name}',
            default,
            f"Standard deviation of a pose's {of} if it states none, {unit}.",
            minimum=1e-6,
            maximum=most,
        )
        for name, default, of, unit, most in (
            ('translation_uncertainty', 0.03, 'position along each axis', 'metres', 100.0),
            ('rotation_uncertainty', 0.015, 'turn about each axis', 'radians', 3.0),
        )
    ]
    return SurveyParameters(
        map_frame=parameters.declare(
            'map_frame', 'map', 'The frame that poses come in; others are refused.'
        ),
        queue_size=parameters.declare(
            'queue_size',
            5,
            'How many clouds may wait at once; of more, the oldest are dropped.',
            minimum=1,
            maximum=1000,
        ),
        unstated=np.diag(np.square(np.repeat(deviations, 3))),
    )
