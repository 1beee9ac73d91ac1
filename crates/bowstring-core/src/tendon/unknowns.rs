//! Unknown tensions and drops, and their mixed linear complementarity problem.
//!
//! Theory: docs/theory/actuation.md (Eq. 4.2).

use super::friction::Friction;
use super::history::{History, Slip};
use super::tendons::Tendons;
use crate::math::mlcp::{Complementarity, Side};
use crate::rod::responses::Sources;
use crate::rod::routed::RoutedRod;

/// Negligible slack, over the robot's length.
const NEGLIGIBLE_SLACK: f64 = 1e-12;
/// Negligible stiffness against a common change of tensions, over the largest stiffness of one
/// tension.
const NEGLIGIBLE_STIFFNESS: f64 = 1e-9;

/// Unknown of a tendon.
#[derive(Clone, Copy, PartialEq)]
enum Unknown {
    /// Tension before the base hole.
    Tension(usize),
    /// Drop at a sticking hole.
    Drop { tendon: usize, hole: usize },
}

impl Unknown {
    fn tendon(self) -> usize {
        match self {
            Unknown::Tension(i) => i,
            Unknown::Drop { tendon, .. } => tendon,
        }
    }

    fn hole(self) -> usize {
        match self {
            Unknown::Tension(_) => 0,
            Unknown::Drop { hole, .. } => hole,
        }
    }
}

/// Unknowns of a step, and the problem for their next values.
#[derive(Clone, Default)]
pub(crate) struct Unknowns {
    pub problem: Complementarity,
    /// Unknowns in the order of the columns.
    list: Vec<Unknown>,
    /// Unknowns of the last solution of the rod.
    solved: Vec<Unknown>,
    columns: Columns,
    coefficients: Vec<f64>,
    /// By columns: length change of a tendon from a hole on, for a tension less what clearance takes
    /// with the bend.
    beyond: Vec<f64>,
    /// Compliance added in `problem` to limit tensions far from the solution (m/N).
    limiting_compliance: f64,
    /// Sides of the unknowns at the last call of `keeps_sides`.
    sides: Vec<Side>,
}

/// Right-hand sides of the unknowns.
#[derive(Clone, Default)]
struct Columns {
    /// Tendon of each right-hand side.
    sources: Vec<usize>,
    /// By unknowns and modules: span tension for a unit of each unknown.
    profile: Vec<f64>,
    /// By unknowns and holes: elongation of a tendon from there on, for a unit of each unknown.
    give: Vec<f64>,
}

impl Columns {
    fn fill(&mut self, list: &[Unknown], tendons: &Tendons) {
        let (n, m) = (tendons.routing.modules, tendons.lines.len());
        self.sources.clear();
        self.profile.clear();
        self.profile.resize(list.len() * n, 0.0);
        self.give.resize(list.len() * n, 0.0);
        for (c, unknown) in list.iter().enumerate() {
            let (i, hole) = (unknown.tendon(), unknown.hole());
            self.sources.push(i);
            let per = match *unknown {
                Unknown::Tension(_) => 1.0,
                Unknown::Drop { .. } => 1.0 / tendons.carried[hole * m + i],
            };
            for k in hole..=tendons.routing.ends[i] {
                self.profile[c * n + k] = tendons.carried[k * m + i] * per;
            }
            let mut sum = 0.0;
            for k in (0..n).rev() {
                sum += tendons.compliance.friction_spans[k * m + i] * self.profile[c * n + k];
                self.give[c * n + k] = sum;
            }
        }
    }

    /// Elongation of a whole tendon for a unit of a column.
    fn stretch(&self, c: usize, i: usize, tendons: &Tendons) -> f64 {
        let (n, m) = (tendons.routing.modules, tendons.lines.len());
        (0..n)
            .map(|k| tendons.compliance.spans[k * m + i] * self.profile[c * n + k])
            .sum()
    }
}

