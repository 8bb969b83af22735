"""Figures, film and report of a run."""

import base64
import json
import re
from dataclasses import asdict
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
import torch

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.runs import train
from dntorch.runs.build import build_agent
from dntorch.runs.config import Config
from dntorch.runs.record import Record
from dntorch.runs.run import Trial
from dntorch.show import extracts, figures
from dntorch.show.report import write_report


def play(config: Config, steps: int, rewarded: bool = True) -> Record:
    """A made-up record: behaviours of 20 steps that repeat the sequence."""
    n = len(config.colors)
    record, random = Record(config.steps, ElementaryBehaviors(n)), np.random.default_rng(0)
    order = [config.colors.index(letter) for letter in config.sequence[:-1]]
    for t in range(steps):
        state, now = order[(t // 20 - 1) % len(order)], order[t // 20 % len(order)]
        record.intention[t, now] = record.satisfaction[t, state] = 1
        record.trace[t] = random.random((n, n)) / n
        record.error[t] = random.normal()
        record.weights[t // record.SPARSE] = random.random((n, n)) * rewarded
        if t % 20 == 0 and t:
            record.found[t] = record.reported[t] = state
            record.completed[t] = rewarded and t % 80 == 0
        record.length += 1
    return record


def results(config: Config, record: Record) -> dict:
    rewards = record.rewards.tolist()
    return {
        "version": "0.1.0", "world": config.world, "seed": config.seed, "steps": record.length,
        "steps_per_second": 432.1, "duration_seconds": 12.3, "behaviors": len(record.behaviors),
        "behaviors_in_exploration": 17, "rewards": rewards,
        "first_reward_step": rewards[0] if rewards else None, "optimal_at_end": bool(rewards),
        "disagreements": 0, "longest_intention_overlap": 2, "longest_cos_overlap": 3,
        "steps_without_state": 5, "value_matrix": record.weights[-1].T.tolist(),
        "config": asdict(config),
    }  # fmt: skip


# ---------------------------------------------------------------------------- figures


@pytest.mark.parametrize(
    ("config", "steps", "rewarded"),
    [
        (Config(steps=400, explore=200), 400, True),
        (Config(steps=400, explore=200), 130, True),
        (Config(steps=300, explore=0, world="nodes"), 300, False),
        (Config(steps=300, explore=300), 300, False),
        (Config(steps=1, explore=1), 1, False),
        (Config(steps=200, explore=100), 0, False),
        (Config(steps=200, explore=100, colors="RG", sequence="RGR"), 200, True),
        (Config(steps=400, explore=100, colors="ROYGCBVM", sequence="ROYGCBVMR"), 400, True),
    ],
)
def test_every_run_has_all_figures(config, steps, rewarded, tmp_path):
    record = play(config, steps, rewarded)
    paths = figures.write_figures(record, config, tmp_path)
    names = ["dynamics", "reward", "td_error", "trace", "values", "values_over_time"]
    assert [path.name for path in paths] == [f"{name}.png" for name in names]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)


def test_values_are_shown_with_the_state_down_and_the_action_across():
    config = Config(steps=100, explore=0)
    record = play(config, 100, rewarded=False)
    record.weights[-1, 1, 0] = 1  # action 1 in state 0
    shown = figures.values(record, config).axes[0].images[0].get_array()
    assert shown[0, 1] == 1 and shown.sum() == 1
    assert extracts.value_image(record.weights[-1])[0, 1] == 1


def test_a_chunk_holds_the_last_behaviours_of_its_phase():
    record = play(Config(steps=1000, explore=500), 1000)
    for first, last in ((0, 500), (500, 1000)):
        steps = extracts.chunk(record, first, last)
        completed = (record.reported[steps.start + 1 : steps.stop] >= 0).sum()
        assert completed == extracts.CHUNK and first <= steps.start < steps.stop <= last


def test_error_of_a_transition_is_the_mean_between_two_completions():
    record = play(Config(steps=100, explore=0), 100)
    ends, sizes = extracts.mean_errors(record)
    assert ends.tolist() == [40, 60, 80]
    assert sizes[0] == pytest.approx(np.abs(record.error[20:40]).mean(), rel=1e-5)
    assert extracts.running_mean(np.array([1.0, 2.0, 6.0]), 2).tolist() == [1.0, 1.5, 4.0]


# ---------------------------------------------------------------------------- report


class Page(HTMLParser):
    """Addresses that a page loads, and whether its tags are closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open, self.loads = [], []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.loads += [v for k, v in attributes if k in ("src", "href", "poster", "data")]
        self.open += [tag] * (tag not in ("meta", "img", "link"))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_report_is_one_file_with_every_number(tmp_path):
    config = Config(steps=400, explore=200, seed=12345, learning_rate=0.0625)
    record = play(config, 400)
    content = results(config, record)
    figures.write_figures(record, config, tmp_path)
    (tmp_path / "video.webm").write_bytes(b"film")
    html = write_report(tmp_path, content, config).read_text(encoding="utf-8")
    loads = Page(html).loads
    assert len(loads) == len(figures.FIGURES) + 1
    assert all(load.startswith(("data:image/png;base64,", "data:video/webm;")) for load in loads)
    assert not re.search(r"https?://|file:|@import|url\(|<script|<link", html)
    assert base64.b64encode(b"film").decode() in html
    table, verbatim = unescape(html).split("<pre>")
    assert json.loads(verbatim.split("</pre>")[0]) == content
    for name, value in {**content, **asdict(config)}.items():
        if name not in ("config", "value_matrix", "rewards", "optimal_at_end"):
            row = rf"<code>{name}</code></td><td class=\"number\">(<b>)?{re.escape(str(value))}<"
            assert re.search(row, table), name
    assert ", ".join(map(str, content["rewards"])) in table


def test_a_run_whose_states_are_several_completions_has_figures_and_a_report(tmp_path):
    config = Config(world="nodes", steps=40, explore=40, colors="GB", sequence="GB", recall=1)
    trial = Trial(config)
    trial.advance(40)
    trial.agent.weights[1, 2] = 0.5  # G after B, then G
    figures.write_figures(trial.record, config, tmp_path)
    page = unescape(write_report(tmp_path, train.results(trial, 40, 1.0), config).read_text())
    rows = re.findall(r"<th><span class=\"tile\"[^>]*>(\w+)</span></th>\s*<td", page)
    assert rows == ["GG", "BG", "GB", "BB"] and page.count(">0.5000<") == 1


@pytest.mark.parametrize("content", [{}, {"rewards": [], "first_reward_step": None, "odd": [[1]]}])
def test_a_report_without_figures_film_or_numbers_is_a_report(content, tmp_path):
    path = write_report(tmp_path, content, Config(world="nodes"))
    html = path.read_text(encoding="utf-8")
    assert not Page(html).loads and "not found in this run" in html


# ---------------------------------------------------------------------------- film


def frames(path) -> list[np.ndarray]:
    cv2 = pytest.importorskip("cv2")
    reader, seen = cv2.VideoCapture(str(path)), []
    while (read := reader.read())[0]:
        seen.append(read[1])
    return seen


def test_a_film_can_be_seen_and_leaves_the_agent_as_it_was(tmp_path):
    pytest.importorskip("pybullet")
    video = pytest.importorskip("dntorch.show.film")
    config = Config(steps=100, explore=0)
    agent = build_agent(config)
    agent.weights[1, 0] = 1
    agent.behaviors.intention.u.fill_(0.5)
    before = agent.snapshot()
    path = video.write_video(agent, config, tmp_path / "film.webm", max_steps=60)
    seen = frames(path)
    assert len(seen) == 15 and seen[0].shape[1::-1] == video.SIZE
    assert np.abs(seen[0].astype(int) - seen[-1]).max() > 50, "nothing moves"
    assert [p.name for p in tmp_path.iterdir()] == ["film.webm"]
    after = agent.snapshot()
    assert before.keys() == after.keys()
    for name, value in before.items():
        torch.testing.assert_close(after[name], value, rtol=0, atol=0)


def test_a_film_ends_after_its_behaviours(tmp_path, monkeypatch):
    pytest.importorskip("pybullet")
    video = pytest.importorskip("dntorch.show.film")
    config = Config(steps=100, explore=0, colors="RYGCB", sequence="RYG")
    path = video.write_video(build_agent(config), config, tmp_path / "v.webm", 1, fps=2)
    assert 2 < len(frames(path)) <= video.STEPS_EACH / 16 + 1


@pytest.mark.parametrize("explore", [60, 30])
def test_an_agent_without_phases_is_filmed_with_its_noise(explore):
    film = pytest.importorskip("dntorch.show.film")
    config = Config(
        world="ring", steps=60, explore=explore, seed=1, missing="B", sequence="GYRG", patience=9.0
    )
    actor, trial = build_agent(config), Trial(config)
    list(film._play(actor, config, behaviors=8, stride=10, max_steps=30))
    trial.advance(30)
    filmed, lived = (a.behaviors.intention.u.argmax() for a in (actor, trial.agent))
    assert (filmed == lived) == (explore == 60)


@pytest.mark.parametrize(("dt", "fps"), [(0.05, 8), (0.1, 8), (0.08, 25), (1 / 32, 8)])
def test_a_film_is_as_long_as_what_happens_in_it(dt, fps, tmp_path):
    cv2 = pytest.importorskip("cv2")
    video = pytest.importorskip("dntorch.show.film")
    config = Config(world="ring", steps=100, explore=0, dt=dt)
    path = video.write_video(build_agent(config), config, tmp_path / "v.webm", 8, fps, 40)
    reader = cv2.VideoCapture(str(path))
    shown = reader.get(cv2.CAP_PROP_FRAME_COUNT) / reader.get(cv2.CAP_PROP_FPS)
    stride = video.stride_of(fps, config)
    assert shown == pytest.approx(-(-40 // stride) * stride * dt, rel=0.02)


@pytest.mark.parametrize("fps", [0, -8, float("nan"), float("inf")])
def test_a_film_without_a_pace_is_refused(fps, tmp_path):
    video = pytest.importorskip("dntorch.show.film")
    config = Config(world="ring", steps=100, explore=0)
    with pytest.raises(ValueError, match=f"fps={fps} is not positive and finite"):
        video.write_video(build_agent(config), config, tmp_path / "v.webm", fps=fps)
    assert not list(tmp_path.iterdir())


def test_a_film_that_cannot_be_written_is_an_error(tmp_path):
    video = pytest.importorskip("dntorch.show.film")
    config = Config(world="ring", steps=100, explore=0)
    with pytest.raises(RuntimeError, match=r"cannot write .*nowhere"):
        video.write_video(build_agent(config), config, tmp_path / "nowhere" / "v.webm")


def test_the_film_shows_white_where_value_is_high():
    panels = pytest.importorskip("dntorch.show.panels")
    weights = np.zeros((4, 4), np.float32)
    weights[1, 0] = 1  # action 1 in state 0
    panel = panels._matrix(extracts.value_image(weights), "RGBY")
    cell = (panels.SIDE - 30) // 4
    middle = 30 + cell // 2
    assert panel[middle, middle + cell].tolist() == [255, 255, 255]
    assert panel[middle + cell, middle].tolist() == [0, 0, 0]
