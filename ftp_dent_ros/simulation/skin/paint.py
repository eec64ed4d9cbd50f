"""How a panel's paint reflects light: a livery of one or two tones, matt or glossy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.skin.marks import Mark

# Reflectance of clear varnish (refractive index 1.5) at normal incidence.
_VARNISH = 0.04


@dataclass(frozen=True)
class Paint:
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

    albedo: tuple[float, float, float] = (0.8, 0.8, 0.8)
    edge: tuple[float, float, float] = (0.0, 0.0, 1.0)
    albedo_beyond: tuple[float, float, float] = (0.8, 0.8, 0.8)
    roughness: float = 0.0
    marks: tuple[Mark, ...] = ()

    @property
    def coloured(self) -> bool:
        """Whether a mark's factor differs from colour to colour."""
        return any(mark.coloured for mark in self.marks)

    def beyond_edge(self, x: NDArray, y: NDArray) -> NDArray[np.bool_]:
        """Mask of panel coordinates beyond the paint's edge."""
        n_x, n_y, offset = self.edge
        if not (n_x or n_y):
            return np.full(x.shape, offset < 0)
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
