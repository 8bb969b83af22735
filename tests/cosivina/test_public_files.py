"""Public models: the same numbers as COSIVINA's Python port, and the same lags."""

import json

import numpy as np
import pytest
import torch
from cosivina_models import public

from dntorch import Architecture
from dntorch.cosivina import load, noise, save


def run(model, steps, state=None):
    """States after each step, by label."""
    state, states = model.initial([]) if state is None else state, []
    with torch.no_grad():
        for _ in range(steps):
            _, state = model.step({}, state)
            states.append(state)
    return states


def members(model):
    """Labels of fields and traces."""
    return [element.label for element in model.elements.values() if not element.passing]


def furthest(a, b, labels):
    return max(float((a[label] - b[label]).abs().max()) for label in labels)


def errors(path, states):
    """Furthest from the port's activations, for the steps that are recorded."""
    found = {}
    with np.load(path.with_suffix(".npz")) as reference:
        for key in reference.files:
            step, label = key.split("|", 1)
            ours = states[int(step) - 1][label]
            error = (ours - torch.from_numpy(reference[key]).reshape(ours.shape)).abs().max()
            found[int(step)] = max(found.get(int(step), 0.0), float(error))
    return found


@public(large=False)
def test_with_its_first_step_a_model_runs_as_in_cosivina(path):
    model = load(path, torch.float64, first_step=True)
    found = errors(path, run(model, 60))
    assert list(found) == [1, 10, 60]
    assert max(found.values()) < 1e-10, found


@public(large=False)
def test_without_it_couplings_act_from_the_start(path):
    """A field at rest is not quite silent: a fast or biased model starts a little elsewhere."""
    exact = load(path, torch.float64, first_step=True)
    model = load(path, torch.float64)
    (first,), (ours,) = run(exact, 1), run(model, 1)
    assert not model.ordered and exact.ordered
    changed = {label for label in members(model) if not torch.equal(first[label], ours[label])}
    stimuli = {stimulus.label for stimulus in exact.stimuli.values()}
    coupled = {link.target for link in exact.links if link.source not in stimuli}
    assert changed <= coupled & set(members(model))
    assert furthest(first, ours, members(model)) < 1e-3


@public()
def test_from_the_same_state_it_steps_as_cosivina_does(path):
    """Default lags are those of the file, whatever was silent in the first step."""
    exact, model = load(path, torch.float64, first_step=True), load(path, torch.float64)
    labels = members(model)
    assert labels and set(labels) == set(members(exact))
    ours = model.initial([])
    for theirs in run(exact, 7):  # relays that only we have see what the others do
        ours |= {label: x for label, x in theirs.items() if label in ours}
        before, (ours,) = theirs, run(model, 1, ours)
    assert furthest(run(exact, 1, before)[-1], ours, labels) < 1e-10


@public(large=True)
def test_large_models_load_in_float32_and_stay_finite(path):
    model = load(path)
    given = {label: torch.randn(shape) for label, shape in noise(path).items()}
    state = model.initial([])
    for _ in range(3):
        outputs, state = model.step(given, state)
    assert all(x.dtype == torch.float32 and x.isfinite().all() for x in state.values())
    assert set(outputs) == set(members(model))


@public()
def test_labels_are_those_of_the_file(path):
    elements = json.loads(path.read_text())["simulator"]["elements"]
    model = load(path)
    for kinds, ours in (
        (("NeuralField", "MemoryTrace"), set(members(model))),
        (("GaussStimulus1D", "GaussStimulus2D", "NormalNoise", "BoostStimulus"),
         {stimulus.label for stimulus in model.stimuli.values()}),
    ):  # fmt: skip
        labels = {each["label"] for each in elements if each["class"] in kinds}
        assert labels <= ours
    for each in elements:
        if each["class"] == "NeuralField":
            size = [n for n in each["param"]["size"] if n > 1]
            assert list(model.state[each["label"]].shape) == size
            assert model[each["label"]].tau == pytest.approx(each["param"]["tau"] / 1000)


@public()
def test_a_saved_model_is_the_same_model(path, tmp_path):
    model = load(path, torch.float64)
    save(model, tmp_path / "again.json", noise=list(noise(path)))
    again = load(tmp_path / "again.json", torch.float64)
    assert isinstance(again, Architecture) and again.ordered == model.ordered
    assert noise(tmp_path / "again.json") == noise(path)
    ours, theirs = run(model, 4), run(again, 4)
    assert furthest(ours[-1], theirs[-1], members(model)) < 1e-12
