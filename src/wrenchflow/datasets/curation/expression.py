"""Conditions on a row of a table, as a person writes them: `contact_fraction > 0.1 and max_force < 40`.

The text is parsed by Python's own parser and walked over a short list of allowed nodes; nothing of it is ever run.
Logic is Kleene's, of three values: what is missing makes a condition unknown, not false, so that
`not (max_force > 40)` does not let in an episode whose force nobody knows. Unknown is not selected, and counted.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from wrenchflow.errors import ConfigError, unknown

_LONGEST = 4000  # Characters; deeper nesting than a person writes would exhaust Python's stack.
_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_ALLOWED = (
    "names of columns, numbers, texts in quotes, True and False, < <= > >= == !=, in [..], + - * /, and, or, not, "
    "has('kind of finding')"
)
# What a person may call a column of the quality table besides its own name.
ALIASES = {"peak_force_n": "max_force", "peak_force": "max_force"}

Row = Mapping[str, Any]
# Of a row: a number, a text, a truth, or None where it cannot be told.
Value = Callable[[Row], Any]


@dataclass(frozen=True, kw_only=True)
class Expression:
    """A condition.

    Attributes:
        text: As it was written.
        columns: The columns that it asks for.
    """

    text: str
    columns: frozenset[str]
    _value: Value

    def matches(self, row: Row) -> bool | None:
        """Whether it holds of a row; None where that cannot be told."""
        found = self._value(row)
        return None if found is None else bool(found)


def parse(text: str, available: Mapping[str, Any]) -> Expression:
    """Read a condition.

    Args:
        text: As a person writes it.
        available: The columns that there are, each with a value of its kind, or None where nobody knows any.

    Raises:
        ConfigError: If it is no condition, asks for a column that is not there, or compares a text with a number.
    """
    if len(text) > _LONGEST:
        raise ConfigError(f"the expression has {len(text)} characters, expected {_LONGEST} at most.")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        reader = _Reader(text, available)
        value = reader.read(tree.body)
    except SyntaxError as error:
        raise ConfigError(f"'{text}' is no expression: {error.msg}. Allowed are {_ALLOWED}.") from error
    except (RecursionError, MemoryError) as error:
        raise ConfigError("the expression is nested too deep.") from error
    return Expression(text=text, columns=frozenset(reader.columns), _value=value)


class _Reader:
    """Turns nodes into functions of a row."""

    def __init__(self, text: str, available: Mapping[str, Any]) -> None:
        self._text, self._available = text, available
        self.columns: set[str] = set()

    def read(self, node: ast.expr) -> Value:
        match node:
            case ast.BoolOp(op=ast.And(), values=values):
                return _all([self.read(each) for each in values])
            case ast.BoolOp(op=ast.Or(), values=values):
                return _any([self.read(each) for each in values])
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return _not(self.read(operand))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _both(lambda a, _: -a, self.read(operand), lambda row: 0)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _both(_ARITHMETIC[type(op)], self._number(left), self._number(right))
            case ast.Compare(left=left, ops=ops, comparators=others):
                sides = [left, *others]
                parts = [self._compare(sides[i], op, sides[i + 1]) for i, op in enumerate(ops)]
                return _all(parts) if len(parts) > 1 else parts[0]
            case ast.Constant(value=bool() | int() | float() | str() as constant):
                return lambda row: constant
            case ast.Name(id=name):
                return self._column(name)
            case ast.Call(func=ast.Name(id="has"), args=[ast.Constant(value=str() as kind)], keywords=[]):
                return lambda row: None if row.get("kinds") is None else kind in row["kinds"]
        raise ConfigError(
            f"'{ast.get_source_segment(self._text, node) or self._text}' is not allowed in an expression. "
            f"Allowed are {_ALLOWED}."
        )

    def _column(self, name: str) -> Value:
        name = name if name in self._available else ALIASES.get(name, name)
        if name not in self._available:
            raise ConfigError(unknown("column", name, self._available))
        self.columns.add(name)
        return lambda row: row.get(name)

    def _number(self, node: ast.expr) -> Value:
        if self._kind(node) is str:
            raise ConfigError(f"'{self._text}' reckons with a text, '{ast.unparse(node)}', expected a number.")
        return self.read(node)

    def _compare(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> Value:
        if isinstance(op, ast.In | ast.NotIn):
            if not isinstance(right, ast.List | ast.Tuple) or not all(isinstance(e, ast.Constant) for e in right.elts):
                raise ConfigError(f"'{self._text}': 'in' takes a list of values, as in task in ['a', 'b'].")
            members = [each.value for each in right.elts if isinstance(each, ast.Constant)]
            found = _both(lambda a, _: a in members, self.read(left), lambda row: 0)
            return _not(found) if isinstance(op, ast.NotIn) else found
        if type(op) not in _COMPARE:
            raise ConfigError(f"'{self._text}' compares by something else than < <= > >= == != in.")
        kinds = {self._kind(left), self._kind(right)} - {None}
        if len(kinds) > 1:
            raise ConfigError(
                f"'{self._text}' compares '{ast.unparse(left)}' with '{ast.unparse(right)}': a text with a number."
            )
        return _both(_COMPARE[type(op)], self.read(left), self.read(right))

    def _kind(self, node: ast.expr) -> type | None:
        """Text, number, or None where that is not known: a truth is a number."""
        value: Any = None
        if isinstance(node, ast.Constant):
            value = node.value
        elif isinstance(node, ast.Name):
            value = self._available.get(node.id, self._available.get(ALIASES.get(node.id, ""), None))
        elif isinstance(node, ast.BinOp | ast.UnaryOp | ast.Compare | ast.BoolOp | ast.Call):
            return float
        return None if value is None else (str if isinstance(value, str) else float)


def _both(function: Callable[[Any, Any], Any], left: Value, right: Value) -> Value:
    """Of two values; unknown where one is, where something is divided by zero, and where the result is no number."""

    def value(row: Row) -> Any:
        a, b = left(row), right(row)
        if a is None or b is None:
            return None
        try:
            found = function(a, b)
        except (ZeroDivisionError, OverflowError, TypeError):
            return None
        return None if found != found else found

    return value


def _not(of: Value) -> Value:
    def value(row: Row) -> bool | None:
        found = of(row)
        return None if found is None else not found

    return value


def _all(parts: list[Value]) -> Value:
    def value(row: Row) -> bool | None:
        found = [part(row) for part in parts]
        if any(each is not None and not each for each in found):
            return False
        return None if None in found else True

    return value


def _any(parts: list[Value]) -> Value:
    def value(row: Row) -> bool | None:
        found = [part(row) for part in parts]
        if any(found):
            return True
        return None if None in found else False

    return value
