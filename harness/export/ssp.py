"""A loop as SSP: plant and controller as connected FMUs in one archive, with SystemStructure.ssd and a parameter set.

Limited to what the tested importers read: one flat system without its own connectors, scalars with `ssc:Real` in every
connector, connected connectors only, the standard's prefixes, SI units, and components of which no name begins with
another's, since FMPy finds parameters by the beginning of their names.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from gough_stewart.fmu_build.build import to_zip, unit_archives
from gough_stewart.fmu_build.component import Role, UnitComponent
from gough_stewart.fmu_build.documents import BY_NAME, installed_package, rendered
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.plants.signals import AT_MOTORS, Side
from gough_stewart.model.process.progress import StepProgress

PLANT, CONTROLLER = "plant", "controller"


def loop_archive(
    name: str,
    plant: UnitComponent,
    controller: UnitComponent,
    duration: float,
    step: float,
    targets: Iterable[Target],
    notes: Iterable[str] = (),
    *,
    fmi_version: str = "2.0",
    ssp_version: str = "1.0",
    side: Side = "leg",
    progress: StepProgress | None = None,
) -> bytes:
    """The archive: SystemStructure.ssd, both FMUs, their parameters again as an SSV file, and a page.

    Parameters
    ----------
    duration
        Of the experiment [s].
    step
        Of the master, the controller's clock [s].
    notes
        Paragraphs about the loop, for the page and the description of the system.
    fmi_version
        Of both units. All importers of SSP 1.0 support "2.0"; with "3.0" the units describe scalars, too, since
        connectors of SSP 1.0 have no dimensions.
    ssp_version
        "2.0" says what "1.0" does, for importers that expect it.
    side
        Of elastic legs, where encoders read.
    """
    targets, notes = tuple(targets), tuple(notes)
    components = {PLANT: replace(plant, has_scalars_only=True), CONTROLLER: replace(controller, has_scalars_only=True)}
    units = {
        f"resources/{key}.fmu": next(iter(unit_archives(unit, (fmi_version,), targets, progress).values()))
        for key, unit in components.items()
    }
    structure = system_structure(name, components, duration, step, " ".join(notes), version=ssp_version, side=side)
    return to_zip(
        {
            "SystemStructure.ssd": structure,
            "documentation/index.html": rendered("loop.html", title=f"{name}: plant and controller", notes=notes),
            f"resources/{name}.ssv": parameter_values(name, components, ssp_version),
            **units,
        }
    )


def system_structure(
    name: str,
    components: Mapping[str, UnitComponent],
    duration: float,
    step: float,
    description: str = "",
    *,
    version: str = "1.0",
    side: Side = "leg",
) -> bytes:
    """SystemStructure.ssd of a plant and a controller, each output connected to the input of the same name.

    Encoders at the motors' side of elastic legs read that.
    """
    at_motors = side == "motor" and AT_MOTORS["leg_length"] in components[PLANT].layout.by_name
    connections, connectors = list[dict[str, str]](), dict[str, list[tuple[str, str, str]]]()
    for source, sink in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
        rows, outputs = components[source].layout, {row.variable.name for row in components[source].layout.outputs()}
        for row in components[sink].layout.of_role(Role.INPUT):
            variable = row.variable
            if variable.name not in outputs:
                continue
            read = AT_MOTORS.get(variable.name, variable.name) if at_motors and source == PLANT else variable.name
            for out, into in zip(rows.by_name[read].variable.scalar_names, variable.scalar_names, strict=True):
                connectors.setdefault(source, []).append(("output", out, variable.unit))
                connectors.setdefault(sink, []).append(("input", into, variable.unit))
                connections.append(
                    {"startElement": source, "startConnector": out, "endElement": sink, "endConnector": into}
                )
    return rendered(
        "systemStructure.xml",
        version=version,
        name=name,
        tool=f"gough-stewart {installed_package()[0]['Version']}",
        description=description or None,
        components=[
            {
                "name": key,
                "connectors": sorted(connectors.get(key, ()), key=lambda connector: connector[0]),
                "set": _parameters({"": unit}),
            }
            for key, unit in components.items()
        ],
        connections=connections,
        all_units=_units(unit for rows in connectors.values() for *_, unit in rows),
        step=repr(step),
        duration=repr(duration),
    )


def parameter_values(name: str, components: Mapping[str, UnitComponent], version: str = "1.0") -> bytes:
    """The parameters of all components as one SSV file, named `component.parameter` as its importers expect."""
    named = {f"{key}.": unit for key, unit in components.items()}
    return rendered("parameterSet.xml", version=version, name=name, set=_parameters(named))


def _parameters(components: Mapping[str, UnitComponent]) -> dict[str, Any]:
    """Of components by the beginning of their names: name, value and unit of each parameter, and all units."""
    rows = [
        (f"{prefix}{scalar}", repr(float(value)), row.variable.unit)
        for prefix, unit in components.items()
        for row in unit.layout.of_role(Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
        for scalar, value in zip(row.variable.scalar_names, unit.starts[row.variable.name].flat, strict=True)
    ]
    return {"rows": rows, "units": _units(unit for *_, unit in rows)}


def _units(names: Iterable[str]) -> list[Any]:
    return [BY_NAME[name] for name in sorted({*names} - {""})]
