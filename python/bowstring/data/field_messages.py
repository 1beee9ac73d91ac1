"""Files of fields checked as a whole, with one sentence for each problem."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from bowstring.data.columns import nearest
from bowstring.errors import InputError
from bowstring.units import quote

Model = TypeVar("Model", bound=BaseModel)

_MOST: Final = 20  # listed problems
_BRANCHES: Final = ("Sigma", "float")  # names that pydantic adds to the path of a union


class Fields(BaseModel):
    """Set of fields of a file; others are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def checked(model: type[Model], tree: dict[str, Any], label: str) -> Model:
    """Check the tree of a file.

    Parameters
    ----------
    model : type of BaseModel
        Fields of the file.
    tree : dict
        Content of the file.
    label : str
        Name of the file for messages.

    Returns
    -------
    BaseModel
        Instance of `model`.

    Raises
    ------
    InputError
        If it is not valid; the message lists all problems with their fields.
    """
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        problems = [_sentence(model, item) for item in error.errors()]
    first, *others = dict.fromkeys(problems)
    more = f" (and {len(others)} more)" if others else ""
    lines = [f"{label}: {first}{more}.", *(f"  {other}." for other in others[:_MOST])]
    raise InputError("\n".join(lines))


def _model_at(root: type[BaseModel], names: Sequence[str]) -> type[BaseModel]:
    """Model of a set of fields, by the path of field names to it."""
    found = root
    for name in names:
        found = next(_models_in(found.model_fields[name].annotation))
    return found


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for each in get_args(annotation):
        yield from _models_in(each)


def _sentence(root: type[BaseModel], error: Any) -> str:
    """Convert one of pydantic's errors to "field: sentence"."""
    kind, given = error["type"], error["input"]
    loc = tuple(step for step in error["loc"] if step not in _BRANCHES)
    path = "".join(f"[{s}]" if isinstance(s, int) else f".{s}" for s in loc).lstrip(".")
    if kind == "bowstring":
        sentence = error["ctx"]["sentence"]
        return f"{path}: {sentence}" if path else sentence
    names = tuple(step for step in loc if isinstance(step, str))
    if kind == "extra_forbidden":
        known = list(_model_at(root, names[:-1]).model_fields)
        near = nearest(names[-1], known)
        hint = f"; did you mean {near}?" if near else "."
        return f"{path}: unknown field{hint} Known here: {', '.join(known)}"
    if kind == "missing":
        return f"{path}: missing"
    if kind == "literal_error":
        return f"{path}: got {quote(given)}; must be {error['ctx']['expected']}"
    if kind in ("model_type", "model_attributes_type"):
        fields = ", ".join(_model_at(root, names).model_fields)
        return f"{path}: got {quote(given)}; must be a set of fields: {fields}"
    if kind in ("too_short", "too_long", "tuple_type"):
        return f"{path}: got {quote(given)}; must be a list of columns or numbers of right length"
    if kind in ("float_parsing", "float_type"):
        return f"{path}: got {quote(given)}; must be a number"
    return f"{path}: got {quote(given)}; {error['msg'][:1].lower()}{error['msg'][1:]}"
