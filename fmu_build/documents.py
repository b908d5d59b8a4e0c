"""The documents of a unit: model description, build description, terminals and pages, each a filled-in template.

Pages are self-contained and well-formed as XML. Formulas of Markdown, also those of the site, become MathML, which
browsers render without a script.
"""

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageMetadata, distributions
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.fmu_build.component import (
    PARAMETER_ROLES,
    SCALAR_REFERENCE,
    Kind,
    LayoutRow,
    Role,
    UnitComponent,
)
from gough_stewart.model.vectors import Array

if TYPE_CHECKING:
    from jinja2 import Environment

# What XML 1.0 does not allow, and the rest of the control characters.
_REFUSED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
_NAME, _LICENSE = "gough-stewart", "licenses/LICENSE"


class PhysicalUnit(NamedTuple):
    """A unit as FMI describes it: exponents of base units; the factor is always 1."""

    name: str
    exponents: dict[str, int]
    # displayed value = factor · value
    display: tuple[str, float] | None = None


_DEGREES = float(np.rad2deg(1.0))
UNITS = (
    PhysicalUnit("N", {"kg": 1, "m": 1, "s": -2}),
    PhysicalUnit("N.m", {"kg": 1, "m": 2, "s": -2}),
    PhysicalUnit("m", {"m": 1}, ("mm", 1e3)),
    PhysicalUnit("rad", {"rad": 1}, ("deg", _DEGREES)),
    PhysicalUnit("m/s", {"m": 1, "s": -1}, ("mm/s", 1e3)),
    PhysicalUnit("rad/s", {"s": -1, "rad": 1}, ("deg/s", _DEGREES)),
    PhysicalUnit("m/s2", {"m": 1, "s": -2}),
    PhysicalUnit("rad/s2", {"s": -2, "rad": 1}, ("deg/s2", _DEGREES)),
    PhysicalUnit("J", {"kg": 1, "m": 2, "s": -2}),
    PhysicalUnit("kg", {"kg": 1}),
    PhysicalUnit("kg.m2", {"kg": 1, "m": 2}),
    PhysicalUnit("N.s/m", {"kg": 1, "s": -1}),
    PhysicalUnit("s", {"s": 1}),
    PhysicalUnit("N/m", {"kg": 1, "s": -2}),
    PhysicalUnit("N/(m.s)", {"kg": 1, "s": -3}),
    PhysicalUnit("1", {}),
    PhysicalUnit("N/s", {"kg": 1, "m": 1, "s": -3}),
    PhysicalUnit("Hz", {"s": -1}),
)
BY_NAME = {unit.name: unit for unit in UNITS}


class DescribedVariable(NamedTuple):
    """A variable of the model description: a whole row of the layout, or one of its slots."""

    row: LayoutRow
    name: str
    slots: range
    reference: int  # value reference
    key: int  # by which others refer to it: its position from 1 in FMI 2.0, its value reference in FMI 3.0
    start: str | None
    state: int | None  # the key of the state of which it is the derivative


def model_description(component: UnitComponent, fmi_version: str, token: str, source_files: Sequence[str]) -> bytes:
    """modelDescription.xml, with the component's start values; FMI 2.0 lists the files to compile there."""
    layout, in_scalars = component.layout, fmi_version == "2.0" or component.has_scalars_only
    variables, keys = list[DescribedVariable](), dict[int, int]()
    for row in layout.described(fmi_version):
        values = component.starts.get(row.variable.name)
        state = None if row.derivative_of is None else layout.by_name[row.derivative_of].first
        for k, name in enumerate(row.scalar_names if in_scalars else [row.variable.name]):
            slots = row.slots[k : k + 1] if in_scalars else row.slots
            reference = row.reference
            if in_scalars:
                reference = slots.start if fmi_version == "2.0" else SCALAR_REFERENCE + slots.start
            key = len(variables) + 1 if fmi_version == "2.0" else reference
            keys |= dict.fromkeys(slots, key)
            elements = () if values is None else values.flat[k : k + len(slots)]
            start = None if values is None else " ".join(repr(float(value)) for value in elements)
            state_key = None if state is None else keys[state + k]
            variables.append(DescribedVariable(row, name, slots, reference, key, start, state_key))

    def unknowns(rows: Iterable[LayoutRow], roles: tuple[Role, ...]) -> list[tuple[int, dict[int, Kind]]]:
        """Variables of rows by key, with dependencies on those of some roles: constant if it is for all elements."""
        knowns = {slot for row in layout.of_role(*roles) for slot in row.slots}
        dependencies = []
        for variable in (variable for row in rows for variable in variables if variable.row is row):
            kinds: dict[int, Kind] = {}
            for slot in variable.slots:
                for slot_of_known, kind in component.dependencies.get(slot, {}).items():
                    if slot_of_known in knowns and kinds.get(keys[slot_of_known]) != "dependent":
                        kinds[keys[slot_of_known]] = kind
            dependencies.append((variable.key, dict(sorted(kinds.items()))))
        return dependencies

    outputs, derivatives, running = layout.outputs(), layout.of_role(Role.DERIVATIVE), (Role.INPUT, Role.STATE)
    computed, units = [row for row in outputs if row.role is Role.RESULT], {row.variable.unit for row in layout.rows}
    return rendered(
        "modelDescription.xml",
        component=component,
        fmi_version=fmi_version,
        token=token,
        package=installed_package()[0],
        source_files=source_files,
        units=[unit for unit in UNITS if unit.name in units],
        display_units={unit.name: unit.display[0] for unit in UNITS if unit.display is not None},
        variables=variables,
        has_dimensions=not in_scalars,
        has_states=bool(derivatives),
        outputs=unknowns(outputs, running),
        derivatives=unknowns(derivatives, running),
        initial_unknowns=unknowns([*computed, *derivatives], (*running, *PARAMETER_ROLES)),
    )


