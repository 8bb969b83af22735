"""Sections of the agent beyond the paper: run, judged and shown."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from dntorch.commands import dntorch
from dntorch.commands.beyond import NAMES
from dntorch.paper.beyond import SECTIONS
from dntorch.paper.beyond_study import MET, MISSED, REVISIONS, judge
from dntorch.paper.predictions import predictions


def beyond(*arguments: object):
    return CliRunner().invoke(dntorch, ["beyond", *map(str, arguments)])


def test_the_command_has_every_section() -> None:
    assert list(NAMES) == list(SECTIONS)


def test_every_prediction_is_about_a_line_that_there_is() -> None:
    expected = predictions("beyond")
    for section, lines in SECTIONS.items():
        there = lines(0, 2)
        revised = [name for when in REVISIONS for name in expected[when].get(section, {})]
        for name in [*expected[section], *revised]:
            assert name in there, (section, name)


def test_a_section_is_run_judged_and_shown_and_goes_on(tmp_path: Path) -> None:
    budget = ["change", "--runs", 2, "--steps", 100, "--processes", 1, "--out", tmp_path]
    chosen = ["--lines", "autonomous; two phases"]
    done = beyond(*budget, *chosen)
    assert done.exit_code == 0, (done.output, done.exception)
    assert (
        "missed  autonomous: optimal at the end, at least 0.9: 0 [0, 0.658], 2 runs" in done.output
    )
    assert "met     two phases: optimal at the end, at most 0.1" in done.output
    content = json.loads((tmp_path / "change.json").read_text())
    assert content["lines"].keys() == {"autonomous", "two phases"}
    assert content["lines"]["autonomous"]["discrete"]["to_relearn"] is None
    page = (tmp_path / "report.html").read_text()
    assert 'src="change.png"' in page and "missed" in page
    assert (tmp_path / "change.png").stat().st_size > 5000
    parts = {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    again = beyond(*budget, *chosen)
    assert again.exit_code == 0, again.output
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()} == parts


def test_a_prediction_is_judged_at_its_bound() -> None:
    row = {"runs": 100, "optimal": [90, 100], "optimal_interval": [0.8, 0.95], "to_relearn": 420.0}
    claims = judge("change", {"autonomous": row})
    assert [claim.verdict for claim in claims] == [MET] * 4
    worse = row | {"optimal": [89, 100], "to_relearn": None}
    assert [claim.verdict for claim in judge("change", {"autonomous": worse})] == [MISSED] * 4
    assert judge("change", {"a line without prediction": row}) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["change", "--lines", "nix"], "--lines='nix' is not in change: choose from autonomous"),
        (["nix"], "'nix' is not one of"),
        (["--world", "ring"], "--world=ring: name sections"),
        (["search", "--world", "ring"], "--world=ring: drawn sequences and worlds are abstract"),
        (["change", "--runs", "1"], "--runs"),
    ],
)
def test_what_cannot_be_run_is_refused_before_there_is_a_folder(arguments, words, tmp_path) -> None:
    done = beyond(*arguments, "--out", tmp_path / "out")
    assert done.exit_code != 0 and not (tmp_path / "out").exists()
    assert words in done.output + str(done.exception)
