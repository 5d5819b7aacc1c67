"""Small expressions of the registry: conditions between the entries of one structure.

Comparisons, ``and``/``or``/``not``, ``+ - *``, numbers, texts, names of entries and
``given(name)``. Evaluated by walking the syntax tree: nothing else can be expressed.
"""

import ast
import functools
import operator
from collections.abc import Callable, Mapping
from typing import TypeAlias

Value: TypeAlias = int | float | str | bool
_Values: TypeAlias = Callable[[str], Value]
_Given: TypeAlias = Callable[[str], bool]

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
    *(ast.Name, ast.Load, ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.BinOp),
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
            if not _is_allowed(node):
                msg = f"expression {text!r} holds {type(node).__name__}"
                raise ValueError(msg)
        self._tree = tree

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
            return bool(_evaluated(self._tree, required, given))
        except UnknownValueError:
            return None


@functools.cache
def expression(text: str) -> Expression:
    """Return the parsed expression; each text is parsed once."""
    return Expression(text)


def _evaluated(node: ast.expr, value: _Values, given: _Given) -> Value:
    """Return the value of a part of an expression, given that of every name."""
    match node:
        case ast.Constant(value=int() | float() | str() as constant):
            return constant
        case ast.Name(id="true"):
            return True
        case ast.Name(id=name):
            return value(name)
        case ast.Call(args=[ast.Name(id=name)]):
            return given(name)
        case ast.UnaryOp(operand=operand):
            return not _evaluated(operand, value, given)
        case ast.BoolOp(op=op, values=parts):
            results = (_evaluated(part, value, given) for part in parts)
            return all(results) if isinstance(op, ast.And) else any(results)
        case ast.BinOp(left=left, op=op, right=right):
            first, second = (_evaluated(part, value, given) for part in (left, right))
            if isinstance(first, str) or isinstance(second, str):
                raise UnknownValueError
            return _ARITHMETIC[type(op)](first, second)
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            first, second = (_evaluated(part, value, given) for part in (left, right))
            if isinstance(first, str) != isinstance(second, str):
                if not isinstance(op, ast.Eq | ast.NotEq):
                    raise UnknownValueError
            return _COMPARISONS[type(op)](first, second)
    raise AssertionError  # refused by `_is_allowed`


def _is_allowed(node: ast.AST) -> bool:
    match node:
        case ast.Constant(value=constant):
            return isinstance(constant, int | float | str)
        case ast.Call(func=ast.Name(id="given"), args=[ast.Name()], keywords=[]):
            return True
        case ast.Compare(ops=operators):
            return len(operators) == 1
    return isinstance(node, _ALLOWED)
