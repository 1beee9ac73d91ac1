//! The study's robot, for tests and benchmarks.
#![allow(dead_code)]

#[path = "random.rs"]
mod random;
#[path = "stiffness.rs"]
mod stiffness;

use bowstring_core::dynamics::integrator::{Count, Damping, Integrator, Simulator, Step};
use bowstring_core::model::load::{Load, Model, Theory};
use bowstring_core::model::robot::{Disk, Profile, Robot, RobotSpec, Tendon};
use bowstring_core::statics::path::Command;
use bowstring_core::statics::solver::{Outcome, Pose, Solver, Status};
#[allow(unused_imports)]
pub use {random::Draw, stiffness::*};

pub const LENGTH: f64 = 0.641;

/// Hole at a distance from the backbone (m), at an angle in degrees.
pub fn hole(distance: f64, angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.to_radians().sin_cos();
    [distance * cos, distance * sin]
}

/// Amouri 2019, Table 1, with `n` disks of the same total mass and 35 GPa.
pub fn study_robot(n: usize, clamped_length: f64) -> Robot {
    let mass = 0.02 * 9.0 / n as f64;
    let (radius, thickness) = (0.032f64, 0.003f64);
    let across = mass * (3.0 * radius.powi(2) + thickness.powi(2)) / 12.0;
    let disks = (1..=n).map(|k| Disk {
        hole_length: 0.0,
        station: LENGTH * k as f64 / n as f64,
        clamped_length,
        mass,
        inertia: [across, mass * radius.powi(2) / 2.0],
        segment: 0,
    });
    let tendons = [0.0f64, 120.0, 240.0].map(|a| Tendon::parallel(hole(0.029, a), n - 1));
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section(0.005, 35e9, 0.3, 1800.0).into()],
        disks: disks.collect(),
        tendons: tendons.to_vec(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

pub fn by_tensions(tensions: &[f64]) -> Load<'_> {
    Load {
        tensions,
        ..Load::default()
    }
}

/// Rao et al. (2021): two segments of 200 mm, three tendons each.
pub fn rao_robot() -> Robot {
    let disks = (1..=20).map(|k| Disk {
        hole_length: 0.0,
        station: 0.02 * k as f64,
        clamped_length: 0.0,
        mass: 0.001,
        inertia: [4e-8, 7e-8],
        segment: usize::from(k > 10),
    });
    let tendons = [9, 19].into_iter().flat_map(|end_disk| {
        [90.0f64, -30.0, 210.0].map(|a| Tendon::parallel(hole(0.01, a), end_disk))
    });
    let backbone = section(0.0014, 54e9, 0.3, 6450.0);
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![backbone.into(), backbone.into()],
        disks: disks.collect(),
        tendons: tendons.collect(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

/// A backbone without tendons, in equal modules between disks without mass.
pub fn rod(profile: Profile, length: f64, modules: usize) -> Robot {
    let disk = |k: usize| Disk {
        hole_length: 0.0,
        station: length * k as f64 / modules as f64,
        clamped_length: 0.0,
        mass: 0.0,
        inertia: [0.0; 2],
        segment: 0,
    };
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![profile],
        disks: (1..=modules).map(disk).collect(),
        tendons: vec![],
        gravity: [0.0; 3],
    })
    .unwrap()
}

pub fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

/// Solves a load, which must have a solution.
pub fn solved(solver: &mut Solver, load: &Load) -> Outcome {
    let outcome = solver.solve(load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{load:?}");
    outcome
}

/// Poses of the disks of a solution.
pub fn disks(solver: &Solver) -> Vec<Pose> {
    let n = solver.robot().module_count();
    (0..n).map(|k| solver.disk(k).unwrap()).collect()
}

/// Largest distance between disks (m).
pub fn apart(a: &[Pose], b: &[Pose]) -> f64 {
    let gaps = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a.position - b.position).norm());
    gaps.fold(0.0, f64::max)
}

/// An undamped integrator, without gravity.
pub fn fixed_steps(step: f64, spectral_radius: f64) -> Integrator {
    Integrator {
        gravity: [0.0; 3],
        damping: Damping {
            mass: 0.0,
            material: 0.0,
        },
        spectral_radius,
        step: Step::Fixed(step),
    }
}

/// Advances a motion, which nothing must stop.
pub fn go(simulator: &mut Simulator, duration: f64, load: &Load) -> Count {
    let (stop, count) = simulator.advance(duration, load).unwrap();
    assert_eq!(stop, None, "at {} s", simulator.time());
    count
}

pub fn displacements(values: &[f64]) -> Vec<Command> {
    values.iter().map(|p| Command::Displacement(*p)).collect()
}

pub fn tensions(values: &[f64]) -> Vec<Command> {
    values.iter().map(|t| Command::Tension(*t)).collect()
}
