"""Fields and architectures of fields against COSIVINA's way, in one run.

COSIVINA's Python port steps elements one after the other in NumPy, in float64, and one simulation
after the other. The lateral term of a line is ``np.convolve`` of the output, extended around the
ring, with a kernel that is as wide as the ring; that of a sheet is an FFT. Here the same field is
stepped in float32 as a batch. A batch of NumPy in float32 stands beside it, since it is what a
good programmer would write.

    python benchmarks/fields.py
"""

import argparse
import statistics
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from harness import machine, ratios, take_turns
from torch import Tensor, nn

from dntorch import DNF, Architecture, Dynamics, Gauss, Global, Projection, gauss
from dntorch.cells.field import FieldState, lateral
from dntorch.cells.kernels import assemble
from dntorch.process import settle

STEEPNESS, TAU, H, DT = 4.0, 0.1, -5.0, 1 / 32
KERNEL = (Gauss(20.0, 4.0), Gauss(-8.0, 12.0), Global(-0.2))
SHEET = (Gauss(20.0, 3.0), Global(-0.2))
Way = Callable[[], object]


def rate(u: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-STEEPNESS * u))


def leak(u: np.ndarray, target: np.ndarray) -> np.ndarray:
    return u + u.dtype.type(DT / TAU) * (target - u)


