"""An architecture with one element of each kind."""

from dntorch import DNF, Architecture, Gauss, MemoryTrace, Relay, gauss


def coupled() -> Architecture:
    return Architecture(
        {
            "scene": DNF((4, 30), (Gauss(4.0, (0.5, 2.0)),)),
            "space": DNF(30),
            "node": DNF(()),
            "sum": Relay(30),
            "trace": MemoryTrace(30),
        },
        ("cue", "scene"),
        ("scene", "space", "c p -> p", Gauss(6.0, 2.0)),
        ("space", "sum"),
        ("space", "trace"),
        ("sum", "node", "p ->", 0.5),
        inputs={"cue": gauss((4, 30), (1, 10), (0.5, 2.0), 9.0)},
    )
