"""``ftp-dent calibrate``: a board under projected patterns to ``rig.yaml``."""

# Each is a module `calibrate_STEP`.
COMMANDS = {
    'check': 'whether a rig still holds, from one photograph of a wall, a board or the skin',
    'capture': 'photographs of a board in many poses, through the nodes of a running payload',
    'solve': 'photographs of a board in many poses to rig.yaml and a page',
}
