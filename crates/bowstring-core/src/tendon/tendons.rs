//! The tendons of a robot: tensions, lengths and slack.
//!
//! Theory: docs/theory/actuation.md.

use super::compliance::{Compliance, Routing};
use super::history::{History, Slip};
use super::line::{Command, Line};
use crate::math::linalg::Vec3;
use crate::model::error::{Argument, InputError, Rule};
use crate::model::load::{Load, Model, OwnedLoad};
use crate::model::robot::Robot;
use crate::rod::routed::RoutedRod;

/// Most holes with friction: all that stick are unknowns together, in a dense matrix.
const MOST_HOLES: usize = 2000;

/// Lines and routing of all tendons, and their state in a step.
#[derive(Clone, Default)]
pub(crate) struct Tendons {
    pub lines: Vec<Line>,
    pub routing: Routing,
    pub compliance: Compliance,
    /// Unstretched length of each tendon in the home pose (m).
    pub home: Vec<f64>,
    pub now: History,
    /// Slack length of each tendon (m), times `step.share` (theory Eq. 5.4); negative where it is
    /// too short.
    pub slack: Vec<f64>,
    /// Displacement that each tendon loses in holes and mount (m); `home` has that of the home pose
    /// subtracted.
    pub lost: Vec<f64>,
    /// Ratio of each span's tension to that before the base hole, by modules and tendons, zero
    /// where the tendon does not pass; and the span's tension (N).
    pub carried: Vec<f64>,
    pub tensions: Vec<f64>,
    pub step: StepStart,
}

/// State of the tendons at the start of a step.
#[derive(Clone, Default)]
pub(crate) struct StepStart {
    /// Fraction of the step where forces balance.
    pub share: f64,
    /// Elongation of each tendon, and its length from base hole to anchor (m).
    pub elongation: Vec<f64>,
    pub routed: Vec<f64>,
    /// Displacements up to which the work of motors has been counted (m).
    pub counted: Vec<f64>,
}

impl Tendons {
    /// One line for each tendon; the home pose is found later.
    pub fn new(robot: &Robot, model: Model, lines: &[Line]) -> Result<Self, InputError> {
        check_lines(robot, model, lines)?;
        let routing = Routing::new(robot);
        let compliance = Compliance::new(robot, model, &routing, lines);
        let (n, m) = (routing.modules, lines.len());
        if let Some(at) = compliance.spans.iter().position(|c| !c.is_finite()) {
            let rule = Rule::Other(
                "be larger: its compliance exceeds the range of floating-point numbers",
            );
            let (i, argument) = (at % m, Argument::TendonStiffness);
            return Err(InputError::number(argument, i, lines[i].stiffness, rule));
        }
        let passes = |at| f64::from(u8::from(routing.passes(at)));
        Ok(Tendons {
            carried: (0..n * m).map(passes).collect(),
            tensions: vec![0.0; n * m],
            lines: lines.to_vec(),
            home: vec![0.0; m],
            slack: vec![0.0; m],
            lost: vec![0.0; m],
            now: History::default(),
            step: StepStart {
                share: 1.0,
                elongation: vec![0.0; m],
                routed: vec![0.0; m],
                counted: vec![0.0; m],
            },
            routing,
            compliance,
        })
    }

    /// Sets the home pose to one under the pretension alone, by its measured spans and strain;
    /// returns the start of a path there, without friction.
    pub fn set_home(&mut self, rod: &dyn RoutedRod, strain: Vec<Vec3>) -> History {
        let lengths = rod.span_lengths();
        let (n, m) = (self.routing.modules, self.lines.len());
        let tensions: Vec<_> = self.lines.iter().map(|line| line.pretension).collect();
        let compliance = &self.compliance;
        let spans =
            (0..n * m).map(|at| lengths[at] - compliance.friction_spans[at] * tensions[at % m]);
        let spans = spans.collect();
        for i in 0..m {
            let unstretched =
                (0..n).map(|k| lengths[k * m + i] - compliance.spans[k * m + i] * tensions[i]);
            self.home[i] = unstretched.sum::<f64>() - compliance.before[i] * tensions[i];
        }
        self.now = History {
            commands: tensions.iter().map(|t| Command::Tension(*t)).collect(),
            tensions,
            drops: vec![0.0; n * m],
            spans,
            displacements: vec![0.0; m],
            strain,
            slip: vec![Slip::Sticks; n * m],
            plays: vec![],
            lags: vec![],
            crept: vec![],
            load: OwnedLoad::default(),
        };
        self.measure_losses(rod);
        for (home, lost) in self.home.iter_mut().zip(&self.lost) {
            *home -= lost;
        }
        self.now.clone()
    }

    /// Whether regularisation determines tensions that neither rod nor line does.
    pub fn is_rigid(&self) -> bool {
        self.compliance.regularisation.iter().any(|r| *r > 0.0)
    }

