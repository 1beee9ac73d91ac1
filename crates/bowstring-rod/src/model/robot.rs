//! The robot of the mechanics: checked once, immutable afterwards.
//!
//! Theory: docs/theory/rod.md.

use crate::model::coupled::CoupledSection;
use crate::model::error::{Argument, InputError, Rule};
pub use crate::model::section::Section;

/// Sections of the backbone along one segment.
#[derive(Clone, Debug, PartialEq)]
pub enum Profile {
    /// The same section everywhere.
    Uniform(Section),
    /// The same section everywhere, with coupled strains: from [`Profile::of_stiffness`].
    Coupled(Box<CoupledSection>),
    /// Sections at equal distances from the start to the end of the segment. Between them
    /// stiffness, mass and inertia are polynomials of the fourth degree, as in a tapered rod;
    /// angle of the principal axes and unloaded curvature are those of the first one.
    Tapered(Box<[Section; 5]>),
}

impl From<Section> for Profile {
    fn from(section: Section) -> Self {
        Profile::Uniform(section)
    }
}

impl Profile {
    /// A section by its stiffness, which `Robot::new` checks; rows and columns as those of
    /// [`CoupledSection`], the other numbers those of [`Section`]. Without couplings, but of the two
    /// curvatures, and with equal shear stiffnesses it is a plain [`Section`].
    pub fn of_stiffness(
        stiffness: [[f64; 6]; 6],
        mass_per_length: f64,
        rotary_inertia: f64,
        rest_curvature: [f64; 3],
    ) -> Self {
        let mass = [mass_per_length, rotary_inertia];
        let coupled = CoupledSection::new(stiffness, mass, rest_curvature);
        match coupled.plain() {
            Some(section) => Profile::Uniform(section),
            None => Profile::Coupled(Box::new(coupled)),
        }
    }

    /// The given sections; of one with coupled strains its stiffness without couplings.
    pub fn sections(&self) -> &[Section] {
        match self {
            Profile::Uniform(section) => std::slice::from_ref(section),
            Profile::Coupled(coupled) => std::slice::from_ref(coupled.without_couplings()),
            Profile::Tapered(sections) => &sections[..],
        }
    }

    /// The given sections, to be changed; none of one with coupled strains.
    pub fn sections_mut(&mut self) -> &mut [Section] {
        match self {
            Profile::Uniform(section) => std::slice::from_mut(section),
            Profile::Coupled(_) => &mut [],
            Profile::Tapered(sections) => &mut sections[..],
        }
    }

    /// Multiplies all stiffnesses by a factor.
    pub fn scale_stiffness(&mut self, factor: f64) {
        if let Profile::Coupled(coupled) = self {
            coupled.scale(factor);
        }
        for section in self.sections_mut() {
            section.bending = section.bending.map(|x| x * factor);
            section.torsion *= factor;
            section.axial *= factor;
            section.shear *= factor;
        }
    }

    /// Section at a fraction of the segment.
    pub fn at(&self, fraction: f64) -> Section {
        let sections = match self {
            Profile::Uniform(section) => return *section,
            Profile::Coupled(coupled) => return *coupled.without_couplings(),
            Profile::Tapered(sections) => sections,
        };
        // Lagrange's polynomials of the five places
        let weights: [f64; 5] = std::array::from_fn(|i| {
            let others = (0..5).filter(|&j| j != i);
            others
                .map(|j| (4.0 * fraction - j as f64) / (i as f64 - j as f64))
                .product()
        });
        let mix = |of: &dyn Fn(&Section) -> f64| -> f64 {
            sections.iter().zip(weights).map(|(s, w)| w * of(s)).sum()
        };
        Section {
            bending: [mix(&|s| s.bending[0]), mix(&|s| s.bending[1])],
            torsion: mix(&|s| s.torsion),
            axial: mix(&|s| s.axial),
            shear: mix(&|s| s.shear),
            mass_per_length: mix(&|s| s.mass_per_length),
            rotary_inertia: mix(&|s| s.rotary_inertia),
            ..sections[0]
        }
    }

