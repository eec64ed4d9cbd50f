"""Where images come from: a V4L2 device, files, or the simulated rig."""
