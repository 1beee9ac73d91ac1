"""Numbers and calls in scripts of other programs, computed without running the scripts.

`matlab` and `cpp` bring a script into Python's syntax, of which only arithmetic with numbers, lists
and arrays is computed. A name that a loop, a branch or anything else may change is unknown: None.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.validation import floats

_MOST: Final = 1000  # numbers of an array
_STEPS: Final = 20_000  # of a file; public ones need fewer than 1000
_LONGEST: Final = 5000  # characters of a statement


@dataclass(frozen=True)
class Call:
    """A call of the other program; None for a value that is not computed."""

    name: str
    """Name with its dots, as the script writes it."""
    arguments: list[Any]
    """Values of the arguments without a name."""
    keywords: dict[str, Any]
    """Values of the others, by name."""


def numbers(value: Any) -> Floats:
    """Value as an array of finite floats; ValueError if it is not one."""
    try:
        found = floats(value)
    except TypeError as error:
        raise ValueError from error
    if not np.isfinite(found).all():
        raise ValueError
    return found


def _each(name: str) -> Callable[[Any], Any]:
    return lambda value: getattr(np, name)(numbers(value))


def _full(sizes: Any, value: float) -> Any:
    if not 0 <= math.prod(np.ravel(sizes)) <= _MOST:
        raise ValueError
    return np.full([int(size) for size in np.ravel(sizes)], value)


_OPERATORS: Final = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}
_CPP: Final[dict[str, Callable[..., Any]]] = {n: _each(n) for n in ("cos", "sin", "sqrt")}
_MATLAB: Final = _CPP | {
    "ones": lambda rows, columns: _full([rows, columns], 1.0),
    "sum": lambda row: np.sum(row) if min(np.shape(row)) == 1 else None,
    "matrix": lambda rows: np.block([[numbers(each) for each in row] for row in rows if row]),
}
_PYTHON: Final = _CPP | {
    **{name: _each(name) for name in ("deg2rad", "array", "asarray", "zeros_like")},
    "ones": lambda shape: _full(shape, 1.0),
    "zeros": lambda shape: _full(shape, 0.0),
    "stack": lambda parts, axis=0: np.stack([numbers(each) for each in parts], int(axis)),
    "concatenate": lambda parts: np.concatenate([numbers(each) for each in parts]),
    "float": lambda value: numbers(value) if np.ndim(value) == 0 else None,
    "int": np.trunc,
    "range": lambda count: list(np.arange(float(_full(count, 0.0).size))),
    "zip": lambda *lists: [list(each) for each in zip(*lists, strict=False)],
    "tuple": list,
}
_MODULES: Final = ("", "np", "jnp", "onp", "math")


class Values:
    """Names and calls of a script; `label` begins the message of an error."""

    def __init__(self, label: str, functions: dict[str, Callable[..., Any]]) -> None:
        self.label, self.functions, self.is_matlab = label, functions, functions is _MATLAB
        self.names: dict[str, Any] = {"pi": math.pi, "M_PI": math.pi}
        self.calls: list[Call] = []
        self._steps = 0

    def get(self, node: ast.expr) -> Any:
        """Value of an expression; None if it is not computed."""
        try:
            with np.errstate(all="raise"):
                return self._of(node)
        except InputError:
            raise
        except (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError):
            return None
        except (TypeError, ValueError):
            return None

    def lines(self, statements: Iterable[str]) -> Values:
        """Take statements one by one; the names in those that are not Python become unknown."""
        for statement in statements:
            self._count(5 + len(statement) // 10)
            if (body := _parsed(statement.strip())) is not None:
                self.run(body)
                continue
            for name in re.findall(r"\w+", statement.rpartition("=")[0] or statement):
                self.names.pop(name, None)
        return self

    def run(self, body: list[ast.stmt]) -> None:
        """Take the assignments and calls of statements."""
        for node in body:
            match node:
                case ast.If(test=ast.Compare(left=ast.Name(id="__name__"), ops=[ast.Eq()])):
                    self.run(node.body)
                case ast.Assign(targets=targets, value=value):
                    found = self.get(value)
                    for target in targets:
                        self._assign(target, found)
                case ast.AnnAssign(target=target, value=ast.expr() as value):
                    self._assign(target, self.get(value))
                case ast.Expr(
                    ast.Call(ast.Attribute(value=ast.Name(name), attr="append"), args=[entry])
                ):
                    self._change(name, math.inf, self.get(entry))
                case ast.FunctionDef() | ast.ClassDef():
                    pass
                case _:
                    if isinstance(node, ast.Expr):
                        self.get(node.value)
                    self._forget(node)

    def _forget(self, node: ast.AST) -> None:
        """Make the names unknown that a statement or target may change."""
        for part in ast.walk(node):
            match part:
                case (
                    ast.Name(id=name, ctx=ast.Store())
                    | ast.Subscript(value=ast.Name(id=name), ctx=ast.Store())
                    | ast.Subscript(value=ast.Subscript(value=ast.Name(id=name)), ctx=ast.Store())
                    | ast.Call(func=ast.Attribute(value=ast.Name(id=name)))
                    | ast.Call(func=ast.Attribute(value=ast.Subscript(value=ast.Name(id=name))))
                ):
                    self.names.pop(name, None)

    def _count(self, steps: int) -> None:
        self._steps += steps
        if self._steps > _STEPS:
            raise InputError(
                f"{self.label}: too much to compute; keep only the robot's parameters in it."
            )

    def _assign(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self.names[name] = value
            case ast.Subscript(value=ast.Name(id=name), slice=at):
                self._change(name, self.get(at), value)
            case ast.Tuple(elts=parts):
                fits = isinstance(value, list) and len(value) == len(parts)
                for part, each in zip(parts, value if fits else [None] * len(parts), strict=True):
                    self._assign(part, each)
            case _:
                self._forget(target)

    def _change(self, name: str, index: Any, value: Any) -> None:
        """Set an entry of a copy, as calls may have the former list; at infinity append it."""
        entries = self.names.get(name, [] if self.functions is _CPP else None)
        self.names[name] = None
        if isinstance(entries, list) and isinstance(index, float):
            self._count(len(entries))
            place = len(entries) if index == math.inf else int(index)
            if 0 <= place <= len(entries):
                self.names[name] = [*entries[:place], value, *entries[place + 1 :]]

    def _of(self, node: ast.expr) -> Any:
        return self._counted(self._computed(node))

    def _counted(self, value: Any) -> Any:
        self._count(1 + np.size(value) // 100 if isinstance(value, np.ndarray) else 1)
        if isinstance(value, np.ndarray) and value.size > _MOST:
            raise ValueError
        for each in value if isinstance(value, list) else ():
            self._counted(each)
        return value

    def _computed(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() as value):
                return value
            case ast.Constant(value=int() | float() as value):
                return float(value)
            case ast.Name(id=name):
                return self.names[name]
            case ast.Attribute(attr="pi"):
                return math.pi
            case ast.Attribute(value=owner, attr="T"):
                return numbers(self._of(owner)).T
            case ast.UnaryOp(op=op, operand=operand):
                return _OPERATORS[type(op)](numbers(self._of(operand)))
            case ast.BinOp():
                return self._operated(node)
            case ast.List(elts=parts):
                return [self.get(part) for part in parts]
            case ast.Tuple(elts=parts) if not self.is_matlab:
                return [self.get(part) for part in parts]
            case ast.Dict(keys=keys, values=values):
                pairs = zip(keys, values, strict=True)
                return {self._of(key): self.get(value) for key, value in pairs if key}
            case ast.Subscript(value=owner, slice=at):
                return _entry(self._of(owner), self._of(at))
            case ast.ListComp(generators=[loop]) | ast.GeneratorExp(generators=[loop]):
                return self._repeated(node.elt, loop)
            case ast.Call():
                return self._called(node)
        raise ValueError

    def _operated(self, node: ast.BinOp) -> Any:
        sides = self._of(node.left), self._of(node.right)
        if list in map(type, sides):  # Python repeats and joins lists
            raise ValueError
        left, right = map(numbers, sides)
        # no products and powers of matrices; MATLAB computes a^b^c from the left
        if isinstance(node.op, ast.Pow):
            chained = any(isinstance(part, ast.Pow) for part in ast.walk(node.right))
            single = left.size == right.size == 1 and not chained
        elif isinstance(node.op, ast.Mult):
            single = 1 in (left.size, right.size)
        else:
            single = right.size == 1 or not isinstance(node.op, ast.Div)
        if not single:
            raise ValueError
        return _OPERATORS[type(node.op)](left, right)

    def _repeated(self, element: ast.expr, loop: ast.comprehension) -> list[Any]:
        if loop.ifs:
            raise ValueError
        names, found = dict(self.names), []
        for value in self._of(loop.iter):
            self._assign(loop.target, value)
            found.append(self.get(element))
        self.names = names
        return found

    def _called(self, node: ast.Call) -> Any:
        name = _dotted(node.func)
        arguments = [self.get(each) for each in node.args]
        if self.is_matlab and name in self.names:
            return _entry(np.ravel(self.names[name], "F"), *(at - 1 for at in arguments))
        keywords = {each.arg: self.get(each.value) for each in node.keywords if each.arg}
        module, _, last = name.rpartition(".")
        if last in self.functions and module in _MODULES:
            return self.functions[last](*arguments, **keywords)
        self.calls.append(Call(name, arguments, keywords))
        return self.calls[-1]


def _parsed(text: str) -> list[ast.stmt] | None:
    """Statements of Python; None for text that is not Python."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # such as of unknown escapes in strings
            return ast.parse(text).body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        return None


