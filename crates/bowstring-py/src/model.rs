//! Model objects from Python: arrays of a robot, rod model, load, history.

use crate::input::{brief, input_error, refused, three, Rows};
use bowstring_core::memory;
use bowstring_core::model::load::RodModel as Settings;
use bowstring_core::model::load::{OwnedLoad, PointLoad, TendonPath, Theory};
use bowstring_core::model::robot::{Disk, Payload, Profile, Robot, RobotSpec, Section, Tendon};
use bowstring_core::robot_arcs::Law;
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::path::Line;
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};

/// A law of constant curvature by its name.
pub(crate) fn law_of(name: &str) -> PyResult<Law> {
    match name {
        "lengths" => Ok(Law::Lengths),
        "held" => Ok(Law::HeldLengths),
        "chords" => Ok(Law::Chords),
        "linear" => Ok(Law::Linear),
        "arm" => Ok(Law::LeverArm),
        _ => Err(refused(format!("law is {name}, it must be a law of arcs"))),
    }
}

/// How the rod is modelled; frozen, checked on construction.
///
/// Parameters
/// ----------
/// theory : {"cosserat", "kirchhoff"}
///     Backbone with or without shear and extension.
/// tendon_path : {"straight", "continuous"}
///     Tendons run straight between two disks, or along a curve parallel to the backbone (the
///     model of many published codes, for comparison; with given tensions and without friction).
/// twist : bool
///     Whether the backbone can twist.
/// elements : {1, 2, 4, 8}, optional
///     Fourth-order elements between two disks. By default statics choose the smallest number that
///     keeps the estimated error of the tip within 1e-5 of length and that of tensions within 1e-4
///     of the largest; motion and fits use one.
///
/// Raises
/// ------
/// InputError
///     If a value is not one of these.
///
/// Examples
/// --------
/// >>> import bowstring as bs
/// >>> bs.RodModel("kirchhoff", elements=2)
/// RodModel(theory='kirchhoff', tendon_path='straight', twist=True, elements=2)
#[pyclass(frozen, eq, hash, module = "bowstring._core")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct RodModel(pub Settings);

impl RodModel {
    /// Number of elements between two disks; one where it is not given.
    pub fn elements_or_one(&self) -> usize {
        self.0.elements.unwrap_or(1)
    }
}

const THEORIES: [(&str, Theory); 2] = [
    ("cosserat", Theory::Cosserat),
    ("kirchhoff", Theory::Kirchhoff),
];
const TENDON_PATHS: [(&str, TendonPath); 2] = [
    ("straight", TendonPath::Straight),
    ("continuous", TendonPath::Continuous),
];

/// Value of one of two words.
fn choice<T: Copy>(value: &Bound<'_, PyAny>, name: &str, words: [(&str, T); 2]) -> PyResult<T> {
    let given = value.extract::<String>().ok();
    let found = words
        .iter()
        .find(|(word, _)| given.as_deref() == Some(word));
    found.map(|(_, choice)| *choice).ok_or_else(|| {
        let [(first, _), (second, _)] = words;
        wrong(value, name, &format!("\"{first}\" or \"{second}\""))
    })
}

