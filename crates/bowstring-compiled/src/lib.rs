//! Reader of compiled robots: files of `bowstring export`.
//!
//! The layout is that of `bowstring.cli.schemas.compiled`: numbers in SI, as the core takes them.

#![warn(missing_docs)]
// units end the names, as in the outputs of the package: N is newton
#![allow(non_snake_case)]

use bowstring_core::model::load::TendonPath;
use bowstring_core::model::robot::{
    Disk, Payload, Profile, Robot, RobotSpec, Section, Tendon as Route,
};
use serde::Deserialize;

/// Value of `format`.
const FORMAT: &str = "bowstring compiled robot";
/// Version of the layout that this library reads.
const VERSION: u32 = 1;
/// Largest number of a tendon, in SI: products of such numbers do not overflow.
const MOST: f64 = 1e30;
/// Characters of what the JSON reader says, which repeats text of the file.
const LONGEST: usize = 200;

/// What is read first: another version may have another layout.
#[derive(Deserialize)]
struct Head {
    format: String,
    format_version: u32,
}

#[derive(Deserialize)]
struct Content {
    tendon_path: Path,
    segments: Vec<Segment>,
    disks: Vec<DiskRow>,
    tendons: Vec<Tendon>,
    payloads: Vec<PayloadRow>,
    gravity_m_per_s2: [f64; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Path {
    Straight,
    /// Earlier versions wrote the path of a body's tendons as "continuous".
    #[serde(alias = "continuous")]
    Embedded,
}

#[derive(Deserialize)]
struct Segment {
    sections: Vec<[f64; 11]>,
    stiffness: Option<[[f64; 6]; 6]>,
}

#[derive(Deserialize)]
struct DiskRow {
    station_m: f64,
    clamped_length_m: f64,
    hole_length_m: f64,
    mass_kg: f64,
    inertia_kg_m2: [f64; 2],
    segment: usize,
}

#[derive(Deserialize)]
struct Tendon {
    holes_m: Vec<[f64; 2]>,
    end_disk: usize,
    compliance_m_per_N: f64,
    pretension_N: f64,
    max_tension_N: f64,
}

#[derive(Deserialize)]
struct PayloadRow {
    disk: usize,
    mass_kg: f64,
    centre_m: [f64; 3],
    inertia_kg_m2: [f64; 3],
}

/// A robot and what belongs to its tendons, one of each for each tendon.
pub struct Compiled {
    /// The robot as the core takes it.
    pub robot: Robot,
    /// How tendons run between the disks.
    pub path: TendonPath,
    /// Compliance from motor to end disk (m/N).
    pub compliance: Vec<f64>,
    /// Tension in the home pose (N).
    pub pretension: Vec<f64>,
    /// Default of the largest tension (N).
    pub max_tension: Vec<f64>,
}

/// Reads the text of a file.
///
/// # Errors
/// A sentence that says what is wrong.
pub fn read(text: &[u8]) -> Result<Compiled, String> {
    let remedy = "write it with `bowstring export ROBOT --out robot.json`";
    let unread = |error| format!("no compiled robot: {}; {remedy}", sentence(&error));
    let head: Head = serde_json::from_slice(text).map_err(unread)?;
    if head.format != FORMAT {
        return Err(format!(
            "no compiled robot: its format is {:?}; {remedy}",
            head.format.chars().take(40).collect::<String>()
        ));
    }
    if head.format_version != VERSION {
        return Err(format!(
            "the compiled robot has format version {}, and this library reads version {VERSION}; \
             compile it with the version of Bowstring of the library",
            head.format_version
        ));
    }
    let content: Content = serde_json::from_slice(text).map_err(unread)?;
    for (i, tendon) in content.tendons.iter().enumerate() {
        for (name, value) in [
            ("compliance_m_per_N", tendon.compliance_m_per_N),
            ("pretension_N", tendon.pretension_N),
            ("max_tension_N", tendon.max_tension_N),
        ] {
            if !(0.0..=MOST).contains(&value) {
                return Err(format!(
                    "{name} of tendon {} is {value:?}; it must be from 0 to {MOST:?}",
                    i + 1
                ));
            }
        }
        if tendon.holes_m.is_empty() {
            return Err(format!("tendon {} has no holes", i + 1));
        }
    }
    let per_tendon = |of: fn(&Tendon) -> f64| content.tendons.iter().map(of).collect();
    let (compliance, pretension) = (
        per_tendon(|t| t.compliance_m_per_N),
        per_tendon(|t| t.pretension_N),
    );
    let max_tension = per_tendon(|t| t.max_tension_N);
    let path = match content.tendon_path {
        Path::Straight => TendonPath::Straight,
        Path::Embedded => TendonPath::Embedded,
    };
    let robot = Robot::new(spec(content)?).map_err(|error| error.to_string())?;
    Ok(Compiled {
        robot,
        path,
        compliance,
        pretension,
        max_tension,
    })
}

/// What the JSON reader says, in one line of limited length.
fn sentence(error: &serde_json::Error) -> String {
    let said = error.to_string();
    let line = said.chars().map(|c| if c.is_control() { ' ' } else { c });
    if said.chars().count() <= LONGEST {
        return line.collect();
    }
    let (row, column) = (error.line(), error.column());
    let part: String = line.take(LONGEST).collect();
    format!("{part}... at line {row} column {column}")
}

fn spec(content: Content) -> Result<RobotSpec, String> {
    let segments = content.segments.into_iter().enumerate();
    let backbone: Result<Vec<_>, _> = segments.map(|(k, segment)| profile(k, segment)).collect();
    let disk = |d: DiskRow| Disk {
        station: d.station_m,
        clamped_length: d.clamped_length_m,
        hole_length: d.hole_length_m,
        mass: d.mass_kg,
        inertia: d.inertia_kg_m2,
        segment: d.segment,
    };
    let payload = |p: PayloadRow| Payload {
        disk: p.disk,
        mass: p.mass_kg,
        centre: p.centre_m,
        inertia: p.inertia_kg_m2,
    };
    let tendons = content.tendons.into_iter();
    Ok(RobotSpec {
        backbone: backbone?,
        disks: content.disks.into_iter().map(disk).collect(),
        tendons: tendons.map(|t| Route::new(t.holes_m, t.end_disk)).collect(),
        payloads: content.payloads.into_iter().map(payload).collect(),
        gravity: content.gravity_m_per_s2,
    })
}

fn profile(segment: usize, given: Segment) -> Result<Profile, String> {
    let section = |v: &[f64; 11]| Section {
        bending: [v[0], v[1]],
        principal_angle: v[2],
        torsion: v[3],
        axial: v[4],
        shear: v[5],
        mass_per_length: v[6],
        rotary_inertia: v[7],
        rest_curvature: [v[8], v[9], v[10]],
    };
    match (given.sections.as_slice(), given.stiffness) {
        ([one], None) => Ok(section(one).into()),
        ([one, ..], Some(stiffness)) => {
            let s = section(one);
            let (mass, inertia) = (s.mass_per_length, s.rotary_inertia);
            Ok(Profile::of_stiffness(
                stiffness,
                mass,
                inertia,
                s.rest_curvature,
            ))
        }
        ([a, b, c, d, e], None) => Ok(Profile::Tapered(Box::new([a, b, c, d, e].map(section)))),
        (sections, _) => Err(format!(
            "segment {} has {} sections, it must have 1 or 5",
            segment + 1,
            sections.len()
        )),
    }
}
