"""The package's processes and their modules: the one table of them.

``setup.py`` reads it too, so it imports nothing.
"""

_NODES = (
    'pattern_publisher',
    'camera_capture',
    'reconstruction',
    'mavlink_bridge',
    'dent_inspector',
    'survey',
    'downlink',
    'ground_station',
)
NODES = {name: f'ftp_dent_ros.nodes.{name}' for name in _NODES}
#: Not a ROS node: its parameters become its options.
SIMULATED_AUTOPILOT = 'simulated_autopilot'
EXECUTABLES = {**NODES, SIMULATED_AUTOPILOT: 'ftp_dent_ros.simulation.autopilot'}
# A payload flies without them: the survey, and the two ends of the link to the ground.
OPTIONAL = frozenset({'survey', 'downlink', 'ground_station'})
