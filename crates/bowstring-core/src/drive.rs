//! How the robot is really driven: tendons pulled by a tension or by a length, that stretch, hang
//! slack and rub at their holes.
//!
//! Unknown beside the strain are the tension of each tendon before its base hole, `T`, and at
//! each hole `h` the drop `y` of its logarithm, so that span `k` carries
//!
//! `T_k = T exp(-(y_0 + ... + y_k))`
//!
//! For a tendon that is pulled by a length `p` from home, with `l` the length of a span, `a` its
//! own compliance and `c` that of all before the base hole,
//!
//! `slack = home - p - sum (l_k - a_k T_k) + c T >= 0,  T >= 0,  slack T = 0`
//!
//! At a hole the tendon slips by `v`, positive towards the base, which is the loss of
//! `sum (l_k - a_k T_k)` beyond it since the step before. Coulomb's law for a rope on a bend
//! `beta` (Euler, Eytelwein) is `|y| <= mu beta`, with `y = mu beta` where `v > 0`, `y = -mu beta`
//! where `v < 0`, and `v = 0` between. A step of the path is implicit.
//!
//! Newton's method on all of it: the rod's own elimination answers each unknown tension and each
//! hole that sticks, and what is left is a small complementarity problem. How the bend changes
//! the friction is not in Newton's matrix, which stays symmetric; it is taken from the present
//! bend, and converges with a factor of about `mu` times the bend.

use crate::complementarity::{Complementarity, Side};
use crate::linalg::Vec3;
use crate::load::{Load, Model, TendonPath, Theory};
use crate::robot::{InputError, Robot, Short};
use crate::rod::Source;
use crate::statics::{Solver, Status, MAX_STEP, TOLERANCE};

/// What lies between a motor and the robot's end of a tendon, and how the tendon rubs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// E A of the tendon, N; infinite if it does not stretch.
    pub stiffness: f64,
    /// Length of tendon before the base hole, m.
    pub free_length: f64,
    /// Of the transmission, m/N.
    pub compliance: f64,
    /// Coulomb's coefficient at every hole but the anchor.
    pub friction: f64,
    /// Tension in the home pose, where the pull is zero, N.
    pub pretension: f64,
}

impl Default for Line {
    /// Does not stretch, does not rub.
    fn default() -> Self {
        Line {
            stiffness: f64::INFINITY,
            free_length: 0.0,
            compliance: 0.0,
            friction: 0.0,
            pretension: 0.0,
        }
    }
}

/// What a motor does to its tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Before the base hole, N.
    Tension(f64),
    /// Length taken in since home, m; negative if it is paid out.
    Pull(f64),
}

/// Where a path has come to: all that friction remembers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Before the base hole, N.
    pub tensions: Vec<f64>,
    /// By modules and tendons: drop of the logarithm of tension at the hole where the span
    /// begins, and length of the span less its creep, m.
    pub drops: Vec<f64>,
    pub spans: Vec<f64>,
    /// Taken in since home, m.
    pub pulls: Vec<f64>,
    /// Strain of the backbone, where the next step starts from.
    strain: Vec<Vec3>,
    slip: Vec<Slip>,
    /// Of the last step; the load is gravity, tip force and tip moment.
    pub commands: Vec<Command>,
    pub load: [[f64; 3]; 3],
}

/// What a tendon does at a hole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Slip {
    Towards,
    Away,
    #[default]
    Sticks,
}

/// What a step found.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveOutcome {
    pub status: Status,
    /// Whether it is a minimum of the energy under the given pulls and tensions; `None` under a
    /// tip moment or friction, which have no potential.
    pub stable: Option<bool>,
    pub iterations: usize,
    /// Steps that it took of the path from the last.
    pub increments: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// Largest length that a pulled tendon lacks, m.
    pub length_residual: f64,
    /// Whether the tensions are the smallest of many that hold the same pose.
    pub undetermined: bool,
    /// Without equilibrium: tendons that pull against each other, and the nearest pulls that
    /// have one, m.
    pub fighting: Vec<usize>,
    pub nearest: Option<Vec<f64>>,
}

/// A robot that is driven through its tendons.
#[derive(Clone)]
pub struct Drive {
    solver: Solver,
    lines: Vec<Line>,
    modules: usize,
    /// Module that each tendon ends in.
    ends: Vec<usize>,
    /// By modules and tendons: own compliance of a span, m/N.
    stretch: Vec<f64>,
    /// The same as friction sees it: never zero, as else many a hole that sticks could carry
    /// any tension.
    creep: Vec<f64>,
    /// Of all before the base hole, m/N.
    before: Vec<f64>,
    /// Length less stretch at home, m.
    home: Vec<f64>,
    virgin: History,
    now: History,
    /// Length that is free of tension at zero pull, m.
    slack: Vec<f64>,
    /// Pull by tension of the straight robot, about, m/N.
    scale: f64,
    /// Compliance that makes tensions unique where neither rod nor line does, m/N.
    ridge: Vec<f64>,
    rubs: bool,
    scratch: Scratch,
}

