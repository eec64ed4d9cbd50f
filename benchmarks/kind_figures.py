"""What a method makes of a photograph, against its truth: figures, and whether they will do."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from attempts import attempt
from kind_scenes import KindScene
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Inspection, MeasuredDent
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.ground_truth import GroundTruth
from ftp_dent_ros.simulation.truth import TrueDent, match_truth, true_dents

METHODS = 'default', 'virtual-reference'
# Fringes from an edge within which errors are told apart.
EDGE = 2.0
# A wrong point, metres.
WRONG = 1e-4
# What stands beside a fitting is looked at apart, metres.
_BESIDE = 0.006


@dataclass
class DentFigures:
    """One true dent: the cloud at its centre, and what the inspection says. Millimetres."""

    kind: str
    depth: float
    length: float
    width: float
    # At the centre, mean over a twentieth of the width: the cloud's error, and its sigma.
    cloud_error: float = math.nan
    cloud_sigma: float = math.nan
    found: bool = False
    depth_error: float = math.nan
    depth_u: float = math.nan
    length_error: float = math.nan
    length_u: float = math.nan
    width_error: float = math.nan
    width_u: float = math.nan
    found_kind: str = ''


@dataclass
class Figures:
    """One photograph by one method."""

    kind: str
    seed: int
    method: str
    refused: str = ''
    crashed: str = ''
    area: float = math.nan  # lit, square metres
    coverage: float = math.nan
    outside: int = 0
    mae: float = math.nan  # mm
    wrong: float = math.nan  # share of points beyond `WRONG`
    # Error over sigma: standard deviation, and share below 4; all points, and those at edges.
    spread: float = math.nan
    below4: float = math.nan
    edge_spread: float = math.nan
    edge_below4: float = math.nan
    edge_count: int = 0
    dents: list[DentFigures] = field(default_factory=list)
    false_dents: list[str] = field(default_factory=list)
    false_bumps: list[str] = field(default_factory=list)
    on_fittings: int = 0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def figures(
    name: str, scene: KindScene, truth: GroundTruth, method: str, seed: int, stride: int
) -> Figures:
    """Reconstruct and inspect a photograph by a method of `METHODS`."""
    result = Figures(name, seed, method)
    photograph = scene.taken(seed)

    def measured() -> Cloud:
        measure = reconstructor(scene.rig, scene.pattern, method, stride).measure
        return measure(photograph, True).cloud

    cloud = attempt(measured, result)
    if cloud is None:
        return result
    _points(result, cloud, truth)
    true = visible(scene, truth, stride)
    result.dents = [measured_dent(scene, each, cloud, stride) for each in true]
    found = attempt(lambda: inspect(cloud), result)
    if found is None:
        return result
    _match(result, scene, truth, stride, found)
    return result


def reconstructor(rig: Rig, pattern: Pattern, method: str, stride: int) -> Reconstructor:
    """One of the methods of `METHODS`."""
    settings = {
        'default': Settings(stride=stride),
        'virtual-reference': Settings('virtual-reference', stride=stride),
    }[method]
    return Reconstructor(rig, pattern, settings)


def _points(result: Figures, cloud: Cloud, truth: GroundTruth) -> None:
    """Coverage and errors of the points."""
    on = cloud.valid & truth.lit
    result.area = truth.lit_area
    result.coverage = float(on.sum() / max(truth.lit.sum(), 1))
    result.outside = int((cloud.valid & ~truth.lit).sum())
    if not on.any():
        return
    error = ((cloud.points[..., 2] - truth.depth) * truth.along_ray)[on]
    result.mae = float(1e3 * np.abs(error).mean())
    result.wrong = float((np.abs(error) > WRONG).mean())
    sigma = cloud.sigma[on]
    if not np.isfinite(sigma).any():
        return
    ratio = error / sigma
    at_edge = truth.nearest_edge[on] < EDGE
    result.spread, result.below4 = _spread(ratio)
    result.edge_spread, result.edge_below4 = _spread(ratio[at_edge])
    result.edge_count = int(at_edge.sum())


def _spread(ratio: NDArray) -> tuple[float, float]:
    """Root mean square about 0, and share below 4."""
    ratio = ratio[~np.isnan(ratio)]
    if not len(ratio):
        return math.nan, math.nan
    return float(np.sqrt(np.mean(ratio * ratio))), float((np.abs(ratio) < 4).mean())


def visible(scene: KindScene, truth: GroundTruth, stride: int) -> list[TrueDent]:
    """True dents whose whole 10 % contour is lit, and in view."""
    shown = []
    for true in true_dents(scene.surface):
        pixels = np.rint(scene.rig.camera.project(true.outline) / stride).astype(int)
        inside = (pixels >= 0).all() and (pixels < np.array(truth.lit.shape)[::-1]).all()
        if inside and truth.lit[pixels[:, 1], pixels[:, 0]].mean() > 0.99:
            shown.append(true)
    return shown


def measured_dent(scene: KindScene, true: TrueDent, cloud: Cloud, stride: int) -> DentFigures:
    """The cloud about a dent's deepest point."""
    row = DentFigures(true.kind, 1e3 * true.depth, 1e3 * true.length, 1e3 * true.width)
    bottom = true.position - true.depth * true.normal
    column, line = scene.rig.camera.project(bottom) / stride
    focal = scene.rig.camera.camera_matrix[0, 0] / stride
    reach = max(1.0, 0.05 * true.width * focal / bottom[2])
    rows, columns = np.mgrid[: cloud.valid.shape[0], : cloud.valid.shape[1]]
    near = (np.hypot(rows - line, columns - column) <= reach) & cloud.valid
    if near.any():
        points = cloud.points[near].astype(float)
        row.cloud_error = float(1e3 * scene.surface.distance(points).mean())
        row.cloud_sigma = float(1e3 * np.sqrt(np.mean(cloud.sigma[near].astype(float) ** 2)))
    return row


