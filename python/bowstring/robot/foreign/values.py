"""Values of assignments in scripts of other programs, computed without running their code.

Expressions have the syntax of Python; `matlab` and `cpp` bring other scripts into it. What is not
an assignment of numbers (loops, branches, functions of the script) is not read, and a name that it
may change is unknown afterwards.
"""

from __future__ import annotations

import ast
import contextlib
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError

__all__ = [
    "Call",
    "Function",
    "Unreadable",
    "Values",
    "cpp",
    "matlab",
    "number",
    "numbers",
    "python",
]

_MOST: Final = 10_000  # numbers of a value: far more than a robot has
_OPERATORS: Final[dict[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_PREFIXES: Final = ("", "np", "jnp", "onp", "numpy", "math", "std")
_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    name: getattr(np, name)
    for name in (
        *("sin", "cos", "tan", "sqrt", "abs", "deg2rad", "radians", "array", "asarray"),
        *("zeros_like", "ones_like", "sum", "stack", "concatenate"),
    )
}
_JOINS: Final = ("stack", "concatenate")
_BUILTINS: Final[dict[str, Callable[..., Any]]] = {
    "float": float,
    "int": int,
    "len": len,
    "tuple": list,
    "list": list,
    "zip": lambda *lists: [list(each) for each in zip(*lists, strict=False)],
}
_CONSTANTS: Final = {"pi": math.pi, "M_PI": math.pi, "True": True, "False": False, "None": None}


class Unreadable(Exception):
    """A value that is not a number, a list of numbers or a call that can be read."""


@dataclass(frozen=True)
class Call:
    """A call that makes an object of the other program; arguments that are unreadable are None."""

    name: str
    arguments: tuple[Any, ...]
    keywords: dict[str, Any]


@dataclass(frozen=True)
class Function:
    """A function of one variable, such as a radius along a link."""

    variable: str
    body: ast.expr
    values: Values

    def __call__(self, at: float) -> float:
        inner = Values(self.values.first, {**self.values.names, self.variable: at})
        return float(numbers(inner.of(self.body)).reshape(()))


def numbers(value: Any) -> NDArray[np.float64]:
    """Value as an array of floats; raise `Unreadable` if it is none."""
    count = 0
    stack = [value]
    while stack:  # before NumPy copies it, as lists may hold each other many times
        each = stack.pop()
        count += 1
        if isinstance(each, (list, tuple)):
            stack.extend(each)
        elif isinstance(each, np.ndarray):
            count += each.size
        elif isinstance(each, bool) or not isinstance(each, (float, int)):
            raise Unreadable
        if count + len(stack) > 3 * _MOST:
            raise Unreadable
    try:
        found = np.asarray(value, dtype=float)
    except (ValueError, OverflowError, RecursionError):
        raise Unreadable from None
    if not np.isfinite(found).all():
        raise Unreadable
    return found


def number(value: Any, where: str) -> float:
    """Value as a float; `InputError` begins with where it stands."""
    try:
        return float(numbers(value).reshape(()))
    except (Unreadable, ValueError):
        raise InputError(f"{where}: no number that stands in the file.") from None


@dataclass
class Values:
    """Known names, and the value of an expression.

    Attributes
    ----------
    first : int
        Index of the first entry of a list: 1 for MATLAB, whose lists are flat.
    names : dict
        Values by name.
    calls : list of Call
        Calls that were read, in their order.
    """

    first: int = 0
    names: dict[str, Any] = field(default_factory=dict)
    calls: list[Call] = field(default_factory=list)

    def assign(self, name: str, expression: str | ast.expr, index: int | None = None) -> None:
        """Assign an expression to a name, or to an entry of it; forget the name if unreadable."""
        try:
            value = self.of(expression)
            if index is not None:
                known = self.names.get(name, [])
                if not isinstance(known, (float, list, np.ndarray)):
                    raise Unreadable
                entries = list(np.atleast_1d(known) if isinstance(known, float) else known)
                if not 0 <= index - self.first <= min(len(entries), _MOST):
                    raise Unreadable
                entries[index - self.first : index - self.first + 1] = [value]
                value = entries
            self.names[name] = value
        except Unreadable:
            self.names.pop(name, None)

    def of(self, expression: str | ast.expr) -> Any:
        """Value of an expression; raise `Unreadable` if it cannot be computed."""
        try:
            if isinstance(expression, str):
                return self.of(_parsed(expression.strip(), "eval").body)
            with np.errstate(all="raise"):
                return self._of(expression)
        except (ArithmeticError, LookupError, MemoryError, RecursionError):
            raise Unreadable from None
        except (SyntaxError, TypeError, ValueError, AttributeError):
            raise Unreadable from None

    def known(self, node: ast.expr) -> Any:
        """Value of an expression, or None."""
        try:
            return self.of(node)
        except Unreadable:
            return None

    def _of(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            value = node.value
            return float(value) if isinstance(value, int) and abs(value) > 2**53 else value
        if isinstance(node, ast.Name):
            return self.names[node.id] if node.id in self.names else _CONSTANTS[node.id]
        if isinstance(node, ast.Attribute):
            return self._attribute(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            operand = numbers(self._of(node.operand))
            return _plain(-operand if isinstance(node.op, ast.USub) else operand)
        if isinstance(node, ast.BinOp):
            return self._operated(node)
        if isinstance(node, (ast.List, ast.Tuple)):
            values = [self._of(each) for each in node.elts]
            return self._flat(values) if self.first else values
        if isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
            return {str(self.known(k)): self.known(v) for k, v in pairs if k is not None}
        if isinstance(node, ast.Subscript):
            return self._entry(self._of(node.value), self._of(node.slice))
        if isinstance(node, ast.Lambda):
            used = {each.id for each in ast.walk(node.body) if isinstance(each, ast.Name)}
            known = {name: self.names[name] for name in used & self.names.keys()}
            return Function(node.args.args[0].arg, node.body, Values(self.first, known))
        if isinstance(node, (ast.ListComp, ast.GeneratorExp)):
            return self._comprehension(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        raise Unreadable

    def _operated(self, node: ast.BinOp) -> Any:
        sides = [self._of(node.left), self._of(node.right)]
        left, right = map(numbers, sides)
        if self.first:  # flat lists do not show which products are of matrices
            power = isinstance(node.right, ast.BinOp) and isinstance(node.right.op, ast.Pow)
            if min(left.size, right.size) > 1 or (power and isinstance(node.op, ast.Pow)):
                raise Unreadable
        elif any(isinstance(side, list) for side in sides):  # [a] * 3 repeats a list of Python
            raise Unreadable
        if math.prod(np.broadcast_shapes(left.shape, right.shape)) > _MOST:
            raise Unreadable
        return _plain(_OPERATORS[type(node.op)](left, right))

    def _attribute(self, node: ast.Attribute) -> Any:
        name = ast.unparse(node)
        if name in self.names:
            return self.names[name]
        owner, _, last = name.rpartition(".")
        if owner in _PREFIXES and last in _CONSTANTS:
            return _CONSTANTS[last]
        made = self.known(node.value)
        return made.keywords[last] if isinstance(made, Call) else name

    def _entry(self, values: Any, at: Any) -> Any:
        if isinstance(values, dict):
            return values[at]
        place = int(at) - self.first
        if place != at - self.first or place < 0:
            raise Unreadable
        entry = values[place]
        return _plain(entry) if isinstance(entry, np.generic) else entry

    @staticmethod
    def _flat(values: list[Any]) -> Any:
        """Entries of a list of MATLAB, numbers as one row."""
        try:
            rows = [numbers(value).ravel() for value in values]
        except Unreadable:
            return values
        if sum(map(len, rows)) > _MOST:
            raise Unreadable
        return np.concatenate(rows) if rows else []

    def _comprehension(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        (loop,) = node.generators
        places = self._of(loop.iter)
        inside = ast.walk(node.elt)
        nested = any(isinstance(each, (ast.ListComp, ast.GeneratorExp)) for each in inside)
        if loop.ifs or nested or len(places) > _MOST:
            raise Unreadable
        inner = Values(self.first, dict(self.names), self.calls)
        found = []
        for place in places:
            targets, parts = [loop.target], [place]
            if isinstance(loop.target, ast.Tuple):
                targets, parts = loop.target.elts, place
            for target, part in zip(targets, parts, strict=True):
                inner.names[ast.unparse(target)] = part
            found.append(inner._of(node.elt))
        return found

    def _call(self, node: ast.Call) -> Any:
        name = ast.unparse(node.func)
        if self.first and name in self.names:
            (at,) = node.args
            return self._entry(np.atleast_1d(self.names[name]), self._of(at))
        prefix, _, last = name.rpartition(".")
        arguments = [self.known(each) for each in node.args]
        keywords = {k.arg: self.known(k.value) for k in node.keywords if k.arg is not None}
        if prefix in _PREFIXES and last in ("ones", "zeros", "range", "arange"):
            return self._filled(last, arguments)
        if not prefix and name in _BUILTINS:
            return _BUILTINS[name](*arguments)
        if prefix in _PREFIXES and last in _FUNCTIONS:
            keywords = {k: int(v) for k, v in keywords.items() if k == "axis"}
            (given,) = arguments
            if last in _JOINS:
                given = [numbers(each) for each in given]
                if sum(map(np.size, given)) > _MOST:
                    raise Unreadable
            else:
                given = numbers(given)
            return _plain(numbers(_FUNCTIONS[last](given, **keywords)))
        made = Call(name, tuple(arguments), keywords)
        self.calls.append(made)
        return made

    def _filled(self, name: str, arguments: list[Any]) -> Any:
        sizes = [int(size) for size in np.ravel(numbers(arguments[0]))]
        if name in ("range", "arange"):
            (count,) = sizes
            if len(arguments) > 1 or not 0 <= count <= _MOST:
                raise Unreadable
            return np.arange(float(count)) if name == "arange" else list(range(count))
        if self.first:
            (rows,), columns = sizes, int(arguments[1])  # one size is a square matrix
            sizes = [rows * columns]
        if not 0 <= math.prod(sizes) <= _MOST or min(sizes, default=1) < 0:
            raise Unreadable
        return np.full(sizes, float(name == "ones"))


def _plain(value: Any) -> Any:
    """A number as a float, an array as it is."""
    return float(value) if np.ndim(value) == 0 else value


def _parsed(text: str, mode: str) -> Any:
    """Syntax tree of Python, without the parser's warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ast.parse(text, mode=mode)


def python(text: str) -> Values | None:
    """Read the assignments of a Python script outside functions; None if it is not Python."""
    values = Values()
    try:
        _statements(values, _parsed(text, "exec").body)
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        return None
    return values


def _statements(values: Values, body: list[ast.stmt]) -> None:
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'":
            _statements(values, node.body)
        elif isinstance(node, ast.Expr):
            values.known(node.value)
        elif isinstance(node, ast.Assign) and len(node.targets) == 1:
            (target,) = node.targets
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=False))
            for place, value in pairs:
                values.assign(ast.unparse(place), value)
        else:
            for part in ast.walk(node):
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                    values.names.pop(part.id, None)


_TOKEN: Final = re.compile(
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z]\w*(?:\.[A-Za-z]\w*)*)"
    r"|(?P<space>\s+)|(?P<sign>\.\^|\.\*|\./|\.'|==|[-+*/^()\[\]{},;=@'])"
)
_IN_PYTHON: Final = {".^": "**", "^": "**", ".*": "*", "./": "/", "{": "[", "}": "]"}
_BLOCK: Final = re.compile(r"(if|for|while|switch|try|parfor)\b")
_TARGET: Final = re.compile(
    r"([A-Za-z]\w*(?:\.[A-Za-z]\w*)*)\s*(?:[({]\s*(\d{1,5})\s*[)}])?\s*=(?!=)(.*)", re.DOTALL
)


def matlab(text: str, **known: float) -> Values:
    """Read the assignments of a MATLAB script outside branches and loops.

    ``known`` are values of names whatever the script assigns to them.
    """
    values, depth = Values(first=1), 0
    for statement in _matlab_statements(text):
        if _BLOCK.match(statement):
            depth += 1
            continue
        if re.fullmatch(r"end\w*", statement):
            depth = max(depth - 1, 0)
            continue
        found = _TARGET.fullmatch(statement)
        if found is None:
            for name in re.findall(r"\w+", statement.partition("=")[0]) if "=" in statement else ():
                values.names.pop(name, None)
            continue
        name, index, right = found.groups()
        if name in known:
            values.names[name] = known[name]
            continue
        expression = "" if depth else _in_python(right)
        values.assign(name, expression, int(index) if index else None)
    return values


def _matlab_statements(text: str) -> Iterator[str]:
    """Statements without comments, each in one piece, divided where no bracket is open."""
    text = re.sub(r"^\s*%\{\s*$.*?^\s*%\}\s*$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"%.*", "", re.sub(r"\.\.\..*\n", " ", text))
    depth, start = 0, 0
    for i, sign in enumerate(text + "\n"):
        depth += (sign in "([{") - (sign in ")]}")
        if (sign in ";," and depth <= 0) or (sign == "\n" and depth <= 0):
            if statement := text[start:i].strip():
                yield statement
            start, depth = i + 1, 0


def _in_python(text: str) -> str:
    """Expression of MATLAB in Python, its lists flat; empty if it has a matrix or more."""
    pieces: list[str] = []
    open_: list[str] = []
    separators = [set[str]()]
    kind, place, text = "", 0, text.strip()
    function = re.fullmatch(r"@\s*\(\s*(\w+)\s*\)(.*)", text, re.DOTALL)
    if function:
        body = _in_python(function[2])
        return f"lambda {function[1]}: {body}" if body else ""
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            return ""
        place, sign, of = token.end(), token.group(), str(token.lastgroup)
        ended = kind in ("number", "name", "closed")
        if of == "space":
            following = text[place : place + 2]
            begins = re.match(r"[\w.([{@]|[-+]\S", following)
            if open_ and open_[-1] in "[{" and ended and begins and "\n" not in sign:
                pieces.append(",")
                separators[-1].add(",")
                kind = "sign"
            if "\n" in sign and ended and open_:
                pieces.append(",")
                separators[-1].add(";")
                kind = "sign"
            continue
        if sign in ("'", ".'"):
            if not ended:
                word = re.compile(r"[^'\n\\]*'").match(text, place)
                if word is None:
                    return ""
                place, kind = word.end(), "closed"
                pieces.append(f"'{word.group()}")
            continue
        if sign in "([{":
            open_.append(sign)
            separators.append(set())
        elif sign in ")]}":
            if not open_ or separators.pop() == {",", ";"}:
                return ""
            open_.pop()
        elif sign in ",;" and open_ and open_[-1] in "[{":
            separators[-1].add(sign)
            sign = ","
        pieces.append(_IN_PYTHON.get(sign, sign))
        kind = "closed" if sign in ")]}" else of
    return "".join(pieces)


_CPP_LIST: Final = re.compile(r"=?\s*\{([^{};]*)\}\s*;")
_CPP_TARGET: Final = re.compile(r"(?:[^=]*[ >&*])?(\w+) ?(?:\[ ?(\d{1,5}) ?\])? ?=(?!=)(.*)")
_CPP_COMMA: Final = re.compile(r"(?:[^<]* )?(\w+) ?<<(.*)")  # of Eigen
_CPP_PUSH: Final = re.compile(r"(\w+)\.push_back\((.*)\)")
_CPP_CALL: Final = re.compile(r"\w+(?:\.|->)(\w+)(\(.*\))")
#: A quotient of whole numbers, which C++ rounds.
_CPP_WHOLE: Final = re.compile(r"(?<![\w.])(?<![eE][-+])\d+\s*/\s*\d+(?![\w.])")
_CPP_VECTOR: Final = re.compile(r"(?:.* )?vector ?<.*> ?(\w+)")


def cpp(text: str) -> Values:
    """Read the assignments and calls of C++ code, wherever they stand, one after the other."""
    values = Values()
    text = re.sub(r"//.*", " ", re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL))
    text = " ".join(text.replace("std::", "").split())
    for statement in re.split(r"[;{}]", _CPP_LIST.sub(r"= [\1];", text)):
        statement = statement.strip()
        if len(statement) > _MOST:
            continue
        if found := _CPP_PUSH.fullmatch(statement):
            name, value = found.groups()
            known = values.names.get(name)
            values.assign(name, value, len(known) if isinstance(known, list) else -1)
        elif found := _CPP_COMMA.fullmatch(statement):
            values.assign(found[1], f"[{found[2]}]")
        elif found := _CPP_TARGET.fullmatch(statement):
            name, index, right = found.groups()
            right = "" if _CPP_WHOLE.search(right) else right
            values.assign(name, right, int(index) if index else None)
        elif found := _CPP_CALL.fullmatch(statement):
            with contextlib.suppress(Unreadable):
                values.of(found[1] + found[2])
        elif found := _CPP_VECTOR.fullmatch(statement):
            values.names[found[1]] = []
    return values
