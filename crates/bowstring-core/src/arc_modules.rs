//! Corrected constant curvature: the modules of one segment, each an arc of its own between rigid
//! clamped lengths, with tendons straight from disk to disk.
//!
//! Theory: docs/theory/constant-curvature.md (First and second correction).

use crate::arc::{input, root, Arc, Error, Hole};
use crate::model::robot::Module;
use std::f64::consts::PI;

/// Module of a segment in the plane of its bend.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Flexible length (m).
    flexible: f64,
    /// Rigid lengths at its start and end (m).
    clamp: [f64; 2],
    /// Clamped lengths less the lengths in holes (m).
    excess: f64,
    /// Length (m) by which a hole plane nearer to one disk than to the other lengthens the span.
    skew: f64,
}

/// Modules of a segment.
#[derive(Clone, Debug)]
pub(crate) struct Modules {
    parts: Vec<Part>,
    /// Length of a tendon in the holes (m).
    in_holes: f64,
}

/// Largest thrust over the moment, times the distance of a hole, that a controller would use.
const FAR: f64 = 4.0;

/// What a sum over modules adds up, of a module's bend: value and derivative.
type Measure = fn(f64) -> (f64, f64);

impl Part {
    fn new(module: &Module) -> Self {
        let beyond = |end: usize| module.clamp[end] - module.guides[end];
        let excess = beyond(0) + beyond(1);
        Part {
            flexible: module.flexible,
            clamp: module.clamp,
            excess,
            skew: (beyond(1) - beyond(0)).powi(2) / (2.0 * (module.flexible + excess)),
        }
    }

    /// Mean lever arm of the backbone's bow, per bend (m/rad): theory Eq. 1.10.
    fn bow(&self) -> f64 {
        self.flexible / 12.0 + self.excess / 4.0 - self.skew / 2.0
    }

    /// Bend (rad) under a moment and a thrust over the bending stiffness (1/m, 1/m^2): the positive
    /// root of theory Eq. 1.10, in the form without cancellation near the straight pose.
    fn bend(&self, moment: f64, thrust: f64) -> f64 {
        let linear = moment * self.flexible;
        let stiffness = 1.0 - thrust * self.flexible * self.bow();
        2.0 * linear / (stiffness + stiffness.hypot(linear / 2f64.sqrt()))
    }

    /// Straight span of a tendon in the backbone's axis (m): theory Eq. 1.5.
    fn span(&self, bend: f64, stretch: f64) -> f64 {
        let (sine, cosine) = (0.5 * bend).sin_cos();
        stretch * self.flexible * sinc(bend) + self.excess * cosine + self.skew * sine * sine
    }
}

/// sin(a/2)/(a/2)
fn sinc(a: f64) -> f64 {
    let half = 0.5 * a;
    if half.abs() < 1e-5 {
        1.0 - half * half / 6.0
    } else {
        half.sin() / half
    }
}

