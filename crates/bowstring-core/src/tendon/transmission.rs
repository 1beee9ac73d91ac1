//! The laws of the tendons: pulls, slack, stretch, and friction at the holes.
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
//! In a step of time that balances forces at a share `a` of the way, tensions are those of the
//! balance and lengths those of the end. With `e_0`, `e_1` what a tendon is stretched by at the
//! start, where it hangs zero, and at the end, where hanging counts as negative,
//!
//! `a slack = sum a_k T_k + c T - (1 - a) e_0 - a e_1`
//!
//! so that stretch gives back all its energy without numerical damping (`a = 1/2`: the work
//! `T (e_1 - e_0)` is the gain of `e^2 / (2 c)`), a tendon that catches or lets go never adds any,
//! and one that does not stretch is as long as it must be at the end of every step. With `a = 1`
//! it is the law of statics.
//!
//! The rod's own elimination answers each unknown tension and each hole that sticks, and what is
//! left is a small complementarity problem. How the bend changes the friction is not in Newton's
//! matrix, which stays symmetric; it is taken from the present bend, and converges with a factor
//! of about `mu` times the bend. [Mixing](crate::math::anderson) makes that factor smaller in statics.

use crate::math::linalg::Vec3;
use crate::math::mlcp::{Complementarity, Side};
use crate::model::load::{Load, Model, TendonPath, Theory};
use crate::model::robot::{InputError, Robot, Short};
use crate::motion::{Energies, Lock};
use crate::rod::chain::Sources;

/// What the laws ask of a rod, at rest or in motion.
pub(crate) trait Strung {
    /// Measures all spans where forces balance and at the end of the step.
    fn measure_spans(&mut self, angles: bool);
    /// By modules and tendons, at the end of the step, m.
    fn span_lengths(&self) -> &[f64];
    /// Of the tendons at the holes, where forces balance, rad.
    fn angles(&self) -> &[f64];
    /// Answers right-hand sides by the present elimination: in the first column its own imbalance,
    /// in the next more tension.
    fn respond(&mut self, sources: Sources);
    /// Change of a tendon's length from a hole on, by each of the answers.
    fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]);
    /// By modules and tendons, N.
    fn set_span_tensions(&mut self, tensions: &[f64]);
}

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
    /// Drops of the logarithm of tension at the holes where spans begin, by modules and tendons.
    pub drops: Vec<f64>,
    /// Lengths of the spans less their creep (m), by modules and tendons.
    pub spans: Vec<f64>,
    /// Taken in since home, m.
    pub pulls: Vec<f64>,
    /// Strain of the backbone, where the next step starts from.
    pub(crate) strain: Vec<Vec3>,
    pub(crate) slip: Vec<Slip>,
    /// Commands of the last step.
    pub commands: Vec<Command>,
    /// Gravity (m/s^2), tip force (N) and tip moment (N m) of the last step.
    pub load: [[f64; 3]; 3],
}

impl History {
    /// Takes on another of the same robot; allocates nothing.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.tensions.clone_from(&other.tensions);
        self.drops.clone_from(&other.drops);
        self.spans.clone_from(&other.spans);
        self.pulls.clone_from(&other.pulls);
        self.strain.clone_from(&other.strain);
        self.slip.clone_from(&other.slip);
        self.commands.clone_from(&other.commands);
        self.load = other.load;
    }
}

/// What a tendon does at a hole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Slip {
    Towards,
    Away,
    #[default]
    Sticks,
}

