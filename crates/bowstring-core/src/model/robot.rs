//! The robot of the mechanics: checked once, immutable afterwards.
//!
//! Theory: docs/theory/rod.md.

use crate::model::error::{Argument, InputError, Rule};

/// Elastic section of the backbone in one segment; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Bending stiffness E I (N m^2), equal about both axes.
    pub bending: f64,
    /// Torsional stiffness G J (N m^2).
    pub torsion: f64,
    /// Axial stiffness E A (N).
    pub axial: f64,
    /// Shear stiffness G A times the shear factor (N).
    pub shear: f64,
    /// Mass per length rho A (kg/m).
    pub mass_per_length: f64,
    /// Rotary inertia per length rho I about a diameter (kg m), twice that about the axis. Used
    /// in dynamics only.
    pub rotary_inertia: f64,
    /// Curvature about x and y and twist about z of the unloaded backbone, in its own frame (1/m).
    pub rest_curvature: [f64; 3],
}

/// A spacer disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    /// Distance from the base along the straight backbone (m).
    pub station: f64,
    /// Clamped length of backbone (m), rigid, centred on the station.
    pub clamped_length: f64,
    /// Mass (kg).
    pub mass: f64,
    /// Moments of inertia about a diameter and about the axis (kg m^2). Used in dynamics only.
    pub inertia: [f64; 2],
    /// Segment of the backbone directly before this disk.
    pub segment: usize,
}

/// A tendon: a hole in the base and in every disk up to its end disk.
#[derive(Clone, Debug, PartialEq)]
pub struct Tendon {
    /// Positions x, y of its holes in the frames of the base and of the disks (m), from base to end
    /// disk; a single one stands for all of them.
    pub holes: Vec<[f64; 2]>,
    /// Index of its end disk, where it is anchored.
    pub end_disk: usize,
}

impl Tendon {
    /// A tendon parallel to the backbone: the same hole everywhere.
    pub fn parallel(hole: [f64; 2], end_disk: usize) -> Self {
        Tendon {
            holes: vec![hole],
            end_disk,
        }
    }

    /// A tendon with these holes in the base and in every disk up to its end disk.
    pub fn new(mut holes: Vec<[f64; 2]>, end_disk: usize) -> Self {
        if holes.iter().all(|hole| *hole == holes[0]) {
            holes.truncate(1);
        }
        Tendon { holes, end_disk }
    }

    /// Its hole in the base (0) or in a disk (counted from 1); beyond the end disk that of the end
    /// disk.
    pub fn hole(&self, at: usize) -> [f64; 2] {
        self.holes[at.min(self.holes.len() - 1)]
    }
}

/// Description of a [`Robot`]; SI units, base frame with z along the straight backbone.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSpec {
    /// Sections of the backbone, one for each segment.
    pub sections: Vec<Section>,
    /// Disks from base to tip; the last one is the tip.
    pub disks: Vec<Disk>,
    /// Tendons, those of inner segments first.
    pub tendons: Vec<Tendon>,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
}

/// The backbone between two neighbouring disks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Module {
    /// Flexible length between the clamps (m).
    pub flexible: f64,
    /// Rigid lengths next to the start and to the end disk (m).
    pub clamp: [f64; 2],
    /// Index of the section.
    pub segment: usize,
    /// Index of the first tendon that passes through; all later tendons do too.
    pub first_tendon: usize,
}

/// A checked, immutable robot.
#[derive(Clone, Debug)]
pub struct Robot {
    spec: RobotSpec,
    pub(crate) modules: Vec<Module>,
}