def terminals_and_icons(component: UnitComponent, fmi_version: str) -> bytes:
    """terminalsAndIcons.xml: the six actuators, and groups of variables; empty groups are left out.

    Scalars have one terminal per actuator. A terminal cannot refer to an element of an array, so one terminal holds all
    six actuators of arrays.
    """
    rows, in_scalars = component.layout.by_name, fmi_version == "2.0" or component.has_scalars_only
    # name, description, names of variables by those of members
    terminals = [("actuators", "the six actuators", {name: name for name in component.actuator})]
    if in_scalars:
        scalars = [{name: rows[name].scalar_names[leg] for name in component.actuator} for leg in range(6)]
        terminals = [(f"actuator_{k}", f"actuator of leg {k}", names) for k, names in enumerate(scalars, 1)]
    for name, text, variables in component.groups:
        members = [s for variable in variables for s in (rows[variable].scalar_names if in_scalars else (variable,))]
        if members:
            terminals.append((name, text, dict(zip(members, members, strict=True))))
    return rendered("terminalsAndIcons.xml", terminals=terminals)


def rendered(template: str, **values: Any) -> bytes:
    """A template in `templates/` with its values, none of which may be missing; XML without empty lines."""
    text = _environment().get_template(template).render(**values)
    return (re.sub(r"\n\s*\n", "\n", text) if template.endswith(".xml") else text).encode()


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    def attributes(values: Mapping[str, Any]) -> Markup:
        """The attributes of an element, without those that are None; with a mark for what XML cannot have."""
        stated = ((name, str(value)) for name, value in values.items() if value is not None)
        texts = ((name, _REFUSED.sub("\N{REPLACEMENT CHARACTER}", value)) for name, value in stated)
        return Markup("".join(f" {name}={quoteattr(text)}" for name, text in texts))

    def number(value: float) -> str:
        return f"{value + 0.0:.6g}".replace("-", "−")

    def lines(values: Array | None) -> Sequence[str]:
        """Numbers with six digits, a line for every row of a matrix; one number if all digits are equal."""
        if values is None:
            return ()
        rows = [" ".join(map(number, row)) for row in (values if values.ndim == 2 else values.reshape(1, -1))]
        words = {word for row in rows for word in row.split()}
        return list(words) if len(words) == 1 else rows

    environment = Environment(
        loader=PackageLoader("gough_stewart.fmu_build"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    # numbers, or several with blanks between, with all digits; places with two; none is a negative zero
    environment.filters |= {
        "attributes": attributes,
        "lines": lines,
        "number": number,
        "place": lambda value: f"{round(float(value), 2) + 0.0:g}",
        "exact": lambda values: " ".join(repr(float(value) + 0.0) for value in np.ravel(values)),
    }
    return environment


@cache
def installed_package() -> tuple[PackageMetadata, str]:
    """Metadata and LICENSE of the installed distribution; a checkout has another one of its name, without license."""
    for distribution in distributions(name=_NAME):
        text = distribution.read_text(_LICENSE)
        if text:
            return distribution.metadata, text
    raise BuildError(f"{_NAME} is installed without its license; reinstall it with pip")


# The converter's output for \begin{bmatrix}.
_MATRIX = re.compile(r"<mo>&#x0005B;</mo>(<mtable>.*?</mtable>)<mo>&#x0005D;</mo>", re.DOTALL)
_HEADING = re.compile(r"(#+) (.*)")
_INLINE = re.compile(r"\$(?P<formula>[^$]+)\$|`(?P<code>[^`]+)`|\*\*(?P<strong>[^*]+)\*\*")


@cache  # the pages of both FMI versions have their formulas in common
def mathml(latex: str, display: str) -> str:
    """One formula, `inline` or `block`; `ValueError` for a command that the converter or browsers do not support."""
    from latex2mathml.converter import convert  # here, since most programs make no documents

    element: str = convert(html.unescape(latex).strip(), display=display)
    # browsers support upright letters, but not sans-serif ones
    element = element.replace('mathvariant="sans-serif"', 'mathvariant="normal"')
    unknown = re.search(r'\\\w+|mathvariant="(?!normal)[\w-]+"', html.unescape(element))
    if unknown:
        raise ValueError(f"no MathML for {unknown[0]} in the formula {latex.strip()}")
    return _MATRIX.sub(r'<mrow class="matrix">\1</mrow>', element)


def to_html(markdown: str) -> str:
    """HTML of paragraphs, headings and formulas `$$…$$`, between empty lines; `$…$`, code and bold text inline."""
    elements = []
    for text in re.split(r"\n\s*\n", html.escape(markdown, quote=False).strip()):
        block = text.strip()
        if heading := _HEADING.fullmatch(block):
            level = len(heading[1]) + 1
            elements.append(f"<h{level}>{_inline(heading[2])}</h{level}>")
        elif block.startswith("$$") and block.endswith("$$"):
            elements.append(f'<div class="formula">{mathml(block[2:-2], "block")}</div>')
        elif block:
            elements.append(f"<p>{_inline(block)}</p>")
    return "\n".join(elements)


def _inline(text: str) -> str:
    """An escaped text with its formulas, code and bold parts as elements."""

    def element(match: re.Match[str]) -> str:
        if match["formula"]:
            return mathml(match["formula"], "inline")
        return f"<code>{match['code']}</code>" if match["code"] else f"<strong>{_inline(match['strong'])}</strong>"

    return _INLINE.sub(element, text)
