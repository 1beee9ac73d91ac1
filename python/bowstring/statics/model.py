"""Model of the rod from an argument."""

from __future__ import annotations

from bowstring._core import RodModel
from bowstring.errors import InputError
from bowstring.validation import shown

__all__ = ["RodModel", "as_model"]

_DEFAULT = RodModel()


def as_model(model: RodModel | None) -> RodModel:
    """Return the given model, or the default one for None."""
    if model is None:
        return _DEFAULT
    if not isinstance(model, RodModel):
        raise InputError(f"model is {shown(model)}, it must be a bowstring.RodModel")
    return model
