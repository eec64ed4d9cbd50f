"""The package's processes and their modules: the one table of them.

``setup.py`` reads it too, so it imports nothing.
"""

# Name of a node, and the module beside it, with its function, that declares its parameters.
_NODES = {
    'pattern_publisher': 'pattern_parameters:declare',
    'camera_capture': 'camera_parameters:declare',
    'reconstruction': 'reconstruction_parameters:declare',
    'mavlink_bridge': 'bridge_parameters:declare',
    'dent_inspector': 'inspector_parameters:declare',
    'survey': 'survey_parameters:declare',
    'downlink': 'link_parameters:declare_downlink',
    'ground_station': 'link_parameters:declare_ground',
}
NODES = {name: f'ftp_dent_ros.nodes.{name}' for name in _NODES}
DECLARATIONS = {name: f'ftp_dent_ros.nodes.{place}' for name, place in _NODES.items()}
#: Not a ROS node: its parameters become its options.
SIMULATED_AUTOPILOT = 'simulated_autopilot'
EXECUTABLES = {**NODES, SIMULATED_AUTOPILOT: 'ftp_dent_ros.simulation.autopilot'}
# A payload flies without them: the survey, and the two ends of the link to the ground.
OPTIONAL = frozenset({'survey', 'downlink', 'ground_station'})
