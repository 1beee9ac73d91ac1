//! One implicit step of a path: Newton's method on strain, tensions and friction.
//!
//! Theory: docs/theory/actuation.md.

use crate::criteria::{is_length_settled, LOOSE, MAX_STEP, TOLERANCE};
use crate::dispatch::Passes;
use crate::interrupt;
use crate::math::anderson::AndersonAcceleration;
use crate::math::linalg::Vec3;
use crate::model::load::{Load, OwnedLoad};
use crate::outcome::PathOutcome;
use crate::statics::inelastic::UnloadedCurvature;
use crate::statics::relaxation::CreepingTendons;
use crate::statics::solver::{Solver, Status};
use crate::tendon::{Command, History, Transmission};

// Tuned constants of the iteration. Lengths are fractions of the robot's length.

/// Length error where tensions are determined by regularisation alone, which needs a much smaller
/// one than [`LOOSE`].
const TIGHT: f64 = 1e-14;
/// Largest elongation due to regularisation: far below any that is measurable.
const MAX_REGULARISATION_LENGTH: f64 = 1e-9;
/// Most Newton steps; a step that converges takes fewer than ten, with friction twenty.
const MAX_STEPS: usize = 60;
/// The same from a guess near the solution, where fewer than ten are taken.
const MAX_STEPS_NEARBY: usize = 15;
/// Residual below which an old tangent may be kept, and the contraction that it must reach.
const NEAR: f64 = 1e-2;
const CONTRACTION: f64 = 0.3;
/// Newton steps at the start of a path in which a hole may change directly between the two
/// directions of slip.
const FRESH_STEPS: usize = 5;
/// Negligible pivot over the unit of the shift; growth factor of the tangent's shift; and bounds of
/// the shift over the same unit.
const NEGLIGIBLE_PIVOT: f64 = 1e-12;
const SHIFT_GROWTH: f64 = 4.0;
const LEAST_SHIFT: f64 = 4e-3;
const MOST_SHIFT: f64 = 1e12;
/// Largest compliance that limits changes of tension far from the solution, over that of bending.
const MAX_LIMITING_COMPLIANCE: f64 = 1e-2;
/// Most Newton steps in total, and most increments, of one step of the path; the first increment,
/// its factors after success and failure, and the least increment.
const MOST_ITERATIONS: usize = 400;
const MAX_INCREMENTS: usize = 60;
const FIRST_INCREMENT: f64 = 0.5;
const INCREMENT_FACTORS: [f64; 2] = [1.5, 0.4];
const LEAST_INCREMENT: f64 = 1e-3;
/// Most work of one step of the path, in units of [`interrupt::work`] (about a second); but at
/// least that of so many Newton steps with all unknowns.
const MOST_WORK: usize = 100_000_000;
const LEAST_STEPS: usize = 60;
/// Eliminations of the unknowns in a Newton step with friction, about.
const ELIMINATIONS: usize = 8;
/// Most Newton steps from the strain of other elements.
const MAX_SETTLING: usize = 10;

/// Solver and tendons of a path, at its last step.
#[derive(Clone)]
pub(crate) struct PathStep {
    pub solver: Solver,
    pub transmission: Transmission,
    /// Where the backbone has hysteresis or relaxation.
    pub unloaded: Option<UnloadedCurvature>,
    /// Where tendons creep.
    pub creep: Option<CreepingTendons>,
    /// Initial guess of the next step, where known.
    pub guess: Option<History>,
    acceleration: Acceleration,
    /// Gradient that the solution has left, where it is linearised for perturbed paths (N m).
    pub(super) imbalance: Vec<Vec3>,
}

/// Anderson acceleration of the steps with a partial tangent.
#[derive(Clone)]
struct Acceleration {
    anderson: AndersonAcceleration,
    /// Unknowns at the start and at the end of a Newton step.
    ends: [Vec<f64>; 2],
    /// Scale of tensions: approximate rotation of a module due to 1 N in a tendon (rad/N).
    per_tension: f64,
}

/// Largest moment imbalance over (bending stiffness / length), and length error over the robot's
/// length.
#[derive(Clone, Copy)]
struct Residuals {
    moment: f64,
    length: f64,
}

/// State of the iteration.
struct Iteration {
    symmetric: bool,
    /// Whether regularisation determines tensions that neither rod nor line does.
    rigid: bool,
    /// Unit of the shift.
    unit: f64,
    /// Stiffness added to the tangent while it is not positive definite.
    shift: f64,
    /// Residuals of the iteration before.
    last: Residuals,
    /// Least pivot of the tangent.
    pivot: f64,
}

