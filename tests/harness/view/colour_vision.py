"""How colours look to red-green blind readers, and how far apart they are."""

import numpy as np

from tests.support.arrays import FloatArray

# Machado, Oliveira, Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009), 1291-1298: severity 1.0, of linear RGB.
BLIND = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
# IEC 61966-2-1: linear RGB to XYZ, and its white (D65).
_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def rgb_of(hexadecimal: str) -> FloatArray:
    """Red, green, blue [0, 1] of "#rrggbb"."""
    return np.array([int(hexadecimal[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def lab(rgb: FloatArray, matrix: list[list[float]] | None = None) -> FloatArray:
    """CIELAB of an sRGB colour, as seen through a matrix of linear RGB."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    if matrix is not None:
        linear = np.clip(np.array(matrix) @ linear, 0, 1)
    share = _XYZ @ linear / _XYZ.sum(axis=1)
    x, y, z = np.where(share > (6 / 29) ** 3, np.cbrt(share), share / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def delta_e_76(one: FloatArray, other: FloatArray) -> float:
    """Distance of two colours in CIELAB."""
    return float(np.linalg.norm(one - other))
