"""One frame of a film: what comes in and goes out of an agent, and what happens inside."""

from typing import NamedTuple

import cv2
import numpy as np

from dntorch.cells.functions import is_on
from dntorch.colors import NAMES
from dntorch.modules.sarsa import DNSarsa
from dntorch.runs.config import Config
from dntorch.show.extracts import value_image
from dntorch.show.figures import PAINT

GAP, WIDE, SIDE, HEIGHT = 20, 320, 208, 240
COLUMNS = [GAP] + [2 * GAP + WIDE + k * (SIDE + GAP) for k in range(3)]
ROWS = (88, 370)
SIZE = (COLUMNS[-1] + SIDE + GAP, ROWS[1] + HEIGHT + GAP)
"""Pixels, width and height: four panels in each of two rows."""
NIGHT, PLATE, TEXT, DIM = (17, 20, 26), (30, 35, 43), (236, 239, 244), (140, 149, 163)
RGB = {letter: tuple(bytes.fromhex(paint[1:])) for letter, paint in PAINT.items()}
FONT = cv2.FONT_HERSHEY_SIMPLEX


class Moment(NamedTuple):
    """What one frame tells."""

    outside: np.ndarray
    image: np.ndarray
    step: int
    found: int
    rewards: int
    rewarded: bool
    title: str = "outside"
    """of the panel that shows ``outside``"""


def draw(agent: DNSarsa, config: Config, moment: Moment) -> np.ndarray:
    """One frame, RGB: what comes in and goes out above, what happens inside below."""
    frame = np.full((SIZE[1], SIZE[0], 3), NIGHT, np.uint8)
    perception, satisfied, heading = (field.u.numpy() for field in agent.sensorimotor.state)
    intention, satisfaction = (r.numpy() for r in agent.behaviors.output(agent.behaviors.state))
    values, trace = (value_image(w.numpy()) for w in (agent.weights, agent.learner.trace.u))
    colors, (top, bottom), half = config.colors, ROWS, (WIDE - GAP) // 2
    outside = cv2.resize(moment.outside, (WIDE, HEIGHT), interpolation=cv2.INTER_AREA)
    _header(frame, config, moment)
    for x, y, title, note, picture in (
        (COLUMNS[0], top, moment.title, "", outside),
        (COLUMNS[1], top, "camera", "", _camera(moment.image, colors, intention)),
        (COLUMNS[2], top, "perceptual field", "hue by column", _field(perception)),
        (COLUMNS[3], top, "motor field", "heading", _curve(heading)),
        (COLUMNS[0], bottom, "intention", "", _bars(intention, colors, half)),
        (COLUMNS[0] + half + GAP, bottom, "CoS", "", _bars(satisfaction, colors, half)),
        (COLUMNS[1], bottom, "CoS field", "hue by column", _field(satisfied)),
        (COLUMNS[2], bottom, "values", "state by action", _matrix(values, colors)),
        (COLUMNS[3], bottom, "eligibility trace", "state by action", _matrix(trace, colors)),
    ):
        height, width = picture.shape[:2]
        frame[y : y + height, x : x + width] = picture
        _text(frame, title, x, y - 9)
        (length, _), _ = cv2.getTextSize(note, FONT, 0.4, 1)
        _text(frame, note, x + width - length, y - 9, 0.4, DIM)
    return frame


