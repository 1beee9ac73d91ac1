"""Robots as chains of rigid links with springs in their joints, for multibody simulators."""
