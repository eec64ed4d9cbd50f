"""Poses out of the autopilot's messages, their history, and how good they are."""