    /// Entries of a tendon in arrays by modules and tendons.
    fn spans_of(&self, i: usize) -> impl Iterator<Item = usize> {
        let m = self.lines.len();
        (0..self.routing.modules).map(move |k| k * m + i)
    }

    /// Displacement of a tendon without slack (m), with the losses of the present pose.
    pub fn displacement_of(&self, history: &History, i: usize) -> f64 {
        let compliance = &self.compliance;
        let (mut tension, mut routed) = (history.tensions[i], 0.0);
        for at in self.spans_of(i) {
            tension *= (-history.drops[at]).exp();
            routed += history.spans[at]
                + (compliance.friction_spans[at] - compliance.spans[at]) * tension;
        }
        self.home[i] - routed + compliance.before[i] * history.tensions[i] + self.lost[i]
    }

    /// Stores the displacements of the present state, as commanded or as they follow from the
    /// tensions.
    pub fn note_displacements(&mut self) {
        for i in 0..self.lines.len() {
            self.now.displacements[i] = match self.now.commands[i] {
                Command::Displacement(p) => p,
                Command::Tension(_) => self.displacement_of(&self.now, i),
            };
        }
    }

    /// Whether a tendon is taut, or pushes.
    pub fn is_taut(&self, i: usize) -> bool {
        self.now.tensions[i] > self.routing.least[i]
    }

    /// Whether a drive has backlash.
    pub fn has_backlash(&self) -> bool {
        self.lines.iter().any(|line| line.backlash > 0.0)
    }

    /// Whether any tendon loses displacement in holes or mount.
    pub fn have_losses(&self) -> bool {
        self.lines.iter().any(Line::loses)
    }

    /// Whether a motor moves the tendon at the base hole as commanded.
    pub fn is_rigid_to_base(&self, i: usize) -> bool {
        self.compliance.before[i] == 0.0 && !self.lines[i].loses()
    }

    /// Commands that reach the tendons through their drives, after the present displacements.
    pub fn driven(&self, commands: &[Command]) -> Vec<Command> {
        let rows = self.lines.iter().zip(&self.now.displacements);
        let driven = commands.iter().zip(rows);
        driven
            .map(|(command, (line, before))| command.through(line.backlash, *before))
            .collect()
    }

