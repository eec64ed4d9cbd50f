"""The simulated world: skin, light, flight and autopilot."""