def _entry(values: Any, at: Any) -> Any:
    if isinstance(values, dict):
        return values[at]
    if at % 1 or at < 0:
        raise ValueError
    return values[int(at)]


def _dotted(node: ast.expr) -> str:
    """Name of a function, such as ``jnp.cos``."""
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return getattr(node, "id", "?")


def python(text: str, label: str) -> Values:
    """Values of a Python script outside functions, loops and branches."""
    body = _parsed(text)
    if body is None:
        raise InputError(f"{label}: not valid Python.")
    values = Values(label, _PYTHON)
    values.run(body)
    return values


def matlab(text: str, label: str) -> Values:
    """Values of a MATLAB script outside loops and branches, arrays with two dimensions."""
    text = re.sub(r"(?ms)^[ \t]*%\{[ \t]*$.*?(?:^[ \t]*%\}[ \t]*$|\Z)", "", text)
    text = re.sub(r"%.*", "", re.sub(r"\.\.\..*\n", " ", text))
    return Values(label, _MATLAB).lines(_matlab_in_python(text))


def _matlab_in_python(text: str) -> Iterator[str]:
    blocks = 0
    for statement in re.findall(r"(?:\[[^\[\]]*\]|[^;\n])+", text):
        block = re.match(r"\s*(if|for|while|switch|try|parfor)\b", statement)
        if re.fullmatch(r"\s*end\w*\s*", statement):
            blocks = max(blocks - 1, 0)
        elif block or blocks or len(statement) > _LONGEST:
            blocks += block is not None and not re.search(r"\bend\s*$", statement)
            yield statement + "?"
        else:
            statement = re.sub(r"\[([^\[\]]*)\]", _matrix, statement)
            yield re.sub(r"(?<=[\w)\]])'", ".T", statement.replace("^", "**"))


