"""The errors that Bowstring raises on purpose."""


class BowstringError(ValueError):
    """Base of all errors that Bowstring raises on purpose; the message is one clear sentence."""


class InputError(BowstringError):
    """A file, a flag or an argument is wrong (exit code 2)."""


class NoSolutionError(BowstringError):
    """The input is valid but has no solution, or none was found (exit code 1)."""
