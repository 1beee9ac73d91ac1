//! The tendons of a robot with their laws: friction and unknowns of a step.
//!
//! Theory: docs/theory/actuation.md.

use super::friction::Friction;
use super::history::History;
use super::line::{Command, Line};
use super::tendons::Tendons;
use super::unknowns::Unknowns;
use crate::model::error::InputError;
use crate::model::load::Model;
use crate::model::robot::Robot;
use crate::rod::routed::RoutedRod;
use crate::step::Lock;

/// Tendons, their friction, and the unknowns of a step.
#[derive(Clone)]
pub(crate) struct Transmission {
    pub tendons: Tendons,
    pub friction: Friction,
    pub unknowns: Unknowns,
}

impl Transmission {
    /// One line for each tendon; the home pose is found later.
    pub fn new(robot: &Robot, model: Model, lines: &[Line]) -> Result<Self, InputError> {
        let tendons = Tendons::new(robot, model, lines)?;
        Ok(Transmission {
            friction: Friction::new(&tendons),
            tendons,
            unknowns: Unknowns::default(),
        })
    }

    /// Prepares a step from `old`.
    pub fn start(&mut self, old: &History, commands: &[Command]) {
        self.tendons.start(old, commands);
        self.friction.start(&self.tendons, old);
        self.unknowns.start();
    }

    /// Friction at the present bend; see [`Friction::update`].
    pub fn update_friction(&mut self, rod: &mut dyn RoutedRod, old: &History, fresh: bool) -> bool {
        let settled = self.friction.update(&mut self.tendons, rod, old, fresh);
        self.tendons.apply(rod);
        settled
    }

    /// Friction of a perturbed path at the present bend; see [`Friction::keep`].
    pub fn keep_friction(&mut self, rod: &mut dyn RoutedRod, old: &History, nominal: &Self) {
        let drops = &nominal.tendons.now.drops;
        self.friction
            .keep(&mut self.tendons, rod, old, &nominal.friction, drops);
        self.tendons.apply(rod);
    }

    /// Solves for the unknowns of a perturbed path, with the columns of the nominal rod: holes that
    /// stick and tendons that are slack stay so. Returns whether there is a solution.
    pub fn solve_kept(&mut self, rod: &mut dyn RoutedRod, old: &History) -> bool {
        self.gather(rod, old, 0.0, true);
        self.unknowns.keep_slack(&self.tendons);
        self.unknowns.problem.solve()
    }

    /// Sets the problem of the unknowns; see [`Unknowns::gather`].
    pub fn gather(
        &mut self,
        rod: &mut dyn RoutedRod,
        old: &History,
        limiting_compliance: f64,
        kept: bool,
    ) {
        self.unknowns.gather(
            &self.tendons,
            &self.friction,
            rod,
            old,
            limiting_compliance,
            kept,
        );
    }

    /// Coefficient of each column in the step.
    pub fn coefficients(&mut self) -> &[f64] {
        self.unknowns.coefficients(&self.tendons)
    }

    /// Moves tensions and drops by a fraction of the step.
    pub fn take(&mut self, rod: &mut dyn RoutedRod, fraction: f64) {
        self.unknowns.take(&mut self.tendons, rod, fraction);
    }

    /// Constraints of small oscillations; see [`Friction::locks`].
    pub fn locks(&self) -> Vec<Lock> {
        self.friction.locks(&self.tendons)
    }

    /// Upper bound of the number of `locks`.
    pub fn lock_count(&self) -> usize {
        self.most_holes()
            + self
                .tendons
                .lines
                .iter()
                .filter(|line| line.friction == 0.0)
                .count()
    }

    /// Most holes that may stick at the same time.
    pub fn most_holes(&self) -> usize {
        let lines = self.tendons.lines.iter().zip(&self.tendons.routing.ends);
        let with_friction = lines.filter(|(line, _)| line.friction > 0.0);
        with_friction.map(|(_, end)| end + 1).sum()
    }
}
