//! How the robot is really driven: tendons pulled by a tension or by a length, that stretch, hang
//! slack and rub at their holes, in a path of equilibria. The laws are those of
//! [`Transmission`].

use crate::dispatch;
use crate::interrupt;
use crate::math::anderson::Mixing;
use crate::math::linalg::Vec3;
use crate::model::load::{Load, Model};
use crate::model::robot::{InputError, Robot};
use crate::rod::chain::Sources;
use crate::rod::estimate::{ErrorEstimate, Verdict, LEVELS};
use crate::statics::adaptive::refine_to;
use crate::statics::solver::{Solver, Status, MAX_STEP, TOLERANCE};
pub use crate::tendon::transmission::{Command, History, Line};
use crate::tendon::transmission::{Slip, Transmission};

/// What a step found.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveOutcome {
    /// How the step ended.
    pub status: Status,
    /// Whether it is a minimum of the energy under the given pulls and tensions; `None` under a
    /// tip moment or friction, which have no potential.
    pub stable: Option<bool>,
    /// Newton steps.
    pub iterations: usize,
    /// Steps that it took of the path from the last.
    pub increments: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// Largest length that a pulled tendon lacks, m.
    pub length_residual: f64,
    /// Whether the tensions are the smallest of many that hold the same pose.
    pub undetermined: bool,
    /// Tendons that pull against each other, where there is no equilibrium.
    pub fighting: Vec<usize>,
    /// Nearest displacements with an equilibrium (m), where there is none.
    pub nearest: Option<Vec<f64>>,
    /// Of a converged answer: estimated discretisation error.
    pub error: Option<ErrorEstimate>,
}

impl DriveOutcome {
    /// Of a step that is not solved yet.
    pub fn pending() -> Self {
        DriveOutcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            increments: 1,
            residual: f64::INFINITY,
            length_residual: f64::INFINITY,
            undetermined: false,
            fighting: vec![],
            nearest: None,
            error: None,
        }
    }
}

/// A robot that is driven through its tendons.
#[derive(Clone)]
pub struct Drive {
    solver: Solver,
    /// Whether elements are chosen step by step.
    automatic: bool,
    transmission: Transmission,
    virgin: History,
    mixing: Mixing,
    /// Where a Newton step begins and where it leads to, for `mixing`.
    ends: [Vec<f64>; 2],
    /// Rotation of a module by a newton in a tendon, about.
    per_tension: f64,
    /// Unknowns of a step that were found to fit into memory.
    fitting: usize,
    /// Stated error of the last step: with friction, which remembers, no later one is smaller.
    remembered: ErrorEstimate,
}

/// Length, as a share of the robot's, to which pulls are met.
const LENGTH_TOLERANCE: f64 = 2e-15;
/// The same where rounding allows no better, and where far less than this is left of tensions
/// that nothing but the ridge tells apart.
const LOOSE: f64 = 1e-12;
const TIGHT: f64 = 1e-14;
const MAX_STEPS: usize = 60;
/// Residual below which Newton's matrix is kept while it serves.
const NEAR: f64 = 1e-2;
/// Steps in which a hole of a path that begins may turn from slip to slip.
const FRESH_STEPS: usize = 5;
/// Newton steps in all, and increments, of the way to a load after which it is given up.
const MOST_ITERATIONS: usize = 400;
const MAX_INCREMENTS: usize = 60;
/// What the error estimates of tip and tension are multiplied by with friction: it changes span
/// tensions with the bends, and the estimate keeps them.
const FRICTION_SAFETY: [f64; 2] = [1.5, 8.0];

