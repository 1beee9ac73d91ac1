//! Constant curvature of a whole robot: an arc for each segment, and the tip.
//!
//! Theory: docs/theory/constant-curvature.md.

use crate::arc::{signed_linear_law, tendon_load, Arc, Error, Hole, Pose, TendonFit};
use crate::arc_modules::{least_thrust, Modules};
use crate::math::linalg::{Mat3, Vec3};
use crate::model::error::InputError;
use crate::model::robot::{Robot, RobotSpec, Tendon};
use crate::statics::batch::for_each;

/// How the arcs follow from the commands of the tendons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Tendon lengths (m), tendons parallel to the backbone (theory Eq. 1.3).
    Lengths,
    /// As [`Law::Lengths`], for arcs that keep the lengths of the segments.
    HeldLengths,
    /// Tendon lengths (m), tendons straight between disks, clamped lengths straight (theory Eq. 1.5).
    Chords,
    /// Tensions (N), linear law (theory Eq. 1.7), with extension where tendons push.
    Linear,
    /// Tensions (N), mean lever arm of straight spans, clamped lengths straight (theory Eq. 1.10).
    LeverArm,
}

/// Most iterations to the spans of a backbone whose length is held.
const ROUNDS: usize = 100;
/// First estimate of the slope of a residual in them, that of spans which hardly depend on them.
const FIRST_SLOPE: f64 = -1.0;

/// Relative difference of bending flexibilities that is rounding.
const ALIKE: f64 = 1e-12;

/// The segments of a robot as constant curvature sees them.
pub struct RobotArcs {
    law: Law,
    segments: Vec<Segment>,
    tendons: usize,
}

/// Arc of a segment, in the frame of its start.
#[derive(Clone, Debug)]
pub struct SegmentArc {
    /// The arc; with bends of modules, their sum and the length of the backbone.
    pub arc: Arc,
    /// Residual of the fit to tendon lengths, root mean square (m).
    pub misfit: f64,
    /// Bend of each module (rad); none where the segment is one arc.
    pub bends: Vec<f64>,
}