fn word<T: PartialEq>(choice: T, words: [(&'static str, T); 2]) -> &'static str {
    let [(first, of_first), (second, _)] = words;
    if choice == of_first {
        first
    } else {
        second
    }
}

fn wrong(value: &Bound<'_, PyAny>, name: &str, rule: &str) -> PyErr {
    refused(format!("{name} is {}, it must be {rule}", brief(value)))
}

#[pymethods]
impl RodModel {
    #[new]
    #[pyo3(signature = (theory=None, tendon_path=None, twist=None, elements=None),
        text_signature = "(theory='cosserat', tendon_path='straight', twist=True, elements=None)")]
    fn make(
        theory: Option<&Bound<'_, PyAny>>,
        tendon_path: Option<&Bound<'_, PyAny>>,
        twist: Option<&Bound<'_, PyAny>>,
        elements: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let mut settings = Settings::default();
        if let Some(value) = theory {
            settings.model.theory = choice(value, "theory", THEORIES)?;
        }
        if let Some(value) = tendon_path {
            settings.model.tendon = choice(value, "tendon_path", TENDON_PATHS)?;
        }
        if let Some(value) = twist {
            let twist = value.cast::<PyBool>();
            settings.model.twist = twist
                .map_err(|_| wrong(value, "twist", "True or False"))?
                .is_true();
        }
        if let Some(value) = elements {
            let whole = !value.is_instance_of::<PyBool>();
            settings.elements = match value.extract() {
                Ok(n @ (1 | 2 | 4 | 8)) if whole => Some(n),
                _ => return Err(wrong(value, "elements", "1, 2, 4 or 8")),
            };
        }
        Ok(RodModel(settings))
    }

    #[getter]
    fn theory(&self) -> &'static str {
        word(self.0.model.theory, THEORIES)
    }
    #[getter]
    fn tendon_path(&self) -> &'static str {
        word(self.0.model.tendon, TENDON_PATHS)
    }
    #[getter]
    fn twist(&self) -> bool {
        self.0.model.twist
    }
    #[getter]
    fn elements(&self) -> Option<usize> {
        self.0.elements
    }

    /// A copy with other values.
    #[pyo3(signature = (**changes))]
    fn replace<'py>(
        slf: &Bound<'py, Self>,
        changes: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let values = Self::to_dict(slf)?;
        if let Some(changes) = changes {
            values.update(changes.as_mapping())?;
        }
        slf.get_type().call((), Some(&values))
    }

    /// Its values by name.
    fn to_dict<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let (this, values) = (slf.get(), PyDict::new(slf.py()));
        values.set_item("theory", this.theory())?;
        values.set_item("tendon_path", this.tendon_path())?;
        values.set_item("twist", this.twist())?;
        values.set_item("elements", this.elements())?;
        Ok(values)
    }

    fn __repr__(&self) -> String {
        format!(
            "RodModel(theory='{}', tendon_path='{}', twist={}, elements={})",
            self.theory(),
            self.tendon_path(),
            if self.twist() { "True" } else { "False" },
            self.elements().map_or("None".into(), |n| n.to_string())
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let values = Self::to_dict(slf)?.values();
        Ok((slf.get_type().into_any(), values.to_tuple().into_any()))
    }
}

/// Loads beside the tendons, attributes of Python's `Load`: gravity (the robot's own if None),
/// force and moment at the tip and on each disk, numbers of point loads (see `point_loads`), and
/// force per length before each disk (zero if None).
#[derive(FromPyObject)]
pub struct DeadLoad<'py> {
    gravity: Option<Bound<'py, PyAny>>,
    tip_force: Option<Bound<'py, PyAny>>,
    tip_moment: Option<Bound<'py, PyAny>>,
    disk_forces: Option<Bound<'py, PyAny>>,
    disk_moments: Option<Bound<'py, PyAny>>,
    point_loads: Option<Bound<'py, PyAny>>,
    line_forces: Option<Bound<'py, PyAny>>,
}

impl DeadLoad<'_> {
    /// The load of a robot, with its tensions.
    pub fn with(&self, robot: &Robot, tensions: Vec<f64>) -> PyResult<OwnedLoad> {
        let zero = [0.0; 3];
        Ok(OwnedLoad {
            tensions,
            gravity: gravity(robot, self.gravity.as_ref())?,
            tip_force: three_or(self.tip_force.as_ref(), "tip_force", "N", zero)?,
            tip_moment: three_or(self.tip_moment.as_ref(), "tip_moment", "N m", zero)?,
            disk_forces: on_disks(robot, self.disk_forces.as_ref(), "disk_forces", "N", None)?,
            disk_moments: on_disks(
                robot,
                self.disk_moments.as_ref(),
                "disk_moments",
                "N m",
                None,
            )?,
            point_loads: given_points(robot, self.point_loads.as_ref())?,
            line_forces: line_forces(robot, self.line_forces.as_ref())?,
            ..OwnedLoad::default()
        })
    }
}

/// Numbers of a point load.
pub const POINT_LOAD: usize = 12;

