//! Loads and the physics to solve.
//!
//! Theory: docs/theory/rod.md (Loads).

use crate::math::linalg::Vec3;
use crate::model::error::{Argument, InputError};
use crate::model::robot::{place, Place, Robot, AT_CLAMP};

/// Rod theory of the backbone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Theory {
    /// With shear and extension.
    Cosserat,
    /// Inextensible and unshearable.
    Kirchhoff,
}

/// Path of a tendon between two disks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TendonPath {
    /// Straight spans from hole to hole, as in a real robot.
    Straight,
    /// Along the backbone, and straight from hole to hole in the axes of its sections: the model of
    /// most published codes, for comparison.
    Continuous,
    /// Along the backbone, and smooth in the axes of its sections: lumens of a solid body.
    Embedded,
}

impl TendonPath {
    /// Whether tendons act on every section, not on disks alone.
    pub fn is_continuous(self) -> bool {
        self != TendonPath::Straight
    }
}

/// Torsional stiffness of a model without twist, relative to that of the backbone.
pub(crate) const RIGID_IN_TORSION: f64 = 1e6;

/// The physics to solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Model {
    /// Rod theory of the backbone.
    pub theory: Theory,
    /// Path of the tendons between disks.
    pub tendon: TendonPath,
    /// Whether the backbone can twist; if not, its torsional stiffness is multiplied by a million.
    pub twist: bool,
}

impl Default for Model {
    fn default() -> Self {
        Model {
            theory: Theory::Cosserat,
            tendon: TendonPath::Straight,
            twist: true,
        }
    }
}

/// Numbers of elements in a module to choose from.
pub const LEVELS: [usize; 4] = [1, 2, 4, 8];

/// Model of the rod: its physics and its elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RodModel {
    /// Physics.
    pub model: Model,
    /// Fourth-order elements in a module: 1, 2, 4 or 8; `None` chooses them for each load.
    pub elements: Option<usize>,
}

/// A force and a moment at a point fixed to a disk or to a section of the backbone; SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointLoad {
    /// The disk, from base to tip; not used where there is an arc length.
    pub disk: usize,
    /// Arc length of the section of the straight backbone on which it acts (m); `None` for a load
    /// on a disk.
    pub arc_length: Option<f64>,
    /// Point at which the force acts, from the centre of the disk or section, in its frame (m).
    pub point: [f64; 3],
    /// Force (N).
    pub force: [f64; 3],
    /// Moment (N m).
    pub moment: [f64; 3],
    /// Whether force and moment turn with the disk or section, their components then being in its
    /// frame; otherwise they are dead loads in the base frame.
    pub follower: bool,
}

impl PointLoad {
    /// Whether the load has a potential: a dead force has, wherever it acts.
    pub fn has_potential(&self) -> bool {
        self.moment == [0.0; 3] && !(self.follower && self.force != [0.0; 3])
    }

    /// Moment of force and moment about the centre of the disk, in the disk's frame (N m).
    pub fn own_moment(&self) -> Vec3 {
        Vec3(self.point).cross(Vec3(self.force)) + Vec3(self.moment)
    }
}

/// Motion of the base of a robot in motion, in axes of the base that move with it; SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BaseMotion {
    /// Acceleration of the origin (m/s^2).
    pub acceleration: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
    /// Angular acceleration (rad/s^2).
    pub angular_acceleration: [f64; 3],
}

impl BaseMotion {
    fn parts(&self) -> [[f64; 3]; 3] {
        [
            self.acceleration,
            self.angular_velocity,
            self.angular_acceleration,
        ]
    }
}

/// Loads of the robot, in the base frame unless they are followers, and the tension of each tendon;
/// SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load<'a> {
    /// Tensions (N), one for each tendon, none negative.
    pub tensions: &'a [f64],
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Force on the tip (N), beside that on the last disk.
    pub tip_force: [f64; 3],
    /// Moment on the tip (N m), beside that on the last disk.
    pub tip_moment: [f64; 3],
    /// Forces on the disks (N) from base to tip, one for each disk; empty if there are none.
    pub disk_forces: &'a [[f64; 3]],
    /// Moments on the disks (N m), in the same form.
    pub disk_moments: &'a [[f64; 3]],
    /// Loads at points fixed to disks, in addition.
    pub point_loads: &'a [PointLoad],
    /// Forces per length on the backbone (N/m) before each disk; empty if there are none.
    pub line_forces: &'a [[f64; 3]],
    /// Motion of the base, used in motion only.
    pub base: BaseMotion,
}