#[derive(Clone, Default)]
struct Scratch {
    complementarity: Complementarity,
    /// Unknowns in the order of the columns.
    unknowns: Vec<Unknown>,
    /// Tension by modules that goes with a unit of each unknown.
    profile: Vec<f64>,
    coefficients: Vec<f64>,
    /// By columns and holes: change of a tendon's length from there on, and its own give.
    beyond: Vec<f64>,
    give: Vec<f64>,
    /// By holes of one tendon.
    slipped: Vec<f64>,
    /// By modules and tendons: most that friction may drop.
    bounds: Vec<f64>,
    /// Steps in which a hole has changed its mind.
    doubts: usize,
}

#[derive(Clone, Copy)]
enum Unknown {
    /// Before the base hole.
    Tension(usize),
    /// What a hole that sticks lets through more than now.
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

/// Holes with friction: all that stick are unknown together, in a dense matrix.
const MOST_HOLES: usize = 2000;
/// Share of `scale` that every span stretches by before its holes slip.
const CREEP: f64 = 1e-7;
/// Share of `scale` far below which tensions are not told apart.
const RIDGE: f64 = 2e-10;
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
/// Steps with a hole that has changed its mind; after these all that may stick are unknown
/// together.
const BOLD_STEPS: usize = 8;
/// Newton steps in all, and increments, of the way to a load after which it is given up.
const MOST_ITERATIONS: usize = 400;
const MAX_INCREMENTS: usize = 60;

impl Drive {
    /// Compliance before the base hole, m/N.
    fn give(&self, i: usize) -> f64 {
        self.before[i] + self.ridge[i]
    }

    /// As for [`Solver::new`], with one line for each tendon.
    pub fn new(
        robot: &Robot,
        model: Model,
        elements: usize,
        lines: &[Line],
    ) -> Result<Self, InputError> {
        let fail = |what: String| Err(InputError(what));
        let (n, m) = (robot.module_count(), robot.tendon_count());
        if lines.len() != m {
            return fail(format!(
                "{} lines were given, the robot has {m} tendons",
                lines.len()
            ));
        }
        if m == 0 {
            return fail("a robot without tendons is not driven".into());
        }
        let rubbing = (0..m).filter(|&i| lines[i].friction > 0.0);
        let holes: usize = rubbing.map(|i| robot.spec().tendons[i].end_disk + 1).sum();
        if holes > MOST_HOLES {
            return fail(format!(
                "tendons rub at {holes} holes; this version solves friction at {MOST_HOLES} or fewer"
            ));
        }
        if model.tendon == TendonPath::Continuous {
            return fail(
                "pulls, slack and friction need straight spans; a continuous tendon has none"
                    .into(),
            );
        }
        for (i, line) in lines.iter().enumerate() {
            let place = i + 1;
            if !(line.stiffness > 0.0) {
                return fail(format!(
                    "stiffness of tendon {place} is {} N, it must be positive",
                    Short(line.stiffness)
                ));
            }
            for (name, value) in [
                ("free length", line.free_length),
                ("compliance of the transmission", line.compliance),
                ("friction coefficient", line.friction),
                ("pretension", line.pretension),
            ] {
                if !(value >= 0.0 && value.is_finite()) {
                    return fail(format!(
                        "{name} of tendon {place} is {}, it must not be negative",
                        Short(value)
                    ));
                }
            }
        }
        let solver = Solver::new(robot, model, elements)?;
        let mut stretch = vec![0.0; n * m];
        let mut start = 0.0;
        for (k, disk) in robot.spec().disks.iter().enumerate() {
            for (i, line) in lines.iter().enumerate() {
                if k <= robot.spec().tendons[i].end_disk {
                    stretch[k * m + i] = (disk.station - start) / line.stiffness;
                }
            }
            start = disk.station;
        }
        let before: Vec<_> = lines
            .iter()
            .map(|line| line.compliance + line.free_length / line.stiffness)
            .collect();
        let holes = robot.spec().tendons.iter();
        let widest = holes
            .map(|t| t.hole[0].hypot(t.hole[1]))
            .fold(0.0, f64::max);
        let scale = widest * widest / robot.moment_scale();
        let tendons = &robot.spec().tendons;
        let rigid = |i: usize| before[i] == 0.0 && lines[i].stiffness.is_infinite();
        // bending about two axes and extension tell three tendons apart
        let crowded = |i: usize| {
            let beside =
                || (0..m).filter(|&j| rigid(j) && tendons[j].end_disk == tendons[i].end_disk);
            beside().count() > 3 || beside().any(|j| j != i && tendons[j].hole == tendons[i].hole)
        };
        let ridge = (0..m)
            .map(|i| {
                if rigid(i) && (model.theory == Theory::Kirchhoff || crowded(i)) {
                    RIDGE * scale
                } else {
                    0.0
                }
            })
            .collect();
        let passes = |at: usize| at / m <= robot.spec().tendons[at % m].end_disk;
        let creep = (0..n * m)
            .map(|at| {
                if passes(at) {
                    stretch[at].max(CREEP * scale)
                } else {
                    0.0
                }
            })
            .collect();
        let mut drive = Drive {
            solver,
            creep,
            modules: n,
            ends: robot.spec().tendons.iter().map(|t| t.end_disk).collect(),
            stretch,
            before,
            scale,
            home: vec![0.0; m],
            virgin: History::default(),
            now: History::default(),
            slack: vec![0.0; m],
            ridge,
            rubs: lines.iter().any(|line| line.friction > 0.0),
            scratch: Scratch::default(),
            lines: lines.to_vec(),
        };
        drive.go_home(elements)?;
        Ok(drive)
    }

