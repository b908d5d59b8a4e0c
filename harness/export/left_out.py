"""What an export leaves out of its experiment."""

from collections.abc import Iterable, Iterator
from typing import Any

from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import Part
from gough_stewart.harness.export.stability import Host
from gough_stewart.harness.section import Kind

# What every form has, what it is checked by, or what describes the run alone. Everything else in an experiment is left
# out if it is set, so that a new key is named until it has its place here.
_HAS = frozenset(
    {
        *("title", "description", "platform", "reference", "controller", "start", "require"),
        *("plant.kind", "plant.file", "plant.parameters", "plant.tolerance", "plant.fixed_step_size"),
        *("loop.duration", "loop.sample_time", "loop.plant_step", "loop.delay"),
        *("actuators.force_limit", "sensors.seed"),
        *("limits.reference", "limits.condition_number"),
    }
)
# What it carries of the machine, by part; noise is left out, since its random streams are the harness's.
_CARRIES: dict[Part, tuple[str, ...]] = {
    "drives": ("actuators.rate_limit", "actuators.lag"),
    "sensors": ("sensors.quantisation", "sensors.sample_time"),
}
# Values that mean nothing more than the default does.
_HARMLESS = {"limits.stroke": ("warn", "ignore")}
# A controller alone has no plant, of whichever kind.
_OF_PLANT = ("plant",)
_OTHER_MACHINES = "ensemble (its other machines)"


def left_out(experiment: Experiment, host: Host, parts: Iterable[Part] = ()) -> list[str]:
    """Keys that are set in an experiment, and that a form with these parts does not include: `injection`.

    Of an `[ensemble]`, the keys that vary are named, since a form holds one value of each; an SSP holds one machine.
    """
    around = () if host == "ssp" else _OF_PLANT
    carried = {key for part in parts for key in _CARRIES[part]}
    found = [key for key in _set(experiment) if key not in _HAS | carried and key.split(".")[0] not in (*_HAS, *around)]
    if experiment.ensemble is not None:
        for key, path in _varied(experiment):
            is_named = any(".".join(path).startswith(each) for each in found)
            if path[0] not in around and not is_named:
                found.append(_OTHER_MACHINES if path[0] in _OF_PLANT else f"ensemble.{key}")
    return list(dict.fromkeys(found))


def _set(experiment: Experiment) -> Iterator[str]:
    """Keys that are not at their defaults, as `section.key`; lists and choices of a kind by their section."""
    for section, value in experiment.model_dump(exclude_defaults=True).items():
        if section == "ensemble":
            continue
        # a section of a kind, such as an injection, is one thing
        if not isinstance(value, dict) or section in _HAS or isinstance(getattr(experiment, section), Kind):
            if _means_something(section, value):
                yield section
            continue
        yield from (f"{section}.{name}" for name, own in value.items() if _means_something(f"{section}.{name}", own))


def _means_something(key: str, value: Any) -> bool:
    if value in _HARMLESS.get(key, ()):
        return False
    return any(value.values()) if isinstance(value, dict) else value not in (None, [], 0)


def _varied(experiment: Experiment) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Keys of `[ensemble]` as written, each with its path; a bare name is of the machine."""
    assert experiment.ensemble is not None
    for key in experiment.ensemble.varied:
        yield key, tuple(key.split(".")) if "." in key else ("plant", key)
    for together in experiment.ensemble.covariance:
        for key in together.of:
            yield key, tuple(key.split(".")) if "." in key else ("plant", key)
