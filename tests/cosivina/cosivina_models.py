"""Small COSIVINA files, and where the public ones lie."""

import json
from pathlib import Path

import pytest

DATA = Path(__file__).parents[3] / "shared" / "data" / "cosivina"
PUBLIC = sorted(DATA.glob("*.json"))
LARGE = ("DCCS", "LookingModel", "wolves")


def public(*, large: bool | None = None) -> pytest.MarkDecorator:
    """Parametrise over the public files; skip, by name, where they are not there."""
    chosen = [
        path
        for path in PUBLIC
        if large is None or any(word in path.name for word in LARGE) == large
    ]
    none = pytest.param(None, marks=pytest.mark.skip(reason=f"no COSIVINA files in {DATA}"))
    return pytest.mark.parametrize("path", chosen or [none], ids=lambda path: path and path.stem)


def element(label, kind, *inputs, **parameters):
    """One element; an input is a label, or a label and a component."""
    reads = [each if isinstance(each, tuple) else (each, "output") for each in inputs]
    return {
        "label": label,
        "class": kind,
        "param": parameters,
        "nInputs": len(reads),
        "input": [{"label": a, "component": b} for a, b in reads],
    }


def field(label, size, *inputs, tau=10, h=-5, beta=4):
    return element(label, "NeuralField", *inputs, size=size, tau=tau, h=h, beta=beta)


def pattern(label, size, numbers):
    return element(label, "CustomStimulus", size=size, pattern=numbers)


def write(folder, *elements, delta_t=1):
    """A file of elements; returns its path."""
    simulator = {
        "deltaT": delta_t,
        "tZero": 0,
        "nElements": len(elements),
        "elementLabels": [each["label"] for each in elements],
        "elements": list(elements),
    }
    path = folder / "model.json"
    path.write_text(json.dumps({"simulator": simulator}))
    return path
