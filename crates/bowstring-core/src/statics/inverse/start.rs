//! Starts: constant-curvature arcs, and the least tensions that bend the segments to them.

use super::descent::FIRST_WEIGHT;
use super::step::Linear;
use super::task::Task;
use super::InverseSolver;
use crate::math::bounded::Problem;
use crate::model::load::LEVELS;

/// Largest rotation of the arc of the first start (rad).
const LARGEST_BEND: f64 = 4.5;
/// Range of the bend of a segment in the further starts (rad).
const FURTHER_BENDS: [f64; 2] = [0.4, 2.0];

/// Number of the start from the straight robot.
const STRAIGHT: usize = 1;

impl InverseSolver {
    /// A start, with its equilibrium from the straight backbone; false if it has none.
    pub(super) fn start(&mut self, task: &Task, number: usize) -> bool {
        self.linearised = false;
        self.curvature.clear();
        let load = self.load.borrow();
        let level = self.first_level(&load);
        let Ok(level) = self.at(LEVELS[level]) else {
            return false;
        };
        self.point.level = level;
        self.start_tensions(task, number);
        // one segment makes the first arc itself
        let segments = self.robot.spec().backbone.len();
        if number != STRAIGHT && segments > 1 {
            self.start_by_arcs(task);
        }
        self.load.tensions.clear();
        let unit = self.unit;
        self.load
            .tensions
            .extend(self.point.tensions.iter().map(|t| t * unit));
        let load = std::mem::take(&mut self.load);
        let found = self.level().solver.solve(&load.borrow());
        self.load = load;
        let Ok(found) = found else { return false };
        if !self.measure(task) {
            return false;
        }
        self.point.outcome = found;
        self.keep_strain();
        true
    }

    /// Least tensions within the limits whose moments bend each segment to an arc by the linear
    /// law.
    pub(super) fn start_tensions(&mut self, task: &Task, number: usize) {
        let tendons = self.robot.tendon_count();
        let spec = self.robot.spec();
        let segments = spec.backbone.len();
        let [x, y, z] = task.target.position;
        let (distance, phi) = (x.hypot(y), y.atan2(x));
        // the chord of an arc makes half the bend with the tangent at the base
        let bend = (2.0 * distance.atan2(z)).min(LARGEST_BEND);
        let Linear {
            solver,
            a,
            b,
            centre,
            lower,
            upper,
        } = &mut self.linear;
        let (rows, sharp) = (2 * segments, 1.0 / FIRST_WEIGHT);
        a.clear();
        a.resize(rows * tendons, 0.0);
        b.clear();
        let mut from = 0.0;
        for s in 0..segments {
            let last = spec.disks.iter().rposition(|d| d.segment == s);
            let first = spec.disks.iter().position(|d| d.segment == s);
            let (Some(first), Some(last)) = (first, last) else {
                b.extend([0.0; 2]);
                continue;
            };
            let length = spec.disks[last].station - from;
            from = spec.disks[last].station;
            let stiffness = self.robot.section(first, 0.5).bending;
            let stiffness = 0.5 * (stiffness[0] + stiffness[1]);
            let (theta, phi) = match number {
                0 => (bend * length / self.length, phi),
                STRAIGHT => (0.0, 0.0),
                _ => {
                    // quasi-random directions, opposite from segment to segment
                    let turn = 0.618_033_988_749_895 * number as f64 + 0.414_213_562 * s as f64;
                    let flip = if (number + s).is_multiple_of(2) {
                        0.0
                    } else {
                        0.5
                    };
                    let at = phi + std::f64::consts::TAU * (turn + flip).fract();
                    let [least, most] = FURTHER_BENDS;
                    let size = (0.754_877_666 * number as f64 + 0.569_840_29 * s as f64).fract();
                    (least + (most - least) * size, at)
                }
            };
            let moment = stiffness * theta / length / self.unit;
            for (i, tendon) in spec.tendons.iter().enumerate() {
                if tendon.end_disk >= last {
                    let hole = tendon.hole(first + 1);
                    for q in 0..2 {
                        a[i * rows + 2 * s + q] = sharp * hole[q] / self.length;
                    }
                }
            }
            let m = sharp * moment / self.length;
            b.extend([m * phi.cos(), m * phi.sin()]);
        }
        centre.clear();
        centre.resize(tendons, 0.0);
        lower.clear();
        lower.extend_from_slice(&task.lower);
        upper.clear();
        upper.extend_from_slice(&task.upper);
        let problem = Problem {
            a,
            b,
            root: &[],
            centre,
            lower,
            upper,
        };
        self.point.tensions.fill(0.0);
        solver.solve(&problem, &mut self.point.tensions);
    }
}
