"""``ftp-dent``: one module a command, imported only when it is asked for."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
from collections.abc import Mapping, Sequence

from ftp_dent_ros import __version__
from ftp_dent_ros.errors import FtpDentError, missing_package, printable
from ftp_dent_ros.process import keep_freed, one_for_blas

# Each is a module with `ARGUMENTS` and `run(arguments) -> exit status`, or with such `COMMANDS`.
COMMANDS = {
    'demo': 'the whole payload on a simulated panel and autopilot',
    'up': "run a configuration's nodes and keep them running",
    'pattern': 'what is projected, drawn as an image, or read back from one',
    'reconstruct': 'one photograph to a point cloud',
    'inspect': 'clouds, photographs or bags to their dents and their report',
    'survey': 'bags of one aircraft to one skin: mosaic, coverage, dents',
    'surveys': 'the surveys of an aircraft that are kept in a file',
    'compare': 'what has become of the dents between two surveys',
    'calibrate': 'a board under projected patterns to rig.yaml',
    'evaluate': "the paper's simulation and tables, and least squares beside them",
    'preflight': 'whether a running payload is fit to take off with',
    'link-check': "who is on the autopilot's link, and whether it is fit to fly",
    'ground': "the payload's topics on the ground, over a thin link",
    'record': 'record topics to an MCAP bag',
    'replay': 'publish the messages of a bag',
    'recover': 'mend a bag whose recorder was killed',
}


def add_commands(
    parser: argparse.ArgumentParser, module: str, commands: Mapping[str, str], words: list[str]
) -> None:
    """Declare every command's name, and the arguments of the one that the words choose."""
    choices = parser.add_subparsers(metavar='COMMAND', required=True)
    chosen = next((word for word in words if not word.startswith('-')), None)
    for name, summary in commands.items():
        command = choices.add_parser(name, help=summary, description=summary.capitalize() + '.')
        if name != chosen:
            continue
        path = f'{module}{name.replace("-", "_")}'
        content = importlib.import_module(f'ftp_dent_ros.cli.{path}')
        if hasattr(content, 'COMMANDS'):
            add_commands(command, f'{path}_', content.COMMANDS, words[words.index(name) + 1 :])
            continue
        command.set_defaults(run=content.run)
        for names, how in content.ARGUMENTS:
            command.add_argument(*names, **how)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command: exit status 0 done, 2 bad usage or input (one line on stderr)."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    chosen = next((word for word in words if not word.startswith('-')), None)
    one_for_blas()
    for name in ('stdout', 'stderr'):
        if getattr(sys, name) is None:
            # Closed by who started us (`>&-`): what is said goes nowhere.
            setattr(sys, name, open(os.devnull, 'w', encoding='utf-8'))  # noqa: SIM115
    # Names of files may hold what the terminal's encoding does not.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')
    keep_freed()
    try:
        parser = argparse.ArgumentParser(prog='ftp-dent')
        parser.description = 'Single-shot fringe projection: photographs to clouds with a pose.'
        parser.add_argument('--version', action='version', version=__version__)
        add_commands(parser, '', COMMANDS, words)
        parsed = parser.parse_args(words)
        status: int = parsed.run(parsed)
        sys.stdout.flush()
        return status
    except FtpDentError as error:
        sentence = str(error)
    except ModuleNotFoundError as error:
        sentence = missing_package(error)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read the output, such as `head`, has seen enough; nothing is left to flush to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        # A file, disk or network that nobody who knows more has spoken for.
        name = error.filename if error.filename2 is None else error.filename2
        what = '' if name is None else f'{printable(str(name))}: '
        sentence = f'{what}{error.strerror or error}: check path, permissions and disk'
    print(f'ftp-dent {chosen}: {sentence}', file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
