"""What the elements of a file compute, in the words of this library."""

from typing import Any, NamedTuple

from torch import Tensor

from dntorch.cosivina.files import Size

AXES = "yxzw"
"""Of a size in COSIVINA, in its order; their capitals end the names of parameters."""


class Map(NamedTuple):
    """A linear map between two patterns: sum over axes, kernel, repeat along new axes."""

    came: tuple[str, ...]
    """Names of the source's axes."""
    goes: tuple[str, ...]
    """Names of the target's axes."""
    gain: float = 1.0
    terms: tuple = ()
    """Of a kernel over the axes that go through, in the order of the target; may be none."""
    border: tuple[str, ...] = ()
    """Of these axes."""

    @property
    def through(self) -> tuple[str, ...]:
        """Axes that go from source to target."""
        return tuple(name for name in self.goes if name in self.came)

    @property
    def same(self) -> bool:
        """Whether it is a plain gain."""
        return self.came == self.goes and not self.terms

    @property
    def pattern(self) -> str:
        return f"{' '.join(self.came)} -> {' '.join(self.goes)}"


class Part(NamedTuple):
    """One component of an element, such as its output.

    ===============  ======================================================
    role             what it is
    ===============  ======================================================
    ``field``        a dynamic neural field
    ``trace``        a memory trace
    ``constant``     a stimulus that acts by itself
    ``open``         what the caller gives, zero unless given
    ``map``          a linear function of the first input
    ``sums``         one over axes, known when the size of the input is
    ``sum``          of all inputs
    ``first``        the first input, through a gain or an output function
    ``product``      of the first two inputs
    ``unsupported``  an error if something neural reads it
    ===============  ======================================================
    """

    role: str
    size: Size = (1, 1)
    map: Map | None = None
    """Of a linear part: how its first input becomes this component."""
    reads: Size = ()
    """Of a linear part: the size that its input must have."""
    options: dict[str, Any] = {}  # noqa: RUF012
    """Arguments of the structure that it becomes."""
    value: Tensor | None = None
    why: str = ""
    """Of what is not supported: the reason."""


def shape(size: Size) -> tuple[int, ...]:
    """A size without axes of one site: ``(1, n)`` is a line, ``(1, 1)`` a number."""
    return tuple(n for n in size if n > 1)


def names(size: Size) -> tuple[str, ...]:
    """Names of the axes of `shape`."""
    return tuple(name for name, n in zip(AXES, size) if n > 1)


def repeat(size: Size, into: Size, gain: float = 1.0) -> Map | None:
    """A pattern into a larger one, as MATLAB adds arrays of compatible sizes; or none fits."""
    if len(size) > len(into):
        return None
    full = (*size, *(1,) * (len(into) - len(size)))
    if not all(n in (1, m) for n, m in zip(full, into)):
        return None
    return Map(names(full), names(into), gain)


def chain(first: Map, then: Map) -> Map | None:
    """One map that does what two do one after the other; or none if that takes two."""
    if any("+" in name for name in (*first.came, *first.goes, *then.came, *then.goes)):
        plain = first if then.same else then if first.same else None
        return plain and plain._replace(gain=first.gain * then.gain)
    known = dict(zip(then.came, first.goes))
    fresh = (f"{name}{k}" for k in range(9) for name in AXES)
    used = {*first.came, *first.goes}
    for name in then.goes:
        if name not in known:
            known[name] = next(new for new in fresh if new not in used)
            used.add(known[name])
    came, goes = first.came, tuple(known[name] for name in then.goes)
    middle = {known[name] for name in then.through}
    lost = [name for name in first.goes if name not in middle]
    if (first.terms and then.terms) or any(name not in came for name in lost):
        return None  # two kernels; a sum over copies
    if first.terms and any(name in first.through for name in lost):
        return None  # a sum over what a kernel has spread
    if then.terms and not all(name in first.through for name in middle):
        return None  # a kernel over copies
    gain = first.gain * then.gain
    if not first.terms:
        return Map(came, goes, gain, then.terms, then.border)
    through = [name for name in goes if name in came]
    if through != list(first.through):
        return None  # turned after a kernel
    return Map(came, goes, gain, first.terms, first.border)
