"""Equilibria in JAX: `bowstring.integrations.jax` under its public name."""

from bowstring.integrations.jax import *  # noqa: F403
