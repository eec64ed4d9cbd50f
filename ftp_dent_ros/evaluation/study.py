"""The paper's section 3 and its tables 3, 4 and 6, with least squares beside them.

The noise of the photographs is that of the simulated camera (12,000 electrons at saturation, 0.8
grey levels of read noise, 8 bits), but in section 3, where it is white noise on the phase: as in
the paper added to the phase map, which nothing filters afterwards, and once more put into the
light, where demodulation filters most of it away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ftp_dent_ros.evaluation.scenes import (
    DYNAMIC_RIG,
    SAMPLES,
    SPEED,
    STATIC_RIG,
    Scene,
    sample,
    simulated_dent,
)
from ftp_dent_ros.evaluation.trial import (
    LEAST_SQUARES,
    Bench,
    Figures,
    Method,
    Trial,
    mean,
    methods,
)

PHASE_NOISE = 0.6  # radians, standard deviation

ITOH = methods('itoh')
ESTRADA = methods('estrada', 0.8)
SMOOTHER = methods('estrada', 0.7)


@dataclass(frozen=True, eq=False)
class Case:
    """Rows of a table: one scene, photographed with several seeds, by several methods."""

    table: str
    row: str
    scene: Scene
    methods: tuple[Method, ...]
    seeds: int
    phase_noise: float = 0.0


@dataclass(frozen=True, eq=False)
class Entry:
    """Mean figures of one method in one row, how often it refused, and its first trial."""

    case: Case
    method: Method
    figures: Figures
    refused: int
    first: Trial
    paper: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Study:
    """All that was measured.

    Attributes
    ----------
    entries : list of Entry
    quick : bool
    """

    quick: bool
    entries: list[Entry] = field(default_factory=list)

    def of(self, table: str) -> dict[str, list[Entry]]:
        """Entries of a table by row."""
        rows: dict[str, list[Entry]] = {}
        for entry in self.entries:
            if entry.case.table == table:
                rows.setdefault(entry.case.row, []).append(entry)
        return rows

    def one(self, table: str, row: str, method: Method) -> Entry:
        """Entry of a method."""
        return next(entry for entry in self.of(table)[row] if entry.method is method)


def cases(quick: bool) -> list[Case]:
    """What is to be measured."""
    many, few = (2, 1) if quick else (20, 3)
    all_methods = (*ITOH, *ESTRADA, *SMOOTHER, LEAST_SQUARES)
    found = [
        Case('section 3', 'phase map', simulated_dent(), all_methods, many, PHASE_NOISE),
        Case('section 3', 'light', simulated_dent(PHASE_NOISE), all_methods, many),
        Case('section 3', 'none', simulated_dent(), all_methods, 1),
    ]
    for name in SAMPLES:
        scene = sample(name, STATIC_RIG, 0.6)
        found.append(Case('static', name, scene, (*ITOH, *ESTRADA, LEAST_SQUARES), few))
    for name in SAMPLES:
        for row, speed in ((f'{name}, dynamic', SPEED), (f'{name}, static', 0.0)):
            scene = sample(name, DYNAMIC_RIG, 1.2, speed)
            found.append(Case('dynamic', row, scene, (*ESTRADA, LEAST_SQUARES), few))
    return found


def study(quick: bool, progress: Callable[[], object] = lambda: None) -> Study:
    """Measure every case; `progress` is called once for each photograph and method."""
    result = Study(quick)
    benches: dict[tuple[str, int], Bench] = {}
    for case in cases(quick):
        for method in case.methods:
            benches.setdefault((method.name, id(case.scene.rig)), Bench(method, case.scene.rig))
        chosen = [benches[method.name, id(case.scene.rig)] for method in case.methods]
        result.entries.extend(_measured(case, chosen, progress))
    return result


def steps(quick: bool) -> int:
    """How often `study` calls its `progress`."""
    return sum(case.seeds * len(case.methods) for case in cases(quick))


def _measured(case: Case, benches: list[Bench], progress: Callable[[], object]) -> Iterator[Entry]:
    scene, lit = case.scene, case.scene.lit()
    trials: list[list[Trial]] = [[] for _ in benches]
    image = scene.photograph(0)
    for seed in range(case.seeds):
        noise = None
        if case.phase_noise:
            rng = np.random.default_rng(seed)
            noise = rng.normal(0, case.phase_noise, lit.shape).astype(np.float32)
        elif seed:
            image = scene.photograph(seed)
        for bench, done in zip(benches, trials, strict=True):
            trial = bench.run(scene, lit, image, noise)
            # Only the first is drawn; the clouds of the others would fill the memory.
            done.append(trial if seed == 0 else Trial(trial.figures, None, None))
            progress()
    paper = _paper()
    for bench, done in zip(benches, trials, strict=True):
        yield Entry(
            case,
            bench.method,
            mean([trial.figures for trial in done]),
            sum(np.isnan(trial.figures.mae) for trial in done),
            done[0],
            paper.get((case.table, case.row, bench.method.name)),
        )


def _paper() -> dict[tuple[str, str, str], tuple[float, float]]:
    """What the paper reports, by table, row and method: MAE and standard deviation in mm."""
    reported = {}
    names = {
        'itoh': [method.name for method in ITOH],
        'estrada': [method.name for method in ESTRADA],
        'smoother': [method.name for method in SMOOTHER],
    }
    # Section 3.
    section = {
        'itoh': ((6.820, 7.174), (3.827, 7.090)),
        'estrada': ((7.597, 4.822), (1.591, 1.339)),
        'smoother': ((1.241, 1.047), (1.221, 1.032)),
    }
    table3 = {
        'A': ((0.158, 0.176), (0.126, 0.115)),
        'B': ((0.167, 0.202), (0.144, 0.151)),
        'C': ((0.259, 0.616), (0.154, 0.494)),
        'D': ((0.158, 0.566), (0.144, 0.537)),
    }
    table4 = {
        'A': ((0.153, 0.174), (0.120, 0.110)),
        'B': ((0.165, 0.190), (0.135, 0.130)),
        'C': ((0.202, 0.162), (0.115, 0.114)),
        'D': ((0.213, 0.368), (0.124, 0.131)),
    }
    table6 = {
        'A, dynamic': ((0.381, 0.456), (0.280, 0.307)),
        'A, static': ((0.504, 0.486), (0.285, 0.217)),
        'B, dynamic': ((0.419, 0.438), (0.309, 0.396)),
        'B, static': ((0.432, 0.329), (0.287, 0.255)),
        'C, dynamic': ((0.436, 0.443), (0.271, 0.265)),
        'C, static': ((0.493, 0.546), (0.320, 0.468)),
        'D, dynamic': ((0.411, 0.394), (0.295, 0.294)),
        'D, static': ((0.370, 0.357), (0.293, 0.401)),
    }
    for kind, pairs in section.items():
        for method, figures in zip(names[kind], pairs, strict=True):
            reported['section 3', 'phase map', method] = figures
    for table, kind, rows in (
        ('static', 'itoh', table3),
        ('static', 'estrada', table4),
        ('dynamic', 'estrada', table6),
    ):
        for row, row_pairs in rows.items():
            for method, figures in zip(names[kind], row_pairs, strict=True):
                reported[table, row, method] = figures
    return reported
