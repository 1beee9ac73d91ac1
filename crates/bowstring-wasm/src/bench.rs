//! A robot on the bench: its path of equilibria, and the fields of its present pose.

use crate::arcs::Curvature;
use crate::loads::Loads;
use crate::motion::{Motion, POINTS};
use bowstring_compiled::{read, Compiled};
use bowstring_core::dynamics::integrator::{Damping, Fields, Integrator, Simulator, Step};
use bowstring_core::model::load::Model;
use bowstring_core::model::robot::{Robot, Tendon};
use bowstring_core::statics::inverse::InverseSolver;
use bowstring_core::statics::path::{Command, Line, PathOutcome, PathSolver};
use bowstring_core::statics::solver::Status;
use bowstring_core::stress::Section;

/// Time step of a motion (s).
const TIME_STEP: f64 = 1.0 / 240.0;
/// Spectral radius: fast oscillations of single modules decay.
const SPECTRAL_RADIUS: f64 = 0.8;

/// How a solve ended.
pub struct Solved {
    pub converged: bool,
    pub residual: f64,
    pub error: f64,
    pub iterations: usize,
    pub sentence: String,
}

pub struct Bench {
    robot: Robot,
    model: Model,
    lines: Vec<Line>,
    /// The path in the home pose, with the fewest elements.
    home: PathSolver,
    path: PathSolver,
    arcs: Curvature,
    /// Outer and inner radius of each segment (m), where they are known.
    radii: Option<Vec<[f64; 2]>>,
    /// Position and rotation of each disk in the last equilibrium.
    poses: Vec<f64>,
    /// Fields of the last equilibrium, of the robot with its mass in points as in a motion: for
    /// stress and the picture.
    fields: Option<Fields>,
    motion: Option<Motion>,
    /// Inverse kinematics, made at its first use.
    pub(crate) inverse: Option<Box<InverseSolver>>,
}

impl Bench {
    pub fn new(compiled: &str) -> Result<Self, String> {
        let Compiled {
            robot,
            path,
            compliance,
            pretension,
            ..
        } = read(compiled.as_bytes())?;
        let model = Model {
            tendon: path,
            ..Model::default()
        };
        let line = |(compliance, pretension): (&f64, &f64)| Line {
            compliance: *compliance,
            pretension: *pretension,
            ..Line::default()
        };
        let lines: Vec<_> = compliance.iter().zip(&pretension).map(line).collect();
        let home = PathSolver::new(&robot, model, None, &lines).map_err(|e| e.to_string())?;
        Ok(Bench {
            arcs: Curvature::new(&robot),
            robot,
            model,
            lines,
            path: home.clone(),
            home,
            radii: None,
            poses: vec![],
            fields: None,
            motion: None,
            inverse: None,
        })
    }

    pub fn set_radii(&mut self, outer: &[f64], inner: &[f64]) -> Result<(), String> {
        let segments = self.robot.spec().backbone.len();
        if outer.len() != segments || inner.len() != segments {
            return Err(format!("radii must be one for each of {segments} segments"));
        }
        let pairs = outer
            .iter()
            .zip(inner)
            .map(|(outer, inner)| [*outer, *inner]);
        let pairs: Vec<_> = pairs.collect();
        let sound = |[outer, inner]: &[f64; 2]| *inner >= 0.0 && inner < outer && outer.is_finite();
        if !pairs.iter().all(sound) {
            return Err("an inner radius must be 0 or more, and less than the outer one".into());
        }
        self.radii = Some(pairs);
        Ok(())
    }

    /// Equilibrium of commands and loads; without one the last pose is kept.
    pub fn solve(
        &mut self,
        displacements: bool,
        commands: &[f64],
        loads: &Loads,
        cold: bool,
    ) -> Result<Solved, String> {
        self.motion = None;
        if cold {
            self.path = self.home.clone();
        }
        let command = match displacements {
            true => Command::Displacement,
            false => Command::Tension,
        };
        let commands: Vec<_> = commands.iter().map(|c| command(*c)).collect();
        let outcome = self.path.step(&commands, &loads.with(&[]));
        let outcome = outcome.map_err(|error| error.to_string())?;
        let converged = outcome.status == Status::Converged;
        if converged {
            self.poses.clear();
            for pose in (0..self.robot.module_count()).filter_map(|k| self.path.solver().disk(k)) {
                self.poses.extend(pose.position.0);
                self.poses.extend(pose.rotation.0.as_flattened());
            }
            self.fields = self.rest_of(loads);
        }
        Ok(Solved {
            converged,
            residual: outcome.residual,
            error: outcome.error.map_or(f64::NAN, |error| error.tip),
            iterations: outcome.iterations,
            sentence: self.sentence(&outcome),
        })
    }

    fn sentence(&self, outcome: &PathOutcome) -> String {
        match outcome.status {
            Status::Converged if outcome.stable == Some(false) => {
                "this equilibrium is unstable: the robot would jump to another".into()
            }
            Status::Converged if self.fields.is_none() => {
                "the pose cannot be drawn: the robot has no stable rest with its masses".into()
            }
            Status::Converged => String::new(),
            Status::Unstable => "this load has no stable equilibrium near the last pose".into(),
            Status::NoEquilibrium if !outcome.opposing.is_empty() => {
                let names: Vec<_> = outcome
                    .opposing
                    .iter()
                    .map(|i| format!("{}", i + 1))
                    .collect();
                format!(
                    "the displacements of tendons {} conflict: no pose has all of them",
                    names.join(", ")
                )
            }
            Status::NoEquilibrium => "this load has no equilibrium without colliding disks".into(),
            Status::MaxIterations => {
                "no equilibrium was found; the load may be more than the robot holds".into()
            }
        }
    }

