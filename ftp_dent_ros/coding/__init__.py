"""Clouds in few bytes, for thin links and small bags."""