def _header(frame: np.ndarray, config: Config, moment: Moment) -> None:
    """Rewarded sequence on the left, time and score on the right."""
    pitch = min(34, WIDE // len(config.sequence))
    for k, letter in enumerate(config.sequence):
        _tile(frame, GAP + pitch * k, 16, min(28, pitch - 2), letter)
    color, weight = (RGB["Y"], 2) if moment.rewarded else (TEXT, 1)
    _text(frame, f"{moment.step * config.dt:.1f} s", COLUMNS[1], 38, 0.7)
    _text(frame, f"found: {moment.found}", COLUMNS[2], 38, 0.7)
    _text(frame, f"rewards: {moment.rewards}", COLUMNS[3], 38, 0.7, color, weight)


def _camera(image: np.ndarray, colors: str, intention: np.ndarray) -> np.ndarray:
    """The camera image, enlarged, and below it the colour that is wanted."""
    panel = np.full((HEIGHT, SIDE, 3), PLATE, np.uint8)
    height = min(SIDE * image.shape[0] // image.shape[1], HEIGHT - 72)
    panel[:height] = cv2.resize(image, (SIDE, height), interpolation=cv2.INTER_NEAREST)
    cv2.line(panel, (SIDE // 2, height), (SIDE // 2, height + 6), TEXT, 1)
    if is_on(intention).any():
        letter = colors[intention.argmax()]
        _tile(panel, 16, height + 26, 32, letter)
        _text(panel, f"find {NAMES[letter]}", 60, height + 49, 0.6)
    else:
        _text(panel, "deciding", 60, height + 49, 0.6, DIM)
    return panel


def _field(u: np.ndarray) -> np.ndarray:
    """Activation of a field of hue by column: rows in their hue, white where it is on."""
    hue = np.linspace(0, 360, len(u), endpoint=False, dtype=np.float32)[:, None] + 0 * u
    bright = ((u + 6) / 8).clip(0.12, 1)  # from resting level to well above threshold
    hsv = np.stack((hue, (1 - u / 6).clip(0.15, 0.85), bright), -1).astype(np.float32)
    rgb = (255 * cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)).astype(np.uint8)
    return cv2.resize(rgb, (SIDE, HEIGHT), interpolation=cv2.INTER_NEAREST)


def _curve(u: np.ndarray) -> np.ndarray:
    """Activation of a field of one axis, filled where it is above threshold."""
    panel = np.full((HEIGHT, SIDE, 3), PLATE, np.uint8)
    zero = HEIGHT // 2
    x = (np.arange(len(u)) + 0.5) * SIDE / len(u)
    y = (zero - u.clip(-9, 9) * zero / 10).round()
    curve = np.stack((x, y), -1).astype(np.int32)
    above = np.stack((x, y.clip(max=zero)), -1).astype(np.int32)
    peak = np.concatenate((above, [[x[-1], zero], [x[0], zero]])).astype(np.int32)
    cv2.fillPoly(panel, [peak], tuple(c // 2 for c in RGB["C"]))
    cv2.line(panel, (0, zero), (SIDE, zero), DIM, 1)
    cv2.line(panel, (SIDE // 2, 0), (SIDE // 2, HEIGHT), DIM, 1)
    cv2.polylines(panel, [curve], False, RGB["C"], 2, cv2.LINE_AA)
    _text(panel, "left", 8, HEIGHT - 10, 0.42, DIM)
    _text(panel, "right", SIDE - 40, HEIGHT - 10, 0.42, DIM)
    return panel


def _bars(rates: np.ndarray, colors: str, width: int) -> np.ndarray:
    """Firing rates of nodes, one bar each."""
    panel = np.full((HEIGHT, width, 3), PLATE, np.uint8)
    pitch, base = width / len(colors), HEIGHT - 34
    for k, (letter, rate) in enumerate(zip(colors, rates)):
        left, right = round((k + 0.15) * pitch), round((k + 0.85) * pitch)
        full = base - 14
        dark = tuple(c // 5 + 24 for c in RGB[letter])
        cv2.rectangle(panel, (left, 14), (right, base), dark, -1)
        cv2.rectangle(
            panel, (left, base - round(full * float(rate))), (right, base), RGB[letter], -1
        )
        _text(panel, letter, (left + right) // 2 - 5, HEIGHT - 11, 0.55, RGB[letter], 2)
    return panel


def _matrix(shown: np.ndarray, colors: str) -> np.ndarray:
    """A matrix of state (down) by action (across), white is high, with coloured letters.

    Where a state is more than one completion its rows stand without letters.
    """
    panel = np.full((HEIGHT, SIDE, 3), PLATE, np.uint8)
    n, edge = len(colors), 30
    low, high = min(0.0, float(shown.min())), float(shown.max())
    gray = (255 * (shown - low) / max(high - low, 1e-6)).clip(0, 255).astype(np.uint8)
    cell = (SIDE - edge) // n
    square = cv2.resize(gray, (n * cell, n * cell), interpolation=cv2.INTER_NEAREST)
    panel[edge : edge + n * cell, edge : edge + n * cell] = square[..., None]
    for k, letter in enumerate(colors):
        middle = edge + k * cell + cell // 2
        _text(panel, letter, middle - 6, 22, 0.55, RGB[letter], 2)
        if len(shown) == n:
            _text(panel, letter, 9, middle + 7, 0.55, RGB[letter], 2)
    _text(panel, f"white: {high:.2f}", edge, HEIGHT - 12, 0.42, DIM)
    return panel


def _tile(frame: np.ndarray, x: int, y: int, size: int, letter: str) -> None:
    cv2.rectangle(frame, (x, y), (x + size, y + size), RGB[letter], -1)
    _text(frame, letter, x + size // 2 - 7, y + size // 2 + 8, 0.65, TEXT, 2)


def _text(frame: np.ndarray, text: str, x: int, y: int, size=0.5, color=TEXT, weight=1) -> None:
    cv2.putText(frame, text, (x, y), FONT, size, color, weight, cv2.LINE_AA)
