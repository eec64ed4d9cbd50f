"""Bytes to and from an autopilot, as messages, and who speaks on the link."""
