"""Small expressions of the registry: conditions between the entries of one structure.

Comparisons, ``and``/``or``/``not``, ``+ - *``, numbers, texts, names of entries and
``given(name)``. Made into functions by walking the syntax tree: nothing else can be expressed.
"""

import ast
import functools
import operator
from collections.abc import Callable, Mapping
from typing import TypeAlias

Value: TypeAlias = int | float | str | bool
_Values: TypeAlias = Callable[[str], Value]
_Given: TypeAlias = Callable[[str], bool]
_Step: TypeAlias = Callable[[_Values, _Given], Value]

_ARITHMETIC: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Value, Value], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}

_ALLOWED = (
    *(ast.Constant, ast.Name, ast.Load, ast.Call, ast.Compare),
    *(ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.BinOp),
    *_ARITHMETIC,
    *_COMPARISONS,
)


class UnknownValueError(Exception):
    """An entry that the expression needs cannot be read: nothing can be said."""


class Expression:
    """A condition, ready to be evaluated."""

    def __init__(self, text: str) -> None:
        """Parse ``text``.

        Raises:
            ValueError: If it holds anything that the module does not name.
        """
        self.text = text
        tree = ast.parse(text, mode="eval").body
        self.names = tuple(
            dict.fromkeys(
                node.id
                for node in ast.walk(tree)
                if isinstance(node, ast.Name) and node.id not in ("given", "true")
            )
        )
        """Entries that the expression looks at, in order."""
        for node in ast.walk(tree):
            if not isinstance(node, _ALLOWED):
                msg = f"expression {text!r} holds {type(node).__name__}"
                raise ValueError(msg)
        self._evaluate = _compiled(tree)

    def holds(
        self, value: Callable[[str], Value | None], given: Callable[[str], bool]
    ) -> bool | None:
        """Return whether the condition holds; None where an entry cannot be read.

        Args:
            value: Value of an entry by its name, with the default where it is missing.
            given: Whether an entry stands in the list and is not 0.
        """

        def required(name: str) -> Value:
            content = value(name)
            if content is None:
                raise UnknownValueError(name)
            return content

        try:
            return bool(self._evaluate(required, given))
        except UnknownValueError:
            return None


@functools.cache
def expression(text: str) -> Expression:
    """Return the parsed expression; each text is parsed once."""
    return Expression(text)


def _compiled(node: ast.expr) -> _Step:
    """Return what tells the value of an expression, given that of every name."""
    match node:
        case ast.Constant(value=int() | float() | str() as constant):
            return lambda value, given: constant
        case ast.Name(id="true"):
            return lambda value, given: True
        case ast.Name(id=name):
            return lambda value, given: value(name)
        case ast.Call(func=ast.Name(id="given"), args=[ast.Name(id=name)]):
            return lambda value, given: given(name)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            inner = _compiled(operand)
            return lambda value, given: not inner(value, given)
        case ast.BoolOp(op=ast.And(), values=parts):
            steps = list(map(_compiled, parts))
            return lambda value, given: all(step(value, given) for step in steps)
        case ast.BoolOp(op=ast.Or(), values=parts):
            steps = list(map(_compiled, parts))
            return lambda value, given: any(step(value, given) for step in steps)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            return _calculated(_ARITHMETIC[type(op)], _compiled(left), _compiled(right))
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _compared(op, _compiled(left), _compiled(right))
        case _:
            msg = f"expression holds {ast.unparse(node)!r}, which is not allowed"
            raise ValueError(msg)


def _calculated(
    operation: Callable[[float, float], float], left: _Step, right: _Step
) -> _Step:
    def calculated(value: _Values, given: _Given) -> Value:
        first, second = left(value, given), right(value, given)
        if isinstance(first, str) or isinstance(second, str):
            raise UnknownValueError
        return operation(first, second)

    return calculated


def _compared(operator_: ast.cmpop, left: _Step, right: _Step) -> _Step:
    holds = _COMPARISONS[type(operator_)]
    any_kind = isinstance(operator_, ast.Eq | ast.NotEq)

    def compared(value: _Values, given: _Given) -> Value:
        first, second = left(value, given), right(value, given)
        if isinstance(first, str) != isinstance(second, str) and not any_kind:
            raise UnknownValueError
        return holds(first, second)

    return compared