/// Point loads of a robot with `disks` disks, from their numbers one after the other: disk, below
/// zero counted from the tip; point; force; moment; 1 for a follower; arc length, below zero for a
/// load on the disk. The core checks them.
pub fn point_loads(numbers: &[f64], disks: usize) -> Vec<PointLoad> {
    let load = |v: &[f64]| {
        let disk = if v[0] < 0.0 {
            v[0] + disks as f64
        } else {
            v[0]
        };
        let three = |at: usize| [v[at], v[at + 1], v[at + 2]];
        PointLoad {
            disk: if disk >= 0.0 {
                disk as usize
            } else {
                usize::MAX
            },
            arc_length: (v[11] >= 0.0 || v[11].is_nan()).then_some(v[11]),
            point: three(1),
            force: three(4),
            moment: three(7),
            follower: v[10] != 0.0,
        }
    };
    numbers.chunks_exact(POINT_LOAD).map(load).collect()
}

/// The numbers of [`point_loads`].
pub fn numbers_of_points(loads: &[PointLoad]) -> Vec<f64> {
    let numbers = |load: &PointLoad| {
        let place = [load.disk as f64].into_iter().chain(load.point);
        let wrench = load.force.into_iter().chain(load.moment);
        place.chain(wrench).chain([
            f64::from(u8::from(load.follower)),
            load.arc_length.unwrap_or(-1.0),
        ])
    };
    loads.iter().flat_map(numbers).collect()
}

fn given_points(robot: &Robot, given: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<PointLoad>> {
    let Some(given) = given else {
        return Ok(vec![]);
    };
    match given.extract::<PyReadonlyArray2<f64>>() {
        Ok(array) if array.shape()[1] == POINT_LOAD => {
            let numbers: Vec<f64> = array.as_array().iter().copied().collect();
            Ok(point_loads(&numbers, robot.module_count()))
        }
        _ => Err(refused(format!(
            "point_loads is {}, it must be a sequence of PointLoad",
            brief(given)
        ))),
    }
}

/// Forces per length before each disk: one for all, (3,), or (N, 3).
fn line_forces(robot: &Robot, given: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<[f64; 3]>> {
    let one = given.and_then(|given| given.extract::<PyReadonlyArray1<f64>>().ok());
    match one.as_ref().map(|v| v.as_array()) {
        Some(v) if v.len() == 3 => Ok(vec![[v[0], v[1], v[2]]; robot.module_count()]),
        _ => on_disks(robot, given, "line_forces", "N/m", None),
    }
}

/// Vectors on all disks, (N, 3), or on those of each of several rows, (n, N, 3); empty if None.
fn on_disks(
    robot: &Robot,
    given: Option<&Bound<'_, PyAny>>,
    name: &str,
    unit: &str,
    rows: Option<usize>,
) -> PyResult<Vec<[f64; 3]>> {
    let Some(given) = given else {
        return Ok(vec![]);
    };
    let n = robot.module_count();
    let each = match rows {
        Some(rows) => format!(" or ({rows}, {n}, 3)"),
        None => String::new(),
    };
    let rule = format!("({n}, 3){each}: one vector for each disk, in {unit}");
    let Ok(array) = given.extract::<PyReadonlyArrayDyn<f64>>() else {
        let value = brief(given);
        return Err(refused(format!(
            "{name} is {value}, it must be numbers of shape {rule}"
        )));
    };
    let shape = array.shape();
    if shape != [n, 3] && rows.is_none_or(|rows| shape != [rows, n, 3]) {
        let shape: Vec<_> = shape.iter().map(usize::to_string).collect();
        let comma = if shape.len() == 1 { "," } else { "" };
        return Err(refused(format!(
            "{name} has shape ({}{comma}), it must have {rule}",
            shape.join(", ")
        )));
    }
    let numbers: Vec<f64> = array.as_array().iter().copied().collect();
    Ok(vectors(&numbers))
}

/// Vectors from their numbers, one after the other.
pub fn vectors(numbers: &[f64]) -> Vec<[f64; 3]> {
    let vectors = numbers.chunks_exact(3);
    vectors.map(|v| [v[0], v[1], v[2]]).collect()
}

fn three_or(
    given: Option<&Bound<'_, PyAny>>,
    name: &str,
    unit: &str,
    otherwise: [f64; 3],
) -> PyResult<[f64; 3]> {
    given.map_or(Ok(otherwise), |value| three(value, name, unit))
}

/// Gravity as given, or the robot's own.
pub fn gravity(robot: &Robot, given: Option<&Bound<'_, PyAny>>) -> PyResult<[f64; 3]> {
    three_or(given, "gravity", "m/s^2", robot.spec().gravity)
}

/// Arrays of Python's `RobotDisks` for the mechanics, one entry for each disk.
#[derive(FromPyObject)]
struct Disks<'py> {
    station_m: PyReadonlyArray1<'py, f64>,
    clamped_length_m: PyReadonlyArray1<'py, f64>,
    mass_kg: PyReadonlyArray1<'py, f64>,
    inertia_kg_m2: PyReadonlyArray2<'py, f64>,
    hole_length_m: PyReadonlyArray1<'py, f64>,
    segment: PyReadonlyArray1<'py, i64>,
}

/// Arrays of Python's `RobotTendons` for the routing.
#[derive(FromPyObject)]
struct Tendons<'py> {
    holes_m: PyReadonlyArray3<'py, f64>,
    end_disk: PyReadonlyArray1<'py, i64>,
    pushes: PyReadonlyArray1<'py, bool>,
}

