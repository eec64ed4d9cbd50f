"""The probability of detection, as MIL-HDBK-1823A states it, on simulated photographs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

from ftp_dent_ros import __version__
from ftp_dent_ros.dents.dent import Inspection, SmallestDent
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.scenes import PATTERN, Scene, make_rig
from ftp_dent_ros.files import write_texts
from ftp_dent_ros.fleet import cores, in_order
from ftp_dent_ros.inspection.inspecting import area_of
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pages.drawing import data_uri, figure_png
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.pages.words import finite
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.profilometry import Settings as ReconstructionSettings
from ftp_dent_ros.robust import deviation, median
from ftp_dent_ros.simulation import (
    Dent,
    Dirt,
    Lettering,
    Paint,
    PaintPatch,
    Panel,
    Photometry,
    Rivet,
    domed_rivet,
    waviness,
)
from ftp_dent_ros.simulation.dents import SMOOTH, Cap, Gaussian, RaisedCosine, Shape
from ftp_dent_ros.simulation.paint import Mark
from ftp_dent_ros.simulation.truth import match_truth, true_dents

DISTANCES = 0.6, 0.8, 1.2
LIGHTS: dict[str, dict[str, Any]] = {
    'usual': {},
    'dim': {'exposure': 0.3},
    'sun': {'exposure': 0.4, 'ambient': 1.2},
}
#: Dents a photograph.
TOGETHER = 4
# Of the depths and widths that are drawn, metres.
_DEPTHS, _WIDTHS = (2e-5, 1e-3), (0.012, 0.05)
_SHAPES: tuple[Shape, ...] = SMOOTH, RaisedCosine(), Gaussian(), Cap()

# Sizes are counted in these: logarithms of order 1.
_DEPTH, _WIDTH = 1e-4, 0.03

Values = NDArray[np.float64]

_COLOURS = {'clean': '#1b6ca8', 'dirty': '#b5651d', 'wavy': '#2e8b57'}


@dataclass(frozen=True)
class Trial:
    """One photograph.

    Attributes
    ----------
    distance : float
        Metres.
    skin : str
    area : float
        Of skin that was measured, square metres.
    dents : list of [depth, width, hit, measured depth]
        Metres; hit is 1 or 0, and what was measured NaN of misses.
    false_calls : int
        Dents where there are none.
    others : int
        Whatever else was listed where there is no dent.
    """

    distance: float
    skin: str
    area: float
    dents: list[list[float]]
    false_calls: int
    others: int


def run_trials(
    dents: int, blanks: int, smallest_depth: float, progress: Callable[[], Any]
) -> list[Trial]:
    """All trials, on all cores; `progress` is called after each."""
    # Blank ones are numbered below 0.
    wanted = [*range(math.ceil(dents / TOGETHER)), *range(-1, -blanks - 1, -1)]
    trials = []
    for trial in in_order(partial(_taken, smallest_depth=smallest_depth), wanted, cores()):
        trials.append(trial)
        progress()
    return trials


def _taken(index: int, smallest_depth: float) -> Trial:
    distance, skin, scene = scene_of(index)
    truth = list(true_dents(scene.surface))
    try:
        photograph = scene.photograph(abs(index))
        measured = reconstructor_at(distance).measure(photograph, True)
        found = inspect(measured.cloud, SmallestDent(smallest_depth=smallest_depth))
    except FtpDentError:
        # Without a cloud all are missed.
        missed = [[true.depth, true.width, 0, math.nan] for true in truth]
        return Trial(distance, skin, 0.0, missed, 0, 0)
    results, false, others = _compared(truth, found)
    return Trial(distance, skin, area_of(measured.cloud.points), results, false, others)


def _compared(truth, found: Inspection) -> tuple[list[list[float]], int, int]:
    pairs = match_truth(
        [dent.position for dent in found.dents],
        [true.position for true in truth],
        [true.width / 2 for true in truth],
    )
    results = []
    for index, true in enumerate(truth):
        hit = index in pairs
        measured = found.dents[pairs[index]].depth.value if hit else math.nan
        results.append([true.depth, true.width, int(hit), measured])
    reach = [(true.position, true.length) for true in truth]
    others = [o for o in found.others if all(np.linalg.norm(o.position - p) > r for p, r in reach)]
    return results, len(found.dents) - len(pairs), len(others)


def scene_of(index: int) -> tuple[float, str, Scene]:
    """What the trial of a number photographs; a blank skin below 0."""
    rng = np.random.default_rng([2026, abs(index), int(index < 0)])
    skins = DENTED if index >= 0 else SKINS
    distance = DISTANCES[abs(index) % len(DISTANCES)]
    skin = skins[abs(index) // len(DISTANCES) % len(skins)]
    light = str(rng.choice(list(LIGHTS)))
    dents = tuple(_dents(rng, distance)) if index >= 0 else ()
    pose = Pose.from_rpy(
        (*rng.normal(0, 0.05, 2), rng.uniform(-0.2, 0.2)), (*rng.normal(0, 0.005, 2), distance)
    )
    panel = Panel(
        pose,
        (-0.6, 0.6, -0.6, 0.6),
        float(rng.choice([0.0, 2.0])),
        dents=dents,
        **_SKINS[skin](rng, int(rng.integers(1 << 30)), 0.2 * distance),
    )
    photometry = Photometry(reference_distance=distance, **LIGHTS[light])
    return distance, skin, Scene(_rig(distance), (panel,), photometry)


def _dents(rng: np.random.Generator, distance: float) -> Iterator[Dent]:
    for column, row in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
        width = math.exp(rng.uniform(*np.log(_WIDTHS)))
        depth = min(math.exp(rng.uniform(*np.log(_DEPTHS))), width / 12)
        shape = _SHAPES[int(rng.integers(len(_SHAPES)))]
        part, _ = Dent(0, 0, 1, 1, 1, 0, shape).size()
        middle = distance * np.array([0.14 * column, 0.075 * row])
        x, y = (middle + rng.uniform(-0.01, 0.01, 2)).tolist()
        length = width * rng.uniform(1, 1.6)
        angle = rng.uniform(0, math.pi)
        yield Dent(x, y, length / part, width / part, depth, angle, shape)


def _marked(*marks: Mark) -> dict[str, Any]:
    return {'paint': Paint(marks=marks)}


def _letters(x: float, y: float) -> dict[str, Any]:
    return _marked(Lettering(x, y, 'NO STEP', 0.02, (0.25, 0.3, 0.8)))


def _patches(places: Sequence[tuple[float, float]]) -> dict[str, Any]:
    return _marked(*(PaintPatch(x, y, 0.05, 0.03, (0.5,) * 3) for x, y in places))


def _riveted(rivet: Callable[[float, float], Any], y: float) -> dict[str, Any]:
    return {'rivets': tuple(rivet(-0.3 + 0.025 * i, y) for i in range(25))}


#: What panels have, of a generator, a seed and how far out of the middle things stand, metres.
_SKINS: dict[str, Callable[[np.random.Generator, int, float], dict[str, Any]]] = {
    'clean': lambda rng, seed, reach: {},
    'dirty': lambda rng, seed, reach: _marked(Dirt(0.25, seed=seed)),
    'wavy': lambda rng, seed, reach: {'waves': waviness(1e-4, rng.uniform(0.08, 0.2), seed)},
    'rivets': lambda rng, seed, reach: _riveted(Rivet, reach * rng.uniform(-0.4, 0.4)),
    'domed rivets': lambda rng, seed, reach: _riveted(domed_rivet, reach * rng.uniform(-0.4, 0.4)),
    'lettering': lambda rng, seed, reach: _letters(*(reach * rng.uniform(-0.5, 0.5, 2)).tolist()),
    'patches': lambda rng, seed, reach: _patches((reach * rng.uniform(-1, 1, (3, 2))).tolist()),
    'streaks': lambda rng, seed, reach: _marked(
        Dirt(0.15, (0.016, 0.006), seed, stretch=8.0, angle=rng.uniform(0, math.pi))
    ),
}
#: Blank skins; the first three are those that are dented too.
SKINS = tuple(_SKINS)
DENTED = SKINS[:3]


@lru_cache(maxsize=4)
def _rig(distance: float):
    return make_rig(distance, 0.24, (1280, 720, 1530.0), 1810.0)


@lru_cache(maxsize=4)
def reconstructor_at(distance: float) -> Reconstructor:
    """Of photographs that are taken so many metres away."""
    return Reconstructor(_rig(distance), PATTERN, ReconstructionSettings(stride=2))


@dataclass(frozen=True)
class Detection:
    """What a set of hits and misses says of dents of one width.

    Attributes
    ----------
    dents, hits : int
    a90 : float
        Depth that is found in 90 % of cases, metres; NaN if the set does not tell.
    a90_95 : float
        Its upper bound with a confidence of 95 %, metres; NaN if there is none.
    coefficients : tuple of 3 floats
        Of 1, ln(depth / 0.1 mm) and ln(width / 30 mm) in the logit.
    """

    dents: int
    hits: int
    a90: float
    a90_95: float
    coefficients: tuple[float, float, float]

    def probability(self, depth: Values, width: float) -> Values:
        """At depths and a width, metres."""
        b0, b1, b2 = self.coefficients
        logit = b0 + b1 * np.log(np.asarray(depth) / _DEPTH) + b2 * math.log(width / _WIDTH)
        return 1 / (1 + np.exp(-np.clip(logit, -500, 500)))


def detection(depths: Values, widths: Values, hits: Values) -> Detection:
    """Fit hits (1) and misses (0) of dents, shape (n,), metres; depths are of 30 mm wide ones."""
    count, found = len(hits), int(np.sum(hits))
    if count < 10 or found in (0, count):
        return Detection(count, found, math.nan, math.nan, (math.nan,) * 3)
    columns = np.stack([np.ones(count), np.log(depths / _DEPTH), np.log(widths / _WIDTH)], axis=1)
    hits = np.asarray(hits, float)
    best = _maximum(lambda b: _likelihood(b, columns, hits), np.array([0.0, 2.0, 0.0]))
    top = _likelihood(best, columns, hits)
    wanted = math.log(9)
    coefficients = float(best[0]), float(best[1]), float(best[2])
    if best[1] <= 0:
        return Detection(count, found, math.nan, math.nan, coefficients)
    a90 = (wanted - best[0]) / best[1]

    def excess(size: float) -> float:
        def bound(rest: Values) -> Values:
            return np.array([wanted - rest[0] * size, *rest])

        rest = _maximum(lambda r: _likelihood(bound(r), columns, hits), best[1:])
        return 2 * (top - _likelihood(bound(rest), columns, hits)) - float(chi2.ppf(0.90, 1))

    bound = math.nan
    if excess(math.log(100.0)) > 0:
        bound = _DEPTH * math.exp(brentq(excess, a90, math.log(100.0), xtol=1e-3))
    return Detection(count, found, _DEPTH * math.exp(a90), bound, coefficients)


def most_calls(calls: int, area: float) -> float:
    """Upper bound, with a confidence of 95 %, of false calls a square metre."""
    return float(chi2.ppf(0.95, 2 * calls + 2)) / 2 / area if area > 0 else math.nan


def _likelihood(b: Values, columns: Values, hits: Values) -> float:
    """Logarithm of the likelihood, with half of that of the information's determinant."""
    logit = np.clip(columns @ b, -30, 30)
    p = 1 / (1 + np.exp(-logit))
    information = columns.T @ (columns * (p * (1 - p))[:, None])
    _, determinant = np.linalg.slogdet(information + 1e-12 * np.eye(len(b)))
    return float((hits * logit - np.logaddexp(0, logit)).sum() + determinant / 2)


