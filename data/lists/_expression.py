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
        self._tree = ast.parse(text, mode="eval").body
        self.names = tuple(
            dict.fromkeys(
                node.id
                for node in ast.walk(self._tree)
                if isinstance(node, ast.Name) and node.id not in ("given", "true")
            )
        )
        """Entries that the expression looks at, in order."""
        for node in ast.walk(self._tree):
            if not isinstance(node, _ALLOWED):
                msg = f"expression {text!r} holds {type(node).__name__}"
                raise ValueError(msg)

    def holds(
        self, value: Callable[[str], Value | None], given: Callable[[str], bool]
    ) -> bool | None:
        """Return whether the condition holds; None where an entry cannot be read.

        Args:
            value: Value of an entry by its name, with the default where it is missing.
            given: Whether an entry stands in the list and is not 0.
        """

        def known(name: str) -> Value:
            found = value(name)
            if found is None:
                raise UnknownValueError(name)
            return found

        try:
            return bool(_evaluate(self._tree, known, given))
        except UnknownValueError:
            return None


@functools.cache
def expression(text: str) -> Expression:
    """Return the parsed expression; each text is parsed once."""
    return Expression(text)


def _evaluate(
    node: ast.expr, value: Callable[[str], Value], given: Callable[[str], bool]
) -> Value:
    match node:
        case ast.Constant(value=int() | float() | str() as constant):
            return constant
        case ast.Name(id="true"):
            return True
        case ast.Name(id=name):
            return value(name)
        case ast.Call(func=ast.Name(id="given"), args=[ast.Name(id=name)]):
            return given(name)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return not _evaluate(operand, value, given)
        case ast.BoolOp(op=ast.And(), values=parts):
            return all(_evaluate(part, value, given) for part in parts)
        case ast.BoolOp(op=ast.Or(), values=parts):
            return any(_evaluate(part, value, given) for part in parts)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            first, second = (_evaluate(side, value, given) for side in (left, right))
            if isinstance(first, str) or isinstance(second, str):
                raise UnknownValueError
            return _ARITHMETIC[type(op)](first, second)
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            first, second = (_evaluate(side, value, given) for side in (left, right))
            if isinstance(first, str) != isinstance(second, str) and not isinstance(
                op, ast.Eq | ast.NotEq
            ):
                raise UnknownValueError
            return _COMPARISONS[type(op)](first, second)
        case _:
            msg = f"expression holds {ast.unparse(node)!r}, which is not allowed"
            raise ValueError(msg)