struct Segment {
    length: f64,
    /// Mean bending flexibility about x and y, and their product (1/(N m^2)).
    flexibility: [f64; 3],
    /// Bend of the unloaded segment along x and y (rad).
    rest: [f64; 2],
    /// Stations of the disks from its start over its length.
    disks: Vec<f64>,
    /// Under a law of straight spans.
    modules: Option<Modules>,
    /// First tendon anchored to its end disk; it and all later ones pass the segment.
    first: usize,
    /// First tendon beyond those anchored to its end disk.
    next: usize,
    /// Strain by the sum of tensions (1/N); zero where none of the robot's tendons pushes, as then
    /// the segment keeps its length.
    extensibility: f64,
    /// Holes of the tendons from `first` on; under a law of tensions from the tension centre.
    holes: Vec<Hole>,
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
    /// Lays out the segments of a robot.
    pub fn new(robot: &Robot, law: Law) -> Self {
        let spec = robot.spec();
        let pushes = spec.tendons.iter().any(|tendon| tendon.pushes);
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
                Law::Lengths | Law::HeldLengths | Law::Chords => [0.0; 2],
            };
            let hole = |t| {
                let [x, y] = mean_hole(t, spec, &disks);
                [x - centre[0], y - centre[1]]
            };
            let holes: Vec<_> = tendons.map(hole).collect();
            let straight_spans = matches!(law, Law::Chords | Law::LeverArm);
            let modules = &robot.modules()[disks[0]..=last];
            let flexibility = profile.bending_flexibility();
            let rest = [rest[1], -rest[0]].map(|u| u * length);
            let own = &holes[..next - first];
            let soft = |hole| bend(flexibility, hole);
            let fit = TendonFit::of_backbone(own, law == Law::HeldLengths, soft, rest);
            let station = |&k: &usize| (spec.disks[k].station - start) / length;
            segments.push(Segment {
                length,
                flexibility,
                extensibility: match pushes {
                    true => profile.mean(0.0, 1.0, |s| 1.0 / s.axial),
                    false => 0.0,
                },
                rest,
                disks: disks.iter().map(station).collect(),
                modules: straight_spans.then(|| Modules::new(modules)),
                first,
                next,
                holes,
                fit,
            });
            start = end;
        }
        RobotArcs {
            law,
            segments,
            tendons: spec.tendons.len(),
        }
    }

    /// Number of segments.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// Number of tendons.
    pub fn tendon_count(&self) -> usize {
        self.tendons
    }

    /// Number of disks.
    pub fn disk_count(&self) -> usize {
        self.segments
            .iter()
            .map(|segment| segment.disks.len())
            .sum()
    }

    /// Number of modules that bend each by their own arc.
    pub fn bend_count(&self) -> usize {
        match self.law {
            Law::Chords | Law::LeverArm => self.disk_count(),
            Law::Lengths | Law::HeldLengths | Law::Linear => 0,
        }
    }

    /// Arcs of the segments with given bends of all modules (rad).
    pub fn with_bends(&self, arcs: &[Arc], bends: &[f64]) -> Vec<SegmentArc> {
        let mut start = 0;
        let segments = self.segments.iter().zip(arcs);
        segments
            .map(|(segment, &arc)| {
                let count = segment.modules.as_ref().map_or(0, |_| segment.disks.len());
                let bends = bends[start..start + count].to_vec();
                start += count;
                SegmentArc {
                    arc,
                    misfit: 0.0,
                    bends,
                }
            })
            .collect()
    }

    /// Length (m), bend without tensions (rad) and bend by each tension (rad/N) of each segment under
    /// the linear law.
    pub(crate) fn linear_bends(&self) -> Vec<(f64, [f64; 2], Vec<[f64; 2]>)> {
        let each = self.segments.iter().map(|segment| {
            let mut bends = vec![[0.0; 2]; self.tendons];
            for (bend, [x, y]) in bends[segment.first..].iter_mut().zip(&segment.holes) {
                *bend = self::bend(segment.flexibility, [x, y].map(|c| c * segment.length));
            }
            (segment.length, segment.rest, bends)
        });
        each.collect()
    }

    /// Position of the tip (m).
    ///
    /// # Errors
    /// As for [`RobotArcs::arcs`].
    pub fn tip(&self, commands: &[f64]) -> Result<[f64; 3], Error> {
        let arcs = self.arcs(commands)?;
        let mut frame = Frame::base();
        for piece in self.pieces(&arcs) {
            frame = frame.beyond(&piece);
        }
        Ok(frame.position.0)
    }

    /// The arc of each segment.
    ///
    /// # Errors
    /// If no arc has these tendon lengths, or the law has no equilibrium at these tensions.
    pub fn arcs(&self, commands: &[f64]) -> Result<Vec<SegmentArc>, Error> {
        let mut rest = commands.to_vec();
        let arcs = self.segments.iter().enumerate();
        arcs.map(|(i, segment)| named(i, segment.arc(self.law, &mut rest)))
            .collect()
    }

    /// Derivative of (bend x, bend y, length) of a segment with respect to the lengths that its own
    /// tendons have there, without correction.
    ///
    /// # Errors
    /// If tendon lengths do not determine its arc.
    pub fn fit_jacobian(&self, segment: usize) -> Result<[Vec<f64>; 3], Error> {
        let fit = self.segments[segment].fit.as_ref();
        named(segment, fit.map(TendonFit::jacobian).map_err(Clone::clone))
    }

    /// Given arcs of the segments with the bends of their modules.
    ///
    /// # Errors
    /// If a module bends by more than half a turn.
    pub fn of_arcs(&self, arcs: &[Arc]) -> Result<Vec<SegmentArc>, Error> {
        let segments = self.segments.iter().zip(arcs).enumerate();
        segments
            .map(|(i, (segment, &arc))| {
                let bends = named(i, segment.share(&arc))?;
                Ok(SegmentArc {
                    arc,
                    misfit: 0.0,
                    bends,
                })
            })
            .collect()
    }

    /// Tendon lengths (m) from the base to each tendon's end disk.
    ///
    /// # Errors
    /// If an arc bends tighter than a tendon's distance from the backbone.
    pub fn tendon_lengths(&self, arcs: &[SegmentArc]) -> Result<Vec<f64>, Error> {
        let mut lengths = vec![0.0; self.tendons];
        for (i, (segment, found)) in self.segments.iter().zip(arcs).enumerate() {
            for (length, hole) in lengths[segment.first..].iter_mut().zip(&segment.holes) {
                *length += named(i, segment.tendon_length(found, *hole))?;
            }
        }
        Ok(lengths)
    }

    /// Poses at arc lengths (m) from the base.
    pub fn poses(&self, arcs: &[SegmentArc], arc_lengths: &[f64]) -> Vec<Pose> {
        let (mut start, mut frame) = (0.0, Frame::base());
        let mut starts = Vec::new();
        for piece in self.pieces(arcs).filter(|piece| piece.length > 0.0) {
            starts.push((start, frame, piece));
            start += piece.length;
            frame = frame.beyond(&piece);
        }
        let at = |&s: &f64| {
            let (start, frame, piece) =
                starts[starts.partition_point(|piece| piece.0 < s).max(1) - 1];
            let share = ((s - start) / piece.length).clamp(0.0, 1.0);
            let part = Arc {
                bend: piece.bend.map(|c| c * share),
                length: share * piece.length,
            };
            let end = frame.beyond(&part);
            Pose {
                position: end.position.0,
                rotation: end.axes.0,
            }
        };
        arc_lengths.iter().map(at).collect()
    }

    /// Arc lengths (m) of the disks.
    pub fn disks(&self, arcs: &[SegmentArc]) -> Vec<f64> {
        let mut start = 0.0;
        let mut stations = Vec::new();
        for (segment, found) in self.segments.iter().zip(arcs) {
            match &segment.modules {
                None => stations.extend(segment.disks.iter().map(|s| start + s * found.arc.length)),
                Some(modules) => {
                    let mut station = start;
                    let pieces: Vec<_> = modules.pieces(&found.arc, &found.bends).collect();
                    stations.extend(pieces.chunks_exact(3).map(|module| {
                        station += module.iter().map(|piece| piece.length).sum::<f64>();
                        station
                    }));
                }
            }
            start += found.arc.length;
        }
        stations
    }

    /// The backbone as arcs in series.
    fn pieces<'a>(&'a self, arcs: &'a [SegmentArc]) -> impl Iterator<Item = Arc> + 'a {
        self.segments.iter().zip(arcs).flat_map(|(segment, found)| {
            let whole = segment.modules.is_none().then_some(found.arc);
            let pieces = segment.modules.iter();
            let pieces = pieces.flat_map(|modules| modules.pieces(&found.arc, &found.bends));
            whole.into_iter().chain(pieces)
        })
    }
}

