"""Numbers from users: real and of a wanted shape, or a clear refusal. NumPy alone would take '3', True and None."""

import numpy as np
from numpy.typing import NDArray


def real_array(value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """A float64 copy of real, finite numbers of this shape.

    Raises
    ------
    ValueError
        Texts, truth values, None, complex or ragged input, another shape, or NaN and infinities; the text says what
        was found and what was expected.
    """
    expected = "one number" if shape == () else f"numbers of shape {shape}"
    try:
        array = np.array(value)
    except ValueError:  # ragged
        raise ValueError(f"is {value!r}; expected {expected}") from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"is {value!r}; expected {expected}")
    if array.shape != shape:
        raise ValueError(f"has shape {array.shape}; expected {expected}")
    if not np.isfinite(array).all():
        raise ValueError(f"is {array.tolist()}; expected finite numbers only")
    return array.astype(np.float64, copy=False)  # which is a copy already