    /// Checks commands and load against the robot.
    pub fn check(
        &self,
        robot: &Robot,
        commands: &[Command],
        load: &Load,
    ) -> Result<(), InputError> {
        if commands.len() != self.lines.len() {
            return Err(InputError::other(format!(
                "{} commands were given, the robot has {} tendons",
                commands.len(),
                self.lines.len()
            )));
        }
        let mut tensions = Vec::with_capacity(commands.len());
        for (i, command) in commands.iter().enumerate() {
            tensions.push(match *command {
                Command::Tension(t) => t,
                Command::Displacement(p) => {
                    let length = self.routing.straight[i];
                    InputError::check_number(Argument::Displacement, i, p, Rule::Finite)?;
                    if p >= length {
                        let rule = Rule::Below(length, "the tendon's length");
                        return Err(InputError::number(Argument::Displacement, i, p, rule));
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
            self.carry(i);
        }
    }

    /// Ratios of a tendon's span tensions to that before the base hole, for the present drops.
    pub fn carry(&mut self, i: usize) {
        let m = self.lines.len();
        let mut drop = 0.0;
        for k in 0..=self.routing.ends[i] {
            drop += self.now.drops[k * m + i];
            self.carried[k * m + i] = if drop == 0.0 { 1.0 } else { (-drop).exp() };
        }
    }

    /// Sets the tensions of all spans from those before the base holes and the drops.
    pub fn apply(&mut self, rod: &mut dyn RoutedRod) {
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

    /// Measures unstretched lengths and slack (theory Eq. 4.1; in motion Eq. 5.4) at the present
    /// pose.
    pub fn measure(&mut self, rod: &dyn RoutedRod) {
        self.measure_losses(rod);
        let lengths = rod.span_lengths();
        let compliance = &self.compliance;
        for (at, span) in self.now.spans.iter_mut().enumerate() {
            *span = lengths[at] - compliance.friction_spans[at] * self.tensions[at];
        }
        for i in 0..self.lines.len() {
            self.slack[i] = match self.now.commands[i] {
                Command::Tension(_) => 0.0,
                Command::Displacement(p) => {
                    let spans = self.spans_of(i);
                    let carried: f64 = spans
                        .map(|at| compliance.spans[at] * self.tensions[at])
                        .sum();
                    let before = compliance.before[i] + compliance.regularisation[i];
                    carried + before * self.now.tensions[i]
                        - (1.0 - self.step.share) * self.step.elongation[i]
                        - self.step.share * self.elongation_at(lengths, i, p)
                }
            };
        }
    }

    /// Measures what is lost in holes and mount at the present pose (theory Eq. 4.10).
    pub fn measure_losses(&mut self, rod: &dyn RoutedRod) {
        if !self.have_losses() {
            return;
        }
        let all: f64 = self.now.tensions.iter().sum();
        for (i, line) in self.lines.iter().enumerate() {
            self.lost[i] = line.mount_compliance * all;
            if line.hole_clearance > 0.0 {
                self.lost[i] += line.hole_clearance * rod.bend(self.routing.ends[i]);
            }
        }
    }

    /// Takes the change of what a tendon loses in its holes from that of its length, for each of the
    /// solutions of the rod.
    pub fn take_clearance(&self, rod: &dyn RoutedRod, i: usize, changes: &mut [f64]) {
        let clearance = self.lines[i].hole_clearance;
        if clearance > 0.0 {
            rod.add_bending(self.routing.ends[i], -clearance, changes);
        }
    }

    /// Length of a tendon from base hole to anchor (m).
    pub fn length_of(&self, lengths: &[f64], i: usize) -> f64 {
        self.spans_of(i).map(|at| lengths[at]).sum()
    }

    /// Elongation of a tendon at a displacement (m); negative where it is slack.
    pub fn elongation_at(&self, lengths: &[f64], i: usize, displacement: f64) -> f64 {
        self.length_of(lengths, i) - self.home[i] + displacement - self.lost[i]
    }

    /// Largest length error (m): of a tendon that is too short, or slack under tension.
    pub fn length_residual(&self) -> f64 {
        let mut most: f64 = 0.0;
        for (i, command) in self.now.commands.iter().enumerate() {
            if command.is_displacement() {
                let s = self.slack[i];
                let miss = if self.is_taut(i) { s.abs() } else { -s };
                most = most.max(miss);
            }
        }
        most / self.step.share
    }

    /// Largest length error of a taut tendon, or slip since `old` at a hole that sticks (m).
    pub fn kept_residual(&self, old: &History) -> f64 {
        let mut most = self.stick_residual(old);
        for (i, command) in self.now.commands.iter().enumerate() {
            if command.is_displacement() && self.is_taut(i) {
                most = most.max(self.slack[i].abs());
            }
        }
        most
    }

    /// Largest slip since `old` at a hole that sticks (m).
    pub fn stick_residual(&self, old: &History) -> f64 {
        let (m, now) = (self.lines.len(), &self.now);
        let mut most: f64 = 0.0;
        for i in 0..m {
            if self.lines[i].friction == 0.0 || now.tensions[i] == 0.0 {
                continue;
            }
            let mut slip = 0.0;
            for at in (0..=self.routing.ends[i]).rev().map(|k| k * m + i) {
                slip += now.spans[at] - old.spans[at];
                if now.slip[at] == Slip::Sticks {
                    most = most.max(slip.abs());
                }
            }
        }
        most
    }

    /// Compliance of a whole tendon (theory Eq. 4.3, m/N).
    pub fn whole_compliance(&self, i: usize) -> f64 {
        let spans = self.spans_of(i).map(|at| self.compliance.spans[at]);
        self.compliance.before[i] + spans.sum::<f64>()
    }

    /// Largest elongation due to regularisation (m).
    pub fn regularisation_length(&self) -> f64 {
        let give = |i: usize| self.compliance.regularisation[i] * self.now.tensions[i];
        (0..self.lines.len()).map(give).fold(0.0, f64::max)
    }
}

fn check_lines(robot: &Robot, model: Model, lines: &[Line]) -> Result<(), InputError> {
    let fail = |what: String| Err(InputError::other(what));
    let m = robot.tendon_count();
    if lines.len() != m {
        return fail(format!(
            "{} lines were given, the robot has {m} tendons",
            lines.len()
        ));
    }
    if m == 0 {
        return fail("a robot without tendons cannot be actuated".into());
    }
    let with_friction = (0..m).filter(|&i| lines[i].friction > 0.0);
    let holes: usize = with_friction
        .map(|i| robot.spec().tendons[i].end_disk + 1)
        .sum();
    if holes > MOST_HOLES {
        return fail(format!(
            "tendons have friction at {holes} holes; this version solves friction at {MOST_HOLES} or fewer"
        ));
    }
    if model.tendon.is_continuous() {
        return fail(
            "displacements, slack and friction need straight spans; a continuous tendon has none"
                .into(),
        );
    }
    for (i, line) in lines.iter().enumerate() {
        if !(line.stiffness > 0.0) {
            let (argument, rule) = (Argument::TendonStiffness, Rule::Positive);
            return Err(InputError::number(argument, i, line.stiffness, rule));
        }
        for (argument, value) in [
            (Argument::FreeLength, line.free_length),
            (Argument::Compliance, line.compliance),
            (Argument::Friction, line.friction),
            (Argument::WrapAngle, line.wrap),
            (Argument::Pretension, line.pretension),
            (Argument::Backlash, line.backlash),
            (Argument::HoleClearance, line.hole_clearance),
            (Argument::MountCompliance, line.mount_compliance),
        ] {
            InputError::check_number(argument, i, value, Rule::NotNegative)?;
        }
    }
    Ok(())
}