/// Lines, where their path has come to, and the scratch memory of a step.
#[derive(Clone, Default)]
pub(crate) struct Transmission {
    pub lines: Vec<Line>,
    modules: usize,
    /// Module that each tendon ends in.
    ends: Vec<usize>,
    /// From base hole to anchor in the straight robot, and of the robot, m.
    straight: Vec<f64>,
    length: f64,
    /// By modules and tendons: own compliance of a span, m/N.
    stretch: Vec<f64>,
    /// The same as friction sees it: never zero, as else many a hole that sticks could carry
    /// any tension.
    creep: Vec<f64>,
    /// Of all before the base hole, m/N.
    pub before: Vec<f64>,
    /// Length less stretch at home, m.
    home: Vec<f64>,
    /// Pull by tension of the straight robot, about, m/N.
    pub scale: f64,
    /// Compliance that makes tensions unique where neither rod nor line does, m/N.
    ridge: Vec<f64>,
    pub rubs: bool,
    pub now: History,
    /// Length that is free of tension at zero pull, m; times `share`.
    pub slack: Vec<f64>,
    /// Change of a drop that is none; and slip that is none, m.
    pub fine: f64,
    pub rest: f64,
    /// Where in a step forces balance; and at its start, what each tendon was stretched by, and
    /// its length from base hole to anchor, m.
    pub share: f64,
    stretched: Vec<f64>,
    routed: Vec<f64>,
    /// Pulls up to which the work of motors is counted, m.
    counted: Vec<f64>,
    pub problem: Complementarity,
    /// Unknowns in the order of the columns.
    unknowns: Vec<Unknown>,
    /// Those that the rod has answered.
    answered: Vec<Unknown>,
    /// Tendon of each.
    sources: Vec<usize>,
    /// Tension by modules that goes with a unit of each unknown.
    profile: Vec<f64>,
    coefficients: Vec<f64>,
    /// By modules and tendons: what the holes up to there let through of the tension before the
    /// base hole, zero where the tendon does not pass; and the tension itself, N.
    carried: Vec<f64>,
    tensions: Vec<f64>,
    /// Pulls that the step starts from, m.
    from: Vec<f64>,
    /// By columns: change of a tendon's length from a hole on.
    beyond: Vec<f64>,
    /// By unknowns and holes: own give of a tendon from there on.
    give: Vec<f64>,
    /// By holes of one tendon.
    slipped: Vec<f64>,
    /// By modules and tendons: most that friction may drop.
    bounds: Vec<f64>,
    /// Steps in which a hole has changed its mind.
    doubts: usize,
    /// Whether no hole changed its mind in the last `slide`.
    sure: bool,
    /// Compliance in `problem` that keeps tensions from running away, m/N.
    caution: f64,
    /// Of the unknowns, as `keeps_sides` saw them last.
    sides: Vec<Side>,
}

#[derive(Clone, Copy, PartialEq)]
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
/// Steps with a hole that has changed its mind; after these all that may stick are unknown
/// together.
const BOLD_STEPS: usize = 8;
/// Drop of the logarithm of a tension that a hole holds in small oscillations.
const HOLDS: f64 = 1e-6;
/// Share of `scale` that every span stretches by before its holes slip.
const CREEP: f64 = 1e-7;
/// Share of `scale` far below which tensions are not told apart.
const RIDGE: f64 = 2e-10;

impl Transmission {
    /// One line for each tendon; the home pose is still to be found.
    pub fn new(robot: &Robot, model: Model, lines: &[Line]) -> Result<Self, InputError> {
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
        if let Some(at) = stretch.iter().position(|c| !c.is_finite()) {
            return fail(format!(
                "stiffness of tendon {} is {:e} N, too small to reckon with",
                at % m + 1,
                lines[at % m].stiffness
            ));
        }
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
        let stations = &robot.spec().disks;
        Ok(Transmission {
            creep,
            modules: n,
            ends: tendons.iter().map(|t| t.end_disk).collect(),
            straight: tendons
                .iter()
                .map(|t| stations[t.end_disk].station)
                .collect(),
            length: robot.length(),
            stretch,
            before,
            scale,
            home: vec![0.0; m],
            slack: vec![0.0; m],
            ridge,
            rubs: lines.iter().any(|line| line.friction > 0.0),
            lines: lines.to_vec(),
            fine: 1e-13,
            rest: 1e-12 * robot.length(),
            share: 1.0,
            stretched: vec![0.0; m],
            routed: vec![0.0; m],
            counted: vec![0.0; m],
            carried: (0..n * m)
                .map(|at| f64::from(u8::from(passes(at))))
                .collect(),
            tensions: vec![0.0; n * m],
            from: vec![0.0; m],
            ..Transmission::default()
        })
    }