impl Robot {
    /// Checks a description; the error names the argument, its value and the allowed range.
    pub fn new(spec: RobotSpec) -> Result<Self, InputError> {
        if spec.disks.is_empty() || spec.sections.is_empty() {
            return Err(InputError::other(
                "a robot needs at least one segment with one disk at its end",
            ));
        }
        for (i, s) in spec.sections.iter().enumerate() {
            for (argument, value, rule) in [
                (Argument::BendingStiffness, s.bending, Rule::Positive),
                (Argument::TorsionStiffness, s.torsion, Rule::Positive),
                (Argument::AxialStiffness, s.axial, Rule::Positive),
                (Argument::ShearStiffness, s.shear, Rule::Positive),
                (
                    Argument::MassPerLength,
                    s.mass_per_length,
                    Rule::NotNegative,
                ),
                (Argument::RotaryInertia, s.rotary_inertia, Rule::NotNegative),
            ] {
                InputError::check_number(argument, i, value, rule)?;
            }
            InputError::check_finite(Argument::RestCurvature, i, &s.rest_curvature)?;
        }
        let mut modules = Vec::with_capacity(spec.disks.len());
        let (mut station, mut clamp_before, mut segment) = (0.0, 0.0, 0);
        for (i, d) in spec.disks.iter().enumerate() {
            if !(d.station.is_finite() && d.station > station) {
                let rule = Rule::Other("lie beyond that of the disk before it");
                return Err(InputError::number(Argument::Station, i, d.station, rule));
            }
            let next = if i == 0 { 0 } else { segment + 1 };
            if d.segment >= spec.sections.len() || d.segment < segment || d.segment > next {
                let rule = Rule::Other("follow that of the disk before it");
                return Err(InputError::number(Argument::Segment, i, d.segment, rule));
            }
            for (argument, value) in [
                (Argument::ClampedLength, d.clamped_length),
                (Argument::Mass, d.mass),
            ] {
                InputError::check_number(argument, i, value, Rule::NotNegative)?;
            }
            let [across, along] = d.inertia;
            // a body's principal moments of inertia obey the triangle inequality
            let possible = along >= 0.0 && across * (2.0 + 1e-12) >= along;
            if !(across.is_finite() && possible) {
                let rule = Rule::Other("be those of a body, about a diameter and about the axis");
                let given = &d.inertia[..];
                return Err(InputError::number(Argument::Inertia, i, given, rule));
            }
            let clamp = [clamp_before, d.clamped_length / 2.0];
            let flexible = d.station - station - clamp[0] - clamp[1];
            if flexible <= 0.0 {
                let (argument, rule) = (Argument::FlexibleLength, Rule::Positive);
                return Err(InputError::number(argument, i, flexible, rule));
            }
            modules.push(Module {
                flexible,
                clamp,
                segment: d.segment,
                first_tendon: spec.tendons.partition_point(|t| t.end_disk < i),
            });
            (station, clamp_before, segment) = (d.station, clamp[1], d.segment);
        }
        if segment + 1 != spec.sections.len() {
            return Err(InputError::other(format!(
                "there are {} segments, but disks for {} only",
                spec.sections.len(),
                segment + 1
            )));
        }
        let mut end = 0;
        for (i, t) in spec.tendons.iter().enumerate() {
            for hole in &t.holes {
                InputError::check_finite(Argument::Hole, i, hole)?;
            }
            if t.end_disk >= spec.disks.len() || t.end_disk < end {
                let rule = Rule::Other(
                    "be a disk, no closer to the base than that of the previous tendon",
                );
                return Err(InputError::number(Argument::EndDisk, i, t.end_disk, rule));
            }
            if ![1, t.end_disk + 2].contains(&t.holes.len()) {
                return Err(InputError::other(format!(
                    "tendon {} has {} holes, it must have one for all, or one in the base and in \
                     each of the {} disks that it passes",
                    i + 1,
                    t.holes.len(),
                    t.end_disk + 1
                )));
            }
            end = t.end_disk;
        }
        InputError::check_finite(Argument::Gravity, None, &spec.gravity)?;
        let robot = Robot { spec, modules };
        if !robot.moment_scale().is_normal() {
            return Err(InputError::other(
                "bending stiffness over length exceeds the range of floating-point numbers",
            ));
        }
        Ok(robot)
    }

    /// The description of the robot.
    pub fn spec(&self) -> &RobotSpec {
        &self.spec
    }
    /// Number of modules, which is the number of disks.
    pub fn module_count(&self) -> usize {
        self.modules.len()
    }
    /// Number of tendons.
    pub fn tendon_count(&self) -> usize {
        self.spec.tendons.len()
    }
    /// Length of the straight backbone (m).
    pub fn length(&self) -> f64 {
        self.spec.disks[self.spec.disks.len() - 1].station
    }
    /// Total mass of disks and backbone (kg).
    pub fn mass(&self) -> f64 {
        let (mut mass, mut from) = (0.0, 0.0);
        for (k, disk) in self.spec.disks.iter().enumerate() {
            mass += disk.mass + self.section(k).mass_per_length * (disk.station - from);
            from = disk.station;
        }
        mass
    }
    pub(crate) fn section(&self, module: usize) -> &Section {
        &self.spec.sections[self.modules[module].segment]
    }
    /// Scale of moments (N m): bending stiffness over length, of the segment with the lowest
    /// stiffness.
    pub fn moment_scale(&self) -> f64 {
        let softest = self
            .spec
            .sections
            .iter()
            .map(|s| s.bending)
            .fold(f64::INFINITY, f64::min);
        softest / self.length()
    }
}
