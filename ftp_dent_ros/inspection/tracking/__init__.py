"""Dents over the clouds of a flight: seen again they are still the same dents."""
