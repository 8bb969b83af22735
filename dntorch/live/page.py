"""The page: what a session shows, and what a user may do with it. Bokeh draws it."""

from collections.abc import Callable
from typing import Any

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

from dntorch.live.drawing import Panel, image_panel, matrix_panel, part_panel
from dntorch.live.knobs import Knob
from dntorch.live.session import Session

SPEEDS = {
    "1/64": 1 / 64, "1/16": 1 / 16, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0, "2": 2.0, "4": 4.0,
    "16": 16.0, "as fast as it goes": float("inf"),
}  # fmt: skip
PERIOD = 20
"""ms between two looks for something new to draw"""
PATIENCE = 50
"""looks after which a picture that the browser has not confirmed is taken for lost"""
WIDTH = 290
KEYS = {" ": "play", ".": "step", "r": "reward"}

DRAWN = """
requestAnimationFrame(() => { drawn.data = {n: [beat.data.n[0]]} })
"""
PRESSED = """
if (window.dntorch_keys) return
window.dntorch_keys = true
document.addEventListener("keydown", (event) => {
  const path = event.composedPath()
  const typing = path.some((x) => x.matches && x.matches("input, select, .noUi-handle, button"))
  if (typing && event.key === " ") return
  if (path.some((x) => x.matches && x.matches("input[type=text], textarea"))) return
  if (!names.includes(event.key) || event.repeat) return
  if (event.key === " ") event.preventDefault()
  pressed.data = {key: [event.key], n: [pressed.data.n[0] + 1]}
})
"""


