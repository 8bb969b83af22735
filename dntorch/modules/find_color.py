"""Senses and motors of "find colour c": from camera images to wheel speeds."""

from typing import Final, NamedTuple

import torch
from torch import Tensor

from dntorch.body import EPUCK
from dntorch.cells.color import hue_columns
from dntorch.cells.field import FieldState
from dntorch.cells.functions import is_on
from dntorch.cells.heading import bearings, turning_rate, wheel_speeds
from dntorch.cells.kernels import Gauss, Global, gauss_matrix
from dntorch.checks import check_count, check_ends, check_positive
from dntorch.colors import HUES, MIN_SATURATION, MIN_VALUE, PAPER, check_colors
from dntorch.modules.field import DNF
from dntorch.modules.sensorimotor import Sensorimotor


class ColorState(NamedTuple):
    perception: FieldState
    satisfaction: FieldState
    heading: FieldState


class FindColor(Sensorimotor[ColorState]):
    r"""Turn on the spot until an object of the wanted colour is in the middle of the image.

    ::

        image -> hue by column -> perceptual field -> heading field -> wheel speeds
                                       ^    |
        intention ---- hue bias -------+    v
                  `--- hue and centre bias: CoS field -> match of each condition of satisfaction

    ======================  =========================  =====  ======================================
    quantity                here                       unit   meaning
    ======================  =========================  =====  ======================================
    perceptual field        ``perception``             1      hue by column: salient where an image
                                                              and an intention agree
    CoS field               ``satisfaction``           1      same axes: on where that is central
    heading field           ``heading``                1      one axis: the direction to turn to
    :math:`\lambda`         ``turning_gain``           1/s    attraction of the heading
    :math:`\omega_{scan}`   ``scan``                   rad/s  turning rate while nothing is seen
    ======================  =========================  =====  ======================================

    The image alone leaves the perceptual field below threshold and so does the intention
    alone. Local excitation and global inhibition let one of several fitting objects win.

    Shapes: the observation ``image`` is RGB, uint8, ``(*batch, height, width, 3)``, row 0 at the
    top, of any size; fields have ``hues`` by ``columns`` sites; ``intention`` ``(*batch, n)``;
    the action is two wheel speeds in rad/s, left first, ``(*batch, 2)``.
    State: ``ColorState(perception, satisfaction, heading)``, at rest at their resting level.

    Args:
        colors: letters of the colours to find, one behaviour each.
        fov: horizontal field of view of the camera, rad.
        wheel_radius, axle: of the robot, m; ``max_speed``: of a wheel, rad/s.
        hues, columns: sites of the fields; 360/hues degrees per bin.
        min_saturation, min_value: pixels below are no colour, 0 to 1.
        hue_centers: hue of each colour in degrees where it is not that of the letter (a real
            camera: calibrate).

    Raises:
        ValueError: an image that is not uint8 RGB, unknown colours, two of them in one bin,
            ``fov``, ``wheel_radius``, ``axle`` or ``max_speed`` not positive.

    Source: sections III.B and IV.A of Kazerounian, Luciw, Richter and Sandamirskaya,
    "Autonomous Reinforcement of Behavioral Sequences in Neural Dynamics".

    **Deviation**: the paper gives no parameter of its fields, and takes the maximum of hue
    for the y-axis; here each hue has its own row.

    >>> body = FindColor("RGBY")
    >>> image = torch.zeros(39, 52, 3, dtype=torch.uint8)
    >>> image[10:30, 5:15, 2] = 255  # a blue block on the left
    >>> for _ in range(32):
    ...     action = body({"image": image}, torch.tensor([0.0, 0.0, 1.0, 0.0]))  # find blue
    >>> bool(action[0] < -0.39 and action[1] > 0.39)  # turns left, faster than it scans
    True
    """

    senses = ("image",)
    fixed = ("dt", "fov")

    SALIENCE: Final[float] = 4.0  # a quarter of a column in one hue is as salient as all of it
    PERCEPT_GAIN: Final[float] = 4.0  # neither lifts a field above threshold alone
    INTENTION_GAIN: Final[float] = 2.5
    CENTER_GAIN: Final[float] = 4.0  # from perception to the CoS field
    HEADING_GAIN: Final[float] = 8.0  # from perception to the heading field
    FULL_MATCH: Final[float] = 1.6  # sites of the CoS field that are on at a full match
    SOFTNESS: Final[float] = 0.1  # sites of the heading field at which it pulls as much as the scan

    hue_bias: Tensor
    hue_rows: Tensor
    center: Tensor
    blur: Tensor
    bearing: Tensor

    def __init__(
        self,
        colors: str = PAPER,
        fov: float = EPUCK.fov,
        wheel_radius: float = EPUCK.wheel_radius,
        axle: float = EPUCK.axle,
        max_speed: float = EPUCK.speed_cap,
        turning_gain: float = 1.5,
        scan: float = 0.3,
        hues: int = 24,
        columns: int = 52,
        min_saturation: float = MIN_SATURATION,
        min_value: float = MIN_VALUE,
        hue_centers: list[float] | None = None,
        dt: float = 1 / 32,
    ) -> None:
        super().__init__(dt, max_speed)
        check_count("hues", hues)
        check_count("columns", columns, 2)
        self.n, self.fov = len(check_colors(colors)), fov
        if hue_centers is not None and len(hue_centers) != self.n:
            raise ValueError(f"hue_centers={hue_centers}: give one for each color of {colors}")
        self.wheel_radius, self.axle = wheel_radius, axle
        self.turning_gain, self.scan = turning_gain, scan
        self.hues, self.columns = hues, columns
        self.min_saturation, self.min_value = min_saturation, min_value
        # Widths are in columns of a 52-column image, about that of half a block.
        unit = columns / 52
        shape = (hues, columns)
        border = ("circular", "zero")
        kernel = (Gauss(0.4 / unit, (0.8, 2.5 * unit), normalized=False), Global(-0.4 / unit))
        self.perception = DNF(shape, kernel, border=border, dt=dt)
        self.satisfaction = DNF(
            shape, (Gauss(0.1 / unit, (0.8, 2.5 * unit), normalized=False),), border=border, dt=dt
        )
        self.heading = DNF(
            columns,
            (Gauss(0.4 / unit, 2.5 * unit, normalized=False), Global(-0.15 / unit)),
            border="zero",
            dt=dt,
        )
        centers = hue_centers or [HUES[letter] for letter in colors]
        distance = hue_distances(centers, hues)
        self.register_buffer("hue_bias", torch.exp(-0.5 * distance**2), persistent=False)
        self.register_buffer("hue_rows", own_rows(distance), persistent=False)
        column = torch.arange(columns) - (columns - 1) / 2
        center = torch.exp(-0.5 * (column / (1.5 * unit)) ** 2)
        self.register_buffer("center", center, persistent=False)
        blur = gauss_matrix(columns, 3.5 * unit, "zero")
        self.register_buffer("blur", blur.to(center), persistent=False)
        self.register_buffer("bearing", bearings(columns, fov).to(center), persistent=False)

    def check(self) -> None:
        super().check()
        for name in ("fov", "wheel_radius", "axle"):
            check_positive(name, getattr(self, name))

    def percept(self, image: Tensor) -> Tensor:
        """Salience of each hue in each column, 0 to 1, ``(*batch, hues, columns)``."""
        if image.dtype != torch.uint8 or image.dim() < 3 or image.shape[-1] != 3:
            raise ValueError(
                f"image of shape {list(image.shape)} and dtype {image.dtype}: give uint8 RGB, "
                "(*batch, height, width, 3), as a tensor"
            )
        share = hue_columns(image, self.hues, self.min_saturation, self.min_value)
        batch = list(share.shape[:-2])
        if share.shape[-1] != self.columns:
            share = torch.nn.functional.adaptive_avg_pool1d(
                share.reshape(-1, self.hues, share.shape[-1]), self.columns
            ).reshape(batch + [self.hues, self.columns])
        return torch.matmul(
            (self.SALIENCE * share).clamp_max(1.0).to(self.blur.dtype), self.blur.t()
        )

    def match(self, _observation: dict[str, Tensor], state: ColorState) -> Tensor:
        """How much of each hue the CoS field holds, ``(*batch, n)``, 0 to 1."""
        output = self.satisfaction.output(state.satisfaction)
        return (output.sum(-1) @ self.hue_rows.t() / self.FULL_MATCH).clamp_max(1.0)

    def advance(
        self, observation: dict[str, Tensor], intention: Tensor, state: ColorState
    ) -> ColorState:
        """One step of the fields, all from time t."""
        check_ends("intention", intention, [self.n])
        seen = self.perception.output(state.perception)
        bias = self.INTENTION_GAIN * (intention @ self.hue_bias).unsqueeze(-1)
        percept = self.PERCEPT_GAIN * self.percept(observation["image"]) + bias
        central = self.CENTER_GAIN * seen + bias * self.center
        return ColorState(
            self.perception.euler(percept, state.perception),
            self.satisfaction.euler(central, state.satisfaction),
            self.heading.euler(self.HEADING_GAIN * seen.amax(-2), state.heading),
        )

    def act(self, intention: Tensor, state: ColorState) -> Tensor:
        """Wheel speeds: towards the peak of the heading field; none without an intention."""
        output = self.heading.output(state.heading)
        turning = turning_rate(output, self.bearing, self.turning_gain, self.scan, self.SOFTNESS)
        turning = turning * is_on(intention.amax(-1)).to(turning.dtype)
        return wheel_speeds(turning, self.wheel_radius, self.axle)


def hue_distances(centers: list[float], hues: int) -> Tensor:
    """How many bins each hue lies from the colour of each behaviour, ``(n, hues)``."""
    width = 360 / hues
    degrees = torch.arange(hues) * width - torch.tensor(centers).unsqueeze(-1)
    distance = ((degrees + 180) % 360 - 180).abs() / width
    nearest = distance.argmin(-1)
    if len(set(nearest.tolist())) < len(centers):
        raise ValueError(
            f"hues={hues}: two of the colours at {centers} degrees share a bin of {width:g} "
            "degrees; take more hues"
        )
    return distance


def own_rows(distance: Tensor) -> Tensor:
    """Which hues belong to one behaviour alone, zeros and ones, ``(n, hues)``.

    Those within one bin of its colour and nearer to it than to any other.
    """
    rest = distance.clone()
    rest.scatter_(0, distance.argmin(0, keepdim=True), float("inf"))
    alone = distance < rest.amin(0)
    return (alone & (distance <= 1)).to(distance)
