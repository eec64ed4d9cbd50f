"""Fringes fitted to bins: a first time about a plane, a second time about the surface itself."""