impl Drive {
    /// As for [`Solver::new`], with one line for each tendon. Without a number of elements they
    /// are chosen step by step, and not taken back along a path.
    pub fn new(
        robot: &Robot,
        model: Model,
        elements: impl Into<Option<usize>>,
        lines: &[Line],
    ) -> Result<Self, InputError> {
        let given = elements.into();
        let elements = given.unwrap_or(1);
        dispatch::check_driven(robot, elements, 0, 1)?;
        let mut transmission = Transmission::new(robot, model, lines)?;
        let mut solver = Solver::new(robot, model, elements)?;
        // home: pretension alone, no load
        let tensions: Vec<_> = lines.iter().map(|line| line.pretension).collect();
        let load = Load {
            tensions: &tensions,
            gravity: [0.0; 3],
            tip_force: [0.0; 3],
            tip_moment: [0.0; 3],
        };
        let outcome = solver.solve(&load)?;
        if outcome.status != Status::Converged {
            return Err(InputError(format!(
                "there is no home pose: under the pretension alone the robot has no stable \
                 equilibrium ({})",
                outcome.status.word()
            )));
        }
        solver.engine.measure_spans(false);
        let mut strain = vec![Vec3::zero(); 2 * elements * robot.module_count()];
        solver.engine.strains(&mut |i, w| strain[i] = w);
        let per_tension =
            (transmission.scale / robot.moment_scale()).sqrt() / robot.module_count() as f64;
        let virgin = transmission.go_home(solver.engine.span_lengths(), strain);
        Ok(Drive {
            solver,
            automatic: given.is_none(),
            transmission,
            virgin,
            mixing: Mixing::default(),
            ends: Default::default(),
            per_tension,
            fitting: 0,
            remembered: ErrorEstimate::default(),
        })
    }

    /// The robot that is driven.
    pub fn robot(&self) -> &Robot {
        self.solver.robot()
    }

    /// The solver, for poses and lengths of the last step.
    pub fn solver(&self) -> &Solver {
        &self.solver
    }

    pub(crate) fn transmission(&self) -> &Transmission {
        &self.transmission
    }

    /// What friction remembers of the path so far.
    pub fn history(&self) -> &History {
        &self.transmission.now
    }

    /// Forgets the path: back to the home pose.
    pub fn reset(&mut self) {
        self.solver.unsettle();
        self.transmission.slack.fill(0.0);
        self.transmission.now = self.virgin.clone();
        self.remembered = ErrorEstimate::default();
    }

    /// Goes on from where another path has come to; its commands and loads are those that the
    /// next step starts from.
    pub fn resume(
        &mut self,
        tensions: &[f64],
        drops: &[f64],
        spans: &[f64],
        commands: &[Command],
        load: &Load,
    ) -> Result<(), InputError> {
        let (n, m) = (self.robot().module_count(), self.transmission.lines.len());
        let numbers = tensions.iter().chain(drops).chain(spans);
        if tensions.len() != m
            || commands.len() != m
            || drops.len() != n * m
            || spans.len() != n * m
            || !numbers.into_iter().all(|v| v.is_finite())
            || tensions.iter().any(|t| *t < 0.0)
        {
            return Err(InputError(
                "the history does not belong to this robot".into(),
            ));
        }
        self.transmission
            .check(self.solver.robot(), commands, load)?;
        for at in 0..n * m {
            let most = std::f64::consts::PI * self.transmission.lines[at % m].friction;
            if drops[at].abs() > 1e-12 + most * (1.0 + 1e-9) {
                return Err(InputError(format!(
                    "the history is damaged: tendon {} has lost more at a hole than friction takes",
                    at % m + 1
                )));
            }
        }
        self.reset();
        // the pose is an equilibrium of the history's own tensions: found from it again
        self.transmission.now.tensions.copy_from_slice(tensions);
        self.transmission.now.drops.copy_from_slice(drops);
        self.transmission.now.spans.copy_from_slice(spans);
        self.transmission.now.commands.copy_from_slice(commands);
        self.transmission.now.load = [load.gravity, load.tip_force, load.tip_moment];
        self.transmission.note_pulls();
        Ok(())
    }

    /// Length that each tendon hangs by, m; zero where it pulls.
    pub fn slack(&self) -> &[f64] {
        &self.transmission.slack
    }

    /// Length that each tendon has been taken in since home, m.
    pub fn pull(&self, i: usize) -> f64 {
        self.transmission.now.pulls[i]
    }

    /// Tension of a span, N.
    pub fn span_tension(&self, k: usize, i: usize) -> f64 {
        self.solver.engine.span_tension(k, i)
    }

