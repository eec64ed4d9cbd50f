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

from ftp_dent_ros.demonstration.appraisal import (
    DentAppraisal,
    SkinAppraisal,
    appraise,
    appraise_dents,
    appraise_skin,
    onto_truth,
)
from ftp_dent_ros.demonstration.flight import FlightError, fly, render_ahead, simulation_parameters
from ftp_dent_ros.demonstration.results import BOUNDS, summary_of, write_results
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.page import write_report
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.survey.surveying import report_on_skin

OUT_OF_BOUND = 1
SUMMARY = 'summary.json'
REPORT = 'report'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        '--output', type=Path, default=Path('out/demo'), metavar='DIR', help='default: out/demo'
    )
    parser.add_argument(
        '--clouds', type=int, default=24, metavar='N', help='tagged clouds to fly for; default: 24'
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
    blocks = simulation_parameters(arguments.configuration)
    camera = blocks['camera_capture']['ros__parameters']
    ahead = folder / 'photographs'
    # Some more than are flown for: the camera may begin late, and photographs drain.
    wanted = arguments.clouds + 6
    with _bar('rendering ahead', wanted, 'photograph') as bar:
        render_ahead(blocks, ahead, wanted, bar.update)
    with _bar('flying', arguments.clouds, 'cloud') as bar:

        def progress(tagged: int) -> None:
            # A few more come while the last ones drain.
            bar.total = max(arguments.clouds, tagged)
            bar.update(tagged - bar.n)

        bag = open_bag(fly(folder, blocks, arguments.clouds, progress, bar.write))
    shutil.rmtree(ahead)
    world = read_world(camera['simulation.scene'], camera['simulation.start_ns'])
    count = sum(bag.metadata.message_counts[topic] for topic in ('/points', '/tagged/points'))
    with _bar('comparing with the truth', count, 'cloud') as bar:
        appraisal = appraise(bag, world, bar.update)
    dents, skin, poses = _inspect(bag, world, camera['rig'], folder / REPORT)
    summary = summary_of(appraisal, dents, skin)
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
    return tqdm(desc=what, total=total, unit=unit, dynamic_ncols=True, disable=None)


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
