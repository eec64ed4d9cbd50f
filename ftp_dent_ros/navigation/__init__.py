"""The autopilot: MAVLink link, clock, pose history, frame conversions."""
