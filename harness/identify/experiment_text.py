"""The text of an experiment file with an optimised excitation."""

from gough_stewart.harness.identify.excite import Excited
from gough_stewart.model.platform import Platform
from gough_stewart.model.toml import toml_item

_TEXT = """\
# Written by `gough-stewart excite` with --seed {seed}: finite Fourier series in six coordinates that excite
#   {names}
# Condition number of their regressor: {number:.3g}.

title = {title}
description = "motion for identification, computed torque"

[platform]
{platform}

[reference]
type = "excitation"
frequency = "{frequency!r} Hz"
duration = "{duration!r} s"
fade = "{fade!r} s"
# a row for each harmonic: x, y, z [m]; roll, pitch, yaw [rad]
{coefficients}

[controller]
type = "pd"
bandwidth = "{bandwidth:g} Hz"
damping_ratio = 0.8
feedforward = "computed_torque"

[loop]
duration = "{duration!r} s"
sample_time = "1 ms"

[sensors]
quantisation = {{ leg_length = "1 um" }}
"""
# Bandwidth of the tracking loop: a few times the highest frequency of the motion.
_ABOVE = 6.0


def experiment_text(found: Excited, platform: Platform, chosen: str, names: str, seed: int) -> str:
    """The TOML text; `chosen` is the line that names the platform."""
    reference = found.reference
    sine, cosine = reference.coefficients
    parts = {"position_sine": sine[:, :3], "position_cosine": cosine[:, :3]}
    parts |= {"orientation_sine": sine[:, 3:], "orientation_cosine": cosine[:, 3:]}
    title = "excitation of " + platform.name
    return _TEXT.format(
        seed=seed,
        names=names,
        number=found.condition_number,
        title=toml_item(title).as_string(),
        platform=chosen,
        frequency=float(reference.frequency),
        duration=float(reference.duration),
        fade=float(reference.fade),
        coefficients="\n".join(f"{name} = {toml_item(values).as_string()}" for name, values in parts.items()),
        bandwidth=max(1.0, _ABOVE * reference.highest_frequency),
    )
