"""Probability of detection: which dents are found, from the photograph to the list."""
