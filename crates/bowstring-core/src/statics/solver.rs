//! Static equilibrium: Newton's method, load stepping where it fails, and a status.
//!
//! Theory: docs/theory/statics.md.

use crate::criteria::MAX_EXTRAPOLATION;
pub use crate::criteria::TOLERANCE;
use crate::dispatch::{self, Passes, Plain};
use crate::interrupt;
pub use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, Model, OwnedLoad};
use crate::model::robot::Robot;
pub(crate) use crate::outcome::Settings;
pub use crate::outcome::{Outcome, Status};
use crate::rod::estimate::Verdict;
use crate::rod::sensitivity::Jacobians;
use crate::statics::directional::Linearised;
use crate::statics::newton::{newton, Attempt, MAX_ITERATIONS};
use crate::statics::response::Response;
use crate::step::oscillation::Equilibrium;

/// Least moment over (bending stiffness / length) that may lead from a stable equilibrium to an
/// unstable one.
const LEAST_LEADING_MOMENT: f64 = 0.1;
/// First increment of the load, as a fraction of it.
const FIRST_INCREMENT: f64 = 0.25;
/// Factor of the increment after one that converged.
const LONGER: f64 = 1.5;
/// Factor of the increment after one that did not.
const SHORTER: f64 = 0.3;
/// Increment below which load stepping is given up.
const LEAST_INCREMENT: f64 = 1e-3;
/// Newton steps in total after which smaller increments are not tried.
const MAX_CONTINUATION: usize = 3 * MAX_ITERATIONS;

/// A robot, its physics, and scratch memory for one solve after another.
///
/// ```
/// use bowstring_core::{model::load::{Load, Model}, model::robot::*, statics::solver::{Solver, Status}};
/// let section = Section { bending: [1.07; 2], principal_angle: 0.0, torsion: 0.83, axial: 6.9e5, shear: 2.6e5, mass_per_length: 0.035, rotary_inertia: 5.5e-8, rest_curvature: [0.0; 3] };
/// let disks = (1..=9).map(|k| Disk { hole_length: 0.0, station: 0.641 * k as f64 / 9.0, clamped_length: 0.0, mass: 0.02, inertia: [5.1e-6, 1.02e-5], segment: 0 });
/// let robot = Robot::new(RobotSpec {
///     payloads: vec![],
///     backbone: vec![section.into()],
///     disks: disks.collect(),
///     tendons: vec![Tendon::parallel([0.029, 0.0], 8)],
///     gravity: [0.0; 3],
/// })?;
/// let mut solver = Solver::new(&robot, Model::default(), 1)?;
/// let load = Load { tensions: &[40.0], ..Load::default() };
/// let outcome = solver.solve(&load)?;
/// assert_eq!(outcome.status, Status::Converged);
/// assert!((solver.tip().unwrap().position[0] - 0.2164).abs() < 1e-3);
/// # Ok::<(), bowstring_core::model::error::InputError>(())
/// ```
#[derive(Clone)]
pub struct Solver {
    pub(super) robot: Robot,
    model: Model,
    pub(super) elements: usize,
    pub(crate) engine: Box<dyn Passes>,
    pub(super) settings: Settings,
    /// The last load, for queries after the solve.
    load: OwnedLoad,
    /// Strain of the previous solutions, latest first, for extrapolation along a sweep.
    history: [Vec<Vec3>; 4],
    known: usize,
    /// Linear response of the unloaded robot, computed by the first solve from there.
    response: Option<Option<Response>>,
    /// Whether the last solve converged: only then are results available.
    settled: bool,
}

impl Solver {
    /// A solver with 1, 2, 4 or 8 fourth-order elements in a module.
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Result<Self, InputError> {
        dispatch::check_solvers(robot, elements, 1)?;
        let engine = dispatch::quickest(robot, model, elements)?;
        let straight = vec![Vec3::zero(); 2 * elements * robot.module_count()];
        Ok(Solver {
            engine,
            settings: Settings::new(robot, elements),
            robot: robot.clone(),
            model,
            elements,
            load: OwnedLoad::default(),
            history: std::array::from_fn(|_| straight.clone()),
            known: 0,
            // one that is solved with more elements is seldom solved again
            response: (elements > 1).then_some(None),
            settled: false,
        })
    }

    /// Copies the present strain of every arc and contact force of every module.
    pub(crate) fn strain_and_force(&self, strain: &mut [Vec3], force: &mut [Vec3]) {
        self.engine.strains(&mut |i, w| strain[i] = w);
        self.engine.contact_forces(&mut |k, n| force[k] = n);
    }

