"""The simulated autopilot: real MAVLink 2 over a real link."""