    /// Takes a pose under the pretension alone as home, by its span lengths and strain; returns
    /// the path that begins there, without friction yet.
    pub fn go_home(&mut self, lengths: &[f64], strain: Vec<Vec3>) -> History {
        let (n, m) = (self.modules, self.lines.len());
        let tensions: Vec<_> = self.lines.iter().map(|line| line.pretension).collect();
        let mut spans = vec![0.0; n * m];
        for (k, span) in spans.iter_mut().enumerate() {
            *span = lengths[k] - self.creep[k] * tensions[k % m];
        }
        for i in 0..m {
            let stretched =
                (0..n).map(|k| lengths[k * m + i] - self.stretch[k * m + i] * tensions[i]);
            self.home[i] = stretched.sum::<f64>() - self.before[i] * tensions[i];
        }
        self.now = History {
            commands: tensions.iter().map(|t| Command::Tension(*t)).collect(),
            tensions,
            drops: vec![0.0; n * m],
            spans,
            pulls: vec![0.0; m],
            strain,
            slip: vec![Slip::Sticks; n * m],
            load: [[0.0; 3]; 3],
        };
        self.now.clone()
    }

    /// Whether a ridge holds what neither rod nor line does.
    pub fn is_rigid(&self) -> bool {
        self.ridge.iter().any(|r| *r > 0.0)
    }

