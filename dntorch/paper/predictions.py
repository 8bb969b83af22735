"""What was predicted, and by which margins it is judged: written down before the runs."""

import json
from importlib import resources
from typing import Any


def predictions(part: str) -> dict[str, Any]:
    """A part of ``predictions.json``: ``main``, ``controls`` or ``sensitivity``."""
    text = resources.files(__package__).joinpath("predictions.json").read_text()
    return json.loads(text)[part]