    pub(crate) fn at_rest(&self) -> Equilibrium<'_> {
        let n = self.robot.module_count();
        let (mut strain, mut force) = (
            vec![Vec3::zero(); 2 * self.elements * n],
            vec![Vec3::zero(); n],
        );
        self.strain_and_force(&mut strain, &mut force);
        Equilibrium {
            robot: &self.robot,
            model: self.model,
            elements: self.elements,
            strain,
            force,
        }
    }

    pub(crate) fn model(&self) -> Model {
        self.model
    }

    /// Elements in every module.
    pub fn elements(&self) -> usize {
        self.elements
    }

    /// Discards the last solution.
    pub(crate) fn unsettle(&mut self) {
        self.settled = false;
        self.known = 0;
    }

    /// Takes a strain as that of the last solution, from which `solve_next` starts.
    pub(super) fn take_strain(&mut self, strain: Vec<Vec3>) {
        self.history[0] = strain;
        self.known = 1;
    }

    /// Hands a load over to the engine. Loads between two disks divide modules, which takes a rod in
    /// plain numbers.
    pub(super) fn take_load(&mut self, load: &Load) {
        if self.elements > 1 && load.has_arc_lengths() && !self.engine.divides() {
            let mut plain = self.empty_plain();
            plain.take(load, &*self.engine, self.history[0].len());
            self.engine = plain;
        }
        self.engine.load(load);
    }

    /// Accepts the equilibrium held by the engine as the last solution; returns the module in which
    /// two disks collide.
    pub(crate) fn settle(&mut self, load: &Load) -> Option<usize> {
        self.engine.finish();
        self.load.set(load);
        self.known = 0;
        let collision = self.engine.collision();
        self.settled = collision.is_none();
        collision
    }

    /// The robot of the solver.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Equilibrium from the straight backbone, or from the linear response of the unloaded robot
    /// where a load has one equilibrium.
    pub fn solve(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        load.check_elements(&self.robot, self.elements)?;
        let load = &self.settings.without_negligible(load);
        let outcome = self.solve_from_straight(load);
        self.known = 0;
        self.remember(&outcome);
        Ok(outcome)
    }

    /// Equilibrium from the previous ones, for loads in a fine sequence.
    ///
    /// Extrapolates the strain of up to four previous solutions; falls back to a start from the
    /// straight backbone.
    pub fn solve_next(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        if self.known == 0 || !load.divides_as(&self.robot, &self.load.point_loads) {
            return self.solve(load);
        }
        let load = &self.settings.without_negligible(load);
        self.load.set(load);
        self.take_load(load);
        let [a, b, c, d] = &self.history;
        let ahead = |i: usize| match self.known {
            1 => a[i],
            2 => a[i] * 2.0 - b[i],
            3 => (a[i] - b[i]) * 3.0 + c[i],
            _ => (a[i] + c[i]) * 4.0 - b[i] * 6.0 - d[i],
        };
        // loads that jump are not extrapolated
        let close = (0..a.len()).all(|i| (ahead(i) - a[i]).max_abs() < MAX_EXTRAPOLATION);
        self.engine
            .set_strains(&|i| if close { ahead(i) } else { a[i] });
        let mut outcome = self.equilibrium(load, false);
        if outcome.status != Status::Converged {
            let tried = outcome.iterations;
            outcome = self.solve_from_straight(load);
            outcome.iterations += tried;
            self.known = 0;
        }
        self.remember(&outcome);
        Ok(outcome)
    }

    /// Equilibrium from a strain, or from the straight backbone, by Newton's method alone, without
    /// another start or load stepping.
    pub(crate) fn solve_from(&mut self, strain: Option<&[Vec3]>, load: &Load) -> Outcome {
        let load = &self.settings.without_negligible(load);
        self.load.set(load);
        self.take_load(load);
        // also discards the contact forces of other loads
        self.engine.make_unloaded();
        if let Some(strain) = strain {
            self.engine.set_strains(&|i| strain[i]);
        }
        let outcome = self.equilibrium(load, false);
        self.known = 0;
        self.remember(&outcome);
        outcome
    }

    /// Estimates the error of the last solution, whose outcome is `outcome`. Where its elements are
    /// too coarse to confirm a stable equilibrium, `stable` becomes `None`. Returns the elements in
    /// a module that the tolerances need; `None` without a solution.
    pub fn estimate_error(&mut self, outcome: &mut Outcome) -> Option<usize> {
        let verdict = self.verdict(outcome)?;
        outcome.error = Some(verdict.error);
        outcome.stable = verdict.stable;
        Some(verdict.needed)
    }

    pub(crate) fn verdict(&mut self, outcome: &Outcome) -> Option<Verdict> {
        if !self.settled {
            return None;
        }
        let found = self.engine.estimate();
        let (length, elements) = (self.settings.length, self.elements);
        Some(Verdict::new(
            &found,
            [0.0; 2],
            outcome.stable,
            length,
            elements,
        ))
    }

    /// Strain of the last equilibrium, if the last solve converged.
    pub(crate) fn last_strain(&self) -> Option<Vec<Vec3>> {
        (self.known > 0).then(|| self.history[0].clone())
    }

    fn solve_from_straight(&mut self, load: &Load) -> Outcome {
        self.load.set(load);
        let (engine, robot) = (&mut *self.engine, &self.robot);
        self.response
            .get_or_insert_with(|| Response::of(engine, robot));
        self.take_load(load);
        self.engine.make_unloaded();
        let response = self.response.as_mut().and_then(Option::as_mut);
        let mut tried = 0;
        if let Some(start) = response.and_then(|response| response.start(load)) {
            self.engine.set_strains(&|i| start[i]);
            let outcome = self.equilibrium(load, false);
            if outcome.status == Status::Converged && !outcome.left_unstable {
                return outcome;
            }
            tried = outcome.iterations;
            self.engine.make_unloaded();
        }
        let mut outcome = self.equilibrium(load, true);
        outcome.iterations += tried;
        outcome
    }

    fn remember(&mut self, outcome: &Outcome) {
        if outcome.status != Status::Converged {
            self.known = 0;
            return;
        }
        self.history.rotate_right(1);
        let latest = &mut self.history[0];
        self.engine.strains(&mut |i, w| latest[i] = w);
        self.known = (self.known + 1).min(4);
    }

    /// Solves from the strain in the engine; with `patience` also by load stepping.
    fn equilibrium(&mut self, load: &Load, patience: bool) -> Outcome {
        let mut outcome = Outcome::pending();
        let attempt = newton(&mut *self.engine, &self.settings, &mut outcome);
        let mut attempt = self.judged(attempt, load, false);
        if patience && !attempt.is_sound() {
            attempt = self.continued(attempt, load, &mut outcome);
        }
        match attempt {
            Attempt::Converged {
                stable,
                collision: None,
            } => {
                outcome.stable = stable;
                outcome.status = Status::Converged;
            }
            Attempt::Converged { collision, .. } => {
                outcome.collision = collision;
                outcome.status = Status::NoEquilibrium;
            }
            Attempt::Saddle => {
                outcome.stable = Some(false);
                outcome.status = Status::Unstable;
            }
            Attempt::Stuck => outcome.status = Status::MaxIterations,
        }
        self.settled = outcome.status == Status::Converged;
        outcome
    }

    /// Load stepping after a failed attempt: of the loads without a potential alone, then of the
    /// whole load.
    fn continued(&mut self, attempt: Attempt, load: &Load, outcome: &mut Outcome) -> Attempt {
        // if load stepping fails too, the first outcome is kept
        let first = *outcome;
        let mut continued = Attempt::Stuck;
        if !load.has_potential() {
            let mut rest = OwnedLoad::default();
            rest.set(load);
            rest.scale(1.0, 0.0);
            let rest = self.solve_from_straight(&rest.borrow());
            self.load.set(load);
            outcome.iterations += rest.iterations;
            if rest.status == Status::Converged {
                continued = self.continuation(load, false, outcome);
                let unstable = Some(false);
                if !matches!(continued, Attempt::Converged { stable, .. } if stable == unstable) {
                    outcome.left_unstable |= matches!(attempt, Attempt::Saddle);
                    outcome.left_unstable |= rest.left_unstable;
                }
            }
        }
        if !continued.is_sound() {
            outcome.left_unstable = first.left_unstable;
            continued = self.continuation(load, true, outcome);
        }
        match (attempt, continued) {
            (_, continued) if continued.is_sound() => continued,
            // at the full load disks collide
            (Attempt::Stuck, continued @ Attempt::Converged { .. }) => continued,
            (Attempt::Stuck, _) => Attempt::Stuck,
            (attempt, _) => {
                outcome.residual = first.residual;
                attempt
            }
        }
    }

    /// Raises the load from zero by adaptive increments: the whole load or, from the engine's
    /// equilibrium under the other loads, those without a potential alone. Reports the fraction
    /// reached. Disks that collide on the way are passed if there is no other: only the whole load
    /// has to keep them apart.
    fn continuation(&mut self, load: &Load, all: bool, outcome: &mut Outcome) -> Attempt {
        let mut part = OwnedLoad::default();
        let mut start = vec![Vec3::zero(); self.history[0].len()];
        let (mut reached, mut increment) = (0.0, if all { FIRST_INCREMENT } else { 1.0 });
        let mut passes = false;
        if all {
            self.engine.make_unloaded();
        }
        self.engine.strains(&mut |i, w| start[i] = w);
        loop {
            let fraction = f64::min(reached + increment, 1.0);
            let share = if all { fraction } else { 1.0 };
            part.set(load);
            part.scale(share, fraction);
            let mut attempt = self.attempt_from(&start, &part.borrow(), outcome);
            if fraction == 1.0 {
                let size = load.size_without_potential(self.settings.length);
                let leads =
                    !all && !passes && size > LEAST_LEADING_MOMENT * self.settings.moment_scale;
                attempt = self.judged(attempt, load, leads);
            }
            let collides = matches!(
                attempt,
                Attempt::Converged {
                    collision: Some(_),
                    ..
                }
            );
            let sound = attempt.is_sound() || collides && passes;
            if sound && fraction == 1.0 {
                outcome.fraction = 1.0;
                return attempt;
            }
            if sound {
                self.engine.strains(&mut |i, w| start[i] = w);
                reached = fraction;
                increment *= LONGER;
            } else {
                increment *= SHORTER;
            }
            if !passes {
                outcome.fraction = reached;
            }
            if fraction == 1.0 && matches!(attempt, Attempt::Saddle) && !load.has_potential() {
                // converged to an unstable equilibrium: smaller increments lead to the same
                return attempt;
            }
            if increment < LEAST_INCREMENT && collides {
                passes = true;
                increment = FIRST_INCREMENT;
            }
            // limit the time spent on a load without an equilibrium
            if increment < LEAST_INCREMENT
                || outcome.iterations > MAX_CONTINUATION
                || interrupt::interrupted()
            {
                return Attempt::Stuck;
            }
        }
    }

    /// Newton's method from a strain, with its steps added to `outcome`.
    fn attempt_from(&mut self, start: &[Vec3], load: &Load, outcome: &mut Outcome) -> Attempt {
        self.take_load(load);
        self.engine.make_unloaded();
        self.engine.set_strains(&|i| start[i]);
        let mut part = Outcome {
            iterations: 0,
            ..*outcome
        };
        let attempt = newton(&mut *self.engine, &self.settings, &mut part);
        outcome.iterations += part.iterations;
        outcome.residual = part.residual;
        outcome.left_unstable |= part.left_unstable;
        attempt
    }

    /// Pose of the tip, which is the last disk; `None`, as for all that follow, unless the last
    /// solve converged.
    pub fn tip(&self) -> Option<Pose> {
        self.disk(self.robot.module_count() - 1)
    }

    /// Pose of a disk, with index 0 next to the base.
    pub fn disk(&self, k: usize) -> Option<Pose> {
        self.settled.then(|| self.engine.disk(k))
    }

    /// Length of a tendon from the base hole to the hole of its end disk (m).
    pub fn tendon_length(&self, i: usize) -> Option<f64> {
        self.settled.then(|| self.engine.length(i))
    }

    /// Points of the backbone (m), `per_module` in each module, base and tip included.
    pub fn centerline(&self, per_module: usize) -> Option<Vec<Vec3>> {
        self.settled.then(|| self.plain().centerline(per_module))
    }

    /// Derivatives of the last equilibrium, those with respect to gravity if requested; `None` for
    /// continuous tendons, and where the equilibrium is so close to losing stability that they are
    /// not finite.
    pub fn jacobians(&self, gravity: bool) -> Option<Jacobians> {
        if !self.settled {
            return None;
        }
        let segments: Vec<_> = self.robot.spec().disks.iter().map(|d| d.segment).collect();
        self.plain().jacobians(&segments, gravity)
    }

    /// The last equilibrium with its tangent, for derivatives along lines; `None` as for
    /// [`Solver::jacobians`].
    pub fn linearised(&self) -> Option<Linearised> {
        if !self.settled {
            return None;
        }
        let mut strain = vec![Vec3::zero(); self.history[0].len()];
        self.engine.strains(&mut |i, w| strain[i] = w);
        Linearised::new(&self.robot, self.model, &self.load.borrow(), strain)
    }

    /// Derivatives of the tip's position and rotation by each tension at the last equilibrium, and
    /// in the engine those of its strain; false where the engine has none.
    pub(super) fn tip_by_tensions_in_lanes(&mut self, columns: &mut [[Vec3; 2]]) -> bool {
        if !(self.settled && self.engine.respond_to_tensions(columns)) {
            return false;
        }
        let mut entries = columns.iter().flatten().flat_map(|v| v.0);
        entries.all(f64::is_finite)
    }

    /// Derivatives of the tip's position and, if wanted, rotation by each tension at the last
    /// equilibrium, in a rod of [`Solver::empty_plain`]; false where `jacobians` is `None`.
    pub(super) fn tip_by_tensions(
        &self,
        plain: &mut dyn Plain,
        rotation: bool,
        columns: &mut [[Vec3; 2]],
    ) -> bool {
        if !self.settled {
            return false;
        }
        plain.take(&self.load.borrow(), &*self.engine, self.history[0].len());
        plain.tip_by_tensions(rotation, columns)
    }

    /// A rod in plain numbers with the same modules.
    pub(super) fn empty_plain(&self) -> Box<dyn Plain> {
        dispatch::plain(&self.robot, self.model, self.elements)
            .expect("elements were checked when the solver was made")
    }

    /// The present state in plain numbers, evaluated.
    fn plain(&self) -> Box<dyn Plain> {
        let mut plain = self.empty_plain();
        plain.take(&self.load.borrow(), &*self.engine, self.history[0].len());
        plain
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::instructions::Instructions;
    use crate::model::load::PointLoad;
    use crate::model::robot::{Profile, RobotSpec, Section};
    use crate::parts;

    fn robot() -> Robot {
        with_backbone(|section| section.into())
    }

    fn with_backbone(profile: impl Fn(Section) -> Profile) -> Robot {
        let sections = [1.1, 0.7].map(parts::section);
        let spec = parts::robot(&sections, &[6, 5], [0.06, 0.002], 1.0, &[5, 5, 10, 10, 10]);
        Robot::new(RobotSpec {
            backbone: sections.map(profile).to_vec(),
            ..spec
        })
        .unwrap()
    }

    /// From the linear response a solve is shorter, and ends where it does from straight; beyond the
    /// critical load it starts from straight.
    #[test]
    fn linear_response_is_a_start() {
        let mut solver = Solver::new(&robot(), Model::default(), 1).unwrap();
        let mut steps = [0; 2];
        for (tension, side) in [(0.0, 0.4), (5.0, -0.2), (20.0, 0.1), (40.0, 0.0)] {
            let tensions = [0.2 * tension, 0.0, tension, 0.1 * tension, 0.0];
            let load = Load {
                tensions: &tensions,
                gravity: [0.0, 5.0, -5.0],
                tip_force: [side, 0.0, 0.1],
                ..Load::default()
            };
            let straight = solver.solve_from(None, &load);
            let wanted = solver.tip().unwrap();
            let found = solver.solve(&load).unwrap();
            let off = solver.tip().unwrap().position - wanted.position;
            assert_eq!(found.stable, Some(true));
            assert!(off.max_abs() < 1e-9, "{off:?}");
            steps[0] += straight.iterations;
            steps[1] += found.iterations;
        }
        assert!(steps[1] < steps[0], "{steps:?}");
        let critical = Load {
            tensions: &[0.0; 5],
            tip_force: [0.0, 0.0, -20.0],
            ..Load::default()
        };
        let mut response = Response::of(&mut *solver.engine, &solver.robot).unwrap();
        assert!(response.start(&critical).is_none());
    }

    /// All engines that this processor can run give the same solution.
    #[test]
    fn engines_agree() {
        for elements in [1, 2] {
            check_engines(elements);
        }
    }

    fn check_engines(elements: usize) {
        let (robot, model) = (robot(), Model::default());
        let engines =
            Instructions::ALL.map(|most| dispatch::up_to(most, &robot, model, elements).unwrap());
        for (tip_force, tip_moment) in [([0.3, -0.2, 0.1], [0.0; 3]), ([0.0; 3], [0.05, 0.1, 0.1])]
        {
            let load = Load {
                tensions: &[5.0, 20.0, 10.0, 0.0, 15.0],
                gravity: [0.0, 0.0, -9.81],
                tip_force,
                tip_moment,
                ..Load::default()
            };
            let mut solver = Solver::new(&robot, model, elements).unwrap();
            let mut first = None;
            for engine in &engines {
                solver.engine = engine.clone();
                let outcome = solver.solve(&load).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                let solution = (
                    solver.tip().unwrap().position,
                    solver.tendon_length(1).unwrap(),
                    outcome.iterations,
                );
                let (tip, length, iterations) = *first.get_or_insert(solution);
                assert!((solution.0 - tip).norm() < 1e-11);
                assert!((solution.1 - length).abs() < 1e-11);
                assert_eq!(solution.2, iterations);
            }
        }
    }

    /// Lanes hold neither couplings nor loads between two disks: those are solved in plain numbers.
    #[test]
    fn couplings_and_loads_between_disks_take_plain_numbers() {
        let coupled = with_backbone(|s| {
            let mut stiffness = [[0.0; 6]; 6];
            let own = [
                s.bending[0],
                s.bending[1],
                s.torsion,
                s.shear,
                s.shear,
                s.axial,
            ];
            for (q, x) in own.into_iter().enumerate() {
                stiffness[q][q] = x;
            }
            // bending with twist
            (stiffness[0][2], stiffness[2][0]) = (0.4 * s.torsion, 0.4 * s.torsion);
            Profile::of_stiffness(stiffness, s.mass_per_length, s.rotary_inertia, [0.0; 3])
        });
        assert!(coupled.is_coupled());
        let between = [PointLoad {
            arc_length: Some(0.21),
            force: [0.5, 0.2, -1.0],
            moment: [0.02, 0.0, 0.01],
            ..PointLoad::default()
        }];
        let load = Load {
            tensions: &[5.0, 20.0, 10.0, 0.0, 15.0],
            gravity: [0.0, 0.0, -9.81],
            tip_force: [0.3, -0.2, 0.1],
            ..Load::default()
        };
        let loaded = Load {
            point_loads: &between,
            ..load
        };
        for elements in [2, 4] {
            for (robot, loads) in [(&coupled, vec![load]), (&robot(), vec![load, loaded, load])] {
                let model = Model::default();
                let mut solver = Solver::new(robot, model, elements).unwrap();
                let mut plain = solver.clone();
                plain.engine = dispatch::plain(robot, model, elements).unwrap();
                for load in loads {
                    for next in [false, true] {
                        let [tip, other] = [&mut solver, &mut plain].map(|solver| {
                            let outcome = match next {
                                false => solver.solve(&load).unwrap(),
                                true => solver.solve_next(&load).unwrap(),
                            };
                            assert_eq!(outcome.status, Status::Converged);
                            solver.tip().unwrap().position
                        });
                        assert!((tip - other).norm() < 1e-10, "{elements}");
                    }
                }
            }
        }
        // the strain is kept where plain numbers take the place of lanes
        let mut solver = Solver::new(&robot(), Model::default(), 2).unwrap();
        solver.solve(&load).unwrap();
        let mut before = vec![Vec3::zero(); solver.history[0].len()];
        solver.engine.strains(&mut |i, w| before[i] = w);
        solver.take_load(&loaded);
        assert!(solver.engine.divides());
        solver
            .engine
            .strains(&mut |i, w| assert_eq!(w.0, before[i].0));
    }

    /// No results are available without convergence.
    #[test]
    fn no_numbers_without_convergence() {
        let robot = robot();
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        let nothing = |solver: &Solver| {
            solver.tip().is_none()
                && solver.disk(0).is_none()
                && solver.tendon_length(0).is_none()
                && solver.centerline(4).is_none()
                && solver.jacobians(false).is_none()
        };
        assert!(nothing(&solver));
        let load = |tensions: &'static [f64; 5]| Load {
            tensions,
            ..Load::default()
        };
        solver.solve(&load(&[1.0, 2.0, 3.0, 0.0, 1.0])).unwrap();
        assert!(solver.tip().is_some() && solver.jacobians(false).is_some());
        let far = solver.solve(&load(&[0.0, 0.0, 1e5, 0.0, 0.0])).unwrap();
        assert_ne!(far.status, Status::Converged);
        assert!(far.stable != Some(true) && far.fraction < 1.0);
        assert!(nothing(&solver));
        let near = solver
            .solve_next(&load(&[1.0, 2.0, 3.0, 0.0, 1.0]))
            .unwrap();
        assert_eq!(near.status, Status::Converged);
    }
}