/// Arrays of Python's `Robot` for the mechanics.
#[derive(FromPyObject)]
pub struct RobotArrays<'py> {
    disks: Disks<'py>,
    tendons: Tendons<'py>,
    /// Sections of each segment, (S, 1, 11), or (S, 5, 11) with a taper; see `section`.
    sections: PyReadonlyArray3<'py, f64>,
    /// Full stiffness of the section of each segment, (S, 6, 6); NaN where it has none.
    section_stiffness: PyReadonlyArray3<'py, f64>,
    /// Disk, mass, centre and moments of inertia of each payload, (P, 8).
    payload_numbers: PyReadonlyArray2<'py, f64>,
    gravity: [f64; 3],
    /// Whether the tendons are embedded in the body.
    pub is_embedded: bool,
}

/// Numbers of a section.
const SECTION: usize = 11;

/// A section from its numbers: two bending stiffnesses, angle of the principal axes, torsional, axial
/// and shear stiffness, mass per length, rotary inertia, and rest curvature.
fn section(at: impl Fn(usize) -> f64) -> Section {
    Section {
        bending: [at(0), at(1)],
        principal_angle: at(2),
        torsion: at(3),
        axial: at(4),
        shear: at(5),
        mass_per_length: at(6),
        rotary_inertia: at(7),
        rest_curvature: [at(8), at(9), at(10)],
    }
}

/// Full stiffness of the section of each segment, where it has one.
fn stiffnesses(
    array: &PyReadonlyArray3<f64>,
    segments: usize,
) -> PyResult<Vec<Option<[[f64; 6]; 6]>>> {
    if array.shape() != [segments, 6, 6] {
        return Err(refused(format!(
            "section_stiffness has shape {:?}, it must have [{segments}, 6, 6]",
            array.shape()
        )));
    }
    let array = array.as_array();
    let matrix =
        |k: usize| [0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|j| array[[k, i, j]]));
    let given = |m: [[f64; 6]; 6]| (!m.as_flattened().iter().all(|x| x.is_nan())).then_some(m);
    Ok((0..segments).map(|k| given(matrix(k))).collect())
}

/// Sections along a segment: one, by its full stiffness if it has one, or five.
fn profile(
    count: usize,
    stiffness: Option<[[f64; 6]; 6]>,
    at: impl Fn(usize, usize) -> f64,
) -> Profile {
    let section = |i: usize| section(|q| at(i, q));
    if let Some(stiffness) = stiffness {
        let s = section(0);
        let rest = s.rest_curvature;
        return Profile::of_stiffness(stiffness, s.mass_per_length, s.rotary_inertia, rest);
    }
    match count {
        1 => section(0).into(),
        _ => Profile::Tapered(Box::new(std::array::from_fn(section))),
    }
}

/// A payload from its numbers: disk, mass, centre, and moments of inertia.
fn payload_of(at: impl Fn(usize) -> f64) -> Payload {
    Payload {
        disk: at(0) as usize,
        mass: at(1),
        centre: [at(2), at(3), at(4)],
        inertia: [at(5), at(6), at(7)],
    }
}