    /// Settings of a motion.
    fn integrator(gravity: [f64; 3], damping: f64, step: Step) -> Integrator {
        Integrator {
            gravity,
            damping: Damping {
                mass: damping,
                material: 0.0,
            },
            spectral_radius: SPECTRAL_RADIUS,
            step,
        }
    }

    fn simulator(&self, elements: usize, settings: Integrator) -> Result<Simulator, String> {
        let simulator = Simulator::new(&self.robot, self.model, elements, settings);
        simulator.map_err(|error| error.to_string())
    }

    /// Fields of the last equilibrium; `None` where it cannot be at rest with its masses.
    fn rest_of(&self, loads: &Loads) -> Option<Fields> {
        // it makes no step, so that any robot may have one
        let step = Step::Adaptive {
            tolerance: self.robot.length(),
            longest: TIME_STEP,
        };
        let settings = Self::integrator(loads.gravity, 0.0, step);
        let elements = self.path.solver().elements();
        let mut simulator = self.simulator(elements, settings).ok()?;
        if simulator.rest_at(&self.path) != Ok(None) {
            return None;
        }
        let mut fields = Fields::default();
        simulator.record(POINTS, &mut fields);
        Some(fields)
    }

    /// A motion at rest in the last equilibrium, with one element in each module, so that it keeps
    /// up with real time; the sentence says why there is none.
    fn at_rest(&self, gravity: [f64; 3], damping: f64) -> Result<Simulator, String> {
        let said = |error: bowstring_core::model::error::InputError| error.to_string();
        let mut simulator = self.simulator(
            1,
            Self::integrator(gravity, damping, Step::Fixed(TIME_STEP)),
        )?;
        let mut path = simulator.path_solver(&self.lines).map_err(said)?;
        let history = self.path.history();
        let outcome = path.step(&history.commands, &history.load.borrow());
        let no_rest = || "the robot has no stable rest here to start from".to_string();
        if outcome.map_err(said)?.status != Status::Converged {
            return Err(no_rest());
        }
        match simulator.rest_at(&path).map_err(said)? {
            None => Ok(simulator),
            Some(_) => Err(no_rest()),
        }
    }

    /// Starts a motion from the last equilibrium towards other commands and loads; gravity stays.
    pub fn release(
        &mut self,
        commands: &[f64],
        loads: &Loads,
        rise: f64,
        damping: f64,
    ) -> Result<(), String> {
        self.motion = None;
        if !(rise >= 0.0 && rise.is_finite()) {
            return Err(format!("the rise time is {rise} s; it must be 0 or more"));
        }
        let history = self.path.history();
        let load = &history.load;
        let before = Loads {
            gravity: load.gravity,
            force: load.tip_force,
            moment: load.tip_moment,
        };
        let values: Vec<_> = history.commands.iter().map(Command::value).collect();
        if commands.len() != values.len() {
            return Err(format!(
                "{} commands, and the robot has {} tendons",
                commands.len(),
                values.len()
            ));
        }
        let simulator = self.at_rest(before.gravity, damping)?;
        let (from, to) = ((values, before), (commands.to_vec(), *loads));
        self.motion = Some(Motion::new(simulator, from, to, rise)?);
        Ok(())
    }

    /// Advances the motion; the sentence says why it stopped, and is empty where it did not.
    pub fn advance(&mut self, duration: f64) -> Result<String, String> {
        let Some(motion) = &mut self.motion else {
            return Err("nothing moves: release the robot first".into());
        };
        motion.advance(duration)
    }

    pub fn kinetic_energy(&self) -> f64 {
        self.motion.as_ref().map_or(0.0, Motion::kinetic_energy)
    }

    pub(crate) fn robot(&self) -> &Robot {
        &self.robot
    }

    pub(crate) fn model(&self) -> Model {
        self.model
    }

    pub(crate) fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Fields of the motion, or of the last equilibrium.
    pub fn fields(&self) -> Option<&Fields> {
        self.motion
            .as_ref()
            .map(Motion::fields)
            .or(self.fields.as_ref())
    }

    /// Position (3) and rotation (9) of each disk, from base to tip.
    pub fn disks(&self) -> Vec<f64> {
        let Some(motion) = &self.motion else {
            return self.poses.clone();
        };
        let disks = &motion.fields().disks;
        let rows = disks.position.chunks(3).zip(disks.rotation.chunks(9));
        rows.flat_map(|(p, r)| p.iter().chain(r).copied()).collect()
    }

    /// By how much the path of each tendon is shorter than in the straight robot (m), in the last
    /// equilibrium: its displacement, but where it is slack or elastic.
    pub fn path_displacements(&self) -> Vec<f64> {
        let spec = self.robot.spec();
        let of = |(i, tendon): (usize, &Tendon)| {
            let length = self.path.solver().tendon_length(i)?;
            Some(spec.disks[tendon.end_disk].station - length)
        };
        let found: Option<Vec<_>> = spec.tendons.iter().enumerate().map(of).collect();
        found.unwrap_or_default()
    }

    pub fn arcs(&self) -> &Curvature {
        &self.arcs
    }

    /// Largest von Mises stress (Pa) at each point of the backbone.
    pub fn stress(&self) -> Vec<f64> {
        let (Some(fields), Some(radii)) = (self.fields(), &self.radii) else {
            return vec![];
        };
        let disks = self.robot.spec().disks.iter();
        let sections: Vec<_> = disks
            .flat_map(|disk| {
                let [outer, inner] = radii[disk.segment];
                [Section::ring(outer, inner); POINTS]
            })
            .collect();
        let (force, moment) = (&fields.sections.force, &fields.sections.moment);
        if force.len() != 3 * sections.len() {
            return vec![];
        }
        bowstring_core::stress::largest_von_mises(&sections, force, moment)
    }
}