class Page:
    """One page in one browser; all pages of a session show the same.

    A picture is one message; the next is sent when the browser has drawn the last.
    """

    def __init__(self, session: Session, document: Document) -> None:
        self.session, self.document = session, document
        self.beat = ColumnDataSource({"n": [0]})
        self.drawn = ColumnDataSource({"n": [0]})
        self.pressed = ColumnDataSource({"key": [""], "n": [0]})
        self.panels: list[Panel] = []
        self._version, self._waited, self._ready, self._layout = -1, 0, False, ()
        self._sliders: dict[tuple[str, str], Slider] = {}
        self._busy = False
        self._make_controls()
        self.figures, self.knobs = column(), column(width=WIDTH)
        self._rebuild()
        document.add_root(row(column(*self.controls, self.knobs, width=WIDTH + 20), self.figures))
        document.title = f"dntorch: {session.source.title}"
        self.beat.js_on_change(
            "data", CustomJS(args={"beat": self.beat, "drawn": self.drawn}, code=DRAWN)
        )
        keys = {"pressed": self.pressed, "names": list(KEYS)}
        document.js_on_event(DocumentReady, CustomJS(args=keys, code=PRESSED))
        document.on_event(DocumentReady, self._begin)
        document.add_periodic_callback(self.refresh, PERIOD)

    # ------------------------------------------------------------------ controls

    def _make_controls(self) -> None:
        session = self.session
        self.message = Div(text="", css_classes=["message"], width=WIDTH)
        self.status = Div(text="", css_classes=["status"], width=WIDTH)
        # What no figure refers to belongs to the page by these tags.
        self.status.tags = [self.beat, self.drawn, self.pressed]
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
        self.controls: list[Any] = [row(*buttons), self.status, self.message, self.speed]
        if session.source.rewarded:
            give = Button(label="reward (key r)", css_classes=["reward"], width=138)
            give.on_click(self._guarded(session.reward))
            learn = Toggle(label="learning", active=True, css_classes=["learn"], width=138)
            self._on(learn, "active", session.learn)
            self.controls.append(row(give, learn))
        self.controls += [self.choice, self.group]
        self._on(self.pressed, "data", lambda data: self._press(data["key"][0]))

    def _on(self, widget: Any, name: str, act: Callable[[Any], Any]) -> None:
        """What a user's change of a widget does; not one that the page made itself."""

        def changed(attr: str, old: Any, new: Any) -> None:
            if not self._busy:
                self._do(lambda: act(new))

        widget.on_change(name, changed)

    def _press(self, key: str) -> None:
        session = self.session
        acts = {"play": session.toggle, "step": session.step, "reward": session.reward}
        if key in KEYS:
            acts[KEYS[key]]()

    def _reset(self) -> None:
        self.session.reset()
        for panel in self.panels:
            panel.rescale()

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
            self.session.set(knob.group, knob.name, value)
        finally:
            self._agree()

    def _agree(self) -> None:
        """Sliders show what the structure has: a refused one goes back."""
        self._busy = True
        try:
            for (group, name), slider in self._sliders.items():
                try:
                    value = self.session.get(group, name)
                except ValueError:
                    continue
                if abs(slider.value - value) > 1e-6 * max(1.0, abs(value)):
                    slider.value = value
        finally:
            self._busy = False

    def _rebuild_knobs(self) -> None:
        groups = self.session.knobs()
        put = [name for name in self.session.peaks]
        names = [name for name in groups if name not in put]
        self._busy = True
        try:
            self.group.options = names
            if self.group.value not in names:
                self.group.value = names[0] if names else ""
        finally:
            self._busy = False
        self._sliders, children = {}, []
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
        self._sliders[knob.group, knob.name] = slider
        return slider

    # ------------------------------------------------------------------ pictures

    def _rebuild(self) -> None:
        """Figures and knobs for what is shown now."""
        session = self.session
        self._layout = (tuple(session.shown), tuple(session.peaks))
        self._rebuild_knobs()
        extras = [image_panel(*each) for each in session.images().items()]
        extras += [matrix_panel(*each) for each in session.matrices().items()]
        pictures = session.pictures()
        parts = [part_panel(label, pictures[label], self._touch) for label in session.shown]
        self.panels = [*extras, *parts]
        rows = [row(*(panel.figures[0] for panel in extras))] if extras else []
        self.figures.children = [*rows, *(row(*panel.figures) for panel in parts)]

    def _touch(self, label: str, position: list[float]) -> None:
        self._do(lambda: self.session.touch(label, position))

    def _begin(self, _: Any) -> None:
        self._ready = True

    def refresh(self) -> None:
        """Send a picture, if there is a new one and the browser has drawn the last."""
        if not self._ready or self.session.version == self._version:
            return
        sent = self.beat.data["n"][0]
        if self.drawn.data["n"][0] != sent and self._waited < PATIENCE:
            self._waited += 1
            return
        self._waited, self._version = 0, self.session.version
        self.document.hold("combine")
        try:
            self._draw()
            self.beat.data = {"n": [sent + 1]}
        finally:
            self.document.unhold()

    def _draw(self) -> None:
        session = self.session
        layout = (tuple(session.shown), tuple(session.peaks))
        if layout[0] != self._layout[0]:
            self._rebuild()
        elif layout != self._layout:
            self._layout = layout
            self._rebuild_knobs()
        with session.lock:
            new = {**session.images(), **session.matrices(), **session.pictures()}
            note, time, playing = session.note(), session.time, session.playing
        for panel in self.panels:
            panel.draw(new[panel.title])
        self.play.label = "pause" if playing else "play"
        pace = f", {session.pace:.2g} s per second" if playing and session.pace else ""
        self.status.text = f"<b>{time:.3f} s</b>{pace}<br>{_plain(note)}"
        self._agree()
        self._busy = True
        try:
            self.choice.value = session.shown
            self.speed.value = next(k for k, v in SPEEDS.items() if v == session.speed)
        except StopIteration:  # a speed set from Python
            pass
        finally:
            self._busy = False


def _plain(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _nice(step: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above."""
    power = 10.0 ** int(f"{step:e}".split("e")[1])
    return max(each * power for each in (1, 2, 5) if each * power <= step * (1 + 1e-9))


