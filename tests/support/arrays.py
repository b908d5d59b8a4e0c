"""Types of arrays in annotations of tests."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
