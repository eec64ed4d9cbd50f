"""What trials say together: a row a distance and skin, and what an inspector may quote."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ftp_dent_ros.evaluation.detection.probability import Detection, detection, most_calls
from ftp_dent_ros.evaluation.detection.trials import DENTED, DISTANCES, SKINS, Trial
from ftp_dent_ros.robust import NORMAL_SPREAD

#: Width that depths are told for, metres.
WIDTH = 0.03
_MM = 1e3


@dataclass(frozen=True)
class Row:
    """Dents of one distance and skin.

    Attributes
    ----------
    distance : float
        Metres.
    skin : str
    detection : Detection
    bias, scatter : float
        Median of the measured depths over the true ones, less 1, and their spread (1.4826 times
        the median absolute deviation); of those found.
    """

    distance: float
    skin: str
    detection: Detection
    bias: float
    scatter: float


@dataclass(frozen=True)
class Blank:
    """Photographs without dents of one skin.

    Attributes
    ----------
    skin : str
    photographs, calls, others : int
        Calls are dents in the list where there are none; others are what else is listed.
    area : float
        Square metres.
    """

    skin: str
    photographs: int
    calls: int
    others: int
    area: float

    @property
    def most(self) -> float:
        """Upper bound of false calls a square metre, with a confidence of 95 %."""
        return most_calls(self.calls, self.area)


def rows_of(trials: Sequence[Trial]) -> list[Row]:
    """A row a distance and skin."""
    rows = []
    for distance in DISTANCES:
        for skin in DENTED:
            some = [t for t in trials if t.dents and (t.distance, t.skin) == (distance, skin)]
            values = np.array([dent for trial in some for dent in trial.dents], float)
            values = values.reshape(-1, 4)
            depth, width, hit, measured = values.T
            ratio = (measured / depth)[hit > 0] - 1
            bias = float(np.median(ratio)) if len(ratio) else math.nan
            scatter = (
                NORMAL_SPREAD * float(np.median(np.abs(ratio - bias))) if len(ratio) else math.nan
            )
            rows.append(Row(distance, skin, detection(depth, width, hit, WIDTH), bias, scatter))
    return rows


def blanks_of(trials: Sequence[Trial]) -> list[Blank]:
    """A row a skin, and all of them together."""
    blank = [trial for trial in trials if not trial.dents]
    groups = [(skin, [t for t in blank if t.skin == skin]) for skin in SKINS]
    return [
        Blank(
            skin,
            len(some),
            sum(t.false_calls for t in some),
            sum(t.others for t in some),
            sum(t.area for t in some),
        )
        for skin, some in (*groups, ('all', blank))
    ]


def _calls(count: int) -> str:
    return f'was {count} false call' if count == 1 else f'were {count or "no"} false calls'


def sentence(rows: Sequence[Row], blanks: Sequence[Blank], smallest_depth: float) -> str:
    """What an inspector may quote, with the conditions that it holds under."""
    clean = next(row for row in rows if (row.distance, row.skin) == (0.8, 'clean'))
    dirty = next(row for row in rows if (row.distance, row.skin) == (0.8, 'dirty'))
    parts = [
        f'{_MM * row.detection.a90_95:.2f} mm on {words} skin'
        for row, words in ((clean, 'clean'), (dirty, 'dirty (25 %)'))
        if math.isfinite(row.detection.a90_95)
    ]
    every = blanks[-1]
    count = sum(row.detection.dents for row in rows)
    if not parts:
        return (
            f'These {count} dents are too few to quote a depth that is found in 90 % of cases '
            'with a confidence of 95 %.'
        )
    return (
        f'In simulation, from one photograph at 0.8 m, single smooth dents {_MM * WIDTH:g} mm '
        'wide are found in 90 % of cases, with a confidence of 95 % (a90/95), from a depth of '
        f'{" and ".join(parts)} on, when depths from {_MM * smallest_depth:g} mm on are looked '
        f'for; there {_calls(every.calls)} on {every.area:.0f} m² of skin without dents '
        f'(with a confidence of 95 % at most {every.most:.2f} a square metre). It holds for the '
        "simulated rig, lights and skins below, for dents away from the frame's rim, and not for "
        'a real rig until that has been tested in the same way.'
    )
