"""Equilibria in PyTorch: `bowstring.integrations.torch` under its public name."""

from bowstring.integrations.torch import *  # noqa: F403
