"""The page: what a session shows, and what a user may do with it. Bokeh draws it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    ColumnDataSource,
    CustomJS,
    Div,
    MultiChoice,
    Select,
    Slider,
    Toggle,
)
from bokeh.palettes import viridis

from dntorch.live.drawing import LEVELS, Drawing
from dntorch.live.knobs import Knob
from dntorch.live.session import Session

SPEEDS = {
    "1/64": 1 / 64, "1/16": 1 / 16, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0, "2": 2.0, "4": 4.0,
    "16": 16.0, "as fast as it goes": float("inf"),
}  # fmt: skip
PERIOD = 20
"""ms between two looks for something new to draw"""
PATIENCE = 50
"""looks after which pictures that the browser has not confirmed are taken for lost"""
WIDTH = 290
KEYS = {" ": "play", ".": "step", "r": "reward"}

AHEAD = 2
"""pictures on their way at most"""
DRAW = Path(__file__).with_name("draw.js").read_text()


class Page:
    """One page in one browser; all pages of a session show the same.

    A picture is one message; it waits while two are on their way to the browser, so that a slow
    one sees fewer pictures and no late ones.
    """

    def __init__(self, session: Session, document: Document) -> None:
        self.session, self.document, self.drawing = session, document, Drawing()
        self.beat = ColumnDataSource(
            {"n": [0], "described": [""], "bytes": [np.zeros(1, np.uint8)]}
        )
        self.drawn = ColumnDataSource({"n": [0]})
        self.pressed = ColumnDataSource({"key": [""], "label": [""], "position": [[]], "n": [0]})
        self._version, self._waited, self._ready = -1, 0, False
        self._turned, self._peaks = -1, ()
        self._sliders: list[tuple[Knob, Slider]] = []
        self._busy = False
        self._make_controls()
        self.knobs = column(width=WIDTH)
        self._rebuild_knobs()
        document.add_root(column(*self.controls, self.knobs, width=WIDTH + 20))
        document.title = f"dntorch: {session.source.title}"
        arguments = {
            "beat": self.beat, "drawn": self.drawn, "pressed": self.pressed, "names": list(KEYS),
            "palette": [int(color[1:], 16) for color in viridis(LEVELS)],
        }  # fmt: skip
        document.js_on_event(DocumentReady, CustomJS(args=arguments, code=DRAW))
        self.beat.js_on_change("data", CustomJS(code="window.dntorch?.draw()"))
        document.on_event(DocumentReady, self._begin)
        document.add_periodic_callback(self.refresh, PERIOD)

    # ------------------------------------------------------------------ controls

    def _make_controls(self) -> None:
        session = self.session
        self.message = Div(text="", css_classes=["message"], width=WIDTH)
        # What no widget refers to belongs to the page by these tags.
        self.message.tags = [self.beat, self.drawn, self.pressed]
        self.play = Button(label="play", css_classes=["play"], width=66, button_type="primary")
        buttons = [self.play]
        for label, act in (
            ("step", lambda: session.step()), ("reset", self._reset), ("clear", session.clear)
        ):  # fmt: skip
            buttons.append(Button(label=label, css_classes=[label], width=66))
            buttons[-1].on_click(self._guarded(act))
        self.play.on_click(self._guarded(session.toggle))
        self.speed = Select(
            title="speed, simulated seconds per second", value="1", options=list(SPEEDS),
            css_classes=["speed"], width=WIDTH,
        )  # fmt: skip
        self._on(self.speed, "value", lambda name: session.set_speed(SPEEDS[name]))
        self.choice = MultiChoice(
            title="shown", value=session.shown, options=list(session.source.parts), width=WIDTH,
            css_classes=["shown"],
        )  # fmt: skip
        self._on(self.choice, "value", self._show)
        self.group = Select(title="parameters of", css_classes=["group"], width=WIDTH)
        self._on(self.group, "value", lambda _: self._rebuild_knobs())
        self.controls: list[Any] = [row(*buttons), self.message, self.speed]
        if session.source.rewarded:
            give = Button(label="reward (key r)", css_classes=["reward"], width=138)
            give.on_click(self._guarded(session.reward))
            learn = Toggle(label="learning", active=True, css_classes=["learn"], width=138)
            self._on(learn, "active", session.learn)
            self.controls.append(row(give, learn))
        self.controls += [self.choice, self.group]
        self._on(self.pressed, "data", self._press)

    def _on(self, widget: Any, name: str, act: Callable[[Any], Any]) -> None:
        """What a user's change of a widget does; not one that the page made itself."""

        def changed(attr: str, old: Any, new: Any) -> None:
            if not self._busy:
                self._do(lambda: act(new))

        widget.on_change(name, changed)

    def _press(self, data: dict[str, Any]) -> None:
        session, key = self.session, data["key"][0]
        acts = {"play": session.toggle, "step": session.step, "reward": session.reward}
        if key == "touch":
            session.touch(data["label"][0], list(data["position"][0]))
        elif key in KEYS:
            acts[KEYS[key]]()

    def _reset(self) -> None:
        self.session.reset()
        self.drawing.rescale()

    def _show(self, labels: list[str]) -> None:
        if labels != self.session.shown:
            self.session.shown = labels

    def _guarded(self, act: Callable[[], Any]) -> Callable[[], None]:
        return lambda: self._do(act)

    def _do(self, act: Callable[[], Any]) -> None:
        """What a user asked for; a refusal is shown."""
        try:
            act()
            self.message.text = ""
        except (ValueError, TypeError) as error:
            self.message.text = f"<b style='color:#b00'>{_plain(str(error))}</b>"

    # ------------------------------------------------------------------ knobs

    def _turn(self, knob: Knob, value: float) -> None:
        try:
            self.session.turn(knob, value)
        finally:
            self._agree()

    def _agree(self) -> None:
        """Sliders show what the structure has: a refused one goes back."""
        self._busy, self._turned = True, self.session.turned
        try:
            with self.session.lock:
                for knob, slider in self._sliders:
                    value = knob.read()
                    if abs(slider.value - value) > 1e-6 * max(1.0, abs(value)):
                        slider.value = value
        finally:
            self._busy = False

    def _rebuild_knobs(self) -> None:
        groups = self.session.knobs()
        put = list(self.session.peaks)
        self._peaks, self._turned = tuple(put), self.session.turned
        names = [name for name in groups if name not in put]
        self._busy = True
        try:
            self.group.options = names
            if self.group.value not in names:
                self.group.value = names[0] if names else ""
        finally:
            self._busy = False
        self._sliders, children = [], []
        for name in [self.group.value, *reversed(put[-3:])]:
            if name in put:
                children.append(Div(text=f"<b>{_plain(name)}</b>"))
            children += [self._slider(knob) for knob in groups.get(name, [])]
        self.knobs.children = children

    def _slider(self, knob: Knob) -> Slider:
        value = knob.read()
        low, high = min(knob.low, value), max(knob.high, value)
        name = "knob-" + "-".join(knob.name.split())
        slider = Slider(
            title=knob.name, value=value, start=low, end=high, step=_nice((high - low) / 200),
            format="0[.]000", css_classes=[name], width=WIDTH - 10,
        )  # fmt: skip
        self._on(slider, "value", lambda value: self._turn(knob, value))
        self._sliders.append((knob, slider))
        return slider

    # ------------------------------------------------------------------ pictures

    def _begin(self, _: Any) -> None:
        self._ready = True

    def refresh(self) -> None:
        """Send a picture, if there is a new one and the browser keeps up."""
        if not self._ready or self.session.version == self._version:
            return
        sent, drawn = self.beat.data["n"][0], self.drawn.data["n"][0]
        if sent - drawn >= AHEAD and self._waited < PATIENCE:
            self._waited += 1
            return
        self._waited, self._version = 0, self.session.version
        described, data = self.drawing.encode(self.session)
        self._follow()
        self.beat.data = {"n": [sent + 1], "described": [described], "bytes": [data]}

    def _follow(self) -> None:
        """Widgets show what the session has, whoever changed it."""
        session = self.session
        if tuple(session.peaks) != self._peaks:
            self._rebuild_knobs()
        elif session.turned != self._turned:
            self._agree()
        speed = next((name for name, value in SPEEDS.items() if value == session.speed), None)
        self._busy = True
        try:
            self.play.label = "pause" if session.playing else "play"
            self.choice.value = session.shown
            self.speed.value = speed or self.speed.value
        finally:
            self._busy = False


def _plain(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _nice(step: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above."""
    power = 10.0 ** int(f"{step:e}".split("e")[1])
    return max(each * power for each in (1, 2, 5) if each * power <= step * (1 + 1e-9))
