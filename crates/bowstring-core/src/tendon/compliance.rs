//! Routing of the tendons and their axial compliance.
//!
//! Theory: docs/theory/actuation.md (Elastic tendons, Eq. 4.3).

use super::line::Line;
use crate::model::load::{Model, Theory};
use crate::model::robot::{Robot, Tendon};

/// Least compliance of a span with friction, over `scale`: far below that of any tendon, but enough
/// to make the tensions of several sticking holes unique.
const LEAST_COMPLIANCE: f64 = 1e-7;
/// Regularisation, over `scale`, of tensions that neither rod nor line determines: far below the
/// effect of a tension, above rounding.
const REGULARISATION: f64 = 2e-10;

/// Routing of the tendons.
#[derive(Clone, Default)]
pub(crate) struct Routing {
    pub modules: usize,
    /// Module in which each tendon ends.
    pub ends: Vec<usize>,
    /// Least tension of each tendon (N), at which it is slack; -infinity where it pushes too.
    pub least: Vec<f64>,
    /// Length of each tendon from base hole to anchor in the straight robot (m).
    pub straight: Vec<f64>,
    /// Length of the robot (m).
    pub length: f64,
}

/// Axial compliances (m/N).
#[derive(Clone, Default)]
pub(crate) struct Compliance {
    /// Compliance of each span (L/EA of theory Eq. 4.3), by modules and tendons.
    pub spans: Vec<f64>,
    /// Compliance of each span in the equations of friction: never zero, because otherwise several
    /// sticking holes could share a tension in more than one way.
    pub friction_spans: Vec<f64>,
    /// Compliance of transmission and free length before the base hole (c + F/EA of
    /// theory Eq. 4.3).
    pub before: Vec<f64>,
    /// Regularisation that makes tensions unique where neither rod nor line does.
    pub regularisation: Vec<f64>,
    /// Approximate derivative of tendon displacement with respect to tension in the straight robot.
    pub scale: f64,
}

impl Routing {
    pub fn new(robot: &Robot) -> Self {
        let (tendons, disks) = (&robot.spec().tendons, &robot.spec().disks);
        Routing {
            modules: robot.module_count(),
            ends: tendons.iter().map(|t| t.end_disk).collect(),
            least: tendons.iter().map(Tendon::least_tension).collect(),
            straight: tendons.iter().map(|t| disks[t.end_disk].station).collect(),
            length: robot.length(),
        }
    }

    /// Whether the tendon of an entry (by modules and tendons) passes that module.
    pub fn passes(&self, at: usize) -> bool {
        let m = self.ends.len();
        at / m <= self.ends[at % m]
    }
}

impl Compliance {
    pub fn new(robot: &Robot, model: Model, routing: &Routing, lines: &[Line]) -> Self {
        let (n, m) = (routing.modules, lines.len());
        let tendons = &robot.spec().tendons;
        let mut spans = vec![0.0; n * m];
        let mut start = 0.0;
        for (k, disk) in robot.spec().disks.iter().enumerate() {
            for (i, line) in lines.iter().enumerate() {
                if routing.passes(k * m + i) {
                    let [x, y] = [0, 1].map(|q| tendons[i].hole(k + 1)[q] - tendons[i].hole(k)[q]);
                    let length = (disk.station - start).hypot(x.hypot(y));
                    spans[k * m + i] = length / line.stiffness;
                }
            }
            start = disk.station;
        }
        let of = |line: &Line| line.compliance + line.free_length / line.stiffness;
        let before: Vec<_> = lines.iter().map(of).collect();
        let holes = tendons.iter().flat_map(|t| &t.holes);
        let radius = holes.map(|hole| hole[0].hypot(hole[1]));
        let widest = radius.fold(0.0, f64::max);
        let scale = widest * widest / robot.moment_scale();
        let friction_spans = |at: usize| match routing.passes(at) {
            true => spans[at].max(LEAST_COMPLIANCE * scale),
            false => 0.0,
        };
        let rigid = |i: usize| before[i] == 0.0 && lines[i].stiffness.is_infinite();
        // bending about two axes and extension distinguish three tendons
        let crowded = |i: usize| {
            let beside =
                || (0..m).filter(|&j| rigid(j) && tendons[j].end_disk == tendons[i].end_disk);
            beside().count() > 3 || beside().any(|j| j != i && tendons[j].holes == tendons[i].holes)
        };
        let regularisation =
            |i: usize| match rigid(i) && (model.theory == Theory::Kirchhoff || crowded(i)) {
                true => REGULARISATION * scale,
                false => 0.0,
            };
        Compliance {
            friction_spans: (0..n * m).map(friction_spans).collect(),
            regularisation: (0..m).map(regularisation).collect(),
            spans,
            before,
            scale,
        }
    }
}
