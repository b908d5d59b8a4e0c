"""What `build` made, as a report: files, variables of the units, how they passed their checks, and the next step."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.harness.report.document import Cell, Column, File, Note, Number, Report, Section, Table, Verdict
from gough_stewart.harness.report.quantities import COUNT, NUMBER, listed, plain_text, sentence
from gough_stewart.model.interface import IDEAL, Variant, unit_text
from gough_stewart.model.platform import Platform

if TYPE_CHECKING:
    from gough_stewart.harness.plants.unit_check import UnitCheck

_CAUSALITIES = ("input", "output", "parameter", "local")


def unit_report(  # noqa: PLR0915 – sections of the report in their order
    platform: Platform,
    versions: Sequence[str],
    targets: Sequence[str],
    files: Sequence[str],
    checks: "Sequence[UnitCheck] | None",
) -> Report:
    """The report of units of some FMI versions, and of models for MuJoCo; without checks it says that none was made."""
    versions = list(dict.fromkeys(versions))
    systems = "this machine" if list(targets) == ["native"] else listed([*targets])
    models = [name for name in files if name.endswith(".xml")]
    built = [f"FMI {listed([*versions])} of the platform {platform.name}, compiled for {systems}"] if versions else []
    built += [f"model of the platform {platform.name} for MuJoCo in {name}" for name in models]
    built.append("six actuator forces in, pose and leg lengths out")
    numbers = [Number("files", "files written", float(len(files)), COUNT)]
    sections, told = list[Section](), tuple[Number, ...]()
    outcome, failed = "not yet run: `--check` runs and compares them", list[str]()
    if checks is not None:
        from gough_stewart.harness.plants.unit_check import EXPLANATION

        failed = [f"{check.name} of {check.file}" for check in checks if not check.passed]
        worst = max((check.deviation for check in checks if check.deviation is not None), default=None)
        told = (
            Number("checks.failed", "failed checks", float(len(failed)), COUNT),
            Number("checks.deviation", "largest deviation from reference results", worst, NUMBER),
        )
        rows = ((check.file, check.name, "passed" if check.passed else "FAILED", check.result) for check in checks)
        columns = tuple(map(Column, ("unit", "check", "outcome", "deviation or problem")))
        sections.append(Section("Checks", (Table("", columns, tuple(rows), note=EXPLANATION),)))
        outcome = f"all {len(checks)} checks passed"
        if failed:
            outcome = f"{len(failed)} of {len(checks)} checks failed: {listed(failed)}"
    verdict = Verdict(sentence([*built, outcome if versions else None]), "bad" if failed else "good", told)

    component = plant_component(platform)
    units = {version: name for version in versions for name in files if name.endswith(f"fmi{version[0]}.fmu")}
    steps = [f"Look at the model: `python -m mujoco.viewer --mjcf={name}`" for name in models]
    kinds = dict.fromkeys(models, "for MuJoCo; its comment says what it leaves out")
    for version, name in units.items():
        kinds[name] = f"FMI {version}, Co-Simulation and Model Exchange, with the compiled code for {systems}"
        force = 1.05 * float(component.starts["actuator_force"].flat[0])
        values, push = (
            f"--start-values 'actuator_force[1]' {force:.6g} ",
            "push leg 1 with 5 % more than it needs to stand",
        )
        if version != "2.0":  # FMPy's command sets scalars only
            values, push = "", "let it stand"
        command = f"python -m fmpy --stop-time 0.5 {values}--output-file fmi{version[0]}.csv simulate {name}"
        steps.append(f"FMI {version}, by FMPy: {push}: `{command}`")
        if Variant.of(platform) == IDEAL:
            command = f"gough-stewart run heave_step --plant fmu{version[0]} --fmu {name}"
            steps.append(
                f"FMI {version}, a closed loop on the unit, which takes the experiment's platform: `{command}`"
            )
    sections.append(Section("Next step", tuple(map(Note, steps)), detail=True))
    if units:
        # all variables but time and derivatives: inputs, outputs, parameters, local ones
        shown = [row for row in component.layout.rows if row.derivative_of is None and row.variable.name != "time"]
        shown.sort(key=lambda row: _CAUSALITIES.index(row.variable.causality))
        lines, ends = list[tuple[Cell, ...]](), list[int]()
        for k, row in enumerate(shown):
            variable, start = row.variable, component.starts.get(row.variable.name)
            size = " × ".join(map(str, variable.shape)) or "1"
            text = "" if start is None else plain_text(start.reshape(variable.shape or (1,)) + 0.0)  # no negative zero
            slots = f"{row.first} to {row.slots[-1]}" if len(row.slots) > 1 else f"{row.first}"
            references = {"2.0": slots, "3.0": str(row.reference)}
            unit = "" if variable.unit == "1" else unit_text(variable.unit)
            lines.append((variable.name, variable.causality, size, unit, *(references[v] for v in versions), text))
            if k + 1 < len(shown) and shown[k + 1].variable.causality != variable.causality:
                ends.append(k)
        heads = ("variable", "causality", "elements", "unit", *(f"in FMI {v}" for v in versions), "start")
        note = (
            "SI units; value references of a variable in FMI 3.0, and of its elements in FMI 2.0, where each is a "
            "variable of its own, such as actuator_force[1] or base_points[6,3]."
        )
        table = Table(
            "", tuple(map(Column, heads)), tuple(lines), first_shown=ends[1] + 1, group_ends=tuple(ends), note=note
        )
        sections.append(Section("Variables", (table,), detail=True))
    return Report(
        f"FMU of {platform.name}" if versions else f"Model of {platform.name} for MuJoCo",
        verdict,
        tuple(sections),
        study="build",
        numbers=(*numbers, *told),
        files=tuple(File(name, kinds.get(name, "")) for name in files),
    )