def _maximum(function, start: Values) -> Values:
    return np.asarray(minimize(lambda b: -function(b), start, method='Nelder-Mead').x, float)


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


def _results(trials: Sequence[Trial], distance: float, skin: str) -> Values:
    """Depths, widths, hits and measured depths of the dents of a distance and skin, (4, n)."""
    some = [t for t in trials if (t.distance, t.skin) == (distance, skin)]
    return np.array([dent for t in some for dent in t.dents], float).reshape(-1, 4).T


def rows_of(trials: Sequence[Trial]) -> list[Row]:
    """A row a distance and skin."""
    rows = []
    for distance in DISTANCES:
        for skin in DENTED:
            depth, width, hit, measured = _results(trials, distance, skin)
            ratio = (measured / depth)[hit > 0] - 1
            bias = median(ratio)
            found = detection(depth, width, hit)
            rows.append(Row(distance, skin, found, bias, deviation(ratio - bias)))
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


def sentence(rows: Sequence[Row], blanks: Sequence[Blank], smallest_depth: float) -> str:
    """What an inspector may quote, with the conditions that it holds under."""
    clean = next(row for row in rows if (row.distance, row.skin) == (0.8, 'clean'))
    dirty = next(row for row in rows if (row.distance, row.skin) == (0.8, 'dirty'))
    parts = [
        f'{1e3 * row.detection.a90_95:.2f} mm on {words} skin'
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
        f'In simulation, from one photograph at 0.8 m, single smooth dents {1e3 * _WIDTH:g} mm '
        'wide are found in 90 % of cases, with a confidence of 95 % (a90/95), from a depth of '
        f'{" and ".join(parts)} on, when depths from {1e3 * smallest_depth:g} mm on are looked '
        f'for; there were {every.calls} false calls on {every.area:.0f} m² of skin without dents '
        f'(with a confidence of 95 % at most {every.most:.2f} a square metre). It holds for the '
        "simulated rig, lights and skins below, for dents away from the frame's rim, and not for "
        'a real rig until that has been tested in the same way.'
    )