    /// Mean of a number between two fractions of the segment.
    pub fn mean(&self, from: f64, to: f64, of: impl Fn(&Section) -> f64) -> f64 {
        let Profile::Tapered(_) = self else {
            return of(&self.at(from));
        };
        // three Gauss points on each part, of a thirty-second of the segment or less
        let parts = (32.0 * (to - from)).ceil().max(2.0);
        let (out, half) = (0.6_f64.sqrt(), 0.5 * (to - from) / parts);
        let mut sum = 0.0;
        for part in 0..parts as usize {
            let centre = from + half * (2 * part + 1) as f64;
            for (x, weight) in [(-out, 5.0), (0.0, 8.0), (out, 5.0)] {
                sum += weight * of(&self.at(centre + x * half));
            }
        }
        sum / (18.0 * parts)
    }

    /// Place in the section (m) through which an axial force does not bend it.
    pub fn tension_centre(&self) -> [f64; 2] {
        match self {
            Profile::Coupled(section) => section.tension_centre(),
            _ => [0.0; 2],
        }
    }

    /// Mean bending flexibility over the segment (1/(N m^2)): about x, about y, and their product.
    pub fn bending_flexibility(&self) -> [f64; 3] {
        let by = |q: usize| self.mean(0.0, 1.0, |s| 1.0 / s.bending[q]);
        in_axes([by(0), by(1)], self.sections()[0].principal_angle)
    }
}

/// Components about x and y, and their product, of a tensor with these principal values.
pub fn in_axes([first, second]: [f64; 2], angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let difference = first - second;
    [
        second + difference * cos * cos,
        second + difference * sin * sin,
        difference * sin * cos,
    ]
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
    /// Length of its holes along the axis (m), centred on the station: straight tendons end at
    /// their entry and exit planes. Zero where holes are points in the mid-plane.
    pub hole_length: f64,
    /// Segment of the backbone directly before this disk.
    pub segment: usize,
}

/// A rigid body fixed to a disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    /// Index of its disk.
    pub disk: usize,
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass from the centre of the disk, in the frame of the disk (m).
    pub centre: [f64; 3],
    /// Moments of inertia about axes through its centre of mass that are parallel to those of the
    /// disk (kg m^2). Used in dynamics only.
    pub inertia: [f64; 3],
}

/// A tendon: a hole in the base and in every disk up to its end disk.
#[derive(Clone, Debug, PartialEq)]
pub struct Tendon {
    /// Positions x, y of its holes in the frames of the base and of the disks (m), from base to end
    /// disk; a single one stands for all of them.
    pub holes: Vec<[f64; 2]>,
    /// Index of its end disk, where it is anchored.
    pub end_disk: usize,
    /// Whether it pushes too: a rod, or a chamber under pressure. It is never slack.
    pub pushes: bool,
}

impl Tendon {
    /// A tendon parallel to the backbone: the same hole everywhere.
    pub fn parallel(hole: [f64; 2], end_disk: usize) -> Self {
        Tendon {
            holes: vec![hole],
            end_disk,
            pushes: false,
        }
    }

    /// A tendon with these holes in the base and in every disk up to its end disk.
    pub fn new(mut holes: Vec<[f64; 2]>, end_disk: usize) -> Self {
        if holes.iter().all(|hole| *hole == holes[0]) {
            holes.truncate(1);
        }
        Tendon {
            holes,
            end_disk,
            pushes: false,
        }
    }

    /// Least tension (N), at which it is slack; none where it pushes too.
    pub fn least_tension(&self) -> f64 {
        if self.pushes {
            f64::NEG_INFINITY
        } else {
            0.0
        }
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
    /// Sections of the backbone along each segment.
    pub backbone: Vec<Profile>,
    /// Disks from base to tip; the last one is the tip.
    pub disks: Vec<Disk>,
    /// Tendons, those of inner segments first.
    pub tendons: Vec<Tendon>,
    /// Bodies fixed to disks.
    pub payloads: Vec<Payload>,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
}

/// The backbone between two neighbouring disks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Module {
    /// Flexible length between the clamps (m).
    pub flexible: f64,
    /// Rigid lengths next to the start and to the end disk (m).
    pub clamp: [f64; 2],
    /// Lengths of holes beyond the start and before the end disk's station (m).
    pub guides: [f64; 2],
    /// Index of the segment.
    pub segment: usize,
    /// Fractions of the segment where the flexible length begins and ends.
    pub part: [f64; 2],
    /// Index of the first tendon that passes through; all later tendons do too.
    pub first_tendon: usize,
}

