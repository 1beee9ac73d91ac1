"""The rod in equilibrium: actuation, solve, sweep, batch, derivatives, fields of stress."""
