"""Noise as an input of a field."""

from collections.abc import Sequence

import torch
from torch import Tensor

from dntorch.cells.field import separable
from dntorch.cells.kernels import borders_of, gauss_matrix, per_axis, sites
from dntorch.checks import (
    check_count,
    check_dtype,
    check_ends,
    check_floats,
    check_positive,
    check_time_constant,
)
from dntorch.number import Number, span, wide
from dntorch.parameters import Parameters


class Noise(Parameters):
    r"""Shapes white noise into an input that gives a resting field a known spread.

    .. math:: S(x) = \text{sd} \sqrt{\frac{1 + r}{1 - r}} \sum_{x'} \omega(x, x')\, \xi(x'),
              \qquad r = \Big(1 - \frac{dt}{k \tau}\Big)^k

    With :math:`k` = ``substeps`` of the field, whose input is held, and rows of :math:`\omega`
    of unit length, a field at rest has the standard deviation ``sd`` at any ``dt`` and
    ``sigma``; for one sub-step the factor is :math:`\sqrt{(2\tau - dt) / dt}`.

    ==============  ====  ========================================================
    parameter       unit  meaning
    ==============  ====  ========================================================
    ``sd``          1     standard deviation of the resting field
    ``sigma``       1     width of the correlation in sites, 0 for white noise; one
                          for all axes or one per axis
    ``tau``         s     time constant of the field
    ``dt``          s     control step of the field, in ``substeps``
    ==============  ====  ========================================================

    ``sd`` and ``tau`` may be tensors ``(*batch,)``. Pure: the caller draws. Nothing random happens
    unless somebody passes it.

    Shapes: ``xi`` and the input of the field ``(*batch, *shape)``.

    Raises:
        ValueError: ``sd`` or ``sigma`` negative, ``dt / substeps > tau``, an unknown border.

    Not in the paper. COSIVINA's ``amplitude / sqrt(dt)`` gives
    ``amplitude / sqrt(2 tau - dt)``, which changes with dt.

    >>> from dntorch import DNF
    >>> field, noise = DNF(1000, kernel=()), Noise(1000, sd=0.5)
    >>> _ = torch.manual_seed(0)
    >>> for _ in range(64):
    ...     output = field(noise(torch.randn(1000)))
    >>> round(float(field.u.std()), 1)
    0.5
    """

    shape: list[int]
    fixed = ("dt",)

    def __init__(
        self,
        shape: int | Sequence[int],
        sd: Number,
        sigma: float | Sequence[float] = 0.0,
        border: str | Sequence[str] = "circular",
        tau: Number = 0.1,
        dt: float = 1 / 32,
        substeps: int = 1,
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__()
        check_floats(dtype)
        self.register_buffer("origin", torch.zeros((), dtype=dtype), persistent=False)
        check_count("substeps", substeps)
        self.shape, self.substeps, self.dt = sites(shape), substeps, dt
        self.sd, self.tau = sd, tau
        self.sigma, self.border = sigma, border
        axes = len(self.shape)
        if axes > 3:
            raise ValueError(f"shape={shape!r}: give 0 to 3 axes")
        borders_of(border, axes)
        each = zip(self.shape, per_axis("sigma", sigma, axes), per_axis("border", border, axes))
        for axis in range(3):
            self.register_buffer(f"rows_{axis}", torch.empty(0, dtype=dtype), persistent=False)
        for axis, (n, width, edge) in enumerate(each):
            rows = gauss_matrix(n, width, edge, normalized=False)
            unit = rows / rows.square().sum(-1, keepdim=True).sqrt()
            self.register_buffer(f"rows_{axis}", unit[None].to(self.origin), persistent=False)
        self._check_all()
        self._ready = True

    def _check_all(self) -> None:
        if not span(self.sd)[0] >= 0:
            raise ValueError(f"sd={span(self.sd)[0]} is negative: give a standard deviation")
        check_positive("dt", self.dt, "give seconds per step")
        check_time_constant("tau", self.tau, self.dt / self.substeps)

    def resize(self, *batch: int) -> "Noise":
        """Nothing of it has a batch but numbers that were given one."""
        return self

    def forward(self, xi: Tensor) -> Tensor:
        """Input of the field, from white noise of unit variance."""
        check_ends("xi", xi, self.shape)
        check_dtype("xi", xi, self.origin.dtype)
        axes = len(self.shape)
        if axes > 0:
            xi = separable(xi, [self.rows_0, self.rows_1, self.rows_2][:axes], 0)
        left = 1 - self.dt / self.substeps / wide(self.tau, axes)
        kept = left**self.substeps
        return wide(self.sd, axes) * ((1 + kept) / (1 - kept)) ** 0.5 * xi