    /// Finds the home pose: pretension alone, no load, no friction yet.
    fn go_home(&mut self, elements: usize) -> Result<(), InputError> {
        let (n, m) = (self.modules, self.lines.len());
        let tensions: Vec<_> = self.lines.iter().map(|line| line.pretension).collect();
        let load = Load {
            tensions: &tensions,
            gravity: [0.0; 3],
            tip_force: [0.0; 3],
            tip_moment: [0.0; 3],
        };
        let outcome = self.solver.solve(&load)?;
        if outcome.status != Status::Converged {
            return Err(InputError(format!(
                "there is no home pose: under the pretension alone the robot has no stable \
                 equilibrium ({})",
                outcome.status.word()
            )));
        }
        self.solver.engine.measure_spans(false);
        let mut strain = vec![Vec3::zero(); 2 * elements * n];
        self.solver.engine.strains(&mut |i, w| strain[i] = w);
        let lengths = self.solver.engine.span_lengths();
        let mut spans = vec![0.0; n * m];
        for (k, span) in spans.iter_mut().enumerate() {
            *span = lengths[k] - self.creep[k] * tensions[k % m];
        }
        for i in 0..m {
            let stretched =
                (0..n).map(|k| lengths[k * m + i] - self.stretch[k * m + i] * tensions[i]);
            self.home[i] = stretched.sum::<f64>() - self.before[i] * tensions[i];
        }
        self.virgin = History {
            commands: tensions.iter().map(|t| Command::Tension(*t)).collect(),
            tensions,
            drops: vec![0.0; n * m],
            spans,
            pulls: vec![0.0; m],
            strain,
            slip: vec![Slip::Sticks; n * m],
            load: [[0.0; 3]; 3],
        };
        self.now = self.virgin.clone();
        Ok(())
    }

    /// The robot that is driven.
    pub fn robot(&self) -> &Robot {
        self.solver.robot()
    }

    /// The solver, for poses and lengths of the last step.
    pub fn solver(&self) -> &Solver {
        &self.solver
    }

    /// What friction remembers of the path so far.
    pub fn history(&self) -> &History {
        &self.now
    }

    /// Forgets the path: back to the home pose.
    pub fn reset(&mut self) {
        self.solver.unsettle();
        self.slack.fill(0.0);
        self.now = self.virgin.clone();
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
        let (n, m) = (self.modules, self.lines.len());
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
        self.check(commands, load)?;
        for at in 0..n * m {
            let most = std::f64::consts::PI * self.lines[at % m].friction;
            if drops[at].abs() > 1e-12 + most * (1.0 + 1e-9) {
                return Err(InputError(format!(
                    "the history is damaged: tendon {} has lost more at a hole than friction takes",
                    at % m + 1
                )));
            }
        }
        self.reset();
        // the pose is an equilibrium of the history's own tensions: found from it again
        self.now.tensions.copy_from_slice(tensions);
        self.now.drops.copy_from_slice(drops);
        self.now.spans.copy_from_slice(spans);
        self.now.commands.copy_from_slice(commands);
        self.now.load = [load.gravity, load.tip_force, load.tip_moment];
        self.note_pulls();
        Ok(())
    }

    /// Length that each tendon hangs by, m; zero where it pulls.
    pub fn slack(&self) -> &[f64] {
        &self.slack
    }

