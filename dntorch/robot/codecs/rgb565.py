"""Pixels of 16 bits: five of red, six of green, five of blue, high byte first.

The expansion is that of GCtronic's tools (``r = b0 & 0xF8`` and so on): low bits are 0, so
white is (248, 252, 248).
"""

from typing import NamedTuple

import numpy as np


class Picture(NamedTuple):
    """An image as it came over the wire."""

    width: int
    height: int
    pixels: bytes
    """row by row from the top left: two bytes a pixel in colour, one in gray"""


def _expand() -> np.ndarray:
    """RGB of every 16-bit pixel, ``(65536, 3)``."""
    word = np.arange(65536)
    parts = (word >> 8) & 0xF8, (word >> 3) & 0xFC, (word << 3) & 0xF8
    return np.stack(parts, axis=1).astype(np.uint8)


_RGB = _expand()


def decode(picture: Picture) -> np.ndarray:
    """uint8 ``(height, width, 3)``, RGB; of gray pixels all three are the same.

    Raises:
        ValueError: the number of bytes is neither one nor two a pixel.

    >>> decode(Picture(1, 1, bytes([0xF8, 0x00]))).tolist()
    [[[248, 0, 0]]]
    """
    width, height, pixels = picture
    if len(pixels) == 2 * width * height:
        return np.take(_RGB, np.frombuffer(pixels, ">u2"), axis=0).reshape(height, width, 3)
    if len(pixels) == width * height:
        gray = np.frombuffer(pixels, np.uint8).reshape(height, width, 1)
        return np.repeat(gray, 3, axis=2)
    raise ValueError(
        f"{len(pixels)} bytes are no image of {width}x{height}: give one or two bytes a pixel"
    )


def encode(image: np.ndarray) -> bytes:
    """Bytes of an RGB image, uint8 ``(height, width, 3)``; low bits are cut off.

    >>> encode(np.array([[[255, 4, 8]]], np.uint8)).hex()
    'f821'
    """
    red, green, blue = np.moveaxis(image.astype(np.uint16), -1, 0)
    word = (red & 0xF8) << 8 | (green & 0xFC) << 3 | blue >> 3
    return word.astype(">u2").tobytes()
