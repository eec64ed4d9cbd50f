"""All poses of a survey at once, from pairs of clouds and from the autopilot."""
