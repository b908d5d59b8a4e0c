"""The changes that make mutants, as queries of syntax trees: of tokens, and of meaning, named after a mistake.

Annotations, decorators and texts are not changed: such changes break the import or affect nothing that a test
should check. No change of meaning repeats one of tokens.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from itertools import chain, permutations

from tree_sitter import Node

Captures = Mapping[str, Node]
Text = str | Callable[[Captures], Iterable[str]]
# A query, and what is put in the place of its node `all`, or of all from `a` to `b`: texts with the nodes by name.
Rule = tuple[str, *tuple[Text, ...]]

# What is not changed inside.
SKIPPED = {
    *("type", "decorator", "interpolation", "template_substitution", "array_declarator", "preproc_def"),
    *("preproc_function_def", "raise_statement", "throw_statement"),
}
_LITERALS = {
    *("integer", "float", "number", "number_literal", "string", "string_literal", "concatenated_string", "true"),
    *("false", "template_string", "char_literal", "none", "null", "keyword_argument", "generator_expression"),
}
_NOT_ALONE = {"list_splat", "dictionary_splat", "spread_element", "pair", "initializer_pair"}
# Operators and functions that are confused: both of a pair, or one for others.
_EXCHANGED = (
    *("+ -", "* /", "+= -=", "*= /=", "++ --", "| &", "== !=", "=== !==", "&& ||", "and or", "sin cos", "min max"),
    *("minimum maximum", "fmin fmax", "any all", "some every", "floor ceil", "argmin argmax", "zeros ones"),
    *("radians degrees", "mean sum", "nanmax nanmin", "True False", "true false", "break continue", "break; continue;"),
)
_OTHER: dict[str, tuple[str, ...]] = {
    **{a: (b,) for pair in _EXCHANGED for a, b in permutations(pair.split())},
    **{"<": ("<=", ">"), "<=": ("<", ">"), ">": (">=", "<"), ">=": (">", "<"), "//": ("/",), "%": ("*",)},
    **{"is": ("is not",), "is not": ("is",), "in": ("not in",), "not in": ("in",), "**": ("*",), "??": ("&&",)},
    **{"sorted": ("list",), "cumsum": ("array",), "tanh": ("arctan",)},
}
# Names that are confused in texts: both of a pair, or the next of a row.
_CONFUSED = (
    *("position orientation", "velocity angular_velocity", "acceleration angular_acceleration", "force torque"),
    *("leg_length leg_velocity", "leg_lower_mass leg_upper_mass", "leg_lower_com leg_upper_com", "leg task"),
    *("leg_lower_inertia leg_upper_inertia", "leg_viscous_friction leg_coulomb_friction", "lower upper", "low high"),
    *("base_points platform_points", "platform machine", "noise quantisation", "reference measured", "platform plant"),
    *("x y z", "roll pitch yaw", "min max", "rms peak", "first last"),
)
_OTHER_NAME = {name: row[k - len(row) + 1] for row in map(str.split, _CONFUSED) for k, name in enumerate(row)}
_NUMBER = re.compile(r"(?P<value>0[xX][0-9a-fA-F]+|[0-9.][0-9_.]*([eE][+-]?[0-9]+)?)(?P<suffix>[uUlLfFzn]*)$")


def text_of(node: Node) -> str:
    """The source of a node."""
    return (node.text or b"").decode()


def _other_token(captures: Captures) -> Iterable[str]:
    return _OTHER.get(text_of(captures["all"]), ())


def _other_name(captures: Captures) -> Iterable[str]:
    return filter(None, [_OTHER_NAME.get(text_of(captures["all"]))])


def _other_numbers(captures: Captures) -> Iterable[str]:
    """An integer plus and minus one; another number times 1.1, and its negative."""
    found = _NUMBER.match(text_of(captures["all"]))
    if found is None:
        return ()
    value, suffix = found["value"].replace("_", ""), found["suffix"]
    if re.fullmatch(r"0[xX][0-9a-fA-F]+|[0-9]+", value):
        integer = int(value, 16 if value[1:2] in {"x", "X"} else 10)
        return (f"{other}{suffix}" for other in (integer + 1, integer - 1) if other >= 0)
    larger = 1.1 * float(value)
    return (f"{larger!r}{suffix}", f"(-{value}{suffix})") if larger else (f"1.0{suffix}",)


def _swapped(captures: Captures) -> Iterable[str]:
    return () if {captures["a"].type, captures["b"].type} & _NOT_ALONE else ("{b}{between}{a}",)


def _swapped_arguments(captures: Captures) -> Iterable[str]:
    return () if {captures["a"].type, captures["b"].type} & _LITERALS else _swapped(captures)


def _sibling(captures: Captures) -> Iterable[str]:
    """The next attribute that the same function reads of the same object: belief for machine, last for present."""
    read, function = _read(captures["whole"]), captures["whole"]
    if read is None:
        return ()
    while function.parent is not None and function.type not in _FUNCTIONS:
        function = function.parent
    names = list(dict.fromkeys(name for whole, name in _reads_below(function) if whole == read[0]))
    return (names[(names.index(read[1]) + 1) % len(names)],)


def _reads_below(node: Node) -> Iterable[tuple[str, str]]:
    below = chain.from_iterable(map(_reads_below, node.named_children))
    return filter(None, chain([_read(node)], below))


def _read(node: Node) -> tuple[str, str] | None:
    """Object and attribute where an attribute of a plain name is read, and neither called nor written."""
    above = node.parent
    if node.type not in _READS or above is None or node == above.child_by_field_name("function"):
        return None
    whole, name = node.named_children[0], node.named_children[-1]
    is_written = "assignment" in above.type and node == above.child_by_field_name("left")
    is_plain = whole.type == "identifier" and text_of(whole) not in ("np", "Math")
    return (text_of(whole), text_of(name)) if is_plain and not is_written else None


_FUNCTIONS = {"function_definition", "function_declaration", "method_definition"}
_READS = {"attribute", "field_expression", "member_expression"}
_UNWRAPPED = '(#any-of? @n "sqrt" "abs" "square" "fabs" "copy")'
# Calls whose first two arguments commute, or are obviously wrong when exchanged.
_IN_ORDER = '(#not-match? @n "^(f?min|f?max|minimum|maximum|dot|hypot|array_equal|isinstance|getattr|setattr|zip)$")'
_FACTOR = '(#any-of? @n "1000" "1000.0" "1e3" "1e6" "1e-3" "0.001" "100" "100.0" "60" "60.0" "180" "180.0")'
_AXIS = '(#match? @n "^(sum|mean|max|min|all|any|std|prod|norm|argmax|argmin|cumsum)$") (#eq? @k "axis")'
_CALL = "call function: [(identifier) @n (attribute attribute: (_) @n)] arguments:"
_PYTHON: dict[str, tuple[Rule, ...]] = {
    "": (
        ("[(binary_operator operator: _ @all) (boolean_operator operator: _ @all)]", _other_token),
        ("[(comparison_operator operators: _ @all) (augmented_assignment operator: _ @all)]", _other_token),
        ("(call function: [(identifier) @all (attribute attribute: (_) @all)])", _other_token),
        ('(binary_operator left: (_) @a operator: "@" right: (_) @b) @all', "({b}) @ ({a})"),
        ("[(unary_operator argument: (_) @a) (not_operator argument: (_) @a)] @all", "({a})"),
        ("[(integer) (float)] @all", _other_numbers),
        ("[(true) (false) (break_statement) (continue_statement)] @all", _other_token),
        ("[(if_statement condition: (_) @all) (elif_clause condition: (_) @all)]", "not ({all})"),
        ("[(if_clause (_) @all) (conditional_expression . (_) . (_) @all)]", "not ({all})"),
        ('(attribute object: (_) @a attribute: (_) @n (#any-of? @n "T" "mT")) @all', "{a}"),
        ('(subscript subscript: (_) @all (#any-of? @all "i" "j" "k" "n" "index" "leg"))', "{all} - 1"),
        (f"({_CALL} (_ . (_) @a .) {_UNWRAPPED}) @all", "({a})"),
        (f"({_CALL} (argument_list . (_) @a . (_) @b) {_IN_ORDER})", _swapped_arguments),
        ("[(expression_statement [(call) (augmented_assignment)]) (raise_statement)] @all", "pass"),
        ("(expression_statement (assignment left: [(attribute) (subscript)])) @all", "pass"),
    ),
    "swap": (
        ("[(tuple (_) @a . (_) @b) (list (_) @a . (_) @b) (expression_list (_) @a . (_) @b)]", _swapped),
        ("(dictionary (pair value: (_) @a) . (pair value: (_) @b))", _swapped),
        ("(subscript subscript: (_) @a . subscript: (_) @b)", _swapped),
        ("(argument_list (keyword_argument value: (_) @a) . (keyword_argument value: (_) @b))", _swapped),
    ),
    "name": (("(string (string_content) @all)", _other_name),),
    "option": (("(conditional_expression . (_) @a . (_) . (_) @b .) @all", "({a})", "({b})"),),
    "dropped": (
        ("(boolean_operator left: (_) @a right: (_) @b) @all", "{a}", "{b}"),
        ('(binary_operator (parenthesized_expression) @a ["|" "&"] (_) @b) @all', "{a}", "{b}"),
    ),
    "one side": (
        ("(comparison_operator . (_) @a . _ . (_) @b . _ . (_))", "{b}"),
        ("(comparison_operator (_) . _ . (_) @a . _ . (_) @b .)", "{a}"),
        (f'(comparison_operator . ({_CALL} (_ . (_) @a .)) @all (#eq? @n "abs"))', "-({a})"),
    ),
    "unit": (
        (f'({_CALL} (_ . (_) @a .) (#any-of? @n "radians" "degrees" "deg2rad" "rad2deg")) @all', "({a})"),
        (f'(binary_operator left: (_) @n operator: "*" right: (_) @a {_FACTOR}) @all', "({a})"),
        (f'(binary_operator left: (_) @a operator: ["*" "/"] right: (_) @n {_FACTOR}) @all', "({a})"),
    ),
    "frame": (('(binary_operator left: (_) @all operator: "@" (#not-match? @all "[.]m?T$"))', "({all}).T"),),
    "reduction": (
        (f'({_CALL} (_ "," @a . (keyword_argument name: (_) @k) @b) {_AXIS})', ""),
        (f"({_CALL} (_ . (keyword_argument name: (_) @k) @all) {_AXIS})", ""),
    ),
    "stale": (('(subscript "[" . (identifier) @all . "]")', "0"),),
    "block": (
        ('[(slice . (_) @all . ":") (slice ":" . (_) @all .)]', ""),
        (f'({_CALL} (_ . (_) @a .) (#eq? @n "range")) @all', "range(1, {a})", "range(({a}) - 1)"),
    ),
    "sibling": (("(attribute attribute: (_) @all) @whole", _sibling),),
}
# In the names that the grammar of C has; that of JavaScript has others for some.
_C_CALL = "call_expression function: [(identifier) @n (field_expression field: (_) @n)] arguments:"
_C: dict[str, tuple[Rule, ...]] = {
    "": (
        ("[(binary_expression operator: _ @all) (update_expression operator: _ @all)]", _other_token),
        ("(assignment_expression operator: _ @all)", _other_token),
        ("(call_expression function: [(identifier) @all (field_expression field: (_) @all)])", _other_token),
        ('(unary_expression operator: ["-" "!" "~"] argument: (_) @a) @all', "({a})"),
        ('((number_literal) @all (#not-match? @all "^-"))', _other_numbers),
        ("[(true) (false) (break_statement) (continue_statement)] @all", _other_token),
        ("(if_statement condition: (_) @all)", "(!{all})"),
        ("(conditional_expression condition: (_) @all)", "!({all})"),
        (f"({_C_CALL} (_ . (_) @a .) {_UNWRAPPED}) @all", "({a})"),
        (f"({_C_CALL} (argument_list . (_) @a . (_) @b) {_IN_ORDER})", _swapped_arguments),
        ("(expression_statement [(call_expression) (assignment_expression) (update_expression)]) @all", ";"),
    ),
    "swap": (
        ("(initializer_list (_) @a . (_) @b)", _swapped),
        ("(initializer_list (initializer_pair value: (_) @a) . (initializer_pair value: (_) @b))", _swapped),
    ),
    "name": (("(string_literal (string_content) @all)", _other_name),),
    "option": (("(conditional_expression consequence: (_) @a alternative: (_) @b) @all", "({a})", "({b})"),),
    "dropped": (('(binary_expression left: (_) @a operator: ["&&" "||"] right: (_) @b) @all', "{a}", "{b}"),),
    "one side": (
        (f'(binary_expression left: ({_C_CALL} (_ . (_) @a .)) @all operator: _ (#match? @n "^f?abs$"))', "-({a})"),
    ),
    "unit": (
        (f'(binary_expression left: (_) @a operator: ["*" "/"] right: (_) @n {_FACTOR}) @all', "({a})"),
        (f'(binary_expression left: (_) @n operator: "*" right: (_) @a {_FACTOR}) @all', "({a})"),
    ),
    "stale": (("(subscript_expression index: (identifier) @all)", "0"),),
    "block": (('(for_statement condition: (binary_expression operator: "<" right: (_) @all))', "{all} - 1"),),
    "sibling": (("(field_expression field: (_) @all) @whole", _sibling),),
}
_IN_JAVASCRIPT = {
    **{"number_literal": "number", "string_literal": "string", "string_content": "string_fragment"},
    **{"initializer_list (initializer_pair": "object (pair", "initializer_pair": "pair", "initializer_list": "array"},
    **{"conditional_expression": "ternary_expression", "argument_list": "arguments", "field:": "property:"},
    **{"field_expression": "member_expression", '["&&" "||"]': '["&&" "||" "??"]'},
    "(assignment_expression operator": "(augmented_assignment_expression operator",
    "(assignment_expression)": "(assignment_expression) (augmented_assignment_expression)",
}


def _in_javascript(rule: Rule) -> Rule:
    query, *texts = rule
    for name, other in _IN_JAVASCRIPT.items():
        query = query.replace(name, other)
    return query, *texts


_JAVASCRIPT = {mistake: tuple(map(_in_javascript, rules)) for mistake, rules in _C.items()}
_JAVASCRIPT[""] += (("(throw_statement) @all", ";"),)
# By the suffix of a source, and by the mistake that is imitated: "" for a change of tokens.
RULES = {".py": _PYTHON, ".c": _C, ".h": _C, ".js": _JAVASCRIPT}