/// Names the segment in an error.
fn named<T>(segment: usize, found: Result<T, Error>) -> Result<T, Error> {
    let text = |text| format!("segment {}: {text}", segment + 1);
    found.map_err(|error| match error {
        Error::Input(problem) => Error::Input(text(problem)),
        Error::NoSolution(problem) => Error::NoSolution(text(problem)),
    })
}

#[derive(Clone, Copy)]
struct Frame {
    position: Vec3,
    axes: Mat3<f64>,
}

impl Frame {
    fn base() -> Self {
        Frame {
            position: Vec3::zero(),
            axes: Mat3::identity(),
        }
    }

    /// Frame at the end of an arc that starts here.
    fn beyond(self, arc: &Arc) -> Self {
        let pose = arc.pose();
        Frame {
            position: self.position + self.axes * Vec3(pose.position),
            axes: match arc.bend {
                [0.0, 0.0] => self.axes,
                _ => self.axes * Mat3(pose.rotation),
            },
        }
    }
}

/// Bend (rad) by a moment's components times the length (N m^2), with the flexibility about x and y
/// and their product (1/(N m^2)).
fn bend([about_x, about_y, product]: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    // a bend towards x is a rotation about y
    [about_y * x - product * y, about_x * y - product * x]
}

impl Segment {
    /// Holes of the tendons anchored to its end disk.
    fn own(&self) -> &[Hole] {
        &self.holes[..self.next - self.first]
    }