    /// Length that each tendon has been taken in since home, m.
    pub fn pull(&self, i: usize) -> f64 {
        self.now.pulls[i]
    }

    /// Tension of a span, N.
    pub fn span_tension(&self, k: usize, i: usize) -> f64 {
        self.solver.engine.span_tension(k, i)
    }

    /// From base hole to anchor in the straight robot, m.
    fn home_length(&self, i: usize) -> f64 {
        self.robot().spec().disks[self.ends[i]].station
    }

    /// Pull that a tendon without slack has.
    fn pull_of(&self, history: &History, i: usize) -> f64 {
        let m = self.lines.len();
        let (mut tension, mut routed) = (history.tensions[i], 0.0);
        for at in (0..self.modules).map(|k| k * m + i) {
            tension *= (-history.drops[at]).exp();
            routed += history.spans[at] + (self.creep[at] - self.stretch[at]) * tension;
        }
        self.home[i] - routed + self.before[i] * history.tensions[i]
    }

    /// Pulls of the present state, as commanded or as the tensions give them.
    fn note_pulls(&mut self) {
        for i in 0..self.lines.len() {
            self.now.pulls[i] = match self.now.commands[i] {
                Command::Pull(p) => p,
                Command::Tension(_) => self.pull_of(&self.now, i),
            };
        }
    }

    /// Equilibrium under commands and load, one step on the path from the last.
    ///
    /// # Errors
    /// If a number does not fit the robot.
    pub fn step(&mut self, commands: &[Command], load: &Load) -> Result<DriveOutcome, InputError> {
        self.check(commands, load)?;
        let old = self.now.clone();
        let mut outcome = self.way(&old, commands, load);
        if outcome.status != Status::Converged {
            self.now = old;
            if outcome.status != Status::NoEquilibrium {
                self.explain(&mut outcome, commands, load);
            }
            self.solver.unsettle();
            self.slack.fill(f64::NAN);
        }
        Ok(outcome)
    }

