"""From correspondences to a rig: start, adjust, choose the terms, hold out, say how good it is."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ftp_dent_ros import __version__
from ftp_dent_ros.calibration.adjustment.bundle import Estimate, adjust
from ftp_dent_ros.calibration.adjustment.gross_errors import (
    refuse_hopeless,
    refuse_wrong_scale,
    without_bad_poses,
)
from ftp_dent_ros.calibration.adjustment.holding_out import HeldOut, hold_out
from ftp_dent_ros.calibration.adjustment.model import SHAPES, Model
from ftp_dent_ros.calibration.adjustment.selection import candidates, select
from ftp_dent_ros.calibration.adjustment.start import first_rig
from ftp_dent_ros.calibration.adjustment.uncertainty import covariance
from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.calibration.observing.observation import Observation
from ftp_dent_ros.errors import RigError
from ftp_dent_ros.rig.calibration_record import CalibrationRecord
from ftp_dent_ros.rig.geometry import check_geometry
from ftp_dent_ros.rig.rig import Rig

# A corner this many deviations off is named.
_OUTLIER = 6.0


@dataclass(frozen=True, eq=False)
class Solution:
    """A calibrated rig and what is known about it.

    Attributes
    ----------
    rig : Rig
        With its record and covariance.
    estimate : Estimate
    model : Model
    scores : dict
        Cross-validation's, by candidate.
    observations : list of Observation
        Those that were used, in the order of `estimate`'s poses.
    excluded : dict of str to str
        Poses left out, and why.
    outliers : list of str
        Corners far off, in words.
    held_out : HeldOut or None
        None if there were too few poses.
    remarks : list of str
    """

    rig: Rig
    estimate: Estimate
    model: Model
    scores: dict[Model, float]
    board: Board
    observations: list[Observation]
    held_out: HeldOut | None
    excluded: dict[str, str] = field(default_factory=dict)
    outliers: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def solve(
    observations: list[Observation],
    board: Board,
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
    baseline: float = 0.0,
    model: Model | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Solution:
    """Calibrate a rig.

    Parameters
    ----------
    observations : list of Observation
        Of this tool or any other.
    board : Board
    camera_size, projector_size : (int, int)
        Width and height, pixels.
    baseline : float
        Distance between the two lenses by the tape, metres; 0 if it was not measured. Nothing
        else tells a wrong size of the squares.
    model : Model, optional
        The terms to estimate; chosen by cross-validation if left out.
    progress : callable
        Told after each of `STEPS` steps.

    Raises
    ------
    CalibrationError
        The observations give no rig; the message says what is wrong with them.
    """
    used = list(observations)
    points = board.points
    start, poses = first_rig(used, points, camera_size, projector_size)
    progress('start')
    estimate = adjust(used, points, start, poses, Model())
    used, estimate, excluded = without_bad_poses(used, points, estimate)
    progress('all poses')
    refuse_hopeless(estimate)
    refuse_wrong_scale(estimate.rig, baseline)
    # A board that looks the same upside down has no shape that could be told from its mirror.
    shapes = SHAPES if board.dictionary or (board.columns + board.rows) % 2 else SHAPES[:2]
    scores: dict[Model, float] = {}
    if model is None:
        model, scores = select(used, points, estimate, Model(), shapes, progress)
    estimate = adjust(used, points, estimate.rig, estimate.poses, model)
    progress('final')
    checked = hold_out(used, points, estimate, model)
    progress('held out')
    record = _record(estimate, board, checked)
    rig = replace(estimate.rig, record=replace(record, id=estimate.rig.id))
    return Solution(
        rig,
        estimate,
        model,
        scores,
        board,
        used,
        checked,
        excluded,
        _outliers(used, estimate),
        _remarks(estimate, baseline, checked),
    )


STEPS = 4 + candidates(SHAPES)


def _record(estimate: Estimate, board: Board, checked: HeldOut | None) -> CalibrationRecord:
    names = ('camera', 'projector', 'joint')
    kind = f'ChArUco {board.dictionary}' if board.dictionary else 'chessboard'
    places = np.concatenate(
        [
            Rotation.from_rotvec(pose[:3]).apply(estimate.shape) + pose[3:]
            for pose in estimate.poses
        ]
    )
    now = datetime.datetime.now(datetime.timezone.utc)
    return CalibrationRecord(
        id='',
        date=now.strftime('%Y-%m-%dT%H:%M:%SZ'),
        tool=f'ftp-dent calibrate solve {__version__}',
        board=f'{kind}, {board.columns}x{board.rows} inner corners, {1e3 * board.square:g} mm',
        poses=len(estimate.poses),
        rms_px=dict(zip(names, estimate.rms(), strict=True)),
        held_out_rms_px=dict(zip(names, checked.rms, strict=True)) if checked else {},
        depth_range=(float(places[:, 2].min()), float(places[:, 2].max())),
        covariance=covariance(estimate),
    )


def _outliers(used: list[Observation], estimate: Estimate) -> list[str]:
    words = []
    for observation, residuals in zip(used, estimate.residuals, strict=True):
        for part, deviation, word in (
            (slice(0, 2), estimate.deviations[0], 'seen'),
            (slice(2, 4), estimate.deviations[1], 'lit'),
        ):
            off = np.linalg.norm(residuals[:, part], axis=1)
            words += [
                f'{observation.name}: corner {corner} is {word} {off[corner]:.2f} pixels off '
                f'({off[corner] / deviation:.0f} standard deviations)'
                for corner in np.flatnonzero(off > _OUTLIER * deviation)
            ]
    return words


def _remarks(estimate: Estimate, baseline: float, checked: HeldOut | None) -> list[str]:
    remarks = []
    try:
        check_geometry(estimate.rig)
    except RigError as reason:
        remarks.append(f'this rig is known now, but it cannot measure: {reason}')
    if not baseline:
        found = 1e3 * float(np.linalg.norm(estimate.rig.translation))
        remarks.append(
            f'the lenses come out {found:.0f} mm apart: check it with a tape, for nothing else '
            'tells a wrong size of the squares (--baseline does it for you)'
        )
    if checked is None:
        remarks.append('too few poses to hold half of them out: take 15')
    tilts = np.degrees(np.linalg.norm(estimate.poses[:, :2], axis=1))
    if np.median(tilts) < 10:
        remarks.append('the board was hardly tilted: tilt it by 20 to 35 degrees')
    return remarks
