"""The surface around a region of a grid, by closed forms of volumes, areas and normals."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

from gough_stewart.harness.workspace.isosurface import Isosurface, isosurface


def enclosed(surface: Isosurface) -> float:
    """By Gauss's theorem; negative if normals point inward."""
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("n", [25, 45])
def test_the_surface_of_a_ball_is_closed_and_encloses_its_volume(n: int) -> None:
    """Expected: 4/3 π r³ less what chords cut off, in second order of the step; every edge in two triangles."""
    axes = [np.linspace(-1, 1, n), np.linspace(-1.2, 1.2, n), np.linspace(-1, 1.1, n)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    surface = isosurface(axes, 0.9 - np.sqrt(x**2 + y**2 + z**2), x)
    assert enclosed(surface) == pytest.approx(4 / 3 * np.pi * 0.9**3, rel=8 / n**2)
    edges = np.sort(np.concatenate([surface.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.allclose(surface.colour, surface.vertices[:, 0], atol=1e-12)


@pytest.mark.parametrize("normal", [(0.5, -0.8, 0.4), (-0.3, 0.2, 0.9), (0.7, 0.7, -0.1)])
def test_a_box_that_a_plane_cuts_is_exact(normal: tuple[float, float, float]) -> None:
    """Expected: SciPy's intersection of half spaces; corners in the plane or on faces; normals all outward."""
    axes = [np.array([-1.0, -0.6, 0.1, 0.9]), np.array([2.0, 2.3, 3.1, 3.3, 3.9]), np.array([-7.0, -5.5, -5.0])]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    middle = np.array([0.03, 2.9, -5.8])
    field = normal[0] * (x - middle[0]) + normal[1] * (y - middle[1]) + normal[2] * (z - middle[2])
    surface = isosurface(axes, field, 3 * x - y + 2 * z)
    low, high = np.array([(axis[0], axis[-1]) for axis in axes]).T
    faces = [*np.column_stack([-np.eye(3), low]), *np.column_stack([np.eye(3), -high])]
    faces.append(np.append(-np.array(normal), np.dot(normal, middle)))
    inside = middle + 0.05 * np.array(normal)
    hull = ConvexHull(HalfspaceIntersection(np.array(faces), inside).intersections)
    assert enclosed(surface) == pytest.approx(hull.volume, rel=1e-9)
    v = surface.vertices
    on_plane = abs((v - middle) @ normal) < 1e-9
    assert (on_plane | (abs(v - low) < 1e-12).any(axis=1) | (abs(v - high) < 1e-12).any(axis=1)).all()
    assert ((v - middle) @ normal > -1e-9).all()
    assert on_plane.sum() > 5
    a, b, c = (v[surface.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a) / 2
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(hull.area, rel=1e-9)
    # seen from inside, each triangle turns the other way
    assert ((area * (a - inside)).sum(axis=1) > -1e-12).all()
    assert surface.colour[on_plane] == pytest.approx((v @ [3, -1, 2])[on_plane])


def test_a_volume_that_goes_on_beyond_the_grid_is_cut_at_its_end() -> None:
    """Expected: 2 · 4 · 3 of the whole box, 0.7 · 4 · 3 of the part with x > 0.3."""
    axes = [np.linspace(-1, 1, 11), np.linspace(-2, 2, 13), np.linspace(-1.5, 1.5, 9)]
    x = np.meshgrid(*axes, indexing="ij")[0]
    assert enclosed(isosurface(axes, 1 + 0 * x, x)) == pytest.approx(24)
    assert enclosed(isosurface(axes, x - 0.3, x)) == pytest.approx(8.4)
