"""What a Platform accepts, refuses, promises and shows, alone and among many."""

import inspect
import pickle
import re
from copy import deepcopy
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest
from lxml import html

from gough_stewart import GoughStewartError, Platform, SteppingModel, leg_geometry, load_preset
from gough_stewart.model.parameters import PHYSICAL
from gough_stewart.model.platform import platforms_with
from tests.support.lagrangian import FloatArray
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN


def refused(platform: Platform, message: str, **change: Any) -> str:
    """The field of the error of a change, which is the same by `replace` and, for numbers, by `with_parameters`."""
    with pytest.raises(GoughStewartError, match=message) as caught:
        replace(platform, **change)
    if not {"name", "source"} & {*change}:
        with pytest.raises(GoughStewartError, match=f"^{re.escape(str(caught.value))}$"):
            platform.with_parameters(change)
    return str(vars(caught.value)["field"])


def says(text: str, **change: Any) -> None:
    """The change of the uneven platform is refused in exactly these words."""
    assert refused(UNEVEN, f"^{re.escape(text)}$", **change) == text.partition(": ")[0]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("base_points", np.zeros((5, 3)), r"has shape \(5, 3\); expected numbers of shape \(6, 3\)"),
        ("platform_com", 0.1, r"has shape \(\); expected numbers of shape \(3,\)"),
        ("platform_points", [[1, 2], [3]], "expected numbers of shape"),
        ("gravity", [0, 0, np.nan], "expected finite numbers"),
        ("leg_lower_mass", [1.0, 2.0], r"has shape \(2,\); expected one number, or six, one per leg"),
        ("platform_mass", True, "expected one number"),
        ("platform_mass", "10", "expected one number"),
        ("platform_mass", np.inf, "expected finite numbers"),
        ("home_position", [0, 0, 0.0], "leg Jacobian is singular at the home pose"),
        ("base_points", np.append(np.arange(17.0), -1e200).reshape(6, 3), "expected numbers below 1e"),
    ],
)
def test_an_impossible_parameter_is_refused_by_name(paper: Platform, field: str, value: Any, message: str) -> None:
    assert field in refused(paper, message, **{field: value})


def test_published_preset_follows_the_formulas_of_the_appendix(paper: Platform) -> None:
    """Expected: the appendix, + first: azimuths 2(i−1)π/3 ± π/12, and the platform joint 30° away."""
    base, top = [], []
    for i in (1, 2, 3):
        for sign in (1, -1):
            azimuth = 2 * (i - 1) * np.pi / 3 + sign * np.pi / 12
            base.append([2 * np.sin(azimuth), 2 * np.cos(azimuth), 0])
            near = azimuth + sign * np.pi / 6
            top.append([np.sin(near), np.cos(near), 0])
    assert np.allclose(paper.base_points, base, atol=1e-15)
    assert np.allclose(paper.platform_points, top, atol=1e-15)


def test_motion_base_masses_are_those_of_the_sources_cylinders() -> None:
    """Expected: cylinder formulas with the source's density and dimensions."""
    platform, rho = load_preset("motion_base"), 76e3 / 9.81
    L = leg_geometry(platform, platform.home_position, platform.home_orientation).length[0]
    assert platform.platform_mass == pytest.approx(rho * np.pi * 0.05, abs=0.05)
    assert platform.leg_lower_mass == pytest.approx(rho * np.pi * (0.05**2 - 0.03**2) * 0.75 * L, abs=0.05)
    assert platform.leg_upper_mass == pytest.approx(rho * np.pi * 0.03**2 * 0.75 * L, abs=0.05)
    assert platform.leg_lower_com == pytest.approx(0.375 * L, abs=0.001)


