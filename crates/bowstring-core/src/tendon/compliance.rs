//! Routing of the tendons and their axial compliance.

use super::line::Line;
use crate::model::load::{Model, Theory};
use crate::model::robot::Robot;

/// Share of `scale` that every span stretches by before its holes slip: far below the stretch of
/// any tendon, enough to make the tensions of many sticking holes unique.
const CREEP: f64 = 1e-7;
/// Share of `scale` that regularises tensions which neither rod nor line determines: far below
/// what a tension changes, above rounding.
const RIDGE: f64 = 2e-10;

/// Where the tendons run.
#[derive(Clone, Default)]
pub(crate) struct Routing {
    pub modules: usize,
    /// Module that each tendon ends in.
    pub ends: Vec<usize>,
    /// From base hole to anchor in the straight robot, m.
    pub straight: Vec<f64>,
    /// Of the robot, m.
    pub length: f64,
}

/// Axial compliances, m/N.
#[derive(Clone, Default)]
pub(crate) struct Compliance {
    /// Own compliance of each span, by modules and tendons.
    pub stretch: Vec<f64>,
    /// The same as friction sees it: never zero, or else many holes that stick could carry any
    /// tension.
    pub creep: Vec<f64>,
    /// Of all before the base hole.
    pub before: Vec<f64>,
    /// Makes tensions unique where neither rod nor line does.
    pub ridge: Vec<f64>,
    /// Tendon displacement by tension of the straight robot, about.
    pub scale: f64,
}

impl Routing {
    pub fn new(robot: &Robot) -> Self {
        let (tendons, disks) = (&robot.spec().tendons, &robot.spec().disks);
        Routing {
            modules: robot.module_count(),
            ends: tendons.iter().map(|t| t.end_disk).collect(),
            straight: tendons.iter().map(|t| disks[t.end_disk].station).collect(),
            length: robot.length(),
        }
    }

    /// Whether the tendon of an entry by modules and tendons passes there.
    pub fn passes(&self, at: usize) -> bool {
        let m = self.ends.len();
        at / m <= self.ends[at % m]
    }
}

impl Compliance {
    pub fn new(robot: &Robot, model: Model, routing: &Routing, lines: &[Line]) -> Self {
        let (n, m) = (routing.modules, lines.len());
        let tendons = &robot.spec().tendons;
        let mut stretch = vec![0.0; n * m];
        let mut start = 0.0;
        for (k, disk) in robot.spec().disks.iter().enumerate() {
            for (i, line) in lines.iter().enumerate() {
                if routing.passes(k * m + i) {
                    stretch[k * m + i] = (disk.station - start) / line.stiffness;
                }
            }
            start = disk.station;
        }
        let of = |line: &Line| line.compliance + line.free_length / line.stiffness;
        let before: Vec<_> = lines.iter().map(of).collect();
        let radius = tendons.iter().map(|t| t.hole[0].hypot(t.hole[1]));
        let widest = radius.fold(0.0, f64::max);
        let scale = widest * widest / robot.moment_scale();
        let creep = |at: usize| match routing.passes(at) {
            true => stretch[at].max(CREEP * scale),
            false => 0.0,
        };
        let rigid = |i: usize| before[i] == 0.0 && lines[i].stiffness.is_infinite();
        // bending about two axes and extension tell three tendons apart
        let crowded = |i: usize| {
            let beside =
                || (0..m).filter(|&j| rigid(j) && tendons[j].end_disk == tendons[i].end_disk);
            beside().count() > 3 || beside().any(|j| j != i && tendons[j].hole == tendons[i].hole)
        };
        let ridge = |i: usize| match rigid(i) && (model.theory == Theory::Kirchhoff || crowded(i)) {
            true => RIDGE * scale,
            false => 0.0,
        };
        Compliance {
            creep: (0..n * m).map(creep).collect(),
            ridge: (0..m).map(ridge).collect(),
            stretch,
            before,
            scale,
        }
    }
}