impl Iteration {
    /// Whether only friction may be left to solve.
    fn is_settled(&self, now: &Residuals) -> bool {
        let loose = if self.rigid { TIGHT } else { LOOSE };
        now.moment <= TOLERANCE && is_length_settled(now.length, self.last.length, loose)
    }

    /// Whether the tangent is positive definite.
    fn is_definite(&self) -> bool {
        self.pivot > NEGLIGIBLE_PIVOT * self.unit
    }

    /// Raises the shift of the tangent; false at its upper bound.
    fn raise_shift(&mut self) -> bool {
        self.shift = if self.shift == 0.0 {
            self.unit
        } else {
            SHIFT_GROWTH * self.shift
        };
        self.shift <= MOST_SHIFT * self.unit
    }

    fn lower_shift(&mut self) {
        self.shift = if self.shift < LEAST_SHIFT * self.unit {
            0.0
        } else {
            self.shift / SHIFT_GROWTH
        };
    }
}

impl PathStep {
    pub fn new(solver: Solver, transmission: Transmission) -> Self {
        let robot = solver.robot();
        let scale = transmission.tendons.compliance.scale / robot.moment_scale();
        PathStep {
            acceleration: Acceleration {
                anderson: AndersonAcceleration::default(),
                ends: Default::default(),
                per_tension: scale.sqrt() / robot.module_count() as f64,
            },
            solver,
            transmission,
            unloaded: None,
            creep: None,
            guess: None,
            imbalance: vec![],
        }
    }

    /// Whether equilibria depend on the path: with friction, backlash, hysteresis, relaxation or
    /// creep.
    pub fn has_memory(&self) -> bool {
        let backlash = self.transmission.tendons.has_backlash();
        self.tangent_is_partial() || self.creep.is_some() || backlash
    }

    /// Whether the tangent leaves changes of friction or of the unloaded curvature out.
    fn tangent_is_partial(&self) -> bool {
        self.transmission.friction.enabled || self.unloaded.is_some()
    }

    /// Prepares relaxation and creep for a step from `old`, also one in several increments.
    pub fn begin(&mut self, old: &History, duration: f64) {
        if self.unloaded.is_some() {
            self.take(&old.load.borrow(), old);
        }
        if let Some(unloaded) = &mut self.unloaded {
            unloaded.begin(&*self.solver.engine, old, duration);
        }
        if let Some(creep) = &mut self.creep {
            creep.begin(&mut self.transmission.tendons, old, duration);
        }
    }

    /// Measures what is lost in holes and mount at a state of the path.
    pub fn measure_losses(&mut self, at: &History) {
        if self.transmission.tendons.have_losses() {
            self.take(&at.load.borrow(), at);
            self.solver.engine.evaluate();
            let engine = &*self.solver.engine;
            self.transmission.tendons.measure_losses(engine);
        }
    }

    /// Most work of a step, in units of [`interrupt::work`].
    pub fn most_work(&self) -> usize {
        let transmission = &self.transmission;
        let most = transmission.tendons.lines.len() + transmission.most_holes();
        let eliminations = ELIMINATIONS * most.pow(3) / 96;
        MOST_WORK.max(LEAST_STEPS * (self.work(most) + eliminations))
    }

    /// Work of a Newton step apart from the elimination of the unknowns, of that number.
    fn work(&self, unknowns: usize) -> usize {
        self.solver.settings.work * (2 + unknowns)
    }

    /// Solves for the load directly, from the guess and else from `old`, or by load stepping where
    /// that fails; after `begin`.
    pub fn solve(&mut self, old: &History, commands: &[Command], load: &Load) -> PathOutcome {
        if let Some(guess) = self.guess.take().filter(|guess| guess.is_alike(old)) {
            let found = self.newton(old, commands, load, Some(&guess));
            if found.status == Status::Converged {
                return found;
            }
        }
        let first = self.newton(old, commands, load, None);
        if first.status == Status::Converged {
            return first;
        }
        let (mut reached, mut increment) = (0.0, FIRST_INCREMENT);
        let (mut increments, mut iterations) = (0, first.iterations);
        let mut from = old.clone();
        let mut part_commands = commands.to_vec();
        let mut part = OwnedLoad::default();
        for _ in 0..MAX_INCREMENTS {
            let share = f64::min(reached + increment, 1.0);
            // a motor that changes its kind of command starts from the tendon's present value
            for (i, to) in commands.iter().enumerate() {
                let start = match to {
                    Command::Tension(_) => old.tensions[i],
                    Command::Displacement(_) => old.displacements[i],
                };
                part_commands[i] = to.with(between(start, to.value(), share));
            }
            part.between_dead(&old.load, load, share);
            let part = part.borrow();
            let now = if share == 1.0 { load } else { &part };
            let found = self.newton(&from, &part_commands, now, None);
            iterations += found.iterations;
            if iterations > MOST_ITERATIONS || interrupt::must_end() {
                break;
            }
            if found.status == Status::Converged {
                increments += 1;
                if share == 1.0 {
                    return PathOutcome {
                        increments,
                        iterations,
                        ..found
                    };
                }
                from = self.transmission.tendons.now.clone();
                reached = share;
                increment *= INCREMENT_FACTORS[0];
            } else {
                increment *= INCREMENT_FACTORS[1];
                if increment < LEAST_INCREMENT {
                    break;
                }
            }
        }
        PathOutcome {
            iterations,
            ..first
        }
    }

