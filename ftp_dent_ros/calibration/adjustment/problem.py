"""The least-squares problem of a calibration: residuals and their sparse Jacobian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.adjustment.model import DISTORTIONS, LENS, RIG, Model
from ftp_dent_ros.calibration.adjustment.projection import cross_matrices, left_jacobian, project
from ftp_dent_ros.calibration.observing.observation import Observation
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.robust import NORMAL_SPREAD

# What a print or a plate may be off without being another board; metres, standard deviation.
_FREEDOM = 0.0003
# Before anything is known, pixels, standard deviation of camera and projector.
FIRST_DEVIATIONS = (0.3, 0.3)
_LEAST_DEVIATION = 0.005


class Problem:
    """Residuals and their sparse Jacobian over the active ones of all parameters."""

    def __init__(
        self,
        observations: list[Observation],
        board: NDArray[np.float64],
        start: Rig,
        model: Model,
        free: str,
        shape: NDArray[np.float64] | None,
    ) -> None:
        self.board = board
        self.count = len(observations)
        self.observed = np.concatenate([np.hstack([o.camera, o.projector]) for o in observations])
        self.pose_of = np.repeat(np.arange(self.count), len(board))
        self.corner_of = np.tile(np.arange(len(board)), self.count)
        self.known = np.isfinite(self.observed)
        self.deviations = FIRST_DEVIATIONS
        self.model = model
        half = np.abs(board[:, :2] - board[:, :2].mean(axis=0)).max(axis=0)
        x, y = ((board[:, :2] - board[:, :2].mean(axis=0)) / half).T
        terms = {'flat': 0, 'bent': 3, 'free': board.size}[model.shape]
        # d corner / d shape parameter, shape (n, 3, terms).
        self.give = np.zeros((len(board), 3, terms))
        if model.shape == 'bent':
            self.give[:, 2] = np.stack([x * x, x * y, y * y], axis=1)
        elif model.shape == 'free':
            self.give[:] = np.eye(board.size).reshape(len(board), 3, board.size)
        self.start_shape: NDArray[np.floating] = np.zeros(terms)
        if shape is not None and terms:
            flat = self.give.reshape(-1, terms)
            self.start_shape = np.linalg.lstsq(flat, (shape - board).ravel(), rcond=None)[0]
        elif shape is not None:
            self.board = shape
        active: list[int] = []
        if free == 'rig':
            for offset, terms_of in ((0, model.camera), (LENS, model.projector)):
                active += [offset + i for i in range(4)]
                active += [offset + 4 + i for i in DISTORTIONS[terms_of]]
        if free in ('rig', 'pose'):
            active += range(18, 24)
        active += range(RIG, RIG + 6 * self.count)
        first = RIG + 6 * self.count
        if free == 'rig':
            active += range(first, first + terms)
        self.active = np.array(active)
        self.place = np.full(first + terms, -1)
        self.place[self.active] = np.arange(len(self.active))

    def whole(self, active: NDArray, vector: NDArray) -> NDArray[np.float64]:
        """All parameters: those of `vector`, the active ones replaced."""
        whole = vector.copy()
        whole[self.active] = active
        return whole

    def residuals(self, active: NDArray, vector: NDArray) -> NDArray[np.float64]:
        """Modelled less observed coordinates in standard deviations, then what is known before."""
        whole = self.whole(active, vector)
        difference = self.modelled(whole)[0] - self.observed
        weighted = (difference / np.repeat(self.deviations, 2))[self.known]
        if self.model.shape == 'free':
            weighted = np.concatenate([weighted, whole[RIG + 6 * self.count :] / _FREEDOM])
        return weighted

    def jacobian(self, active: NDArray, vector: NDArray) -> csr_matrix:
        """Derivatives of `residuals` by the active parameters."""
        whole = self.whole(active, vector)
        _, parts = self.modelled(whole, derivatives=True)
        row_of = np.full(self.known.shape, -1)
        row_of[self.known] = np.arange(self.known.sum())
        rows, columns, values = [], [], []
        for components, indices, derivative in parts:
            # derivative: (observations, 2, k), indices: (observations, k)
            scale = 1 / self.deviations[components.start // 2]
            row = np.broadcast_to(row_of[:, components, None], derivative.shape)
            column = np.broadcast_to(self.place[indices][:, None], derivative.shape)
            kept = (row >= 0) & (column >= 0) & (derivative != 0)
            rows.append(row[kept])
            columns.append(column[kept])
            values.append(derivative[kept] * scale)
        height = int(self.known.sum())
        if self.model.shape == 'free':
            place = self.place[RIG + 6 * self.count :]
            kept_places = place >= 0
            rows.append(height + np.flatnonzero(kept_places))
            columns.append(place[kept_places])
            values.append(np.full(kept_places.sum(), 1 / _FREEDOM))
            height += len(place)
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return csr_matrix(entries, shape=(height, len(self.active)))

    def modelled(self, whole: NDArray, derivatives: bool = False):
        """Pixels of every corner in every pose, shape (poses * n, 4), and their derivatives."""
        first = RIG + 6 * self.count
        corners = self.board + self.give @ whole[first:]
        poses = whole[RIG:first].reshape(-1, 6)
        turns = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        turned = np.einsum('pij,nj->pni', turns, corners).reshape(-1, 3)
        in_camera = turned + poses[self.pose_of, 3:]
        rig_turn = Rotation.from_rotvec(whole[18:21]).as_matrix()
        rig_turned = in_camera @ rig_turn.T
        in_projector = rig_turned + whole[21:24]
        pixels = np.empty((len(turned), 4))
        parts = []
        for points, offset, components in (
            (in_camera, 0, slice(0, 2)),
            (in_projector, LENS, slice(2, 4)),
        ):
            part = whole[offset : offset + LENS]
            pixel, by_point, by_lens = project(points, part)
            pixels[:, components] = pixel
            if not derivatives:
                continue
            count = len(points)
            indices = np.broadcast_to(np.arange(offset, offset + LENS), (count, LENS))
            parts.append((components, indices, by_lens))
            by_camera_point = by_point
            if offset:
                by_turn = by_point @ (-cross_matrices(rig_turned) @ left_jacobian(whole[18:21]))
                indices = np.broadcast_to(np.arange(18, 24), (count, 6))
                parts.append((components, indices, np.concatenate([by_turn, by_point], axis=2)))
                by_camera_point = by_point @ rig_turn
            jacobians = np.stack([left_jacobian(pose[:3]) for pose in poses])
            by_rotation = by_camera_point @ (-cross_matrices(turned) @ jacobians[self.pose_of])
            indices = RIG + 6 * self.pose_of[:, None] + np.arange(6)
            parts.append(
                (components, indices, np.concatenate([by_rotation, by_camera_point], axis=2))
            )
            if self.model.shape != 'flat':
                by_corner = by_camera_point @ turns[self.pose_of]
                if self.model.shape == 'free':
                    indices = first + 3 * self.corner_of[:, None] + np.arange(3)
                    parts.append((components, indices, by_corner))
                else:
                    terms = self.give.shape[2]
                    indices = np.broadcast_to(np.arange(first, first + terms), (count, terms))
                    parts.append((components, indices, by_corner @ self.give[self.corner_of]))
        return pixels, parts

    def spread(self, vector: NDArray) -> tuple[float, float]:
        """Robust standard deviation of camera and projector coordinates, pixels."""
        difference = self.modelled(vector)[0] - self.observed
        spent = len(self.active) / max(int(self.known.sum()), 1)
        result = []
        for part in (slice(0, 2), slice(2, 4)):
            known = np.abs(difference[:, part][self.known[:, part]])
            deviation = (
                NORMAL_SPREAD * float(np.median(known)) if len(known) else FIRST_DEVIATIONS[0]
            )
            result.append(max(_LEAST_DEVIATION, deviation / np.sqrt(max(1 - spent, 0.1))))
        return result[0], result[1]
