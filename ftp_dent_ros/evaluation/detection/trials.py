"""Photographs of skins with and without dents, and which dents are found in them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ftp_dent_ros.dents.dent import Inspection, Settings
from ftp_dent_ros.errors import ConfigurationError, FtpDentError
from ftp_dent_ros.evaluation.scenes import PATTERN, Scene, make_rig
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.profilometry import Settings as ReconstructionSettings
from ftp_dent_ros.simulation import (
    Dent,
    Dirt,
    DomedRivet,
    Lettering,
    Paint,
    Panel,
    Patch,
    Photometry,
    Rivet,
    waviness,
)
from ftp_dent_ros.simulation.skin.shapes import SMOOTH, Cap, Gaussian, RaisedCosine, Shape
from ftp_dent_ros.simulation.truth import true_dents
from ftp_dent_ros.simulation.truth_matching import match_truth

DISTANCES = 0.6, 0.8, 1.2
#: Skins with dents; blank ones have all of `SKINS`.
DENTED = 'clean', 'dirty', 'wavy'
SKINS = 'clean', 'dirty', 'wavy', 'rivets', 'domed rivets', 'lettering', 'patches', 'streaks'
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
# A dent is no deeper than this part of its width: skin folds before.
_STEEPEST = 1 / 12
_STRIDE = 2


@dataclass(frozen=True)
class Trial:
    """One photograph.

    Attributes
    ----------
    index : int
    distance : float
        Metres.
    skin, light : str
    area : float
        Of skin that was measured, square metres.
    dents : list of [depth, width, hit, measured depth]
        Metres; hit is 1 or 0, and what was measured NaN of misses.
    false_calls : int
        Dents where there are none.
    others : int
        Whatever else was listed where there is no dent.
    refused : str
        Why there is no cloud, if there is none: its dents are missed.
    """

    index: int
    distance: float
    skin: str
    light: str
    area: float
    dents: list[list[float]]
    false_calls: int
    others: int
    refused: str = ''


def trials(
    folder: Path, dents: int, blanks: int, smallest_depth: float, progress: Callable[[], Any]
) -> list[Trial]:
    """All trials; those that a run before has left in the folder are not taken again.

    Raises
    ------
    ConfigurationError
        The folder holds trials of something else, or cannot be written.
    """
    path = folder / 'trials.jsonl'
    done = _taken_before(path, json.dumps({'smallest_depth': smallest_depth}))
    # Blank ones are numbered below 0, so that both can be added to later.
    wanted = [*range(math.ceil(dents / TOGETHER)), *range(-1, -blanks - 1, -1)]
    for index in wanted:
        if index not in done:
            done[index] = _taken(index, smallest_depth)
            try:
                with path.open('a') as file:
                    file.write(json.dumps(asdict(done[index])) + '\n')
            except OSError as reason:
                raise ConfigurationError(
                    f'{path} cannot be written ({reason.strerror}): make room there'
                ) from None
        progress()
    return [done[index] for index in wanted]


def _taken_before(path: Path, head: str) -> dict[int, Trial]:
    """The trials of a file by their numbers; one that is cut short is taken off it."""
    try:
        whole = path.read_text() if path.exists() else ''
        lines = whole.split('\n')[:-1] or [head]
        kept = '\n'.join(lines) + '\n'
        if lines[0] != head:
            raise ConfigurationError(
                f'{path}: is of other settings ({lines[0]}): remove it, or name another folder'
            )
        found = [Trial(**json.loads(line)) for line in lines[1:]]
        if kept != whole:
            with written_aside(path) as aside:
                aside.write_text(kept)
    except (OSError, ValueError, TypeError) as reason:
        raise ConfigurationError(
            f'{path}: holds no trials ({reason}): remove it, or name another folder'
        ) from None
    return {trial.index: trial for trial in found}


def _taken(index: int, smallest_depth: float) -> Trial:
    distance, skin, light, scene = scene_of(index)
    truth = list(true_dents(scene.surface))
    words = index, distance, skin, light
    try:
        photograph = scene.photograph(abs(index))
        measured = reconstructor_at(distance).measure(photograph, True)
        found = inspect(measured.cloud, Settings(smallest_depth=smallest_depth))
    except FtpDentError as error:
        missed = [[true.depth, true.width, 0, math.nan] for true in truth]
        return Trial(*words, 0.0, missed, 0, 0, str(error))
    results, false, others = _compared(truth, found)
    return Trial(*words, area_of(measured.cloud.points), results, false, others)


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


def scene_of(index: int) -> tuple[float, str, str, Scene]:
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
        **_skin(skin, rng, distance),
    )
    photometry = Photometry(reference_distance=distance, **LIGHTS[light])
    return distance, skin, light, Scene(_rig(distance), (panel,), photometry)


def _dents(rng: np.random.Generator, distance: float) -> Iterator[Dent]:
    for x, y in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
        width = math.exp(rng.uniform(*np.log(_WIDTHS)))
        depth = min(math.exp(rng.uniform(*np.log(_DEPTHS))), _STEEPEST * width)
        shape = _SHAPES[int(rng.integers(len(_SHAPES)))]
        part, _ = Dent(0, 0, 1, 1, 1, 0, shape).size_at()
        place = distance * np.array([0.14 * x, 0.075 * y]) + rng.uniform(-0.01, 0.01, 2)
        length = width * rng.uniform(1, 1.6)
        angle = float(rng.uniform(0, math.pi))
        at_x, at_y = map(float, place)
        yield Dent(at_x, at_y, length / part, width / part, depth, angle, shape)


def _skin(skin: str, rng: np.random.Generator, distance: float) -> dict[str, Any]:
    seed = int(rng.integers(1 << 30))
    reach = 0.2 * distance
    if skin == 'dirty':
        return {'paint': Paint(marks=(Dirt(0.25, seed=seed),))}
    if skin == 'streaks':
        angle = float(rng.uniform(0, math.pi))
        streaks = Dirt(0.15, (0.016, 0.006), seed, stretch=8.0, angle=angle)
        return {'paint': Paint(marks=(streaks,))}
    if skin == 'wavy':
        return {'waves': waviness(1e-4, float(rng.uniform(0.08, 0.2)), seed)}
    if skin in ('rivets', 'domed rivets'):
        kind = Rivet if skin == 'rivets' else DomedRivet
        y = float(rng.uniform(-0.4, 0.4) * reach)
        return {'rivets': tuple(kind(-0.3 + 0.025 * i, y) for i in range(25))}
    if skin == 'lettering':
        x, y = rng.uniform(-0.5, 0.5, 2) * reach
        mark = Lettering(float(x), float(y), 'NO STEP', 0.02, (0.25, 0.3, 0.8))
        return {'paint': Paint(marks=(mark,))}
    if skin == 'patches':
        places = rng.uniform(-1, 1, (3, 2)) * reach
        marks = tuple(Patch(float(x), float(y), 0.05, 0.03, (0.5,) * 3) for x, y in places)
        return {'paint': Paint(marks=marks)}
    return {}


@lru_cache(maxsize=4)
def _rig(distance: float):
    return make_rig(distance, 0.24, (1280, 720, 1530.0), 1810.0)


@lru_cache(maxsize=4)
def reconstructor_at(distance: float) -> Reconstructor:
    """Of photographs that are taken so many metres away."""
    return Reconstructor(_rig(distance), PATTERN, ReconstructionSettings(stride=_STRIDE))


def area_of(points) -> float:
    """Of a cloud's whole cells, square metres."""
    right, down = np.diff(points, axis=1)[:-1], np.diff(points, axis=0)[:, :-1]
    return float(np.nansum(np.linalg.norm(np.cross(right, down), axis=-1)))
