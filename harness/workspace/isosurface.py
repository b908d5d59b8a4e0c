"""The closed surface of a workspace: around the region where a field on a grid is positive, by marching tetrahedra.

Source: Doi & Koide, "An efficient method of triangulating equi-valued surfaces by using tetrahedral cells", IEICE
Transactions E74(1), 1991. A cell is divided into six tetrahedra about one diagonal, so that neighbours match.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gough_stewart.model.kinematics import LARGEST_PITCH
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import COORDINATES, PoseQualities, Workspace, evaluate_poses

# Corners of a cell are numbered by their bits, 4 a + 2 b + c for the corner (a, b, c).
_TETRAHEDRA = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
# Coordinates of the same corners in their cell, in cells (6, 4, 3).
_PLACES = (_TETRAHEDRA[..., None] >> np.array([2, 1, 0]) & 1).astype(float)

# Colours of a surface end at this condition number, and shares of one beyond would be shares of infinity.
_LARGEST_SHOWN = 1000.0
# Least number of cells along each coordinate; with fewer, edges where two limits meet look ragged.
_CELLS = 60


class Isosurface(NamedTuple):
    """Triangles, and the values of a second field at their corners."""

    vertices: FloatArray  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3), counter-clockwise seen from where the field is negative
    colour: FloatArray  # (n,)


def clearance(platform: Platform, q: PoseQualities, pitch: FloatArray) -> FloatArray:
    """A continuous measure of distance from the nearest limit, positive inside the reachable region.

    The least of: margin of leg length in characteristic lengths, margins of joint angle and pitch in rad, smallest
    singular value.
    """
    least = np.minimum(LARGEST_PITCH - np.abs(pitch), q.singular_margin)
    if q.leg_length_margin is not None:
        least = np.fmin(least, q.leg_length_margin / platform.characteristic_length)
    if q.joint_angle_margin is not None:
        least = np.fmin(least, q.joint_angle_margin)
    return np.asarray(least)


def isosurface(axes: Sequence[FloatArray], field: FloatArray, colour: FloatArray) -> Isosurface:
    """The surface on which a field is 0, by linear interpolation between neighbours; closed at the ends of the grid.

    Coordinates of the grid (k,), (l,), (m,) increase; `colour` at its points (k, l, m) is interpolated as well.
    """
    # repeat the end planes with negative values, so that the surface is cut flat at the ends of the grid
    points = np.stack(np.meshgrid(*(np.pad(axis, 1, mode="edge") for axis in axes), indexing="ij"), axis=-1)
    inner = np.pad(np.asarray(field, float), 1, mode="edge")
    is_end = np.pad(np.zeros(np.shape(field), bool), 1, constant_values=True)
    inner = np.where(is_end & (inner > 0), -np.inf, inner).ravel()
    colours = np.pad(np.asarray(colour, float), 1, mode="edge").ravel()
    # windows of 2×2×2 points have the corners in the order of their numbers; tetrahedra of those that are crossed
    cells = sliding_window_view(np.arange(inner.size).reshape(points.shape[:3]), (2, 2, 2)).reshape(-1, 8)
    positive = (inner[cells] > 0).sum(axis=1)
    corners = cells[(positive > 0) & (positive < 8)][:, _TETRAHEDRA].reshape(-1, 4)
    is_in = inner[corners] > 0
    kind = np.arange(len(corners)) % len(_TETRAHEDRA)
    edges, outward = [], []
    for case in range(1, 15):
        chosen = (is_in << np.arange(4)).sum(axis=1) == case
        rows, local = corners[chosen], _PLACES[kind[chosen]]
        within = [k for k in range(4) if case >> k & 1]
        without = [k for k in range(4) if k not in within]
        # as three edges from a corner inside to one outside; two corners on either side give a quadrangle
        triangles = [[(a, c) for a in within for c in without]]
        if len(within) == 2:
            (a, b), (c, d) = within, without
            triangles = [[(a, c), (a, d), (b, d)], [(a, c), (b, d), (b, c)]]
        for triangle in triangles:
            edges.append(rows[:, np.array(triangle)])
            # from the mean of the corners inside to that of the others; in a repeated end plane, out of the grid
            outward.append(local[:, without].mean(axis=1) - local[:, within].mean(axis=1))
    pairs = np.concatenate(edges)  # (m, 3, 2), inside first
    unique, index = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    corner = index.reshape(-1, 3)
    low, high = inner[unique[:, 1]], inner[unique[:, 0]]
    # at a repeated end plane both points coincide, and any share is right
    share = np.where(np.isfinite(low), high / (high - np.where(np.isfinite(low), low, -1.0)), 0.0)[:, None]
    place = points.reshape(-1, 3)
    vertices = place[unique[:, 0]] * (1 - share) + place[unique[:, 1]] * share
    of_vertices = colours[unique[:, 0]] * (1 - share[:, 0]) + colours[unique[:, 1]] * share[:, 0]
    # normals point outward
    a, b, c = (vertices[corner[:, k]] for k in range(3))
    # scale the axes alike: the sign of a covector times a vector does not depend on scale, but its accuracy does
    span = np.ptp(vertices, axis=0)
    span[span == 0] = 1.0
    backward = (np.cross((b - a) / span, (c - a) / span) * np.concatenate(outward)).sum(axis=1) < 0
    corner[backward] = corner[backward][:, [0, 2, 1]]
    return Isosurface(vertices, corner, of_vertices)


def surface_of(workspace: Workspace) -> Isosurface | None:
    """The surface with clearance 0 [m, rad], with the logarithm of the condition number; None if the volume is empty.

    Grid cells that the surface crosses, and their neighbours, are divided and evaluated again; all others keep their
    sign.
    """
    coarse = clearance(workspace.platform, workspace.qualities, workspace.coordinates()[..., 4])
    # poses exactly at a limit are reachable, but enclose no volume
    if not (coarse > 0).any():
        return None
    parts = [-(-_CELLS // (n - 1)) for n in workspace.shape]
    axes = [
        np.interp(np.arange((len(values) - 1) * part + 1) / part, np.arange(len(values)), values)
        for values, part in zip(workspace.swept.values(), parts, strict=True)
    ]
    near = np.ix_(*(np.rint(np.arange(len(axis)) / part).astype(int) for axis, part in zip(axes, parts, strict=True)))
    number = workspace.qualities.condition_number
    field, colour = coarse[near], number[near]
    if max(parts) > 1:
        # points in cells with corners on both sides of the surface, or next to such cells
        inside = sliding_window_view(coarse > 0, (2, 2, 2)).sum(axis=(3, 4, 5))
        cells = binary_dilation((inside > 0) & (inside < 8), structure=np.ones((3, 3, 3), dtype=bool))
        for axis, part in enumerate(parts):
            cells = np.repeat(cells, part, axis=axis)
        fine = sliding_window_view(np.pad(cells, 1), (2, 2, 2)).any(axis=(3, 4, 5))
        places = {name: axis[k] for name, axis, k in zip(workspace.swept, axes, np.nonzero(fine), strict=True)}
        places |= {name: np.full(fine.sum(), value) for name, value in workspace.fixed.items()}
        poses = np.stack([places[name] for name in COORDINATES], axis=-1)
        q = evaluate_poses(workspace.platform, poses[:, :3], poses[:, 3:])
        field[fine], colour[fine] = clearance(workspace.platform, q, poses[:, 4]), q.condition_number
    return isosurface(axes, field, np.log10(np.minimum(colour, _LARGEST_SHOWN)))
