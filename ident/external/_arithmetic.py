"""Operations of JAX on numbers as operations of CasADi."""

import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

Operation = Callable[..., Any]

REDUCTIONS: Mapping[str, Operation] = {
    "reduce_sum": operator.add,
    "reduce_prod": operator.mul,
    "reduce_max": ca.fmax,
    "reduce_min": ca.fmin,
    "reduce_and": ca.logic_and,
    "reduce_or": ca.logic_or,
}

MOVES: Mapping[str, Sequence[int] | None] = {
    "reshape": (0,),
    "squeeze": (0,),
    "expand_dims": (0,),
    "broadcast_in_dim": (0,),
    "transpose": (0,),
    "slice": (0,),
    "split": (0,),
    "unstack": (0,),
    "rev": (0,),
    "gather": (0,),
    "dynamic_slice": (0,),
    "pad": (0, 1),
    "scatter": (0, 2),
    "concatenate": None,
    "stack": None,
}
"""What only moves elements: which of its inputs hold them (None: all), and not where to."""

_PLAIN: Mapping[str, Operation] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "abs": ca.fabs,
    "sign": ca.sign,
    "floor": ca.floor,
    "ceil": ca.ceil,
    "sqrt": ca.sqrt,
    "square": lambda x: x * x,
    "exp": ca.exp,
    "expm1": ca.expm1,
    "log": ca.log,
    "log1p": ca.log1p,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "atan2": ca.atan2,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "max": ca.fmax,
    "min": ca.fmin,
    "pow": ca.power,
    "rem": ca.fmod,
    "eq": ca.eq,
    "ne": ca.ne,
    "lt": ca.lt,
    "le": ca.le,
    "gt": ca.gt,
    "ge": ca.ge,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "not": ca.logic_not,
    "clamp": lambda low, x, high: ca.fmin(ca.fmax(x, low), high),
    "stop_gradient": lambda x: x,
    "copy": lambda x: x,
    "copy_p": lambda x: x,
}


def _plain(operation: Operation, _: Mapping[str, Any]) -> Operation:
    return operation


def _converted(params: Mapping[str, Any]) -> Operation:
    """Return the conversion to another type; all numbers are floats in the graph."""
    if np.issubdtype(params["new_dtype"], np.integer):
        return lambda x: ca.if_else(x < 0.0, ca.ceil(x), ca.floor(x))
    return lambda x: x


def _integer_power(params: Mapping[str, Any]) -> Operation:
    return lambda x: x ** params["y"]


def _select(which: Any, *cases: Any) -> Any:
    found = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        found = ca.if_else(which <= float(number), cases[number], found)
    return found


ELEMENTWISE: Mapping[str, Callable[[Mapping[str, Any]], Operation]] = {
    **{name: functools.partial(_plain, one) for name, one in _PLAIN.items()},
    "convert_element_type": _converted,
    "select_n": lambda _: _select,
    "integer_pow": _integer_power,
}
"""By name of the operation: from its parameters to the same on expressions."""