    /// Bends of the modules of a given arc.
    fn share(&self, arc: &Arc) -> Result<Vec<f64>, Error> {
        let Some(modules) = &self.modules else {
            return Ok(Vec::new());
        };
        let (length, rigid) = (arc.length, modules.rigid());
        if length <= rigid {
            return Err(Error::Input(format!(
                "the arc is {length:.4} m long, and its clamped lengths alone {rigid:.4} m"
            )));
        }
        let bends = modules.of_total(arc.theta(), least_thrust(self.own(), arc.bend));
        let problem = "the arc bends a module by more than half a turn";
        bends.ok_or(Error::Input(problem.into()))
    }

    fn tendon_length(&self, found: &SegmentArc, hole: Hole) -> Result<f64, Error> {
        match &self.modules {
            None => found.arc.tendon_length(hole),
            Some(modules) => modules.tendon_length(&found.arc, &found.bends, hole),
        }
    }

    /// The arc; of tendon lengths, what the tendons beyond have used of theirs is taken away.
    fn arc(&self, law: Law, rest: &mut [f64]) -> Result<SegmentArc, Error> {
        let length = self.length;
        let one = |arc| SegmentArc {
            arc,
            misfit: 0.0,
            bends: Vec::new(),
        };
        match (law, &self.modules) {
            (Law::Linear, _) => {
                let mut arc = signed_linear_law(&rest[self.first..], &self.holes, length, 1.0)?;
                let [x, y] = bend(self.flexibility, arc.bend);
                arc.bend = [x + self.rest[0], y + self.rest[1]];
                let force: f64 = rest[self.first..].iter().sum();
                arc.length *= 1.0 - self.extensibility * force;
                if arc.length <= 0.0 {
                    return Err(Error::NoSolution(format!(
                        "a total tension of {force:?} N shortens it to nothing by the linear law; lower the tensions"
                    )));
                }
                Ok(one(arc))
            }
            (Law::LeverArm, Some(modules)) => self.lever_arm(modules, &rest[self.first..]),
            _ => self.fitted(rest),
        }
    }

    /// Arc by the law with the mean lever arm of straight spans.
    fn lever_arm(&self, modules: &Modules, tensions: &[f64]) -> Result<SegmentArc, Error> {
        let refuse = |text: &str| {
            Err(Error::Input(format!(
                "the lever-arm law is for a backbone {text}; use linear"
            )))
        };
        let [about_x, about_y, product] = self.flexibility;
        if self.rest != [0.0; 2] {
            return refuse("that is straight without load");
        }
        if product.hypot(about_x - about_y) > ALIKE * about_x {
            return refuse("with equal bending stiffness about all axes");
        }
        let (force, [x, y]) = tendon_load(tensions, &self.holes)?;
        let moment = x.hypot(y);
        let limit = modules.largest_thrust() / about_x;
        if force >= limit {
            return Err(Error::NoSolution(format!(
                "a total tension of {force:?} N is beyond the lever-arm law (limit {limit:.4} N, where a backbone without clamped lengths buckles between its disks); lower the tensions"
            )));
        }
        let bends = modules.under(moment * about_x, force * about_x);
        let theta: f64 = bends.iter().sum();
        let towards = match moment > 0.0 {
            true => [x / moment, y / moment],
            false => [0.0; 2],
        };
        let arc = Arc {
            bend: towards.map(|c| c * theta),
            length: self.length,
        };
        Ok(SegmentArc {
            arc,
            misfit: 0.0,
            bends,
        })
    }

