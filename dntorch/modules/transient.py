"""Detectors of onset and offset."""

from torch import Tensor

from dntorch.cells.transient import TransientState, transient_step
from dntorch.checks import check_count, check_ends, check_time_constant
from dntorch.dynamics import Dynamics
from dntorch.number import Number, wide


class TPCell(Dynamics[TransientState]):
    r"""Transient pulse cells: a positive pulse at the onset of input, a negative at its offset.

    .. math:: \tau \dot{TP}^+ &= -TP^+ + I - TP^- \\
              \tau \dot{TP}^- &= -TP^- + I

    ===============  ===============  ====  ===================================
    symbol           here             unit  meaning
    ===============  ===============  ====  ===================================
    :math:`TP^+`     ``pulse``        1     excitatory cell, the output
    :math:`TP^-`     ``inhibitory``   1     inhibitory cell, follows the input
    :math:`\tau`     ``tau``          s     time constant of both
    :math:`I`        input            1     the input whose changes are reported
    ===============  ===============  ====  ===================================

    A step of input I from rest gives :math:`TP^+ = I (t/\tau) e^{-t/\tau}`: peak I/e at
    :math:`t = \tau`, area :math:`I \tau`, however long the input lasts.

    ``tau`` may be a tensor ``(*batch,)``, one number per agent.

    Shapes: input and output ``(*batch, *shape)``; the output is the pulse after the step.
    State: ``TransientState(pulse, inhibitory)``, both 0 at rest.

    Raises:
        ValueError: ``dt > tau``.

    Source: eqs. (7) and (8) of Kazerounian, Luciw, Richter and Sandamirskaya,
    "Autonomous Reinforcement of Behavioral Sequences in Neural Dynamics", after Rhodes.
    No deviation.

    >>> cell = TPCell(())
    >>> on = [round(float(cell(torch.tensor(1.0))), 2) for _ in range(320)]
    >>> max(on), on[-1], round(min(float(cell(torch.tensor(0.0))) for _ in range(64)), 2)
    (0.38, 0.0, -0.38)
    """

    pulse: Tensor
    inhibitory: Tensor
    shape: list[int]

    def __init__(self, shape: tuple[int, ...], tau: Number = 0.5, dt: float = 1 / 32) -> None:
        super().__init__(dt)
        if isinstance(shape, int):
            raise ValueError(f"shape={shape}: give a tuple, such as ({shape},)")
        for size in shape:
            check_count("shape", size)
        self.tau, self.shape = tau, list(shape)

    def check(self) -> None:
        check_time_constant("tau", self.tau, self.dt)

    def initial(self, batch: list[int]) -> TransientState:
        rest = self.origin.new_zeros(batch + self.shape)
        return TransientState(rest, rest.clone())

    def output(self, state: TransientState) -> Tensor:
        return state.pulse.clone()

    def euler(self, input: Tensor, state: TransientState) -> TransientState:
        check_ends("input", input, self.shape)
        return transient_step(input, state, wide(self.tau, len(self.shape)), self.dt)
