"""300 runs of another simulator, end to end.

dynamic-neural-field-composer (C++, MIT License, (c) 2026 Jgocunha) ships 100 scenarios of
detection, selection, working memory, insufficient input and several peaks, each with three
sigmoids, and the activation after 500 steps with and 500 without stimuli.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from dntorch.cells.field import FieldState, field_step
from dntorch.cells.kernels import Gauss, Global, assemble

DATA = Path(__file__).parents[3] / "shared" / "data"
SITES = 100
KIND = {"sigmoid": "logistic", "abs_sigmoid": "abs", "heaviside": "heaviside"}


@pytest.fixture(scope="module")
def runs():
    if not (DATA / "dnfc_1d.json").exists():
        pytest.skip(f"no reference runs in {DATA}")
    with np.load(DATA / "dnfc_1d.npz") as arrays:
        references = [torch.from_numpy(arrays[k]) for k in ("with_stimulus", "without_stimulus")]
    return json.loads((DATA / "dnfc_1d.json").read_text())["decks"], references


def interaction(deck):
    terms = []
    for k in deck["kernels"]:
        terms.append(Global(k["amplitudeGlobal"]))
        if k["type"] == "gauss kernel":
            terms.append(Gauss(k["amplitude"], k["width"]))
        else:
            terms.append(Gauss(k["amplitudeExc"], k["widthExc"]))
            terms.append(Gauss(-k["amplitudeInh"], k["widthInh"]))
    (stack,), everywhere = assemble(terms, [SITES], "circular")
    assert everywhere == 0  # on one axis it is part of the matrix
    return stack


def stimulus(deck):
    site = torch.arange(SITES, dtype=torch.float64)
    total = torch.zeros(SITES, dtype=torch.float64)
    for s in deck["stimuli"]:
        distance = (site - (s["position"] - 1) + SITES / 2) % SITES - SITES / 2  # from one-based
        total += s["amplitude"] * torch.exp(-0.5 * (distance / s["width"]) ** 2)
    return total


@pytest.mark.parametrize("sigmoid", KIND)
def test_activation_agrees_with_another_simulator(runs, sigmoid):
    chosen = [i for i, deck in enumerate(runs[0]) if deck["sigmoid"] == sigmoid]
    decks = [runs[0][i] for i in chosen]
    assert len(decks) == 100 and all(deck["dt"] == deck["tau"] for deck in decks)
    kernels = torch.stack([interaction(deck) for deck in decks])
    input = torch.stack([stimulus(deck) for deck in decks])
    h = torch.tensor([deck["h"] for deck in decks], dtype=torch.float64)
    steepness = decks[0]["beta"] or 1.0

    def step(input, u, kernel, h):
        args = [kernel], 0.0, 1.0, h, KIND[sigmoid], steepness, 0.0, 1.0
        return field_step(input, FieldState(u), *args).u

    step = torch.vmap(step)
    u = input + h[:, None]  # the other's first step is without interaction
    for steps, reference, given in zip((499, 500), runs[1], (input, 0 * input), strict=True):
        for _ in range(steps):
            u = step(given, u, kernels, h)
        torch.testing.assert_close(u, reference[chosen].double(), atol=1e-4, rtol=0)
