"""Units of the keys of experiment files; expected from the tables of docs/control.md and docs/platforms.md."""

import pytest

from gough_stewart.harness.experiment.overrides import unit_of, value_text


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("controller.bandwidth", "Hz"),
        ("loop.sample_time", "s"),
        ("limits.position_error", "m"),
        ("disturbance[2].force", "N"),
        ("change[1].parameters.platform_mass", "kg"),
        ("machine.base_points[3,2]", "m"),
        ("plant.parameters.leg_viscous_friction", "N.s/m"),
        ("sensors.quantisation.leg_length", "m"),
        # a factor, a choice, a key that is unknown, and gains that act on legs or on axes
        ("change[1].factors.platform_mass", ""),
        ("controller.space", ""),
        ("loop.nothing", ""),
        ("controller.proportional_gain", ""),
    ],
)
def test_keys_have_the_units_of_the_manual(key: str, unit: str) -> None:
    assert unit_of(key) == unit


def test_values_are_told_with_units_and_angles_in_degrees() -> None:
    """Expected by hand: half a turn is 180 degrees; words and numbers without unit stay as they are."""
    assert value_text("start.orientation", [0.0, 0.0, 3.141592653589793]) == "0, 0, 180 deg"
    assert value_text("actuators.force_limit", "platform") == "platform"
    assert value_text("actuators.force_limit", 16000.0) == "16000 N"
    assert value_text("loop.delay", 2) == "2"
