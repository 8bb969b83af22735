"""Serial order: a sequence is shown once, and done again in its own time.

Each of five nodes stands for a place in the order. Only one is on at a time; it leaves its memory
node on, which inhibits it and prepares the next one. While a sequence is shown, the field of
actions has a peak at what is shown, and what ordinal node and action have in common is learned.
Afterwards each ordinal node calls up its action. A node of satisfaction comes on when the action
is seen done, shuts all ordinal nodes, and lets the next one come on as soon as it is off: steps
may be short or long, nothing in the model counts time.

Source: Sandamirskaya and Schöner, "An embodied account of serial order: how instabilities drive
sequence generation", Neural Networks 23, 2010. Five seconds on one core.

    python recipes/fields/serial_order.py --out serial_order.png
"""

import argparse

import torch
from matplotlib.figure import Figure

from dntorch import DNF, Architecture, Gauss, Global, Matrices, MemoryTrace, Relay, gauss

PLACES, SITES = 5, 60
SEQUENCE = [30, 10, 50, 20, 40]  # sites of the actions
SHOW, DONE = 32, 16  # steps of 1/32 s: an action, and the pause after it


def serial_order() -> Architecture:
    """Ordinal and memory nodes, actions, satisfaction, and what was learned."""
    same, following = torch.eye(PLACES), torch.eye(PLACES).roll(1, 0)
    following[0] = 0.0  # nothing comes before the first
    pairs = (PLACES, SITES)
    return Architecture(
        {
            "ordinal": DNF(PLACES, (Matrices((16.0 * same,)), Global(-5.0)), h=-3.0),
            "memory": DNF(PLACES, Matrices((5.0 * same,)), h=-3.0),
            "action": DNF(SITES, (Gauss(14.0, 3.0), Global(-0.6))),
            "done": DNF((), Global(2.0)),
            "together": Relay(pairs, "product"),
            "learned": MemoryTrace(pairs, tau_build=0.2, tau_decay=1e6),
            "recalled": Relay(pairs, "product"),
        },
        ("ordinal", "memory", 4.0),
        ("memory", "ordinal", Matrices((4.0 * following - 6.0 * same,))),
        ("done", "ordinal", "-> o", -12.0),
        ("ordinal", "together", "o -> o a", 1.0),
        ("action", "together", "a -> o a", 1.0),
        ("together", "learned"),
        ("ordinal", "recalled", "o -> o a", 1.0),
        ("learned", "recalled"),
        ("recalled", "action", "o a -> a", 7.0),
    )


def show(model: Architecture) -> None:
    """Each action of the sequence once, and then forget where in the order we are."""
    start = 8.0 * torch.eye(PLACES)[0]
    for k, site in enumerate(SEQUENCE):
        for step in range(SHOW):
            given = {"action": gauss(SITES, site, 3.0, 8.0)}
            model(given | {"ordinal": start} if k == 0 and step < 16 else given)
        for _ in range(DONE):
            model({"done": torch.tensor(8.0)})
    for _ in range(32):
        model({"memory": torch.full((PLACES,), -20.0)})


def recall(model: Architecture, speed: float, steps: int) -> tuple[list[int], list, list]:
    """Let an arm follow the field of actions; where it arrives, its way, and the activation."""
    arm, arrived, way, activation = 0.0, [], [], []
    start, idle = 8.0 * torch.eye(PLACES)[0], True
    for step in range(steps):
        field = model.state["action"]
        goal = int(field.argmax()) if field.max() > 0 else None
        if goal is not None:
            arm += max(-speed, min(speed, goal - arm))
        there = goal is not None and abs(goal - arm) < 0.5
        if there and idle:
            arrived.append(goal)
        idle = goal is None or (idle and not there)
        given = {"done": torch.tensor(8.0 * there)}
        model(given | {"ordinal": start} if step < 16 else given)
        way.append(arm)
        activation.append(model.state["ordinal"])
    return arrived, way, activation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=384, help="of the recall, 1/32 s each")
    parser.add_argument("--out", default="serial_order.png")
    arguments = parser.parse_args()

    model = serial_order()
    show(model)
    arrived, way, activation = recall(model, 1.0, arguments.steps)
    print(f"shown once: {SEQUENCE}; done again: {arrived}")
    assert len(arrived) == PLACES, "not all actions"
    assert max(abs(a - b) for a, b in zip(arrived, SEQUENCE)) <= 1, "not the sequence"

    figure = Figure(figsize=(7, 3.4), layout="constrained")
    nodes, arm = figure.subplots(2, 1, sharex=True)
    time = torch.arange(len(way)) / 32
    for k, u in enumerate(torch.stack(activation).t()):
        nodes.plot(time, u, label=str(k + 1))
    nodes.axhline(0, color="gray", lw=0.7)
    nodes.set(ylabel="ordinal nodes: u", ylim=(-12, 15))
    nodes.legend(frameon=False, ncol=5)
    arm.plot(time, way, "black")
    arm.set(xlabel="time of the recall (s)", ylabel="arm (sites)", yticks=sorted(SEQUENCE))
    arm.grid(axis="y", lw=0.5)
    figure.savefig(arguments.out, dpi=72)


if __name__ == "__main__":
    main()
