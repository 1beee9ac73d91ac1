"""Inverse kinematics: tensions and displacements for a position of the tip."""