def write_detection(
    folder: Path, trials: Sequence[Trial], smallest_depth: float
) -> tuple[Path, str]:
    """Write ``detection.html`` and ``detection.json``; the page's path, and what may be quoted."""
    rows, blanks = rows_of(trials), blanks_of(trials)
    quoted = sentence(rows, blanks, smallest_depth)
    text = render(
        'ftp_dent_ros.evaluation',
        'templates/detection.html.j2',
        sentence=quoted,
        rows=rows,
        blanks=blanks,
        curves=_curves(trials, rows),
        dents=sum(row.detection.dents for row in rows),
        photographs=len(trials),
        width=f'{1e3 * _WIDTH:g}',
        smallest=f'{1e3 * smallest_depth:g}',
        version=__version__,
    )
    record: dict[str, Any] = {
        'sentence': quoted,
        'width_mm': 1e3 * _WIDTH,
        'smallest_depth_mm': 1e3 * smallest_depth,
        'rows': [asdict(row) for row in rows],
        'blanks': [{**asdict(blank), 'at_most_per_m2': blank.most} for blank in blanks],
    }
    data = json.dumps(finite(record), indent=1, allow_nan=False) + '\n'
    write_texts(folder, {'detection.json': data, 'detection.html': text}, 'the page')
    return folder / 'detection.html', quoted


