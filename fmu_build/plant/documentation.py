"""documentation/index.html of the FMU: one self-contained page, for the platform that gives the start values."""

from collections.abc import Mapping
from html import escape
from importlib.resources import files
from math import log10

import numpy as np

from gough_stewart.fmu_build.formulas import to_html
from gough_stewart.fmu_build.layout import Layout, Role
from gough_stewart.fmu_build.page import html_page, variables_table
from gough_stewart.fmu_build.plant.drawing import drawing_svg
from gough_stewart.fmu_build.plant.layout import plant_layout
from gough_stewart.fmu_build.plant.tables import MOST_FIXED_STEPS
from gough_stewart.model import interface
from gough_stewart.model.integrator import MOST_INTERNAL_STEPS
from gough_stewart.model.platform import Platform
from gough_stewart.model.step_times import DEFAULT_TOLERANCE, TOLERANCES
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import Array


def documentation_page(platform: Platform, fmi_version: str, starts: Mapping[str, Array] | None = None) -> bytes:
    """The page as well-formed, self-contained HTML.

    Parameters
    ----------
    platform
        The platform of the drawing.
    fmi_version
        "2.0" or "3.0"; determines names, example and the description of the interface.
    starts
        Start values in the table by name; by default those of the platform.

    Raises
    ------
    ValueError
        Another version.
    """
    if fmi_version not in _EXAMPLES:
        raise ValueError(f"fmi_version is {fmi_version!r}; expected '2.0' or '3.0'")
    variant = Variant.of(platform)
    layout = plant_layout(variant)
    home = interface.start_values((row.variable for row in layout.rows), platform)
    starts = home if starts is None else starts
    stands_still = all(np.array_equal(starts[name], value) for name, value in home.items())
    sections = (
        _heading(platform, fmi_version),
        _model(variant),
        _frames(platform),
        _variables(layout, starts, fmi_version, stands_still),
        _equations(),
        _behaviour(layout, variant, fmi_version),
        _failures(fmi_version),
        _example(platform, fmi_version),
        _SOURCE,
    )
    return html_page(f"Gough–Stewart platform, FMI {fmi_version}", sections)


def _heading(platform: Platform, fmi_version: str) -> str:
    source = f" ({escape(platform.source)})" if platform.source else ""
    return f"""
<h1>Gough–Stewart platform</h1>
<p>Functional mock-up unit for FMI {fmi_version}, Co-Simulation and Model Exchange. Inputs are six actuator forces;
outputs are pose, motion and leg lengths. Start values are those of the platform
<b>{escape(platform.name)}</b>{source}; parameters can be set to those of any other platform of its kind.</p>
"""


def _model(variant: Variant) -> str:
    friction = (
        """viscous, and one that sticks, of the elasto-plastic model (<code>leg_friction_model</code> = 1, Dupont and
others 2002) or LuGre (2, Canudas de Wit and others 1995), with a bristle's deflection as state of each leg.
Parameters of friction that are 0 are derived."""
        if variant.bristles
        else "viscous, and Coulomb friction smoothed by a hyperbolic tangent."
    )
    springs = """
<li>A spring with a damper between the motor's and the platform's side of each leg; friction and armature are on the
motor's side, whose position and velocity are states. <code>motor_position</code> is the leg's length without its
stretch: set it with the pose.</li>"""
    return f"""
<h2>Model</h2>
<ul>
<li>A platform and six identical legs of two rigid parts each, which slide along the leg; base joints and platform
joints can be anywhere.</li>
<li>Ideal universal joints at the base, ideal spherical joints at the platform. Legs do not spin about their axis, so
their axial inertia has no effect.</li>
<li>Rotors and screws of electric actuators, as an inertia reflected along the leg.</li>
<li>Friction between the two parts of a leg: {friction}</li>{springs if variant.springs else ""}
<li>Gravity, and an external force and torque on the platform.</li>
</ul>
<p>Not modelled: friction in the joints, {"" if variant.springs else "elasticity, "}actuator dynamics, contact. Stroke
and force limits are not enforced.</p>
"""