/// A [`Load`] that owns its tensions and the loads on its disks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnedLoad {
    /// Tensions (N), one for each tendon.
    pub tensions: Vec<f64>,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Force on the tip (N), beside that on the last disk.
    pub tip_force: [f64; 3],
    /// Moment on the tip (N m), beside that on the last disk.
    pub tip_moment: [f64; 3],
    /// Forces on the disks (N) from base to tip, one for each disk; empty if there are none.
    pub disk_forces: Vec<[f64; 3]>,
    /// Moments on the disks (N m), in the same form.
    pub disk_moments: Vec<[f64; 3]>,
    /// Loads at points fixed to disks, in addition.
    pub point_loads: Vec<PointLoad>,
    /// Forces per length on the backbone (N/m) before each disk; empty if there are none.
    pub line_forces: Vec<[f64; 3]>,
    /// Motion of the base, used in motion only.
    pub base: BaseMotion,
}

/// Linear interpolation; the end is met exactly.
fn mix(a: f64, b: f64, share: f64) -> f64 {
    if (share - 1.0).abs() < 1e-12 {
        b
    } else {
        a + share * (b - a)
    }
}

fn mix_vectors(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    [0, 1, 2].map(|q| mix(a[q], b[q], share))
}

/// Interpolates between vectors on disks, of which there may be none.
fn mix_disks(out: &mut Vec<[f64; 3]>, from: &[[f64; 3]], to: &[[f64; 3]], share: f64) {
    let on = |disks: &[[f64; 3]], k: usize| disks.get(k).copied().unwrap_or_default();
    out.clear();
    let disks = 0..from.len().max(to.len());
    out.extend(disks.map(|k| mix_vectors(on(from, k), on(to, k), share)));
}

/// Interpolates between point loads; those that act in one of the lists only fade in or out.
fn mix_points(out: &mut Vec<PointLoad>, from: &[PointLoad], to: &[PointLoad], share: f64) {
    let place = |load: &PointLoad| (load.disk, load.arc_length, load.point, load.follower);
    let none = |load: &PointLoad| PointLoad {
        force: [0.0; 3],
        moment: [0.0; 3],
        ..*load
    };
    let mixed = |a: &PointLoad, b: &PointLoad| PointLoad {
        force: mix_vectors(a.force, b.force, share),
        moment: mix_vectors(a.moment, b.moment, share),
        ..*a
    };
    out.clear();
    let alike = from.len() == to.len() && from.iter().map(place).eq(to.iter().map(place));
    if alike {
        out.extend(from.iter().zip(to).map(|(a, b)| mixed(a, b)));
        return;
    }
    out.extend(from.iter().map(|a| mixed(a, &none(a))));
    out.extend(to.iter().map(|b| mixed(&none(b), b)));
}

impl OwnedLoad {
    /// Copies a load; allocates nothing if it has as many tensions and loaded disks.
    pub fn set(&mut self, load: &Load) {
        self.tensions.clear();
        self.tensions.extend_from_slice(load.tensions);
        self.set_dead(load);
    }

    /// The same without tensions.
    pub fn set_dead(&mut self, load: &Load) {
        (self.gravity, self.tip_force, self.tip_moment) =
            (load.gravity, load.tip_force, load.tip_moment);
        for (to, from) in [
            (&mut self.disk_forces, load.disk_forces),
            (&mut self.disk_moments, load.disk_moments),
            (&mut self.line_forces, load.line_forces),
        ] {
            to.clear();
            to.extend_from_slice(from);
        }
        self.point_loads.clear();
        self.point_loads.extend_from_slice(load.point_loads);
        self.base = load.base;
    }

