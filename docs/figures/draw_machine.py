"""Draws docs/figures/friction.svg and springs.svg, the pictures of docs/machine.md: `make figures`."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from saving import save_svg
from scipy.integrate import solve_ivp

import gough_stewart as gs
from gough_stewart.harness.control.linear import linear_matrices
from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.report.plotting import COLOURS, files_of
from gough_stewart.model.friction import Bristles, bristle_friction, law_of_bristles
from gough_stewart.model.interface import Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

STICKS = {"leg_coulomb_friction": 100.0, "leg_static_friction": 150.0, "leg_viscous_friction": 500.0}
NAMES = {"elasto_plastic": "elasto-plastic", "lugre": "LuGre"}
# The experiment of the pull: mass [kg], spring [N/m], speed of its end [m/s], time [s].
MASS, SPRING, SPEED, SECONDS = 500.0, 2e4, 0.002, 12.0
STIFFNESSES = np.geomspace(1e6, 1e9, 7)
FORCE, FORCE_FREQUENCY, RUN = 2000.0, 2.0, 0.25  # of the runs that converge [N, Hz, s]
SHOWN = 2e7  # of the response [N/m]


def machine(friction: str = "smooth", **other: float) -> Platform:
    """`motion_base` with the friction of these pictures."""
    return replace(gs.load_preset("motion_base"), leg_friction_model=friction, **(STICKS | other))


def law_of(friction: str) -> Bristles:
    """The law of one leg."""
    law = law_of_bristles(Variant.of(platform := machine(friction)), platform)
    return Bristles(*(np.ravel(np.broadcast_to(part, 6))[:1] for part in law))


def driven(law: Bristles, motion: object, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Friction [N] of a bristle at velocities `motion(t)` [m/s]: times (n,), and the path [m]."""

    def rates(at: float, x: FloatArray) -> list[float]:
        v = np.atleast_1d(motion(at))  # type: ignore[operator]
        return [float(v[0]), float(bristle_friction(law, v, x[1:])[1][0])]

    found = solve_ivp(rates, (t[0], t[-1]), [0.0, 0.0], "Radau", t, rtol=1e-7, atol=1e-12, max_step=t[-1] / 500).y
    return bristle_friction(law, motion(t), found[1])[0], found[0]  # type: ignore[operator]


def over_velocity(axes: Axes) -> None:
    """The Stribeck curve, and the hysteresis of velocities that vary about it."""
    law = law_of("lugre")
    v = np.linspace(2e-5, 5e-3, 400)
    level = law.coulomb + (law.static - law.coulomb) * np.exp(-((v / law.stribeck_velocity) ** 2))
    for k, frequency in enumerate((0.5, 2.0, 5.0)):
        period = 1 / frequency
        t = np.linspace(0, 3 * period, 1501)
        force, _ = driven(law, lambda s, f=frequency: 2.0e-3 - 1.9e-3 * np.cos(2 * np.pi * f * s), t)
        last = t >= 2 * period
        speed = 2.0e-3 - 1.9e-3 * np.cos(2 * np.pi * frequency * t)
        axes.plot(1e3 * speed[last], force[last], color=COLOURS[k + 1], label=f"{frequency:g} Hz")
    axes.plot(1e3 * v, level + law.viscous * v, "k--", linewidth=1.2, label="steady")
    axes.set_title("friction against velocity, LuGre")
    axes.set_xlabel("velocity [mm/s]")
    axes.set_ylabel("friction [N]")
    axes.legend(fontsize=8)


def presliding(axes: Axes) -> None:
    """Nested loops below and up to breakaway; the friction of the elastic range has no loop."""
    for k, friction in enumerate(NAMES):
        law = law_of(friction)
        t = np.linspace(0, 14, 2801)

        # slow triangles of growing size [m/s], so that damping is negligible
        def motion(s: FloatArray | float) -> FloatArray:
            size = np.select([np.asarray(s) < 4, np.asarray(s) < 8], [4e-6, 8e-6], 16e-6)
            phase = np.mod(np.asarray(s), 4.0)
            return size * np.where((phase < 1) | (phase >= 3), 1.0, -1.0)

        force, path = driven(law, motion, t)
        axes.plot(1e6 * path, force, color=COLOURS[k], linestyle=("-", "--")[k], label=NAMES[friction])
    axes.set_title("presliding")
    axes.set_xlabel("path [µm]")
    axes.set_ylabel("friction [N]")
    axes.legend(loc="upper left", fontsize=8)