impl RobotArrays<'_> {
    fn payloads(&self) -> PyResult<Vec<Payload>> {
        let rows: Rows<8> = self.payload_numbers.extract()?;
        Ok(rows.iter().map(|v| payload_of(|q| v[q])).collect())
    }

    /// Description for the core, which checks it.
    pub fn spec(&self) -> PyResult<RobotSpec> {
        let (disks, tendons) = (&self.disks, &self.tendons);
        let n = disks.station_m.len();
        for (name, len, expected) in [
            ("clamped_length_m", disks.clamped_length_m.len(), n),
            ("mass_kg", disks.mass_kg.len(), n),
            ("hole_length_m", disks.hole_length_m.len(), n),
            ("segment", disks.segment.len(), n),
        ] {
            if len != expected {
                return Err(refused(format!(
                    "{name} has {len} entries, it must have {expected}"
                )));
            }
        }
        for (name, shape, rows) in [("inertia_kg_m2", disks.inertia_kg_m2.shape(), n)] {
            if shape != [rows, 2] {
                return Err(refused(format!(
                    "{name} has shape {shape:?}, it must have [{rows}, 2]"
                )));
            }
        }
        let (segments, places) = match self.sections.shape() {
            &[segments, places @ (1 | 5), SECTION] => (segments, places),
            shape => {
                return Err(refused(format!(
                    "sections has shape {shape:?}, it must have [S, 1, {SECTION}] or [S, 5, \
                     {SECTION}]"
                )))
            }
        };
        let sections = self.sections.as_array();
        let stiffness = stiffnesses(&self.section_stiffness, segments)?;
        let (shape, count) = (tendons.holes_m.shape(), tendons.end_disk.len());
        if ![[count, 1, 2], [count, n + 1, 2]]
            .iter()
            .any(|s| s == shape)
        {
            return Err(refused(format!(
                "holes_m has shape {shape:?}, it must have [{count}, 1, 2] or [{count}, {}, 2]",
                n + 1
            )));
        }
        // an index below zero becomes a huge one, which the core refuses
        let index = |i: &i64| usize::try_from(*i).unwrap_or(usize::MAX);
        let at = |array: &PyReadonlyArray1<f64>, i: usize| array.as_array()[i];
        let inertia = disks.inertia_kg_m2.as_array();
        let holes = tendons.holes_m.as_array();
        Ok(RobotSpec {
            payloads: self.payloads()?,
            backbone: (0..segments)
                .map(|i| profile(places, stiffness[i], |k, q| sections[[i, k, q]]))
                .collect(),
            disks: (0..n)
                .map(|i| Disk {
                    hole_length: at(&disks.hole_length_m, i),
                    station: at(&disks.station_m, i),
                    clamped_length: at(&disks.clamped_length_m, i),
                    mass: at(&disks.mass_kg, i),
                    inertia: [inertia[[i, 0]], inertia[[i, 1]]],
                    segment: index(&disks.segment.as_array()[i]),
                })
                .collect(),
            tendons: (0..tendons.end_disk.len())
                .map(|i| {
                    let end_disk = index(&tendons.end_disk.as_array()[i]);
                    let count = end_disk.saturating_add(2).min(holes.shape()[1]);
                    let hole = |k: usize| [holes[[i, k, 0]], holes[[i, k, 1]]];
                    Tendon {
                        pushes: tendons.pushes.as_array()[i],
                        ..Tendon::new((0..count).map(hole).collect(), end_disk)
                    }
                })
                .collect(),
            gravity: self.gravity,
        })
    }
}

