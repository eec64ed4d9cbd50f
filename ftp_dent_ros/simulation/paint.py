"""How a panel reflects light: its paint, the marks on it, sun on parts of it, a board's print."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.fields import (
    Checked,
    Colour,
    Count,
    Limits,
    NotNegative,
    Numbers,
    Pair,
    Positive,
    Quadruple,
    Reflectance,
    Share,
    Triple,
)
from ftp_dent_ros.simulation.dents import turned
from ftp_dent_ros.simulation.sensor import Image

# Grains of a noise before it repeats (at 4 mm half a metre), and samples a grain: OpenCV 4 rounds
# positions to 1/32 of a sample.
_GRAINS = 128
_FINE = 8
# Pixels of a letter's height: 0.1 mm of a letter of 20 mm.
LETTER = 200
# Of the images that lists of positions are made into.
_COLUMNS = 4096

# Standard deviations that 99 % of a normal distribution lie within.
_WITHIN = 2.576

# Reflectance of clear varnish (refractive index 1.5) at normal incidence.
_VARNISH = 0.04

# Half the narrowest ramp, metres: an edge is never sharper than a tenth of a millimetre.
_SHARP = 5e-5


def noise(seed: int, octave: int, u: Image, v: Image) -> Image:
    """Smooth noise of mean 0 and variance 1 with grains one unit wide."""
    # OpenCV cannot wrap a map of positions: the field has a rim.
    # Less whole repetitions: to the last bit as np.mod of float32, in a tenth of its time.
    column, row = ((at - _GRAINS * np.floor(at / _GRAINS)) * _FINE for at in (u, v))
    return sampled(_grains(seed, octave), column, row)


@lru_cache(maxsize=16)
def _grains(seed: int, octave: int) -> Image:
    """A noise at `_FINE` samples a unit, its first column and row repeated at the end."""
    size = _GRAINS * _FINE
    white = np.random.default_rng([seed, octave]).standard_normal((size, size), np.float32)
    rim = 4 * _FINE
    padded = np.pad(white, rim, mode='wrap')
    # The correlation of white noise blurred by sigma is half at a distance of 1.67 sigma.
    smooth = cv2.GaussianBlur(padded, (0, 0), (0.5 / 1.665) * _FINE)[rim : 1 - rim, rim : 1 - rim]
    return (smooth - smooth.mean()) / smooth.std()


@lru_cache(maxsize=8)
def letters_of(text: str) -> Image:
    """Cover of a line of text, 0 to 1, capitals `LETTER` pixels high and in the middle."""
    # OpenCV's versions draw other fonts under one name: measured on what is drawn.
    capital = np.flatnonzero(_drawn('H').any(axis=1))
    size = LETTER / len(capital)
    canvas = _drawn(text)
    above, below = capital[0], len(canvas) - 1 - capital[-1]
    rim = ((max(below - above, 0), max(above - below, 0)), (0, 0))
    letters: Image = cv2.resize(np.pad(canvas, rim), None, fx=size, fy=size)
    return letters.astype(np.float32) / 255


def _drawn(text: str) -> NDArray[np.uint8]:
    """A line of text with room around it; its height does not depend on the letters."""
    font, scale, thickness = cv2.FONT_HERSHEY_DUPLEX, 8.0, 24
    (_, height), below = cv2.getTextSize('H', font, scale, thickness)
    (width, _), _ = cv2.getTextSize(text, font, scale, thickness)
    room = below + thickness
    canvas = np.zeros((height + 2 * room, width + 2 * thickness), np.uint8)
    cv2.putText(canvas, text, (thickness, height + room), font, scale, 255, thickness, cv2.LINE_AA)
    return canvas


def sampled(field: Image, column: Image, row: Image) -> Image:
    """Linear interpolation of a field, of channels or not, 0 around it, at positions."""
    # OpenCV limits a side to 32767: a list is made an image.
    count = column.size
    shape, width = column.shape, min(max(count, 1), _COLUMNS)
    places = np.full((2, -(-count // width) * width), -2.0, np.float32)
    places[:, :count] = column.ravel(), row.ravel()
    column, row = places.reshape(2, -1, width)
    values = cv2.remap(field, column, row, cv2.INTER_LINEAR, borderValue=0)
    channels = field.shape[2:]
    return values.reshape(-1, *channels)[:count].reshape(*shape, *channels)


@dataclass(frozen=True)
class Dirt(Checked):
    """Smooth random albedo of several scales, the same everywhere.

    Attributes
    ----------
    contrast : float
        Half the range that holds 99 % of the factor, whose mean is 1.
    scales : tuple of float
        Widths of the grains (at half of their correlation), metres; each gives the same variance.
    seed : int
    stretch : float
        How many times longer than wide the grains are: streaks.
    angle : float
        From the panel's x axis to their length, towards y, radians.
    """

    contrast: Share
    scales: Annotated[Numbers, Limits(above=0)] = (0.064, 0.016, 0.004)
    seed: Count = 0
    stretch: Positive = 1.0
    angle: float = 0.0

    smooth = True
    x = y = 0.0
    reach = math.inf

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        along, across = (c * x + s * y) / self.stretch, c * y - s * x
        total = np.zeros(x.shape, np.float32)
        for index, scale in enumerate(self.scales):
            total += noise(self.seed, index, along / scale, across / scale)
        total *= np.float32(self.contrast / (_WITHIN * math.sqrt(len(self.scales))))
        total += 1
        # No dirt swallows all light, nor does any lack of it more than double it.
        return np.clip(total, 0.1, 1.9, out=total)


@dataclass(frozen=True)
class PaintPatch(Checked):
    """A rectangle or ellipse of another paint; long and narrow, it is a stripe or a scratch.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    length, width : float
        Metres.
    tint : tuple of 3 floats
        Factor on the albedo of red, green and blue light.
    angle : float
        From the panel's x axis to its length, towards y, radians.
    round : bool
        An ellipse.
    """

    x: float
    y: float
    length: Positive
    width: Positive
    tint: Colour
    angle: float = 0.0
    round: bool = False

    smooth = False

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds it, metres."""
        ramp = 1 + 2 * _SHARP / min(self.length, self.width)
        return math.hypot(self.length, self.width) / 2 * ramp

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        along, across = _from_centre(self, x, y)
        half_length, half_width = self.length / 2, self.width / 2
        if self.round:
            r = np.hypot(along / half_length, across / half_width)
            beyond = (r - 1) * min(half_length, half_width)
        else:
            beyond = np.maximum(np.abs(along) - half_length, np.abs(across) - half_width)
        return _tinted(np.clip(0.5 - beyond / (2 * _SHARP), 0, 1), self.tint)