def stick_slip(axes: Axes) -> None:
    """A mass that a slow spring pulls."""
    t = np.linspace(0, SECONDS, 2401)
    for k, friction in enumerate(NAMES):
        law = law_of(friction)

        def rates(at: float, x: FloatArray, law: Bristles = law) -> list[float]:
            v, z = x[1:2], x[2:3]
            friction, bristle_rate = bristle_friction(law, v, z)
            return [x[1], (SPRING * (SPEED * at - x[0]) - friction[0]) / MASS, float(bristle_rate[0])]

        found = solve_ivp(rates, (0, SECONDS), [0.0] * 3, "Radau", t, rtol=1e-8, atol=[1e-12, 1e-12, 1e-14]).y[0]
        axes.plot(t, 1e3 * found, color=COLOURS[k], linestyle=("-", "--")[k], label=NAMES[friction])
    axes.plot(t, 1e3 * SPEED * t, color="k", linewidth=0.8, label="end of the spring")
    axes.set_title(f"{MASS:g} kg on a spring of {SPRING:g} N/m")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("position [mm]")
    axes.legend(loc="upper left", fontsize=8)


def path_of(platform: Platform) -> FloatArray:
    """Heights [m] under forces that vary, in steps of 5 ms."""
    model = gs.SteppingModel(platform, tolerance=1e-10)
    held, found = np.asarray(model.get("actuator_force")), []
    for k in range(round(RUN / 5e-3)):
        wave = FORCE * np.sin(2 * np.pi * FORCE_FREQUENCY * 5e-3 * k) * np.array([1, 0.4, -0.3, 0.8, 0.2, -0.6])
        model.set("actuator_force", held + wave)
        model.do_step(model.time, 5e-3)
        found.append(np.asarray(model.get("position")).copy())
    return np.array(found)


def convergence(axes: Axes) -> None:
    """Distance from the rigid plant: it falls with the stiffness to the power 1."""
    rigid = path_of(machine(leg_coulomb_friction=0.0, leg_static_friction=0.0))
    gaps = [
        np.abs(path_of(machine(leg_coulomb_friction=0.0, leg_static_friction=0.0, leg_stiffness=k)) - rigid).max()
        for k in STIFFNESSES
    ]
    axes.loglog(STIFFNESSES, gaps, "o-", color=COLOURS[0])
    axes.loglog(STIFFNESSES, gaps[-1] * STIFFNESSES[-1] / STIFFNESSES, "k--", linewidth=1, label="slope −1")
    axes.set_title("distance from the rigid plant")
    axes.set_xlabel("stiffness of a leg [N/m]")
    axes.set_ylabel("largest difference of position [m]")
    axes.legend(fontsize=8)


def answers(axes: Axes) -> None:
    """From the force of leg 1 to its length, and to the position of its motor."""
    omega = 2 * np.pi * np.geomspace(3, 300, 1200)
    made = (
        ("rigid legs", machine(), "leg_length", "k"),
        ("2·10⁷ N/m, at the leg", machine(leg_stiffness=SHOWN), "leg_length", COLOURS[0]),
        ("2·10⁷ N/m, at the motor", machine(leg_stiffness=SHOWN), "motor_position", COLOURS[1]),
    )
    for label, platform, output, colour in made:
        found = linear_matrices(platform, outputs=(output,))
        gain = [gain_at(found, w) for w in omega]
        axes.loglog(omega / (2 * np.pi), gain, color=colour, label=label, linewidth=1.3)
    for mode in gs.modes(gs.linearise(machine(leg_stiffness=SHOWN))):
        if mode.eigenvalue.imag:
            axes.axvline(mode.frequency, color="0.6", linewidth=0.6, zorder=0)
    axes.set_title("answer of leg 1 to its force, and the modes")
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("position over force [m/N]")
    axes.legend(fontsize=8)


def gain_at(system: StateSpace, w: float) -> float:
    """|(C (iω − A)⁻¹ B + D)₁₁|."""
    x = np.linalg.solve(1j * w * np.eye(len(system.A)) - system.A, system.B[:, :1])
    return float(abs((system.C[:1] @ x + system.D[:1, :1])[0, 0]))


def main() -> None:
    """Write the pictures beside this file."""

    def friction(figure: Figure) -> None:
        first, second, third = figure.subplots(1, 3)
        over_velocity(first)
        presliding(second)
        stick_slip(third)

    def springs(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        answers(left)
        convergence(right)

    save_svg("friction.svg", files_of(friction, 10.5, 3.4, ("svg",))["svg"])
    save_svg("springs.svg", files_of(springs, 9.0, 3.4, ("svg",))["svg"])


if __name__ == "__main__":
    main()
