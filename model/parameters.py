"""What the equations need to know of a platform: the parameters of the interface, as arrays or symbols."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from gough_stewart.model.vectors import Array, Scalars


class Parameters(Protocol):
    """Anything that carries the physical parameters: a `Platform`, a batch of platforms, CasADi symbols.

    Leading axes `...` broadcast against those of the state; names, units and meaning are in
    `gough_stewart.model.interface`.
    """

    @property
    def base_points(self) -> Array: ...  # (..., 6, 3) m, world
    @property
    def platform_points(self) -> Array: ...  # (..., 6, 3) m, platform axes
    @property
    def platform_mass(self) -> Scalars: ...
    @property
    def platform_com(self) -> Array: ...  # (..., 3) m, platform axes
    @property
    def platform_inertia(self) -> Array: ...  # (..., 3, 3) kg m2, platform axes, about the centre of mass
    @property
    def leg_lower_mass(self) -> Scalars: ...
    @property
    def leg_upper_mass(self) -> Scalars: ...
    @property
    def leg_lower_com(self) -> Scalars: ...  # m, from B_i along u_i
    @property
    def leg_upper_com(self) -> Scalars: ...  # m, from P_i back toward B_i
    @property
    def leg_lower_inertia(self) -> Scalars: ...  # kg m2, transverse, about the part's own centre of mass
    @property
    def leg_upper_inertia(self) -> Scalars: ...
    @property
    def leg_viscous_friction(self) -> Scalars: ...
    @property
    def leg_coulomb_friction(self) -> Scalars: ...
    @property
    def leg_friction_velocity(self) -> Scalars: ...
    @property
    def gravity(self) -> Array: ...  # (..., 3) m/s2, world


@dataclass(frozen=True)
class ParameterArrays:
    """`Parameters` held as they are, unchecked: batches for NumPy, symbols for CasADi."""

    base_points: Array
    platform_points: Array
    platform_mass: Scalars
    platform_com: Array
    platform_inertia: Array
    leg_lower_mass: Scalars
    leg_upper_mass: Scalars
    leg_lower_com: Scalars
    leg_upper_com: Scalars
    leg_lower_inertia: Scalars
    leg_upper_inertia: Scalars
    leg_viscous_friction: Scalars
    leg_coulomb_friction: Scalars
    leg_friction_velocity: Scalars
    gravity: Array


def stack(parameters: Sequence[Parameters]) -> ParameterArrays:
    """Many platforms as one batch: every parameter gets a leading axis of their number."""
    names = [f.name for f in fields(ParameterArrays)]
    return ParameterArrays(**{name: np.stack([np.asarray(getattr(p, name)) for p in parameters]) for name in names})
