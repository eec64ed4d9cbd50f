"""A calibration as one page that opens offline."""

from __future__ import annotations

from pathlib import Path

import jinja2
import numpy as np

from ftp_dent_ros.calibration.adjustment.bundle import rms
from ftp_dent_ros.calibration.adjustment.model import DISTORTIONS, rig_vector
from ftp_dent_ros.calibration.adjustment.solving import Solution
from ftp_dent_ros.calibration.reporting import pictures
from ftp_dent_ros.calibration.reporting.opencv import OpenCvResult, calibrate_with_opencv
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.rig.calibration_record import PARAMETERS

_COEFFICIENTS = ('k1', 'k2', 'p1', 'p2', 'k3')
_SHAPES = {
    'flat': 'the board is flat',
    'bent': 'the board is bent (a quadratic)',
    'free': "each of the board's corners has its own place",
}


def write_page(path: Path, solution: Solution, left_out: list[str]) -> None:
    """Write the page of a solution; `left_out` are sentences on poses that were not used."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('ftp_dent_ros.calibration', 'templates'),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    compared = calibrate_with_opencv(solution)
    text = environment.get_template('page.html.j2').render(
        rig=solution.rig,
        record=solution.rig.record,
        remarks=solution.remarks,
        errors=_errors(solution, compared),
        numbers=_numbers(solution, compared),
        terms=_terms(solution),
        depth=depth_words(solution),
        poses=_poses(solution),
        excluded=left_out,
        outliers=solution.outliers,
        pictures={
            'residuals': pictures.residual_maps(solution),
            'coverage': pictures.coverage(solution),
            'expected': pictures.expected_depth(solution),
        },
    )
    with written_aside(path) as aside:
        aside.write_text(text, encoding='utf-8', errors='backslashreplace')


def depth_words(solution: Solution) -> str:
    """What the held-out poses say of depths, beside what the covariance states."""
    checked = solution.held_out
    if checked is None:
        return 'Too few poses to hold any out.'
    error = 1e3 * checked.depth_errors
    return (
        f'Corners of held-out poses, triangulated from their columns alone as in flight, lie '
        f'{np.sqrt(np.mean(error**2)):.3f} mm (RMS) off their board, {np.mean(error):+.3f} mm in '
        f'the mean, at {1e3 * checked.depths.min():.0f} to {1e3 * checked.depths.max():.0f} mm; '
        "this has the corners' own noise in it."
    )


def _errors(solution: Solution, compared: OpenCvResult | None) -> list[tuple[str, list[str]]]:
    rows = [('all poses', [f'{value:.3f}' for value in solution.estimate.rms()])]
    checked = solution.held_out
    if checked is not None:
        rows.append(('held out', [f'{value:.3f}' for value in checked.rms]))
        rows.append(('predicted', ['', '', f'{checked.stereo_rms:.3f}']))
    if compared is not None:
        rows.append(('OpenCV', [f'{value:.3f}' for value in compared.rms]))
    return rows


def _numbers(solution: Solution, compared: OpenCvResult | None) -> list[list[str]]:
    ours, record = rig_vector(solution.rig), solution.rig.record
    theirs = rig_vector(compared.rig) if compared else np.full(len(ours), np.nan)
    variance = np.full(len(ours), np.nan)
    if record is not None and record.covariance is not None:
        variance = np.diag(record.covariance)
    rows = []
    for name, value, square, other in zip(PARAMETERS, ours, variance, theirs, strict=True):
        digits = 2 if name[-3:] in ('f_x', 'f_y', 'c_x', 'c_y') else 5
        deviation = f'{np.sqrt(square):.{digits}f}' if square > 0 else 'not estimated'
        rows.append([name, f'{value:.{digits}f}', deviation, f'{other:.{digits}f}'])
    lengths = [1e3 * np.linalg.norm(vector[21:]) for vector in (ours, theirs)]
    slope = ours[21:] / np.linalg.norm(ours[21:])
    deviation = ''
    if record is not None and record.covariance is not None:
        deviation = f'{1e3 * np.sqrt(slope @ record.covariance[21:, 21:] @ slope):.3f}'
    rows.append(['baseline, mm', f'{lengths[0]:.3f}', deviation, f'{lengths[1]:.3f}'])
    return rows


def _terms(solution: Solution) -> str:
    words = []
    for name, index in (
        ('camera', solution.model.camera),
        ('projector', solution.model.projector),
    ):
        names = ', '.join(_COEFFICIENTS[i] for i in DISTORTIONS[index]) or 'none'
        words.append(f'{name} {names}')
    bend = 1e3 * float(np.abs(solution.estimate.shape[:, 2]).max())
    shape = _SHAPES[solution.model.shape]
    if solution.model.shape != 'flat':
        shape += f', by up to {bend:.2f} mm'
    return '; '.join([*words, shape])


def _poses(solution: Solution) -> list[list[str]]:
    rows = []
    for observation, residuals in zip(
        solution.observations, solution.estimate.residuals, strict=True
    ):
        camera, projector, both = rms([residuals])
        seen, lit = (
            int(np.isfinite(each).all(axis=1).sum())
            for each in (observation.camera, observation.projector)
        )
        rows.append(
            [
                observation.name,
                *(
                    f'{value:.3f}' if np.isfinite(value) else ''
                    for value in (camera, projector, both)
                ),
                str(seen),
                str(lit),
            ]
        )
    return rows