def _frames(platform: Platform) -> str:
    return f"""
<h2>Frames and signs</h2>
{drawing_svg(platform).decode()}
<ul>
<li>World frame X<sub>0</sub>Y<sub>0</sub>Z<sub>0</sub>: fixed at the base, Z up. The platform's own frame has its
origin at O<sub>p</sub>; platform joints, centre of mass and inertia are expressed in it.</li>
<li><code>orientation</code>: roll α, pitch β, yaw γ about the <em>fixed</em> world axes X, then Y, then Z, so that
R = R<sub>z</sub>(γ) R<sub>y</sub>(β) R<sub>x</sub>(α) maps platform to world components.</li>
<li><code>angular_velocity</code>: world components; not the rates of roll, pitch and yaw.</li>
<li>Leg i goes from base joint B<sub>i</sub> to platform joint P<sub>i</sub>, in the direction u<sub>i</sub>.
<code>actuator_force</code> &gt; 0 extends the leg.</li>
<li><code>joint_force</code>: force of leg i on the platform at P<sub>i</sub>, world components.</li>
<li>All quantities are in SI units, all angles in radians.</li>
</ul>
"""


def _variables(layout: Layout, starts: Mapping[str, Array], fmi_version: str, stands_still: bool) -> str:
    own_weight = """ The start values of the actuator forces hold the home pose:
with all defaults, the platform stands still."""
    return f"""
{variables_table(layout, starts, fmi_version, "Matrices of joints have one row per leg.")}
<p>Outputs with a start value are the continuous states: their start is exact and can be set. Fixed parameters can be
set until initialization ends, tunable ones also during the run.{own_weight if stands_still else ""}</p>
"""


def _equations() -> str:
    """The equations from the file beside the code, which the site also shows."""
    return to_html(files("gough_stewart.model").joinpath("task_space.md").read_text(encoding="utf-8"))


def _behaviour(layout: Layout, variant: Variant, fmi_version: str) -> str:
    lowest, highest = (_power(t) for t in TOLERANCES)
    if fmi_version == "2.0":
        inputs = """In Co-Simulation inputs are held over a communication step, or change linearly if their first
derivative is set by <code>fmi2SetRealInputDerivatives</code>; a derivative stays in effect until it is set again. First
derivatives of outputs are available."""
        step, event = "between communication steps", "event and continuous-time mode"
    else:
        inputs = """In Co-Simulation inputs are held over a communication step. The intermediate-update callback is
called after every internal step. It can read outputs, set inputs and, if early return is allowed, end the step there.
First derivatives of outputs are available."""
        step, event = "in step mode", "event mode"
    tunable = ", ".join(f"<code>{row.variable.name}</code>" for row in layout.of_role(Role.TUNABLE_PARAMETER))
    scheme, fixed = "the Dormand–Prince pair of order 5(4)", "the classical Runge–Kutta method of order 4"
    if variant.bristles:
        scheme = "the exponential scheme ETDRK4, whole steps against two halves,"
        fixed = "the same scheme in momenta, divided where a leg breaks away, reverses or rings,"
    jacobians = "directional derivatives" if fmi_version == "2.0" else "directional and adjoint derivatives"
    return f"""
<h2>Behaviour</h2>
<ul>
<li>Co-Simulation integrates by {scheme} with error control. The tolerance is that of the
experiment, from {lowest} to {highest}, by default {_power(DEFAULT_TOLERANCE)}; it is relative, and absolute in SI
units. The internal step size carries over from one communication step to the next, so short steps cost
little.</li>
<li><code>fixed_step_size</code> &gt; 0 selects {fixed} instead, in equal steps
not above that size that end at the communication point: constant cost, for hardware in the loop. It has no
effect on Model Exchange, where the importer integrates.</li>
<li>{inputs}</li>
<li>All parameters can be set before initialization ends. During the run ({step} in Co-Simulation, in {event} in Model
Exchange): {tunable}.</li>
<li>The communication step size can vary. There are no events and no discrete states.</li>
<li>The state can be saved, restored and serialized; after a restore, the unit repeats its results bit by bit. Exact
{jacobians} with respect to inputs, states and parameters are available.</li>
</ul>
"""