impl Modules {
    pub fn new<'a>(modules: impl IntoIterator<Item = &'a Module>) -> Self {
        let (parts, in_holes) = modules
            .into_iter()
            .map(|module| (Part::new(module), module.guides[0] + module.guides[1]))
            .unzip::<_, _, Vec<_>, Vec<_>>();
        Modules {
            parts,
            in_holes: in_holes.iter().sum(),
        }
    }

    fn flexible(&self) -> f64 {
        self.parts.iter().map(|part| part.flexible).sum()
    }

    pub fn rigid(&self) -> f64 {
        self.parts
            .iter()
            .map(|part| part.clamp[0] + part.clamp[1])
            .sum()
    }

    /// Thrust over the bending stiffness (1/m^2) at which the law of theory Eq. 1.10 ends.
    ///
    /// Without clamps it is Euler's load of a module, which is below that of a backbone held to an
    /// arc by the factor pi^2/12.
    pub fn largest_thrust(&self) -> f64 {
        let softest = self.parts.iter().map(|part| part.flexible * part.bow());
        PI * PI / 12.0 / softest.fold(0.0, f64::max)
    }

    /// Bends (rad) under a moment and a thrust over the bending stiffness (1/m, 1/m^2).
    pub fn under(&self, moment: f64, thrust: f64) -> Vec<f64> {
        let parts = self.parts.iter();
        parts.map(|part| part.bend(moment, thrust)).collect()
    }

    /// Bends (rad), none beyond half a turn, for which the sum of a measure is `target`; `thrust` is
    /// the thrust over the moment (1/m). They are in the proportion of theory Eq. 1.11, with the
    /// curvature of the softest module as the unknown.
    fn with_sum(&self, target: f64, thrust: f64, measure: Measure) -> Option<Vec<f64>> {
        let softening = |part: &Part| thrust * part.flexible * part.bow();
        let most = self.parts.iter().map(softening).fold(0.0, f64::max);
        let terms = || {
            let parts = self.parts.iter();
            parts.map(|part| (part.flexible, most - softening(part)))
        };
        let sum = |curvature: f64| {
            terms().fold((-target, 0.0), |(value, slope), (flexible, stiffer)| {
                let share = 1.0 / (1.0 + curvature * stiffer);
                let (v, d) = measure(curvature * flexible * share);
                (value + v, slope + d * flexible * share * share)
            })
        };
        let half_turn = terms()
            .map(|(flexible, stiffer)| flexible / PI - stiffer)
            .fold(0.0, f64::max);
        if sum(1.0 / half_turn).0 < 0.0 {
            return None;
        }
        let curvature = match target {
            0.0 => 0.0,
            _ => root(sum, 0.0, 1.0 / half_turn),
        };
        let bends =
            terms().map(|(flexible, stiffer)| curvature * flexible / (1.0 + curvature * stiffer));
        Some(bends.collect())
    }

    /// Bends (rad) that add up to `theta`.
    pub fn of_total(&self, theta: f64, thrust: f64) -> Option<Vec<f64>> {
        self.with_sum(theta, thrust, |bend| (bend, 1.0))
    }

    /// Arc and bends whose tendons have the lengths of those parallel to the arc `parallel`.
    pub fn of_lengths(&self, parallel: &Arc, thrust: f64) -> Result<(Arc, Vec<f64>), Error> {
        let chord = parallel.theta();
        let measure: Measure = |bend| (2.0 * (0.5 * bend).sin(), (0.5 * bend).cos());
        let Some(bends) = self.with_sum(chord, thrust, measure) else {
            return input(
                "no arc has these tendon lengths: straight spans would bend a module by more than half a turn".into(),
            );
        };
        let rigid = self.in_holes + self.spans(&bends, 0.0);
        let stretch = (parallel.length - rigid) / (self.spans(&bends, 1.0) + self.in_holes - rigid);
        if !(stretch > 0.0) {
            return input(format!(
                "no arc has these tendon lengths: clamped lengths and holes alone take {rigid:.4} m"
            ));
        }
        let theta: f64 = bends.iter().sum();
        let gain = if chord > 0.0 { theta / chord } else { 1.0 };
        let arc = Arc {
            bend: parallel.bend.map(|c| c * gain),
            length: self.rigid() + stretch * self.flexible(),
        };
        Ok((arc, bends))
    }

    /// Length (m) of a tendon in the axis of a backbone that keeps its length.
    pub fn axis(&self, bends: &[f64]) -> f64 {
        self.in_holes + self.spans(bends, 1.0)
    }

    /// Sum of the spans in the backbone's axis (m).
    fn spans(&self, bends: &[f64], stretch: f64) -> f64 {
        let spans = self.parts.iter().zip(bends);
        spans.map(|(part, &bend)| part.span(bend, stretch)).sum()
    }

    /// Length of the flexible parts over that without load.
    fn stretch(&self, arc: &Arc) -> f64 {
        (arc.length - self.rigid()) / self.flexible()
    }

    /// Length (m) of the tendon through `hole`: theory Eq. 1.5.
    pub fn tendon_length(&self, arc: &Arc, bends: &[f64], hole: Hole) -> Result<f64, Error> {
        let theta = arc.theta();
        let inwards = match theta > 0.0 {
            true => (arc.bend[0] * hole[0] + arc.bend[1] * hole[1]) / theta,
            false => 0.0,
        };
        let chords: f64 = bends.iter().map(|bend| 2.0 * (0.5 * bend).sin()).sum();
        let length = self.in_holes + self.spans(bends, self.stretch(arc)) - inwards * chords;
        if length > 0.0 {
            return Ok(length);
        }
        input(format!(
            "a tendon at ({:.4}, {:.4}) m would have the length {length:.4} m: the arc bends tighter than the tendon's distance from the backbone",
            hole[0], hole[1]
        ))
    }

    /// The backbone as arcs in series, three a module: clamp, flexible part, clamp.
    pub fn pieces<'a>(&'a self, arc: &Arc, bends: &'a [f64]) -> impl Iterator<Item = Arc> + 'a {
        let theta = arc.theta();
        let towards = match theta > 0.0 {
            true => arc.bend.map(|c| c / theta),
            false => [0.0; 2],
        };
        let stretch = self.stretch(arc);
        let rigid = |length| Arc {
            bend: [0.0; 2],
            length,
        };
        self.parts.iter().zip(bends).flat_map(move |(part, &bend)| {
            let flexible = Arc {
                bend: towards.map(|c| c * bend),
                length: stretch * part.flexible,
            };
            [rigid(part.clamp[0]), flexible, rigid(part.clamp[1])]
        })
    }
}

/// Least thrust over the moment (1/m) with which tendons through `holes` bend towards `bend`: that of
/// the two beside it, or of the one that lies farthest towards it. Tendons nearly opposite each other
/// bend across their line by tensions far too large.
pub(crate) fn least_thrust(holes: &[Hole], bend: [f64; 2]) -> f64 {
    let theta = bend[0].hypot(bend[1]);
    if theta == 0.0 {
        return 0.0;
    }
    let [x, y] = bend.map(|c| c / theta);
    let mut least = f64::INFINITY;
    for (i, a) in holes.iter().enumerate() {
        let towards = a[0] * x + a[1] * y;
        let beside = a[1] * x - a[0] * y;
        let size = a[0].hypot(a[1]);
        if towards > 0.0 && beside.abs() <= 1e-9 * size {
            least = least.min(1.0 / towards);
        }
        for b in &holes[..i] {
            // T_a a + T_b b = (x, y)
            let area = a[0] * b[1] - a[1] * b[0];
            let (t, u) = ((x * b[1] - y * b[0]) / area, (a[0] * y - a[1] * x) / area);
            if t >= 0.0 && u >= 0.0 && (t + u) * size.max(b[0].hypot(b[1])) <= FAR {
                least = least.min(t + u);
            }
        }
    }
    if least.is_finite() {
        return least;
    }
    let arms = holes.iter().map(|a| a[0] * x + a[1] * y);
    let arm = arms.fold(0.0, f64::max);
    let size = holes.iter().map(|a| a[0].hypot(a[1])).fold(0.0, f64::max);
    if arm * FAR > size {
        1.0 / arm
    } else {
        0.0
    }
}
