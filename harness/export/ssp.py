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
    duration: float,  # of the experiment [s]
    step: float,  # of the master, the controller's clock [s]
    targets: Iterable[Target],
    notes: Iterable[str] = (),  # paragraphs about the loop, for the page and the description of the system
    *,
    # of both units; with "3.0" they describe scalars, too, since connectors of SSP 1.0 have no dimensions
    fmi_version: str = "2.0",
    ssp_version: str = "1.0",
    side: Side = "leg",  # of elastic legs, where encoders read
    progress: StepProgress | None = None,
) -> bytes:
    """The archive: SystemStructure.ssd, both FMUs, their parameters again as an SSV file, and a page.

    Each output is connected to the input of the same name; encoders at the motors' side of elastic legs read that. The
    parameters of the SSV file are named `component.parameter`, as importers expect.
    """
    targets, notes = tuple(targets), tuple(notes)
    components = {PLANT: replace(plant, has_scalars_only=True), CONTROLLER: replace(controller, has_scalars_only=True)}
    files = {
        f"resources/{key}.fmu": next(iter(unit_archives(unit, (fmi_version,), targets, progress).values()))
        for key, unit in components.items()
    }
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
    structure = rendered(
        "systemStructure.xml",
        version=ssp_version,
        name=name,
        tool=f"gough-stewart {installed_package()[0]['Version']}",
        description=" ".join(notes) or None,
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
    named = _parameters({f"{key}.": unit for key, unit in components.items()})
    return to_zip(
        {
            "SystemStructure.ssd": structure,
            "documentation/index.html": rendered("loop.html", title=f"{name}: plant and controller", notes=notes),
            f"resources/{name}.ssv": rendered("parameterSet.xml", version=ssp_version, name=name, set=named),
            **files,
        }
    )


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