def ring_taps(matrices: Tensor) -> np.ndarray:
    """The kernel of a ring, its middle where ``np.convolve`` has it."""
    taps = matrices[0, :, 0].numpy()
    return np.roll(taps, len(taps) // 2)


# ------------------------------------------------------------------ one field


class Line:
    """COSIVINA's way on a line: a convolution of the padded ring, per simulation."""

    def __init__(self, inputs: np.ndarray, steps: int) -> None:
        self.inputs, self.steps, n = inputs.astype(float), steps, inputs.shape[-1]
        self.reach = n // 2 - 1 + n % 2, n // 2  # as far as a ring of n sites goes
        (matrices,), _ = assemble(KERNEL[:-1], [n], "circular")
        self.kernel, self.everywhere = ring_taps(matrices), KERNEL[-1].amplitude
        self.u = np.full_like(self.inputs, H)

    def lateral(self, f: np.ndarray) -> np.ndarray:
        around = np.pad(f, self.reach, mode="wrap")
        return np.convolve(around, self.kernel, "valid") + self.everywhere * f.sum()

    def __call__(self) -> None:
        for row, u in enumerate(self.u):
            for _ in range(self.steps):
                u = leak(u, H + self.inputs[row] + self.lateral(rate(u)))
            self.u[row] = u


class Sheet(Line):
    """COSIVINA's way on a sheet: FFT, per simulation."""

    def __init__(self, inputs: np.ndarray, steps: int) -> None:
        self.inputs, self.steps = inputs.astype(float), steps
        shape = list(inputs.shape[1:])
        (rows, columns), everywhere = assemble(SHEET, shape, "circular")
        taps = torch.einsum("ty,tx->yx", rows[:, :, 0], columns[:, :, 0]).numpy()
        self.spectrum, self.shape = np.fft.rfft2(taps + everywhere), shape
        self.u = np.full_like(self.inputs, H)

    def lateral(self, f: np.ndarray) -> np.ndarray:
        return np.fft.irfft2(np.fft.rfft2(f) * self.spectrum, self.shape)


class Batched:
    """NumPy in float32, a whole batch at once; matrices, as here."""

    def __init__(self, inputs: np.ndarray, steps: int) -> None:
        self.inputs, self.steps, shape = inputs, steps, list(inputs.shape[1:])
        kernel = KERNEL if len(shape) == 1 else SHEET
        matrices, everywhere = assemble(kernel, shape, "circular")
        self.matrices = [m[0].numpy().astype(np.float32) for m in matrices]
        self.everywhere = np.float32(everywhere)
        self.u = np.full_like(inputs, H)

    def lateral(self, f: np.ndarray) -> np.ndarray:
        if len(self.matrices) == 1:
            return f @ self.matrices[0].T
        y, x = self.matrices
        return y @ f @ x.T + self.everywhere * f.sum((-2, -1), keepdims=True)

    def __call__(self) -> None:
        for _ in range(self.steps):
            f = 1 / (1 + np.exp(np.float32(-STEEPNESS) * self.u))
            self.u = leak(self.u, self.lateral(f) + self.inputs + np.float32(H))


class Ours:
    """The pure step of a structure in a loop.

    ``together``: that many steps are compiled into one function; 0 leaves them eager.
    """

    def __init__(self, structure, inputs, state, steps: int, together: int = 0) -> None:
        self.inputs, self.state, self.calls = inputs, state, steps // max(together, 1)

        def several(inputs, state):
            output, state = structure.step(inputs, state)
            for _ in range(together - 1):
                output, state = structure.step(inputs, state)
            return output, state

        self.advance = structure.step
        if together:
            self.advance = torch.compile(several, fullgraph=True, dynamic=False)

    @torch.no_grad()  # one mode: another one is a second entry in the compiler's cache
    def __call__(self) -> None:
        for _ in range(self.calls):
            _, self.state = self.advance(self.inputs, self.state)


def fields(
    shape: tuple[int, ...], batch: int, steps: int, rows: int
) -> tuple[dict[str, Way], dict]:
    """Ways of one field. Of ``batch`` simulations one by one, ``rows`` are run and counted."""
    torch.manual_seed(0)
    places = torch.rand(len(shape), batch) * shape[0]
    inputs = gauss(shape, tuple(places) if len(shape) > 1 else places[0], 4.0, 8.0)
    field = DNF(shape, KERNEL if len(shape) == 1 else SHEET)
    cosivina = (Line if len(shape) == 1 else Sheet)(inputs[:rows].numpy(), steps)
    ways: dict[str, Way] = {
        "COSIVINA's way": cosivina,
        "NumPy float32, batch": Batched(inputs.numpy(), steps),
        "eager": Ours(field, inputs, field.initial([batch]), steps),
        "compiled": Ours(field, inputs, field.initial([batch]), steps, 1),
        "compiled, ten steps": Ours(field, inputs, field.initial([batch]), steps, 10),
    }
    for way in ways.values():
        way()
    reached = [torch.as_tensor(w.u if hasattr(w, "u") else w.state.u)[:rows] for w in ways.values()]
    for each in reached[1:]:
        torch.testing.assert_close(each.double(), reached[0], atol=2e-3, rtol=1e-3)
    return ways, {name: steps * (rows if name == "COSIVINA's way" else batch) for name in ways}


# ------------------------------------------------------------------ three layers

LAYERS = {"see": 0.1, "inhibit": 0.05, "remember": 0.1}
SELF = {"see": Gauss(8.0, 3.0), "remember": Gauss(16.0, 3.0)}
COUPLED = [
    ("see", "inhibit", Gauss(10.0, 3.0)),
    ("remember", "inhibit", Gauss(8.0, 3.0)),
    ("see", "remember", Gauss(6.0, 3.0)),
    ("inhibit", "see", Gauss(-8.0, 3.0)),
    ("inhibit", "remember", Gauss(-8.0, 9.0)),
]


def three_layers(n: int) -> Architecture:
    each = {name: DNF(n, SELF.get(name, ()), tau=tau) for name, tau in LAYERS.items()}
    return Architecture(each, *COUPLED)


class Elements:
    """Three layers as COSIVINA steps them: an element per kernel and per field, one by one."""

    def __init__(self, see: np.ndarray, steps: int) -> None:
        self.see, self.steps, n = see.astype(float), steps, see.shape[-1]
        pairs = [(name, name, term) for name, term in SELF.items()] + COUPLED
        self.kernels = [(a, b, self.taps(term, n)) for a, b, term in pairs]
        self.u = {name: np.full_like(self.see, H) for name in LAYERS}

    @staticmethod
    def taps(term: Gauss, n: int) -> np.ndarray:
        """Within five sigmas, as COSIVINA cuts a kernel."""
        (matrices,), _ = assemble(term, [n], "circular")
        reach = min(round(5 * term.sigma), n // 2 - 1)
        taps = np.roll(matrices[0, :, 0].numpy(), reach)[: 2 * reach + 1]
        return taps

    def __call__(self) -> None:
        for row in range(len(self.see)):
            u = {name: x[row] for name, x in self.u.items()}
            for _ in range(self.steps):
                f = {name: rate(x) for name, x in u.items()}
                sums = {name: np.full_like(x, H) for name, x in u.items()}
                sums["see"] = sums["see"] + self.see[row]
                for source, target, taps in self.kernels:
                    around = np.pad(f[source], len(taps) // 2, mode="wrap")
                    sums[target] = sums[target] + np.convolve(around, taps, "valid")
                u = {name: x + DT / LAYERS[name] * (sums[name] - x) for name, x in u.items()}
            for name in u:
                self.u[name][row] = u[name]


def layers(n: int, batch: int, steps: int, rows: int) -> tuple[dict[str, Way], dict]:
    torch.manual_seed(0)
    see = gauss(n, torch.rand(batch) * n, 3.0, 9.0)
    model = three_layers(n)
    folded = model.fold()
    given, state = {"see": see}, model.initial([batch])
    ways: dict[str, Way] = {
        "element by element": Elements(see[:rows].numpy(), steps),
        "architecture": Ours(model, given, state, steps),
        "folded": Ours(folded, given, folded.initial([batch]), steps),
        "folded, compiled": Ours(folded, given, folded.initial([batch]), steps, 1),
        "folded, ten steps": Ours(folded, given, folded.initial([batch]), steps, 10),
    }
    for way in ways.values():
        way()
    truth = ways["element by element"].u
    for way in list(ways.values())[1:]:
        for name in LAYERS:
            now = way.state[name][:rows].double()
            torch.testing.assert_close(now, torch.from_numpy(truth[name]), atol=2e-3, rtol=1e-3)
    return ways, {name: steps * (rows if name == "element by element" else batch) for name in ways}


# ------------------------------------------------------------------ against a composite by hand


class LayersState(NamedTuple):
    see: FieldState
    inhibit: FieldState
    remember: FieldState


class ByHand(Dynamics[LayersState]):
    """Three layers as one would write them without `Architecture`."""

    def __init__(self, n: int) -> None:
        super().__init__(DT)
        self.see = DNF(n, SELF["see"], tau=LAYERS["see"])
        self.inhibit = DNF(n, (), tau=LAYERS["inhibit"])
        self.remember = DNF(n, SELF["remember"], tau=LAYERS["remember"])
        self.couplings = nn.ModuleDict(
            {f"{a}_{b}": Projection("x -> x", n, n, term) for a, b, term in COUPLED}
        )

    def euler(self, input: Tensor, state: LayersState) -> LayersState:
        see, inhibit, remember = self.output(state)
        to = self.couplings
        return LayersState(
            self.see.euler(input + to["inhibit_see"](inhibit), state.see),
            self.inhibit.euler(
                to["see_inhibit"](see) + to["remember_inhibit"](remember), state.inhibit
            ),
            self.remember.euler(
                to["see_remember"](see) + to["inhibit_remember"](inhibit),
                state.remember,
            ),
        )

    def output(self, state: LayersState) -> tuple[Tensor, Tensor, Tensor]:
        return (
            self.see.output(state.see),
            self.inhibit.output(state.inhibit),
            self.remember.output(state.remember),
        )


class ManyByHand(nn.Module):
    """A loop inside TorchScript: handing a NamedTuple to Python costs more than a step."""

    def __init__(self, structure: ByHand) -> None:
        super().__init__()
        self.structure = structure

    def forward(self, see: Tensor, state: LayersState, steps: int) -> LayersState:
        for _ in range(steps):
            _, state = self.structure.step(see, state)
        return state


class Many(nn.Module):
    """The same for an architecture."""

    def __init__(self, structure: Architecture) -> None:
        super().__init__()
        self.structure = structure

    def forward(self, see: Tensor, state: dict[str, Tensor], steps: int) -> dict[str, Tensor]:
        for _ in range(steps):
            _, state = self.structure.step({"see": see}, state)
        return state


def scripted(n: int, batch: int, steps: int) -> tuple[dict[str, Way], dict]:
    torch.manual_seed(0)
    see = gauss(n, torch.rand(batch) * n, 3.0, 9.0)
    model, hand = three_layers(n), ByHand(n)
    loops = {
        "composite": (torch.jit.script(ManyByHand(hand)), hand.initial([batch])),
        "architecture": (torch.jit.script(Many(model)), model.initial([batch])),
    }
    with torch.no_grad():
        one, other = (loop(see, state, 60) for loop, state in loops.values())
        for name in LAYERS:
            torch.testing.assert_close(other[name], getattr(one, name).u, atol=1e-3, rtol=1e-4)

    def way(loop: nn.Module, state: object) -> Way:
        return torch.no_grad()(lambda: loop(see, state, steps))

    ways: dict[str, Way] = {f"{name}, scripted": way(*each) for name, each in loops.items()}
    ways["composite, eager"] = Ours(hand, see, hand.initial([batch]), steps)
    ways["architecture, eager"] = Ours(model, {"see": see}, model.initial([batch]), steps)
    return ways, dict.fromkeys(ways, steps * batch)


# ------------------------------------------------------------------ the lateral term of a sheet


class Lateral:
    """Only the lateral term, of ``terms`` Gaussians and a global one: matrices or FFT."""

    def __init__(self, shape: tuple[int, int], terms: int, batch: int, fft: bool, steps: int):
        kernel = [Gauss(20.0 / (k + 1), 3.0 * (k + 1)) for k in range(terms)] + [Global(-0.2)]
        stacks, self.everywhere = assemble(kernel, list(shape), "circular")
        self.stacks = [stack.float() for stack in stacks]
        self.f = torch.rand(batch, *shape)
        taps = torch.einsum("ty,tx->yx", stacks[0][:, :, 0], stacks[1][:, :, 0]) + self.everywhere
        self.spectrum = torch.fft.rfft2(taps).to(torch.complex64)
        self.shape, self.fft, self.steps = shape, fft, steps

    def once(self) -> Tensor:
        if self.fft:
            return torch.fft.irfft2(torch.fft.rfft2(self.f) * self.spectrum, s=self.shape)
        return lateral(self.f, self.stacks, self.everywhere)

    @torch.inference_mode()
    def __call__(self) -> None:
        for _ in range(self.steps):
            self.once()


def sheet(
    shape: tuple[int, int], terms: int, batch: int, steps: int
) -> tuple[dict[str, Way], dict]:
    torch.manual_seed(0)
    dense = Lateral(shape, terms, batch, False, steps)
    fft = Lateral(shape, terms, batch, True, steps)
    fft.f = dense.f
    torch.testing.assert_close(dense.once(), fft.once(), atol=1e-2, rtol=1e-3)
    ways: dict[str, Way] = {"matrices": dense, "FFT": fft}
    return ways, dict.fromkeys(ways, steps * batch)


# ------------------------------------------------------------------ print


def show(title: str, ways: dict[str, Way], work: dict, floor: str, rounds: int) -> None:
    """Time per simulation and step, and how many times as fast as ``floor``."""
    times = take_turns(ways, rounds)
    unit = {name: [t / work[name] for t in each] for name, each in times.items()}
    print(f"\n{title}")
    for name, each in unit.items():
        middle, low, high = ratios(unit[floor], each)
        micro = 1e6 * statistics.median(each)
        print(
            f"  {name:24} {micro:10.2f} us {middle:8.2f} x  ({low:.2f} to {high:.2f})", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--only", default="", help="parts whose title has this")
    arguments = parser.parse_args()
    settle()
    print(machine(), "\nbigger is faster")

    def part(title: str, floor: str, build: Callable, *sizes) -> None:
        if arguments.only in title:
            torch.compiler.reset()
            show(title, *build(*sizes), floor, arguments.rounds)

    first = "COSIVINA's way"
    for batch, steps, rows in (1, 200, 1), (64, 20, 4), (1024, 10, 20):
        part(f"1-D, 100 sites, batch {batch}", first, fields, (100,), batch, steps, rows)
    for batch, steps, rows in (1, 20, 1), (64, 10, 4), (1024, 10, 8):
        part(f"2-D, 100 x 100 sites, batch {batch}", first, fields, (100, 100), batch, steps, rows)
    for batch, steps, rows in (1, 100, 1), (64, 20, 2):
        title = f"three layers of 100 sites, batch {batch}"
        part(title, "element by element", layers, 100, batch, steps, rows)
    for batch, steps in (1, 100), (64, 30):
        title = f"architecture and composite, batch {batch}"
        part(title, "composite, scripted", scripted, 100, batch, steps)
    for terms in (1, 2, 3):
        for batch, steps in (1, 10), (16, 1):
            title = f"lateral, 306 x 100 sites, {terms} terms, batch {batch}"
            part(title, "matrices", sheet, (306, 100), terms, batch, steps)
    print("\n" + machine())


if __name__ == "__main__":
    main()
