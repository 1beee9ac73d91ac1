"""The errors that Bowstring raises on purpose, and its warning."""


class BowstringError(ValueError):
    """Base of all errors that Bowstring raises on purpose; the message is one clear sentence."""


class InputError(BowstringError):
    """A file, a flag or an argument is wrong (exit code 2)."""


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