    /// Checks that copies for steps side by side fit into memory.
    ///
    /// # Errors
    /// If they do not.
    pub fn check_copies(&self, copies: usize) -> Result<(), InputError> {
        let unknowns = self.transmission.lines.len() + self.transmission.most_holes();
        dispatch::check_driven(self.robot(), self.solver.elements(), unknowns, copies)
    }

    /// Checks the numbers of a step, and that its unknowns fit into memory.
    ///
    /// # Errors
    /// If they do not.
    pub fn check(&mut self, commands: &[Command], load: &Load) -> Result<(), InputError> {
        self.transmission.check(self.robot(), commands, load)?;
        let pulled = commands.iter().filter(|c| matches!(c, Command::Pull(_)));
        let unknowns = pulled.count() + self.transmission.most_holes();
        if unknowns > self.fitting {
            dispatch::check_driven(self.robot(), self.solver.elements(), unknowns, 1)?;
            self.fitting = unknowns;
        }
        Ok(())
    }

    /// Equilibrium under commands and load, one step on the path from the last.
    ///
    /// # Errors
    /// If a number does not fit the robot.
    pub fn step(&mut self, commands: &[Command], load: &Load) -> Result<DriveOutcome, InputError> {
        self.check(commands, load)?;
        let load = &load.without_moment_below(self.solver.settings().least_moment());
        let mut iterations = 0;
        loop {
            let old = self.transmission.now.clone();
            let mut outcome = self.way(&old, commands, load);
            iterations += outcome.iterations;
            if outcome.status == Status::Converged {
                let needed = self.estimate_error(&mut outcome, commands);
                if let Some(finer) = self.finer(needed, &old) {
                    *self = finer;
                    continue;
                }
            }
            outcome.iterations = iterations;
            if let Some(error) = outcome.error {
                self.remembered = error;
            }
            if outcome.status != Status::Converged {
                self.transmission.now = old;
                if outcome.status != Status::NoEquilibrium && !interrupt::interrupted() {
                    self.explain(&mut outcome, commands, load);
                }
                self.solver.unsettle();
                self.transmission.slack.fill(f64::NAN);
            }
            return Ok(outcome);
        }
    }

    /// The same robot at `old`, where a step from there needs more elements than it has.
    fn finer(&self, needed: usize, old: &History) -> Option<Drive> {
        let enough = needed == self.solver.elements();
        if enough || !self.automatic || interrupt::interrupted() {
            return None;
        }
        self.with_elements(needed, old)
    }

    /// The same robot at `now` with more elements; none where it has no home then.
    fn with_elements(&self, elements: usize, now: &History) -> Option<Drive> {
        let lines = &self.transmission.lines;
        let mut finer = Drive::new(self.robot(), self.solver.model(), elements, lines).ok()?;
        finer.automatic = self.automatic;
        dispatch::check_driven(self.robot(), elements, self.fitting, 1).ok()?;
        finer.fitting = self.fitting;
        finer.remembered = self.remembered;
        let factor = elements / self.solver.elements();
        finer.transmission.now = now.clone();
        finer.transmission.now.strain = refine_to(now.strain.clone(), factor);
        Some(finer)
    }

