"""Who reads whom: the order of an architecture's elements, and their names as modules."""

import re
from collections.abc import Mapping, Sequence

from torch import nn

from dntorch.checks import shown

MARK = "_x"
TAKEN = frozenset(dir(nn.ModuleDict()))


def escaped(label: str) -> str:
    """A label as the name of a module: ASCII letters, digits and ``_``; one to one.

    >>> escaped("scene"), escaped("v -> u (inh.)"), escaped("keys")
    ('scene', 'v_x20__x2d__x3e__x20_u_x20__x28_inh_x2e__x29_', '_x6b_eys')
    """
    text = label.replace(MARK, _code("_") + "x")
    text = re.sub(r"[^A-Za-z0-9_]", lambda found: _code(found[0]), text)
    return _code(text[0]) + text[1:] if text in TAKEN else text


def _code(letter: str) -> str:
    return f"{MARK}{ord(letter):x}_"


Reads = Mapping[str, list[str]]


def in_order(reads: Reads, relays: list[str], order: Sequence[str] | None) -> list[str]:
    """The sequence in which elements step: relays after what they read, then the others.

    Raises:
        ValueError: relays that read each other in a circle; an order that does not name each
            element once.
    """
    if order is None:
        return [*_sorted(reads, relays), *(label for label in reads if label not in relays)]
    if isinstance(order, str) or not isinstance(order, Sequence):
        raise TypeError(f"order={shown(order)} is no list: give the names of all elements")
    if not all(isinstance(label, str) for label in order):
        raise TypeError(f"order={shown(order)}: give names, which are text")
    for label in {*reads, *order}:
        if list(order).count(label) != 1 or label not in reads:
            raise ValueError(
                f"order has {label!r} {list(order).count(label)} times: name each element once"
            )
    return list(order)


def _sorted(reads: Reads, relays: list[str]) -> list[str]:
    done: list[str] = []
    while len(done) < len(relays):
        ready = [
            label
            for label in relays
            if label not in done
            and all(source in done or source not in relays for source in reads[label])
        ]
        if not ready:
            circle = [label for label in relays if label not in done]
            raise ValueError(
                f"relays {circle} read each other in a circle: put an element with a state between"
            )
        done += ready
    return done


def backward(reads: Reads, relays: list[str], sequence: Sequence[str]) -> dict[str, int]:
    """Relays that stand behind one that reads them, each with how many such stand before it."""
    place = {label: k for k, label in enumerate(sequence)}
    late = {
        source
        for label, sources in reads.items()
        for source in sources
        if source in relays and place[source] >= place[label]
    }
    return {label: len(late) for label in late}
