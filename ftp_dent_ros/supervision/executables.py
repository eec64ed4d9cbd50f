"""The package's processes: the one table of them.

``setup.py`` reads it too, so it imports nothing.
"""

#: Each is run by `ftp_dent_ros.nodes`, in the module of its name.
NODES = (
    'pattern_publisher',
    'camera_capture',
    'reconstruction',
    'mavlink_bridge',
    'dent_inspector',
    'survey',
    'downlink',
    'ground_station',
)
#: Not a ROS node: its parameters become its options.
SIMULATED_AUTOPILOT = 'simulated_autopilot'
EXECUTABLES = (*NODES, SIMULATED_AUTOPILOT)
# A payload flies without them: the survey, and the two ends of the link to the ground.
OPTIONAL = frozenset({'survey', 'downlink', 'ground_station'})
