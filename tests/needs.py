"""Marks of tests that need a package which not every Python has."""

from importlib.util import find_spec

import pytest


def needs(*packages: str) -> pytest.MarkDecorator:
    """Skip, by name, where one is not installed."""
    missing = [name for name in packages if not find_spec(name)]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)}")


EPUCK = pytest.param("epuck", marks=needs("pybullet"))
"""the world among others"""
