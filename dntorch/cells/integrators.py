r"""Integrators built from Euler steps, so that every cell writes only its Euler step.

With :math:`E_\Delta(x) = x + \Delta\, \dot x(x)`, the Euler step, one step of Heun's method
(the explicit trapezoidal rule, order two) is the mean of the state and two Euler steps:

.. math::
    x + \tfrac{\Delta}{2} \left(\dot x(x) + \dot x(E_\Delta(x))\right)
    = \tfrac12 \left(x + E_\Delta(E_\Delta(x))\right)

A structure with ``substeps`` and ``integrator`` therefore steps like this::

    for _ in range(substeps):                   # each of dt / substeps seconds
        ahead = substep(input, state)
        if integrator == "heun":
            ahead = halfway(state, substep(input, ahead))
        state = ahead

The input is held during a step: order two holds for the state, not for a moving input.
"""

INTEGRATORS = ("euler", "heun")


def check_integrator(integrator: str, substeps: int) -> None:
    """Raise unless ``integrator`` is known and ``substeps`` at least one."""
    if integrator not in INTEGRATORS:
        choices = " or ".join(map(repr, INTEGRATORS))
        raise ValueError(f"integrator={integrator!r} is unknown: choose {choices}")
    if not isinstance(substeps, int) or substeps < 1:
        raise ValueError(f"substeps={substeps!r}: give a whole number, at least one per step")