@dataclass(frozen=True)
class Lettering(Checked):
    """A line of text.

    Attributes
    ----------
    x, y : float
        Its centre on the panel, metres.
    text : str
    height : float
        Of a capital letter, metres.
    tint : tuple of 3 floats
        Factor on the albedo of red, green and blue light.
    angle : float
        From the panel's x axis to the way it is read, towards y, radians.
    """

    x: float
    y: float
    text: str
    height: Positive
    tint: Colour
    angle: float = 0.0

    smooth = False

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds it, metres."""
        return math.hypot(*letters_of(self.text).shape) / 2 * self.height / LETTER

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        letters = letters_of(self.text)
        along, across = _from_centre(self, x, y)
        scale = np.float32(LETTER / self.height)
        column = along * scale + np.float32((letters.shape[1] - 1) / 2)
        row = across * scale + np.float32((letters.shape[0] - 1) / 2)
        return _tinted(sampled(letters, column, row), self.tint)


def scratches(count: Count, extent: Quadruple, seed: Count = 0) -> tuple[PaintPatch, ...]:
    """Narrow light and dark marks, 0.2 to 0.8 mm wide and 10 to 80 mm long.

    Parameters
    ----------
    count : int
    extent : tuple of 4 floats
        x_min, x_max, y_min, y_max that their centres lie in, metres.
    seed : int
    """
    rng = np.random.default_rng(seed)
    x_min, x_max, y_min, y_max = extent
    found = []
    for _ in range(count):
        tint = float(rng.choice([rng.uniform(0.25, 0.7), rng.uniform(1.1, 1.25)]))
        found.append(
            PaintPatch(
                float(rng.uniform(x_min, x_max)),
                float(rng.uniform(y_min, y_max)),
                float(rng.uniform(0.01, 0.08)),
                float(rng.uniform(0.0002, 0.0008)),
                (tint,) * 3,
                float(rng.uniform(0, math.pi)),
            )
        )
    return tuple(found)


Mark = Dirt | PaintPatch | Lettering


def _from_centre(mark: PaintPatch | Lettering, x: Image, y: Image) -> tuple[Image, Image]:
    """Coordinates along and across a mark from its centre, metres, float32."""
    dx, dy = (x - mark.x).astype(np.float32), (y - mark.y).astype(np.float32)
    return turned(dx, dy, mark.angle)


def _tinted(cover: Image, tint: Colour) -> Image:
    """Factor on red, green and blue where a mark covers a part of what is seen."""
    return np.stack([1 - cover * np.float32(1 - part) for part in tint])


@dataclass(frozen=True)
class Paint(Checked):
    """A diffuse paint, marked or not, under an optional varnish.

    Attributes
    ----------
    albedo : tuple of 3 floats
        Diffuse reflectance of red, green and blue light.
    edge : tuple of 3 floats
        A paint edge ``(n_x, n_y, offset)``: where n_x x + n_y y > offset on the panel,
        `albedo_beyond` holds instead of `albedo`. The default has no edge.
    albedo_beyond : tuple of 3 floats
        Albedo beyond the edge.
    roughness : float
        Roughness alpha of the varnish's GGX microfacets (Walter et al., EGSR 2007); 0 is matt.
    marks : tuple of Mark
        Dirt, scratches, letters, patches: each a factor on the albedo.
    """

    albedo: Reflectance = (0.8, 0.8, 0.8)
    edge: Triple = (0.0, 0.0, 1.0)
    albedo_beyond: Reflectance = (0.8, 0.8, 0.8)
    roughness: Share = 0.0
    marks: tuple[Mark, ...] = ()

    def beyond_edge(self, x: NDArray, y: NDArray) -> NDArray[np.bool_]:
        """Mask of panel coordinates beyond the paint's edge."""
        n_x, n_y, offset = self.edge
        return n_x * x + n_y * y > offset

    def specular(self, normal: NDArray, to_light: NDArray, to_eye: NDArray) -> NDArray[np.float64]:
        """Specular reflectance on the scale of an albedo: pi times the GGX BRDF.

        Parameters
        ----------
        normal, to_light, to_eye : ndarray, shape (n, 3)
            Unit vectors.

        Returns
        -------
        ndarray, shape (n,)
        """
        if not self.roughness:
            return np.zeros(len(normal))
        half = to_light + to_eye
        half /= np.sqrt(dot(half, half))[:, None]
        cos_light = np.maximum(dot(normal, to_light), 1e-6)
        cos_eye = np.maximum(dot(normal, to_eye), 1e-6)
        cos_half = dot(normal, half)
        alpha2 = self.roughness**2
        facets = alpha2 / (math.pi * (cos_half**2 * (alpha2 - 1) + 1) ** 2)
        fresnel = _VARNISH + (1 - _VARNISH) * (1 - dot(half, to_eye)) ** 5
        visibility = 1 / (_smith(cos_light, alpha2) * _smith(cos_eye, alpha2))
        return math.pi * facets * fresnel * visibility


def dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Scalar products of vectors of shape (n, 3), shape (n,)."""
    return np.einsum('ij,ij->i', a, b)


def _smith(cosine: NDArray, alpha2: float) -> NDArray[np.float64]:
    """Denominator of Smith's masking term: cos + sqrt(alpha^2 + (1 - alpha^2) cos^2)."""
    return cosine + np.sqrt(alpha2 + (1 - alpha2) * cosine * cosine)


@dataclass(frozen=True)
class Sunlight(Checked):
    """Light on one side of a line across a panel.

    Attributes
    ----------
    level : float
        On the lit side, as a fraction of the projector's full light on the white patch of the
        photometry, as its `ambient` is.
    edge : tuple of 3 floats
        ``(n_x, n_y, offset)``: where n_x x + n_y y > offset on the panel it is lit.
    softness : float
        Width of the half shadow, metres: 9 mm behind an edge one metre away, in the sun.
    """

    level: NotNegative
    edge: Triple
    softness: NotNegative = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.edge[:2]):
            self.refuse('edge', 'a direction n_x, n_y that is not 0, 0')

    def at(self, x: NDArray, y: NDArray) -> NDArray:
        """Light at panel coordinates of any shape."""
        n_x, n_y, offset = self.edge
        width = max(self.softness, 2 * _SHARP) * math.hypot(n_x, n_y)
        ramp = np.clip((n_x / width) * x + (n_y / width) * y + (0.5 - offset / width), 0, 1)
        # The sun's disc behind an edge: the part of it in view.
        return self.level * ramp * ramp * (3 - 2 * ramp)


@dataclass(frozen=True, eq=False)
class Print(Paint):
    """Ink where an image is dark: there the albedo is `albedo_beyond`.

    Attributes
    ----------
    ink : ndarray, shape (rows, columns), bool
        Its rim is as all that is around it.
    pixel : float
        Side of the image's pixels on the panel, metres.
    origin : tuple of 2 floats
        Panel coordinates of the image's upper left corner, metres.
    """

    albedo: Reflectance = (0.85, 0.85, 0.85)
    albedo_beyond: Reflectance = (0.05, 0.05, 0.05)
    ink: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((1, 1), bool))
    pixel: float = 0.001
    origin: Pair = (0.0, 0.0)

    def beyond_edge(self, x: NDArray, y: NDArray) -> NDArray[np.bool_]:
        """Mask of panel coordinates that are inked."""
        place = np.stack([np.nan_to_num(x) - self.origin[0], np.nan_to_num(y) - self.origin[1]])
        column, row = np.floor(place / self.pixel).astype(np.intp)
        rows, columns = self.ink.shape
        return self.ink[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


def board_print(board: Board) -> Print:
    """A calibration board's print; its first inner corner is the panel's origin."""
    origin = (-1.5 * board.square, -1.5 * board.square)
    # Of the print, a square.
    pixels = board.exact_pixels(40)
    ink = board.draw(pixels) < 128
    return Print(ink=ink, pixel=board.square / pixels, origin=origin)
