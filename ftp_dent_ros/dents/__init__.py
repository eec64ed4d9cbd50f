"""Dents: what one is, the limits that it is held against, and the list of a flight."""
