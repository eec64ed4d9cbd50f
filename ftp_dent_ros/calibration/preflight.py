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
from ftp_dent_ros.photograph.flicker import MUCH, SOME, fall_of_light, flicker, light_of
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.profilometry.measurement import Measurement
from ftp_dent_ros.profilometry.rig_alarm import LAST, rig_alarm
from ftp_dent_ros.rig.rig import Rig

OK, WARN, NO = 'ok', 'warn', 'no'


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
    smallest : SmallestDent, optional
        The smallest dent that will be looked for.
    """
    span = white[..., 0].astype(float) - black[..., 0]
    # Where the projector's light falls.
    lit = span > max(8.0, 0.3 * float(np.percentile(span, 99)))
    if lit.mean() < 0.05:
        return [
            Finding('projector', NO, 'its light is not seen: check lamp, lens cap and distance')
        ]
    dark = black[..., 0][lit].astype(float)
    ambient = float(np.median(dark) / np.median(span[lit]))
    seen = float(np.std((fringes[0][..., 0][lit] - dark) / span[lit]))
    # Coded fringes have less contrast than the stripe's.
    left = min(seen / float(np.std(pattern.draw()[..., 0] / 254)), 1.0)
    findings = [
        Finding('projector', OK, f'lights {100 * lit.mean():.0f} % of the image'),
        _exposure(fringes[0], lit, exposure),
        # Of the fringes' contrast between a black and a white frame, what is lost: a lens in focus
        # leaves six tenths.
        _judged(
            'focus',
            f'{100 * left:.0f} % of the contrast is left',
            1 - left,
            (0.4, 0.7),
            'turn the focus of projector and camera',
        ),
        _judged(
            'ambient',
            f"{100 * ambient:.0f} % of the projector's light",
            ambient,
            (0.5, 1.5),
            'work in the shade, or with a brighter projector',
        ),
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


def _exposure(fringes: NDArray, lit: NDArray, exposure: float) -> Finding:
    levels = fringes[..., 0][lit]
    # Grey level of 255 from which on a pixel is clipped.
    clipped, bright = float((levels >= 250).mean()), float(np.percentile(levels, 98))
    text = f'{100 * clipped:.1f} % clipped, fringes up to {bright:.0f} of 255'
    desired = 215.0
    advice = desired / max(bright, 1.0)
    if clipped > 0.005:
        # How much too bright is not seen: by halves.
        advice = 0.5 if clipped > 0.05 else 0.75
    elif bright >= 0.75 * desired:
        return Finding('exposure', OK, text)
    to = f'{1e3 * exposure * advice:.1f} ms' if exposure else f'{advice:.2f} times as long'
    # Fringes darker than this are not measured.
    verdict = NO if clipped > 0.05 or bright < 60 else WARN
    return Finding('exposure', verdict, f'{text}: expose for {to}')


def _judged(name: str, text: str, bad: float, limits: tuple[float, float], advice: str) -> Finding:
    """OK up to the first limit, with advice beyond it, and NO beyond the second."""
    if bad <= limits[0]:
        return Finding(name, OK, text)
    return Finding(name, WARN if bad <= limits[1] else NO, f'{text}: {advice}')


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
    frames = max(1, round(exposure * 60)) if exposure else 1
    advice = f'expose for a whole number of projector frames ({1e3 * frames / 60:.1f} ms at 60 Hz)'
    return _judged('flicker', found.text, found.worst, (SOME, MUCH), advice)


def _distance(cloud: Cloud, settings: Smallest | None) -> Finding:
    text = f'{np.nanmedian(cloud.points[..., 2]):.3f} m'
    if not np.isfinite(cloud.sigma).any():
        return Finding('distance', OK, f'{text}; this method states no noise')
    text += f'; noise {1e3 * np.nanmedian(cloud.sigma):.4f} mm a point'
    try:
        found = inspect(cloud, settings)
    except CloudError as reason:
        return Finding('distance', WARN, f'{text}; {reason}')
    # On 95 % of the skin a dent of this depth would be found.
    findable = np.nanpercentile(found.findable, 95)
    return Finding('distance', OK, f'{text}, dents found from {1e3 * findable:.2f} mm depth')
