//! Parts of robots for unit tests, of this crate and of `bowstring-rod`.
#![allow(dead_code)]

use crate::model::robot::{Disk, RobotSpec, Section, Tendon};

/// A round section of glass fibre of this bending stiffness (N m^2).
pub fn section(bending: f64) -> Section {
    Section {
        bending: [bending; 2],
        principal_angle: 0.0,
        torsion: 0.8 * bending,
        axial: 7e5,
        shear: 2.6e5,
        mass_per_length: 0.035,
        rotary_inertia: 5.5e-8,
        rest_curvature: [0.0; 3],
    }
}

/// A robot of these sections, by segments, with disks at equal distances (m), and with tendons around
/// it in equal steps (rad) up to these disks.
pub fn robot(
    sections: &[Section],
    disks: &[usize],
    [pitch, clamped_length]: [f64; 2],
    step: f64,
    end_disks: &[usize],
) -> RobotSpec {
    let segments = disks.iter().enumerate();
    let segments = segments.flat_map(|(segment, count)| std::iter::repeat_n(segment, *count));
    let disk = |(k, segment)| Disk {
        hole_length: 0.0,
        station: pitch * (k + 1) as f64,
        clamped_length,
        mass: 0.02,
        inertia: [5.1e-6, 1.0e-5],
        segment,
    };
    let tendon = |(i, end_disk): (usize, &usize)| {
        let (sin, cos) = (step * i as f64).sin_cos();
        Tendon::parallel([0.02 * cos, 0.02 * sin], *end_disk)
    };
    RobotSpec {
        payloads: vec![],
        backbone: sections.iter().map(|section| (*section).into()).collect(),
        disks: segments.enumerate().map(disk).collect(),
        tendons: end_disks.iter().enumerate().map(tendon).collect(),
        gravity: [0.0; 3],
    }
}