def test_errors_name_joint_element_and_number_in_whole_sentences() -> None:
    """Expected: the elements, the moments by hand; legs and elements that are not the first."""
    refused(UNEVEN, "the leg Jacobian is singular", base_points=np.tile([1.0, 2, 0], (6, 1)), **FREE)
    says(
        "platform_inertia: is not positive definite: principal moments (-1, 2, 2.5) kg m²; expected all > 0",
        platform_inertia=np.diag([2.0, -1.0, 2.5]),
    )
    for name, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        length = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length.min()
        says(
            f"{name}: is 3.1 m from the {end} joint; expected between 0 and the shortest leg of the home pose, "
            f"{length:g} m",
            **{name: 3.1},
        )
    high = "leg_length_min: is 3.9 m; expected below leg_length_max = 3.9 m"
    says(high, leg_length_min=[2.3, 2.3, 3.9, 2.3, 2.3, 2.3])
    home = f"leg_length_max: is 2.8 m, but a home leg is {HOME_LEGS[4]:g} m long"
    says(home, leg_length_max=[4.0, 4.0, 4.0, 4.0, 2.8, 4.0])
    far = f"is 9 m from the base joint; expected between 0 and leg 4 in the home pose, {HOME_LEGS[3]:g} m"
    says(f"leg_lower_com: {far}", leg_lower_com=[0.4, 0.4, 0.4, 9.0, 0.4, 0.4])
    other = np.array([[4.6, 0.35, -0.28], [0.35, 5.7, 0.41], [-0.2, 0.41, 8.1]])
    refused(UNEVEN, r"not symmetric: \[1,3\] = -0\.28 but \[3,1\] = -0\.2 kg m²; set both", platform_inertia=other)
    met = UNEVEN.base_points[2] - UNEVEN.platform_points[2]
    text = "home_position: base joint and platform joint 3 coincide in the home pose; raise home_position"
    says(text, home_position=met, home_orientation=np.zeros(3), **FREE)
    alike = {name: getattr(UNEVEN, name)[[0, 1, 2, 3, 1, 5]] for name in ("base_points", "platform_points")}
    places = re.escape("(-0.61, 1.88, -0.03) m and (-0.69, 0.75, 0.03) m; expected at most one")
    refused(UNEVEN, f"legs 2 and 5 share both joints, at {places}", **alike)
    refused(UNEVEN, r"is \[9\.0, 0\.0, .*; expected six values > 0, or 0", leg_static_friction=[9, 0, 9, 9, 9, 9])
    says("actuator_power_max: is 0 W; expected > 0, or leave it out: maximum actuator power", actuator_power_max=0.0)
    says("source: is 3; expected a text", source=3)
    says("name: is None; expected a text", name=None)


ELASTIC = replace(UNEVEN, leg_stiffness=3.1e6, leg_damping=95.0, leg_armature=4.7)
STICKING = replace(ELASTIC, leg_friction_model="elasto_plastic", leg_coulomb_friction=100.0, leg_static_friction=150.0)


@pytest.mark.parametrize(
    ("platform", "change", "message"),
    [
        (ELASTIC, {"platform_mass": 1e9}, "leg_stiffness: is .* would bounce"),
        (ELASTIC, {"leg_upper_mass": 1e9}, "leg_stiffness: is .* would bounce"),
        (ELASTIC, {"leg_stiffness": [3e6, 3e6, 3e6, 3e6, 3e6, 1.0]},
         r"leg_stiffness: is 1 N/m in leg 6: .* would bounce at about 0\.09 Hz; expected 123 N/m \(1 Hz\) or more"),
        (ELASTIC, {"leg_armature": [4.0, 4.0, 4.0, 0.0, 4.0, 4.0]}, "leg_armature: is 0 kg in leg 4; .* needs a motor"),
        (ELASTIC, {"leg_stiffness": 0.0}, "leg_damping: .* but legs are rigid"),
        (UNEVEN, {"leg_damping": 95.0}, "leg_damping: is 95 N s/m, but legs are rigid"),
        (STICKING, {"leg_coulomb_friction": 200.0}, "leg_static_friction: is 150 N, below"),
        (STICKING, {"leg_coulomb_friction_factor": [1, 1, 1, 0, 1, 1]}, "leg_coulomb_friction: is 0 N in a leg"),
        (STICKING, {"leg_static_friction": [140.0, 70.0, 149.0, 90.0, 130.0, 50.0]},
         "leg_static_friction: is 149 N, below leg_coulomb_friction = 150 N in leg 3;"),
        (STICKING, {"leg_bristle_stiffness": [1e6, 1e6, 1e5, 1e6, 1e6, 1e6]},
         r"is 100000 N/m: .* over 0\.00225 m before they slide in leg 3; .* 0\.001 m, that is 225000 N/m or more"),
        (STICKING, {"leg_breakaway_share": [0.5, 0.5, 0.5, 0.5, 0.995, 0.5]},
         r"leg_breakaway_share: is 0\.995 in leg 5; expected at most 0\.99, or"),
        (UNEVEN, {"leg_friction_model": "lugre", "leg_coulomb_friction": 0.0}, "needs > 0 in each"),
    ],
    ids=lambda value: "" if isinstance(value, Platform) else str(value)[:30],
)  # fmt: skip
def test_a_condition_on_several_parameters_is_checked_whichever_changes(
    platform: Platform, change: dict[str, Any], message: str
) -> None:
    """Expected: refused by a change of one of them alone, as by a platform made anew."""
    refused(platform, message, **change)


