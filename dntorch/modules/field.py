"""Dynamic neural fields."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.field import FieldState, field_relax
from dntorch.cells.functions import sigmoid
from dntorch.cells.integrators import check_integrator
from dntorch.cells.kernels import SELECTIVE, Kernel, sites
from dntorch.checks import check_ends, check_floats, check_time_constant
from dntorch.dynamics import Dynamics
from dntorch.modules.kernelled import Kernelled
from dntorch.number import Number, wide


class DNF(Kernelled, Dynamics[FieldState]):
    r"""Dynamic neural field over 0, 1, 2 or 3 dimensions: a node, a line, a sheet, a block.

    .. math:: \tau \dot u(x) = -u(x) + h + S(x) + \sum_{x'} \omega(x, x') f(u(x'))

    ==============  ===================  ====  ================================================
    symbol          here                 unit  meaning
    ==============  ===================  ====  ================================================
    :math:`u`       ``u``                1     activation; a site is *on* above ``threshold``
    :math:`\tau`    ``tau``              s     time constant
    :math:`h`       ``h``                1     resting level; from ``threshold`` on all sites
                                               are on at rest, as biased models want
    :math:`\omega`  ``kernel``           1     terms that add up: `Gauss`, `Global`, `Matrices`;
                                               signed, negative amplitudes inhibit
    :math:`f`       ``kind``             1     output: "logistic", "abs", "heaviside",
                                               "semilinear" or "linear", without bound
    :math:`\beta`   ``steepness``        1     of the sigmoid
    :math:`\mu`     ``threshold``        1     of the sigmoid
    \               ``border``           --    "circular" or "zero", one for all or one per axis
    \               ``dt, substeps``     s, 1  seconds per step; number of sub-steps
    \               ``integrator``       --    "euler", or "heun": the mean of the state and
                                               two Euler steps, ``0.5 * (x + E(E(x)))``
    \               ``dtype``            --    of the buffers, kernels built in float64
    ==============  ===================  ====  ================================================

    Shapes: input and output ``(*batch, *shape)``; two dimensions are ``(y, x)``; the output
    is :math:`f(u)` after the step. State: ``FieldState(u)``, at rest ``h``.

    ``tau`` and ``h`` may be tensors ``(*batch,)``, one number per field of a batch.

    Noise is an input that the caller draws: see `Noise`. NaN in an input spreads through the field.

    ``field.kernel`` reads as terms; setting it builds new matrices, differentiable in the
    numbers of its terms: ``field.kernel = (Gauss(a, s), Global(-0.5))`` with tensors a and s
    that want gradients, again after each step of an optimizer. To learn the matrices
    themselves, make them parameters, which are then in the checkpoint: ``field.kernel_0 =
    nn.Parameter(field.kernel_0)``, one stack of matrices ``(terms, n, n)`` per axis;
    ``field.kernel`` then reads as `Matrices`. ``field.double()`` keeps kernels rounded to
    float32; ``dtype=torch.float64`` has exact ones.

    Inside a composite, ``euler`` advances the field by ``dt`` in ``substeps`` Euler steps;
    ``integrator`` is that of ``step``.

    Raises:
        ValueError: ``dt / substeps > tau``, more than three axes, a term
            that has no effect or doesn't fit the axes; in a step, an input that doesn't end in
            ``shape`` or has another dtype.
        TypeError: an input that is no tensor.

    Source: Amari, "Dynamics of pattern formation in lateral-inhibition type neural fields",
    1977; eq. (1) of Kazerounian, Luciw, Richter and Sandamirskaya, "Autonomous Reinforcement
    of Behavioral Sequences in Neural Dynamics". Conventions as in cedar and COSIVINA, but
    cedar's kernel limit is a whole width, and COSIVINA counts positions from 1.

    **Deviations**: printed :math:`\sigma(u(x,t))` in the integral over :math:`x'`, used
    :math:`f(u(x',t))`. Kernel, sigmoid and numbers are not given; the default kernel
    decides between two inputs and lets go of the winner when its input goes.

    >>> site, field = torch.arange(51), DNF(51)
    >>> two = 7 * torch.exp(-((site - 12) / 4) ** 2) + 8 * torch.exp(-((site - 38) / 4) ** 2)
    >>> for _ in range(64):
    ...     output = field(two)
    >>> output[[12, 38]].round().tolist()
    [0.0, 1.0]
    """

    settable = ("kind", "substeps", "integrator")
    u: Tensor
    shape: list[int]

    def __init__(
        self,
        shape: int | Sequence[int],
        kernel: Kernel = SELECTIVE,
        tau: Number = 0.1,
        h: Number = -5.0,
        kind: str = "logistic",
        steepness: float = 4.0,
        threshold: float = 0.0,
        border: str | Sequence[str] = "circular",
        dt: float = 1 / 32,
        substeps: int = 1,
        integrator: str = "euler",
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__(dt)
        check_floats(dtype)
        check_integrator(integrator, substeps)
        self.shape, self.border = sites(shape), border
        if len(self.shape) > 3:
            raise ValueError(f"shape={shape!r}: give 0 to 3 axes")
        self.tau, self.h = tau, h
        self.kind, self.steepness, self.threshold = kind, steepness, threshold
        self.substeps, self.integrator = substeps, integrator
        self.to(dtype=dtype)
        self.kernel = kernel

    def check(self) -> None:
        check_integrator(self.integrator, self.substeps)
        check_time_constant("tau", self.tau, self.dt / self.substeps)
        sigmoid(self.origin, self.kind, self.steepness, self.threshold)  # raises if unknown

    def initial(self, batch: list[int]) -> FieldState:
        rest = self.origin.new_zeros(batch + self.shape)
        return FieldState(rest + wide(self.h, len(self.shape)))

    def output(self, state: FieldState) -> Tensor:
        """Firing rate :math:`f(u)`."""
        return sigmoid(state.u, self.kind, self.steepness, self.threshold)

    def substep(self, input: Tensor, state: FieldState) -> FieldState:
        """One Euler step of ``dt / substeps`` seconds."""
        output = sigmoid(state.u, self.kind, self.steepness, self.threshold)
        return self.relaxed(input, output, state)

    def relaxed(self, input: Tensor, output: Tensor, state: FieldState) -> FieldState:
        """`substep` for a composite that knows the output already."""
        check_ends("input", input, self.shape)
        if input.dtype != state.u.dtype:
            raise ValueError(
                f"input of dtype {input.dtype} does not fit the field's {state.u.dtype}: give "
                "input.to(field.u), or build the field with dtype=torch.float64"
            )
        axes, dt = len(self.shape), self.dt / self.substeps
        tau, h = wide(self.tau, axes), wide(self.h, axes)
        return field_relax(input, output, state, self._stacks(), self.everywhere, tau, h, dt)

    def euler(self, input: Tensor, state: FieldState) -> FieldState:
        """``dt`` seconds in Euler steps."""
        for _ in range(self.substeps):
            state = self.substep(input, state)
        return state

    def step(self, input: Tensor, state: FieldState) -> tuple[Tensor, FieldState]:
        for _ in range(self.substeps):
            ahead = self.substep(input, state)
            if self.integrator == "heun":
                ahead = self.halfway(state, self.substep(input, ahead))
            state = ahead
        return self.output(state), state
