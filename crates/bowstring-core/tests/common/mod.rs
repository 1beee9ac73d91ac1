//! The study's robot, for tests and benchmarks.
#![allow(dead_code)]

use bowstring_core::load::Load;
use bowstring_core::robot::{Disk, Robot, RobotSpec, Section, Tendon};

pub const LENGTH: f64 = 0.641;

pub fn section(diameter: f64, young: f64, poisson: f64, density: f64) -> Section {
    let area = std::f64::consts::PI * diameter * diameter / 4.0;
    let inertia = std::f64::consts::PI * diameter.powi(4) / 64.0;
    let shear = young / (2.0 * (1.0 + poisson));
    Section {
        bending: young * inertia,
        torsion: shear * 2.0 * inertia,
        axial: young * area,
        shear: shear * area,
        mass_per_length: density * area,
        rotary_inertia: density * inertia,
    }
}

/// Amouri 2019, Table 1, with `n` disks of the same total mass and 35 GPa.
pub fn study_robot(n: usize, clamped_length: f64) -> Robot {
    let mass = 0.02 * 9.0 / n as f64;
    let (radius, thickness) = (0.032f64, 0.003f64);
    let across = mass * (3.0 * radius.powi(2) + thickness.powi(2)) / 12.0;
    let disks = (1..=n).map(|k| Disk {
        station: LENGTH * k as f64 / n as f64,
        clamped_length,
        mass,
        inertia: [across, mass * radius.powi(2) / 2.0],
        segment: 0,
    });
    let tendons = [0.0f64, 120.0, 240.0].map(|a| Tendon {
        hole: [0.029 * a.to_radians().cos(), 0.029 * a.to_radians().sin()],
        end_disk: n - 1,
    });
    Robot::new(RobotSpec {
        sections: vec![section(0.005, 35e9, 0.3, 1800.0)],
        disks: disks.collect(),
        tendons: tendons.to_vec(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

pub fn pull(tensions: &[f64]) -> Load<'_> {
    Load {
        tensions,
        gravity: [0.0; 3],
        tip_force: [0.0; 3],
        tip_moment: [0.0; 3],
    }
}