def skewed(share: float) -> FloatArray:
    """The inertia with one element changed by a share of its largest, 8.1."""
    J = UNEVEN.platform_inertia.copy()
    J[0, 2] += share * 8.1
    return J


HOME_LEGS = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
FAR = 10 * float(np.sqrt((UNEVEN.platform_points**2).sum(axis=1)).max()) * np.array([0.6, 0.0, 0.8])
STEEP = np.pi / 2 - 1e-3
FREE: dict[str, Any] = {"leg_length_min": None, "leg_length_max": None}
TOO_LARGE = r"expected numbers below 1e\+30 in SI units"
# Just accepted, just refused, and the words.
BOUNDS: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"platform_inertia": skewed(0.9e-9)}, {"platform_inertia": skewed(1.1e-9)}, "not symmetric"),
    ({"platform_inertia": np.diag([2, 1, 3 + 2.7e-9])}, {"platform_inertia": np.diag([2, 1, 3 + 3.3e-9])}, "triangle"),
    ({"platform_com": (1 - 1e-9) * FAR}, {"platform_com": (1 + 1e-9) * FAR}, "ten times"),
    ({"joint_angle_max": np.pi}, {"joint_angle_max": np.nextafter(np.pi, 4)}, "at most π"),
    *(
        ({f"leg_length_{end}": length}, {f"leg_length_{end}": np.nextafter(length, beyond)}, "but a home leg is")
        for end, length, beyond in (("min", float(HOME_LEGS.min()), 9), ("max", float(HOME_LEGS.max()), 0))
    ),
    ({"platform_mass": 1e30}, {"platform_mass": 1.1e30}, f"^platform_mass: is 1.1e\\+30; {TOO_LARGE}"),
    ({"actuator_force_max": 1e30}, {"actuator_force_max": 1.1e30}, f"^actuator_force_max: is 1.1e\\+30; {TOO_LARGE}"),
    *(({"gravity": [0, s * 1e30, 0]}, {"gravity": [0, s * 1.1e30, 0]}, f"^gravity: is .*{TOO_LARGE}") for s in (1, -1)),
    *(
        (
            {"home_orientation": [0.0, s * (STEEP - 1e-9), 0.0], **FREE},
            {"home_orientation": [0.0, s * (STEEP + 1e-9), 0.0], **FREE},
            f"has pitch {s * STEEP:g} rad",
        )
        for s in (1, -1)
    ),
]


@pytest.mark.parametrize(("inside", "outside", "text"), BOUNDS)
def test_bounds_hold_from_both_sides(inside: dict[str, Any], outside: dict[str, Any], text: str) -> None:
    """Expected: 1e-9 of an inertia, ten radii, π, 1e30, home legs, 1e-3 of 90°."""
    for name, value in inside.items():
        assert np.array_equal(getattr(replace(UNEVEN, **inside), name), value)
    refused(UNEVEN, text, **outside)


def test_a_change_may_contradict_what_stays() -> None:
    """Expected: legs of the new home pose beyond the stroke, and shorter than a part's centre of mass."""
    home = UNEVEN.home_position
    refused(UNEVEN, "^leg_length_max: is 3.9 m, but a home leg is", home_position=home * [1, 1, 1.4])
    refused(UNEVEN, "^leg_length_max: is 3.9 m, but a home leg is", base_points=UNEVEN.base_points - [0, 0, 0.9])
    refused(UNEVEN, "^leg_lower_com: is 2 m", home_position=home * [1, 1, 0.5], leg_lower_com=2.0, **FREE)


# With all that an ideal plant does not have, so that no number is 0.
REAL = real_platform("lugre", springs=True)


