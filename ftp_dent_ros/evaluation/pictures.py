"""The paper's figures, drawn of what came out here."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
import scipy.fft
from matplotlib.figure import Figure

from ftp_dent_ros.evaluation.scenes import PATTERN, Scene
from ftp_dent_ros.evaluation.study import Entry
from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fourier_transform.reference import reference_phase

_MM = 1e3
_NOTHING = '0.85'


def error_maps(entries: Sequence[Entry]) -> bytes:
    """Absolute errors of methods side by side, each to its own scale (figures 12, 13, 16, 17)."""
    figure = Figure(figsize=(4.2 * len(entries), 3.0), layout='constrained')
    for axes, entry in zip(_row(figure, len(entries)), entries, strict=True):
        axes.set_title(entry.method.name, fontsize=9)
        axes.set_axis_off()
        error = entry.first.error_mm
        if error is None:
            axes.text(0.5, 0.5, 'refused: no fringe order\nthat the stripe agrees on', ha='center')
            continue
        error = np.abs(_cropped(error))
        colours = matplotlib.colormaps['viridis'].copy()
        colours.set_bad(_NOTHING)
        limit = float(np.nanpercentile(error, 99))
        image = axes.imshow(error, cmap=colours, vmin=0, vmax=limit, interpolation='nearest')
        scale = figure.colorbar(image, ax=axes, shrink=0.85)
        scale.set_label(f'mm; MAE {np.nanmean(error):.3g}', fontsize=8)
        scale.ax.tick_params(labelsize=7)
    return _png(figure)


def sections(entries: Sequence[Entry]) -> bytes:
    """Depth and its error along the row through the dent's middle (figure 15)."""
    figure = Figure(figsize=(4.2 * len(entries), 4.2), layout='constrained')
    upper, lower = figure.subplots(2, len(entries), sharex=True, squeeze=False)
    limit = 0.0
    for above, below, entry in zip(upper, lower, entries, strict=True):
        above.set_title(entry.method.name, fontsize=9)
        cloud, error = entry.first.cloud, entry.first.error_mm
        if cloud is None or error is None:
            continue
        along, across = entry.case.scene.on_panel(cloud.points)
        points = cloud.valid.sum(axis=1)
        off = np.where(cloud.valid, np.abs(across), 0).sum(axis=1) / np.maximum(points, 1)
        row = np.where(points > 0, off, np.inf).argmin()
        x = along[row] * _MM
        local = entry.case.scene.panel.pose.inverse().apply(cloud.points[row].astype(float))
        depth = local[:, 2] * _MM
        truth, _, _ = entry.case.scene.dent.height(local[:, 0], local[:, 1])
        above.plot(x, -depth, linewidth=1.0, label='measured')
        above.plot(x, -_MM * truth, 'k--', linewidth=0.8, label='truth')
        below.plot(x, error[row], linewidth=0.6)
        below.set_xlabel('along the panel, mm', fontsize=8)
        limit = max(limit, float(np.nanpercentile(np.abs(error[row]), 99.5)))
    if limit:
        for below in lower:
            below.set_ylim(-1.2 * limit, 1.2 * limit)
        upper[0].legend(fontsize=8)
    upper[0].set_ylabel('height, mm', fontsize=8)
    lower[0].set_ylabel('error, mm', fontsize=8)
    return _png(figure)


def spectrum(scene: Scene) -> bytes:
    """Spectra of the middle row, of the object and of the virtual reference (figure 3)."""
    red = scene.photograph(0)[..., 0].astype(float)
    plane = ReferencePlane(float(scene.panel.pose.translation[2]))
    carrier = carrier_on(scene.rig, PATTERN, plane)
    middle = red.shape[0] // 2
    lit = np.flatnonzero(scene.lit()[middle] & (red[middle] > 0))
    columns = slice(lit[0], lit[-1] + 1)
    rays = scene.rig.camera.rays(scene.rig.camera.pixel_grid())[middle, columns]
    reference = 0.5 + 0.5 * np.cos(reference_phase(scene.rig, PATTERN, rays[None], plane))[0]
    reference *= red[middle, columns].mean() / reference.mean()
    figure = Figure(figsize=(7, 3), layout='constrained')
    axes = figure.add_subplot()
    for values, style, label in (
        (red[middle, columns], 'b-', 'object'),
        (reference, 'r:', 'virtual reference'),
    ):
        frequency = scipy.fft.rfftfreq(len(values))
        axes.semilogy(frequency, np.abs(scipy.fft.rfft(values)), style, linewidth=0.8, label=label)
    axes.axvline(carrier.frequency, color='k', linewidth=0.8, label='carrier and band')
    for side in (-1, 1):
        axes.axvline(carrier.frequency + side * carrier.radius, color='k', ls=':', linewidth=0.8)
    axes.set(xlabel='cycles a pixel', ylabel='modulus', xlim=(0, 3 * carrier.frequency))
    axes.legend(fontsize=8)
    return _png(figure)


def _row(figure: Figure, count: int) -> Sequence[Any]:
    return figure.subplots(1, count, squeeze=False)[0]


def _cropped(error):
    """The part of the image that holds points."""
    rows, columns = (np.flatnonzero(np.isfinite(error).any(axis=axis)) for axis in (1, 0))
    return error[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=110)
    return stream.getvalue()
