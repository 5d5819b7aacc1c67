"""Operations of JAX on numbers as operations of CasADi."""

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

MOVES: Mapping[str, Sequence[int]] = {
    **dict.fromkeys(("reshape", "squeeze", "expand_dims", "broadcast_in_dim"), (0,)),
    **dict.fromkeys(("transpose", "slice", "split", "unstack", "rev"), (0,)),
    **dict.fromkeys(("gather", "dynamic_slice"), (0,)),
    **dict.fromkeys(("concatenate", "stack"), ()),
    "pad": (0, 1),
    "scatter": (0, 2),
}
"""What only moves elements: which of its inputs hold them (none named: all), not where to."""

_SAME = (
    "sign floor ceil sqrt exp expm1 log log1p sin cos tan asin acos atan atan2 sinh cosh tanh"
    " eq ne lt le gt ge"
)
"""What both call alike."""
_PLAIN: Mapping[str, Operation] = {
    **{name: getattr(ca, name) for name in _SAME.split()},
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "abs": ca.fabs,
    "square": lambda x: x * x,
    "max": ca.fmax,
    "min": ca.fmin,
    "pow": ca.power,
    "rem": ca.fmod,
    "and": ca.logic_and,
    "or": ca.logic_or,
    "not": ca.logic_not,
    "clamp": lambda low, x, high: ca.fmin(ca.fmax(x, low), high),
    **dict.fromkeys(("stop_gradient", "copy", "copy_p"), lambda x: x),
}


def elementwise(name: str, params: Mapping[str, Any]) -> Operation | None:
    """Return what an operation of JAX does to each element, on expressions; None: it does not.

    Args:
        name: Of the operation.
        params: Its parameters.
    """
    match name:
        case "integer_pow":
            return lambda x: x ** params["y"]
        case "select_n":
            return _select
        case "convert_element_type" if np.issubdtype(params["new_dtype"], np.integer):
            return lambda x: ca.if_else(x < 0.0, ca.ceil(x), ca.floor(x))
        case "convert_element_type":  # all numbers are floats in the graph
            return lambda x: x
    return _PLAIN.get(name)


def _select(which: Any, *cases: Any) -> Any:
    found = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        found = ca.if_else(which <= float(number), cases[number], found)
    return found