/// Where a section of the backbone is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// At the base, which does not move.
    Base,
    /// On a disk or its clamped length, so far beyond its station (m).
    Disk {
        /// The disk.
        disk: usize,
        /// Distance beyond its station (m).
        beyond: f64,
    },
    /// At a fraction of the flexible length of a module.
    Between {
        /// The module.
        module: usize,
        /// Fraction of its flexible part.
        fraction: f64,
    },
}

/// Distance over the flexible length of a module below which a section belongs to the clamp there.
pub const AT_CLAMP: f64 = 1e-9;

/// Place of a section at an arc length of the straight backbone (m). Modules have lengths of the
/// clamp at the start, the flexible part and the clamp at the end (m).
pub fn place(modules: impl IntoIterator<Item = [f64; 3]>, arc_length: f64) -> Place {
    let (mut station, mut last) = (0.0, Place::Base);
    for (k, [start, flexible, end]) in modules.into_iter().enumerate() {
        let along = arc_length - station - start;
        let near = AT_CLAMP * flexible;
        if along <= near {
            break;
        }
        if along < flexible - near {
            return Place::Between {
                module: k,
                fraction: along / flexible,
            };
        }
        station += start + flexible + end;
        last = Place::Disk {
            disk: k,
            beyond: arc_length - station,
        };
    }
    last
}

/// A checked, immutable robot.
#[derive(Clone, Debug)]
pub struct Robot {
    spec: RobotSpec,
    pub(crate) modules: Vec<Module>,
    /// Mass of each disk (kg), and what the backbone in its clamps weighs beyond the mean mass per
    /// length of its module, which all else takes for the clamps too.
    pub(crate) disk_mass: Vec<f64>,
}

