"""What a few photographs say before take-off: light, focus, flicker, noise, rig."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.rig_check import check
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import SmallestDent as Smallest
from ftp_dent_ros.errors import CalibrationError, CloudError, RefusedFrameError
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.profilometry.flicker import MUCH, SOME, fall_of_light, flicker, light_of
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.rig_alarm import LAST, rig_alarm
from ftp_dent_ros.rig.rig import Rig

OK, WARN, NO = 'ok', 'warn', 'no'
# Grey level of the white that is projected.
_WHITE = 254
# Bright enough to be measured, and as bright as it should be: grey levels.
_BRIGHT, _DESIRED = 60, 215
_MOST_CLIPPED, _SOME_CLIPPED = 0.05, 0.005
# Part of the skin on which the smallest dent that is told would be found, per cent.
_MOST = 95


@dataclass(frozen=True)
class Finding:
    """One line of the check.

    Attributes
    ----------
    name : str
    verdict : str
        `OK`, `WARN` or `NO`.
    text : str
        The value, and what to do if it is not well.
    """

    name: str
    verdict: str
    text: str


def sharpness(
    white: NDArray[np.uint8],
    black: NDArray[np.uint8],
    fringes: NDArray[np.uint8],
    projected: NDArray[np.uint8],
) -> float:
    """What the lenses leave of the contrast of the fringes that are projected, 0 to 1.

    Parameters
    ----------
    white, black, fringes : ndarray, shape (height, width, 3), uint8
        Photographs of grey level 254, of 0, and of the fringes.
    projected : ndarray, shape (projector's height, width, 3), uint8
        The fringes' image; coded ones have less contrast than the stripe's.
    """
    lit = _lit(white, black)
    if not lit.any():
        return 0.0
    dark = black[..., 0][lit].astype(float)
    part = (fringes[..., 0][lit] - dark) / (white[..., 0][lit] - dark)
    return float(
        np.clip(np.std(part) / max(float(np.std(projected[..., 0] / _WHITE)), 1e-3), 0, 1)
    )


def examine(
    rig: Rig,
    pattern: Pattern,
    white: NDArray[np.uint8],
    black: NDArray[np.uint8],
    fringes: list[NDArray[np.uint8]],
    reconstructor: Reconstructor,
    exposure: float = 0.0,
    smallest: Smallest | None = None,
) -> list[Finding]:
    """Examine photographs of what will be inspected, or of a wall.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    white, black : ndarray, shape (height, width, 3), uint8
        RGB, under an even projected image.
    fringes : list of ndarray
        Two or more under the pattern; three or more tell the flicker.
    reconstructor : Reconstructor
        Of `rig` and `pattern`.
    exposure : float
        Of the photographs, seconds; 0 if it is not known.
    smallest : ftp_dent_ros.dents.dent.Settings, optional
        The smallest dent that will be looked for.
    """
    lit = _lit(white, black)
    if lit.mean() < 0.05:
        return [
            Finding('projector', NO, 'its light is not seen: check lamp, lens cap and distance')
        ]
    findings = [
        Finding('projector', OK, f'lights {100 * lit.mean():.0f} % of the image'),
        _exposure(fringes[0], lit, exposure),
        _focus(sharpness(white, black, fringes[0], pattern.draw())),
        _ambient(white, black, lit),
    ]
    try:
        measured = [reconstructor.measure(each) for each in fringes[:LAST]]
    except RefusedFrameError as reason:
        return [*findings, Finding(pattern.code, NO, str(reason))]
    cloud = measured[0].cloud
    share = float(cloud.valid.sum() * reconstructor.settings.stride**2 / lit.sum())
    findings.append(
        Finding(
            pattern.code,
            OK if share > 0.5 else WARN,
            f'seen; {100 * min(share, 1):.0f} % measured',
        )
    )
    findings.append(_flicker(fringes, measured, rig, exposure))
    findings.append(_distance(cloud, smallest))
    try:
        found = check(rig, pattern, fringes[0], cloud.points, flatness=math.inf)
        verdict = (OK if found.tells else WARN) if found.holds else NO
        findings.append(Finding('rig', verdict, found.sentence))
    except CalibrationError as reason:
        findings.append(Finding('rig', WARN, f'not checked: {reason}'))
    checks = [each.epipolar for each in measured if each.epipolar and each.epipolar.seen]
    if checks:
        trouble = rig_alarm(checks)
        text = trouble or checks[-1].sentence
        findings.append(Finding('epipolar', NO if trouble else OK, text))
    return findings


def _lit(white: NDArray, black: NDArray) -> NDArray[np.bool_]:
    """Where the projector's light falls."""
    span = white[..., 0].astype(float) - black[..., 0]
    return span > max(8.0, 0.3 * float(np.percentile(span, 99)))


def _exposure(fringes: NDArray, lit: NDArray, exposure: float) -> Finding:
    levels = fringes[..., 0][lit]
    # Grey level of 255 from which on a pixel is clipped.
    clipped, bright = float((levels >= 250).mean()), float(np.percentile(levels, 98))
    advice = _DESIRED / max(bright, 1.0)
    if clipped > _SOME_CLIPPED:
        # How much too bright is not seen: by halves.
        advice = 0.5 if clipped > _MOST_CLIPPED else 0.75
    to = f'{1e3 * exposure * advice:.1f} ms' if exposure else f'{advice:.2f} times as long'
    text = f'{100 * clipped:.1f} % clipped, fringes up to {bright:.0f} of 255'
    if clipped > _SOME_CLIPPED or bright < 0.75 * _DESIRED:
        verdict = NO if clipped > _MOST_CLIPPED or bright < _BRIGHT else WARN
        return Finding('exposure', verdict, f'{text}: expose for {to}')
    return Finding('exposure', OK, text)


def _focus(left: float) -> Finding:
    text = f'{100 * left:.0f} % of the contrast is left'
    # Of the fringes' contrast between a black and a white frame: what a lens in focus leaves of
    # it.
    if left >= 0.6:
        return Finding('focus', OK, text)
    advice = 'turn the focus of projector and camera with --watch'
    return Finding('focus', WARN if left >= 0.3 else NO, f'{text}: {advice}')


def _flicker(
    fringes: list[NDArray], measured: list[Measurement], rig: Rig, exposure: float
) -> Finding:
    source = rig.projector_centre
    found = flicker(
        [
            light_of(Photograph.of(image)) / fall_of_light(each.cloud.points, source)
            for image, each in zip(fringes, measured, strict=False)
        ]
    )
    if found is None:
        return Finding('flicker', WARN, 'not known: it takes three photographs that show light')
    if found.worst <= SOME:
        return Finding('flicker', OK, found.text)
    frames = max(1, round(exposure * 60)) if exposure else 1
    advice = f'expose for a whole number of projector frames ({1e3 * frames / 60:.1f} ms at 60 Hz)'
    return Finding('flicker', WARN if found.worst <= MUCH else NO, f'{found.text}: {advice}')


def _ambient(white: NDArray, black: NDArray, lit: NDArray) -> Finding:
    dark = float(np.median(black[..., 0][lit]))
    span = float(np.median(white[..., 0][lit].astype(float) - black[..., 0][lit]))
    share = dark / max(span, 1.0)
    text = f"{100 * share:.0f} % of the projector's light"
    # Part of the light from elsewhere.
    if share <= 0.5:
        return Finding('ambient', OK, text)
    advice = 'work in the shade, or with a brighter projector'
    return Finding('ambient', WARN if share <= 1.5 else NO, f'{text}: {advice}')


def _distance(cloud: Cloud, settings: Smallest | None) -> Finding:
    text = f'{np.nanmedian(cloud.points[..., 2]):.3f} m'
    if not np.isfinite(cloud.sigma).any():
        return Finding('distance', OK, f'{text}; this method states no noise')
    text += f'; noise {1e3 * np.nanmedian(cloud.sigma):.4f} mm a point'
    try:
        found = inspect(cloud, settings)
    except CloudError as reason:
        return Finding('distance', WARN, f'{text}; {reason}')
    findable = np.nanpercentile(found.findable, _MOST)
    return Finding('distance', OK, f'{text}, dents found from {1e3 * findable:.2f} mm depth')
