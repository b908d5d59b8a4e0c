"""documentation/index.html of a controller's unit."""

from collections.abc import Iterable, Mapping
from html import escape

from gough_stewart.fmu_build.controller.controller import Controller
from gough_stewart.fmu_build.page import html_page, variables_table
from gough_stewart.model.vectors import Array


def documentation_page(controller: Controller, starts: Mapping[str, Array], fmi_version: str) -> bytes:
    """The page as well-formed, self-contained HTML.

    Parameters
    ----------
    controller
        The controller with its variables and title.
    starts
        Start values in the table, by name.
    fmi_version
        "2.0" or "3.0"; determines names and the description of the interface.
    """
    sections = (
        _heading(controller, fmi_version),
        _time(controller, fmi_version),
        notes_section(controller.notes),
        variables_table(controller.layout, starts, fmi_version),
        _failures(fmi_version),
    )
    return html_page(f"Controller of a Gough–Stewart platform, FMI {fmi_version}", sections)


def _heading(controller: Controller, fmi_version: str) -> str:
    reference = "The reference is an input" if controller.reference else "The reference is part of the unit"
    kinds = "Co-Simulation with event mode, and Scheduled Execution" if controller.is_clocked else "Co-Simulation"
    return f"""
<h1>Controller of a Gough–Stewart platform</h1>
<p>{escape(controller.title)}. Functional mock-up unit for FMI {fmi_version}, {kinds}. Inputs are
measurements; outputs are six actuator forces. {reference}. All quantities are in SI units; a
force &gt; 0 extends the leg.</p>
"""


def _time(controller: Controller, fmi_version: str) -> str:
    if controller.is_clocked:
        return _time_of_clock(controller)
    between = (
        "change linearly if their first derivatives are set by <code>fmi2SetRealInputDerivatives</code>"
        if fmi_version == "2.0"
        else "are set in the intermediate-update callback, which is called at every sample"
    )
    return f"""
<h2>Time</h2>
<ul>
<li>Samples are taken at the start time + k · <code>sample_time</code>, {controller.sample_time:.6g} s by design, and
at no other time. A sample at a communication point reads the inputs that were set there before the step.</li>
{_steps(controller)}
<li>The forces of sample k are the outputs from sample k + <code>output_delay</code> on, {controller.output_delay} by
design; before them the outputs are <code>start_force</code>. Outputs have no direct feedthrough from the inputs, so the
delay is the same with every importer. <code>output_delay</code> is a whole number from 1 to
{controller.most_output_delay}. The parameter <code>delay</code> delays nothing: for this many samples ahead the
feedforward is computed.</li>
<li>Communication steps can be any fraction or multiple of the sample time, or neither. For samples within a step,
the inputs are held from its beginning, or {between}.</li>
{_BAD_INPUTS}
<code>input_bad_time</code> report it from the next sample on, whatever <code>output_delay</code> is.</li>
<li>Tunable parameters take effect at the next sample.</li>
<li>The state can be saved, restored and serialized; after a restore, the unit repeats its results bit by bit. There are
no continuous states, no events and no derivatives of outputs.</li>
</ul>
"""


_BAD_INPUTS = """<li>While all inputs are exactly zero, as with importers that do not propagate start values, the forces
are <code>start_force</code>, and the controller's state does not change. Controllers whose inputs are velocities only
treat zeros as measurements.</li>
<li>Inputs are checked against ranges that were fixed at the export. While one is out of its range, or frozen where that
is watched, the forces are safe ones, and the controller's state does not change. <code>input_status</code> and"""


def _time_of_clock(controller: Controller) -> str:
    return f"""
<h2>Time</h2>
<ul>
<li>The controller runs when its clock <code>sample_clock</code> ticks: at the start time + k ·
{controller.step_time:.6g} s, and at no other time. The clock is a fixed periodic input clock: the importer activates
it, and may choose another interval by <code>fmi3SetIntervalDecimal</code> in initialization mode, where the
controller was not designed for one. All inputs and outputs belong to the clock.</li>
{_steps(controller)}
<li>Co-Simulation, in event mode at each tick: <code>fmi3SetClock</code>, set the inputs, get the outputs,
<code>fmi3UpdateDiscreteStates</code>, <code>fmi3EnterStepMode</code>, <code>fmi3DoStep</code>,
<code>fmi3EnterEventMode</code>. The first tick is right after initialization. The outputs follow the inputs until
<code>fmi3UpdateDiscreteStates</code>, which ends the tick. A communication step over a tick is an error.</li>
<li>Scheduled Execution: set the inputs, <code>fmi3ActivateModelPartition</code>, get the outputs.</li>
<li>The outputs of a tick are the forces that its inputs determine, {controller.output_delay} samples late by design:
<code>output_delay</code> is a whole number from {controller.least_output_delay} to {controller.most_output_delay}. With
0 they depend directly on the inputs. The parameter <code>delay</code> delays nothing: for this many samples ahead the
feedforward is computed.</li>
{_BAD_INPUTS}
<code>input_bad_time</code> report it at the same tick, whatever <code>output_delay</code> is.</li>
<li>Tunable parameters take effect at the next tick, or at the present one until it ends.</li>
<li>The state can be saved, restored and serialized, also within a tick.</li>
</ul>
"""


def _steps(controller: Controller) -> str:
    """What happens between samples, if anything."""
    n = controller.steps_a_sample
    if n == 1:
        return ""
    return f"""<li>Between samples the unit takes steps, {n} in a sample: drives move on, and sensors may be read. These
are at the start time + k · <code>sample_time</code> / {n}.</li>"""


def notes_section(notes: Iterable[str]) -> str:
    """What is known about the loop of a controller, as a section; nothing without notes."""
    items = "\n".join(f"<li>{escape(text)}</li>" for text in notes)
    return f"<h2>The loop</h2>\n<ul>\n{items}\n</ul>" if items else ""


def _failures(fmi_version: str) -> str:
    prefix = f"fmi{fmi_version[0]}"
    return f"""
<h2>Limits and failures</h2>
<ul>
<li><code>{prefix}Discard</code> from a setting function: a value is not finite or out of range. From a communication
step: inconsistent parameters, inputs or forces that are not finite, or too many samples. A discarded call leaves the
unit in its state before the call.</li>
<li><code>{prefix}Error</code>: misuse, such as a call that is not allowed in the current mode, a communication point
that is not the current time, or a step beyond the stop time.</li>
<li>Messages name quantity, value and expectation. Errors are always logged, other messages while logging is on.</li>
</ul>
"""
