"""``ftp-dent demo``: the whole payload in simulation, its figures against the truth."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number, progress_bar
from ftp_dent_ros.demonstration.appraisal import (
    Figures,
    appraise,
    appraise_dents,
    appraise_skin,
)
from ftp_dent_ros.demonstration.flight import (
    BOUNDS,
    SUMMARY,
    FlightError,
    fly,
    render_ahead,
    simulation_parameters,
    write_results,
)
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.page import write_report
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.survey.surveying import report_on_skin

RECORD = 'summary.json'
REPORT = 'report'


ARGUMENTS = (
    argument(
        '--output', type=Path, default=Path('out/demo'), metavar='DIR', help='default: out/demo'
    ),
    argument(
        '--clouds',
        type=number('--clouds', 1, kind=int),
        default=24,
        metavar='N',
        help='tagged clouds to fly for; default: 24',
    ),
    argument(
        '--configuration',
        default='shipped:simulation.yaml',
        metavar='CONFIG.yaml',
        help='nodes and parameters; default: %(default)s',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Fly, appraise, draw: 0 if every figure is within its bound, else 1."""
    started = time.monotonic()
    output = arguments.output
    _refuse_to_replace_others(output)
    blocks = simulation_parameters(arguments.configuration)
    # A demonstration under its name is a whole one.
    unfinished = output.with_name(f'{output.name}.unfinished')
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    try:
        figures, summary = _demonstrate(blocks, arguments.clouds, unfinished)
    except FlightError as error:
        raise FlightError(f'{error} (kept in {unfinished})') from None
    if output.exists():
        shutil.rmtree(output)
    unfinished.rename(output)
    names = [f'{path.name}/' if path.is_dir() else path.name for path in output.iterdir()]
    print(f'\n{summary}\n\nIn {output}/:', *sorted(names), sep='\n  ')
    print(f'Done in {time.monotonic() - started:.0f} s.')
    return _verdict(figures, output)


def _refuse_to_replace_others(output: Path) -> None:
    """Only a demonstration's folder, or an empty one, is replaced; none that this runs in."""
    if Path(os.path.abspath(output)) in (Path.cwd(), *Path.cwd().parents):
        raise ConfigurationError(
            f'--output {output} holds the folder that this runs in: name one of its own'
        )
    if output.is_dir() and ((output / RECORD).exists() or not any(output.iterdir())):
        return
    if output.exists() or output.is_symlink():
        raise ConfigurationError(
            f'--output {output} exists and is no demonstration: name another folder'
        )


def _demonstrate(blocks: dict[str, Any], clouds: int, folder: Path) -> tuple[Figures, str]:
    camera = blocks['camera_capture']['ros__parameters']
    ahead = folder / 'photographs'
    # Some more than are flown for: the camera may begin late, and photographs drain.
    wanted = clouds + 6

    def render() -> None:
        with progress_bar('rendering ahead', wanted, 'photograph') as rendering:
            render_ahead(blocks, ahead, wanted, rendering.update)

    with progress_bar('flying', clouds, 'cloud') as bar:

        def progress(tagged: int) -> None:
            # A few more come while the last ones drain.
            bar.total = max(clouds, tagged)
            bar.update(tagged - bar.n)

        bag = open_bag(fly(folder, blocks, clouds, render, progress, bar.write))
    shutil.rmtree(ahead)
    world = read_world(camera['simulation.scene'], camera['simulation.start_ns'])
    count = sum(bag.message_counts[topic] for topic in ('/points', '/tagged/points'))
    with progress_bar('comparing with the truth', count, 'cloud') as bar:
        appraisal = appraise(bag, world, bar.update)
    dents, skin, poses = _inspect(bag, world, camera['rig'], folder / REPORT)
    figures = {**appraisal, **dents, **skin}
    summary = SUMMARY.format(**figures)
    (folder / 'summary.txt').write_text(f'{summary}\n', encoding='utf-8')
    record = {'figures': figures, 'bounds': BOUNDS}
    (folder / RECORD).write_text(json.dumps(record, indent=1), encoding='utf-8')
    write_results(bag, world, poses, folder)
    return figures, summary


def _inspect(
    bag: Bag, world: World, rig: str, folder: Path
) -> tuple[Figures, Figures, dict[int, Pose]]:
    """Write the report on the flight's skin, and hold it against the true one.

    The last are the cameras' poses by the skin, which is put onto the true one.
    """
    file = find(rig)
    calibrated = read_rig(file)
    named, camera = (file.name, calibrated.id), calibrated.camera
    count = bag.message_counts['/points']
    with progress_bar('inspecting', 3 * count, 'cloud') as bar:
        report, joined = report_on_skin(bag, named, camera, progress=bar.update)
    write_report(folder, replace(report, source='flight of the demonstration'))
    skin, moves = appraise_skin(bag, joined, world)
    poses = {
        stamp: move @ joined.graph.poses[joined.numbers[stamp]] for stamp, move in moves.items()
    }
    return appraise_dents(bag, report, world, camera, moves), skin, poses


def _verdict(figures: Figures, output: Path) -> int:
    print(f'The report: {output / REPORT / "report.html"}')
    # A figure that could not be measured (NaN) is out of its bound.
    outside = [name for name, bound in BOUNDS.items() if not figures[name] <= bound]
    if outside:
        print(f'OUT OF BOUND: {", ".join(outside)}. The logs are in {output}/log.')
        return 1
    program = 'ftp-dent' if shutil.which('ftp-dent') else sys.argv[0]
    print('All figures are within their bounds. Try next:\n')
    print(f'  {program} reconstruct {output}/camera.png \\')
    entries = {entry.name: entry for entry in read_configuration(output / 'payload.yaml')}
    shown = entries['pattern_publisher'].parameters
    print(f'      --rig {shown["rig"]} --pattern {shown["pattern"]} --output cloud.ply')
    print(f'  {program} replay {output}/bag')
    return 0
