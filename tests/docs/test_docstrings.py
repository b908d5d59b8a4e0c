"""Docstrings of the public face: sections, shapes and units of arrays, sources of formulas."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator

from numpy.typing import ArrayLike

import gough_stewart as gs

# "(6,)", "(..., 6, 6)", "(n, 3)", "a number or (6,)"
SHAPE = re.compile(r"\((?:\.\.\.|…|\d+|[a-zA-Z])(?:,| × )(?: ?(?:\.\.\.|…|\d+|[a-zA-Z]),?)*\)")
# "[m]", "[N, N m]", "[1]", "in SI units"
UNIT = re.compile(r"\[[^\]\d]*(?:m|rad|s|N|kg|Hz|W|J|SI)[^\]\d]*[\d²]*[^\]\d]*\]|\[1\]|SI units")
FORMULA = re.compile(r"\S = .*[ᵀ⁻¹²·√ωζλδẋ/ẏ]")
SOURCE = re.compile(r"\(\d{4}\)|, \d{4}|Li & Li 2000|docs/equations\.md|`inverse_dynamics`|Cauchy")
# their formulas define their own names
DEFINITIONS = {"metrics", "identify"}
FUNCTIONS = [name for name in dir(gs) if inspect.isfunction(getattr(gs, name))]


def sections_of(name: str) -> dict[str, str]:
    """The sections of a docstring by title; what stands before them has the title ""."""
    parts = re.split(r"^(\w[\w ]+)\n-{3,}\n", inspect.getdoc(getattr(gs, name)) or "", flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def texts_by_name(section: str) -> dict[str, str]:
    """The text about each name of a section, of which several may share one."""
    entries = re.findall(r"^(\S.*)\n((?:(?: {4}.*)?\n?)*?)(?=^\S|\Z)", section, re.MULTILINE)
    return {name: text for names, text in entries for name in names.split(", ")}


def is_array(annotation: object) -> bool:
    text = str(annotation)
    return ("ndarray" in text and not re.search("ParametersOf|Callable", text)) or annotation == ArrayLike


def test_a_function_names_its_arguments_results_errors_an_example_and_what_to_see_also() -> None:
    """Expected: the names of its signature; names of the package."""
    for name in FUNCTIONS:
        sections, signature = sections_of(name), inspect.signature(getattr(gs, name))
        parameters = set(signature.parameters) - {"anyway"}  # a former name
        assert set(texts_by_name(sections.get("Parameters", ""))) == parameters, name
        assert "Raises" in sections or not parameters, name
        assert ">>> " in sections["Examples"], name
        others = sections["See Also"].strip().split(", ")
        assert set(others) <= set(dir(gs)) - {name}, name


def undescribed(texts: dict[str, str]) -> dict[str, str]:
    """Those without a shape or a unit."""
    return {key: text for key, text in texts.items() if not (SHAPE.search(text) and UNIT.search(text))}


def test_an_array_that_a_function_takes_or_returns_has_shape_and_unit() -> None:
    for name in FUNCTIONS:
        sections, signature = sections_of(name), inspect.signature(getattr(gs, name))
        described = texts_by_name(sections.get("Parameters", ""))
        texts = {key: described[key] for key, value in signature.parameters.items() if is_array(value.annotation)}
        if is_array(signature.return_annotation):
            texts["Returns"] = sections["Returns"]
        assert undescribed(texts) == {}, name


def test_a_formula_has_its_source() -> None:
    for name in set(FUNCTIONS) - DEFINITIONS:
        text = inspect.getdoc(getattr(gs, name)) or ""
        prose = re.sub(r"`[^`]*`|>>>.*", "", text)
        assert not FORMULA.search(prose) or SOURCE.search(text), name


def described_members(cls: type) -> Iterator[tuple[str, object, str]]:
    """Fields and properties that a class of this package declares: name, type, and what is said about it."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    for node, following in zip(body.body, [*body.body[1:], None], strict=True):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            literal = following.value if isinstance(following, ast.Expr) else None
            text = str(literal.value) if isinstance(literal, ast.Constant) else ""
            yield node.target.id, inspect.get_annotations(cls)[node.target.id], text
        elif isinstance(node, ast.FunctionDef) and isinstance(
            value := inspect.getattr_static(cls, node.name), property
        ):
            assert value.fget is not None
            yield node.name, inspect.get_annotations(value.fget).get("return"), inspect.getdoc(value) or ""


def test_an_array_that_a_class_has_is_described_with_shape_and_unit() -> None:
    """Expected: beside it, or in the text of the class by its name (the parameters of a platform, as a table)."""
    for name, cls in ((name, getattr(gs, name)) for name in dir(gs) if inspect.isclass(getattr(gs, name))):
        members = {key: text for key, kind, text in described_members(cls) if is_array(kind) and key[0] != "_"}
        whole = texts_by_name(sections_of(name).get("Parameters", ""))
        assert undescribed({key: text or whole.get(key, "") for key, text in members.items()}) == {}, name
