"""The skin: its form, dents, fittings, paint, and what lies on it."""
