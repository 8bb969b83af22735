"""Parameters of a structure: checked whenever they are set, one number or one per agent."""

import difflib
import inspect
from typing import Any, ClassVar, get_args

import torch
from torch import Tensor, nn

from dntorch.checks import LARGEST, shown
from dntorch.number import Number

_MANY = (Number, Number | None)
_NUMERIC = (float, float | None, *_MANY)
_COLLECTED = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
_MISSING = object()


class Lasting(nn.Module):
    """A module whose tensors are used outside of inference mode, too, wherever it was built."""

    def register_buffer(self, name: str, tensor: Tensor | None, persistent: bool = True) -> None:
        super().register_buffer(name, outside_inference(tensor), persistent)

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        for name, buffer in list(self._buffers.items()):
            self.register_buffer(name, buffer, name not in self._non_persistent_buffers_set)
        for name, parameter in list(self._parameters.items()):
            self._parameters[name] = outside_inference(parameter)


class Parameters(Lasting):
    """A module whose constructor's arguments are its parameters; see `dntorch.Dynamics`.

    Attributes:
        settable: arguments other than numbers that may be set after construction.
        fixed: numbers that may not.
    """

    settable: ClassVar[tuple[str, ...]] = ()
    fixed: ClassVar[tuple[str, ...]] = ("dt",)
    _arguments: ClassVar[dict[str, inspect.Parameter]] = {}
    origin: Tensor

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in cls.__dict__:
            try:
                signature = inspect.signature(cls.__init__, eval_str=True)
            except NameError:  # an annotation that only a type checker can look up
                signature = inspect.signature(cls.__init__)
            _, *own = signature.parameters.values()
            named = [each for each in own if each.kind not in _COLLECTED]
            cls._arguments = cls._arguments | {each.name: each for each in named}
            cls.__signature__ = signature.replace(parameters=own)  # ``help`` asks the metaclass

    def __getstate__(self) -> dict[str, Any]:
        # A kernel made of tensors that want gradients is a buffer within their graph.
        cut = {k: x if x is None else x.detach() for k, x in self._buffers.items()}
        return self.__dict__ | {"_buffers": cut}

    def check(self) -> None:
        """Raise unless the parameters fit each other; called when one of them was set."""

    def __setattr__(self, name: str, value: Any) -> None:
        if "_buffers" not in self.__dict__:
            raise AttributeError(f"{name} can't be set yet: call super().__init__(dt) first")
        argument = type(self)._arguments.get(name)
        ready = self.__dict__.get("_ready", False)
        if argument is None or isinstance(getattr(type(self), name, None), property):
            own = name.startswith("_") or hasattr(type(self), name)  # such as ``state``
            if ready and argument is None and self._is_part(name):
                self._exchange(name, value)
                return
            if ready and argument is None and not own:
                self._refuse_misspelling(name)
            super().__setattr__(name, value)
        elif ready:
            self._change(argument, value)
        else:
            self._place(name, self._as_held(argument, value))

    def _change(self, argument: inspect.Parameter, value: Any) -> None:
        """Set a parameter of a finished structure, or leave everything as it was."""
        name, before = argument.name, getattr(self, argument.name, _MISSING)
        value, part = self._as_held(argument, value), isinstance(value, nn.Module)
        numeric = argument.annotation in _NUMERIC
        if numeric and before is _MISSING:
            raise ValueError(f"{name}={value} can't be set: it is not kept under its own name")
        if name in self.fixed or not (numeric or part or name in self.settable):
            raise ValueError(
                f"{name}={value} can't be set: {name} is fixed when a {type(self).__name__} is "
                "built; build another one"
            )
        self._try(name, value, before)

    def _try(self, name: str, value: Any, before: Any) -> None:
        part = isinstance(value, nn.Module)
        try:
            self._place(name, value)
            self._accept()
            if part:
                self.resize(*self.origin.shape)
        except Exception:
            self._place(name, before)
            if isinstance(before, Parameters) and before.origin.shape != self.origin.shape:
                before.resize(*self.origin.shape)
            raise

    def _is_part(self, name: str) -> bool:
        """Whether a structure, or what holds structures, was built in under a name."""
        held = self.__dict__["_modules"].get(name)
        return held is not None and any(isinstance(x, Parameters) for x in held.modules())

    def _exchange(self, name: str, value: Any) -> None:
        """Replace a part that is no argument by one of its kind and size."""
        before = self._modules[name]
        if not isinstance(before, Parameters):
            raise ValueError(
                f"{name} can't be set: it is fixed when a {type(self).__name__} is built; build "
                "another one"
            )
        if not isinstance(value, type(before)):
            raise TypeError(f"{name}={named(value)} is no {type(before).__name__}: give one")
        sizes = [
            {k: list(x.shape) for k, x in part.flat(part.initial([])).items()}
            for part in (before, value.select(0) if value.origin.dim() else value)
        ]
        if sizes[0] != sizes[1]:
            raise ValueError(
                f"{name} has a state of shapes {sizes[1]}, the {type(self).__name__} was built for "
                f"{sizes[0]}: give one of the same size"
            )
        self._try(name, value, before)

    def _accept(self) -> None:
        """Raise unless all numbers are finite, for this batch, and fit each other."""
        for name, number in self._numbers().items():
            self._as_held(self._arguments[name], number)
        check_batch(self, list(self.origin.shape))
        self._check_all()

    def _place(self, name: str, value: Any) -> None:
        if name in self.__dict__ or name in self._buffers or name in self._parameters:
            delattr(self, name)
        if isinstance(value, Tensor) and not isinstance(value, nn.Parameter):
            self.register_buffer(name, value, persistent=False)
        elif isinstance(value, nn.Parameter):
            super().__setattr__(name, outside_inference(value))
        elif value is not _MISSING:
            super().__setattr__(name, value)

    def _as_held(self, argument: inspect.Parameter, value: Any) -> Any:
        """A parameter as it is held; refuses what is no finite number where one belongs."""
        name, default = argument.name, argument.default
        parts = [k for k in _kinds(argument.annotation) if issubclass(k, nn.Module)]
        if parts and not isinstance(value, (*parts, type(None))):
            raise TypeError(f"{name}={named(value)} is no {parts[0].__name__}: give one")
        if argument.annotation not in _NUMERIC or (value is None and default is None):
            return value
        if isinstance(value, Tensor) and (value.is_complex() or value.dtype == torch.bool):
            raise TypeError(f"{name} of dtype {value.dtype} is no number: give floats")
        if isinstance(value, Tensor) and argument.annotation in _MANY:
            like = self._buffers.get("origin", torch.zeros(()))
            held = value.to(like)  # where a large one becomes infinite
            if not value.is_meta and not bool(held.isfinite().all()):
                raise ValueError(f"{name}={value.tolist()} is not finite: give numbers")
            own = isinstance(value, nn.Parameter)  # which an optimizer may already hold
            return value if own else held.clone()  # the caller may change his
        if isinstance(value, Tensor) and value.numel() != 1:
            raise ValueError(
                f"{name}={value.tolist()}: give one number for all agents, or annotate it Number"
            )
        try:
            if isinstance(value, (bool, str)):
                raise TypeError
            number = float(value)
        except OverflowError:
            raise ValueError(f"{name}={shown(value)} is not finite: give a number") from None
        except (TypeError, ValueError):
            many = ", or a tensor with one per agent" if argument.annotation in _MANY else ""
            raise TypeError(f"{name}={shown(value)} is no number: give a float{many}") from None
        if not abs(number) <= LARGEST and number != default:
            raise ValueError(f"{name}={value} is not finite: give a number")
        return number

    @classmethod
    def numeric(cls) -> list[str]:
        """Names of the parameters that are numbers."""
        return [name for name, each in cls._arguments.items() if each.annotation in _NUMERIC]

    def _numbers(self) -> dict[str, Tensor]:
        """Parameters that are tensors, one number per agent."""
        held = {**self._buffers, **self._parameters}
        return {k: held[k] for k in self.numeric() if isinstance(held.get(k), Tensor)}

    def extra_repr(self) -> str:
        """The parameters, for ``print``."""
        names = [k for k in self._arguments if k not in self._modules and hasattr(self, k)]
        return ", ".join(f"{name}={getattr(self, name)!r}" for name in names)

    def _refuse_misspelling(self, name: str) -> None:
        if hasattr(self, name):
            return
        for path, part in self.named_modules():
            if isinstance(part, Parameters) and name in part.numeric():
                raise AttributeError(
                    f"{type(self).__name__} has no parameter {name!r}: set {path}.{name}"
                )
        near = difflib.get_close_matches(name.lower(), self._arguments, 1, cutoff=0.86)
        if near:
            raise AttributeError(
                f"{type(self).__name__} has no parameter {name!r}: did you mean {near[0]!r}?"
            )


def _kinds(annotation: Any) -> list[type]:
    """The classes that an annotation such as ``NodeWTA | None`` names."""
    return [k for k in (*get_args(annotation), annotation) if isinstance(k, type)]


def outside_inference(tensor: Any) -> Any:
    """The tensor, or a copy that may be updated outside of inference mode, too."""
    if tensor is None or not tensor.is_inference():
        return tensor
    with torch.inference_mode(False):
        copy = tensor.detach().clone()
        return nn.Parameter(copy) if isinstance(tensor, nn.Parameter) else copy


def check_batch(structure: nn.Module, batch: list[int]) -> None:
    """Raise unless numbers per agent, here and in all parts, are for ``batch``."""
    for path, part in structure.named_modules():
        for name, number in part._numbers().items() if isinstance(part, Parameters) else ():
            where, shape = ".".join(filter(None, (path, name))), list(number.shape)
            if shape and shape != batch:
                raise ValueError(
                    f"{where} of shape {shape} does not fit the batch {batch}: give one number, or "
                    "one for each agent; call resize(*batch) or spread(*batch) before"
                )


def named(value: Any) -> str:
    """A value in a sentence of one line: of a module its kind."""
    return type(value).__name__ if isinstance(value, nn.Module) else repr(value)