    /// Compliance before the base hole, m/N.
    fn compliance(&self, i: usize) -> f64 {
        self.before[i] + self.ridge[i]
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
    pub fn note_pulls(&mut self) {
        for i in 0..self.lines.len() {
            self.now.pulls[i] = match self.now.commands[i] {
                Command::Pull(p) => p,
                Command::Tension(_) => self.pull_of(&self.now, i),
            };
        }
    }

    /// Checks commands and load against the robot.
    pub fn check(
        &self,
        robot: &Robot,
        commands: &[Command],
        load: &Load,
    ) -> Result<(), InputError> {
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
                    let length = self.straight[i];
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
        .check(robot)
    }

    /// Prepares a step from `old`.
    pub fn start(&mut self, old: &History, commands: &[Command]) {
        self.now.copy_from(old);
        self.now.commands.copy_from_slice(commands);
        for (i, command) in commands.iter().enumerate() {
            if let Command::Tension(t) = command {
                self.now.tensions[i] = *t;
            }
        }
        for i in 0..self.lines.len() {
            self.carry(i);
            if self.rubs {
                self.from[i] = if old.tensions[i] > 0.0 {
                    old.pulls[i]
                } else {
                    self.pull_of(old, i)
                };
            }
        }
        self.doubts = 0;
        // a step of a path that was broken off and gone on with is the same to the last digit
        self.unknowns.clear();
        self.answered.clear();
        self.problem.size = 0;
        self.problem.side.clear();
    }

    /// Tensions of all spans by those before the base holes and the drops.
    pub fn apply(&mut self, rod: &mut dyn Strung) {
        let m = self.lines.len();
        for (tensions, carried) in self.tensions.chunks_mut(m).zip(self.carried.chunks(m)) {
            for ((tension, carried), before) in
                tensions.iter_mut().zip(carried).zip(&self.now.tensions)
            {
                *tension = before * carried;
            }
        }
        rod.set_span_tensions(&self.tensions);
    }

    /// What the holes of a tendon let through, by the present drops.
    fn carry(&mut self, i: usize) {
        let m = self.lines.len();
        let mut drop = 0.0;
        for k in 0..=self.ends[i] {
            drop += self.now.drops[k * m + i];
            self.carried[k * m + i] = if drop == 0.0 { 1.0 } else { (-drop).exp() };
        }
    }

    /// Lengths less stretch, and slack, at the present pose.
    pub fn measure(&mut self, rod: &dyn Strung) {
        let m = self.lines.len();
        let lengths = rod.span_lengths();
        for (at, span) in self.now.spans.iter_mut().enumerate() {
            *span = lengths[at] - self.creep[at] * self.tensions[at];
        }
        for i in 0..m {
            self.slack[i] = match self.now.commands[i] {
                Command::Tension(_) => 0.0,
                Command::Pull(p) => {
                    let spans = (0..self.modules).map(|k| k * m + i);
                    let carried: f64 = spans.map(|at| self.stretch[at] * self.tensions[at]).sum();
                    let stretched = self.length_of(lengths, i) - self.home[i] + p;
                    carried + self.compliance(i) * self.now.tensions[i]
                        - (1.0 - self.share) * self.stretched[i]
                        - self.share * stretched
                }
            };
        }
    }

    /// Length of a tendon from base hole to anchor.
    fn length_of(&self, lengths: &[f64], i: usize) -> f64 {
        let m = self.lines.len();
        (0..self.modules).map(|k| lengths[k * m + i]).sum()
    }

    /// Largest length by which a tendon is too short, or hangs while it pulls.
    pub fn length_residual(&self) -> f64 {
        let mut most: f64 = 0.0;
        for (i, command) in self.now.commands.iter().enumerate() {
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
        most / self.share
    }

    /// Friction at the present bend: who slips, who sticks, and the drops of those that slip.
    /// False while that still changes.
    ///
    /// On a `fresh` path, where nothing stuck yet, a hole that slips the wrong way slips the other.
    pub fn slide(&mut self, rod: &dyn Strung, old: &History, fresh: bool) -> bool {
        let m = self.lines.len();
        let rest = self.rest;
        let (lengths, angles) = (rod.span_lengths(), rod.angles());
        self.slipped.resize(self.modules, 0.0);
        self.bounds.resize(self.modules * m, 0.0);
        let (mut settled, mut sure) = (true, true);
        for i in 0..m {
            let line = self.lines[i];
            let end = self.ends[i];
            if line.friction == 0.0 {
                continue;
            }
            // an inextensible line tells its base hole's slip; without one the drop stays
            let told = match self.now.commands[i] {
                Command::Pull(to) if self.before[i] == 0.0 => Some(to - self.from[i]),
                _ => None,
            };
            let mut slipped = 0.0;
            for k in (0..=end).rev() {
                let at = k * m + i;
                slipped -= lengths[at] - self.creep[at] * self.tensions[at] - old.spans[at];
                self.slipped[k] = slipped;
            }
            let hangs = self.now.tensions[i] == 0.0;
            for k in 0..=end {
                let at = k * m + i;
                let slipped = self.slipped[k];
                let bound = line.friction * angles[at];
                let (before, slip) = (self.now.drops[at], self.now.slip[at]);
                self.bounds[at] = bound;
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
                        (next, drop) = if change > rest {
                            (Slip::Towards, bound)
                        } else if change < -rest {
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
                settled &= (drop - before).abs() <= self.fine;
                sure &= sound;
                (self.now.slip[at], self.now.drops[at]) = (next, drop);
            }
            self.carry(i);
        }
        self.sure = sure;
        if !sure && !fresh {
            self.doubts += 1;
        }
        settled && sure
    }

    /// Columns of the unknown tensions and drops, and the complementarity problem between them.
    ///
    /// `caution` is compliance that keeps tensions from running away. `kept`: columns that were
    /// made for the same unknowns serve again.
    pub fn gather(&mut self, rod: &mut dyn Strung, old: &History, caution: f64, kept: bool) {
        let (n, m) = (self.modules, self.lines.len());
        // asks every hole, not only those that stick
        let thorough = self.doubts > BOLD_STEPS;
        self.unknowns.clear();
        for (i, command) in self.now.commands.iter().enumerate() {
            if let Command::Pull(_) = command {
                self.unknowns.push(Unknown::Tension(i));
            }
        }
        if self.rubs {
            for (i, tension) in self.now.tensions.iter().enumerate() {
                if *tension == 0.0 || self.lines[i].friction == 0.0 {
                    continue;
                }
                // where a pull tells the slip of the base hole, there is nothing to ask
                let told =
                    matches!(self.now.commands[i], Command::Pull(_)) && self.before[i] == 0.0;
                for hole in usize::from(told)..=self.ends[i] {
                    if thorough || self.now.slip[hole * m + i] == Slip::Sticks {
                        self.unknowns.push(Unknown::Drop { tendon: i, hole });
                    }
                }
            }
        }
        let kept = kept && (!self.rubs || self.unknowns == self.answered);
        let size = self.unknowns.len();
        // so that all but the right-hand side is known
        let known = kept && self.problem.size == size;
        if !known {
            self.problem.resize(size);
        }
        if size == 0 {
            return;
        }
        if !known {
            self.fill_profile();
        }
        rod.respond(Sources {
            tendons: if kept { &[] } else { &self.sources },
            tensions: &self.profile,
        });
        self.answered.clone_from(&self.unknowns);
        let (unknowns, profile) = (&self.unknowns, &self.profile);
        let stretched = |c: usize| -> f64 {
            let i = unknowns[c].tendon();
            (0..n)
                .map(|k| self.stretch[k * m + i] * profile[c * n + k])
                .sum()
        };
        let problem = &mut self.problem;
        let more = caution - if known { self.caution } else { 0.0 };
        self.caution = caution;
        // all columns, or the own imbalance alone
        self.beyond.resize(if known { 1 } else { size + 1 }, 0.0);
        for (r, row) in self.unknowns.iter().enumerate() {
            let i = row.tendon();
            let hole = row.hole();
            let at = hole * m + i;
            let share = match *row {
                Unknown::Tension(_) => self.share,
                Unknown::Drop { .. } => 1.0,
            };
            rod.beyond(hole, i, &mut self.beyond);
            let mut q = -share * self.beyond[0];
            match *row {
                Unknown::Tension(_) => {
                    q += self.slack[i];
                    [problem.lower[r], problem.upper[r]] = [0.0, f64::INFINITY];
                }
                Unknown::Drop { .. } => {
                    for k in hole..n {
                        q -= self.now.spans[k * m + i] - old.spans[k * m + i];
                    }
                    let (tension, drop) = (self.tensions[at], self.now.drops[at]);
                    let bound = self.bounds[at];
                    problem.lower[r] = tension * (drop - bound);
                    problem.upper[r] = tension * (drop + bound);
                    problem.side[r] = match self.now.slip[at] {
                        Slip::Towards => Side::Lower,
                        Slip::Away => Side::Upper,
                        Slip::Sticks => Side::Between,
                    };
                }
            }
            for (c, column) in self.unknowns.iter().enumerate() {
                let place = &mut problem.matrix[r * size + c];
                if !known {
                    *place = -share * self.beyond[c + 1];
                    if column.tendon() == i {
                        *place += match (row, column) {
                            (Unknown::Drop { .. }, _) => self.give[c * n + hole],
                            (Unknown::Tension(_), Unknown::Drop { .. }) => stretched(c),
                            (Unknown::Tension(_), Unknown::Tension(_)) => {
                                stretched(c) + self.before[i] + self.ridge[i]
                            }
                        };
                    }
                }
                if let (Unknown::Tension(_), true) = (row, c == r) {
                    *place += more;
                }
                let entry = *place;
                if let Unknown::Tension(j) = *column {
                    // tensions as they will be, drops by their change
                    q -= entry * self.now.tensions[j];
                }
            }
            problem.q[r] = q;
        }
    }

    /// Tension by modules that goes with a unit of each unknown, and how the tendon gives way.
    fn fill_profile(&mut self) {
        let (n, m) = (self.modules, self.lines.len());
        let size = self.unknowns.len();
        self.sources.clear();
        self.profile.clear();
        self.profile.resize(size * n, 0.0);
        for (c, unknown) in self.unknowns.iter().enumerate() {
            let i = unknown.tendon();
            self.sources.push(i);
            let hole = unknown.hole();
            let per = match *unknown {
                Unknown::Tension(_) => 1.0,
                Unknown::Drop { .. } => 1.0 / self.carried[hole * m + i],
            };
            for k in hole..=self.ends[i] {
                self.profile[c * n + k] = self.carried[k * m + i] * per;
            }
        }
        // own compliance of a tendon from each hole on, times each column
        self.give.resize(size * n, 0.0);
        for (c, column) in self.unknowns.iter().enumerate() {
            let i = column.tendon();
            let mut sum = 0.0;
            for k in (0..n).rev() {
                sum += self.creep[k * m + i] * self.profile[c * n + k];
                self.give[c * n + k] = sum;
            }
        }
    }

    /// Whether nothing but the rod is unknown, so that nothing was gathered.
    pub fn is_bare(&self) -> bool {
        self.unknowns.is_empty()
    }

    /// What each column takes part in the step with, its own imbalance first.
    pub fn coefficients(&mut self) -> &[f64] {
        self.coefficients.clear();
        self.coefficients.push(1.0);
        for (unknown, z) in self.unknowns.iter().zip(&self.problem.z) {
            self.coefficients.push(match *unknown {
                Unknown::Tension(i) => z - self.now.tensions[i],
                Unknown::Drop { .. } => *z,
            });
        }
        &self.coefficients
    }

    /// Whether all holes go on as they did.
    pub fn is_sure(&self) -> bool {
        self.sure
    }

    /// Appends the unknowns, a tension times `per_tension`.
    pub fn unknowns_to(&self, per_tension: f64, out: &mut Vec<f64>) {
        let m = self.lines.len();
        out.extend(self.unknowns.iter().map(|unknown| match *unknown {
            Unknown::Tension(i) => per_tension * self.now.tensions[i],
            Unknown::Drop { tendon, hole } => self.now.drops[hole * m + tendon],
        }));
    }

    /// Whether what pulls and what hangs is the same as when last asked.
    pub fn keeps_sides(&mut self) -> bool {
        let kept = self.sides == self.problem.side;
        self.sides.clone_from(&self.problem.side);
        kept
    }

    /// Takes what `unknowns_to` wrote; false, and all as it was, where it would push.
    pub fn take_unknowns(
        &mut self,
        rod: &mut dyn Strung,
        per_tension: f64,
        values: &[f64],
    ) -> bool {
        let m = self.lines.len();
        let all = self.unknowns.iter().zip(&self.problem.side).zip(values);
        let pushes = |((unknown, side), value): ((&Unknown, &Side), &f64)| {
            matches!(unknown, Unknown::Tension(_)) && *side == Side::Between && *value <= 0.0
        };
        if all.clone().any(pushes) {
            return false;
        }
        let mut moved = false;
        for ((unknown, side), value) in all {
            match *unknown {
                Unknown::Tension(_) if *side != Side::Between => {}
                Unknown::Tension(i) => self.now.tensions[i] = value / per_tension,
                Unknown::Drop { tendon, hole } => {
                    self.now.drops[hole * m + tendon] = *value;
                    moved = true;
                }
            }
        }
        if moved {
            (0..m).for_each(|i| self.carry(i));
        }
        self.apply(rod);
        true
    }

    /// Moves tensions and drops by a fraction of the step that was found.
    pub fn take(&mut self, rod: &mut dyn Strung, fraction: f64) {
        let m = self.lines.len();
        let answer = self.problem.z.iter().zip(&self.problem.side);
        let steps = self.unknowns.iter().zip(self.coefficients.iter().skip(1));
        let mut moved = false;
        for ((unknown, step), (z, side)) in steps.zip(answer) {
            match *unknown {
                // what hangs has no tension, exactly
                Unknown::Tension(i) if fraction == 1.0 => self.now.tensions[i] = *z,
                Unknown::Tension(i) => self.now.tensions[i] += fraction * step,
                Unknown::Drop { tendon, hole } => {
                    let at = hole * m + tendon;
                    self.now.drops[at] -= fraction * step / self.tensions[at];
                    moved = true;
                    self.now.slip[at] = match side {
                        Side::Lower => Slip::Towards,
                        Side::Upper => Slip::Away,
                        Side::Between => Slip::Sticks,
                    };
                }
            }
        }
        if moved {
            (0..m).for_each(|i| self.carry(i));
        }
        self.apply(rod);
    }

    /// What a step of time does to the tendons, the one that leads to the present pose: energy in
    /// those that are pulled, and what motors did and was lost beside the tendons' `work` on the
    /// robot, J.
    pub fn energies(&self, rod: &dyn Strung, work: f64) -> Energies {
        let (mut before, mut after, mut motors) = (0.0, 0.0, 0.0);
        // what numerical damping takes is no loss
        let mut numerical = 0.0;
        for (i, command) in self.now.commands.iter().enumerate() {
            let length = self.length_of(rod.span_lengths(), i);
            match *command {
                Command::Tension(t) => motors += t * (self.routed[i] - length),
                Command::Pull(p) => {
                    let stretched = length - self.home[i] + p;
                    motors += self.now.tensions[i] * (p - self.counted[i]);
                    before += self.energy(i, self.stretched[i]);
                    after += self.energy(i, stretched);
                    if self.now.tensions[i] > 0.0 && self.lines[i].friction == 0.0 {
                        let more = stretched - self.stretched[i];
                        numerical += (2.0 * self.share - 1.0) * self.energy(i, more.abs());
                    }
                }
            }
        }
        Energies {
            elastic: after,
            work: motors - work,
            dissipated: motors - work - (after - before) - numerical,
            ..Energies::default()
        }
    }

    /// Of all of a line, m/N.
    pub fn whole_compliance(&self, i: usize) -> f64 {
        let m = self.lines.len();
        let spans = (0..self.modules).map(|k| self.stretch[k * m + i]);
        self.before[i] + spans.sum::<f64>()
    }

    /// Energy of a tendon that is stretched by a length.
    fn energy(&self, i: usize, stretched: f64) -> f64 {
        let compliance = self.whole_compliance(i);
        if compliance > 0.0 && stretched > 0.0 {
            0.5 * stretched * stretched / compliance
        } else {
            0.0
        }
    }

    /// Tension by what a tendon is stretched by at the end of the last step, N; none where it
    /// does not stretch.
    pub fn tension_of_stretch(&self, i: usize) -> Option<f64> {
        let compliance = self.whole_compliance(i);
        (compliance > 0.0).then(|| self.stretched[i] / compliance)
    }

    /// Lets pulls jump; returns the energy that motors put into the tendons at once, J.
    pub fn jump(&mut self, values: &[f64], slack: &mut [f64]) -> f64 {
        let mut energy = 0.0;
        for (i, to) in values.iter().enumerate() {
            if let Command::Pull(_) = self.now.commands[i] {
                let stretched = self.routed[i] - self.home[i] + to;
                let now = f64::max(stretched, 0.0);
                energy += self.energy(i, now) - self.energy(i, self.stretched[i]);
                self.stretched[i] = now;
                if self.whole_compliance(i) > 0.0 {
                    slack[i] = f64::max(-stretched, 0.0);
                }
                self.counted[i] = *to;
            }
        }
        energy
    }

    /// Pull of a tendon now, m.
    pub fn pull_now(&self, i: usize, old: &History) -> f64 {
        match self.now.commands[i] {
            Command::Pull(_) => self.counted[i],
            Command::Tension(_) => old.pulls[i],
        }
    }

    /// Takes a pose at rest as one of this path, though it was found with another rod, which is all
    /// but the same: home shifts by the difference, so that no tendon jerks.
    pub fn adopt(&mut self, rod: &dyn Strung) {
        self.measure(rod);
        for (i, slack) in self.slack.iter().enumerate() {
            if self.now.tensions[i] > 0.0 {
                self.home[i] -= slack;
            }
        }
    }

    /// Ends a step of time at the present pose; returns the energy in tendons that are pulled.
    pub fn arrive(&mut self, rod: &dyn Strung) -> f64 {
        let mut energy = 0.0;
        for i in 0..self.lines.len() {
            let length = self.length_of(rod.span_lengths(), i);
            self.routed[i] = length;
            (self.stretched[i], self.slack[i]) = match self.now.commands[i] {
                Command::Tension(_) => (0.0, 0.0),
                Command::Pull(p) => {
                    let stretched = length - self.home[i] + p;
                    // what pulls and does not stretch is but rounding off
                    let stiff = self.whole_compliance(i) == 0.0;
                    let hangs = if stiff && self.now.tensions[i] > 0.0 {
                        0.0
                    } else {
                        f64::max(-stretched, 0.0)
                    };
                    self.counted[i] = p;
                    (f64::max(stretched, 0.0), hangs)
                }
            };
            energy += self.energy(i, self.stretched[i]);
        }
        self.note_pulls();
        energy
    }

    /// Holes that may stick together.
    pub fn most_holes(&self) -> usize {
        let rubbing = (0..self.lines.len()).filter(|&i| self.lines[i].friction > 0.0);
        rubbing.map(|i| self.ends[i] + 1).sum()
    }

    /// At most as many as `locks` gives.
    pub fn lock_count(&self) -> usize {
        let all = |i: usize| match self.lines[i].friction > 0.0 {
            true => self.ends[i] + 1,
            false => 1,
        };
        (0..self.lines.len()).map(all).sum()
    }

    /// What keeps its length in small oscillations: tendons that are pulled and do not hang; where
    /// they rub, every stretch between two holes that hold, for a small motion does not make them
    /// slip. A hole without bend holds nothing.
    pub fn locks(&self) -> Vec<Lock> {
        let (n, m) = (self.modules, self.lines.len());
        let mut locks = vec![];
        for i in 0..m {
            if self.now.tensions[i] == 0.0 {
                continue;
            }
            let rubs = self.lines[i].friction > 0.0;
            let holds = |k: usize| rubs && self.bounds[k * m + i] > HOLDS;
            let pulled = matches!(self.now.commands[i], Command::Pull(_));
            let mut start = 0;
            for k in 0..=self.ends[i] {
                let last = k == self.ends[i];
                if !last && !holds(k + 1) {
                    continue;
                }
                let free = start == 0 && !holds(0);
                let from = std::mem::replace(&mut start, k + 1);
                if free && !pulled {
                    continue;
                }
                let own = if rubs { &self.creep } else { &self.stretch };
                let mut compliance: f64 = (from..=k).map(|k| own[k * m + i]).sum();
                if free {
                    compliance += self.before[i] + self.ridge[i];
                }
                locks.push(Lock {
                    tendon: i,
                    spans: (0..n)
                        .map(|at| f64::from(u8::from((from..=k).contains(&at))))
                        .collect(),
                    compliance,
                });
            }
        }
        locks
    }

    /// Largest length that a ridge made up for, m.
    pub fn given_way(&self) -> f64 {
        let give = |i: usize| self.ridge[i] * self.now.tensions[i];
        (0..self.lines.len()).map(give).fold(0.0, f64::max)
    }

    /// Whether some tensions may grow together and nothing moves.
    pub fn is_undetermined(&mut self) -> bool {
        let problem = &mut self.problem;
        let size = problem.size;
        let entries = (0..size).map(|i| problem.matrix[i * size + i]);
        let most = entries.fold(0.0, f64::max);
        let hangs = 1e-12 * self.length;
        for (r, unknown) in self.unknowns.iter().enumerate() {
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
