"""Images made smaller or larger by areas: every pixel is the mean of what it covers."""

import numpy as np


def means(values: np.ndarray, parts: int, zoom: float = 1.0) -> np.ndarray:
    """Means of ``values`` along the first axis over ``parts`` of its middle ``1/zoom``, float32.

    Where a zoom below 1 looks beyond the end there is 0.

    >>> means(np.array([1.0, 3.0, 5.0, 9.0]), 2).tolist()
    [2.0, 7.0]
    >>> means(np.array([1.0, 3.0, 5.0, 9.0]), 2, zoom=2.0).tolist()
    [3.0, 5.0]
    >>> means(np.array([1.0, 3.0, 5.0, 9.0]), 4, zoom=0.5).tolist()
    [0.0, 2.0, 7.0, 0.0]
    """
    size = len(values)
    span = size * (0.5 + (np.arange(parts + 1) / parts - 0.5) / zoom)
    edges = span.clip(0, size)
    whole = np.minimum(edges.astype(int), size - 1)
    shape = (-1,) + (1,) * (values.ndim - 1)
    part = (edges - whole).astype(np.float32).reshape(shape)
    before = np.zeros((size + 1, *values.shape[1:]), np.float32)
    whole_numbers = np.issubdtype(values.dtype, np.integer)  # four times as fast as floats
    before[1:] = np.cumsum(values, axis=0, dtype=np.int32 if whole_numbers else np.float32)
    upto = before[whole] + part * values[whole]
    return np.diff(upto, axis=0) / np.diff(span).astype(np.float32).reshape(shape)


def resample(
    image: np.ndarray, width: int, height: int, zoom: float | tuple[float, float] = 1.0
) -> np.ndarray:
    """The middle ``1/zoom`` of an image, uint8 ``(h, w, 3)``, with another number of pixels.

    ``zoom`` may differ across and down; below 1 there is a black margin.
    """
    across, down = zoom if isinstance(zoom, tuple) else (zoom, zoom)
    if image.shape[:2] == (height, width) and across == down == 1:
        return image
    small = means(means(image, height, down).swapaxes(0, 1), width, across)
    return np.rint(small.swapaxes(0, 1)).astype(np.uint8)
