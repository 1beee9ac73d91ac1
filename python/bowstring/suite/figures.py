"""Figure of one set of the suite: error of each model and published figures, as bars."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.formatting import significant
from bowstring.suite.running import SetResult
from bowstring.viz.style import LIGHT, WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS: Final = {
    "constant_curvature": "blue",
    "arcs": "blue",
    "rod": "ink",
    "authors": "amber",
    "learner": "green",
    "other": "purple",
}
_LETTERS: Final = 44  # letters of a line of a label


def draw_set(result: SetResult) -> Figure:
    """Draw the errors of a set by its first metric.

    Parameters
    ----------
    result : SetResult
        Results of the set.

    Returns
    -------
    matplotlib.figure.Figure
        Horizontal bars: models in the order of the protocol, then published figures.
    """
    from matplotlib.figure import Figure

    given = result.given
    name, metric = next(iter(given.metrics.items()))
    bars = [
        (each.model.label, each.validation.values[name], _COLOURS[each.model.model])
        for each in result.models
    ]
    bars += [
        (f"published: {each.what}", each.value, _COLOURS[each.by])
        for each in given.protocol.published
        if each.metric == name
    ]
    labels = ["\n".join(textwrap.wrap(label, _LETTERS)) for label, _, _ in bars]
    values = np.array([value for _, value, _ in bars])
    lines = sum(label.count("\n") + 1 for label in labels)
    figure = Figure(
        figsize=(1.5 * WIDTH, 0.9 + 0.19 * lines + 0.12 * len(bars)), layout="constrained"
    )
    axes = figure.subplots()
    place = np.arange(len(bars))
    axes.barh(place, values, color=[LIGHT[colour] for _, _, colour in bars], height=0.66)
    for at, value in zip(place, values, strict=True):
        axes.annotate(
            significant(value), (value, at), (3, 0), textcoords="offset points", va="center"
        )
    axes.set_yticks(place, labels)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.12)
    axes.set_xlabel(f"{metric.label}, {metric.unit}")
    rows = max(each.validation.rows for each in result.models)
    axes.set_title(f"{given.name} ({given.kind}, {rows} rows)")
    return figure