def _curves(trials: Sequence[Trial], rows: Sequence[Row]) -> str:
    """Probability of detection over the depth, a picture a distance, as a data URI."""
    figure = Figure(figsize=(10, 3.4), layout='constrained')
    axes = figure.subplots(1, len(DISTANCES), sharey=True)
    depths = np.geomspace(2e-5, 1e-3, 200)
    for axis, distance in zip(axes, DISTANCES, strict=True):
        for row in (row for row in rows if row.distance == distance):
            colour = _COLOURS[row.skin]
            # What is not a number is not drawn.
            chance = row.detection.probability(depths, _WIDTH)
            axis.plot(1e3 * depths, chance, color=colour, label=row.skin)
            axis.plot(1e3 * row.detection.a90_95, 0.9, 'o', color=colour, ms=5)
            depth, _, hit, _ = _results(trials, row.distance, row.skin)
            axis.plot(1e3 * depth, hit, '|', color=colour, alpha=0.5, ms=7)
        axis.axhline(0.9, color='#999', lw=0.7, ls=':')
        axis.set(xscale='log', xlim=(0.016, 1.25), xlabel='depth, mm')
        axis.set_title(f'{distance:g} m', fontsize=10)
        axis.legend(fontsize=8, frameon=False, loc='center right')
    axes[0].set_ylabel('probability of detection')
    return data_uri(figure_png(figure, 130))