def _matrix(found: re.Match[str]) -> str:
    columns = re.sub(r"(?<=[\w.)'])[ \t]+(?=[\w.(]|[-+]\S)", ",", found[1])
    rows = re.split("[;\n]", columns)
    return f"matrix([{','.join(f'[{row.strip()}]' for row in rows)}])"


#: Statements of C++, and how Python writes them.
_STATEMENTS: Final = (
    (re.compile(r"(\w+)\.push_back ?\((.*)\)"), r"\1.append(\2)"),
    (re.compile(r"(?:[^<]* )?(\w+) ?<<(.*)"), r"\1 = [\2]"),  # of Eigen
    (re.compile(r"(?:[^=]*[ >&*])?(\w+ ?(?:\[ ?\d{1,4} ?\])?) ?=(?!=)(.*)"), r"\1 = \2"),
    (re.compile(r"\w+(?:\.|->)(\w+ ?\(.*\))"), r"\1"),
    (re.compile(r"(?:.* )?vector ?<.*> ?(\w+)"), r"\1 = []"),
)


def cpp(text: str, label: str) -> Values:
    """Values of C++ code outside loops and branches, functions one after the other."""
    text = re.sub(r"(?s)/\*.*?(?:\*/|\Z)", " ", text)
    text = " ".join(re.sub(r"//.*", " ", text).replace("std::", "").split())
    text = re.sub(r"=? ?\{([^{};]*)\} ?;", r"= [\1];", text)
    block = r"\b(?:for|while|if|else) ?(?:\([^{}]{0,500}\) ?)?\{[^{}]*\}"
    text = re.sub(block, lambda found: found[0].replace(";", "?;"), text)
    return Values(label, _CPP).lines(map(_cpp_in_python, re.split("[;{}]", text)))


def _cpp_in_python(statement: str) -> str:
    statement = statement.strip()
    # C++ rounds a quotient of whole numbers
    whole = re.search(r"(?<![\w.])(?<![eE][-+])\d+ ?/ ?\d+(?![\w.])", statement)
    for pattern, form in _STATEMENTS if len(statement) <= _LONGEST and not whole else ():
        if found := pattern.fullmatch(statement):
            return found.expand(form)
    return statement + "?"
