"""Scenes are rendered once for all tests of this folder."""

from functools import cache

import pytest
from small_scenes import SCENES


@pytest.fixture(scope='session')
def scene():
    """Function that renders the scene of a name."""
    return cache(lambda name: SCENES[name]())
