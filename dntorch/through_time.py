"""Many steps at once, differentiable through all of them."""

from typing import Any

import torch
from torch import Tensor
from torch.utils._pytree import tree_flatten, tree_map, tree_unflatten

from dntorch.checks import check_count, shown
from dntorch.dynamics import Dynamics


def rollout(
    structure: Dynamics, inputs: Any, state: Any = None, steps: int | None = None
) -> tuple[Any, Any]:
    """Step a structure through time.

    Args:
        structure: any structure; what it holds is read, not changed.
        inputs: what its ``step`` takes, with a leading axis of time: a tensor, a dict, or a tuple
            for a structure of several inputs. Without a tensor in it, such as ``{}`` for an
            architecture whose stimuli act by themselves, ``steps`` says how long.
        state: to begin with; by default the one it holds.
        steps: how many; by default as many as the inputs have.

    Returns:
        outputs and states after each step, stacked along a leading axis of time. Differentiable in
        the inputs, the state and the numbers of kernels.

    Raises:
        ValueError: inputs without a common axis of time, a state that lacks something.
        TypeError: inputs or a state that are no tensors, what has no step.

    >>> from dntorch import DNF
    >>> outputs, states = rollout(DNF(5), torch.zeros(3, 5))
    >>> states.u.shape
    torch.Size([3, 5])
    """
    if not hasattr(structure, "step"):
        raise TypeError(f"structure is a {type(structure).__name__}: give one with a step")
    if steps is not None:
        check_count("steps", steps, 1)
    each = inputs if isinstance(inputs, tuple) else (inputs,)
    for x in tree_flatten(each)[0]:
        if not isinstance(x, Tensor):
            raise TypeError(f"inputs has {shown(x)}: give tensors with a leading axis of time")
    leaves, spec = tree_flatten(each)
    lengths = {len(x) if x.dim() else 0 for x in leaves} | ({steps} if steps is not None else set())
    if len(lengths) != 1 or not all(lengths):
        raise ValueError(
            f"inputs have lengths {sorted(lengths)}: give each a leading axis of as many steps, "
            "or steps if there is nothing to give"
        )
    if state is None:
        state = structure.state
    elif isinstance(structure, Dynamics):
        structure._require_names(state)
    outputs, states = [], []
    for k in range(lengths.pop()):
        row = [leaf[k] for leaf in leaves]
        output, state = structure.step(*tree_unflatten(row, spec), state)
        outputs.append(output)
        states.append(state)
    return _stacked(outputs), _stacked(states)


def _stacked(rows: list[Any]) -> Any:
    return tree_map(lambda *each: _stack(each), *rows)


def _stack(each: tuple[Tensor, ...]) -> Tensor:
    return torch.stack(each)