impl Robot {
    /// Checks a description; the error names the argument, its value and the allowed range.
    pub fn new(spec: RobotSpec) -> Result<Self, InputError> {
        if spec.disks.is_empty() || spec.backbone.is_empty() {
            return Err(InputError::other(
                "a robot needs at least one segment with one disk at its end",
            ));
        }
        for (i, profile) in spec.backbone.iter().enumerate() {
            if let Profile::Coupled(coupled) = profile {
                coupled.check(i)?;
            }
            for s in profile.sections() {
                Self::check_section(i, s)?;
            }
            if let Profile::Tapered(_) = profile {
                // between the given sections the polynomials may fall below zero
                for k in 1..64 {
                    Self::check_section(i, &profile.at(k as f64 / 64.0))?;
                }
            }
        }
        let mut modules = Vec::with_capacity(spec.disks.len());
        let (mut station, mut clamp_before, mut segment) = (0.0, 0.0, 0);
        for (i, d) in spec.disks.iter().enumerate() {
            if !(d.station.is_finite() && d.station > station) {
                let rule = Rule::Other("lie beyond that of the disk before it");
                return Err(InputError::number(Argument::Station, i, d.station, rule));
            }
            let next = if i == 0 { 0 } else { segment + 1 };
            if d.segment >= spec.backbone.len() || d.segment < segment || d.segment > next {
                let rule = Rule::Other("follow that of the disk before it");
                return Err(InputError::number(Argument::Segment, i, d.segment, rule));
            }
            for (argument, value) in [
                (Argument::ClampedLength, d.clamped_length),
                (Argument::HoleLength, d.hole_length),
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
            let before = if i == 0 {
                0.0
            } else {
                spec.disks[i - 1].hole_length / 2.0
            };
            let guides = [before, d.hole_length / 2.0];
            if d.station - station - guides[0] - guides[1] <= 0.0 {
                let rule = Rule::Other("leave a length of tendon between this disk and the last");
                return Err(InputError::number(
                    Argument::HoleLength,
                    i,
                    d.hole_length,
                    rule,
                ));
            }
            modules.push(Module {
                guides,
                part: [0.0; 2],
                flexible,
                clamp,
                segment: d.segment,
                first_tendon: spec.tendons.partition_point(|t| t.end_disk < i),
            });
            (station, clamp_before, segment) = (d.station, clamp[1], d.segment);
        }
        if segment + 1 != spec.backbone.len() {
            return Err(InputError::other(format!(
                "there are {} segments, but disks for {} only",
                spec.backbone.len(),
                segment + 1
            )));
        }
        Self::place_in_segments(&spec.disks, &mut modules);
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
        for (i, payload) in spec.payloads.iter().enumerate() {
            Self::check_payload(i, payload, spec.disks.len())?;
        }
        InputError::check_finite(Argument::Gravity, None, &spec.gravity)?;
        let mut robot = Robot {
            disk_mass: spec.disks.iter().map(|disk| disk.mass).collect(),
            spec,
            modules,
        };
        robot.weigh_clamps();
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
    /// The robot with all stiffnesses of each segment's backbone multiplied by a factor.
    ///
    /// # Errors
    /// If a stiffness is not positive and finite then.
    pub fn with_stiffness(&self, factors: &[f64]) -> Result<Self, InputError> {
        let mut spec = self.spec.clone();
        for (profile, factor) in spec.backbone.iter_mut().zip(factors) {
            profile.scale_stiffness(*factor);
        }
        Robot::new(spec)
    }
    /// Flexible length of a module (m).
    pub fn flexible_length(&self, module: usize) -> f64 {
        self.modules[module].flexible
    }

    /// Number of modules, which is the number of disks.
    pub fn module_count(&self) -> usize {
        self.modules.len()
    }
    /// Number of tendons.
    pub fn tendon_count(&self) -> usize {
        self.spec.tendons.len()
    }
    /// Checks a tension of each tendon (N), counted on where there are more: finite, and not negative
    /// where the tendon can only pull.
    pub fn check_tensions(&self, tensions: &[f64]) -> Result<(), InputError> {
        let tendons = self.spec.tendons.iter().cycle();
        for (i, (t, tendon)) in tensions.iter().zip(tendons).enumerate() {
            if !(t.is_finite() && *t >= tendon.least_tension()) {
                let rule = match t.is_finite() {
                    true => Rule::TendonsPull,
                    false => Rule::Finite,
                };
                let tendon = i % self.tendon_count();
                return Err(InputError::number(Argument::Tension, tendon, *t, rule));
            }
        }
        Ok(())
    }
    /// Length of the straight backbone (m).
    pub fn length(&self) -> f64 {
        self.spec.disks[self.spec.disks.len() - 1].station
    }
    /// The backbone between neighbouring disks, from base to tip.
    pub fn modules(&self) -> &[Module] {
        &self.modules
    }
    /// Lengths of the clamp at the start, the flexible part and the clamp at the end of every
    /// module (m).
    pub fn lengths(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let modules = self.modules.iter();
        modules.map(|m| [m.clamp[0], m.flexible, m.clamp[1]])
    }
    /// Total mass of disks, backbone and payloads (kg).
    pub fn mass(&self) -> f64 {
        let mut mass = self.spec.payloads.iter().map(|payload| payload.mass).sum();
        for (k, disk) in self.disk_mass.iter().enumerate() {
            let [from, to] = self.modules[k].clamp;
            mass += disk + self.mass_per_length(k) * (from + self.modules[k].flexible + to);
        }
        mass
    }
    /// Mean mass per length of a module (kg/m).
    pub fn mass_per_length(&self, module: usize) -> f64 {
        let [from, to] = self.modules[module].part;
        self.profile(module).mean(from, to, |s| s.mass_per_length)
    }
    /// Length that a tendon has in the holes of its disks (m), to the middle of its end disk.
    pub fn length_in_holes(&self, tendon: usize) -> f64 {
        let guides = self.modules[..=self.spec.tendons[tendon].end_disk].iter();
        guides.flat_map(|module| module.guides).sum()
    }
    fn check_payload(i: usize, payload: &Payload, disks: usize) -> Result<(), InputError> {
        if payload.disk >= disks {
            return Err(InputError::other(format!(
                "payload {} is on disk {}, and the robot has {disks} disks",
                i + 1,
                payload.disk.saturating_add(1)
            )));
        }
        InputError::check_number(Argument::PayloadMass, i, payload.mass, Rule::NotNegative)?;
        InputError::check_finite(Argument::PayloadCentre, i, &payload.centre)?;
        let [a, b, c] = payload.inertia;
        // the moments of inertia of a body obey the triangle inequality
        let least = -1e-12 * (a + b + c);
        let possible = [b + c - a, c + a - b, a + b - c]
            .iter()
            .all(|x| *x >= least);
        if !((a + b + c).is_finite() && a.min(b).min(c) >= 0.0 && possible) {
            let rule = Rule::Other("be the moments of inertia of a body");
            let given = &payload.inertia[..];
            return Err(InputError::number(Argument::PayloadInertia, i, given, rule));
        }
        Ok(())
    }
    /// Whether any segment is tapered.
    pub fn has_taper(&self) -> bool {
        let tapered = |p: &Profile| matches!(p, Profile::Tapered(_));
        self.spec.backbone.iter().any(tapered)
    }
    /// Whether any segment has coupled strains.
    pub fn is_coupled(&self) -> bool {
        let coupled = |p: &Profile| matches!(p, Profile::Coupled(_));
        self.spec.backbone.iter().any(coupled)
    }
    /// Sections along the backbone of a module.
    pub fn profile(&self, module: usize) -> &Profile {
        &self.spec.backbone[self.modules[module].segment]
    }
    /// Section at a fraction of a module's flexible length.
    pub fn section(&self, module: usize, fraction: f64) -> Section {
        let [from, to] = self.modules[module].part;
        self.profile(module).at(from + fraction * (to - from))
    }
    /// Fractions of its segment where the flexible length of each module begins and ends.
    fn place_in_segments(disks: &[Disk], modules: &mut [Module]) {
        let mut first = 0;
        let mut start = 0.0;
        while first < disks.len() {
            let segment = disks[first].segment;
            let next = first + disks[first..].partition_point(|d| d.segment == segment);
            let length = disks[next - 1].station - start;
            let mut station = start;
            for (module, disk) in modules[first..next].iter_mut().zip(&disks[first..next]) {
                let [from, to] = module.clamp;
                module.part = [station + from, disk.station - to].map(|s| (s - start) / length);
                station = disk.station;
            }
            (first, start) = (next, station);
        }
    }
    /// Adds to each disk what the backbone in its clamps weighs beyond that mean.
    fn weigh_clamps(&mut self) {
        if !self.has_taper() {
            return;
        }
        for k in 0..self.modules.len() {
            let [[start, _], [end, _]] = self.clamp_excess(k);
            if k > 0 {
                self.disk_mass[k - 1] += start;
            }
            self.disk_mass[k] += end;
        }
    }
    /// What the backbone weighs more than by the mean of a module in the clamp at its start and at
    /// its end: mass (kg), and mass times distance from the disk (kg m).
    pub(crate) fn clamp_excess(&self, k: usize) -> [[f64; 2]; 2] {
        let Module { part, clamp, .. } = self.modules[k];
        let (profile, mean) = (self.profile(k), self.mass_per_length(k));
        let per_length = (part[1] - part[0]) / self.modules[k].flexible;
        std::array::from_fn(|side| {
            let (length, mut out) = (clamp[side], [0.0; 2]);
            let inward = if side == 0 { -per_length } else { per_length };
            // Gauss's rule
            let off = 0.5 * 0.6_f64.sqrt();
            for (place, weight) in [(0.5 - off, 5.0), (0.5, 8.0), (0.5 + off, 5.0)] {
                let from_disk = place * length;
                let at = part[side] + inward * (length - from_disk);
                let excess = (profile.at(at).mass_per_length - mean) * length * weight / 18.0;
                out[0] += excess;
                out[1] += excess * from_disk;
            }
            out
        })
    }
    fn check_section(segment: usize, s: &Section) -> Result<(), InputError> {
        for (argument, value, rule) in [
            (Argument::BendingStiffness, s.bending[0], Rule::Positive),
            (Argument::BendingStiffness, s.bending[1], Rule::Positive),
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
            InputError::check_number(argument, segment, value, rule)?;
        }
        InputError::check_finite(Argument::PrincipalAngle, segment, &[s.principal_angle])?;
        InputError::check_finite(Argument::RestCurvature, segment, &s.rest_curvature)
    }
    /// Scale of moments (N m): bending stiffness over length, of the segment with the lowest
    /// stiffness.
    pub fn moment_scale(&self) -> f64 {
        let softest = self
            .spec
            .backbone
            .iter()
            .flat_map(Profile::sections)
            .flat_map(|s| s.bending)
            .fold(f64::INFINITY, f64::min);
        softest / self.length()
    }
}
