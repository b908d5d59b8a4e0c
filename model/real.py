"""Validation of users' numbers: real, with the expected shape. NumPy alone would accept '3', True and None."""

import numpy as np
from numpy.typing import NDArray


def real_array(value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """A float64 copy of real, finite numbers of this shape.

    Raises
    ------
    ValueError
        Texts, booleans, None, complex or ragged input, another shape, NaN or infinity; the message has the value found
        and the expectation.
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
    return array.astype(np.float64, copy=False)  # already a copy
