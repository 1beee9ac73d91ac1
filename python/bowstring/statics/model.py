"""The model of the rod that an argument gives."""

from __future__ import annotations

from bowstring._core import RodModel
from bowstring.errors import InputError
from bowstring.validation import shown

__all__ = ["RodModel", "as_model"]

_DEFAULT = RodModel()


def as_model(model: RodModel | None) -> RodModel:
    """The model given, or the default one."""
    if model is None:
        return _DEFAULT
    if not isinstance(model, RodModel):
        raise InputError(f"model is {shown(model)}, it must be a bowstring.RodModel")
    return model