    /// Discretisation error of the step that converged: at the lengths that pulls hold, tensions
    /// take what lengths would lack. Returns the elements that the tolerances need.
    fn estimate_error(&mut self, outcome: &mut DriveOutcome, commands: &[Command]) -> usize {
        let n = self.robot().module_count();
        let (engine, transmission) = (&mut *self.solver.engine, &self.transmission);
        let mut found = engine.estimate();
        let tensions = &transmission.now.tensions;
        let held: Vec<usize> = (0..commands.len())
            .filter(|&i| matches!(commands[i], Command::Pull(_)) && tensions[i] > 0.0)
            .collect();
        let mut largest = 0.0;
        if !held.is_empty() {
            let lacks: Vec<f64> = held.iter().map(|&i| engine.length_error(i)).collect();
            let mut spans = vec![0.0; held.len() * n];
            for (c, &i) in held.iter().enumerate() {
                for k in 0..n {
                    spans[c * n + k] = engine.span_tension(k, i) / tensions[i];
                }
            }
            engine.measure_spans(false);
            engine.respond(Sources {
                tendons: &held,
                tensions: &spans,
            });
            let size = held.len();
            let (mut matrix, mut row) = (vec![0.0; size * size], vec![0.0; 1 + size]);
            for (r, &i) in held.iter().enumerate() {
                engine.beyond(0, i, &mut row);
                for c in 0..size {
                    matrix[r * size + c] = -row[1 + c];
                }
                matrix[r * size + r] += transmission.whole_compliance(i);
            }
            let changes = solve_regularised(&mut matrix, lacks);
            largest = changes.iter().fold(0.0, |a: f64, t| a.max(t.abs()));
            if changes.iter().any(|t| !t.is_finite()) {
                largest = f64::NAN;
            }
            let coefficients: Vec<f64> = std::iter::once(1.0).chain(changes).collect();
            found.motion = engine.correct(&coefficients);
        }
        let with_friction = transmission.rubs;
        let friction = if with_friction {
            FRICTION_SAFETY
        } else {
            [1.0; 2]
        };
        found.motion *= friction[0];
        let tautest = tensions.iter().fold(0.0, |a: f64, t| a.max(*t));
        let verdict = Verdict::new(
            &found,
            [largest * friction[1], tautest],
            outcome.stable,
            self.robot().length(),
            self.solver.elements(),
        );
        outcome.stable = verdict.stable;
        let mut error = verdict.error;
        if with_friction {
            error.tip = error.tip.max(self.remembered.tip);
            error.tension = error.tension.max(self.remembered.tension);
        }
        outcome.error = Some(error);
        verdict.needed
    }

    /// Straight to the load, or along a line of increments where that fails.
    fn way(&mut self, old: &History, commands: &[Command], load: &Load) -> DriveOutcome {
        let mut outcome = self.newton(old, commands, load);
        if outcome.status == Status::Converged {
            return outcome;
        }
        let (mut reached, mut increment) = (0.0, 0.5);
        let mut increments = 0;
        let mut from = old.clone();
        let first = outcome.clone();
        let mut part_commands = commands.to_vec();
        for _ in 0..MAX_INCREMENTS {
            let share = f64::min(reached + increment, 1.0);
            let mix = |a: f64, b: f64| if share == 1.0 { b } else { a + share * (b - a) };
            for (i, to) in commands.iter().enumerate() {
                // a motor that changes its manner starts from what the tendon has
                part_commands[i] = match *to {
                    Command::Tension(t) => Command::Tension(mix(old.tensions[i], t)),
                    Command::Pull(p) => Command::Pull(mix(old.pulls[i], p)),
                };
            }
            let three = |q: usize, to: [f64; 3]| [0, 1, 2].map(|x| mix(old.load[q][x], to[x]));
            let part = Load {
                tensions: load.tensions,
                gravity: three(0, load.gravity),
                tip_force: three(1, load.tip_force),
                tip_moment: three(2, load.tip_moment),
            };
            let found = self.newton(&from, &part_commands, &part);
            outcome.iterations += found.iterations;
            if outcome.iterations > MOST_ITERATIONS {
                break;
            }
            if interrupt::interrupted() {
                break;
            }
            if found.status == Status::Converged {
                increments += 1;
                if share == 1.0 {
                    return DriveOutcome {
                        increments,
                        iterations: outcome.iterations,
                        ..found
                    };
                }
                from = self.transmission.now.clone();
                reached = share;
                increment *= 1.5;
            } else {
                increment *= 0.4;
                if increment < 1e-3 {
                    break;
                }
            }
        }
        DriveOutcome {
            iterations: outcome.iterations,
            ..first
        }
    }

