"""Clouds of a simulated flight joined to one skin, and two surveys of one skin compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from measures import MM, Figures, attempt, generator, root_mean_square
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.rigid import twist_between
from ftp_dent_ros.simulation import (
    Dent,
    Dirt,
    Lettering,
    Paint,
    Panel,
    Photometry,
    Renderer,
    Rivet,
    Surface,
    scratches,
)
from ftp_dent_ros.survey.comparison import compare
from ftp_dent_ros.survey.information import COMMON
from ftp_dent_ros.survey.joining import Joining
from ftp_dent_ros.survey.patch import patch_of
from ftp_dent_ros.survey.registration import register
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult

DISTANCE, STEP = 0.8, 0.045
TOGETHER, STRIP = 3, 12
HALF_S = 500_000_000
# What an autopilot states of its poses, 3 cm and 0.9 degrees, and seconds in which it forgets.
STATED = np.diag([0.03**2] * 3 + [0.015**2] * 3)
FORGOTTEN_S = 10.0

Random = np.random.Generator


def marked_skin(rng: Random, length: float, half: float = 0.2) -> Panel:
    """Part of a fuselage along y, with dents, rivets, dirt, scratches and letters."""
    low, high = -0.6, length + 0.6
    words = Lettering(0.03, float(rng.uniform(low, high)), 'NO STEP', 0.02, (0.4,) * 3, 1.57)
    dirt = Dirt(float(rng.uniform(0.03, 0.12)), seed=int(rng.integers(1 << 30)))
    lines = scratches(int(25 * (high - low)), (-half, half, low, high), int(rng.integers(1 << 30)))
    rows = rng.uniform(0.07 - half, half - 0.07, round(10 * half))
    dents = (
        Dent(
            *rng.uniform((0.08 - half, 0), (half - 0.08, length)),
            *rng.uniform(0.015, (0.06, 0.05)),
            rng.uniform(2e-4, 1e-3),
            rng.uniform(0, 3),
        )
        for _ in range(int(30 * half * length) + 1)
    )
    return Panel(
        Pose(Rotation.identity(), np.zeros(3)),
        (-0.6, 0.6, low, high),
        float(rng.uniform(1.5, 3.0)),
        Paint(float(rng.uniform(0.4, 0.8)), roughness=0.3, marks=(*lines, words, dirt)),
        tuple(dents),
        tuple(Rivet(float(x), y) for x in rows for y in np.arange(low, high, 0.025)),
    )


def flight(rng: Random, count: int) -> list[Pose]:
    """True poses of the camera along y, with sway and wobble."""
    along = Rotation.from_euler('z', np.pi / 2)
    poses = []
    for index in range(count):
        sway, wobble = rng.normal(0, 0.006, 3), rng.normal(0, 0.008, 3)
        place = np.array([0.0, STEP * index, -DISTANCE]) + sway
        poses.append(Pose(along * Rotation.from_rotvec(wobble), place))
    return poses


def erring(rng: Random, poses: list[Pose]) -> list[Pose]:
    """What an autopilot says of poses: off by a wander as large as `STATED`."""
    keep = np.exp(-HALF_S / 1e9 / FORGOTTEN_S)
    nothing = np.zeros(6)
    error, stated = rng.multivariate_normal(nothing, STATED), []
    for pose in poses:
        new = rng.multivariate_normal(nothing, STATED)
        error = keep * error + np.sqrt(1 - keep**2) * new
        turn = Rotation.from_rotvec(error[3:])
        stated.append(Pose(turn * pose.rotation, pose.translation + error[:3]))
    return stated


@cache
def devices(code: str) -> tuple[Renderer, Reconstructor]:
    """The shipped rig and pattern, of a code."""
    rig = read_rig(find('shipped:rig.yaml'))
    pattern = replace(read_pattern(find('shipped:pattern.yaml')), code=code)
    light = Photometry(reference_distance=DISTANCE)
    return Renderer(rig, pattern.draw(), light), Reconstructor(rig, pattern, Settings(stride=2))


def seen_from(pose: Pose, panel: Panel, code: str, rng: Random) -> Cloud:
    """Cloud with its skin image from a pose."""
    renderer, reconstructor = devices(code)
    photograph = renderer.render(Surface((panel,)).transformed(pose.inverse()), rng)
    return reconstructor.measure(photograph, skin=True).cloud


def pairs(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """Neighbouring clouds laid on each other, from poses that are off."""
    rows: dict[str, Figures] = {}
    for code in CODES:
        rng = generator(seed, draw, name)
        poses, panel = flight(rng, TOGETHER), marked_skin(rng, 0.3)
        rows[code] = {}
        with attempt(rows[code]):
            patches = [patch_of(seen_from(pose, panel, code, rng)) for pose in poses]
            errors, ratios, untold = [], [], 0
            for first, second in ((0, 1), (1, 2), (0, 2)):
                true, doubt = poses[first].inverse() @ poses[second], STATED / 4
                off = rng.multivariate_normal(np.zeros(6), doubt)
                turned = Rotation.from_rotvec(off[3:]) * true.rotation
                guess = Pose(turned, true.translation + off[:3])
                found = register(patches[first], patches[second], guess, doubt)
                if found.rank < 6:
                    untold += 1
                    continue
                error = twist_between(found.pose, true, found.centre)
                stated = np.linalg.inv(found.information) + found.common @ COMMON @ found.common.T
                errors.append(np.abs(error))
                ratios.append(np.sqrt(error @ np.linalg.solve(stated, error) / 6))
            rows[code]['untold'] = untold
            if errors:
                along, normal, turn = np.split(np.array(errors), (2, 3), axis=1)
                rows[code] |= {
                    'normal_mm': MM * float(normal.mean()),
                    'along_mm': MM * float(along.mean()),
                    'turn_degrees': float(np.degrees(turn.mean())),
                    'pose_over_u': root_mean_square(ratios),
                }
    return rows


def strip(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """A strip of clouds joined; what is seen from its middle."""
    rows: dict[str, Figures] = {}
    for code in CODES:
        rng = generator(seed, draw, name)
        poses, panel = flight(rng, STRIP), marked_skin(rng, STEP * STRIP)
        stated = erring(rng, poses)
        rows[code] = {}
        with attempt(rows[code]):
            joining = Joining()
            for index, (true, said) in enumerate(zip(poses, stated, strict=True)):
                cloud = seen_from(true, panel, code, rng)
                joining.add(index * HALF_S, cloud, said, STATED)
            joining.finish()
            errors, ratios = _seen_from_the_middle(joining, poses)
            size = MM * np.linalg.norm(errors[:, :3], axis=1)
            rows[code] |= {
                'mae_mm': float(size.mean()),
                'p95_mm': float(np.percentile(size, 95)),
                'pose_over_u': root_mean_square(ratios),
                'pairs': len(joining.graph.links) - len(joining.graph.left_out),
                'left_out': len(joining.graph.left_out),
            }
    return rows


def _seen_from_the_middle(joining: Joining, poses: list[Pose]) -> tuple[NDArray, list[float]]:
    """Errors (n, 6), and over what is stated."""
    middle, graph = len(poses) // 2, joining.graph
    covariances = graph.covariances(anchor=middle)
    start, true = graph.poses[middle], poses[middle]
    errors, ratios = [], []
    for index, (found, where) in enumerate(zip(graph.poses, poses, strict=True)):
        if index != middle:
            seen, there = start.inverse() @ found, true.inverse() @ where
            shift = start.rotation.apply(seen.translation - there.translation)
            turn = start.rotation.apply((seen.rotation * there.rotation.inv()).as_rotvec())
            error = np.concatenate([shift, turn])
            errors.append(error)
            ratios.append(np.sqrt(error @ np.linalg.solve(covariances[index], error) / 6))
    return np.array(errors), ratios


# Two surveys of a fuselage of this radius, so much of it, metres; dents apart from one another.
RADIUS, SKIN, APART = 2.0, (6.0, 2.4), 0.04
DENTS, GROWN, REPAIRED, NEW = 60, 3, 2, 5
GROWTH = 5e-5
# Of a survey: places, what can be found, cells of coverage, metres; how a map walks over a metre;
# errors as parts of what is stated; the later rig sees everything larger.
PLACE, FINDABLE, CELL, DRIFT, OFF, LARGER = 2e-4, 6e-5, 0.01, 0.3e-3, 0.6, 1.003
# Of the skin about a dent: its points and their noise, metres, correlated over so many of them.
POINT, NOISE, CORRELATED = 1e-3, 3e-6, 2.5
OPEN = 'known', 'first seen', 'not seen'


def comparison(name: str, seed: int, draw: int) -> dict[str, Figures]:
    """Two surveys between which dents grow, come and are repaired: is each told right?"""
    rng = generator(seed, draw, name)
    flat: list[NDArray] = []
    while len(flat) < DENTS + NEW:
        place = rng.uniform((0.1, 0.1), np.array(SKIN) - 0.1)
        if all(np.linalg.norm(place - other) > APART for other in flat):
            flat.append(place)
    width = rng.uniform(0.015, 0.06, DENTS + NEW)
    depth = np.exp(rng.uniform(np.log(2e-4), np.log(3e-3), DENTS + NEW))
    sizes = np.stack([depth, width * rng.uniform(1, 1.8, DENTS + NEW), width], axis=1)
    number = np.arange(DENTS + NEW)
    grown, new = number < GROWN, number >= DENTS
    repaired = (number >= GROWN) & (number < GROWN + REPAIRED)
    later_sizes = sizes + GROWTH * grown[:, None] * [1, 0, 0]
    figures: Figures = {}
    with attempt(figures):
        earlier = _survey('earlier', rng, np.array(flat), sizes, ~new, 1.0)
        later = _survey('later', rng, np.array(flat), later_sizes, ~repaired, LARGER)
        seen = [{each.number for each in one.dents} for one in (earlier, later)]
        right = wrong = still_open = 0
        ratios = []
        for each in compare(earlier, later).dents:
            numbers = {d.number for d in (each.earlier, each.later) if d is not None}
            if len(numbers) > 1:
                wrong += 1
                continue
            (which,) = numbers
            if which in seen[0] and which in seen[1]:
                true = 'grown' if grown[which] else 'known'
            elif new[which] or repaired[which]:
                true = 'new' if new[which] else 'repaired'
            else:
                true = 'not seen' if which in seen[0] else 'first seen'
            right += each.status == true
            still_open += each.status != true and each.status in OPEN
            wrong += each.status != true and each.status not in OPEN
            for quantity, change in each.changes.items():
                truth = GROWTH * (grown[which] and quantity == 'depth')
                ratios.append((change.estimate.value - truth) / change.half)
        inside = float(np.mean(np.abs(ratios) < 1))
        figures |= {'right': right, 'open': still_open, 'wrong': wrong, 'within_95': inside}
    return {'sizes': figures}


def _survey(
    name: str, rng: Random, flat: NDArray, sizes: NDArray, there: NDArray, larger: float
) -> SurveyResult:
    turn = [*rng.normal(0, 0.03, 2), rng.uniform(-np.pi, np.pi)]
    pose = Pose.from_rpy(turn, rng.uniform(-20, 20, 3))
    walk, missed = _walk(rng), rng.uniform(0.5, 5.0)
    dents = []
    for index in np.flatnonzero(there & (np.abs(flat[:, 0] - missed) > 0.05)):
        place, normal = _on_fuselage(flat[index])
        place = pose.apply(place + walk(flat[index]) + rng.normal(0, PLACE, 3))
        depth, length, width = sizes[index]
        stated = 2e-7 / width, 1e-5 / width, 1e-5 / width
        estimates = (
            Estimate(float(larger * size + OFF * u * rng.normal()), float(u))
            for size, u in zip(sizes[index], stated, strict=True)
        )
        dent = _dent(
            place, pose.rotation.apply(normal), pose.rotation.apply([1.0, 0, 0]), *estimates
        )
        about = _relief(rng, depth, length, width, larger)
        dents.append(SurveyedDent(int(index), dent, np.eye(3) * 1e-6, 5, about))
    sides = (np.arange(CELL / 2, size, CELL) for size in SKIN)
    grid = np.stack(np.meshgrid(*sides, indexing='ij'), -1).reshape(-1, 2)
    grid = grid[np.abs(grid[:, 0] - missed) > 0.05]
    cells = pose.apply(_on_fuselage(grid)[0] + walk(grid)).astype(np.float32)
    findable = np.full(len(cells), FINDABLE, np.float32)
    coverage = CoverageCells(CELL, cells, findable)
    return SurveyResult(name, (), 0, 'map', tuple(dents), coverage=coverage)


def _on_fuselage(flat: NDArray) -> tuple[NDArray, NDArray]:
    """Points and outward normals of places on the unrolled skin."""
    angle = flat[..., 1] / RADIUS
    normal = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    return np.concatenate([flat[..., :1], RADIUS * normal[..., 1:]], axis=-1), normal


def _walk(rng: Random) -> Callable[[NDArray], NDArray]:
    """A random field that differs by `DRIFT` over a metre, along each axis; it walks."""
    waves = rng.normal(0, 1, (64, 2)) * np.exp(rng.uniform(-2, 1.5, (64, 1)))
    share = 1 / np.linalg.norm(waves, axis=1) ** 1.5
    probe, turn = rng.uniform(0, 5, (400, 2)), rng.uniform(0, 2 * np.pi, 400)
    beside = probe + np.stack([np.cos(turn), np.sin(turn)], -1)
    phases, signs = rng.uniform(0, 2 * np.pi, (3, 64)), rng.normal(0, 1, (3, 64)) * share

    def field(flat: NDArray) -> NDArray:
        both = zip(phases, signs, strict=True)
        return np.stack([np.sin(flat @ waves.T + phase) @ sign for phase, sign in both], -1)

    scale = DRIFT / np.std(field(beside) - field(probe))
    return lambda flat: scale * field(flat)


def _relief(rng: Random, depth: float, length: float, width: float, larger: float) -> DentRelief:
    """The skin about a dent, seen from a little beside it."""
    columns, rows = (round((0.75 * size + 0.006) / POINT) for size in (length, width))
    a, b = DentRelief(POINT, np.zeros((2 * rows + 1, 2 * columns + 1), np.float32)).places()
    x, y = (each + off for each, off in zip((a, b), rng.normal(0, PLACE, 2), strict=True))
    form = np.exp(-4 * np.log(10) * ((x / length) ** 2 + (y / width) ** 2))
    noise = gaussian_filter(rng.normal(size=a.shape), CORRELATED)
    noise *= NOISE * 2 * np.sqrt(np.pi) * CORRELATED
    heights = -(y**2) / (2 * RADIUS) - larger * depth * form + noise
    return DentRelief(POINT, heights.astype(np.float32))


def _dent(
    place: NDArray,
    normal: NDArray,
    axis: NDArray,
    depth: Estimate,
    length: Estimate,
    width: Estimate,
) -> MeasuredDent:
    """As it was measured; what a comparison does not look at is not told."""
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)[:, None]
    across = np.cross(normal, axis)
    along = length.value / 2 * np.cos(angles) * axis
    unknown, no_profile = Estimate(np.nan, np.nan), np.empty((0, 2))
    return MeasuredDent(
        'dent',
        place,
        normal,
        axis,
        depth,
        length,
        width,
        *[unknown] * 5,
        bottom_radius=np.nan,
        significance=depth.value / depth.uncertainty,
        is_cut=False,
        outline=place + along + width.value / 2 * np.sin(angles) * across,
        length_profile=no_profile,
        width_profile=no_profile,
    )
