"""A small interpreter of Structured Text, to run what a job writes as the PLC would.

It knows declared variables and strict types only, so that what it runs is declared, typed
and closed as IEC 61131-3 asks.
"""

import operator
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

_TOKEN = re.compile(
    r"\s+|\(\*.*?\*\)|(?P<literal>16#[0-9A-F]+|T#\d+s|\d+\.\d+|\d+|'[^']*')"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<sign>:=|>=|<=|<>|\.\.|[-+*/()\[\],;:<>=.])",
    re.S,
)
_WHOLE = ("INT", "DINT", "UDINT")
_START: dict[str, Any] = {"LREAL": 0.0, "BOOL": False, "T_AMSNETID": ""}
_START |= dict.fromkeys(_WHOLE, 0)
Env = dict[str, Any]
Code = Callable[[Env], Any]


class Program:
    """Function blocks of a file; `new` makes an instance of one."""

    def __init__(self, text: str, library: dict[str, Callable[[], Any]]) -> None:
        assert text.isascii()
        self.tokens = list(_tokens(text))
        self.library = {name.upper(): make for name, make in library.items()}
        self.blocks: dict[str, tuple[dict[str, Any], Code]] = {}
        while self.tokens:
            self.take("FUNCTION_BLOCK")
            name = self.word()
            declared: dict[str, Any] = {}
            while self.peek() == "VAR" or self.peek().startswith("VAR_"):
                self.section(declared)
            self.declared = declared
            body = self.statements(("END_FUNCTION_BLOCK",))
            self.take("END_FUNCTION_BLOCK")
            self.blocks[name] = (declared, body)

    def new(self, name: str) -> Any:
        if name.upper() in self.library:
            return self.library[name.upper()]()
        declared, body = self.blocks[name.upper()]
        return Block(self, declared, body)

    def peek(self) -> str:
        return self.tokens[0].upper() if self.tokens else ""

    def take(self, *expected: str) -> str:
        token = self.tokens.pop(0)
        assert not expected or token.upper() in expected, (token, expected)
        return token

    def word(self) -> str:
        token = self.take().upper()
        # No doubled underscore, and none at the end.
        assert re.fullmatch(r"_?[A-Z](_?[A-Z0-9])*", token), token
        return token

    def section(self, declared: dict[str, Any]) -> None:
        self.take("VAR", "VAR_INPUT", "VAR_OUTPUT")
        if self.peek() == "CONSTANT":
            self.take()
        while self.peek() != "END_VAR":
            name = self.word()
            assert name not in declared, name
            self.take(":")
            size = None
            if self.peek() == "ARRAY":
                self.take()
                self.take("[")
                assert self.take() == "0"
                self.take("..")
                size = int(self.take()) + 1
                self.take("]")
                self.take("OF")
            kind, start = self.word(), None
            if self.peek() == ":=":
                self.take()
                start = self.array() if size else self.expression()({})
            if size is not None:
                assert len([check(kind, value) for value in start or []]) == size
            elif start is not None:
                check(kind, start)
            declared[name] = (kind, start)
            self.take(";")
        self.take("END_VAR")

    def array(self) -> list[Any]:
        self.take("[")
        values = [self.expression()({})]
        while self.take(",", "]") == ",":
            values.append(self.expression()({}))
        return values

    def statements(self, ends: tuple[str, ...]) -> Code:
        found: list[Code] = []
        while self.peek() not in ends and not self.tokens[0].isdigit():
            found.append(self.statement())
        return lambda env: [each(env) for each in found]

    def statement(self) -> Code:
        kinds = {"IF": self.if_, "WHILE": self.while_, "CASE": self.case}
        if self.peek() in kinds:
            return kinds[self.take().upper()]()
        name = self.word()
        assert name in self.declared, name
        if self.peek() == "(":
            given = self.arguments()
            self.take(";")
            return lambda env: env[name].call(
                {key: (value, env) for key, value in given.items()}
            )
        kind = self.declared[name][0]
        self.take(":=")
        value = self.expression()
        self.take(";")

        def assign(env: Env) -> None:
            env[name] = check(kind, value(env))

        return assign

    def arguments(self) -> dict[str, Code]:
        self.take("(")
        given: dict[str, Code] = {}
        while True:
            name = self.word()
            self.take(":=")
            given[name] = self.expression()
            if self.take(",", ")") == ")":
                return given

    def if_(self) -> Code:
        branches: list[tuple[Code, Code]] = []
        while True:
            test = self.expression()
            self.take("THEN")
            branches.append((test, self.statements(("ELSIF", "ELSE", "END_IF"))))
            word = self.take("ELSIF", "ELSE", "END_IF").upper()
            if word == "ELSE":
                branches.append((lambda env: True, self.statements(("END_IF",))))
                self.take("END_IF")
            if word != "ELSIF":
                break
        self.take(";")

        def run(env: Env) -> None:
            for test, body in branches:
                if check("BOOL", test(env)):
                    body(env)
                    return

        return run

    def while_(self) -> Code:
        test = self.expression()
        self.take("DO")
        body = self.statements(("END_WHILE",))
        self.take("END_WHILE")
        self.take(";")

        def run(env: Env) -> None:
            while check("BOOL", test(env)):
                body(env)

        return run

    def case(self) -> Code:
        of = self.expression()
        self.take("OF")
        branches: dict[int, Code] = {}
        while self.peek() != "END_CASE":
            label = int(self.take())
            self.take(":")
            branches[label] = self.statements(("END_CASE",))
        self.take("END_CASE")
        self.take(";")
        return lambda env: branches[of(env)](env)

    def expression(self) -> Code:
        return self.binary(0)

    _LEVELS = (("OR",), ("AND",), (">=", "<=", "<>", ">", "<", "="), "+-", "*/")

    def binary(self, level: int) -> Code:
        if level == len(self._LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while self.peek() in self._LEVELS[level]:
            sign = self.take().upper()
            right = self.binary(level + 1)
            left = _joined(sign, left, right)
        return left

    def unary(self) -> Code:
        if self.peek() not in ("NOT", "-"):
            return self.primary()
        sign, inner = self.take().upper(), self.unary()
        if sign == "-":
            return lambda env: -inner(env)
        return lambda env: not check("BOOL", inner(env))

    def primary(self) -> Code:
        token = self.take()
        if token == "(":
            inner = self.expression()
            self.take(")")
            return inner
        if not re.match(r"[A-Za-z_]", token) or token.startswith("T#"):
            value = _literal(token)
            return lambda env: value
        name = token.upper()
        if name in ("TRUE", "FALSE"):
            return lambda env: name == "TRUE"
        if name == "ADR":
            self.take("(")
            of = self.word()
            assert of in self.declared, of
            self.take(")")
            return lambda env: (env, of)
        if name in _FUNCTIONS:
            self.take("(")
            inside = [self.expression()]
            while self.take(",", ")") == ",":
                inside.append(self.expression())
            return lambda env: _FUNCTIONS[name](*(each(env) for each in inside))
        assert name in self.declared, name
        if self.peek() == "[":
            self.take()
            index = self.expression()
            self.take("]")
            return lambda env: env[name][check("INT", index(env))]
        if self.peek() == ".":
            self.take()
            field = self.word()
            return lambda env: env[name].env[field]
        return lambda env: env[name]


class Block:
    """An instance of a function block."""

    def __init__(self, program: Program, declared: dict[str, Any], body: Code) -> None:
        self.declared, self.body = declared, body
        self.env: Env = {}
        for name, (kind, start) in declared.items():
            if start is None:
                start = _START[kind] if kind in _START else program.new(kind)
            self.env[name] = list(start) if isinstance(start, list) else start

    def call(self, given: dict[str, tuple[Code, Env]]) -> None:
        for name, (value, env) in given.items():
            self.env[name] = check(self.declared[name][0], value(env))
        self.body(self.env)

    def cycle(self, **given: Any) -> Env:
        self.call({k.upper(): (lambda env, v=v: v, {}) for k, v in given.items()})
        return self.env


def check(kind: str, value: Any) -> Any:
    """Return a value that has this type; IEC converts none of these silently."""
    if kind == "BOOL":
        assert isinstance(value, bool), (kind, value)
    elif kind in _WHOLE:
        assert type(value) is int, (kind, value)
    elif kind == "LREAL":
        assert type(value) is float, (kind, value)
    return value


def _tokens(text: str) -> Iterator[str]:
    at = 0
    while at < len(text):
        hit = _TOKEN.match(text, at)
        assert hit is not None, text[at : at + 30]
        at = hit.end()
        if hit.lastgroup is not None:
            yield hit[0]


def _literal(token: str) -> Any:
    if token.startswith("'"):
        return token[1:-1]
    if token.startswith("T#"):
        return token
    if token.startswith("16#"):
        return int(token[3:], 16)
    return float(token) if "." in token else int(token)


def _joined(sign: str, left: Code, right: Code) -> Code:
    def run(env: Env) -> Any:
        a, b = left(env), right(env)
        assert type(a) is type(b), (a, sign, b)
        return _SIGNS[sign](a, b)

    return run


_SIGNS: dict[str, Callable[[Any, Any], Any]] = {
    ">=": operator.ge, "<=": operator.le, "<>": operator.ne, ">": operator.gt,
    "<": operator.lt, "=": operator.eq, "+": operator.add, "-": operator.sub,
    "*": operator.mul, "/": operator.truediv,
    "OR": lambda a, b: check("BOOL", a) or b,
    "AND": lambda a, b: check("BOOL", a) and b,
}  # fmt: skip
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "LIMIT": lambda low, value, high: min(max(value, low), high),
    "LREAL_TO_DINT": lambda value: round(check("LREAL", value)),
    "DINT_TO_LREAL": lambda value: float(check("DINT", value)),
    "SIZEOF": lambda value: {float: 8, int: 4, bool: 1}[type(value)],
}


@pytest.fixture
def program() -> Callable[..., Program]:
    """Return what reads the text of function blocks, with a library beside them."""
    return Program