    /// Borrows it as a [`Load`].
    pub fn borrow(&self) -> Load<'_> {
        Load {
            tensions: &self.tensions,
            gravity: self.gravity,
            tip_force: self.tip_force,
            tip_moment: self.tip_moment,
            disk_forces: &self.disk_forces,
            disk_moments: &self.disk_moments,
            point_loads: &self.point_loads,
            line_forces: &self.line_forces,
            base: self.base,
        }
    }

    /// Interpolates linearly between two loads, gravity excepted.
    pub fn between(&mut self, from: &Self, to: &Self, share: f64) {
        for i in 0..self.tensions.len() {
            self.tensions[i] = mix(from.tensions[i], to.tensions[i], share);
        }
        self.mix_wrenches(from, &to.borrow(), share);
    }

    /// Interpolates linearly between two loads without their tensions.
    pub fn between_dead(&mut self, from: &Self, to: &Load, share: f64) {
        self.gravity = mix_vectors(from.gravity, to.gravity, share);
        self.mix_wrenches(from, to, share);
    }

    fn mix_wrenches(&mut self, from: &Self, to: &Load, share: f64) {
        self.tip_force = mix_vectors(from.tip_force, to.tip_force, share);
        self.tip_moment = mix_vectors(from.tip_moment, to.tip_moment, share);
        let mixed = |a: [f64; 3], b: [f64; 3]| mix_vectors(a, b, share);
        self.base = BaseMotion {
            acceleration: mixed(from.base.acceleration, to.base.acceleration),
            angular_velocity: mixed(from.base.angular_velocity, to.base.angular_velocity),
            angular_acceleration: mixed(
                from.base.angular_acceleration,
                to.base.angular_acceleration,
            ),
        };
        let Self {
            disk_forces,
            disk_moments,
            line_forces,
            ..
        } = self;
        mix_disks(disk_forces, &from.disk_forces, to.disk_forces, share);
        mix_disks(disk_moments, &from.disk_moments, to.disk_moments, share);
        mix_disks(line_forces, &from.line_forces, to.line_forces, share);
        mix_points(
            &mut self.point_loads,
            &from.point_loads,
            to.point_loads,
            share,
        );
    }

    /// Multiplies tensions, gravity and dead forces by one factor, moments and followers by
    /// another.
    pub fn scale(&mut self, forces: f64, moments: f64) {
        self.tensions.iter_mut().for_each(|t| *t *= forces);
        let with_forces = [&mut self.gravity, &mut self.tip_force];
        let with_forces = with_forces.into_iter().chain(&mut self.disk_forces);
        let with_forces = with_forces.chain(&mut self.line_forces);
        with_forces.flatten().for_each(|x| *x *= forces);
        let with_moments = std::iter::once(&mut self.tip_moment).chain(&mut self.disk_moments);
        with_moments.flatten().for_each(|x| *x *= moments);
        for load in &mut self.point_loads {
            let of_force = if load.follower { moments } else { forces };
            load.force = load.force.map(|x| x * of_force);
            load.moment = load.moment.map(|x| x * moments);
        }
    }
}

