"""The errors that Bowstring raises on purpose, and its warning."""

from __future__ import annotations


class BowstringError(ValueError):
    """Base of all errors that Bowstring raises on purpose; the message is one clear sentence."""


class InputError(BowstringError):
    """A file, a flag or an argument is wrong (exit code 2).

    Attributes
    ----------
    argument : str
        Name of the argument, as in Python; empty where the error is not of a single one.
    index : int or None
        Of the tendon, disk, segment or row it is about, from 0.
    value, rule : str
        What was given, with its unit, and what it must be; empty where the message alone says it.
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
        """The error of an argument whose value breaks a rule."""
        message = f"{argument} is {value}, it must be {rule}"
        return cls(message, argument=argument, value=value, rule=rule)


class NoSolutionError(BowstringError):
    """The input is valid but has no solution, or none was found (exit code 1).

    Attributes
    ----------
    status : str
        The word for it, as in JSON: that of a solution or a run that is not ``"converged"``, or
        ``"no_equilibrium"`` where there is none to begin from. Empty where no word is defined.
    """

    def __init__(self, message: str, *, status: str = "") -> None:
        super().__init__(message)
        self.status = status


class StabilityWarning(UserWarning):
    """An equilibrium was found, but it is not known to be stable."""
