"""The projector as this computer's display: pixel for pixel, with a desktop or without one."""
