//! The study's robot, for tests and benchmarks.
#![allow(dead_code)]

use bowstring_core::model::load::Load;
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Section, Tendon};

pub const LENGTH: f64 = 0.641;

pub fn section(diameter: f64, young: f64, poisson: f64, density: f64) -> Section {
    let area = std::f64::consts::PI * diameter * diameter / 4.0;
    let inertia = std::f64::consts::PI * diameter.powi(4) / 64.0;
    let shear = young / (2.0 * (1.0 + poisson));
    Section {
        bending: [young * inertia; 2],
        principal_angle: 0.0,
        torsion: shear * 2.0 * inertia,
        axial: young * area,
        shear: shear * area,
        mass_per_length: density * area,
        rotary_inertia: density * inertia,
        rest_curvature: [0.0; 3],
    }
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
    let tendons = [0.0f64, 120.0, 240.0].map(|a| Tendon {
        holes: vec![[0.029 * a.to_radians().cos(), 0.029 * a.to_radians().sin()]],
        end_disk: n - 1,
        pushes: false,
    });
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
        [90.0f64, -30.0, 210.0].map(|a| Tendon {
            holes: vec![[0.01 * a.to_radians().cos(), 0.01 * a.to_radians().sin()]],
            end_disk,
            pushes: false,
        })
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

/// SplitMix64: the same draws on every platform.
pub struct Draw(pub u64);

impl Draw {
    pub fn within(&mut self, from: f64, to: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        from + (to - from) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
