"""The study of a robot, step by step: its error and validity limit of constant curvature.

`run_study` repeats the study of Amouri 2019 for any robot and tendon, or several tendons:

1. its geometric sweep, constant curvature alone (Eq. 5, Fig. 6 and 7);
2. a sweep of the tension from zero, solved by straight-span statics;
3. the same tension over time, solved by dynamics, with stress and strain as in Fig. 5
   (`bowstring.study.ramp_response`);
4. constant curvature compared with both, from the tendon *lengths* of the rod (Eq. 2-5 of the
   study) and from the *force* by the linear law, each plain and corrected
   (`bowstring.study.comparison`), and curvature that varies along the robot
   (`bowstring.study.shape_models`);
5. an error budget: physical effects one at a time, in this sweep, added to a baseline and removed
   from a full model (`bowstring.study.error_budget`); friction, elastic tendons and displacement
   control along a path of loading and unloading (`bowstring.study.actuation_budget`);
6. a verdict at a stated tolerance (`bowstring.study.verdict`);
7. with measurements, all models against them, with and without registration, a decomposition of
   the error, and tests of the residuals (`bowstring.study.data_validation`); with angles alone the
   angles (`bowstring.study.angle_validation`).

Budget and verdict use statics, which needs no choice of rise time and damping. Friction at the
holes is in the actuation part of the budget only.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Progress
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.robot.model import Robot, check_disks, check_robot, check_tendons, without_laws
from bowstring.statics.model import RodModel
from bowstring.study.combinations import combinations, worst_combination
from bowstring.study.comparison import MEANINGS, Model, Theory
from bowstring.study.design_map import design_map, without_map
from bowstring.study.error_budget import error_budget
from bowstring.study.load_map import check_load_axis, load_map
from bowstring.study.notes import claim_of, notes_of
from bowstring.study.ramp_response import (
    Transient,
    check_rise,
    slowest_frequency,
    transient,
    without_surface,
)
from bowstring.study.settings import Extras, Ramp, Settings
from bowstring.study.shape_models import compare_shapes
from bowstring.study.study import Study
from bowstring.study.sweeps import Statics, arc_scale_of, geometric_sweep, static_sweep
from bowstring.study.verdict import judge
from bowstring.validation import choice, instance, share_of_length, shown
from bowstring.validity.loading import Loading, largest_load
from bowstring.validity.spread import Spread, assumed_distributions, design_of, sampled

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements

_ON_MATRIX: Final = (
    "The uncertain numbers leave out the stiffness matrix: its entries take no distributions.",
)
_ASSUMED_POINTS, _GIVEN_POINTS = 256, 1024  # base points of the samples


def run_study(
    robot: Robot,
    *,
    tolerance: float | str = 0.01,
    theory: Theory = "cosserat",
    loading: Loading | None = None,
    ramp: Ramp | None = None,
    measurements: Measurements | str | Path | None = None,
    extras: Extras | None = None,
    progress: Progress | None = None,
) -> Study:
    """Study the error of constant curvature for a robot.

    Parameters
    ----------
    robot : Robot
        The robot.
    tolerance : float or str
        Tolerated tip error: a share of the robot's length, 0.01 or "1 %", or a length, "0.5 mm".
    theory : {"cosserat", "kirchhoff"}
        Rod theory of the main sweep and of dynamics. The budget uses both.
    loading : Loading, optional
        Actuated tendons, range of tension, and number of loads.
    ramp : Ramp, optional
        Rise of the tension and damping in dynamics.
    measurements : Measurements, str or Path, optional
        Measurements of this robot, or their table, with which all models are compared too
        (`bowstring.study.data_validation`). Read a table in another format by
        `bowstring.read_measurements` with a mapping.
    extras : Extras, optional
        Solid in the report, finite elements.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Study
        Comparison, error budget and verdict; `bowstring.study.report.write` writes its report.

    Raises
    ------
    InputError
        If a setting is out of range, the measurements cannot be read or used, or a solid or finite
        elements are not possible.
    NoSolutionError
        If no load of the sweep has an equilibrium.
    """
    check_robot(robot)
    check_tendons(robot, "the study")
    check_disks(robot, "the study")
    loading, extras = instance("loading", loading, Loading), instance("extras", extras, Extras)
    settings = settings_of(robot, tolerance, theory, loading, instance("ramp", ramp, Ramp))
    model = Model(robot, settings.tendon, settings.theory, settings.shares)
    over = check_load_axis(robot, model, extras.over)
    _check_extras(robot, extras)
    if extras.compare and (measurements is None or theory != "cosserat"):
        raise InputError(
            "compare is of models on left-out rows of measurements, with the Cosserat rod; give "
            "measurements, and leave theory out"
        )
    whole, data, angles = progress or (lambda what, share: None), None, None
    if measurements is not None:
        whole("measurements", 0.0)
        table = as_measurements(robot, measurements)
        judging = (
            *(robot, table, settings.tolerance, settings.theory),
            partial(_between(whole, 0.0, 0.2), "measurements"),
        )
        if table.points.shape[1]:
            from bowstring.study.data_validation import judge_data

            data = judge_data(*judging, compare=extras.compare)
        elif extras.compare:
            raise InputError(
                f"{table.name} has angles only; the comparison of models on left-out rows needs "
                "measured tips: leave compare out"
            )
        else:
            from bowstring.study.angle_validation import judge_angles

            angles = judge_angles(*judging)
        whole = _between(whole, 0.2, 1.0)
    # finite elements take most of the time
    notify = whole if extras.fe is None else _between(whole, 0.0, 0.2)

    notify("geometric sweep", 0.0)
    model.arc_scale = arc_scale_of(model, settings)
    geometry = geometric_sweep(model, settings)

    notify("statics", 0.05)
    statics = static_sweep(model, settings)
    comparisons = model.compare(statics.tension, statics.tip_position, statics.tendon_lengths)
    shapes = compare_shapes(model, statics, comparisons)

    notify("dynamics", 0.1)
    motion, without = dynamics_of(
        model, settings, statics, partial(_between(notify, 0.1, 0.2), "dynamics")
    )
    in_time = {}
    if motion is not None:
        in_time = model.compare(
            statics.tension, motion.load_tip, motion.load_lengths, against="dynamics"
        )

    notify("error budget", 0.2)
    calibrated = None if data is None else data.calibrated_friction
    notified = partial(_between(notify, 0.2, 0.8), "error budget")
    budget = error_budget(model, statics.tension, notified, calibrated)

    notify("verdict", 0.8)
    verdict = judge(
        model, settings.tolerance, settings.max_tension, comparisons, budget, shapes.text
    )

    notify("map and uncertainty", 0.9)
    of_design = design_map(without_laws(robot), settings)
    of_load = load_map(model, settings, over)
    spreads = _spreads(robot, settings, extras.uncertainty)

    bricks, by_bricks = None, {}
    if extras.fe is not None:
        from bowstring.study import finite_elements

        bricks = finite_elements.solve(
            robot,
            model.tensions(statics.tension),
            statics.tip_position,
            extras.fe,
            partial(_between(whole, 0.2, 1.0), "finite elements"),
        )
        by_bricks = model.compare(
            statics.tension, bricks.tip_position, bricks.tendon_lengths, against="fe"
        )
        if data is not None:
            bricks = finite_elements.at_data(bricks, statics.tension, model.shares, data)
    whole("done", 1.0)
    return Study(
        robot=robot,
        settings=settings,
        geometry=geometry,
        statics=statics,
        dynamics=motion,
        without_dynamics=without,
        comparisons=(
            *comparisons.values(),
            *in_time.values(),
            *by_bricks.values(),
            *(() if data is None else data.comparisons),
            *shapes.comparisons,
        ),
        budget=budget,
        verdict=verdict,
        shapes=shapes,
        claim=claim_of(robot, settings, comparisons, in_time, by_bricks),
        notes=(
            *notes_of(robot, settings, geometry, statics, comparisons, in_time, data, angles),
            *([without_map(robot)] if of_design is None else ()),
            *([without_surface(robot)] if without_surface(robot) else ()),
            *(_ON_MATRIX if spreads and extras.uncertainty is None and robot.has_matrix else ()),
            *(spreads[0].distributions.warnings if spreads else ()),
        ),
        data=data,
        angles=angles,
        solid=extras.solid,
        bricks=bricks,
        map=of_design,
        load_map=of_load,
        spreads=spreads,
        uncertainty_assumed=extras.uncertainty is None,
    )


# -- its steps ---------------------------------------------------------------------------------


def _check_extras(robot: Robot, extras: Extras) -> None:
    """Refuse a solid or finite elements that are not possible, before any work."""
    if extras.solid:
        from bowstring.cad.solid import check_cad
        from bowstring.robot.sizes import sizes_of

        sizes_of(robot)
        check_cad()
    if extras.fe is not None:
        from bowstring.fem.run import check

        check(robot)
        extras.fe.check()


def _spreads(robot: Robot, settings: Settings, given: Any) -> tuple[Spread, ...]:
    """Validity limits with uncertain numbers; none where statics solves too few samples."""
    shares = {i: share for i, share in enumerate(settings.shares, 1) if share}
    loading = Loading(settings.max_tension, settings.points, shares)
    free = without_laws(robot)
    try:
        joint = assumed_distributions(free) if given is None else given
    except InputError:  # no number has an assumed distribution
        return ()
    spread_of = sampled(
        free,
        design_of(free, joint, _ASSUMED_POINTS if given is None else _GIVEN_POINTS),
        MEANINGS,
        tolerance=settings.tolerance,
        loading=loading,
        model=RodModel(settings.theory),
    )
    out = []
    for name in MEANINGS:
        with suppress(NoSolutionError):
            out.append(spread_of(name))
    return tuple(out)


def _between(notify: Progress, start: float, end: float) -> Progress:
    """Progress callback for a part of the work between two shares."""
    return lambda what, done: notify(what, start + (end - start) * done)


def as_measurements(robot: Robot, measurements: Measurements | str | Path) -> Measurements:
    """Read measurements of a robot, unless they are read already."""
    from bowstring.data.measurements import Measurements, read_measurements

    if isinstance(measurements, Measurements):
        return measurements
    if not isinstance(measurements, (str, Path)):
        raise InputError(
            f"measurements is {shown(measurements)}, it must be the path of a table, or "
            "measurements that are read"
        )
    return read_measurements(measurements, robot)


def settings_of(
    robot: Robot, tolerance: float | str, theory: Theory, loading: Loading, ramp: Ramp
) -> Settings:
    """Check the settings of a study and choose those that are left out."""
    tolerance = share_of_length("tolerance", tolerance, robot.length)
    choice("theory", theory, ("cosserat", "kirchhoff"))
    tried = combinations(robot) if loading.tendon is None else []
    shares = loading.shares(robot)
    earlier: tuple[str, ...] = ()
    if len(tried) > 1:
        shares, earlier = worst_combination(robot, tried, theory, tolerance, loading.max_tension)
    leading = int(np.argmax(np.abs(shares)))
    limit = loading.max_tension
    if limit is None:
        limit = largest_load(robot, np.array(shares), RodModel(theory))
    return Settings(
        tolerance=tolerance,
        max_tension=limit,
        points=loading.points,
        theory=theory,
        tendon=leading,
        shares=shares,
        tried=len(tried),
        earlier=earlier,
        range_chosen=loading.max_tension is None,
        rise=ramp.rise,
        modal_damping=ramp.modal_damping,
    )


def dynamics_of(
    model: Model, settings: Settings, statics: Statics, progress: Callable[[float], None]
) -> tuple[Transient | None, str]:
    """Motion, or reason why there is none; statics does not depend on it."""
    try:
        frequency = slowest_frequency(model)
    except BowstringError as error:
        return None, f"Dynamics is left out: {str(error).rstrip('.')}."
    if settings.rise is not None:
        check_rise(model.robot, settings.rise, frequency)
    try:
        motion = transient(
            model, statics.tension, frequency, settings.rise, settings.modal_damping, progress
        )
    except BowstringError as error:
        return None, f"Dynamics is left out: {str(error).rstrip('.')}."
    return motion, ""
