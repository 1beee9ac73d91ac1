"""Environments for Gymnasium: `bowstring.integrations.gymnasium` under its public name."""

from bowstring.integrations.gymnasium import *  # noqa: F403