@pytest.mark.parametrize("name", [*UNEVEN.as_dict(), "leg_velocity_max"])
def test_equal_platforms_are_equal_in_every_field(name: str) -> None:
    """Expected: a change of the last number of any field makes another platform; the same value makes the same."""
    value: Any = getattr(REAL, name)
    assert replace(REAL, **{name: value}) == REAL
    assert hash(replace(REAL, **{name: value})) == hash(REAL)
    other: Any = f"{value}x" if isinstance(value, str) else 1.3 if value is None else np.array(value)
    if isinstance(other, np.ndarray):
        other[(-1,) * other.ndim] *= 1 + 1e-12
        other = np.full(6, 2.0) if name == "leg_static_friction_factor" else other
    if name == "leg_friction_model":
        other = "elasto_plastic"
    changed = replace(REAL, **{name: other})
    assert changed != REAL
    if name not in ("name", "source"):
        found = REAL.with_parameters({name: other})
        assert found == changed
        assert not isinstance(value, np.ndarray) or not getattr(found, name).flags.writeable


def test_the_friction_of_screws_is_that_of_their_preload() -> None:
    """Expected: JIS B 1192 with a third of the largest force and the screw of motion_base; all else as there."""
    screws, base = load_preset("motion_base_screws"), load_preset("motion_base")
    assert screws.actuator_force_max is not None
    preload, lead, diameter = screws.actuator_force_max / 3, 0.025, 0.04
    torque = 0.05 * (lead / (np.pi * diameter)) ** -0.5 * preload * lead / (2 * np.pi)
    assert screws.leg_coulomb_friction == pytest.approx(2 * np.pi * torque / lead, rel=0.01)
    assert screws.leg_static_friction / screws.leg_bristle_stiffness == pytest.approx(20e-6)
    friction = ("friction_model", "coulomb_friction", "static_friction", "stribeck_velocity", "bristle_stiffness")
    own = ("name", "source", *(f"leg_{each}" for each in friction))
    assert replace(screws, **{name: getattr(base, name) for name in own}) == base


def test_a_platform_and_its_copies_are_read_only_and_share_no_memory_with_what_they_were_made_from() -> None:
    points = UNEVEN.base_points.copy()
    platform = replace(UNEVEN, base_points=points)
    points[0, 0] = 99
    for copied in (platform, deepcopy(platform), pickle.loads(pickle.dumps(platform))):
        assert copied == UNEVEN
        with pytest.raises(FrozenInstanceError):
            copied.platform_mass = 3.0  # type: ignore[misc]
        for array in (copied.base_points, copied.gravity):
            with pytest.raises(ValueError, match="read-only"):
                array[-1] = 1.0


# Between the shortest and the longest leg in the home pose.
MIDDLE_LEGS = np.quantile(HOME_LEGS, [0.3, 0.7]).tolist()
# Values of six members, and which of them are impossible, by the messages of a platform alone.
VARIED: dict[str, list[Any]] = {
    "platform_mass": [3.0, 4.0, 0.0, 5.0, -1.0, 2e30],
    "leg_upper_mass": [1.3, 1.3, 1.3, 1.4, 1.3, 1.3],
    "leg_coulomb_friction_factor": [np.arange(6.0), np.ones(6), -np.eye(6)[4], np.zeros(6), -np.ones(6), np.ones(6)],
    "platform_inertia": [
        np.diag(each) for each in ([2.0, 2, 3], [2.0, 2, 3.9], [2.0, 2, 4.1], [1.0, 0, 1], [3.0, 3, 3], [9.0, 8, 16])
    ],
    "platform_points": [
        UNEVEN.platform_points * scale + shift * np.eye(6, 3)
        for scale, shift in ((1, 0), (1, 1e-3), (1e-9, 0), (0.9, 0), (-1, 0), (1.1, 0))
    ],
    "base_points": [UNEVEN.base_points[[0, 1, 2, 3, 4, k]] for k in (5, 0, 5, 4, 3, 5)],
    "home_position": [UNEVEN.home_position + z * np.eye(3)[2] for z in (0.0, 0.01, -10.0, -2.0, 5.0, 0.1)],
    "home_orientation": [[0.0, pitch, 0.1] for pitch in (0.0, 0.1, 1.6, -1.57, 0.2, 3.0)],
    "leg_lower_com": [0.1, 0.2, 50.0, 3.0, 0.3, -0.1],
    "platform_com": [[0, 0, z] for z in (0.0, 0.5, 1e3, -1e3, 0.2, 9.0)],
    "leg_length_max": [30.0, 40.0, 1e-3, *MIDDLE_LEGS, 31.0],
    "leg_length_min": [0.1, 0.2, 30.0, *MIDDLE_LEGS, 0.3],
    "joint_angle_max": [0.5, 3.1, 3.2, 1.0, 4.0, 2.0],
    # of other kinds than numbers of one shape
    "platform_com ": [[0, 0, 0.1], [0, np.inf, 0], [0, 0, "1 m"], [0, 0], [0, 0, 1e3], [0, 0, 0.2]],
    "leg_length_max ": [30.0, 40.0, None, 1e-3, np.nan, 31.0],
    "leg_viscous_friction": [1.0, [1.0, 2, 3, 4, 5, 6], 2.0, 3.0, -1.0, 4.0],
    "platform_mas": [1.0] * 6,
}


