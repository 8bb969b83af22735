"""The table of COSIVINA's element classes."""

from collections.abc import Callable

from dntorch.cosivina import elements
from dntorch.cosivina.elements import Parts
from dntorch.cosivina.files import Element, Size
from dntorch.cosivina.parts import Part

SUPPORTED: dict[str, Callable[[Element, float], Parts]] = {
    "BoostStimulus": elements.boost,
    "CustomStimulus": elements.pattern,
    "DiagonalExpansion": elements.diagonal_expansion,
    "DiagonalSum": elements.diagonal_sum,
    "ExpandDimension": elements.expand_any,
    "ExpandDimension2D": elements.expand,
    "FastFourierTransform": elements.passed,
    "GaussKernel1D": elements.kernel,
    "GaussKernel2D": elements.kernel,
    "GaussKernel3D": elements.kernel,
    "GaussStimulus1D": elements.bump,
    "GaussStimulus2D": elements.bump,
    "GaussStimulus3D": elements.bump,
    "HalfWaveRectification": elements.rectified,
    "KernelFFT": elements.fft,
    "KernelInverseFFT": elements.inverse_fft,
    "LateralInteractions1D": elements.hat,
    "LateralInteractions2D": elements.hat,
    "LateralInteractions3D": elements.hat,
    "LateralInteractionsDiscrete": elements.discrete,
    "LateralInteractionsShifted1D": elements.hat_shifted,
    "MemoryTrace": elements.trace,
    "MexicanHatKernel1D": elements.hat,
    "MexicanHatKernel2D": elements.hat,
    "MexicanHatKernel3D": elements.hat,
    "NeuralField": elements.field,
    "NormalNoise": elements.noise,
    "PointwiseProduct": elements.multiplied,
    "ScaleInput": elements.scaled,
    "ShiftInput": elements.moved,
    "Sigmoid": elements.logistic,
    "SumAllDimensions": elements.sums,
    "SumDimension": elements.sum_over,
    "SumInputs": elements.added,
    "Transpose": elements.transpose,
    "WeightMatrix": elements.weights,
}


def _one(element: Element) -> Size:
    return (1, 1)


def _image(element: Element) -> Size:
    return (*element.size()[:2], 3)


OUTSIDE: dict[str, dict[str, Callable[[Element], Size]]] = {
    "CameraGrabber": {"image": _image},
    "ColorExtraction": {"output": Element.size},
    "CustomStimulusSequence": {"output": lambda element: element.size("stimulusSize")},
    "DynamicRobotController": {"orientation": _one, "position": lambda element: (1, 2)},
    "ImageLoader": {"image": _image},
    "MobileRobotArena": {
        "robotPhi": _one,
        "robotPosition": lambda element: (1, 2),
        "rawSensorValues": lambda element: (1, len(element.numbers("sensorAngles"))),
        "sensorOutput": lambda element: element.size("sensorOutputSize"),
    },
    "TimedBoost": {"output": _one},
    "TimedCustomStimulus": {"output": Element.size},
    "TimedGaussStimulus1D": {"output": Element.size},
    "TimedGaussStimulus2D": {"output": Element.size},
}
"""Components that the caller gives: what comes from a device, or at times that no step knows."""

_LEARNS = "it learns weights, which no link does here: give learned ones as a WeightMatrix"
_RECORDS = "it only records: take out what reads it"

MISSING = {
    "AdaptiveWeightMatrix": _LEARNS,
    "AttractorDynamics": "a heading has no element here: give what it does by hand",
    "Convolution": "a product of two patterns at all shifts has no element here: give it by hand",
    "DynamicVariable": "an integrator without leak has no element here: give its state by hand",
    "HebbianConnection": _LEARNS,
    "History": _RECORDS,
    "Interpolation1D": "interpolation has no element here: take a WeightMatrix",
    "LFP": _RECORDS,
    "RunningHistory": _RECORDS,
    "ScalarToGaussian": "a number becomes a pattern outside: give a CustomStimulus by hand",
    "SingleNodeDynamics": "it is for plots: take a NeuralField of size [1, 1]",
    "TimedSwitch": "a step does not know the time: switch the input in your loop",
}
"""Left out, unless something neural reads them: then this is why that can't be."""


def parts(element: Element, delta_t: float) -> Parts:
    """The components of an element, its default one first.

    Raises:
        ValueError: an unknown class, a parameter that is missing or does not fit.
    """
    kind = element.kind
    if kind in SUPPORTED:
        return SUPPORTED[kind](element, delta_t)
    if kind in OUTSIDE:
        return {name: Part("open", size(element)) for name, size in OUTSIDE[kind].items()}
    if kind in MISSING:
        return {"": Part("unsupported", why=MISSING[kind])}
    raise element.error("the class is unknown: take it out, or write what it does with known ones")