impl Load<'_> {
    /// Dead moment on a disk of a robot with `n` disks, that on the tip included (N m).
    #[inline(always)]
    pub fn moment_on(&self, k: usize, n: usize) -> [f64; 3] {
        let own = self.disk_moments.get(k).copied().unwrap_or_default();
        match k + 1 == n {
            true => [0, 1, 2].map(|q| self.tip_moment[q] + own[q]),
            false => own,
        }
    }

    /// Whether there are moments on disks, that on the tip included.
    pub fn has_moments(&self) -> bool {
        let mut on_disks = self.disk_moments.iter();
        self.tip_moment != [0.0; 3] || on_disks.any(|moment| *moment != [0.0; 3])
    }

    /// Whether all loads have a potential: moments and followers have none.
    #[inline(always)]
    pub fn has_potential(&self) -> bool {
        self.tip_moment == [0.0; 3]
            && self.disk_moments.iter().all(|m| *m == [0.0; 3])
            && self.point_loads.iter().all(PointLoad::has_potential)
    }

    /// Whether it can be solved in lanes: dead forces on disks alone.
    #[inline(always)]
    pub fn fits_lanes(&self) -> bool {
        self.point_loads.is_empty() && self.line_forces.is_empty() && self.has_potential()
    }

    /// Whether a point load has no potential: a follower or a moment.
    pub fn has_follower(&self) -> bool {
        !self.point_loads.iter().all(PointLoad::has_potential)
    }

    /// Sum of the magnitudes of all moments, and of follower forces times a length (N m).
    pub fn size_without_potential(&self, length: f64) -> f64 {
        let of_points = self.point_loads.iter().map(|load| {
            let force = if load.follower { length } else { 0.0 };
            Vec3(load.moment).norm() + force * Vec3(load.force).norm()
        });
        let all = self.disk_moments.iter().chain([&self.tip_moment]);
        all.map(|m| Vec3(*m).norm()).sum::<f64>() + of_points.sum::<f64>()
    }

    /// The same load with moments below `least` (N m) in sum removed: they are below the residual,
    /// but as they have no potential they would change how stability is determined.
    pub fn without_negligible(&self, least: f64) -> Self {
        match self.point_loads.is_empty() && self.size_without_potential(0.0) <= least {
            true => Load {
                tip_moment: [0.0; 3],
                disk_moments: &[],
                ..*self
            },
            false => *self,
        }
    }

    /// Checks numbers and their count against the robot.
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        let tendons = robot.tendon_count();
        if self.tensions.len() != tendons {
            let given = self.tensions.len();
            return Err(InputError::count(
                Argument::Tension,
                given,
                tendons,
                "tendon",
            ));
        }
        robot.check_tensions(self.tensions)?;
        for (argument, v) in [
            (Argument::Gravity, &self.gravity),
            (Argument::TipForce, &self.tip_force),
            (Argument::TipMoment, &self.tip_moment),
        ] {
            InputError::check_finite(argument, None, v)?;
        }
        let disks = robot.module_count();
        for (argument, rows) in [
            (Argument::DiskForces, self.disk_forces),
            (Argument::DiskMoments, self.disk_moments),
            (Argument::LineForces, self.line_forces),
        ] {
            if !rows.is_empty() && rows.len() != disks {
                return Err(InputError::count(argument, rows.len(), disks, "disk"));
            }
            for (k, row) in rows.iter().enumerate() {
                InputError::check_finite(argument, k, row)?;
            }
        }
        for part in self.base.parts() {
            InputError::check_finite(Argument::BaseMotion, None, &part)?;
        }
        self.check_places(robot)?;
        self.check_sections(robot, &[])
    }

    /// Checks the places and numbers of point loads.
    pub fn check_places(&self, robot: &Robot) -> Result<(), InputError> {
        let disks = robot.module_count();
        for (i, load) in self.point_loads.iter().enumerate() {
            if let Some(arc_length) = load.arc_length {
                check_arc_length(robot, i, arc_length)?;
            } else if load.disk >= disks {
                let which = match load.disk {
                    usize::MAX => "a disk before the base".to_string(),
                    disk => format!("disk {}", disk + 1),
                };
                return Err(InputError::other(format!(
                    "point load {} acts on {which}, and the robot has {disks} disks",
                    i + 1
                )));
            }
            for v in [&load.point, &load.force, &load.moment] {
                InputError::check_finite(Argument::PointLoads, i, v)?;
            }
        }
        Ok(())
    }

    /// Checks that there are elements for all sections between two disks on which these loads and
    /// `others` act.
    pub fn check_sections(&self, robot: &Robot, others: &[PointLoad]) -> Result<(), InputError> {
        let (most, module) = self.most_sections(robot, others);
        if most < MOST_ELEMENTS {
            return Ok(());
        }
        let before = match module {
            0 => "the base".to_string(),
            k => format!("disk {k}"),
        };
        Err(InputError::other(format!(
            "{} act on {most} sections between {before} and disk {}; at most {} sections between \
             two disks can be loaded",
            self.named_beside(robot, most, "point loads"),
            module + 1,
            MOST_ELEMENTS - 1
        )))
    }

    /// Names these loads, and says where they have so many loaded sections in a module only with
    /// others.
    fn named_beside(&self, robot: &Robot, most: usize, name: &str) -> String {
        let own = self.most_sections(robot, &[]).0;
        match most > own {
            true => format!("{name} of this load and of the load before it"),
            false => name.to_string(),
        }
    }

    /// Largest number of loaded sections in a module, by these loads and `others`, and the module.
    fn most_sections(&self, robot: &Robot, others: &[PointLoad]) -> (usize, usize) {
        let sections = loaded_sections(robot, others.iter().chain(self.point_loads));
        let counts = sections.chunk_by(|a, b| a.0 == b.0);
        let counts = counts.map(|module| (module.len(), module[0].0));
        counts.max_by_key(|(count, _)| *count).unwrap_or((0, 0))
    }

    /// Whether it divides the modules of a robot at the same sections as other point loads.
    pub fn divides_as(&self, robot: &Robot, others: &[PointLoad]) -> bool {
        let mut both = others.iter().chain(self.point_loads);
        if both.all(|load| load.arc_length.is_none()) {
            return true; // without allocating
        }
        let own = loaded_sections(robot, self.point_loads);
        let others = loaded_sections(robot, others);
        own.len() == others.len()
            && own
                .iter()
                .zip(&others)
                .all(|(a, b)| a.0 == b.0 && same_section(a.1, b.1))
    }

    /// Whether any load may act between two disks.
    pub fn has_arc_lengths(&self) -> bool {
        self.point_loads
            .iter()
            .any(|load| load.arc_length.is_some())
    }

    /// The fewest elements in a module that take the load: the least power of two above the largest
    /// number of loaded sections in a module, hence 1 where no load acts between two disks. At most
    /// the largest number of elements that there is, also for a load that needs more and that
    /// [`Load::check`] refuses.
    pub fn least_elements(&self, robot: &Robot) -> usize {
        usize::min(self.least_elements_beside(robot, &[]), MOST_ELEMENTS)
    }

    /// The fewest elements in a module that take the load and other point loads, without a bound.
    pub fn least_elements_beside(&self, robot: &Robot, others: &[PointLoad]) -> usize {
        (self.most_sections(robot, others).0 + 1).next_power_of_two()
    }

    /// Checks that so many elements in a module take it.
    pub fn check_elements(&self, robot: &Robot, elements: usize) -> Result<(), InputError> {
        self.check_elements_beside(robot, elements, &[])
    }

    /// Checks that so many elements in a module take it and other point loads.
    pub fn check_elements_beside(
        &self,
        robot: &Robot,
        elements: usize,
        others: &[PointLoad],
    ) -> Result<(), InputError> {
        let least = self.least_elements_beside(robot, others);
        if elements >= least {
            return Ok(());
        }
        let what = match self.most_sections(robot, others).0 {
            1 => "a load between two disks needs".to_string(),
            most => {
                let loads = self.named_beside(robot, most, "loads");
                format!("{loads} on {most} sections between two disks need")
            }
        };
        Err(InputError::other(format!(
            "{what} {least} elements or more between them, and elements is {elements}"
        )))
    }
}

