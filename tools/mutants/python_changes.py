"""Changes of Python sources: operators, signs, numbers, indices, conditions, arguments, functions, lost statements.

Annotations, decorators, imports, strings and exception messages are not changed: such changes break the import or
affect nothing that a test should check.
"""

import ast
import re
from collections.abc import Iterator

from tools.mutants.mutation import Change
from tools.mutants.numbers import other_numbers

OPERATORS: dict[type[ast.AST], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/",)),
    ast.Div: ("/", ("*",)),
    ast.FloorDiv: ("//", ("/",)),
    ast.Mod: ("%", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.BitOr: ("|", ("&",)),
    ast.BitAnd: ("&", ("|",)),
    ast.Lt: ("<", ("<=", ">")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
    ast.And: ("and", ("or",)),
    ast.Or: ("or", ("and",)),
}
FUNCTIONS = {
    **{"sin": "cos", "cos": "sin", "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"},
    **{"any": "all", "all": "any", "floor": "ceil", "ceil": "floor", "argmin": "argmax", "argmax": "argmin"},
    **{"zeros": "ones", "ones": "zeros", "radians": "degrees", "degrees": "radians", "mean": "sum", "sum": "mean"},
    **{"sorted": "list", "cumsum": "array", "tanh": "arctan", "nanmax": "nanmin", "nanmin": "nanmax"},
}
UNWRAPPED = {"sqrt", "abs", "square", "fabs", "copy"}
# Calls whose first two arguments commute, or are obviously wrong when exchanged.
KEEP_ORDER = {
    "min",
    "max",
    "minimum",
    "maximum",
    "dot",
    "hypot",
    "array_equal",
    "isinstance",
    "getattr",
    "setattr",
    "zip",
}
COUNTERS = {"i", "j", "k", "n", "index", "leg"}


def python_changes(source: bytes) -> Iterator[list[Change]]:
    """The changes at each place of a source; a few may not be valid Python."""
    collector = _Collector(source)
    collector.visit(ast.parse(source))
    yield from collector.places


def is_python(source: bytes) -> bool:
    """Whether a source can be parsed."""
    try:
        ast.parse(source)
    except SyntaxError:
        return False
    return True


class Places(ast.NodeVisitor):
    """Walks through executable code; `places` has the alternative changes at each place."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.places: list[list[Change]] = []

    def _start(self, node: ast.expr | ast.stmt | ast.keyword) -> int:
        return self.starts[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr | ast.stmt | ast.keyword) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, node: ast.expr | ast.stmt) -> bytes:
        return self.source[self._start(node) : self._end(node)]

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Not the annotation."""
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Defaults and body; neither annotations nor decorators."""
        for default in [*node.args.defaults, *node.args.kw_defaults]:
            if default is not None:
                self.visit(default)
        for statement in node.body:
            self.visit(statement)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """The body."""
        for statement in node.body:
            self.visit(statement)


class _Collector(Places):
    """Collects the changes of operators, numbers, conditions, arguments, functions and statements."""

    def _replace(self, node: ast.expr | ast.stmt, *texts: bytes) -> None:
        if texts:
            self.places.append([Change(self._start(node), self._end(node), text) for text in texts])

    def _operator(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> None:
        if type(operator) not in OPERATORS:
            return
        symbol, others = OPERATORS[type(operator)]
        first, last = self._end(left), self._start(right)
        pattern = re.escape(symbol).replace(r"\ ", r"\s+")
        if found := re.search(
            (pattern if not symbol[0].isalpha() else rf"\b{pattern}\b").encode(), self.source[first:last]
        ):
            self.places.append([Change(first + found.start(), first + found.end(), o.encode()) for o in others])

    # --- expressions -------------------------------------------------------------------------------------------

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if isinstance(node.op, ast.MatMult):
            left, right = self._text(node.left), self._text(node.right)
            self._replace(node, b"(" + right + b") @ (" + left + b")")
        self._operator(node.left, node.op, node.right)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, operator, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            self._operator(left, operator, right)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._operator(left, node.op, right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        self._replace(node, b"(" + self._text(node.operand) + b")")
        if not isinstance(node.operand, ast.Constant):
            self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self._replace(node, str(not node.value).encode())
        elif isinstance(node.value, int | float):
            self._replace(node, *(other.encode() for other in other_numbers(self._text(node).decode())))

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._replace(node.test, b"not (" + self._text(node.test) + b")")
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr in {"T", "mT"}:
            self._replace(node, self._text(node.value))
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        for index in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            if isinstance(index, ast.Name) and index.id in COUNTERS:
                self._replace(index, index.id.encode() + b" - 1")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in FUNCTIONS:
            end = self._end(node.func)
            self.places.append([Change(end - len(name), end, FUNCTIONS[name].encode())])
        if name in UNWRAPPED and len(node.args) == 1:
            self._replace(node, b"(" + self._text(node.args[0]) + b")")
        if len(node.args) > 1 and not any(isinstance(each, ast.Starred | ast.Constant) for each in node.args[:2]):
            first, second = (self._text(each) for each in node.args[:2])
            if first != second and name not in KEEP_ORDER:
                between = self.source[self._end(node.args[0]) : self._start(node.args[1])]
                span = (self._start(node.args[0]), self._end(node.args[1]))
                self.places.append([Change(*span, second + between + first)])
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for condition in node.ifs:
            self._replace(condition, b"not (" + self._text(condition) + b")")
        self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg != "strict":  # `strict` of zip: its condition is always true
            self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Texts are not changed."""

    # --- statements --------------------------------------------------------------------------------------------

    def visit_If(self, node: ast.If) -> None:
        self._replace(node.test, b"not (" + self._text(node.test) + b")")
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._replace(node, b"pass")

    def visit_Break(self, node: ast.Break) -> None:
        self._replace(node, b"continue")

    def visit_Continue(self, node: ast.Continue) -> None:
        self._replace(node, b"break")

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._replace(node, b"pass")
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if all(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets):
            self._replace(node, b"pass")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._replace(node, b"pass")
        self._operator(node.target, node.op, node.value)
        self.generic_visit(node)
