"""The package's processes and their modules: the one table of them.

``setup.py`` reads it too, so it imports nothing.
"""

# Name of a node, and of the module beside it that declares its parameters.
_NODES = {
    'pattern_publisher': 'pattern_parameters',
    'camera_capture': 'camera_parameters',
    'reconstruction': 'reconstruction_parameters',
    'mavlink_bridge': 'bridge_parameters',
    'dent_inspector': 'inspector_parameters',
    'survey': 'survey_parameters',
    'downlink': 'downlink_parameters',
    'ground_station': 'ground_parameters',
}
NODES = {name: f'ftp_dent_ros.nodes.{name}' for name in _NODES}
PARAMETERS = {name: f'ftp_dent_ros.nodes.{module}' for name, module in _NODES.items()}
#: Not a ROS node: its parameters become its options.
SIMULATED_AUTOPILOT = 'simulated_autopilot'
EXECUTABLES = {**NODES, SIMULATED_AUTOPILOT: 'ftp_dent_ros.simulation.autopilot'}
# A payload flies without them: the survey, and the two ends of the link to the ground.
OPTIONAL = frozenset({'survey', 'downlink', 'ground_station'})
