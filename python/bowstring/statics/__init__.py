"""Statics of the rod: loads, actuation, solve, sweep, batch, derivatives, stress fields."""
