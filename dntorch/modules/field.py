"""Dynamic neural fields."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.field import FieldState, field_step
from dntorch.cells.functions import sigmoid
from dntorch.cells.integrators import check_integrator, halfway
from dntorch.cells.kernels import SELECTIVE, Kernel, assemble
from dntorch.dynamics import Dynamics, check_ends, check_time_constant, overwrite


class DNF(Dynamics):
    r"""Dynamic neural field over 0, 1, 2 or 3 dimensions: a node, a line, a sheet, a block.

    .. math:: \tau \dot u(x) = -u(x) + h + S(x) + \sum_{x'} \omega(x, x') f(u(x'))

    ==============  ===================  ====  ================================================
    symbol          here                 unit  meaning
    ==============  ===================  ====  ================================================
    :math:`u`       ``u``                1     activation; a site is *on* above ``threshold``
    :math:`\tau`    ``tau``              s     time constant
    :math:`h`       ``h``                1     resting level, negative
    :math:`\omega`  ``kernel``           1     terms that add up: `Gauss`, `Global`, `Matrices`;
                                               signed, negative amplitudes inhibit
    :math:`f`       ``kind``             1     sigmoid: "logistic", "abs" or "heaviside"
    :math:`\beta`   ``steepness``        1     of the sigmoid
    :math:`\mu`     ``threshold``        1     of the sigmoid
    \               ``border``           --    "circular" or "zero", one for all or one an axis
    \               ``dt, substeps``     s, 1  seconds a step, and parts that it is split into
    \               ``integrator``       --    "euler", or "heun": the mean of the state and
                                               two Euler steps, ``0.5 * (x + E(E(x)))``
    \               ``dtype``            --    of the buffers, kernels built in float64
    ==============  ===================  ====  ================================================

    Shapes: input and output ``(*batch, *shape)``; two dimensions are ``(y, x)``; the output
    is :math:`f(u)` after the step. State: ``FieldState(u)``, at rest ``h``.

    Noise is an input: ``amplitude / dt**0.5 * torch.randn(...)`` added to it moves ``u`` by
    ``amplitude * dt**0.5 / tau * xi`` a step. To learn a kernel, make it a parameter, which
    is then in the checkpoint: ``field.kernel_0 = nn.Parameter(field.kernel_0)``, one stack
    of matrices ``(terms, n, n)`` an axis. ``field.double()`` keeps kernels rounded to float32;
    ``dtype=torch.float64`` has exact ones.

    Raises:
        ValueError: ``dt / substeps > tau``, ``h`` not negative, more than three axes, a term or
            border that doesn't fit the axes; in a step, an input that doesn't end in ``shape``.

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

    u: Tensor
    shape: list[int]
    kernel_0: Tensor
    kernel_1: Tensor
    kernel_2: Tensor

    def __init__(
        self,
        shape: int | Sequence[int],
        kernel: Kernel = SELECTIVE,
        tau: float = 0.1,
        h: float = -5.0,
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
        self.shape = [shape] if isinstance(shape, int) else list(shape)
        if len(self.shape) > 3 or min(self.shape, default=1) < 1:
            raise ValueError(f"shape={shape}: give 0 to 3 axes of at least one site each")
        if not h < 0:
            raise ValueError(f"h={h} must be negative: with another every site is on at rest")
        check_integrator(integrator, substeps)
        check_time_constant("tau", tau, dt / substeps)
        sigmoid(self.origin, kind, steepness, threshold)  # raises for an unknown kind
        self.tau, self.h = tau, h
        self.kind, self.steepness, self.threshold = kind, steepness, threshold
        self.substeps, self.integrator = substeps, integrator
        kernels, self.everywhere = assemble(kernel, self.shape, border)
        self.to(dtype=dtype)
        for axis in range(3):
            matrices = kernels[axis] if axis < len(kernels) else torch.empty(0)
            self.register_buffer(f"kernel_{axis}", matrices.to(self.origin), persistent=False)
        self.resize()

    @property
    def state(self) -> FieldState:
        return FieldState(self.u.clone())

    @state.setter
    def state(self, state: FieldState) -> None:
        overwrite(self.u, state.u)

    def initial(self, batch: list[int]) -> FieldState:
        return FieldState(self.origin.new_full(batch + self.shape, self.h))

    def output(self, state: FieldState) -> Tensor:
        """Firing rate :math:`f(u)`."""
        return sigmoid(state.u, self.kind, self.steepness, self.threshold)

    def euler(self, input: Tensor, state: FieldState) -> FieldState:
        """One Euler step of ``dt / substeps`` seconds."""
        kernels = [self.kernel_0, self.kernel_1, self.kernel_2][: len(self.shape)]
        return field_step(
            input, state, kernels, self.everywhere, self.tau, self.h,
            self.kind, self.steepness, self.threshold, self.dt / self.substeps,
        )  # fmt: skip

    def step(self, input: Tensor, state: FieldState) -> tuple[Tensor, FieldState]:
        check_ends("input", input, self.shape)
        if input.dtype != state.u.dtype:
            raise ValueError(
                f"input of dtype {input.dtype} does not fit the field's {state.u.dtype}: give "
                "input.to(field.u), or build the field with dtype=torch.float64"
            )
        for _ in range(self.substeps):
            ahead = self.euler(input, state)
            if self.integrator == "heun":
                ahead = FieldState(halfway(state.u, self.euler(input, ahead).u))
            state = ahead
        return self.output(state), state