/// Arrays of Python's `Designs`: robots that differ from one robot in these numbers, row by row.
#[derive(FromPyObject)]
pub struct DesignArrays<'py> {
    /// Numbers of the sections of each segment, (D, 11 S), or (D, 55 S) with a taper.
    sections: PyReadonlyArray2<'py, f64>,
    /// Full stiffness of the section of each segment of all robots, (S, 6, 6).
    section_stiffness: PyReadonlyArray3<'py, f64>,
    /// Station, clamped length and mass of each disk, its two moments of inertia, and the length of
    /// its holes, (D, 6 N).
    disks: PyReadonlyArray2<'py, f64>,
    /// x and y of the holes of each tendon, (D, 2 T), or of those in base and disks, (D, 2 T (N + 1)).
    holes: PyReadonlyArray2<'py, f64>,
    /// Numbers of the payloads, (D, 8 P).
    payloads: PyReadonlyArray2<'py, f64>,
    /// Axial stiffness, free length, compliance, friction and pretension of each tendon, (D, 5 T).
    lines: PyReadonlyArray2<'py, f64>,
}

impl DesignArrays<'_> {
    /// The robots for the core, which checks them; an error names the first invalid one.
    pub fn robots(&self, like: &Robot) -> PyResult<Vec<Robot>> {
        let spec = like.spec();
        let count = self.sections.shape()[0];
        for (name, shape, columns) in [
            ("disks", self.disks.shape(), 6 * spec.disks.len()),
            ("lines", self.lines.shape(), LINE * spec.tendons.len()),
            ("payloads", self.payloads.shape(), 8 * spec.payloads.len()),
        ] {
            if shape != [count, columns] {
                return Err(refused(format!(
                    "{name} has shape {shape:?}, it must have [{count}, {columns}]"
                )));
            }
        }
        let per_section = SECTION * spec.backbone.len();
        let places = self.sections.shape()[1] / per_section;
        if ![1, 5].contains(&places) || self.sections.shape()[1] % per_section != 0 {
            return Err(refused(format!(
                "sections has {} columns, it must have {per_section} or {}",
                self.sections.shape()[1],
                5 * per_section
            )));
        }
        // x and y of each tendon's hole: one for all disks, or those in base and disks
        let (per_hole, planes) = (2 * spec.tendons.len(), spec.disks.len() + 1);
        let shape = self.holes.shape();
        if ![[count, per_hole], [count, per_hole * planes]]
            .iter()
            .any(|s| s == shape)
        {
            return Err(refused(format!(
                "holes has shape {shape:?}, it must have [{count}, {per_hole}] or [{count}, {}]",
                per_hole * planes
            )));
        }
        let each = shape[1].checked_div(per_hole).unwrap_or(0);
        let sections = self.sections.as_array();
        let stiffness = stiffnesses(&self.section_stiffness, spec.backbone.len())?;
        let disks = self.disks.as_array();
        let holes = self.holes.as_array();
        let payloads = self.payloads.as_array();
        let robot = |i: usize| {
            let mut spec = spec.clone();
            for (k, own) in spec.backbone.iter_mut().enumerate() {
                *own = profile(places, stiffness[k], |p, q| {
                    sections[[i, SECTION * (places * k + p) + q]]
                });
            }
            for (k, disk) in spec.disks.iter_mut().enumerate() {
                let at = |q: usize| disks[[i, 6 * k + q]];
                *disk = Disk {
                    hole_length: at(5),
                    station: at(0),
                    clamped_length: at(1),
                    mass: at(2),
                    inertia: [at(3), at(4)],
                    segment: disk.segment,
                };
            }
            for (k, payload) in spec.payloads.iter_mut().enumerate() {
                *payload = payload_of(|q| payloads[[i, 8 * k + q]]);
            }
            for (k, tendon) in spec.tendons.iter_mut().enumerate() {
                let hole = |p: usize| [0, 1].map(|q| holes[[i, 2 * (each * k + p) + q]]);
                let count = each.min(tendon.end_disk + 2);
                *tendon = Tendon {
                    pushes: tendon.pushes,
                    ..Tendon::new((0..count).map(hole).collect(), tendon.end_disk)
                };
            }
            Robot::new(spec).map_err(|e| input_error(e.in_row(i)))
        };
        (0..count).map(robot).collect()
    }

    /// Lines of all tendons, by robots and tendons, after `robots`.
    pub fn lines(&self) -> Vec<Line> {
        lines_of(&self.lines)
    }
}

/// Numbers of a [`Line`].
const LINE: usize = 9;

