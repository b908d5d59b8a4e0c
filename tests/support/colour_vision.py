"""How colours look to red-green blind readers, and how far apart they are."""

import numpy as np

from tests.support.arrays import FloatArray

# Machado, Oliveira, Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009), 1291-1298: severity 1.0, of linear RGB.
BLIND = {
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
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


def delta_e_2000(one: FloatArray, other: FloatArray) -> float:
    """CIEDE2000; Sharma, Wu, Dalal, Color Res. Appl. 30 (2005), 21-30, equations (2) to (22)."""
    (L1, a1, b1), (L2, a2, b2) = one, other
    G = 0.5 * (1 - np.sqrt(_seventh((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2)))
    a1, a2 = (1 + G) * a1, (1 + G) * a2
    C1, C2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)), np.degrees(np.arctan2(b2, a2))
    turn = (h2 - h1 + 180) % 360 - 180
    L, C, h = (L1 + L2) / 2, (C1 + C2) / 2, h1 + turn / 2
    dH = 2 * np.sqrt(C1 * C2) * np.sin(np.radians(turn / 2))
    T = sum(
        weight * np.cos(np.radians(n * h - shift))
        for weight, n, shift in ((1, 0, 0), (-0.17, 1, 30), (0.24, 2, 0), (0.32, 3, -6), (-0.20, 4, 63))
    )
    lightness = (L2 - L1) / (1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2))
    chroma, hue = (C2 - C1) / (1 + 0.045 * C), dH / (1 + 0.015 * C * T)
    blue = 60 * np.exp(-((((h - 275 + 180) % 360 - 180) / 25) ** 2))
    rotation = -np.sin(np.radians(blue)) * 2 * np.sqrt(_seventh(C))
    return float(np.sqrt(lightness**2 + chroma**2 + hue**2 + rotation * chroma * hue))


def _seventh(chroma: float) -> float:
    return float(chroma**7 / (chroma**7 + 25.0**7))