impl Unknowns {
    /// Discards the step before, so that a repeated step gives identical results.
    pub fn start(&mut self) {
        self.list.clear();
        self.solved.clear();
        self.problem.size = 0;
        self.problem.side.clear();
    }

    /// Solves for the columns of the unknown tensions and drops, and sets up their complementarity
    /// problem (theory Eq. 4.2).
    ///
    /// `limiting_compliance` is a compliance that limits tensions far from the
    /// solution. `kept`: columns of the same unknowns are reused.
    pub fn gather(
        &mut self,
        tendons: &Tendons,
        friction: &Friction,
        rod: &mut dyn RoutedRod,
        old: &History,
        limiting_compliance: f64,
        kept: bool,
    ) {
        self.collect(tendons, friction);
        let kept = kept && (!friction.enabled || self.list == self.solved);
        let size = self.list.len();
        // whether all but the right-hand side is known
        let known = kept && self.problem.size == size;
        if !known {
            self.problem.resize(size);
        }
        if size == 0 {
            return;
        }
        if !known {
            self.columns.fill(&self.list, tendons);
        }
        rod.respond(Sources {
            tendons: if kept { &[] } else { &self.columns.sources },
            tensions: &self.columns.profile,
        });
        self.solved.clone_from(&self.list);
        let more = limiting_compliance - if known { self.limiting_compliance } else { 0.0 };
        self.limiting_compliance = limiting_compliance;
        // all columns, or only the response to the own imbalance
        self.beyond.resize(if known { 1 } else { size + 1 }, 0.0);
        for r in 0..size {
            let row = self.list[r];
            rod.beyond(row.hole(), row.tendon(), &mut self.beyond);
            if let Unknown::Tension(i) = row {
                tendons.take_clearance(rod, i, &mut self.beyond);
            }
            if !known {
                self.set_matrix_row(r, tendons);
            }
            if let Unknown::Tension(_) = row {
                self.problem.matrix[r * size + r] += more;
            }
            self.set_bounds(r, tendons, friction);
            self.set_right_side(r, tendons, old);
        }
    }

    /// Lists the unknowns: tensions under displacement control, and drops of sticking holes.
    fn collect(&mut self, tendons: &Tendons, friction: &Friction) {
        let (m, now) = (tendons.lines.len(), &tendons.now);
        self.list.clear();
        for (i, command) in now.commands.iter().enumerate() {
            if command.is_displacement() {
                self.list.push(Unknown::Tension(i));
            }
        }
        if !friction.enabled {
            return;
        }
        for (i, tension) in now.tensions.iter().enumerate() {
            if *tension == 0.0 || tendons.lines[i].friction == 0.0 {
                continue;
            }
            // an inextensible line prescribes the slip of the base hole
            let given = now.commands[i].is_displacement() && tendons.is_rigid_to_base(i);
            for hole in usize::from(given)..=tendons.routing.ends[i] {
                if friction.is_global() || now.slip[hole * m + i] == Slip::Sticks {
                    self.list.push(Unknown::Drop { tendon: i, hole });
                }
            }
        }
    }

    /// Derivative of a row's unstretched length with respect to every unknown.
    fn set_matrix_row(&mut self, r: usize, tendons: &Tendons) {
        let (n, size) = (tendons.routing.modules, self.list.len());
        let row = self.list[r];
        let (i, hole) = (row.tendon(), row.hole());
        let share = row_share(row, tendons);
        for (c, column) in self.list.iter().enumerate() {
            let place = &mut self.problem.matrix[r * size + c];
            *place = -share * self.beyond[c + 1];
            if let (Unknown::Tension(_), Unknown::Tension(_)) = (row, column) {
                *place += tendons.lines[i].mount_compliance;
            }
            if column.tendon() == i {
                *place += match (row, column) {
                    (Unknown::Drop { .. }, _) => self.columns.give[c * n + hole],
                    (Unknown::Tension(_), Unknown::Drop { .. }) => {
                        self.columns.stretch(c, i, tendons)
                    }
                    (Unknown::Tension(_), Unknown::Tension(_)) => {
                        let compliance = &tendons.compliance;
                        self.columns.stretch(c, i, tendons)
                            + compliance.before[i]
                            + compliance.regularisation[i]
                    }
                };
            }
        }
    }

