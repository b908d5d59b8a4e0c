"""Bugs of meaning in Python sources: another column, first option for second, one side of a bound, stale values.

Each operator is named after the mistake that it imitates; none repeats a change of `python_changes`.
"""

import ast
from collections.abc import Iterator
from itertools import pairwise

from tools.mutants.mutation import Change
from tools.mutants.python_changes import Places

# Names that are confused in strings: both sides of a pair, or the next of a row.
CONFUSED = (
    ("position", "orientation"),
    ("velocity", "angular_velocity"),
    ("acceleration", "angular_acceleration"),
    ("leg_length", "leg_velocity"),
    ("leg_lower_mass", "leg_upper_mass"),
    ("leg_lower_com", "leg_upper_com"),
    ("leg_lower_inertia", "leg_upper_inertia"),
    ("leg_viscous_friction", "leg_coulomb_friction"),
    ("base_points", "platform_points"),
    ("platform", "machine"),
    ("force", "torque"),
    ("noise", "quantisation"),
    ("reference", "measured"),
    ("platform", "plant"),
    ("x", "y", "z"),
    ("roll", "pitch", "yaw"),
    ("low", "high"),
    ("lower", "upper"),
    ("min", "max"),
    ("rms", "peak"),
    ("leg", "task"),
    ("first", "last"),
)
UNITS = {"radians", "degrees", "deg2rad", "rad2deg"}
REDUCTIONS = {"sum", "mean", "max", "min", "all", "any", "std", "prod", "norm", "argmax", "argmin", "cumsum"}
_FACTORS = {1000, 1e6, 1e-3, 100, 60}
OTHER_NAMES = {a: b for row in CONFUSED for a, b in zip(row, (*row[1:], row[0]), strict=True)}


def semantic_python(source: bytes) -> Iterator[list[Change]]:
    """The changes at each place of a source; a few may not be valid Python."""
    found = _Semantic(source)
    found.visit(ast.parse(source))
    yield from found.places


