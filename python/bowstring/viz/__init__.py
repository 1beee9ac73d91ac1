"""Figures that several parts share, their style and colours, VTK, animation."""
