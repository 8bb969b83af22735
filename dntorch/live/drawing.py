"""Figures of a page: lines, heat maps, space-time plots, pictures."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    LinearAxis,
    LinearColorMapper,
    Range1d,
)
from bokeh.plotting import figure

from dntorch.live.session import ROWS, Picture

Touch = Callable[[str, list[float]], None]
SIZE = 250
PALETTE = "Viridis256"
BLUE, GREEN, ORANGE = "#1f5fa8", "#2a9d43", "#d97706"


class Panel:
    """Figures that show one thing; ``draw`` gives them new numbers."""

    def __init__(self, title: str) -> None:
        self.title, self.figures = title, []
        self.scales: list[Scale] = []

    def draw(self, new: Any) -> None:
        raise NotImplementedError

    def rescale(self) -> None:
        """Begin anew with the ranges of values."""
        for scale in self.scales:
            scale.low, scale.high = math.inf, -math.inf


class Scale:
    """A range of values that grows with them, in few steps."""

    def __init__(self, ends: Any, low: str, high: str, least: float = 1.0) -> None:
        self.ends, self.names, self.least = ends, (low, high), least
        self.low, self.high = math.inf, -math.inf

    def fit(self, *arrays: np.ndarray) -> None:
        known = [array[np.isfinite(array)] for array in arrays]
        known = [array for array in known if array.size]
        if not known:
            return
        low, high = min(float(x.min()) for x in known), max(float(x.max()) for x in known)
        if low >= self.low and high <= self.high:
            return
        low, high = min(low, self.low), max(high, self.high)
        unit = 10.0 ** math.floor(math.log10(max(high - low, self.least))) / 2
        self.low, self.high = unit * math.floor(low / unit), unit * math.ceil(high / unit)
        if self.high <= self.low:
            self.high = self.low + self.least
        for name, value in zip(self.names, (self.low, self.high)):
            setattr(self.ends, name, value)


def _blank(title: str, **options: Any) -> Any:
    size = {"width": SIZE, "height": SIZE} | options
    drawn = figure(title=title, tools="", toolbar_location=None, **size)
    drawn.title.text_font_size = "10pt"
    drawn.grid.visible = False
    return drawn


class Map:
    """A heat map of ``(rows, columns)``, row 0 on top; its sites have whole numbers."""

    def __init__(self, title: str, array: np.ndarray, least: float = 1.0, **options: Any) -> None:
        rows, columns = array.shape
        self.source = ColumnDataSource({"image": [array]})
        self.mapper = LinearColorMapper(PALETTE, low=0, high=1, nan_color="#dddddd")
        self.scale = Scale(self.mapper, "low", "high", least)
        self.figure = _blank(
            title, x_range=Range1d(-0.5, columns - 0.5), y_range=Range1d(rows - 0.5, -0.5),
            **options,
        )  # fmt: skip
        self.figure.image(
            "image", x=-0.5, y=-0.5, dw=columns, dh=rows, source=self.source,
            color_mapper=self.mapper, origin="top_left",
        )  # fmt: skip
        bar = ColorBar(color_mapper=self.mapper, width=8, padding=4, margin=0)
        self.figure.add_layout(bar, "right")

    def draw(self, array: np.ndarray) -> None:
        self.scale.fit(array)
        self.source.data = {"image": [array]}


class PartPanel(Panel):
    """Activation, output, input and the space-time plot of a part."""

    def __init__(self, title: str, picture: Picture, touch: Touch) -> None:
        super().__init__(title)
        self.trail = Map(
            "space-time: activation, newest below", picture.trail, height=SIZE, width=SIZE + 60
        )
        self.trail.figure.xaxis.axis_label = "site"
        self.trail.figure.yaxis.axis_label = f"last {ROWS} steps"
        self.touch = touch
        self.scales = [self.trail.scale]

    def _listen(self, drawn: Any, axes: int) -> None:
        def tapped(event: Tap) -> None:
            place = [event.y, event.x] if axes == 2 else [event.x] if axes == 1 else []
            self.touch(self.title, place)

        drawn.on_event(Tap, tapped)


class Lines(PartPanel):
    """Of a part of one axis; of a node its last steps instead."""

    def __init__(self, title: str, picture: Picture, touch: Touch) -> None:
        super().__init__(title, picture, touch)
        self.axes = picture.activation.ndim
        n = picture.activation.size if self.axes else ROWS
        self.x = np.arange(n, dtype=np.float32)
        self.source = ColumnDataSource(self._columns(picture))
        drawn = _blank(
            title, width=2 * SIZE + 60, x_range=Range1d(-0.5, n - 0.5), y_range=Range1d(-1, 1)
        )
        drawn.extra_y_ranges = {"output": Range1d(-0.05, 1.05)}
        drawn.add_layout(
            LinearAxis(y_range_name="output", axis_label="output", axis_label_text_color=GREEN),
            "right",
        )
        drawn.ray(x=[-0.5], y=[0], length=0, angle=0, line_color="#999999", line_dash="dotted")
        few = n <= 12
        for name, color, scale in (
            ("input", ORANGE, "default"), ("output", GREEN, "output"),
            ("activation", BLUE, "default"),
        ):  # fmt: skip
            where = {"source": self.source, "y_range_name": scale, "color": color}
            drawn.line("x", name, legend_label=name, line_width=2, **where)
            if few:
                drawn.scatter("x", name, size=8, **where)
        drawn.legend.location, drawn.legend.orientation = "top_left", "horizontal"
        drawn.legend.background_fill_alpha, drawn.legend.label_text_font_size = 0.4, "8pt"
        drawn.xaxis.axis_label = "site" if self.axes else f"last {ROWS} steps"
        self.values = Scale(drawn.y_range, "start", "end")
        self.rates = Scale(drawn.extra_y_ranges["output"], "start", "end")
        self.scales += [self.values, self.rates]
        self._listen(drawn, self.axes)
        self.figures = [drawn, self.trail.figure] if self.axes else [drawn]
        drawn.tags = [title]

    def _columns(self, picture: Picture) -> dict[str, np.ndarray]:
        if self.axes:
            return {
                "x": self.x, "activation": picture.activation, "output": picture.output,
                "input": picture.input,
            }  # fmt: skip
        flat = np.ones(ROWS, np.float32)
        return {
            "x": self.x, "activation": picture.trail[:, 0], "output": picture.output * flat,
            "input": picture.input * flat,
        }  # fmt: skip

    def draw(self, new: Picture) -> None:
        columns = self._columns(new)
        self.values.fit(columns["activation"], columns["input"])
        self.rates.fit(columns["output"], np.array([0.0, 1.0]))
        self.source.data = columns
        if self.axes:
            self.trail.draw(new.trail)


class Maps(PartPanel):
    """Of a part of two axes, ``(y, x)``; y = 0 is on top."""

    def __init__(self, title: str, picture: Picture, touch: Touch) -> None:
        super().__init__(title, picture, touch)
        rows, columns = picture.activation.shape
        height = int(min(max(SIZE * rows / columns, 140), 1.3 * SIZE))
        self.maps = [
            Map(name, array, width=SIZE + 60, height=height)
            for name, array in (
                (f"{title}: activation", picture.activation),
                ("output", picture.output),
                ("input", picture.input),
            )
        ]
        self.trail.figure.height = height
        for each in self.maps:
            self._listen(each.figure, 2)
            self.scales.append(each.scale)
        self.figures = [*(each.figure for each in self.maps), self.trail.figure]

    def draw(self, new: Picture) -> None:
        for each, array in zip(self.maps, new):
            each.draw(array)
        self.trail.draw(new.trail)


class MatrixPanel(Panel):
    """A matrix of numbers."""

    def __init__(self, title: str, matrix: np.ndarray) -> None:
        super().__init__(title)
        self.map = Map(title, matrix, least=0.01, width=SIZE + 10, height=SIZE)
        self.scales, self.figures = [self.map.scale], [self.map.figure]

    def draw(self, new: np.ndarray) -> None:
        self.map.draw(new)


class ImagePanel(Panel):
    """A picture, RGB, at most about `SIZE` pixels wide."""

    def __init__(self, title: str, image: np.ndarray) -> None:
        super().__init__(title)
        self.source = ColumnDataSource({"image": [_packed(image)]})
        height, width = image.shape[:2]
        drawn = _blank(
            title, width=SIZE, height=int(SIZE * height / width) + 30, x_range=Range1d(0, 1),
            y_range=Range1d(0, 1), min_border=2,
        )  # fmt: skip
        drawn.axis.visible = False
        drawn.image_rgba("image", x=0, y=0, dw=1, dh=1, source=self.source)
        self.figures = [drawn]

    def draw(self, new: np.ndarray) -> None:
        self.source.data = {"image": [_packed(new)]}


def _packed(image: np.ndarray) -> np.ndarray:
    """RGBA in 32 bits, from the lowest row up as Bokeh wants it."""
    stride = max(1, image.shape[1] // SIZE)
    small = image[::stride, ::stride]
    packed = np.empty(small.shape[:2], np.uint32)
    view = packed.view(np.uint8).reshape(*small.shape[:2], 4)
    view[..., :3], view[..., 3] = small, 255
    return np.ascontiguousarray(packed[::-1])


def part_panel(label: str, picture: Picture, touch: Touch) -> Panel:
    kind = Maps if picture.activation.ndim == 2 else Lines
    return kind(label, picture, touch)


def matrix_panel(title: str, matrix: np.ndarray) -> Panel:
    return MatrixPanel(title, matrix)


def image_panel(title: str, image: np.ndarray) -> Panel:
    return ImagePanel(title, image)