    /// Without an answer: which tendons fight, and the nearest pulls that have one.
    fn explain(&mut self, outcome: &mut DriveOutcome, commands: &[Command], load: &Load) {
        if !commands.iter().any(|c| matches!(c, Command::Pull(_))) {
            return;
        }
        let kept = (
            self.transmission.before.clone(),
            self.transmission.now.clone(),
            self.transmission.rubs,
        );
        let scale = self.transmission.scale;
        let mut best: Option<(Vec<usize>, Vec<f64>)> = None;
        let mut lacked = f64::INFINITY;
        // least squares of what pulls lack, friction aside: compliance that all tendons share,
        // less and less
        self.transmission.rubs = false;
        for share in [1.0, 0.1, 1e-2, 1e-3] {
            for (i, c) in self.transmission.before.iter_mut().enumerate() {
                *c = kept.0[i] + share * scale;
            }
            let from = self.virgin.clone();
            let found = self.way(&from, commands, load);
            if found.status != Status::Converged {
                break;
            }
            best = None;
            let mut pulls = vec![];
            let mut most = 0.0;
            for (i, command) in commands.iter().enumerate() {
                let lacks = share * scale * self.transmission.now.tensions[i];
                pulls.push(match command {
                    Command::Pull(p) => {
                        most = f64::max(most, lacks);
                        p - lacks
                    }
                    Command::Tension(_) => f64::NAN,
                });
            }
            // what only stretch makes up for goes on falling with it
            if lacked.is_finite() && most > 0.3 * lacked && most > 1e-6 * self.robot().length() {
                let lacks = |i: usize| share * scale * self.transmission.now.tensions[i];
                let pulled = |i: usize| matches!(commands[i], Command::Pull(_));
                let fighting = (0..commands.len()).filter(|&i| pulled(i) && lacks(i) > 0.1 * most);
                best = Some((fighting.collect(), pulls));
            }
            lacked = most;
        }
        (
            self.transmission.before,
            self.transmission.now,
            self.transmission.rubs,
        ) = kept;
        if let Some((fighting, nearest)) = best {
            outcome.status = Status::NoEquilibrium;
            outcome.fighting = fighting;
            outcome.nearest = Some(nearest);
        }
    }

    /// One implicit step from `old`; leaves the answer in `self.transmission.now`.
    fn newton(&mut self, old: &History, commands: &[Command], load: &Load) -> DriveOutcome {
        let mut outcome = DriveOutcome::pending();
        self.start(old, commands, load);
        let symmetric = load.tip_moment == [0.0; 3];
        let scale = self.robot().moment_scale();
        let unit = self.solver.settings().shift_unit;
        let length = self.robot().length();
        let fresh = self.transmission.rubs && old.drops.iter().all(|y| *y == 0.0);
        let rigid = self.transmission.is_rigid();
        let (mut last, mut shift) = (f64::INFINITY, 0.0);
        let (mut before, mut pivot) = (0.0, f64::NAN);
        let work = self.solver.settings().work * (2 + self.transmission.problem.size);
        for step in 0..=MAX_STEPS {
            if interrupt::work(work) || !self.solver.engine.evaluate().is_finite() {
                return outcome;
            }
            self.solver.engine.measure_spans(self.transmission.rubs);
            let (mut settled, mut settles) = (true, true);
            if self.transmission.rubs {
                let fresh = fresh && step < FRESH_STEPS;
                let engine = &mut *self.solver.engine;
                settled = self.transmission.slide(engine, old, fresh);
                settles = self.transmission.is_sure();
                self.transmission.apply(engine);
                engine.balance();
            }
            self.transmission.measure(&*self.solver.engine);
            let residual = self.solver.engine.gradient() / scale;
            let lacks = self.transmission.length_residual() / length;
            (outcome.residual, outcome.length_residual) = (residual, lacks * length);
            let stalls = lacks <= if rigid { TIGHT } else { LOOSE } && lacks > 0.5 * last;
            last = lacks;
            settled &= residual <= TOLERANCE && (lacks <= LENGTH_TOLERANCE || stalls);
            if !residual.is_finite() || (step == MAX_STEPS && !settled) {
                return outcome;
            }
            if settled && !symmetric {
                // without a potential there is no more to ask
                return self.finish(outcome, load);
            }
            let engine = &mut *self.solver.engine;
            // friction lags behind the bend, and gains nothing from Newton's newest matrix; what
            // the steps do to each other tells more
            let chord = !settled
                && self.transmission.rubs
                && residual < NEAR
                && residual < 0.3 * before
                && shift == 0.0;
            before = residual;
            if !chord {
                engine.linearise();
                pivot = engine.eliminate(symmetric, if settled { 0.0 } else { shift });
            }
            if pivot.is_nan() {
                return outcome;
            }
            // friction has no potential of its own, but a column that buckles is seen all the same
            let stable = (!self.transmission.rubs).then_some(true);
            if settled && pivot > 1e-12 * unit && !rigid {
                outcome.stable = stable;
                return self.finish(outcome, load);
            }
            // from afar, tensions that the rod hardly tells apart are kept from running away
            let caution = if rigid {
                self.transmission.scale * f64::min(1e-2, lacks)
            } else {
                0.0
            };
            let engine = &mut *self.solver.engine;
            self.transmission.gather(engine, old, caution, chord);
            let solved = self.transmission.problem.solve();
            if interrupt::interrupted() {
                return outcome;
            }
            if symmetric && pivot <= 1e-12 * unit {
                // what the pulls hold does not count
                let held = self.transmission.problem.negative_eigenvalues();
                let negative = self.solver.engine.negative_pivots();
                if negative > held {
                    if settled {
                        outcome.status = Status::Unstable;
                        outcome.stable = Some(false);
                        return outcome;
                    }
                    shift = if shift == 0.0 { unit } else { 4.0 * shift };
                    if shift > 1e12 * unit {
                        return outcome;
                    }
                    continue;
                }
            }
            if settled {
                outcome.stable = stable;
                return self.finish(outcome, load);
            }
            if !solved {
                return outcome;
            }
            if !chord || !settles {
                self.mixing.clear();
            }
            if !self.advance(symmetric) {
                return outcome;
            }
            if shift > 0.0 {
                shift = if shift < 4e-3 * unit {
                    0.0
                } else {
                    0.25 * shift
                };
            }
            outcome.iterations += 1;
        }
        outcome
    }