    /// One implicit step from `old`, by Newton's method from the pose, tensions and slip of `guess`,
    /// without one from those of `old`; leaves the solution in `self.transmission`.
    fn newton(
        &mut self,
        old: &History,
        commands: &[Command],
        load: &Load,
        guess: Option<&History>,
    ) -> PathOutcome {
        let mut outcome = PathOutcome::pending();
        self.start(old, commands, load);
        let mut most_steps = MAX_STEPS;
        if let Some(guess) = guess {
            self.start_at(guess);
            most_steps = MAX_STEPS_NEARBY;
        }
        let friction = self.transmission.friction.enabled;
        let fresh = friction && guess.unwrap_or(old).drops.iter().all(|y| *y == 0.0);
        let mut state = Iteration {
            symmetric: load.has_potential(),
            rigid: self.transmission.tendons.is_rigid(),
            unit: self.solver.settings.shift_unit,
            shift: 0.0,
            last: Residuals {
                moment: 0.0,
                length: f64::INFINITY,
            },
            pivot: f64::NAN,
        };
        // friction has no potential, but a buckled column is detected all the same
        let stable = (!self.tangent_is_partial()).then_some(true);
        for step in 0..=most_steps {
            self.follow_strain(old);
            let work = self.work(self.transmission.unknowns.problem.size);
            if interrupt::work(work) || !self.solver.engine.evaluate().is_finite() {
                return outcome;
            }
            let mut settled = self.update_tendons(old, fresh && step < FRESH_STEPS);
            let residuals = self.residuals();
            outcome.residual = residuals.moment;
            outcome.length_residual = residuals.length * self.solver.robot().length();
            settled &= state.is_settled(&residuals) && self.sticks(old);
            if !residuals.moment.is_finite() || (step == most_steps && !settled) {
                return outcome;
            }
            if settled && !state.symmetric {
                // without a potential stability is not decided
                if state.pivot.is_nan() {
                    // settled at the start: the estimate of the error needs a tangent
                    self.make_tangent(&mut state, true);
                }
                return self.finish(outcome, load);
            }
            let kept = !settled && self.keeps_tangent(&state, &residuals);
            state.last = residuals;
            if !kept {
                self.make_tangent(&mut state, settled);
            }
            if state.pivot.is_nan() {
                return outcome;
            }
            if settled && state.is_definite() && !state.rigid {
                outcome.stable = stable;
                return self.finish(outcome, load);
            }
            let solved = self.solve_unknowns(old, &state, kept);
            if interrupt::must_end() {
                return outcome;
            }
            if self.is_indefinite(&state) {
                if settled {
                    outcome.status = Status::Unstable;
                    outcome.stable = Some(false);
                    return outcome;
                }
                if !state.raise_shift() {
                    return outcome;
                }
                continue;
            }
            if settled {
                outcome.stable = stable;
                return self.finish(outcome, load);
            }
            if !solved {
                return outcome;
            }
            if !kept || (friction && !self.transmission.friction.unchanged) {
                self.acceleration.anderson.clear();
            }
            if !self.advance(state.symmetric) {
                return outcome;
            }
            state.lower_shift();
            outcome.iterations += 1;
        }
        outcome
    }