/// Lines of tendons, whose numbers stand one after another.
pub fn lines_of(numbers: &PyReadonlyArray2<f64>) -> Vec<Line> {
    let numbers: Vec<f64> = numbers.as_array().iter().copied().collect();
    let line = |v: &[f64]| Line {
        stiffness: v[0],
        free_length: v[1],
        compliance: v[2],
        friction: v[3],
        pretension: v[4],
        backlash: v[5],
        wrap: v[6],
        hole_clearance: v[7],
        mount_compliance: v[8],
    };
    numbers.chunks_exact(LINE).map(line).collect()
}

/// Copies of the arrays: they cannot change while the interpreter lock is released.
pub(crate) struct OwnLoads {
    pub count: usize,
    tensions: Vec<f64>,
    gravity: Vec<f64>,
    tip_force: Vec<f64>,
    tip_moment: Vec<f64>,
    disks: usize,
    disk_forces: Vec<[f64; 3]>,
    disk_moments: Vec<[f64; 3]>,
    point_loads: Vec<PointLoad>,
    line_forces: Vec<[f64; 3]>,
}

impl OwnLoads {
    pub fn new(
        robot: &bowstring_core::model::robot::Robot,
        tensions: PyReadonlyArray2<f64>,
        load: &DeadLoad<'_>,
    ) -> PyResult<Self> {
        let (count, tendons) = (tensions.shape()[0], tensions.shape()[1]);
        if tendons != robot.tendon_count() {
            return Err(refused(format!(
                "tensions has shape ({count}, {tendons}), it must have one row for each load and {} columns, one for each tendon",
                robot.tendon_count()
            )));
        }
        let disks = robot.module_count();
        let size = |of: &Option<Bound<'_, PyAny>>| {
            let array = of.as_ref()?.cast::<PyUntypedArray>().ok()?;
            Some(array.len() as f64)
        };
        let all = [&load.disk_forces, &load.disk_moments];
        let of_disks: f64 = all.into_iter().filter_map(size).sum();
        let given = 8.0 * (count as f64 * (tendons as f64 + 9.0) + of_disks);
        memory::check(
            given,
            || format!("a copy of {count} loads"),
            "give fewer at a time",
        )
        .map_err(input_error)?;
        type Given<'a, 'py> = &'a Option<Bound<'py, PyAny>>;
        let rows = |value: Given, otherwise: [f64; 3], name: &str, unit: &str| {
            let Some(value) = value else {
                return Ok(otherwise.to_vec());
            };
            match value.extract::<PyReadonlyArray2<f64>>() {
                Ok(array) if array.shape() == [count, 3] => {
                    Ok(array.as_array().iter().copied().collect())
                }
                Ok(array) => Err(refused(format!(
                    "{name} has shape ({}, {}), it must be (3,) or ({count}, 3), in {unit}",
                    array.shape()[0],
                    array.shape()[1]
                ))),
                Err(_) => Ok(three(value, name, unit)?.to_vec()),
            }
        };
        let disk_rows = |value: Given, name: &str, unit: &str| {
            on_disks(robot, value.as_ref(), name, unit, Some(count))
        };
        Ok(OwnLoads {
            count,
            tensions: tensions.as_array().iter().copied().collect(),
            gravity: rows(&load.gravity, robot.spec().gravity, "gravity", "m/s^2")?,
            tip_force: rows(&load.tip_force, [0.0; 3], "tip_force", "N")?,
            tip_moment: rows(&load.tip_moment, [0.0; 3], "tip_moment", "N m")?,
            disks,
            disk_forces: disk_rows(&load.disk_forces, "disk_forces", "N")?,
            disk_moments: disk_rows(&load.disk_moments, "disk_moments", "N m")?,
            point_loads: given_points(robot, load.point_loads.as_ref())?,
            line_forces: line_forces(robot, load.line_forces.as_ref())?,
        })
    }

    pub fn borrow(&self) -> Loads<'_> {
        Loads {
            count: self.count,
            tensions: &self.tensions,
            gravity: &self.gravity,
            tip_force: &self.tip_force,
            tip_moment: &self.tip_moment,
            disks: self.disks,
            disk_forces: &self.disk_forces,
            disk_moments: &self.disk_moments,
            point_loads: &self.point_loads,
            line_forces: &self.line_forces,
        }
    }
}
