"""Colour vision: from RGB images to a map of hue by column."""

import torch
from torch import Tensor


def hue_saturation_value(image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    r"""Hue in degrees [0, 360), saturation and value from 0 to 1, of uint8 RGB ``(*batch, 3)``.

    .. math:: V = \max(R, G, B), \quad C = V - \min(R, G, B), \quad S = C / V

    and the hue is 60 degrees times :math:`(G-B)/C`, :math:`2 + (B-R)/C` or
    :math:`4 + (R-G)/C` where red, green or blue is the largest; 0 for grays. The definition
    of OpenCV's ``COLOR_RGB2HSV`` on floats.
    """
    red, green, blue = image.to(torch.float32).unbind(-1)
    value = torch.maximum(torch.maximum(red, green), blue)
    chroma = value - torch.minimum(torch.minimum(red, green), blue)
    divisor = chroma.clamp_min(1.0)  # chroma is 0 or at least 1
    sextant = torch.where(
        value == red,
        (green - blue) / divisor,
        torch.where(value == green, 2 + (blue - red) / divisor, 4 + (red - green) / divisor),
    )
    return (60 * sextant) % 360, chroma / value.clamp_min(1.0), value / 255


def hue_columns(image: Tensor, hues: int, min_saturation: float, min_value: float) -> Tensor:
    """Share of each image column that has each hue, ``(*batch, hues, width)``.

    Bin k is centred on ``k * 360 / hues`` degrees; pixels that are too gray or too dark
    count for none.
    """
    hue, saturation, value = hue_saturation_value(image)
    height, width = hue.shape[-2], hue.shape[-1]
    bins = (torch.round(hue * (hues / 360)) % hues).to(torch.int64)
    site = bins * width + torch.arange(width, device=image.device)
    colored = ((saturation >= min_saturation) & (value >= min_value)).to(torch.float32)
    counts = colored.new_zeros(list(image.shape[:-3]) + [hues * width])
    counts = counts.scatter_add(-1, site.flatten(-2), colored.flatten(-2))
    return counts.unflatten(-1, [hues, width]) / height