    /// Measures the spans of the present state anew, at its tensions, friction and set: those of
    /// other elements have other errors, which holes that stick would keep. Leaves them where that
    /// does not converge.
    pub fn settle_spans(&mut self) {
        let now = self.transmission.tendons.now.clone();
        let load = now.load.borrow();
        self.start(&now, &now.commands, &load);
        let (scale, symmetric) = (self.solver.settings.moment_scale, load.has_potential());
        let engine = &mut *self.solver.engine;
        self.transmission.tendons.apply(engine);
        if let Some(unloaded) = &mut self.unloaded {
            unloaded.hold(engine, &now);
        }
        for _ in 0..MAX_SETTLING {
            if !engine.evaluate().is_finite() {
                break;
            }
            if engine.gradient() <= TOLERANCE * scale {
                engine.measure_spans(false);
                let tendons = &mut self.transmission.tendons;
                tendons.measure(engine);
                let strain = &mut tendons.now.strain;
                engine.strains(&mut |i, w| strain[i] = w);
                return;
            }
            engine.linearise();
            engine.eliminate(symmetric, 0.0);
            let largest = engine.newton_step(symmetric).largest;
            if !largest.is_finite() {
                break;
            }
            engine.save();
            engine.advance((MAX_STEP / largest).min(1.0));
        }
        self.transmission.tendons.now = now;
    }

    /// Sets the load, at the pose and tensions of the step before.
    pub(super) fn start(&mut self, old: &History, commands: &[Command], load: &Load) {
        self.transmission.start(old, commands);
        self.transmission.tendons.now.load.set_dead(load);
        self.take(load, old);
        self.transmission.tendons.apply(&mut *self.solver.engine);
    }

    /// Sets a load at the strain of `old`.
    fn take(&mut self, load: &Load, old: &History) {
        self.solver.take_load(&Load {
            tensions: &self.transmission.tendons.now.tensions,
            ..*load
        });
        let engine = &mut *self.solver.engine;
        engine.make_unloaded();
        engine.set_strains(&|i| old.strain[i]);
    }

    /// Moves the unloaded curvature with the present strain.
    pub(super) fn follow_strain(&mut self, old: &History) {
        if let Some(unloaded) = &mut self.unloaded {
            unloaded.follow(&mut *self.solver.engine, old);
        }
    }

    /// Updates friction, lengths and slack at the present strain; returns whether friction is
    /// settled.
    fn update_tendons(&mut self, old: &History, fresh: bool) -> bool {
        let engine = &mut *self.solver.engine;
        let friction = self.transmission.friction.enabled;
        engine.measure_spans(friction);
        let mut settled = true;
        if friction {
            settled = self.transmission.update_friction(engine, old, fresh);
            engine.balance();
        }
        self.transmission.tendons.measure(engine);
        settled
    }

    fn residuals(&mut self) -> Residuals {
        let robot = self.solver.robot();
        let (scale, length) = (robot.moment_scale(), robot.length());
        Residuals {
            moment: self.solver.engine.gradient() / scale,
            length: self.transmission.tendons.length_residual() / length,
        }
    }

    /// Whether no hole that sticks has slipped since `old`, by more than rounding.
    fn sticks(&self, old: &History) -> bool {
        if !self.transmission.friction.enabled {
            return true;
        }
        let slip = self.transmission.tendons.stick_residual(old);
        slip <= LOOSE * self.solver.robot().length()
    }

    /// Whether the tangent of the iteration before is kept: where it is partial, convergence does not
    /// improve with a new one, and Anderson acceleration works better with a constant one.
    fn keeps_tangent(&self, state: &Iteration, now: &Residuals) -> bool {
        self.tangent_is_partial()
            && now.moment < NEAR
            && now.moment < CONTRACTION * state.last.moment
            && state.shift == 0.0
    }

    /// Assembles and eliminates the tangent at the present strain; unshifted if `settled`.
    fn make_tangent(&mut self, state: &mut Iteration, settled: bool) {
        let engine = &mut *self.solver.engine;
        engine.linearise();
        let shift = if settled { 0.0 } else { state.shift };
        state.pivot = engine.eliminate(state.symmetric, shift);
    }

    /// Solves for the unknown tensions and drops (theory Eq. 4.2); returns whether there is a
    /// solution.
    fn solve_unknowns(&mut self, old: &History, state: &Iteration, kept: bool) -> bool {
        // far from the solution, limit tensions that the rod hardly determines
        let limiting_compliance = if state.rigid {
            let scale = self.transmission.tendons.compliance.scale;
            scale * f64::min(MAX_LIMITING_COMPLIANCE, state.last.length)
        } else {
            0.0
        };
        let engine = &mut *self.solver.engine;
        self.transmission
            .gather(engine, old, limiting_compliance, kept);
        self.transmission.unknowns.problem.solve()
    }

    /// Whether the energy has a direction of negative curvature, apart from those that displacement
    /// control holds.
    fn is_indefinite(&mut self, state: &Iteration) -> bool {
        if !state.symmetric || state.is_definite() {
            return false;
        }
        let held = self.transmission.unknowns.problem.negative_eigenvalues();
        self.solver.engine.negative_pivots() > held
    }