    /// Takes on a load, from the pose and tensions of the step before.
    fn start(&mut self, old: &History, commands: &[Command], load: &Load) {
        self.transmission.start(old, commands);
        self.transmission.now.load = [load.gravity, load.tip_force, load.tip_moment];
        let engine = &mut *self.solver.engine;
        engine.load(&Load {
            tensions: &self.transmission.now.tensions,
            ..*load
        });
        engine.make_straight();
        engine.set_strains(&|i| old.strain[i]);
        self.transmission.apply(engine);
    }

    /// Moves strain, tensions and drops by the step that was found; false if it is no number.
    fn advance(&mut self, symmetric: bool) -> bool {
        let engine = &mut *self.solver.engine;
        let largest = if self.transmission.is_bare() {
            engine.newton_step(symmetric).largest
        } else {
            engine.combine(self.transmission.coefficients())
        };
        if !largest.is_finite() {
            return false;
        }
        let fraction = (MAX_STEP / largest).min(1.0);
        let mixes = self.transmission.rubs && fraction == 1.0;
        if mixes {
            self.note(0);
        }
        let engine = &mut *self.solver.engine;
        engine.save();
        engine.advance(fraction);
        self.transmission.take(engine, fraction);
        if mixes {
            self.note(1);
            self.mix();
        }
        true
    }

    /// Writes down strain, tensions and drops as numbers of like size.
    fn note(&mut self, end: usize) {
        let numbers = &mut self.ends[end];
        numbers.clear();
        self.solver
            .engine
            .strains(&mut |_, w| numbers.extend_from_slice(&w.0));
        self.transmission.unknowns_to(self.per_tension, numbers);
    }

    /// Goes on from the end of a Newton step to where the steps before point.
    fn mix(&mut self) {
        let [from, to] = &mut self.ends;
        for (to, from) in to.iter_mut().zip(from.iter()) {
            *to -= from;
        }
        if !self.transmission.keeps_sides() {
            self.mixing.clear();
        }
        if !self.mixing.mix(from, to) {
            return;
        }
        for (to, from) in to.iter_mut().zip(from.iter()) {
            *to += from;
        }
        let arcs = 3 * self.transmission.now.strain.len();
        let engine = &mut *self.solver.engine;
        let (strains, unknowns) = to.split_at(arcs);
        if self
            .transmission
            .take_unknowns(engine, self.per_tension, unknowns)
        {
            engine.set_strains(&|i| Vec3([strains[3 * i], strains[3 * i + 1], strains[3 * i + 2]]));
        } else {
            self.mixing.clear();
        }
    }

