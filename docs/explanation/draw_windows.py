"""Draws windows.png: bins, nodes and windows on fringes, and what windows let through.

python docs/explanation/draw_windows.py [PNG]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import matplotlib
import numpy as np

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH
from ftp_dent_ros.profilometry.least_squares.noise.response import Response

matplotlib.use('Agg')
from matplotlib import pyplot as plt
from matplotlib.patches import Ellipse

PERIOD = 11.7
COLUMNS, ROWS = 60, 42
BLUE, RED, GREEN = '#1f5fa8', '#c23b22', '#2e7d32'


def draw(path: Path) -> None:
    """Write the picture."""
    grid = Grid.for_fringes(COLUMNS, ROWS, PERIOD)
    figure, (image, across, passed) = plt.subplots(
        1, 3, figsize=(12.6, 4.0), width_ratios=(1.35, 1, 1), layout='constrained'
    )
    _image(image, grid)
    _profile(across)
    _response(passed)
    figure.savefig(path, dpi=100)


def _image(axes, grid: Grid) -> None:
    u, v = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    fringes = 150 + 70 * np.cos(2 * np.pi * (u + 0.12 * v - 30) / PERIOD)
    axes.imshow(fringes, cmap='gray', vmin=0, vmax=255)
    for edge in np.arange(0, COLUMNS + 1, grid.step):
        axes.axvline(edge - 0.5, color=BLUE, lw=0.7, alpha=0.9)
    for edge in np.arange(0, ROWS + 1, grid.rows):
        axes.axhline(edge - 0.5, color=BLUE, lw=0.7, alpha=0.9)
    columns, rows = grid.node_positions()
    x, y = np.meshgrid(columns, rows)
    axes.plot(x.ravel(), y.ravel(), '.', color=RED, ms=6)
    column, row = columns[len(columns) // 2], rows[len(rows) // 2]
    for sigmas, style in ((1, '-'), (2, '--')):
        size = 2 * sigmas * WIDTH * PERIOD
        axes.add_patch(Ellipse((column, row), size, size, fill=False, color=GREEN, ls=style, lw=2))
    axes.set(
        xlabel='u, pixels',
        ylabel='v, pixels',
        xlim=(-0.5, COLUMNS - 0.5),
        ylim=(ROWS - 0.5, -0.5),
        title=f'bins {grid.step} x {grid.rows} px (lines), nodes (dots), 1 and 2 s',
    )


def _profile(axes) -> None:
    sigma = WIDTH * PERIOD
    u = np.linspace(-3.2 * sigma, 3.2 * sigma, 400)

    def gaussian(width):
        return np.exp(-0.5 * (u / width) ** 2) / (width * math.sqrt(2 * math.pi))

    flat_top = 2 * gaussian(sigma) - gaussian(math.sqrt(2) * sigma)
    top = flat_top.max()
    axes.fill_between(
        u, 0.5 * top * (1 + np.cos(2 * np.pi * u / PERIOD)) / 2, color='0.88', label='fringes'
    )
    axes.plot(u, gaussian(sigma), color=GREEN, lw=2, label='Gaussian G, s = T / 2')
    axes.plot(u, flat_top, color=RED, lw=2, label='flat-top F')
    axes.axhline(0, color='0.4', lw=0.6)
    axes.set(
        xlabel='u from the node, pixels', yticks=[], title='weights', ylim=(-0.12 * top, 1.5 * top)
    )
    axes.legend(frameon=False, loc='upper right', fontsize=9)


def _response(axes) -> None:
    wavelength = np.linspace(0.5, 6, 400)  # fringes
    gaussian = np.exp(-2 * np.square(np.pi * WIDTH / wavelength))
    flat_top = 2 * gaussian - np.square(gaussian)
    together = 1 - np.square(1 - gaussian) * (1 - flat_top)
    half = float(Response(WIDTH, (1, 1), 4).wavelength(np.float32(0)))
    axes.plot(wavelength, gaussian, color=GREEN, lw=2, label='one Gaussian fit')
    axes.plot(wavelength, flat_top, color=RED, lw=2, label='one flat-top fit')
    axes.plot(wavelength, together, color=BLUE, lw=2, label='two Gaussian fits and a flat-top')
    axes.plot([half, half, 0.5], [0, 0.5, 0.5], color='0.4', lw=0.8, ls='--')
    axes.annotate(f'resolution: {half:.2f} fringes', (half + 0.1, 0.04), fontsize=9)
    axes.set(
        xlabel="a wave's length, fringes",
        title="share of a wave's height that is left",
        ylim=(0, 1.05),
        xlim=(0.5, 6),
    )
    axes.legend(frameon=False, loc='lower right', fontsize=9, bbox_to_anchor=(1, 0.1))


if __name__ == '__main__':
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name('windows.png'))
