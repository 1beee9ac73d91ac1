//! Linear response of the unloaded rod: where a solve from the straight backbone starts.
//!
//! Theory: docs/theory/statics.md (Globalisation).

use crate::criteria::MAX_EXTRAPOLATION;
use crate::dispatch::Passes;
use crate::math::linalg::Vec3;
use crate::model::load::Load;
use crate::model::robot::Robot;
use crate::rod::estimate::NEAR_BUCKLING;

/// Critical force on the tip of a column clamped at its base, over bending stiffness by squared
/// length (Euler).
const CRITICAL_FORCE: f64 = 2.467;

/// Strain of the unloaded rod and its derivatives by tensions, gravity and tip force.
#[derive(Clone)]
pub(super) struct Response {
    unloaded: Vec<Vec3>,
    /// By the numbers of a load: tensions, gravity, tip force.
    columns: Vec<Vec<Vec3>>,
    /// Share of the critical load by 1 N of force on the tip, 1 m/s^2 of gravity and 1 N of tension.
    shares: [f64; 3],
    start: Vec<Vec3>,
}

impl Response {
    /// Response of a rod, which is left under another load; none where the unloaded rod is unstable.
    pub fn of(rod: &mut dyn Passes, robot: &Robot) -> Option<Self> {
        let mut numbers = vec![0.0; robot.tendon_count() + 6];
        let (mut unloaded, mut columns) = (vec![], vec![]);
        let set = |rod: &mut dyn Passes, numbers: &[f64]| {
            let (tensions, forces) = numbers.split_at(robot.tendon_count());
            rod.load(&Load {
                tensions,
                gravity: [forces[0], forces[1], forces[2]],
                tip_force: [forces[3], forces[4], forces[5]],
                ..Load::default()
            });
            rod.make_unloaded();
            rod.evaluate();
            rod.gradient();
        };
        set(rod, &numbers);
        rod.linearise();
        if !(rod.eliminate(true, 0.0) > 0.0) {
            return None;
        }
        rod.strains(&mut |_, w| unloaded.push(w));
        for i in 0..numbers.len() {
            numbers[i] = 1.0;
            set(rod, &numbers);
            numbers[i] = 0.0;
            rod.newton_step(true);
            let mut column = Vec::with_capacity(unloaded.len());
            rod.steps(&mut |_, step| column.push(step));
            columns.push(column);
        }
        let span = robot
            .modules()
            .iter()
            .fold(0.0, |m, l| f64::max(m, l.flexible));
        let (per_length, length) = (1.0 / robot.moment_scale(), robot.length());
        Some(Response {
            start: unloaded.clone(),
            unloaded,
            columns,
            shares: [
                length * per_length / CRITICAL_FORCE,
                robot.mass() * length * per_length / CRITICAL_FORCE,
                span * span / length * per_length / NEAR_BUCKLING,
            ],
        })
    }

    /// Strain under a load; none where it bends far, or where a rod may have several equilibria: the
    /// sum of the shares of the critical loads bounds the share of all (Dunkerley's rule, with all
    /// weight at the tip).
    pub fn start(&mut self, load: &Load) -> Option<&[Vec3]> {
        let norm = |v: [f64; 3]| Vec3(v).norm();
        let pull = load.tensions.iter().map(|t| t.abs()).sum::<f64>();
        let [by_force, by_gravity, by_tension] = self.shares;
        let share =
            by_force * norm(load.tip_force) + by_gravity * norm(load.gravity) + by_tension * pull;
        if !(share < 1.0) || !load.fits_lanes() || !load.disk_forces.is_empty() {
            return None;
        }
        self.start.copy_from_slice(&self.unloaded);
        let numbers = load
            .tensions
            .iter()
            .chain(&load.gravity)
            .chain(&load.tip_force);
        for (number, column) in numbers.zip(&self.columns).filter(|(x, _)| **x != 0.0) {
            for (w, by_number) in self.start.iter_mut().zip(column) {
                *w += *by_number * *number;
            }
        }
        let turned = self.start.iter().zip(&self.unloaded);
        let near = |(w, unloaded): (&Vec3, &Vec3)| (*w - *unloaded).max_abs() < MAX_EXTRAPOLATION;
        turned
            .map(near)
            .fold(true, |all, near| all & near)
            .then_some(&self.start)
    }
}