@pytest.mark.parametrize("number", [1, 13])
@pytest.mark.parametrize("fixed", [FREE, {}, {"leg_coulomb_friction": [1.0, 2, 3, 4, 5, 6], "leg_armature": 3.0}])
@pytest.mark.parametrize("name", VARIED)
def test_many_platforms_are_those_that_are_made_alone(name: str, fixed: dict[str, Any], number: int) -> None:
    """Expected: the same numbers, or the same message, as `with_parameters` of each base, one after the other."""
    bases = [UNEVEN, replace(UNEVEN, platform_mass=2.5, **FREE)]
    of = np.arange(number) % 3 // 2
    parameters = [{**fixed, name.strip(): VARIED[name][k % 6]} for k in range(number)]
    found, errors = platforms_with(bases, of, parameters)
    assert len(found) == number
    parameters_of_all, turned = found.parameters, found[np.arange(number)[::-1]].parameters
    for k, each in enumerate(parameters):
        if k in errors:
            with pytest.raises(GoughStewartError) as caught:
                bases[of[k]].with_parameters(each)
            assert str(errors[k]) == str(caught.value)
            continue
        alone = bases[of[k]].with_parameters(each)
        assert found[k] == alone
        for row in PHYSICAL:
            assert np.array_equal(getattr(parameters_of_all, row.name)[k], getattr(alone, row.name)), row.name
            assert np.array_equal(getattr(turned, row.name)[number - 1 - k], getattr(alone, row.name)), row.name


def test_a_platform_and_a_model_say_what_they_are() -> None:
    """Expected: by hand from the numbers of the uneven platform, in a terminal, a notebook and in help."""
    name, masses, joints, home, limits = repr(UNEVEN).splitlines()
    assert (name, masses) == ("Platform uneven", "  masses   platform 11.5 kg, legs 6 × (2.3 + 1.2) kg")
    pose = "position (0.08, -0.05, 2.9) m, orientation (0.04, -0.07, 0.11) rad"
    assert home == f"  home     {pose}, legs {HOME_LEGS.min():.4g} to {HOME_LEGS.max():.4g} m"
    stated = "leg_length_min 2.3 m, leg_length_max 3.9 m, actuator_force_max 640 N, joint_angle_max 0.7 rad"
    assert limits == f"  limits   {stated}"
    assert "2 m about the base's middle, 1 m about the platform's" in repr(load_preset("liu2000"))
    assert " m about the base's middle, " in joints
    assert repr(SteppingModel(UNEVEN)) == f"<SteppingModel of uneven at 0 s: {pose}>"
    page = html.fragment_fromstring(replace(UNEVEN, name="<b>", source="a & b")._repr_html_())
    rows = {row[0].text_content(): [cell.text_content() for cell in row[1:]] for row in page.findall(".//tbody/tr")}
    assert page.findtext("caption") == "Platform <b> – a & b"
    assert rows["platform_inertia"][:2] == ["4.6, 0.35, -0.28; 0.35, 5.7, 0.41; -0.28, 0.41, 8.1", "kg·m²"]
    assert list(rows) == list(UNEVEN.as_dict())[2:]
    text = inspect.getdoc(Platform) or ""
    assert [name for name in UNEVEN.as_dict() if f"\n{name} : " not in text] == ["name", "source"]