class _Semantic(Places):
    """Collects the changes; `siblings` has the attributes that each function reads of an object."""

    def __init__(self, source: bytes) -> None:
        super().__init__(source)
        self.siblings: list[dict[str, list[str]]] = []
        self.in_text = 0

    # --- swapped columns, legs, axes, names ---------------------------------------------------------------------

    def visit_Tuple(self, node: ast.Tuple) -> None:
        self._exchange(node, node.elts)

    def visit_List(self, node: ast.List) -> None:
        self._exchange(node, node.elts)

    def visit_Dict(self, node: ast.Dict) -> None:
        self._exchange(node, node.values)

    def _exchange(self, node: ast.expr, elements: list[ast.expr]) -> None:
        """Swap neighbours; the first two arguments of a call are a change of `python_changes`."""
        if isinstance(getattr(node, "ctx", None), ast.Store):
            return
        for first, second in pairwise(elements):
            if self._text(first) != self._text(second) and not isinstance(first, ast.Starred):
                between = self.source[self._end(first) : self._start(second)]
                if b"*" not in between:
                    swapped = self._text(second) + between + self._text(first)
                    self._add("swap", self._start(first), self._end(second), swapped)
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if self.in_text or not isinstance(node.value, str):
            return
        text = self._text(node)
        for quote in (b'"', b"'"):
            if node.value in OTHER_NAMES and text == quote + node.value.encode() + quote:
                self._instead("name", node, quote + OTHER_NAMES[node.value].encode() + quote)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Texts are not changed."""

    # --- the first option for the second, one of two conditions, one side of a bound -------------------------------

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._instead("option", node, self._inside(node.body), self._inside(node.orelse))
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._add("dropped", self._start(left), self._end(right), self._text(left))
            self._add("dropped", self._start(left), self._end(right), self._text(right))
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if len(node.ops) > 1:
            for k in range(len(node.ops)):
                parts = [node.left, *node.comparators]
                kept = parts[1:] if k == 0 else parts[:-1]
                self._add("one side", self._start(node), self._end(node), self._between(kept[0], kept[-1]))
        elif isinstance(node.left, ast.Call) and self._called(node.left) in {"abs", "fabs"} and node.left.args:
            # the unwrapped call is a change of `python_changes`: here the other side
            self._instead("one side", node.left, b"-(" + self._text(node.left.args[0]) + b")")
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        left, right = self._text(node.left), self._text(node.right)
        if isinstance(node.op, ast.BitOr | ast.BitAnd) and any(
            isinstance(each, ast.Compare | ast.UnaryOp | ast.BinOp) for each in (node.left, node.right)
        ):
            self._instead("dropped", node, b"(" + left + b")", b"(" + right + b")")
        if isinstance(node.op, ast.Mult | ast.Div):
            for each, other in ((node.left, right), (node.right, left)):
                if isinstance(each, ast.Constant) and each.value in _FACTORS:
                    self._instead("unit", node, b"(" + other + b")")
        if isinstance(node.op, ast.MatMult) and not isinstance(node.left, ast.Attribute):
            self._instead("frame", node.left, b"(" + left + b").T")
        self.generic_visit(node)

    # --- another unit, a wrong reduction, the first of all ----------------------------------------------------------

    def visit_Call(self, node: ast.Call) -> None:
        name = self._called(node)
        if name in UNITS and len(node.args) == 1:
            self._instead("unit", node, b"(" + self._text(node.args[0]) + b")")
        if name in REDUCTIONS:
            for keyword in node.keywords:
                if keyword.arg == "axis":
                    self._lose(node, keyword)
        for first, second in zip(node.keywords, node.keywords[1:], strict=False):
            a, b = self._text(first.value), self._text(second.value)
            if a != b and first.arg and second.arg and "strict" not in (first.arg, second.arg):
                between = self.source[self._end(first.value) : self._start(second.value)]
                self._add("swap", self._start(first.value), self._end(second.value), b + between + a)
        if name == "range" and len(node.args) == 1:
            inner = self._text(node.args[0])
            self._instead("block", node, b"range(1, " + inner + b")", b"range((" + inner + b") - 1)")
        if isinstance(node.func, ast.Attribute):  # a method for data fails wherever it is run
            self.visit(node.func.value)
        for each in (*node.args, *(keyword.value for keyword in node.keywords)):
            self.visit(each)

    def _lose(self, node: ast.Call, keyword: ast.keyword) -> None:
        """Remove one keyword argument, with the comma before it."""
        start = self._start(keyword)
        before = self.source.rfind(b",", self._end(node.func), start)
        first = before if before >= 0 and not self.source[before + 1 : start].strip() else start
        self._add("reduction", first, self._end(keyword), b"")

    def visit_Subscript(self, node: ast.Subscript) -> None:
        index = node.slice
        if isinstance(index, ast.Name) and isinstance(node.ctx, ast.Load):
            self._instead("stale", index, b"0")
        for part in index.elts if isinstance(index, ast.Tuple) else [index]:
            if not isinstance(part, ast.Slice) or part.step is not None or not isinstance(node.ctx, ast.Load):
                continue
            low, high = part.lower, part.upper
            if low is not None:
                self._add("block", self._start(low), self._end(low), b"")
            if high is not None:
                self._add("block", self._start(high), self._end(high), b"")
        self.generic_visit(node)

    # --- another attribute of the same object: belief for machine, last for present ---------------------------------

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        reads: dict[str, list[str]] = {}
        called = {id(each.func) for each in ast.walk(node) if isinstance(each, ast.Call)}
        for each in ast.walk(node):
            if id(each) in called:
                continue
            if isinstance(each, ast.Attribute) and isinstance(each.value, ast.Name) and each.value.id != "np":
                of = reads.setdefault(each.value.id, [])
                if each.attr not in of:
                    of.append(each.attr)
        self.siblings.append(reads)
        super().visit_FunctionDef(node)
        self.siblings.pop()

    def visit_Attribute(self, node: ast.Attribute) -> None:
        of = self.siblings[-1].get(node.value.id, []) if self.siblings and isinstance(node.value, ast.Name) else []
        if node.attr in of and len(of) > 1 and isinstance(node.ctx, ast.Load):
            other = of[(of.index(node.attr) + 1) % len(of)]
            end = self._end(node)
            self._add("sibling", end - len(node.attr), end, other.encode())
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        """Errors are not changed."""

    # --- writing ------------------------------------------------------------------------------------------------

    @staticmethod
    def _called(node: ast.Call) -> str:
        return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")

    def _inside(self, node: ast.expr) -> bytes:
        return b"(" + self._text(node) + b")"

    def _between(self, first: ast.expr, last: ast.expr) -> bytes:
        return self.source[self._start(first) : self._end(last)]

    def _add(self, operator: str, start: int, end: int, text: bytes) -> None:
        self.places.append([Change(start, end, text, operator)])

    def _instead(self, operator: str, node: ast.expr | ast.stmt, *texts: bytes) -> None:
        self.places.append([Change(self._start(node), self._end(node), text, operator) for text in texts])
