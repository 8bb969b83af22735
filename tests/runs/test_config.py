"""A config holds finite numbers within its limits, wherever they come from."""

import json
import math
from pathlib import Path

import pytest

from dntorch import files
from dntorch.runs.build import build_agent
from dntorch.runs.config import FIELDS, Config
from dntorch.runs.run import Trial, load_trained
from dntorch.runs.settings import read_settings


def wrong_values(name: str) -> list:
    within = FIELDS[name].metadata["within"]
    if within is None:
        wrong = ["mars", 3, None, "R" * 100]
        return wrong if FIELDS[name].default == "" else ["", *wrong]
    values = [math.nan, math.inf, -math.inf, within.least - 1, within.most + 1, 1e300, 10**400]
    values += ["1", None, True, [1]]
    values += [within.least] if within.above else []
    return values + ([1.5, 1e10] if within.whole else [])


CASES = [
    pytest.param(name, value, id=f"{name} {repr(value)[:20]}")
    for name in FIELDS
    for value in wrong_values(name)
]


@pytest.mark.parametrize(("name", "value"), CASES)
def test_a_wrong_value_is_refused_by_name(name: str, value, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"^{name}="):
        Config(**{name: value})
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"config": {name: value}}))
    if name not in ("sequence", "colors", "then", "missing"):  # they are checked together
        with pytest.raises(ValueError, match=f"results.json: {name}="):
            read_settings(file)
    checkpoint = tmp_path / "checkpoint.pt"
    files.save(checkpoint, {"config": vars(Config()) | {name: value}, "world": {}, "compiled": 0})
    for load in (Trial.load, load_trained):
        with pytest.raises(ValueError, match=f"checkpoint.pt cannot be used: {name}="):
            load(checkpoint)


@pytest.mark.parametrize("name", [name for name, each in FIELDS.items() if each.type is not str])
def test_every_number_has_limits_and_its_default_keeps_them(name: str) -> None:
    within = FIELDS[name].metadata["within"]
    assert math.isfinite(within.least) and math.isfinite(within.most)
    assert FIELDS[name].default in within and within.whole == (FIELDS[name].type is int)


def test_the_limits_themselves_make_an_agent() -> None:
    """What is within the limits is not refused later for its size."""
    build_agent(Config(width=8, height=6, reward=-1000.0, noise=1000.0, learning_rate=100.0))
    build_agent(Config(width=640, height=480, substeps=100, trace_tau=3600.0))
    assert Config(dt=0.001, reward_duration=3600, seed=2**32 - 1).reward_duration == 3600
    assert Config(steps=10_000_000, explore=0).explore == 0


def test_a_config_of_another_version_says_so(tmp_path: Path) -> None:
    files.save(tmp_path / "c.pt", {"config": {"volume": 3}, "world": {}, "compiled": False})
    for load in (Trial.load, load_trained):
        with pytest.raises(ValueError, match="another version of dntorch"):
            load(tmp_path / "c.pt")


@pytest.mark.parametrize("text", ["[" * 100_000, '{"config": {"noise": NaN}}', "[[", "1" * 2**21])
def test_a_hostile_file_is_one_sentence(text: str, tmp_path: Path) -> None:
    for name in ("a.json", "a.toml"):
        (tmp_path / name).write_text(text)
        with pytest.raises(ValueError, match=name):
            read_settings(tmp_path / name)


def test_a_device_without_an_end_is_read_to_a_limit() -> None:
    with pytest.raises(ValueError, match="zero cannot be used"):
        read_settings(Path("/dev/zero"))
