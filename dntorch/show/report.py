"""One HTML file that tells a run: numbers, figures, film, parameters; nothing else is needed."""

import base64
import dataclasses
import json
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from dntorch.files import write_atomically
from dntorch.runs.config import Config
from dntorch.show.figures import PAINT

FIGURES = {
    "dynamics.png": (
        "Continuous dynamics, discrete behaviours",
        "Intention and condition-of-satisfaction (CoS) nodes while the agent explored (left) and "
        "at the end of the run (right). A CoS node comes on when its colour is found, ends its "
        "intention, and stays on as the state until the next colour is found. The bars are the "
        "sequence of behaviours; a star marks a reward. Not all behaviours take the same time.",
        "the figure of intention and CoS nodes during exploration and after learning",
    ),
    "reward.png": (
        "Cumulative reward",
        "How many times the rewarded sequence was completed. While the agent explores it finds it "
        "by luck, if at all; the steeper and straighter the line is after the dashed end of "
        "exploration, the better it exploits.",
        "the cumulative reward of runs and of one example run",
    ),
    "td_error.png": (
        "Value cell: temporal difference error without the reward",
        "The value cell (above) compares the value of the pair that begins with that of the pair "
        "that ends; below, its mean size in each transition. The reward is not in it: the cell "
        "grows with the values, and learning settles where it balances the reward.",
        "the average TD-error",
    ),
    "trace.png": (
        "Eligibility trace: item-and-order memory",
        "The activity of pairs of a state and the action taken in it. The newest pair is the "
        "strongest and older ones follow in order, so that one reward teaches the whole sequence; "
        "between transitions the pattern stands still, however long a behaviour takes.",
        "the equation of the item-and-order working memory, which has no figure there",
    ),
    "values.png": (
        "What was learned",
        "Values of choosing an action (the next colour, across) in a state (the last colour, "
        "down); white is high and the frames mark the rewarded sequence. The agent stores weights "
        "as [action, state]: they are transposed here.",
        "the value matrix in the video of the robot, with the same axes",
    ),
    "values_over_time.png": (
        "How the values grew",
        "The values of the strongest pairs of state and action. Each reward lifts the pairs in the "
        "trace; wrong shortcuts fade when they lead to no reward.",
        "the unlearning of shortcuts, which its text describes",
    ),
}
"""File, title, what one sees, and the counterpart in the paper."""

MEANING = {
    "version": "of dntorch",
    "world": "epuck: PyBullet and a camera; nodes: abstract",
    "seed": "of layout, exploration and durations",
    "steps": "control steps taken",
    "steps_per_second": "speed of the run",
    "duration_seconds": "time the run took",
    "behaviors": "colours found, as the world judged",
    "behaviors_in_exploration": "colours found while exploring",
    "rewards": "steps in which the sequence was completed",
    "first_reward_step": "step of the first completed sequence",
    "found_in_exploration": "the sequence was first completed while exploring",
    "optimal_at_end": "the last behaviours repeated the rewarded sequence with hardly an error",
    "failures": "intentions that were given up without success",
    "disagreements": "behaviours that agent and world saw differently",
    "longest_intention_overlap": "most steps in a row with two intentions on",
    "longest_cos_overlap": "most steps in a row with two CoS nodes on",
    "steps_without_state": "steps after the first found colour without any CoS node on",
}
APART = ("config", "value_matrix", "value_matrix_axes", "states", "colors")
"""Results that have a table of their own."""


def write_report(
    folder: Path, results: dict[str, Any], config: Config, video: str = "video.webm"
) -> Path:
    """Gather the results, figures and film of a run in ``folder/report.html``.

    A figure or film that is not in ``folder`` is left out.
    """
    folder = Path(folder)
    figures = [
        {"title": title, "text": text, "paper": paper, "data": _embed(folder / name)}
        for name, (title, text, paper) in FIGURES.items()
        if (folder / name).is_file()
    ]
    film = folder / video
    html = _template().render(
        config=config,
        results=results,
        states=results.get("states") or list(config.colors),
        rewards=results.get("rewards") or [],
        matrix=_matrix(results.get("value_matrix") or []),
        numbers=[(k, v, MEANING.get(k, "")) for k, v in results.items() if k not in APART],
        parameters=[
            (field.name, getattr(config, field.name), field.default)
            for field in dataclasses.fields(config)
        ],
        figures=figures,
        video=_embed(film) if film.is_file() else None,
        verbatim=json.dumps(results, indent=1),
        paint=PAINT,
    )
    path = folder / "report.html"
    write_atomically(path, lambda file: file.write(html.encode()))
    return path


def _template():
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = resources.files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    return environment.from_string(source)


def _embed(path: Path) -> Markup:
    """The file itself as an address."""
    kind = {".png": "image/png", ".webm": "video/webm"}[path.suffix]
    return Markup(f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}")


def _matrix(values: list[list[float]]) -> list[list[dict[str, Any]]]:
    """Values ``[state][action]`` with the gray they are shown on, 0 black to 255 white."""
    flat = [value for row in values for value in row]
    low, high = min([0.0, *flat]), max([0.0, *flat])
    scale = 255 / (high - low) if high > low else 0
    return [
        [{"value": value, "gray": round(scale * (value - low))} for value in row] for row in values
    ]
