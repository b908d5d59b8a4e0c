"""documentation/index.html of a controller's unit."""

from collections.abc import Mapping
from html import escape

from gough_stewart.fmu_build.controller.controller import Controller
from gough_stewart.fmu_build.page import html_page, variables_table
from gough_stewart.model.vectors import Array


def documentation_page(controller: Controller, starts: Mapping[str, Array], fmi_version: str) -> bytes:
    """The page as well-formed HTML, with nothing that is fetched from elsewhere.

    Parameters
    ----------
    controller
        Gives variables and title.
    starts
        Start values in the table, by name.
    fmi_version
        "2.0" or "3.0"; decides names and what is said of the interface.
    """
    sections = (
        _heading(controller, fmi_version),
        _time(controller, fmi_version),
        variables_table(controller.layout, starts, fmi_version),
        _failures(fmi_version),
    )
    return html_page(f"Controller of a Gough–Stewart platform, FMI {fmi_version}", sections)


def _heading(controller: Controller, fmi_version: str) -> str:
    reference = "comes in at every sample" if controller.reference else "is inside"
    return f"""
<h1>Controller of a Gough–Stewart platform</h1>
<p>{escape(controller.title)}. Functional mock-up unit for FMI {fmi_version}, Co-Simulation: measurements in, six
actuator forces out; where the platform should be {reference}. All quantities are in SI units; a
force &gt; 0 extends the leg.</p>
"""


def _time(controller: Controller, fmi_version: str) -> str:
    between = (
        "changes linearly if first derivatives of the inputs are set by <code>fmi2SetRealInputDerivatives</code>"
        if fmi_version == "2.0"
        else "is what the importer sets in the intermediate update, which is called at every sample"
    )
    return f"""
<h2>Time</h2>
<ul>
<li>Samples are taken at the start time + k · <code>sample_time</code>, as designed {controller.sample_time:.6g} s, and
at no other time. A sample at a communication point reads what was set there before the step.</li>
<li>The forces of sample k are the outputs from sample k + 1 on: outputs never depend on the inputs of their time, so
that importers cannot disagree about the delay of one sample. Until sample 1 they are <code>start_force</code>.</li>
<li>Communication steps may be any fraction or multiple of the sample time, or neither. What is sampled within a step is
held from its beginning, or {between}.</li>
<li>As long as all inputs are exactly zero, as with importers that do not hand on start values, the forces are
<code>start_force</code>, and the memory stays as it is. Not so if nothing but velocities comes in: zeros are
measurements then.</li>
<li>Tunable parameters act from the next sample on.</li>
<li>The state can be saved, restored and serialized; a restored unit repeats its future to the last bit. There are no
continuous states, no events and no derivatives of outputs.</li>
</ul>
"""


def _failures(fmi_version: str) -> str:
    prefix = f"fmi{fmi_version[0]}"
    return f"""
<h2>Limits and failures</h2>
<ul>
<li><code>{prefix}Discard</code>: of a value that is set, not finite, or out of its range; of a communication step,
parameters that do not go together, inputs or forces that are not finite, or too many samples. The unit is then as it
was before the call.</li>
<li><code>{prefix}Error</code>: misuse, such as a call that is not allowed in the present mode, a communication point
that is not the present time, or a step beyond the stop time.</li>
<li>Messages name quantity, value and expectation. Errors are always logged, other messages while logging is on.</li>
</ul>
"""