def _match(
    result: Figures, scene: KindScene, truth: GroundTruth, stride: int, found: Inspection
) -> None:
    """True dents to those found; the rest is false."""
    true = visible(scene, truth, stride)
    everything = [m for m in (*found.dents, *found.others) if m.kind != 'step']
    pairs = match_truth(
        [m.position for m in everything],
        [t.position for t in true],
        [max(0.010, t.length / 2) for t in true],
    )
    for i, j in pairs.items():
        _compare(result.dents[i], true[i], everything[j])
    places = _fittings(scene)
    dents_cut = [t.position for t in true_dents(scene.surface)]
    for j, m in enumerate(everything):
        if j in pairs.values() or m.kind == 'other':
            continue
        text = f'{m.kind} {1e3 * m.depth.value:.3f}+-{1e3 * m.depth.uncertainty:.3f} mm'
        text += f' at {np.round(1e3 * m.position[:2]).astype(int).tolist()}'
        if any(np.linalg.norm(m.position - place) < reach for place, reach in places):
            result.on_fittings += 1
        elif any(np.linalg.norm(m.position - place) < 0.03 for place in dents_cut):
            # Part of a dent that is cut by the view, or of one that was found already.
            continue
        elif m.kind == 'bump':
            result.false_bumps.append(text)
        else:
            result.false_dents.append(text)


def _compare(row: DentFigures, true: TrueDent, m: MeasuredDent) -> None:
    row.found, row.found_kind = True, m.kind
    row.depth_error = 1e3 * (m.depth.value - true.depth)
    row.depth_u = 1e3 * m.depth.uncertainty
    if m.is_cut:
        return
    row.length_error = 1e3 * (m.length.value - true.length)
    row.length_u = 1e3 * m.length.uncertainty
    row.width_error = 1e3 * (m.width.value - true.width)
    row.width_u = 1e3 * m.width.uncertainty


def _fittings(scene: KindScene) -> list[tuple[NDArray, float]]:
    """Where fittings are in the camera's frame, and how far around them."""
    places = []
    for panel in scene.panels:
        for fitting in panel.rivets:
            at = np.array([fitting.x]), np.array([fitting.y])
            height, _, _ = panel.bare_height(*at)
            place = panel.pose.apply(np.array([fitting.x, fitting.y, height[0]]))
            places.append((place, fitting.reach + _BESIDE))
    return places
