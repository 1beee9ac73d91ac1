"""Exceptions and warnings of Bowstring."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class BowstringError(ValueError):
    """Base class of all errors that Bowstring raises; the message is one sentence."""


class InputError(BowstringError):
    """A file, a flag or an argument is wrong (exit code 2).

    Attributes
    ----------
    argument : str
        Name of the Python argument; empty if no single argument is wrong.
    index : int or None
        Index, from 0, of the tendon, disk, segment or row that is wrong.
    value, rule : str
        Given value with its unit, and allowed range; empty if only the message has them.
    """

    def __init__(
        self,
        message: str,
        *,
        argument: str = "",
        index: int | None = None,
        value: str = "",
        rule: str = "",
    ) -> None:
        super().__init__(message)
        self.argument, self.index, self.value, self.rule = argument, index, value, rule

    @classmethod
    def of(cls, argument: str, value: str, rule: str) -> InputError:
        """Make the error of an argument outside its allowed range."""
        message = f"{argument} is {value}, it must be {rule}"
        return cls(message, argument=argument, value=value, rule=rule)


class NoSolutionError(BowstringError):
    """The input is valid but has no solution, or none was found (exit code 1).

    Attributes
    ----------
    status : str
        Status of the solution or run, as in JSON, or ``"no_equilibrium"`` if the initial
        equilibrium does not exist; empty if no status applies.
    """

    def __init__(self, message: str, *, status: str = "") -> None:
        super().__init__(message)
        self.status = status


class StabilityWarning(UserWarning):
    """An equilibrium was found, but it is not known to be stable."""


class FigureWarning(UserWarning):
    """A figure could not be drawn; the results beside it are complete."""


@contextmanager
def library_errors(beginning: str, *, kind: bool = False) -> Iterator[None]:
    """Turn any exception of a library into an `InputError`; `beginning` is that of its message.

    Libraries raise many kinds of exception on damaged files, with messages that may quote a whole
    cell. `kind`: whether the message names that of the exception.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        text = f"{type(error).__name__} {error}" if kind else str(error)
        raise InputError(f"{beginning}: {' '.join(text.split())[:200]}") from None