/// Sections of the backbone between two disks on which point loads act, each once: module and
/// fraction of its flexible part.
fn loaded_sections<'a>(
    robot: &Robot,
    loads: impl IntoIterator<Item = &'a PointLoad>,
) -> Vec<(usize, f64)> {
    let of = |arc_length: f64| match place(robot.lengths(), arc_length) {
        Place::Between { module, fraction } => Some((module, fraction)),
        _ => None,
    };
    let arc_lengths = loads.into_iter().filter_map(|load| load.arc_length);
    let mut sections: Vec<_> = arc_lengths.filter_map(of).collect();
    sections.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    sections.dedup_by(|b, a| a.0 == b.0 && same_section(a.1, b.1));
    sections
}

/// Most elements in a module.
const MOST_ELEMENTS: usize = LEVELS[LEVELS.len() - 1];

fn check_arc_length(robot: &Robot, i: usize, arc_length: f64) -> Result<(), InputError> {
    let (number, length) = (i + 1, robot.length());
    // a NaN is in no range
    if !(arc_length > 0.0 && arc_length <= length * (1.0 + AT_CLAMP)) {
        return Err(InputError::other(format!(
            "the arc length of point load {number} is {arc_length} m; it must be above 0 m and at \
             most {length} m, the length of the robot"
        )));
    }
    if let Place::Disk { disk, beyond } = place(robot.lengths(), arc_length) {
        let module = &robot.modules[disk];
        let before = -module.clamp[1];
        let after = robot.modules.get(disk + 1).map_or(0.0, |m| m.clamp[0]);
        let near = AT_CLAMP * module.flexible;
        if beyond.abs() > near && beyond > before + near && beyond < after - near {
            return Err(InputError::other(format!(
                "the arc length of point load {number} is {arc_length} m, where disk {} clamps the \
                 backbone; give the disk and a point instead",
                disk + 1
            )));
        }
    }
    Ok(())
}

/// Whether two fractions of a module belong to the same section.
pub fn same_section(a: f64, b: f64) -> bool {
    (a - b).abs() <= AT_CLAMP
}
