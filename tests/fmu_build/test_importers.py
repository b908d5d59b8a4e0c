"""The unit in importers as they come: FMPy's whole simulation, CasADi's DaeBuilder."""

from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from fmpy import simulate_fmu
from numpy.typing import NDArray

from gough_stewart.model import interface, traced
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_jacobian
from tests.fmu_build.test_trajectories import simulate
from tests.support.fmu_plants import DISCARD, ERROR, OK, Fmu, plant, refused
from tests.support.uneven import INPUTS, STATE, UNEVEN

TUNABLE = [v.name for v in interface.PLATFORM_PARAMETERS if v.variability == "tunable"]


def poses(result: Any) -> NDArray[np.float64]:
    """Position and orientation (n, 6) of a result of FMPy."""
    names = [n for n in result.dtype.names if n.startswith(("position", "orientation"))]
    return np.concatenate([np.asarray(result[n]).reshape(len(result), -1) for n in names], axis=1)


@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_a_unit_with_default_settings_stands_still_to_its_default_stop_time(fmu: Fmu, fmi_type: str) -> None:
    """Expected: the home pose, for a second; six different forces hold an uneven platform in gravity aslant."""
    result = simulate_fmu(str(fmu.path), fmi_type=fmi_type)
    assert result["time"][-1] == 1.0
    home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
    assert np.abs(poses(result) - home).max() < 1e-11


def test_fmpy_ends_model_exchange_at_a_singular_pose_with_what_was_reached(fmu: Fmu) -> None:
    """Expected: the paper's own case passes its singular pose at 1.136 s, as the kernel under DOP853 shows."""
    case = replace(paper_case(), duration=1.5)
    messages: list[str] = []
    result = simulate(
        fmu,
        case,
        "ModelExchange",
        debug_logging=True,
        logger=lambda *arguments: messages.append(arguments[-1].decode()),
    )
    assert 1.136 - 2 * 0.015 < result["time"][-1] < 1.136 + 0.015
    jacobians = leg_jacobian(case.platform, poses(result)[:, :3], poses(result)[:, 3:])
    signs = np.sign(np.linalg.det(jacobians))
    assert (signs == signs[0]).all()
    (message,) = messages
    assert "must end" in message
    assert "singular" in message


# --- logging -------------------------------------------------------------------------------------------------------


def test_errors_are_logged_when_logging_is_off_and_discards_are_not(fmu: Fmu) -> None:
    with plant(fmu, logging=False) as p:
        assert refused(p.set, "platform_mass", -1.0) == DISCARD
        assert p.messages == []
        assert refused(p.fmu.terminate) == ERROR
        p.fmu.setDebugLogging(True, ["logStatusDiscard"])
        assert refused(p.fmu.terminate) == ERROR
        assert [m.category for m in p.messages] == ["logStatusError"] * 2


# --- Discard in FMI 2.0 --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("co_simulation", [True, False])
def test_results_that_are_not_finite_are_discarded_only_where_fmi_2_knows_that(fmu: Fmu, co_simulation: bool) -> None:
    """Expected: FMI 2.0, 2.1.3, lists fmi2GetReal for Model Exchange, and directional derivatives for nobody."""
    tiny: dict[str, Any] = {
        "platform_mass": 1e-300,
        "platform_inertia": 1e-300 * np.eye(3),
        "platform_com": [0.0] * 3,
        "leg_armature": 0.0,
    }
    tiny |= {f"leg_{part}_{of}": 1e-300 for part in ("lower", "upper") for of in ("mass", "inertia")}
    with plant(fmu, co_simulation) as p:
        p.start(tiny)
        p.set("actuator_force", [1e29, -1e29, 1e29, 1e29, 1e29, 1e29])
        get, sensitivity = refused(p.get, "acceleration"), refused(p.directional, "acceleration", "position", [1, 2, 3])
        assert get == (ERROR if p.is_fmi2 and co_simulation else DISCARD)
        assert sensitivity == (ERROR if p.is_fmi2 else DISCARD)
        assert "not finite" in p.messages[-1].text
        p.set("actuator_force", [0.0] * 6)
        assert refused(p.get, "position") == OK


# --- CasADi --------------------------------------------------------------------------------------------------------


def test_casadis_dae_builder_has_our_equations_and_jacobians_by_x_u_and_p(fmu2: Fmu) -> None:
    """Expected: CasADi's own differentiation of the kernel, in a lively state of an uneven platform."""
    dae = casadi.DaeBuilder("plant", str(fmu2.folder))
    parts, of = ("x", "u", "p"), ("ode", "y")
    values = {**STATE._asdict(), **INPUTS._asdict(), **{name: 1.1 * getattr(UNEVEN, name) for name in TUNABLE}}
    elements = {
        scalar: value
        for name, whole in values.items()
        for scalar, value in zip(interface.BY_NAME[name].scalar_names, np.ravel(whole), strict=True)
    }
    point = [np.array([elements[scalar] for scalar in getattr(dae, part)()]) for part in parts]
    found = dae.create("found", list(parts), list(of))(*point)
    jacobians = dae.create("jacobians", list(parts), [f"jac_{f}_{z}" for f in of for z in parts])(*point)

    platform = replace(UNEVEN, **{name: values[name] for name in TUNABLE})
    x, u, p = STATE.to_vector(), INPUTS.to_vector(), parameter_vector(platform)
    outputs = interface.size_of(interface.OUTPUTS)
    assert np.array(found[0]).ravel() == pytest.approx(Kernel().derivatives(x, u, p), rel=1e-11, abs=1e-11)
    assert np.array(found[1]).ravel() == pytest.approx(Kernel().outputs(x, u, p)[:outputs], rel=1e-11, abs=1e-11)
    sx, su, sp = casadi.SX.sym("x", 12), casadi.SX.sym("u", 12), casadi.SX.sym("p", len(p))
    names = [scalar for v in interface.PLATFORM_PARAMETERS for scalar in v.scalar_names]
    tuned = [names.index(scalar) for scalar in dae.p()]
    functions = (traced.derivatives_function()(sx, su, sp), traced.outputs_function()(sx, su, sp)[:outputs])
    own = casadi.Function("own", [sx, su, sp], [casadi.jacobian(f, z) for f in functions for z in (sx, su, sp[tuned])])(
        x, u, p
    )
    worst = 0.0
    for theirs, ours in zip(jacobians, own, strict=True):
        assert theirs.shape == ours.shape
        worst = max(worst, np.abs(np.array(theirs) - np.array(ours)).max())
    assert np.abs(np.array(own[2])).max() > 1
    assert worst < 1e-9


def test_casadi_integrates_the_unit(fmu2: Fmu) -> None:
    """Expected: the unit's own Co-Simulation."""
    dae = casadi.DaeBuilder("plant", str(fmu2.folder))
    steps, step = 100, 1e-3
    f = dae.create("f", ["x", "u"], ["ode"])
    u = np.array(dae.start(dae.u()))
    u[:6] *= 1.05
    x = np.array(dae.start(dae.x()))
    for _ in range(steps):  # classical Runge–Kutta
        k1 = f(x, u)
        k2 = f(x + step / 2 * k1, u)
        k3 = f(x + step / 2 * k2, u)
        k4 = f(x + step * k3, u)
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    with plant(fmu2) as p:
        p.start({"actuator_force": u[:6]}, tolerance=1e-11)
        p.step(0.0, steps * step)
        assert np.array(x).ravel()[:6] == pytest.approx(p.pose, abs=1e-10)
