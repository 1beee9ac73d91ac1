"""Shared figures, their style and colours, VTK output, animation."""