    fn check(&self, commands: &[Command], load: &Load) -> Result<(), InputError> {
        if commands.len() != self.lines.len() {
            return Err(InputError(format!(
                "{} commands were given, the robot has {} tendons",
                commands.len(),
                self.lines.len()
            )));
        }
        let mut tensions = Vec::with_capacity(commands.len());
        for (i, command) in commands.iter().enumerate() {
            tensions.push(match *command {
                Command::Tension(t) => t,
                Command::Pull(p) => {
                    let length = self.home_length(i);
                    if !p.is_finite() {
                        return Err(InputError(format!(
                            "pull of tendon {} is {} m, it must be a finite number",
                            i + 1,
                            Short(p)
                        )));
                    }
                    if p >= length {
                        return Err(InputError(format!(
                            "pull of tendon {} is {} m, it must be less than the tendon's \
                             length, {} m",
                            i + 1,
                            Short(p),
                            Short(length)
                        )));
                    }
                    0.0
                }
            });
        }
        Load {
            tensions: &tensions,
            ..*load
        }
        .check(self.robot())
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
            if found.status == Status::Converged {
                increments += 1;
                if share == 1.0 {
                    return DriveOutcome {
                        increments,
                        iterations: outcome.iterations,
                        ..found
                    };
                }
                from = self.now.clone();
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
        let kept = (self.before.clone(), self.now.clone(), self.rubs);
        let scale = self.scale;
        let mut best: Option<(Vec<usize>, Vec<f64>)> = None;
        let mut lacked = f64::INFINITY;
        // least squares of what pulls lack, friction aside: compliance that all tendons share,
        // less and less
        self.rubs = false;
        for share in [1.0, 0.1, 1e-2, 1e-3] {
            for (i, c) in self.before.iter_mut().enumerate() {
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
                let lacks = share * scale * self.now.tensions[i];
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
                let lacks = |i: usize| share * scale * self.now.tensions[i];
                let pulled = |i: usize| matches!(commands[i], Command::Pull(_));
                let fighting = (0..commands.len()).filter(|&i| pulled(i) && lacks(i) > 0.1 * most);
                best = Some((fighting.collect(), pulls));
            }
            lacked = most;
        }
        (self.before, self.now, self.rubs) = kept;
        if let Some((fighting, nearest)) = best {
            outcome.status = Status::NoEquilibrium;
            outcome.fighting = fighting;
            outcome.nearest = Some(nearest);
        }
    }

    /// One implicit step from `old`; leaves the answer in `self.now`.
    fn newton(&mut self, old: &History, commands: &[Command], load: &Load) -> DriveOutcome {
        let mut outcome = DriveOutcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            increments: 1,
            residual: f64::INFINITY,
            length_residual: f64::INFINITY,
            undetermined: false,
            fighting: vec![],
            nearest: None,
        };
        self.start(old, commands, load);
        self.scratch.doubts = 0;
        // a step of a path that was broken off and gone on with is the same to the last digit
        self.scratch.unknowns.clear();
        self.scratch.complementarity.size = 0;
        self.scratch.complementarity.side.clear();
        let symmetric = load.tip_moment == [0.0; 3];
        let scale = self.robot().moment_scale();
        let unit = self.solver.settings().shift_unit;
        let length = self.robot().length();
        let fresh = self.rubs && old.drops.iter().all(|y| *y == 0.0);
        let rigid = self.ridge.iter().any(|r| *r > 0.0);
        let (mut last, mut shift) = (f64::INFINITY, 0.0);
        let (mut before, mut pivot) = (0.0, f64::NAN);
        for step in 0..=MAX_STEPS {
            if !self.solver.engine.evaluate().is_finite() {
                return outcome;
            }
            self.solver.engine.measure_spans(self.rubs);
            let mut settled = true;
            if self.rubs {
                settled = self.slide(old, commands, fresh && step < FRESH_STEPS);
                self.apply();
                self.solver.engine.evaluate();
            }
            self.measure(commands);
            let residual = self.solver.engine.gradient() / scale;
            let lacks = self.length_residual(commands) / length;
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
            // friction lags behind the bend, and gains nothing from Newton's newest matrix
            let chord =
                !settled && self.rubs && residual < NEAR && residual < 0.3 * before && shift == 0.0;
            before = residual;
            if !chord {
                engine.linearise();
                pivot = engine.eliminate(symmetric, if settled { 0.0 } else { shift });
            }
            if pivot.is_nan() {
                return outcome;
            }
            // friction has no potential of its own, but a column that buckles is seen all the same
            let stable = (!self.rubs).then_some(true);
            if settled && pivot > 1e-12 * unit && !rigid {
                outcome.stable = stable;
                return self.finish(outcome, load);
            }
            // from afar, tensions that the rod hardly tells apart are kept from running away
            let caution = if rigid {
                self.scale * f64::min(1e-2, lacks)
            } else {
                0.0
            };
            let thorough = self.scratch.doubts > BOLD_STEPS;
            self.gather(old, commands, symmetric, caution, thorough);
            let solved = self.scratch.complementarity.solve();
            if symmetric && pivot <= 1e-12 * unit {
                // what the pulls hold does not count
                let held = self.scratch.complementarity.negative_eigenvalues();
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
            if !self.advance() {
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
        self.now.clone_from(old);
        self.now.load = [load.gravity, load.tip_force, load.tip_moment];
        self.now.commands.copy_from_slice(commands);
        for (i, command) in commands.iter().enumerate() {
            if let Command::Tension(t) = command {
                self.now.tensions[i] = *t;
            }
        }
        let engine = &mut *self.solver.engine;
        engine.load(&Load {
            tensions: &self.now.tensions,
            ..*load
        });
        engine.make_straight();
        engine.set_strains(&|i| old.strain[i]);
        self.apply();
    }

    /// Tensions of all spans by those before the base holes and the drops.
    fn apply(&mut self) {
        let m = self.lines.len();
        let now = &self.now;
        if !self.rubs {
            self.solver
                .engine
                .set_span_tensions(&|_, i| now.tensions[i]);
            return;
        }
        self.scratch.profile.resize(self.modules * m, 0.0);
        for i in 0..m {
            let mut drop = 0.0;
            for k in 0..self.modules {
                drop += now.drops[k * m + i];
                self.scratch.profile[k * m + i] = now.tensions[i] * (-drop).exp();
            }
        }
        let profile = &self.scratch.profile;
        self.solver
            .engine
            .set_span_tensions(&|k, i| profile[k * m + i]);
    }

    /// Lengths less stretch, and slack, at the present pose.
    fn measure(&mut self, commands: &[Command]) {
        let m = self.lines.len();
        let engine = &*self.solver.engine;
        for (k, span) in self.now.spans.iter_mut().enumerate() {
            let creep = self.creep[k] * engine.span_tension(k / m, k % m);
            *span = engine.span_lengths()[k] - creep;
        }
        for i in 0..m {
            self.slack[i] = match commands[i] {
                Command::Tension(_) => 0.0,
                Command::Pull(p) => {
                    let stretched = |at: usize| {
                        let stretch = self.stretch[at] * engine.span_tension(at / m, i);
                        engine.span_lengths()[at] - stretch
                    };
                    let routed: f64 = (0..self.modules).map(|k| stretched(k * m + i)).sum();
                    self.home[i] - p - routed + self.give(i) * self.now.tensions[i]
                }
            };
        }
    }

    /// Largest length by which a tendon is too short, or hangs while it pulls.
    fn length_residual(&self, commands: &[Command]) -> f64 {
        let mut most: f64 = 0.0;
        for (i, command) in commands.iter().enumerate() {
            if let Command::Pull(_) = command {
                let s = self.slack[i];
                let miss = if self.now.tensions[i] > 0.0 {
                    s.abs()
                } else {
                    -s
                };
                most = most.max(miss);
            }
        }
        most
    }

    /// Friction at the present bend: who slips, who sticks, and the drops of those that slip.
    /// False while that still changes.
    ///
    /// On a `fresh` path, where nothing stuck yet, a hole that slips the wrong way slips the other.
    fn slide(&mut self, old: &History, commands: &[Command], fresh: bool) -> bool {
        let m = self.lines.len();
        let rest = 1e-12 * self.robot().length();
        self.scratch.slipped.resize(self.modules, 0.0);
        self.scratch.bounds.resize(self.modules * m, 0.0);
        let engine = &*self.solver.engine;
        let (mut settled, mut sure) = (true, true);
        for i in 0..m {
            let line = self.lines[i];
            let end = self.ends[i];
            if line.friction == 0.0 {
                continue;
            }
            // an inextensible line tells its base hole's slip; without one the drop stays
            let from = if old.tensions[i] > 0.0 {
                old.pulls[i]
            } else {
                self.pull_of(old, i)
            };
            let told = match commands[i] {
                Command::Pull(to) if self.before[i] == 0.0 => Some(to - from),
                _ => None,
            };
            let mut slipped = 0.0;
            for k in (0..=end).rev() {
                let at = k * m + i;
                let creep = self.creep[at] * engine.span_tension(k, i);
                slipped -= engine.span_lengths()[at] - creep - old.spans[at];
                self.scratch.slipped[k] = slipped;
            }
            let hangs = self.now.tensions[i] == 0.0;
            for k in 0..=end {
                let at = k * m + i;
                let slipped = self.scratch.slipped[k];
                let bound = line.friction * engine.angles()[at];
                let (before, slip) = (self.now.drops[at], self.now.slip[at]);
                self.scratch.bounds[at] = bound;
                let mut next = match slip {
                    _ if fresh && slipped < -rest => Slip::Away,
                    _ if fresh => Slip::Towards,
                    Slip::Towards if slipped < -rest => Slip::Sticks,
                    Slip::Away if slipped > rest => Slip::Sticks,
                    _ => slip,
                };
                let mut drop = match next {
                    Slip::Towards => bound,
                    Slip::Away => -bound,
                    Slip::Sticks => before.clamp(-bound, bound),
                };
                let mut sound = next == slip;
                if k == 0 {
                    if let Some(change) = told {
                        (next, drop) = if change > 0.0 {
                            (Slip::Towards, bound)
                        } else if change < 0.0 {
                            (Slip::Away, -bound)
                        } else {
                            (Slip::Towards, old.drops[at].clamp(-bound, bound))
                        };
                        sound = next == slip;
                    }
                }
                if hangs {
                    (next, drop) = (Slip::Towards, bound);
                    sound = next == slip;
                }
                // the bend still moves, or a hole has changed its mind
                settled &= (drop - before).abs() <= 1e-13;
                sure &= sound;
                (self.now.slip[at], self.now.drops[at]) = (next, drop);
            }
        }
        if !sure && !fresh {
            self.scratch.doubts += 1;
        }
        settled && sure
    }

    /// Columns of the unknown tensions and drops, and the complementarity problem between them.
    fn gather(
        &mut self,
        old: &History,
        commands: &[Command],
        symmetric: bool,
        caution: f64,
        thorough: bool,
    ) {
        let (n, m) = (self.modules, self.lines.len());
        let scratch = &mut self.scratch;
        scratch.unknowns.clear();
        for (i, command) in commands.iter().enumerate() {
            if let Command::Pull(_) = command {
                scratch.unknowns.push(Unknown::Tension(i));
            }
        }
        if self.rubs {
            for (i, tension) in self.now.tensions.iter().enumerate() {
                if *tension == 0.0 || self.lines[i].friction == 0.0 {
                    continue;
                }
                // where a pull tells the slip of the base hole, there is nothing to ask
                let told = matches!(commands[i], Command::Pull(_)) && self.before[i] == 0.0;
                for hole in usize::from(told)..=self.ends[i] {
                    if thorough || self.now.slip[hole * m + i] == Slip::Sticks {
                        scratch.unknowns.push(Unknown::Drop { tendon: i, hole });
                    }
                }
            }
        }
        let engine = &mut *self.solver.engine;
        engine.respond(symmetric, 0, None);
        let size = scratch.unknowns.len();
        scratch.complementarity.resize(size);
        // tension by modules of a unit of each unknown
        scratch.profile.clear();
        scratch.profile.resize(size * n, 0.0);
        for (c, unknown) in scratch.unknowns.iter().enumerate() {
            let part = &mut scratch.profile[c * n..(c + 1) * n];
            let tendon = match *unknown {
                Unknown::Tension(i) => {
                    let mut drop = 0.0;
                    let end = self.ends[i];
                    for (k, t) in part.iter_mut().enumerate().take(end + 1) {
                        drop += self.now.drops[k * m + i];
                        *t = if drop == 0.0 { 1.0 } else { (-drop).exp() };
                    }
                    i
                }
                Unknown::Drop { tendon, hole } => {
                    let per = 1.0 / engine.span_tension(hole, tendon);
                    for k in hole..n {
                        part[k] = engine.span_tension(k, tendon) * per;
                    }
                    tendon
                }
            };
            let source = Source {
                tendon,
                tension: part,
            };
            engine.respond(symmetric, c + 1, Some(source));
        }
        // change of every tendon's length from each hole on, by each column
        let spans = n * m;
        scratch.beyond.resize((size + 1) * spans, 0.0);
        for (c, sums) in scratch
            .beyond
            .chunks_exact_mut(spans)
            .enumerate()
            .take(size + 1)
        {
            sums.copy_from_slice(engine.rates(c));
            for at in (0..spans - m).rev() {
                sums[at] += sums[at + m];
            }
        }
        // own compliance of a tendon from each hole on, times each column
        scratch.give.resize(size * n, 0.0);
        for (c, column) in scratch.unknowns.iter().enumerate() {
            let i = column.tendon();
            let mut sum = 0.0;
            for k in (0..n).rev() {
                sum += self.creep[k * m + i] * scratch.profile[c * n + k];
                scratch.give[c * n + k] = sum;
            }
        }
        let (unknowns, profile) = (&scratch.unknowns, &scratch.profile);
        let stretched = |c: usize| -> f64 {
            let i = unknowns[c].tendon();
            (0..n)
                .map(|k| self.stretch[k * m + i] * profile[c * n + k])
                .sum()
        };
        let problem = &mut scratch.complementarity;
        for (r, row) in scratch.unknowns.iter().enumerate() {
            let i = row.tendon();
            let hole = row.hole();
            let at = hole * m + i;
            let mut q = -scratch.beyond[at];
            match *row {
                Unknown::Tension(_) => {
                    q += self.slack[i];
                    [problem.lower[r], problem.upper[r]] = [0.0, f64::INFINITY];
                }
                Unknown::Drop { .. } => {
                    for k in hole..n {
                        q -= self.now.spans[k * m + i] - old.spans[k * m + i];
                    }
                    let (tension, drop) = (engine.span_tension(hole, i), self.now.drops[at]);
                    let bound = scratch.bounds[at];
                    problem.lower[r] = tension * (drop - bound);
                    problem.upper[r] = tension * (drop + bound);
                    problem.side[r] = match self.now.slip[at] {
                        Slip::Towards => Side::Lower,
                        Slip::Away => Side::Upper,
                        Slip::Sticks => Side::Between,
                    };
                }
            }
            for (c, column) in scratch.unknowns.iter().enumerate() {
                let mut entry = -scratch.beyond[(c + 1) * spans + at];
                if column.tendon() == i {
                    entry += match (row, column) {
                        (Unknown::Drop { .. }, _) => scratch.give[c * n + hole],
                        (Unknown::Tension(_), Unknown::Drop { .. }) => stretched(c),
                        (Unknown::Tension(_), Unknown::Tension(_)) => {
                            stretched(c) + self.before[i] + self.ridge[i] + caution
                        }
                    };
                }
                problem.matrix[r * size + c] = entry;
                if let Unknown::Tension(j) = *column {
                    // tensions as they will be, drops by their change
                    q -= entry * self.now.tensions[j];
                }
            }
            problem.q[r] = q;
        }
    }

    /// Moves strain, tensions and drops by the step that was found; false if it is no number.
    fn advance(&mut self) -> bool {
        let m = self.lines.len();
        let scratch = &mut self.scratch;
        scratch.coefficients.clear();
        scratch.coefficients.push(1.0);
        for (unknown, z) in scratch.unknowns.iter().zip(&scratch.complementarity.z) {
            scratch.coefficients.push(match *unknown {
                Unknown::Tension(i) => z - self.now.tensions[i],
                Unknown::Drop { .. } => *z,
            });
        }
        let engine = &mut *self.solver.engine;
        let largest = engine.combine(&scratch.coefficients);
        if !largest.is_finite() {
            return false;
        }
        let fraction = (MAX_STEP / largest).min(1.0);
        engine.save();
        engine.advance(fraction);
        let answer = scratch
            .complementarity
            .z
            .iter()
            .zip(&scratch.complementarity.side);
        let steps = scratch.unknowns.iter().zip(&scratch.coefficients[1..]);
        for ((unknown, step), (z, side)) in steps.zip(answer) {
            match *unknown {
                // what hangs has no tension, exactly
                Unknown::Tension(i) if fraction == 1.0 => self.now.tensions[i] = *z,
                Unknown::Tension(i) => self.now.tensions[i] += fraction * step,
                Unknown::Drop { tendon, hole } => {
                    let at = hole * m + tendon;
                    self.now.drops[at] -= fraction * step / engine.span_tension(hole, tendon);
                    self.now.slip[at] = match side {
                        Side::Lower => Slip::Towards,
                        Side::Upper => Slip::Away,
                        Side::Between => Slip::Sticks,
                    };
                }
            }
        }
        self.apply();
        true
    }

    /// Takes the answer as the state of the path.
    fn finish(&mut self, mut outcome: DriveOutcome, load: &Load) -> DriveOutcome {
        let give = |i: usize| self.ridge[i] * self.now.tensions[i];
        let given = (0..self.lines.len()).map(give).fold(0.0, f64::max);
        outcome.length_residual = outcome.length_residual.max(given);
        if given > 1e-9 * self.robot().length() {
            // the ridge has given way to what the rod cannot
            outcome.stable = None;
            return outcome;
        }
        for (slack, tension) in self.slack.iter_mut().zip(&self.now.tensions) {
            if *tension > 0.0 {
                *slack = 0.0;
            }
        }
        self.note_pulls();
        let strain = &mut self.now.strain;
        self.solver.engine.strains(&mut |i, w| strain[i] = w);
        outcome.undetermined = self.is_undetermined();
        let collision = self.solver.settle(&Load {
            tensions: &self.now.tensions,
            ..*load
        });
        outcome.status = if collision.is_some() {
            Status::NoEquilibrium
        } else {
            Status::Converged
        };
        outcome
    }

    /// Whether some tensions may grow together and nothing moves.
    fn is_undetermined(&mut self) -> bool {
        let scratch = &mut self.scratch;
        let problem = &mut scratch.complementarity;
        let size = problem.size;
        let entries = (0..size).map(|i| problem.matrix[i * size + i]);
        let most = entries.fold(0.0, f64::max);
        let hangs = 1e-12 * self.solver.robot().length();
        for (r, unknown) in scratch.unknowns.iter().enumerate() {
            problem.side[r] = match *unknown {
                Unknown::Tension(i) if self.ridge[i] > 0.0 && self.slack[i] <= hangs => {
                    Side::Between
                }
                _ => Side::Lower,
            };
            problem.matrix[r * size + r] -= 1e-9 * most;
        }
        problem.negative_eigenvalues() > 0
    }
}

/// Where the next step starts from, for a history that is written down.
impl Drive {
    /// Strain of the backbone.
    pub fn strain(&self) -> Vec<[f64; 3]> {
        self.now.strain.iter().map(|w| w.0).collect()
    }

    /// What each tendon does at each hole, by modules and tendons: slips towards the base (1),
    /// away from it (-1) or sticks (0).
    pub fn slips(&self) -> Vec<i8> {
        let sign = |slip: &Slip| match slip {
            Slip::Towards => 1,
            Slip::Away => -1,
            Slip::Sticks => 0,
        };
        self.now.slip.iter().map(sign).collect()
    }

    /// Starts the next step from what [`Drive::strain`] and [`Drive::slips`] gave; after
    /// [`Drive::resume`].
    ///
    /// # Errors
    /// If it does not fit the robot and its elements, or is not finite.
    pub fn start_from(&mut self, strain: &[[f64; 3]], slips: &[i8]) -> Result<(), InputError> {
        let finite = strain.iter().flatten().all(|w| w.is_finite());
        let (strains, holes) = (self.now.strain.len(), self.now.slip.len());
        if strain.len() != strains || slips.len() != holes || !finite {
            return Err(InputError(
                "the history does not belong to this robot".into(),
            ));
        }
        for (to, from) in self.now.strain.iter_mut().zip(strain) {
            *to = Vec3(*from);
        }
        for (to, from) in self.now.slip.iter_mut().zip(slips) {
            *to = match from.signum() {
                1 => Slip::Towards,
                -1 => Slip::Away,
                _ => Slip::Sticks,
            };
        }
        Ok(())
    }
}
