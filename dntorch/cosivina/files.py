"""COSIVINA parameter files: JSON to a list of elements with their parameters, and back."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dntorch.cells.kernels import LARGEST as SITES
from dntorch.checks import LARGEST, shown
from dntorch.files import write_atomically

Size = tuple[int, ...]
"""As in MATLAB: two numbers at least, ``(1, n)`` for a line, ``(1, 1)`` for a number."""


class Element(NamedTuple):
    """One entry of a file, as it is written there."""

    label: str
    kind: str
    """Name of its class."""
    parameters: Mapping[str, Any]
    inputs: list[tuple[str, str]]
    """Labels of other elements and names of their components."""
    file: str

    def error(self, what: str) -> ValueError:
        """What is wrong with it, for people."""
        kind = self.kind if self.kind.isprintable() else shown(self.kind)
        return ValueError(f"{self.file}: element {shown(self.label)} of class {kind}: {what}")

    def value(self, name: str, default: Any = None) -> Any:
        """A parameter as it is written; a default takes the place of one that is missing."""
        if name not in self.parameters and default is None:
            raise self.error(f"parameter {name!r} is missing: add it to the file")
        return self.parameters.get(name, default)

    def number(self, name: str, default: float | None = None, least: float = -math.inf) -> float:
        """A parameter that is one finite number."""
        (value, *more) = self.numbers(name, default) or [math.nan]
        if more or not least <= value < math.inf:
            limit = f" of at least {least:g}" if least > -math.inf else ""
            given = shown(self.value(name, default))
            raise self.error(f"{name}={given}: give one number{limit}")
        return value

    def positive(self, name: str) -> float:
        """A parameter above zero."""
        if not (value := self.number(name)) > 0:
            raise self.error(f"{name}={value:g} must be positive: give a larger one")
        return value

    def numbers(self, name: str, default: Any = None) -> list[float]:
        """A parameter that is a vector, written as a row, as a column or as one number."""
        flat = _flat(self.value(name, default))
        for x in flat:
            if not isinstance(x, int | float):
                raise self.error(f"{name}={shown(self.value(name, default))}: give numbers")
            if not abs(x) <= LARGEST:
                raise self.error(f"{name}={shown(x)} is not finite: give numbers")
        return [float(x) for x in flat]

    def wholes(self, name: str, default: Any = None) -> list[int]:
        """A parameter that is a vector of whole numbers."""
        flat = self.numbers(name, default)
        if any(x != int(x) for x in flat):
            raise self.error(f"{name}={shown(self.value(name, default))}: give whole numbers")
        return [int(x) for x in flat]

    def flag(self, name: str, default: bool = True) -> bool:
        """A parameter that is 0 or 1."""
        return self.number(name, default) != 0

    def size(self, name: str = "size") -> Size:
        """A parameter that is a size; one number is the length of a line."""
        sizes = self.numbers(name)
        if not sizes or not all(n >= 1 and n == int(n) for n in sizes):
            given = shown(self.value(name))
            raise self.error(f"{name}={given}: give the number of sites per axis")
        if math.prod(sizes) > SITES:
            raise self.error(f"{name}={shown(self.value(name))}: these are too many sites")
        whole = [int(n) for n in sizes]
        return tuple(whole) if len(whole) > 1 else (1, *whole)


class Simulator(NamedTuple):
    """A file."""

    path: str
    delta_t: float
    """Milliseconds per step."""
    elements: dict[str, Element]
    """By label, in the order of the file, in which COSIVINA steps them."""


def read(path: str | Path) -> Simulator:
    """The elements of a parameter file.

    Raises:
        OSError: the file can't be read.
        TypeError: ``path`` is no path.
        ValueError: broken JSON, another kind of file, labels that repeat, inputs from nowhere.
    """
    file = name_of(path)
    try:
        whole = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} is no text at byte {error.start}: save it in UTF-8") from None
    except json.JSONDecodeError as error:
        raise ValueError(
            f"{file} is no JSON: {error.msg} in line {error.lineno}, column {error.colno}; "
            "save it again in COSIVINA"
        ) from None
    except ValueError as error:  # a number of thousands of digits
        raise ValueError(f"{file} is no JSON: {error}; save it again in COSIVINA") from None
    except RecursionError:
        raise ValueError(f"{file} is nested too deeply: save it again in COSIVINA") from None
    try:
        return _simulator(whole, file)
    except RecursionError:
        raise ValueError(f"{file} is nested too deeply: save it again in COSIVINA") from None


def name_of(path: str | Path) -> str:
    """The name of a file, without folders; or raise."""
    if not isinstance(path, str | Path):
        raise TypeError(f"path={shown(path)} is no path: give text, or a pathlib.Path")
    name = Path(path).name
    if not name or "\0" in str(path):
        raise ValueError(f"path={shown(path)} names no file: give one such as 'model.json'")
    return name


def _simulator(whole: Any, file: str) -> Simulator:
    simulator = whole.get("simulator") if isinstance(whole, dict) else None
    if not isinstance(simulator, dict) or not {"deltaT", "elements"} <= simulator.keys():
        raise ValueError(
            f"{file} is no COSIVINA parameter file: it has no 'simulator' with 'deltaT' and "
            "'elements'; save one with sim.saveSettings(file)"
        )
    step = _plain(simulator["deltaT"])
    if not isinstance(step, int | float) or not 0 < step <= LARGEST:
        raise ValueError(f"{file}: deltaT={shown(step)}: give milliseconds per step, above 0")
    return Simulator(file, float(step), _elements(simulator["elements"], file))


def _elements(entries: Any, file: str) -> dict[str, Element]:
    """Elements by label, whose inputs are among them."""
    elements: dict[str, Element] = {}
    for k, entry in enumerate(_listed(entries)):
        element = _element(entry, k, file)
        if element.label in elements:
            raise element.error("another element has this label: give each its own")
        elements[element.label] = element
    for element in elements.values():
        for label, _ in element.inputs:
            if label not in elements:
                raise element.error(f"its input {label!r} is no element of the file: add it")
    return elements


def write(path: str | Path, delta_t: float, elements: Sequence[Element]) -> None:
    """A parameter file that COSIVINA reads with ``Simulator('file', path)``."""
    entries = [
        {
            "label": element.label,
            "class": element.kind,
            "param": dict(element.parameters),
            "nInputs": len(element.inputs),
            "input": [{"label": a, "component": b} for a, b in element.inputs] or None,
        }
        for element in elements
    ]
    head = {
        "deltaT": delta_t,
        "tZero": 0,
        "nElements": len(entries),
        "elementLabels": [entry["label"] for entry in entries],
    }
    lines = ",\n".join(json.dumps(entry, ensure_ascii=False) for entry in entries)
    start = json.dumps({"simulator": head}, ensure_ascii=False).removesuffix("}}")
    text = f'{start}, "elements": [\n{lines}\n]}}}}\n'
    write_atomically(Path(path), lambda sink: sink.write(text.encode()))


def _element(entry: Any, k: int, file: str) -> Element:
    known = isinstance(entry, dict)
    label, kind = (entry.get("label"), entry.get("class")) if known else (None, None)
    if not known or not isinstance(label, str) or not isinstance(kind, str) or not label:
        raise ValueError(f"{file}: element {k + 1} has no 'label' or no 'class': add them")
    element = Element(label, kind, {}, [], file)
    parameters = entry.get("param", {})
    if not isinstance(parameters, dict):
        raise element.error("'param' is no object: give parameters by name")
    inputs = []
    for given in _listed(entry.get("input")):
        if not isinstance(given, dict) or "label" not in given:
            raise element.error(f"input {shown(given)} names no element: give label and component")
        inputs.append((str(given["label"]), str(given.get("component", "output"))))
    plain = {name: _plain(value) for name, value in parameters.items()}
    return element._replace(parameters=plain, inputs=inputs)


def _listed(value: Any) -> list:
    """A struct array: of several entries a list, of one the entry itself, of none nothing."""
    value = _plain(value)
    return value if isinstance(value, list) else [] if value is None else [value]


def _plain(value: Any) -> Any:
    """A value without what JSONLab adds: typed arrays, and words for what is not finite."""
    if isinstance(value, dict) and "_ArraySize_" in value:
        data = [_plain(x) for x in _flat(value.get("_ArrayData_"))]
        sizes = _flat(value["_ArraySize_"])
        if not all(isinstance(n, int | float) and 0 <= n <= len(data) for n in sizes):
            return data
        sizes = [int(n) for n in sizes]
        return _rows(data, sizes) if len(data) == math.prod(sizes) else data
    if isinstance(value, list):
        return [x if type(x) is float else _plain(x) for x in value]
    words = {"_NaN_": math.nan, "_Inf_": math.inf, "-_Inf_": -math.inf}
    return words.get(value, value) if isinstance(value, str) else value


def _rows(data: list, sizes: list[int]) -> list:
    """Nested lists of an array whose first index runs fastest, as in MATLAB."""
    if len(sizes) < 2:
        return data
    return [_rows(data[row :: sizes[0]], sizes[1:]) for row in range(sizes[0])]


def _flat(value: Any) -> list:
    """The entries of nested lists, row after row."""
    if not isinstance(value, list):
        return [] if value is None else [value]
    if any(isinstance(each, list) for each in value):
        return [x for each in value for x in _flat(each)]
    return value