    /// Arc and bends of modules from tendon lengths and the arc `parallel` that they have without
    /// correction.
    fn corrected(
        &self,
        modules: &Modules,
        fit: &TendonFit,
        lengths: &[f64],
        parallel: Arc,
    ) -> Result<(Arc, Vec<f64>), Error> {
        let found =
            |parallel: &Arc| modules.of_lengths(parallel, least_thrust(self.own(), parallel.bend));
        if fit.held(self.length).is_none() {
            return found(&parallel);
        }
        // The held length is that of the backbone, and the spans in its axis are shorter: their sum
        // by the secant method, as that which follows from another may change by more than the other.
        let mut axis = self.length;
        let mut known = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let (mut slope, mut before) = (FIRST_SLOPE, None);
        for _ in 0..ROUNDS {
            let tried = fit
                .fit(lengths, Some(axis))
                .and_then(|(arc, _)| found(&arc));
            let (mut arc, bends) = match tried {
                Ok(found) => found,
                // too far from a length that has an arc, as that of the straight robot has
                Err(_) if (axis - known).abs() > 1e-3 * self.length => {
                    axis = 0.5 * (axis + known);
                    continue;
                }
                Err(error) => return Err(error),
            };
            let change = modules.axis(&bends) - axis;
            if change.abs() <= 1e-15 * self.length {
                arc.length = self.length;
                return Ok((arc, bends));
            }
            if let Some((axis_before, change_before)) = before.replace((axis, change)) {
                let secant: f64 = (change - change_before) / (axis - axis_before);
                slope = if secant < 0.0 { secant } else { slope };
            }
            known = axis;
            axis -= change / slope;
        }
        Err(Error::NoSolution(
            "no arc of the backbone's length was found for these tendon lengths".into(),
        ))
    }

    /// Arc from tendon lengths.
    fn fitted(&self, rest: &mut [f64]) -> Result<SegmentArc, Error> {
        let own = self.next - self.first;
        if own == 0 && !self.holes.is_empty() {
            return Err(Error::Input(
                "no tendon ends at it, so tendon lengths do not determine its arc; use tensions, or make it one segment with the next one".into(),
            ));
        }
        let found = if own == 0 {
            // no tendon passes: as without load
            let arc = Arc {
                bend: self.rest,
                length: self.length,
            };
            SegmentArc {
                arc,
                misfit: 0.0,
                bends: self.share(&arc)?,
            }
        } else {
            let lengths = &rest[self.first..self.next];
            let spent = lengths.iter().position(|&l| l <= 0.0);
            if let Some(tendon) = spent.filter(|_| self.first > 0) {
                return Err(Error::Input(format!(
                    "tendon {} is shorter than the bent segments before it, so nothing is left of it for its own",
                    self.first + tendon + 1
                )));
            }
            let fit = self.fit.as_ref().map_err(Clone::clone)?;
            let held = fit.held(self.length);
            let (parallel, misfit) = fit.fit(lengths, held)?;
            let (arc, bends) = match &self.modules {
                None => (parallel, Vec::new()),
                Some(modules) => self.corrected(modules, fit, lengths, parallel)?,
            };
            fit.check(&arc)?;
            SegmentArc { arc, misfit, bends }
        };
        for (left, hole) in rest[self.next..].iter_mut().zip(&self.holes[own..]) {
            *left -= self.tendon_length(&found, *hole)?;
        }
        Ok(found)
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
            let arcs = RobotArcs::new(&robots[*i], law);
            let rows = commands[*i * each * arcs.tendons..].chunks_exact(arcs.tendons);
            for (tip, row) in tips.chunks_exact_mut(3).zip(rows) {
                if let Ok(found) = arcs.tip(row) {
                    tip.copy_from_slice(&found);
                }
            }
        },
    );
    Ok(out)
}