def _failures(fmi_version: str) -> str:
    prefix = f"fmi{fmi_version[0]}"
    last = (
        "<code>fmi2LastSuccessfulTime</code> is the start of the step, and <code>fmi2Terminated</code> is true"
        if fmi_version == "2.0"
        else "<code>lastSuccessfulTime</code> is the start of the step"
    )
    exited = f"<code>{prefix}ExitInitializationMode</code>"
    completed = f"<code>{prefix}CompletedIntegratorStep</code>"
    # FMI 2.0 lists the functions that may return Discard
    unlisted = ""
    if fmi_version == "2.0":
        unlisted = ", and results or derivatives that are not finite where FMI 2.0 does not allow Discard"
    return f"""
<h2>Limits and failures</h2>
<ul>
<li><code>{prefix}Discard</code> from a setting function: a value is not finite or out of range.
From a communication step: a leg of zero length, a pitch of ±90°, a singular pose reached or passed,
forces or motions that are not finite, an unphysical <code>platform_inertia</code>, a tolerance that
cannot be met, or more than {MOST_INTERNAL_STEPS:,} internal steps ({MOST_FIXED_STEPS:,} fixed ones). From a getting
function: a result is not finite.</li>
<li>A discarded call leaves the unit in its state before the call; {last}. The importer can try other inputs or
another step, or end the simulation.</li>
<li><code>{prefix}Error</code>: misuse, such as a call that is not allowed in the current mode, an unknown value
reference, a communication point that is not the current time, or a step beyond the stop time. Also an invalid start
pose ({exited}){unlisted}.</li>
<li>A pose beyond the limits in Model Exchange: {completed} requests termination (<code>terminateSimulation</code>) and
logs the reason.</li>
<li>Poses are checked at internal steps. With a loose tolerance a motion can reach a singular pose and return between
two of them undetected.</li>
<li>Messages name quantity, value and time. Errors are always logged, other messages while logging is on; categories are
<code>logStatusWarning</code>, <code>logStatusDiscard</code>, <code>logStatusError</code> and <code>logAll</code>.</li>
</ul>
"""


_EXAMPLES = {
    "2.0": """import numpy as np
from fmpy import simulate_fmu

force = [{force}]
columns = [("time", float)] + [(f"actuator_force[{{i}}]", float) for i in range(1, 7)]
result = simulate_fmu(
    "gough_stewart_fmi2.fmu",
    fmi_type="CoSimulation",
    stop_time=0.5,
    output_interval=0.01,
    start_values={{"platform_mass": {mass}}},
    input=np.array([(0.0, *force), (0.5, *force)], dtype=columns),
    output=["position[3]", "leg_length[1]"],
)
print(result["position[3]"][-1])
""",
    "3.0": """import numpy as np
from fmpy import simulate_fmu

force = [{force}]
columns = [("time", float), ("actuator_force", float, (6,))]
result = simulate_fmu(
    "gough_stewart_fmi3.fmu",
    fmi_type="CoSimulation",
    stop_time=0.5,
    output_interval=0.01,
    start_values={{"platform_mass": {mass}}},
    input=np.array([(0.0, force), (0.5, force)], dtype=columns),
    output=["position", "leg_length"],
)
print(result["position"][-1])
""",
}


def _example(platform: Platform, fmi_version: str) -> str:
    force = ", ".join(f"{f:.6g}" for f in 1.05 * platform.home_actuator_force)
    code = _EXAMPLES[fmi_version].format(force=force, mass=f"{platform.platform_mass:.17g}")
    return f"""
<h2>Example with FMPy</h2>
<p>From rest in the start pose, under 5 % more than the holding forces of that pose:</p>
<pre><code>{escape(code, quote=False)}</code></pre>
"""


_SOURCE = """
<h2>Source</h2>
<p>M.-J. Liu, C.-X. Li, C.-N. Li, “Dynamics Analysis of the Gough–Stewart Platform Manipulator”, <cite>IEEE Transactions
on Robotics and Automation</cite> 16(1), 2000, pp. 94–98. The unit evaluates an equivalent form of its equations in the
platform's six coordinates.</p>
"""


def _power(value: float) -> str:
    """A power of ten, in HTML."""
    return f"10<sup>{round(log10(value))}</sup>".replace("-", "−")
