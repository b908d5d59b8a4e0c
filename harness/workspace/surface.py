"""The surface of a reachable volume, on a finer grid than the swept one."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gough_stewart.harness.workspace.display import clearance, clearance_of
from gough_stewart.harness.workspace.isosurface import Surface, isosurface
from gough_stewart.harness.workspace.maps import LARGEST_SHOWN
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import evaluate_poses
from gough_stewart.model.workspace_grid import COORDINATES, Workspace

# Least number of cells along each coordinate; with fewer, edges where two limits meet look ragged.
_CELLS = 60


def surface_of(workspace: Workspace) -> Surface | None:
    """The surface with clearance 0 [m, rad], with the logarithm of the condition number; None if the volume is empty.

    Grid cells that the surface crosses, and their neighbours, are divided and evaluated again; all others keep their
    sign.
    """
    coarse = clearance(workspace)
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
        fine = _passed(coarse > 0, parts)
        field[fine], colour[fine] = _evaluated(workspace, axes, fine)
    return isosurface(axes, field, np.log10(np.minimum(colour, LARGEST_SHOWN)))


def _passed(inside: NDArray[np.bool_], parts: list[int]) -> NDArray[np.bool_]:
    """Points of the fine grid in cells with corners on both sides of the surface, or next to such cells."""
    cells = np.zeros([n - 1 for n in inside.shape], dtype=int)
    for corner in np.ndindex(2, 2, 2):
        cells += inside[tuple(slice(c, c + n) for c, n in zip(corner, cells.shape, strict=True))]
    passed = binary_dilation((cells > 0) & (cells < 8), structure=np.ones((3, 3, 3), dtype=bool))
    fine = np.zeros([n * part + 1 for n, part in zip(passed.shape, parts, strict=True)], dtype=bool)
    inner = passed
    for axis, part in enumerate(parts):
        inner = np.repeat(inner, part, axis=axis)
    for corner in np.ndindex(2, 2, 2):
        fine[tuple(slice(c, c + n) for c, n in zip(corner, inner.shape, strict=True))] |= inner
    return fine


def _evaluated(workspace: Workspace, axes: list[FloatArray], there: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Clearance and condition number at points of a grid."""
    places = {name: axis[k] for name, axis, k in zip(workspace.swept, axes, np.nonzero(there), strict=True)}
    places |= {name: np.full(there.sum(), value) for name, value in workspace.fixed.items()}
    poses = np.stack([places[name] for name in COORDINATES], axis=-1)
    found = evaluate_poses(workspace.platform, poses[:, :3], poses[:, 3:])
    return clearance_of(workspace.platform, found, poses[:, 4]), found.condition_number