    fn set_bounds(&mut self, r: usize, tendons: &Tendons, friction: &Friction) {
        let problem = &mut self.problem;
        match self.list[r] {
            Unknown::Tension(i) => {
                [problem.lower[r], problem.upper[r]] = [tendons.routing.least[i], f64::INFINITY];
            }
            Unknown::Drop { tendon, hole } => {
                let at = hole * tendons.lines.len() + tendon;
                let (tension, drop) = (tendons.tensions[at], tendons.now.drops[at]);
                let bound = friction.bounds[at];
                problem.lower[r] = tension * (drop - bound);
                problem.upper[r] = tension * (drop + bound);
                problem.side[r] = match tendons.now.slip[at] {
                    Slip::Towards => Side::Lower,
                    Slip::Away => Side::Upper,
                    Slip::Sticks => Side::Between,
                };
            }
        }
    }

    /// Slack or slip of a row due to the rod's own imbalance; tensions by their new value, drops by
    /// their change.
    fn set_right_side(&mut self, r: usize, tendons: &Tendons, old: &History) {
        let (n, m, size) = (
            tendons.routing.modules,
            tendons.lines.len(),
            self.list.len(),
        );
        let mut q = -row_share(self.list[r], tendons) * self.beyond[0];
        match self.list[r] {
            Unknown::Tension(i) => q += tendons.slack[i],
            Unknown::Drop { tendon, hole } => {
                for k in hole..n {
                    q -= tendons.now.spans[k * m + tendon] - old.spans[k * m + tendon];
                }
            }
        }
        let row = &self.problem.matrix[r * size..];
        for (column, entry) in self.list.iter().zip(row) {
            if let Unknown::Tension(j) = *column {
                q -= entry * tendons.now.tensions[j];
            }
        }
        self.problem.q[r] = q;
    }

    /// Whether only the rod is unknown.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Coefficient of each column in the step; the first is that of the own imbalance.
    pub fn coefficients(&mut self, tendons: &Tendons) -> &[f64] {
        self.coefficients.clear();
        self.coefficients.push(1.0);
        for (unknown, z) in self.list.iter().zip(&self.problem.z) {
            self.coefficients.push(match *unknown {
                Unknown::Tension(i) => z - tendons.now.tensions[i],
                Unknown::Drop { .. } => *z,
            });
        }
        &self.coefficients
    }

    /// Moves tensions and drops by a fraction of the step.
    pub fn take(&self, tendons: &mut Tendons, rod: &mut dyn RoutedRod, fraction: f64) {
        let m = tendons.lines.len();
        let solution = self.problem.z.iter().zip(&self.problem.side);
        let steps = self.list.iter().zip(self.coefficients.iter().skip(1));
        let mut moved = false;
        for ((unknown, step), (z, side)) in steps.zip(solution) {
            match *unknown {
                // a slack tendon has exactly zero tension
                Unknown::Tension(i) if fraction == 1.0 => tendons.now.tensions[i] = *z,
                Unknown::Tension(i) => tendons.now.tensions[i] += fraction * step,
                Unknown::Drop { tendon, hole } => {
                    let at = hole * m + tendon;
                    tendons.now.drops[at] -= fraction * step / tendons.tensions[at];
                    moved = true;
                    tendons.now.slip[at] = match side {
                        Side::Lower => Slip::Towards,
                        Side::Upper => Slip::Away,
                        Side::Between => Slip::Sticks,
                    };
                }
            }
        }
        apply(tendons, rod, moved);
    }

