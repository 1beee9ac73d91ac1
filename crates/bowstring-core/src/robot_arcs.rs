//! Constant curvature of a whole robot: an arc for each segment, and the tip.
//!
//! Theory: docs/theory/constant-curvature.md.

use crate::arc::{lever_arm_law, linear_law, Arc, Error, Hole, Spans, TendonFit};
use crate::math::linalg::{Mat3, Vec3};
use crate::model::error::InputError;
use crate::model::robot::{Robot, RobotSpec, Tendon};
use crate::statics::batch::for_each;

/// How the arcs follow from the commands of the tendons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Tendon lengths (m), tendons parallel to the backbone (theory Eq. 1.3).
    Lengths,
    /// Tendon lengths (m), tendons straight between disks (theory Eq. 1.5).
    Chords,
    /// Tensions (N), linear law (theory Eq. 1.7).
    Linear,
    /// Tensions (N), mean lever arm of straight spans.
    LeverArm,
}

/// Relative difference of bending flexibilities that is rounding.
const ALIKE: f64 = 1e-12;

/// The segments of a robot as constant curvature sees them.
pub struct RobotArcs {
    segments: Vec<Segment>,
    tendons: usize,
}

struct Segment {
    length: f64,
    /// Mean bending flexibility about x and y, and their product (1/(N m^2)).
    flexibility: [f64; 3],
    /// Bend of the unloaded segment along x and y (rad).
    rest: [f64; 2],
    modules: usize,
    /// First tendon anchored to its end disk; it and all later ones pass the segment.
    first: usize,
    /// First tendon beyond those anchored to its end disk.
    next: usize,
    /// Holes of the tendons from `first` on; under a law of tensions from the tension centre.
    holes: Vec<Hole>,
    spans: Spans,
    /// Fit to tendon lengths; an error if they do not determine an arc.
    fit: Result<TendonFit, Error>,
}

/// Mean of the hole along a segment, by which an arc of constant curvature shortens the tendon.
fn mean_hole(tendon: &Tendon, spec: &RobotSpec, disks: &[usize]) -> Hole {
    let mut sum = [0.0; 2];
    let mut start = match disks[0] {
        0 => 0.0,
        first => spec.disks[first - 1].station,
    };
    let from = start;
    for &k in disks {
        let station = spec.disks[k].station;
        let (a, b) = (tendon.hole(k), tendon.hole(k + 1));
        for q in 0..2 {
            sum[q] += 0.5 * (a[q] + b[q]) * (station - start);
        }
        start = station;
    }
    match tendon.holes.len() {
        1 => tendon.holes[0],
        _ => sum.map(|s| s / (start - from)),
    }
}

impl RobotArcs {
    /// # Errors
    /// If the chord correction is not defined.
    pub fn new(robot: &Robot, law: Law) -> Result<Self, Error> {
        let spec = robot.spec();
        let mut start = 0.0;
        let mut segments = Vec::with_capacity(spec.backbone.len());
        for (i, profile) in spec.backbone.iter().enumerate() {
            let rest = profile.sections()[0].rest_curvature;
            let disks: Vec<_> = (0..spec.disks.len())
                .filter(|&k| spec.disks[k].segment == i)
                .collect();
            let last = disks[disks.len() - 1];
            let end = spec.disks[last].station;
            let length = end - start;
            let first = spec.tendons.partition_point(|t| t.end_disk < disks[0]);
            let next = spec.tendons.partition_point(|t| t.end_disk <= last);
            let tendons = spec.tendons[first..].iter();
            // tensions bend by their moments about the tension centre
            let centre = match law {
                Law::Linear | Law::LeverArm => profile.tension_centre(),
                Law::Lengths | Law::Chords => [0.0; 2],
            };
            let hole = |t| {
                let [x, y] = mean_hole(t, spec, &disks);
                [x - centre[0], y - centre[1]]
            };
            let holes: Vec<_> = tendons.map(hole).collect();
            let spans = match law {
                Law::Chords => {
                    let mut before = start;
                    let share = |k: &usize| {
                        let share = (spec.disks[*k].station - before) / length;
                        before = spec.disks[*k].station;
                        share
                    };
                    Spans::straight(disks.iter().map(share).collect())?
                }
                _ => Spans::curved(),
            };
            let fit = TendonFit::new(&holes[..next - first], spans.clone(), false);
            segments.push(Segment {
                length,
                flexibility: profile.bending_flexibility(),
                rest: [rest[1], -rest[0]].map(|u| u * length),
                modules: disks.len(),
                first,
                next,
                holes,
                spans,
                fit,
            });
            start = end;
        }
        Ok(RobotArcs {
            segments,
            tendons: spec.tendons.len(),
        })
    }

