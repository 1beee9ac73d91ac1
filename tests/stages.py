"""The stages of a study, each computed when a test needs it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from bowstring.data.tip_errors import Comparison
from bowstring.robot.model import Robot
from bowstring.study import run
from bowstring.study.actuation_budget import ActuationBudget, actuation_budget
from bowstring.study.comparison import COMPARISONS, Case, Model, Theory
from bowstring.study.error_budget import Budget, error_budget
from bowstring.study.notes import PublishedClaim, claim_of, notes_of
from bowstring.study.ramp_response import MODAL_DAMPING, Transient
from bowstring.study.settings import Ramp
from bowstring.study.shape_models import ShapeModels, compare_shapes
from bowstring.study.study import Study
from bowstring.study.sweeps import (
    GeometricSweep,
    Statics,
    arc_scale_of,
    geometric_sweep,
    static_sweep,
)
from bowstring.study.terminal import print_study
from bowstring.study.verdict import Verdict, judge
from bowstring.validity.loading import Loading


class Stages:
    """The stages that `run_study` computes, with its settings and their defaults."""

    def __init__(
        self,
        robot: Robot,
        tolerance: float = 0.01,
        theory: Theory = "cosserat",
        rise: float | None = None,
        modal_damping: float = MODAL_DAMPING,
        **loading: Any,
    ) -> None:
        self.robot = robot
        ramp = Ramp(rise, modal_damping)
        self.settings = run.settings_of(robot, tolerance, theory, Loading(**loading), ramp)

    @cached_property
    def model(self) -> Model:
        chosen = self.settings
        model = Model(self.robot, chosen.tendon, chosen.theory, chosen.shares)
        model.arc_scale = arc_scale_of(model, chosen)
        return model

    @cached_property
    def geometry(self) -> GeometricSweep:
        return geometric_sweep(self.model, self.settings)

    @cached_property
    def statics(self) -> Statics:
        return static_sweep(self.model, self.settings)

    @cached_property
    def comparisons(self) -> dict[str, Comparison]:
        """By name, against statics."""
        s = self.statics
        return self.model.compare(s.tension, s.tip_position, s.tendon_lengths, tuple(COMPARISONS))

    @cached_property
    def shapes(self) -> ShapeModels:
        """Constant and variable curvature against statics."""
        return compare_shapes(self.model, self.statics, self.comparisons)

    @cached_property
    def ramp(self) -> tuple[Transient | None, str]:
        """The motion, or the reason why there is none."""
        return run.dynamics_of(self.model, self.settings, self.statics, lambda share: None)

    @property
    def motion(self) -> Transient:
        found, why_not = self.ramp
        assert found is not None, why_not
        return found

    @cached_property
    def in_time(self) -> dict[str, Comparison]:
        """By name, against dynamics."""
        tension, motion = self.statics.tension, self.motion
        return self.model.compare(
            tension, motion.load_tip, motion.load_lengths, tuple(COMPARISONS), "dynamics"
        )

    @cached_property
    def budget(self) -> Budget:
        return error_budget(self.model, self.statics.tension)

    @cached_property
    def verdict(self) -> Verdict:
        return self.judged(self.budget)

    def judged(self, budget: Budget) -> Verdict:
        """The verdict for any budget, of which only the sentences on other effects are used."""
        chosen = self.settings
        return judge(
            self.model,
            chosen.tolerance,
            chosen.max_tension,
            self.comparisons,
            budget,
            self.shapes.text,
        )

    def notes(self, in_time: dict[str, Comparison] | None = None) -> tuple[str, ...]:
        return notes_of(
            self.robot,
            self.settings,
            self.geometry,
            self.statics,
            self.comparisons,
            in_time or {},
            None,
        )

    def claim(self, in_time: dict[str, Comparison] | None = None) -> PublishedClaim | None:
        return claim_of(self.robot, self.settings, self.comparisons, in_time or {}, {})

    def over(self, other: Study) -> Study:
        """Return another study with the sweep of these stages in place of its own, and no dynamics.

        Budget and verdict remain those of the other study.

        """
        return replace(
            other,
            robot=self.robot,
            settings=self.settings,
            geometry=self.geometry,
            statics=self.statics,
            dynamics=None,
            without_dynamics="Dynamics is left out: it was not requested.",
            comparisons=(*self.comparisons.values(), *self.shapes.comparisons),
            shapes=self.shapes,
            claim=self.claim(),
            notes=self.notes(),
        )


def with_gaps(case: Case, loads: Sequence[int]) -> Case:
    """Return a case as if it had no equilibrium at some loads."""
    compared = {
        name: replace(c, difference=c.difference.copy()) for name, c in case.comparisons.items()
    }
    tip = case.tip_position.copy()
    for values in (tip, *(c.difference for c in compared.values())):
        values[list(loads)] = np.nan
    return replace(case, comparisons=compared, tip_position=tip, problem="no equilibrium there")


def printed(study: Study, width: int, folder: Path | None = None, *, verbose: bool = False) -> str:
    """What the terminal shows of a study."""
    out = io.StringIO()
    print_study(study, Console(file=out, width=width), folder, verbose=verbose)
    return out.getvalue()


def by_name(given: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of `run_study` with the fields of its objects beside the others."""
    out = dict(given)
    for name in ("loading", "ramp", "extras"):
        out |= vars(out.pop(name))
    return out


def law_rows(robot: Robot, plain: Robot) -> tuple[ActuationBudget, dict[str, Any]]:
    """The actuation budget of a robot with a law, and its rows by effect.

    The last two are those of the law; the others are those of the robot without it.
    """
    tension = np.linspace(0.0, 60.0, 5)
    found, without = (
        actuation_budget(model, tension, model.case(model.main, tension))
        for model in (Model(each, 0, "cosserat") for each in (robot, plain))
    )
    rows = {row.effect: row for row in found.rows}
    assert [row.effect for row in without.rows] == list(rows)[:-2]
    for row in without.rows:
        assert rows[row.effect].moved == pytest.approx(row.moved, rel=1e-9)
    return found, rows
