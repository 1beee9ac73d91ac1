"""Schemas of results, from the annotations and docstrings of the members that declare a key.

Of an array the docstring has the shape, ``(n, 3)``: a number fixes the length of the list, and
``(...)`` stands for any shape. Where it names NaN or infinity, numbers may be null.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Callable
from functools import cache, reduce
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

import numpy as np
from pydantic import Field, with_config
from typing_extensions import TypedDict, get_type_hints, is_typeddict

from bowstring.results import STRICT, UNITS, Result, about, keys_of

Form = TypeVar("Form", bound=type)

_NUMBERS: Final = {np.float64: float, np.int64: int, np.bool_: bool, np.str_: str}
_SHAPE: Final = re.compile(r",? \(((?:\w+(?: \+ 1)?, ?)+\w*|\.{3})\)(?: or(?= \())?")
_SYMBOLS: Final = "|".join(re.escape(unit.replace("²", "^2")) for unit, _ in UNITS.values())
_UNIT: Final = re.compile(rf"(?:,| in) (?:{_SYMBOLS})(?=[.:;,]|$)")
_MISSING: Final = re.compile(r"\b(?:NaN|[Ii]nfinite|None)\b")


def beside(*results: type[Result]) -> Callable[[Form], Form]:
    """Mark a typed dictionary whose object has the keys of these results too."""

    def mark(form: Form) -> Form:
        setattr(form, "__beside__", results)  # noqa: B010
        return form

    return mark


@cache
def object_of(form: Any) -> Any:
    """Typed dictionary of the keys of a result; of a typed dictionary, with those beside it."""
    keys: dict[str, Any] = {}
    for kind in getattr(form, "__beside__", ()):
        keys |= _keys(object_of(kind))
    if is_typeddict(form):
        keys |= {key: _in_json(kind, "") for key, kind in _keys(form).items()}
    else:
        members = _members(form)
        for name, (key, _) in keys_of(form).items():
            annotation, text = members[name]
            kind = get_args(annotation)[0]
            if key.flat:
                keys |= _keys(object_of(kind))
            else:
                keys[key.name] = Annotated[_in_json(kind, text), about(_meaning(text), key.unit)]
    made: Any = with_config(STRICT)(TypedDict(form.__name__, keys))  # type: ignore[operator]
    made.__doc__ = _first(inspect.getdoc(form) or "").partition("; made by")[0].rstrip(".") + "."
    return made


def _keys(form: Any) -> dict[str, Any]:
    return get_type_hints(form, include_extras=True)


@cache
def _members(kind: type) -> dict[str, tuple[Any, str]]:
    """Annotation and docstring of all members of a class and its bases."""
    found: dict[str, tuple[Any, str]] = {}
    for each in (c for c in reversed(kind.__mro__) if issubclass(c, Result)):
        tree, names = _module(each.__module__)
        (body,) = (
            n.body for n in tree.body if isinstance(n, ast.ClassDef) and n.name == each.__name__
        )
        for node, after in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.FunctionDef) and node.returns is not None:
                name, annotation, text = node.name, node.returns, ast.get_docstring(node)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                name, annotation, text = node.target.id, node.annotation, None
                if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                    text = inspect.cleandoc(str(after.value.value))
            else:
                continue
            if "Key(" in ast.unparse(annotation):
                value = eval(ast.unparse(annotation), names)
                found[name] = value, _first(text or "") or found.get(name, ("", ""))[1]
    return found


@cache
def _module(name: str) -> tuple[ast.Module, dict[str, Any]]:
    """Syntax tree of a module, and its names with those that only type checks import."""
    module = sys.modules[name]
    tree = ast.parse(Path(module.__file__ or "").read_text(encoding="utf-8"))
    names = dict(vars(module))
    for node in tree.body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            exec(compile(ast.Module(node.body, []), name, "exec"), names)
    return tree, names


def _in_json(kind: Any, text: str) -> Any:
    """Type in JSON of a member with a docstring."""
    origin, arguments = get_origin(kind), get_args(kind)
    inner = [_in_json(each, text) for each in arguments if each is not ...]
    if kind is float and re.search(r"NaN|infinite", text):
        return float | None
    if origin is np.ndarray:
        (number,) = (_NUMBERS[each] for each in get_args(arguments[1]))
        if not (shapes := _SHAPE.findall(text)):
            raise ValueError(f"this docstring has no shape of its array: {text}")
        return reduce(_either, (_array(_in_json(number, text), shape) for shape in shapes))
    if origin in (Union, UnionType):
        return reduce(_either, inner)
    if origin is tuple and ... not in arguments:
        return _list(reduce(_either, inner), len(inner))
    if origin is Annotated:
        return kind.copy_with((inner[0],))
    if is_typeddict(kind) or (isinstance(kind, type) and issubclass(kind, Result)):
        return object_of(kind)
    if origin is None or not inner or kind in (None, NoneType):
        return str if kind is Path else kind
    name = getattr(origin, "__name__", "")
    if name in ("Mapping", "dict"):
        return dict[str, inner[1]]  # type: ignore[valid-type]
    if name in ("list", "tuple", "Sequence"):
        return list[inner[0]]  # type: ignore[valid-type]
    return kind


def _either(a: Any, b: Any) -> Any:
    return Union[a, b]  # noqa: UP007


def _array(number: Any, shape: str) -> Any:
    if shape == "...":
        return list[Any]
    for size in reversed(shape.replace(" ", "").rstrip(",").split(",")):
        number = _list(number, int(size) if size.isdigit() else None)
    return number


def _list(of: Any, size: int | None) -> Any:
    kind: Any = list[of]
    return kind if size is None else Annotated[kind, Field(min_length=size, max_length=size)]


def _first(text: str) -> str:
    return " ".join(text.split("\n\n")[0].split())


def _meaning(text: str) -> str:
    """Meaning of a key by a docstring, without shape and unit."""
    text = _UNIT.sub("", _SHAPE.sub("", text))
    return _MISSING.sub("`null`", text).replace("``", "`")