    /// Appends the unknowns to `out`, tensions multiplied by `per_tension`.
    pub fn write(&self, tendons: &Tendons, per_tension: f64, out: &mut Vec<f64>) {
        let m = tendons.lines.len();
        out.extend(self.list.iter().map(|unknown| match *unknown {
            Unknown::Tension(i) => per_tension * tendons.now.tensions[i],
            Unknown::Drop { tendon, hole } => tendons.now.drops[hole * m + tendon],
        }));
    }

    /// Sets the tendons to values as `write` appended them; false, with nothing changed, where a
    /// taut tendon would have a compressive force.
    pub fn read(
        &self,
        tendons: &mut Tendons,
        rod: &mut dyn RoutedRod,
        per_tension: f64,
        values: &[f64],
    ) -> bool {
        let m = tendons.lines.len();
        let all = self.list.iter().zip(&self.problem.side).zip(values);
        let pushes = |((unknown, side), value): ((&Unknown, &Side), &f64)| {
            let least = match *unknown {
                Unknown::Tension(i) => tendons.routing.least[i],
                Unknown::Drop { .. } => return false,
            };
            *side == Side::Between && *value <= least
        };
        if all.clone().any(pushes) {
            return false;
        }
        let mut moved = false;
        for ((unknown, side), value) in all {
            match *unknown {
                Unknown::Tension(_) if *side != Side::Between => {}
                Unknown::Tension(i) => tendons.now.tensions[i] = value / per_tension,
                Unknown::Drop { tendon, hole } => {
                    tendons.now.drops[hole * m + tendon] = *value;
                    moved = true;
                }
            }
        }
        apply(tendons, rod, moved);
        true
    }

    /// Whether the same tendons are taut and the same holes stick as at the last call.
    pub fn keeps_sides(&mut self) -> bool {
        let kept = self.sides == self.problem.side;
        self.sides.clone_from(&self.problem.side);
        kept
    }

    /// Replaces the bounds: slack tendons stay slack, and all other unknowns are free.
    pub fn keep_slack(&mut self, tendons: &Tendons) {
        for (r, unknown) in self.list.iter().enumerate() {
            let (problem, least) = (&mut self.problem, &tendons.routing.least);
            (problem.lower[r], problem.upper[r], problem.side[r]) = match *unknown {
                Unknown::Tension(i) if !tendons.is_taut(i) => (least[i], least[i], Side::Lower),
                _ => (f64::NEG_INFINITY, f64::INFINITY, Side::Between),
            };
        }
    }

    /// Whether some tensions can change together without motion.
    pub fn is_undetermined(&mut self, tendons: &Tendons) -> bool {
        let problem = &mut self.problem;
        let size = problem.size;
        let entries = (0..size).map(|i| problem.matrix[i * size + i]);
        let most = entries.fold(0.0, f64::max);
        let no_slack = NEGLIGIBLE_SLACK * tendons.routing.length;
        let free =
            |i: usize| tendons.compliance.regularisation[i] > 0.0 && tendons.slack[i] <= no_slack;
        for (r, unknown) in self.list.iter().enumerate() {
            problem.side[r] = match *unknown {
                Unknown::Tension(i) if free(i) => Side::Between,
                _ => Side::Lower,
            };
            problem.matrix[r * size + r] -= NEGLIGIBLE_STIFFNESS * most;
        }
        problem.negative_eigenvalues() > 0
    }
}

/// Fraction of the length change that enters a row.
fn row_share(row: Unknown, tendons: &Tendons) -> f64 {
    match row {
        Unknown::Tension(_) => tendons.step.share,
        Unknown::Drop { .. } => 1.0,
    }
}

fn apply(tendons: &mut Tendons, rod: &mut dyn RoutedRod, drops_moved: bool) {
    if drops_moved {
        (0..tendons.lines.len()).for_each(|i| tendons.carry(i));
    }
    tendons.apply(rod);
}
