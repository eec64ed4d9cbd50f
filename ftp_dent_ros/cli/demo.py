"""``ftp-dent demo``: the whole payload in simulation, its figures against the truth."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ftp_dent_ros.demonstration.appraisal import Appraisal, appraise
from ftp_dent_ros.demonstration.dents import DentAppraisal, appraise_dents
from ftp_dent_ros.demonstration.flight import FlightError, fly, simulation_parameters
from ftp_dent_ros.demonstration.results import write_results
from ftp_dent_ros.demonstration.skin import SkinAppraisal, appraise_skin, onto_truth
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.reporting.files import write_report
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.rig import read_rig
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.survey.reporting import report_on_skin

OUT_OF_BOUND = 1
SUMMARY = 'summary.json'
REPORT = 'report'

# What the payload promises in this simulation.
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        '--output', type=Path, default=Path('out/demo'), metavar='DIR', help='default: out/demo'
    )
    parser.add_argument(
        '--clouds', type=int, default=40, metavar='N', help='tagged clouds to fly for; default: 40'
    )
    parser.add_argument(
        '--configuration',
        default='shipped:simulation.yaml',
        metavar='CONFIG.yaml',
        help='nodes and parameters; default: %(default)s',
    )


def run(arguments: argparse.Namespace) -> int:
    """Fly, appraise, draw: 0 if every figure is within its bound, else 1."""
    if arguments.clouds < 1:
        raise ConfigurationError(f'--clouds is {arguments.clouds}: give at least 1')
    started = time.monotonic()
    output = arguments.output
    _refuse_to_replace_others(output)
    # Everything is made aside: a demonstration under its name is a whole one.
    aside = output.with_name(f'.{output.name}.{os.getpid()}')
    try:
        aside.mkdir(parents=True)
    except OSError as error:
        raise ConfigurationError(
            f'--output {output} cannot be made ({error.strerror}): name another folder'
        ) from None
    try:
        figures, summary = _demonstrate(arguments, aside)
    except FlightError as error:
        logs = output.with_name(f'{output.name}.failed')
        shutil.rmtree(logs, ignore_errors=True)
        aside.rename(logs)
        raise FlightError(f'{error} (kept in {logs})') from None
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise
    if output.exists():
        shutil.rmtree(output)
    aside.rename(output)
    print(f'\n{summary}\n\n{_files(output)}')
    print(f'Done in {time.monotonic() - started:.0f} s.')
    return _verdict(figures, output)


def _refuse_to_replace_others(output: Path) -> None:
    """Only a demonstration's folder, or an empty one, is replaced; none that this runs in."""
    if Path(os.path.abspath(output)) in (Path.cwd(), *Path.cwd().parents):
        raise ConfigurationError(
            f'--output {output} holds the folder that this runs in: name one of its own'
        )
    if output.is_dir() and ((output / SUMMARY).exists() or not any(output.iterdir())):
        return
    if output.exists() or output.is_symlink():
        raise ConfigurationError(
            f'--output {output} exists and is no demonstration: name another folder'
        )


def _demonstrate(arguments: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], str]:
    blocks = simulation_parameters(arguments.configuration, time.time_ns())
    camera = blocks['camera_capture']['ros__parameters']
    link = blocks['mavlink_bridge']['ros__parameters']
    world = read_world(camera['simulation.scene'], camera['simulation.start_ns'])
    with _bar('flying', arguments.clouds, 'cloud') as bar:

        def progress(tagged: int) -> None:
            # A few more come while the last ones drain.
            bar.total = max(arguments.clouds, tagged)
            bar.update(tagged - bar.n)

        bag = open_bag(fly(folder, blocks, arguments.clouds, progress, bar.write))
    count = sum(bag.metadata.message_counts[topic] for topic in ('/points', '/tagged/points'))
    with _bar('comparing with the truth', count, 'cloud') as bar:
        appraisal = appraise(bag, world, camera['rate'], link['rate'], bar.update)
    dents, skin, poses = _inspect(bag, world, camera['rig'], folder / REPORT)
    summary = _table(appraisal, dents, skin)
    (folder / 'summary.txt').write_text(f'{summary}\n', encoding='utf-8')
    figures: dict[str, Any] = {}
    for each in (appraisal, dents, skin):
        figures |= dataclasses.asdict(each)
    record = {'figures': figures, 'bounds': BOUNDS}
    (folder / SUMMARY).write_text(json.dumps(record, indent=1), encoding='utf-8')
    with _bar('writing clouds and pictures', None, 'file') as bar:
        write_results(bag, world, poses, folder, bar.update)
    return figures, summary


def _inspect(
    bag: Bag, world: World, rig: str, folder: Path
) -> tuple[DentAppraisal, SkinAppraisal, dict[int, Pose]]:
    """Write the report on the flight's skin, and hold it against the true one.

    The last are the cameras' poses by the skin, which is put onto the true one.
    """
    file = find(rig)
    calibrated = read_rig(file)
    named, camera = (file.name, calibrated.id), calibrated.camera
    count = bag.metadata.message_counts['/points']
    with _bar('inspecting', 3 * count, 'cloud') as bar:
        report, joined = report_on_skin(bag, inspect, named, camera, progress=bar.update)
    write_report(folder, dataclasses.replace(report, source='flight of the demonstration'))
    onto = onto_truth(bag, joined, world)
    poses = {stamp: onto.move(stamp) @ joined.poses[i] for stamp, i in joined.numbers.items()}
    dents = appraise_dents(bag, report, world, camera, onto.move)
    return dents, appraise_skin(bag, joined, world, onto), poses


def _bar(what: str, total: int | None, unit: str) -> tqdm:
    return tqdm(desc=what, total=total, unit=unit, dynamic_ncols=True)


def _table(appraisal: Appraisal, dents: DentAppraisal, skin: SkinAppraisal) -> str:
    """Summary as people read it."""
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


def _files(output: Path) -> str:
    names = [f'{path.name}/' if path.is_dir() else path.name for path in output.iterdir()]
    return '\n'.join([f'In {output}/:', *(f'  {name}' for name in sorted(names))])


def _verdict(figures: dict[str, Any], output: Path) -> int:
    print(f'The report: {output / REPORT / "report.html"}')
    # A figure that could not be measured (NaN) is out of its bound.
    outside = [name for name, bound in BOUNDS.items() if not figures[name] <= bound]
    if math.isnan(figures['camera_mae_mm']) or outside:
        print(f'OUT OF BOUND: {", ".join(outside)}. The logs are in {output}/log.')
        return OUT_OF_BOUND
    program = 'ftp-dent' if shutil.which('ftp-dent') else sys.argv[0]
    print('All figures are within their bounds. Try next:\n')
    print(f'  {program} reconstruct {output}/camera.png \\')
    entries = {entry.name: entry for entry in read_configuration(output / 'payload.yaml')}
    shown = entries['pattern_publisher'].parameters
    print(f'      --rig {shown["rig"]} --pattern {shown["pattern"]} --output cloud.ply')
    print(f'  {program} replay {output}/bag')
    return 0
