"""Colour vision: from RGB images to a map of hue by column."""

import torch
from torch import Tensor


def planes(image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Red, green and blue of uint8 RGB ``(*batch, 3)`` as float32, each dense in memory.

    Side by side they vectorise, interleaved they don't: stacking pays, in compiled code by ten.
    """
    red, green, blue = torch.stack(image.unbind(-1)).to(torch.float32).unbind(0)
    return red, green, blue


def value_and_chroma(red: Tensor, green: Tensor, blue: Tensor) -> tuple[Tensor, Tensor]:
    """Largest channel, and the distance from it to the smallest."""
    value = torch.maximum(torch.maximum(red, green), blue)
    return value, value - torch.minimum(torch.minimum(red, green), blue)


def chroma_by_sextant(
    red: Tensor, green: Tensor, blue: Tensor, value: Tensor, chroma: Tensor
) -> Tensor:
    """Hue in sixths of a turn, from -1 to 5, times chroma: whole numbers."""
    after_red, after_green = green - blue, torch.add(blue - red, chroma, alpha=2.0)
    after_blue = torch.add(red - green, chroma, alpha=4.0)
    rest = torch.where(value == green, after_green, after_blue)
    return torch.where(value == red, after_red, rest)


def hue_saturation_value(image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    r"""Hue in degrees [0, 360), saturation and value from 0 to 1, of uint8 RGB ``(*batch, 3)``.

    .. math:: V = \max(R, G, B), \quad C = V - \min(R, G, B), \quad S = C / V

    and the hue is 60 degrees times :math:`(G-B)/C`, :math:`2 + (B-R)/C` or
    :math:`4 + (R-G)/C` where red, green or blue is the largest; 0 for grays. The definition
    of OpenCV's ``COLOR_RGB2HSV`` on floats.
    """
    red, green, blue = planes(image)
    value, chroma = value_and_chroma(red, green, blue)
    sextant = chroma_by_sextant(red, green, blue, value, chroma) / chroma.clamp_min(1.0)
    return (60 * sextant) % 360, chroma / value.clamp_min(1.0), value / 255


def hue_bins(image: Tensor, hues: int, min_saturation: float, min_value: float) -> Tensor:
    """Bin of each pixel of ``(*batch, height, width, 3)``; ``hues`` where too gray or too dark.

    Bin k is centred on ``k * 360 / hues`` degrees. A hue on the edge of two
    bins is in the even one: numerator and denominator are whole numbers, so that nothing is
    rounded before the bin is.
    """
    red, green, blue = planes(image.flatten(-3, -2))  # in lines, which are joined fastest
    value, chroma = value_and_chroma(red, green, blue)
    turned = chroma_by_sextant(red, green, blue, value, chroma) * hues
    bins = torch.round(turned / (6 * chroma).clamp_min(1.0))
    bins = torch.sub(bins, torch.floor(bins / hues), alpha=hues)  # modulo, in vectors
    colored = (chroma / value.clamp_min(1.0) >= min_saturation) & (value >= 255 * min_value)
    bins = torch.where(colored, bins, hues).to(torch.uint8 if hues < 256 else torch.int32)
    return bins.unflatten(-1, image.shape[-3:-1])


def hue_columns(image: Tensor, hues: int, min_saturation: float, min_value: float) -> Tensor:
    """Share of each image column that has each hue, ``(*batch, hues, width)``: see `hue_bins`.

    Counts the pixels of all other bins, without scattering: exclusive or is 0 where the bin is
    that of the row, and above 0 elsewhere.
    """
    bins = hue_bins(image, hues, min_saturation, min_value)
    # A row without colour is added, since what is joined lies in memory: else compiled code
    # would compute the map again for each hue.
    bins = torch.cat((bins, torch.full_like(bins[..., :1, :], hues)), -2)
    number = torch.arange(hues, dtype=bins.dtype, device=bins.device).unsqueeze(-1).unsqueeze(-1)
    others = (bins.unsqueeze(-3) ^ number).clamp_max(1).to(torch.float32).sum(-2)
    return (bins.shape[-2] - others) / image.shape[-3]