    /// Moves strain, tensions and drops by the step; false if it is not finite.
    fn advance(&mut self, symmetric: bool) -> bool {
        let engine = &mut *self.solver.engine;
        let largest = if self.transmission.unknowns.is_empty() {
            engine.newton_step(symmetric).largest
        } else {
            engine.combine(self.transmission.coefficients())
        };
        if !largest.is_finite() {
            return false;
        }
        let fraction = (MAX_STEP / largest).min(1.0);
        let accelerates = self.tangent_is_partial() && fraction == 1.0;
        if accelerates {
            self.note(0);
        }
        let engine = &mut *self.solver.engine;
        engine.save();
        engine.advance(fraction);
        self.transmission.take(engine, fraction);
        if accelerates {
            self.note(1);
            self.accelerate();
        }
        true
    }

    /// Moves strain, tensions and drops by the step of another rod.
    pub(super) fn advance_by(&mut self, rod: &dyn Passes) {
        let accelerates = self.tangent_is_partial();
        if accelerates {
            self.note(0);
        }
        let engine = &mut *self.solver.engine;
        let mut strain = vec![Vec3::zero(); self.transmission.tendons.now.strain.len()];
        engine.strains(&mut |i, w| strain[i] = w);
        rod.steps(&mut |i, step| strain[i] += step);
        engine.set_strains(&|i| strain[i]);
        self.transmission.take(engine, 1.0);
        if accelerates {
            self.note(1);
            self.accelerate();
        }
    }

    /// Discards the steps so far of the acceleration.
    pub(super) fn clear_acceleration(&mut self) {
        self.acceleration.anderson.clear();
    }

    /// Stores strain, tensions and drops as numbers of similar magnitude.
    fn note(&mut self, end: usize) {
        let numbers = &mut self.acceleration.ends[end];
        numbers.clear();
        self.solver
            .engine
            .strains(&mut |_, w| numbers.extend_from_slice(&w.0));
        let Transmission {
            tendons, unknowns, ..
        } = &self.transmission;
        unknowns.write(tendons, self.acceleration.per_tension, numbers);
    }

    /// Replaces the end of a Newton step by the accelerated one.
    fn accelerate(&mut self) {
        let Transmission {
            tendons, unknowns, ..
        } = &mut self.transmission;
        let Acceleration {
            anderson,
            ends: [from, to],
            per_tension,
        } = &mut self.acceleration;
        for (to, from) in to.iter_mut().zip(from.iter()) {
            *to -= from;
        }
        if !unknowns.keeps_sides() {
            anderson.clear();
        }
        if !anderson.accelerate(from, to) {
            return;
        }
        for (to, from) in to.iter_mut().zip(from.iter()) {
            *to += from;
        }
        let engine = &mut *self.solver.engine;
        let (strains, values) = to.split_at(3 * tendons.now.strain.len());
        if unknowns.read(tendons, engine, *per_tension, values) {
            engine.set_strains(&|i| Vec3([strains[3 * i], strains[3 * i + 1], strains[3 * i + 2]]));
        } else {
            anderson.clear();
        }
    }

    /// Accepts the solution as the state of the path.
    pub(super) fn finish(&mut self, mut outcome: PathOutcome, load: &Load) -> PathOutcome {
        let Transmission {
            tendons, unknowns, ..
        } = &mut self.transmission;
        let given = tendons.regularisation_length();
        outcome.length_residual = outcome.length_residual.max(given);
        if given > MAX_REGULARISATION_LENGTH * self.solver.robot().length() {
            // regularisation replaced a constraint that the rod cannot satisfy
            outcome.stable = None;
            return outcome;
        }
        for i in 0..tendons.lines.len() {
            if tendons.is_taut(i) {
                tendons.slack[i] = 0.0;
            }
        }
        tendons.note_displacements();
        let strain = &mut tendons.now.strain;
        self.solver.engine.strains(&mut |i, w| strain[i] = w);
        if let Some(unloaded) = &self.unloaded {
            tendons.now.plays.clone_from(&unloaded.plays);
            tendons.now.lags.clone_from(&unloaded.lags);
        }
        if let Some(creep) = &self.creep {
            creep.finish(&mut tendons.now);
        }
        outcome.undetermined = unknowns.is_undetermined(tendons);
        let collision = self.solver.settle(&Load {
            tensions: &tendons.now.tensions,
            ..*load
        });
        outcome.status = if collision.is_some() {
            Status::NoEquilibrium
        } else {
            Status::Converged
        };
        outcome
    }
}

/// Linear interpolation; the end is met exactly.
fn between(a: f64, b: f64, share: f64) -> f64 {
    if share == 1.0 {
        b
    } else {
        a + share * (b - a)
    }
}
