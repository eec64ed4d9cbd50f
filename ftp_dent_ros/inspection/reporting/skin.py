"""The whole skin as a report shows it: one picture a layer, with the dents drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Layer:
    """One picture of the skin.

    Attributes
    ----------
    title, caption : str
    data : str
        Of the picture, as a data URI.
    scale : str
        Its colours as a data URI; empty without.
    marks : sequence of str
        What these stand for, from left to right.
    """

    title: str
    caption: str
    data: str
    scale: str = ''
    marks: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Skin:
    """All that is shown of the skin; lengths in the pictures are units of their drawing.

    Attributes
    ----------
    size : (int, int)
        Width and height of the pictures.
    windows : sequence of (float, float)
        Left edge and width of the parts that a picture is shown in, one below the other.
    layers : sequence of Layer
    outlines : sequence of dict
        ``points``, ``number``, ``kind``, ``left``, ``right`` and ``top`` of each dent.
    bar : dict
        ``length`` and ``text`` of a scale bar.
    facts : sequence of (str, str)
    gaps : sequence of dict
        ``x``, ``y`` (m), ``width``, ``height`` (mm) and ``area`` (cm2) of each.
    remarks : sequence of str
    """

    size: tuple[int, int]
    windows: Sequence[tuple[float, float]]
    layers: Sequence[Layer]
    outlines: Sequence[dict[str, Any]]
    bar: dict[str, Any]
    facts: Sequence[tuple[str, str]]
    gaps: Sequence[dict[str, Any]]
    remarks: Sequence[str] = ()
