"""Build file for pip and colcon alike; package.xml names the same dependencies for rosdep."""

import re
import runpy
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'ftp_dent_ros'
HERE = Path(__file__).resolve().parent
VERSION = re.search(r"__version__ = '(.+)'", (HERE / NAME / '__init__.py').read_text()).group(1)
CLUSTER = ('dask>=2022.12', 'distributed>=2022.12')
REPORTS = ('jinja2>=3.1', 'matplotlib>=3.6')
NODES = runpy.run_path(str(HERE / NAME / 'supervision' / 'executables.py'))['NODES']


def shared_files(folder: str) -> list[tuple[str, list[str]]]:
    """Files of a folder and those below it, as setuptools installs them under share/."""
    folders = [HERE / folder, *(path for path in (HERE / folder).rglob('*') if path.is_dir())]
    return [
        (
            f'share/{NAME}/{each.relative_to(HERE)}',
            [str(path.relative_to(HERE)) for path in sorted(each.iterdir()) if path.is_file()],
        )
        for each in folders
        if '__pycache__' not in each.parts
    ]


setup(
    name=NAME,
    version=VERSION,
    description='Single-shot fringe-projection inspection of aircraft skin from a drone',
    license='Apache-2.0',
    maintainer='The ftp_dent_ros maintainers',
    maintainer_email='maintainers@ftp-dent-ros.example',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared_files('config'),
        *shared_files('launch'),
        *shared_files('hook'),
    ],
    zip_safe=False,
    python_requires='>=3.10',
    package_data={
        f'{NAME}.calibration': ['templates/*.j2'],
        f'{NAME}.evaluation': ['templates/*.j2'],
        f'{NAME}.ground.page': ['*.html', '*.css', '*.js'],
        f'{NAME}.inspection': ['*.html', '*.js'],
        f'{NAME}.pages': ['*.html', '*.css'],
        f'{NAME}.survey': ['*.html', '*.js'],
    },
    install_requires=[
        'numpy>=1.26',
        'opencv-python-headless>=4.6',
        'pymavlink>=2.4.40',
        'pyserial>=3.5',
        'pyyaml>=6.0',
        'scipy>=1.11',
        'tqdm>=4.66',
    ],
    extras_require={
        # ROS 2 Jazzy as wheels (x86-64 Linux, Python 3.10 to 3.13): unpinned is another ROS.
        # Never beside a ROS that is sourced.
        'ros': [
            'ros-rclpy[fastrtps]==7.1.6',
            'ros-diagnostic-msgs==5.3.6',
            'ros-geometry-msgs==5.3.6',
            'ros-nav-msgs==5.3.6',
            'ros-sensor-msgs==5.3.6',
            'ros-std-msgs==5.3.6',
            'ros-std-srvs==5.3.6',
            'ros-visualization-msgs==5.3.6',
        ],
        # A window for the projector; on ROS machines apt's python3-sdl2.
        'display': ['pysdl2>=0.9.9', 'pysdl2-dll>=2.0.20'],
        'bags': ['mcap>=1.6', 'rosbags>=0.11'],
        # Pages and pictures: of inspect, calibrate, demo and evaluate. The nodes need neither.
        'reports': list(REPORTS),
        # The link to the ground; cryptography only to make its keys.
        'ground': ['aiohttp>=3.9', 'cryptography>=38', 'eclipse-zenoh>=1.0'],
        # Inspecting many bags on the machines of a Dask cluster; apt's python3-distributed.
        'cluster': list(CLUSTER),
        'test': [
            'colcon-common-extensions>=0.3',
            'pytest>=7.4',
            'pytest-xdist>=3.4',
            'setuptools>=59,<80',
            'wheel',
            *CLUSTER,
            *REPORTS,
        ],
        'lint': [
            'import-linter==2.16',
            'mypy==2.4.1',
            'ruff==0.17.5',
            'types-PyYAML',
            'types-tqdm',
        ],
    },
    entry_points={
        'console_scripts': [
            'ftp-dent = ftp_dent_ros.cli.main:main',
            'simulated_autopilot = ftp_dent_ros.simulation.autopilot:main',
            *(f'{name} = ftp_dent_ros.nodes.__main__:main' for name in NODES),
        ],
    },
)
