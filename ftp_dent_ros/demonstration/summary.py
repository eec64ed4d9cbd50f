"""The figures of a demonstration as people read them, and the bounds that they must keep."""

from __future__ import annotations

from ftp_dent_ros.demonstration.appraisal import Appraisal
from ftp_dent_ros.demonstration.dents import DentAppraisal
from ftp_dent_ros.demonstration.skin import SkinAppraisal

# What the payload promises in this simulation: how many, and millimetres.
BOUNDS = {
    'images_lost': 0,
    'clouds_lost': 0,
    'tagged_clouds_lost': 0,
    'poses_lost': 0,
    'camera_mae_mm': 0.1,
    # By the autopilot's poses, which err as a real one's: 7 cm and 1.1 degrees at most.
    'map_mae_mm': 100.0,
    'skin_mae_mm': 0.1,
    'clouds_not_inspected': 0,
    'dents_missed': 0,
    'sightings_missed': 0,
    'dents_false': 0,
    'dents_false_in_list': 0,
}


def summary_of(appraisal: Appraisal, dents: DentAppraisal, skin: SkinAppraisal) -> str:
    """The figures as people read them, a line each."""
    a, d, s = appraisal, dents, skin
    rows = [
        ('images', f'{a.images}, lost {a.images_lost}{_too_slow(a.images_not_taken, "taken")}'),
        ('clouds', f'{a.clouds}, lost {a.clouds_lost}'),
        (
            'tagged clouds',
            f'{a.tagged_clouds}, lost {a.tagged_clouds_lost}'
            f'{_too_slow(a.tagged_clouds_late, "tagged")}',
        ),
        ('autopilot poses', f'{a.poses}, lost {a.poses_lost}{_too_slow(a.poses_not_had, "had")}'),
        (
            'exposure to tagged cloud',
            f'{a.latency_median_ms:.0f} ms median, {a.latency_maximum_ms:.0f} ms at most',
        ),
        (
            'MAE in the camera frame',
            f'{a.camera_mae_mm:.4f} mm, worst cloud {a.camera_mae_worst_mm:.4f} mm '
            f'(bound {BOUNDS["camera_mae_mm"]} mm)',
        ),
        (
            "by the autopilot's poses",
            f'{a.map_mae_mm:.1f} mm in the map, worst cloud {a.map_mae_worst_mm:.1f} mm '
            f'(bound {BOUNDS["map_mae_mm"]:g} mm)',
        ),
        (
            "by the skin's own poses",
            f'{s.skin_mae_mm:.4f} mm against itself, worst cloud {s.skin_mae_worst_mm:.4f} mm '
            f'(bound {BOUNDS["skin_mae_mm"]} mm)',
        ),
        (
            'the skin',
            f'points {s.skin_place_mm:.3f} mm from their places on it, the whole '
            f'{s.skin_off_mm:.0f} mm off in the map'
            + (f'; {s.skin_parts} parts' if s.skin_parts > 1 else ''),
        ),
        ('clouds not inspected', f'{d.clouds_not_inspected}'),
        (
            'true dents in view',
            f'{d.dents}, missed {d.dents_missed}, false {d.dents_false}, twice {d.dents_twice}',
        ),
        ('their sightings', f'{d.sightings}, missed {d.sightings_missed}'),
        (
            'largest error of a dent',
            f'depth {d.depth_error_mm:.3f} mm, length {d.length_error_mm:.2f} mm, '
            f'width {d.width_error_mm:.2f} mm',
        ),
        ('listed as others', f'{d.others}, where there is none {d.others_false}'),
        (
            "dents in the node's list",
            f'{d.dents_in_list}, false {d.dents_false_in_list}, twice {d.dents_twice_in_list}',
        ),
    ]
    return '\n'.join(f'{name:26}{value}' for name, value in rows)


def _too_slow(count: int, what: str) -> str:
    """What this machine could not do in time: no fault of the payload, but worth to be known."""
    return f'; {count} more not {what} in time, for this machine is too slow' if count else ''