    /// Takes the answer as the state of the path.
    fn finish(&mut self, mut outcome: DriveOutcome, load: &Load) -> DriveOutcome {
        let given = self.transmission.given_way();
        outcome.length_residual = outcome.length_residual.max(given);
        if given > 1e-9 * self.robot().length() {
            // the ridge has given way to what the rod cannot
            outcome.stable = None;
            return outcome;
        }
        let transmission = &mut self.transmission;
        for (slack, tension) in transmission
            .slack
            .iter_mut()
            .zip(&transmission.now.tensions)
        {
            if *tension > 0.0 {
                *slack = 0.0;
            }
        }
        transmission.note_pulls();
        let strain = &mut transmission.now.strain;
        self.solver.engine.strains(&mut |i, w| strain[i] = w);
        outcome.undetermined = transmission.is_undetermined();
        let collision = self.solver.settle(&Load {
            tensions: &transmission.now.tensions,
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

/// Solves a symmetric system by Gauss-Jordan elimination without pivoting; a share of the largest
/// diagonal keeps apart what the rod does not.
fn solve_regularised(matrix: &mut [f64], mut rhs: Vec<f64>) -> Vec<f64> {
    let n = rhs.len();
    let scale = (0..n).fold(0.0, |a: f64, i| a.max(matrix[i * n + i].abs()));
    for i in 0..n {
        matrix[i * n + i] += 1e-10 * scale;
    }
    for i in 0..n {
        let per = 1.0 / matrix[i * n + i];
        for r in (0..n).filter(|r| *r != i) {
            let factor = matrix[r * n + i] * per;
            for c in i..n {
                matrix[r * n + c] -= factor * matrix[i * n + c];
            }
            rhs[r] -= factor * rhs[i];
        }
    }
    for i in 0..n {
        rhs[i] /= matrix[i * n + i];
    }
    rhs
}

/// Where the next step starts from, for a history that is written down.
impl Drive {
    /// Strain of the backbone.
    pub fn strain(&self) -> Vec<[f64; 3]> {
        self.transmission.now.strain.iter().map(|w| w.0).collect()
    }

    /// What each tendon does at each hole, by modules and tendons: slips towards the base (1),
    /// away from it (-1) or sticks (0).
    pub fn slips(&self) -> Vec<i8> {
        let sign = |slip: &Slip| match slip {
            Slip::Towards => 1,
            Slip::Away => -1,
            Slip::Sticks => 0,
        };
        self.transmission.now.slip.iter().map(sign).collect()
    }

    /// Starts the next step from what [`Drive::strain`] and [`Drive::slips`] gave; after
    /// [`Drive::resume`].
    ///
    /// # Errors
    /// If it does not fit the robot and its elements, or is not finite.
    pub fn start_from(&mut self, strain: &[[f64; 3]], slips: &[i8]) -> Result<(), InputError> {
        let finite = strain.iter().flatten().all(|w| w.is_finite());
        let (n, now) = (self.robot().module_count(), self.transmission.now.clone());
        let elements = LEVELS.into_iter().find(|e| 2 * e * n == strain.len());
        if let (true, Some(elements)) = (self.automatic, elements) {
            if elements > self.solver.elements() {
                if let Some(finer) = self.with_elements(elements, &now) {
                    *self = finer;
                }
            }
        }
        let (strains, holes) = (
            self.transmission.now.strain.len(),
            self.transmission.now.slip.len(),
        );
        if strain.len() != strains || slips.len() != holes || !finite {
            return Err(InputError(
                "the history does not belong to this robot".into(),
            ));
        }
        for (to, from) in self.transmission.now.strain.iter_mut().zip(strain) {
            *to = Vec3(*from);
        }
        for (to, from) in self.transmission.now.slip.iter_mut().zip(slips) {
            *to = match from.signum() {
                1 => Slip::Towards,
                -1 => Slip::Away,
                _ => Slip::Sticks,
            };
        }
        Ok(())
    }
}