    /// Length (m), bend without tensions (rad) and bend by each tension (rad/N) of each segment under
    /// the linear law.
    pub(crate) fn linear_bends(&self) -> Vec<(f64, [f64; 2], Vec<[f64; 2]>)> {
        let each = self.segments.iter().map(|segment| {
            let mut bends = vec![[0.0; 2]; self.tendons];
            for (bend, [x, y]) in bends[segment.first..].iter_mut().zip(&segment.holes) {
                *bend = segment.bend([x * segment.length, y * segment.length]);
            }
            (segment.length, segment.rest, bends)
        });
        each.collect()
    }

    /// Position of the tip (m).
    ///
    /// # Errors
    /// If no arc has these tendon lengths, or the law has no equilibrium at these tensions.
    pub fn tip(&self, law: Law, commands: &[f64]) -> Result<[f64; 3], Error> {
        let mut position = Vec3::zero();
        let mut frame = Mat3::<f64>::identity();
        let mut rest = commands.to_vec();
        for segment in &self.segments {
            let pose = segment.arc(law, &mut rest)?.pose();
            position += frame * Vec3(pose.position);
            frame = frame * Mat3(pose.rotation);
        }
        Ok(position.0)
    }

    /// The arc of each segment, in the frame of its start.
    ///
    /// # Errors
    /// As for [`RobotArcs::tip`].
    pub fn arcs(&self, law: Law, commands: &[f64]) -> Result<Vec<Arc>, Error> {
        let mut rest = commands.to_vec();
        let segments = self.segments.iter();
        segments
            .map(|segment| segment.arc(law, &mut rest))
            .collect()
    }
}

impl Segment {
    /// Bend (rad) by a moment's components times the length (N m^2).
    fn bend(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        // a bend towards x is a rotation about y
        let [about_x, about_y, product] = self.flexibility;
        [about_y * x - product * y, about_x * y - product * x]
    }

    /// The arc; of tendon lengths, what the tendons beyond have used of theirs is taken away.
    fn arc(&self, law: Law, rest: &mut [f64]) -> Result<Arc, Error> {
        let length = self.length;
        let [about_x, about_y, product] = self.flexibility;
        match law {
            Law::Linear => {
                let mut arc = linear_law(&rest[self.first..], &self.holes, length, 1.0)?;
                let [x, y] = self.bend(arc.bend);
                arc.bend = [x + self.rest[0], y + self.rest[1]];
                Ok(arc)
            }
            Law::LeverArm if self.rest != [0.0; 2] => Err(Error::NoSolution(
                "the lever-arm law is for a backbone that is straight without load".into(),
            )),
            Law::LeverArm if product.hypot(about_x - about_y) > ALIKE * about_x => Err(Error::NoSolution(
                "the lever-arm law is for a backbone with equal bending stiffness about all axes"
                    .into(),
            )),
            Law::LeverArm => {
                let (tensions, stiffness) = (&rest[self.first..], 1.0 / about_x);
                lever_arm_law(tensions, &self.holes, length, stiffness, self.modules)
            }
            // no tendon passes: as without load
            Law::Lengths | Law::Chords if self.holes.is_empty() => Ok(Arc {
                bend: self.rest,
                length,
            }),
            Law::Lengths | Law::Chords => {
                let fit = self.fit.as_ref().map_err(Clone::clone)?;
                let (arc, _) = fit.fit(&rest[self.first..self.next], None)?;
                let own = self.next - self.first;
                for (left, hole) in rest[self.next..].iter_mut().zip(&self.holes[own..]) {
                    *left -= arc.tendon_length(*hole, &self.spans)?;
                }
                Ok(arc)
            }
        }
    }
}

/// Tips by constant curvature (m), three numbers a row; NaN where there is no arc.
///
/// The rows of `commands` are those of the first robot, then those of the second, and so on, as
/// many for each.
///
/// # Errors
/// If the rows cannot be divided among the robots.
pub fn tips(
    robots: &[Robot],
    law: Law,
    commands: &[f64],
    threads: usize,
) -> Result<Vec<f64>, InputError> {
    let tendons = robots.first().map_or(1, Robot::tendon_count);
    let per_row = robots.len() * tendons;
    if per_row == 0 || !commands.len().is_multiple_of(per_row) {
        return Err(InputError::other(format!(
            "{} commands cannot be divided among {} robots with {tendons} tendons",
            commands.len(),
            robots.len()
        )));
    }
    let each = commands.len() / per_row;
    let mut out = vec![f64::NAN; 3 * each * robots.len()];
    if each == 0 {
        return Ok(out);
    }
    let mut parts: Vec<_> = out.chunks_mut(3 * each).enumerate().collect();
    for_each(
        &mut parts,
        threads,
        || (),
        |(), (i, tips)| {
            let Ok(arcs) = RobotArcs::new(&robots[*i], law) else {
                return;
            };
            let rows = commands[*i * each * arcs.tendons..].chunks_exact(arcs.tendons);
            for (tip, row) in tips.chunks_exact_mut(3).zip(rows) {
                if let Ok(found) = arcs.tip(law, row) {
                    tip.copy_from_slice(&found);
                }
            }
        },
    );
    Ok(out)
}
