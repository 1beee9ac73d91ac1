"""Figures: of the study, of modes, of a fit, of whole backbones; within `bowstring.style`.

matplotlib is imported by the first figure, not with the package.
"""

from bowstring.plots.fit import draw_fit
from bowstring.plots.modes import draw_modes
from bowstring.plots.shapes import backbone_shapes
from bowstring.plots.study import draw

__all__ = ["backbone_shapes", "draw", "draw_fit", "draw_modes"]
