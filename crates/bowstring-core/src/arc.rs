//! Constant curvature: a segment's backbone as one circular arc (Amouri 2019, section 3).
//!
//! Theory: docs/theory/constant-curvature.md.
//!
//! Two maps in both directions, with their derivatives: actuation space (tendon lengths or tensions) to
//! configuration space (the arc), and configuration space to task space (the tip's pose).
//!
//! Frames and signs: the base frame has z along the straight backbone; a tendon's *hole* has the
//! same position (x, y) = r (cos alpha, sin alpha) in every disk; the arc bends towards phi,
//! counted from x towards y; a tendon on the inside of the bend is shorter. SI units and radians.
//!
//! An arc is stored as its *bend vector* (theta cos phi, theta sin phi) and its length. All maps
//! are smooth in these, at the straight pose too; curvature and direction are derived from them.

use crate::math::linalg::dot;
use crate::math::series::stumpff;
use std::f64::consts::TAU;
use std::fmt;

/// Why an arc could not be computed; the text is one sentence.
#[derive(Debug, Clone, PartialEq)]
pub enum Error {
    /// The input is invalid, or no arc is consistent with it.
    Input(String),
    /// The input is valid, but the law has no equilibrium there.
    NoSolution(String),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Input(text) | Error::NoSolution(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for Error {}

pub(crate) fn input<T>(text: String) -> Result<T, Error> {
    Err(Error::Input(text))
}

fn positive(what: impl fmt::Display, value: f64, unit: &str) -> Result<(), Error> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    input(format!(
        "{what} must be positive and finite, got {value:?} {unit}"
    ))
}

/// Checks that an angle is finite and its square does not overflow.
fn angle(theta: f64) -> Result<(), Error> {
    if theta.abs() <= 1e6 {
        return Ok(());
    }
    input(format!(
        "the bend angle must be below 1e6 rad, got {theta:?} rad; check the units"
    ))
}

fn finite(what: &str, values: &[f64], unit: &str) -> Result<(), Error> {
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(value) => input(format!("{what} must be finite, got {value:?} {unit}")),
    }
}

fn one_a_hole(what: &str, values: &[f64], holes: &[Hole]) -> Result<(), Error> {
    let (given, needed) = (values.len(), holes.len());
    if given == needed {
        return Ok(());
    }
    input(format!(
        "{needed} {what} are needed, one a hole, got {given}"
    ))
}

/// Hole position (x, y) of a tendon in every disk, disk axes (m).
pub type Hole = [f64; 2];

/// Position (m) and rotation (body to base) in the frame at the arc's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position (m).
    pub position: [f64; 3],
    /// Rotation from body to base, row by row.
    pub rotation: [[f64; 3]; 3],
}

/// A circular arc that starts at the origin along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Bend vector theta cos(phi), theta sin(phi) (rad); theta is the bend angle from base to tip.
    pub bend: [f64; 2],
    /// Length along the backbone (m).
    pub length: f64,
}

/// Smooth functions of x = theta^2 in all arc formulas (theory Eq. 1.2: a = f, b = g).
struct Smooth {
    /// sin(theta)/theta
    a: f64,
    /// (1 - cos(theta))/theta^2
    b: f64,
    /// a'/theta
    da: f64,
    /// b'/theta
    db: f64,
    /// (theta - sin(theta))/theta^3
    e: f64,
}

impl Smooth {
    fn at(theta: f64) -> Self {
        let [_, a, b, c, d, ..] = stumpff(theta * theta);
        Smooth {
            a,
            b,
            da: c - b,
            db: 2.0 * d - c,
            e: c,
        }
    }
}

impl Arc {
    /// Arc of curvature `kappa` (1/m), direction `phi` (rad) and length (m). A negative curvature
    /// bends towards phi + pi.
    pub fn from_curvature(kappa: f64, phi: f64, length: f64) -> Result<Self, Error> {
        finite("the curvature", &[kappa], "1/m")?;
        finite("the direction of bending", &[phi], "rad")?;
        positive("the arc's length", length, "m")?;
        let theta = kappa * length;
        angle(theta)?;
        Ok(Arc {
            bend: [theta * phi.cos(), theta * phi.sin()],
            length,
        })
    }

    /// Bend angle from base to tip (rad), never negative.
    pub fn theta(&self) -> f64 {
        self.bend[0].hypot(self.bend[1])
    }

    /// Curvature (1/m, never negative) and direction of the bend (rad, in (-pi, pi]; 0 if
    /// straight).
    pub fn curvature(&self) -> (f64, f64) {
        let theta = self.theta();
        let phi = if theta == 0.0 {
            0.0 // atan2 of signed zeros would give +-pi
        } else {
            self.bend[1].atan2(self.bend[0])
        };
        (theta / self.length, phi)
    }

    /// The part from the base to arc length `s` (m, within [0, length]).
    pub fn part(&self, s: f64) -> Result<Self, Error> {
        // allow rounding in the last digit of s
        if !(s >= 0.0 && s <= self.length * (1.0 + 4.0 * f64::EPSILON)) {
            return input(format!(
                "the position along the arc must lie between 0 and its length {} m, got {s:?} m",
                self.length
            ));
        }
        let share = s / self.length;
        Ok(Arc {
            bend: self.bend.map(|c| c * share),
            length: s,
        })
    }

    /// Pose of the arc's end: theory Eq. 1.1 and 1.2 (Amouri 2019, Eq. 1) with the rotation Rz(phi)
    /// Ry(theta) Rz(-phi).
    pub fn pose(&self) -> Pose {
        let [x, y] = self.bend;
        let theta = self.theta();
        let f = Smooth::at(theta);
        Pose {
            position: [f.b * x, f.b * y, f.a].map(|c| c * self.length),
            rotation: [
                [1.0 - f.b * x * x, -f.b * x * y, f.a * x],
                [-f.b * x * y, 1.0 - f.b * y * y, f.a * y],
                [-f.a * x, -f.a * y, theta.cos()],
            ],
        }
    }

    /// Derivative of the end's pose with respect to (bend x, bend y, length). Rows 0 to 2: position
    /// (m). Rows 3 to 5: rotation vector in base axes (rad), dR = w x R.
    pub fn pose_jacobian(&self) -> [[f64; 3]; 6] {
        let [x, y] = self.bend;
        let l = self.length;
        let f = Smooth::at(self.theta());
        // the length last: its products with a bend can overflow
        [
            [l * (f.b + x * x * f.db), l * (x * y * f.db), f.b * x],
            [l * (x * y * f.db), l * (f.b + y * y * f.db), f.b * y],
            [l * (x * f.da), l * (y * f.da), f.a],
            [-f.e * x * y, f.e * x * x - 1.0, 0.0],
            [1.0 - f.e * y * y, f.e * x * y, 0.0],
            [-f.b * y, f.b * x, 0.0],
        ]
    }

    /// Derivative of (kappa, phi, length) with respect to (bend x, bend y, length); `None` at the
    /// straight pose, where phi has no derivative.
    pub fn curvature_jacobian(&self) -> Option<[[f64; 3]; 3]> {
        let theta = self.theta();
        if theta == 0.0 {
            return None;
        }
        let l = self.length;
        let (c, s) = (self.bend[0] / theta, self.bend[1] / theta);
        Some([
            [c / l, s / l, -theta / (l * l)],
            [-s / theta, c / theta, 0.0],
            [0.0, 0.0, 1.0],
        ])
    }

    /// Length of the tendon through `hole` (m), parallel to the backbone: theory Eq. 1.3.
    pub fn tendon_length(&self, hole: Hole) -> Result<f64, Error> {
        let parallel = self.parallel_length(hole);
        if parallel.is_nan() || parallel <= 0.0 {
            return input(format!(
                "a tendon at ({:.4}, {:.4}) m would have the length {parallel:.4} m: the arc bends tighter than the tendon's distance from the backbone",
                hole[0], hole[1]
            ));
        }
        Ok(parallel)
    }

    /// Derivative of [`Arc::tendon_length`] with respect to (bend x, bend y, length).
    pub fn tendon_length_jacobian(&self, hole: Hole) -> [f64; 3] {
        [-hole[0], -hole[1], 1.0]
    }

    fn parallel_length(&self, hole: Hole) -> f64 {
        self.length - (hole[0] * self.bend[0] + hole[1] * self.bend[1])
    }

    /// The arc whose tip is at `position` (m); its length is free. Every point except the origin
    /// and the negative z axis has one with theta below 2 pi.
    pub fn through(position: [f64; 3]) -> Result<Self, Error> {
        let [x, y, z] = position;
        finite("a tip coordinate", &position, "m")?;
        let rho = x.hypot(y);
        let distance = rho.hypot(z);
        if rho == 0.0 && z <= 0.0 {
            return input(format!(
                "no arc from the base ends at ({x:?}, {y:?}, {z:?}) m: the base itself and the points straight behind it cannot be reached"
            ));
        }
        // the chord makes half the bend angle with z
        let half = rho.atan2(z);
        let sine = rho / distance;
        let stretch = if z > 0.0 && sine < 1e-9 {
            1.0 // equal to rounding
        } else {
            half / sine
        };
        let length = distance * stretch;
        if !length.is_finite() || !(2.0 * half / length).is_finite() {
            return input(format!(
                "no arc of finite length ends at ({x:?}, {y:?}, {z:?}) m: the tip lies too close to the axis behind the base"
            ));
        }
        let bend = if rho == 0.0 {
            [0.0, 0.0]
        } else {
            [2.0 * half * (x / rho), 2.0 * half * (y / rho)]
        };
        Ok(Arc { bend, length })
    }

    /// The arc of the given `length` (theta from 0 to 2 pi) whose tip is nearest to `position`, and
    /// the distance (m). Where the direction of the bend is not unique (points on the z axis) it is
    /// phi = 0.
    pub fn nearest(position: [f64; 3], length: f64) -> Result<(Self, f64), Error> {
        finite("a tip coordinate", &position, "m")?;
        positive("the arc's length", length, "m")?;
        let rho = position[0].hypot(position[1]);
        let target = [rho / length, position[2] / length];
        finite("the tip's distance in arc lengths", &target, "lengths")?;

        // in the plane of the bend, in units of the length
        let offset = |theta: f64, f: &Smooth| [theta * f.b - target[0], f.a - target[1]];
        let distance = |theta: f64| {
            let [u, v] = offset(theta, &Smooth::at(theta));
            u.hypot(v)
        };
        // half the derivative of the squared distance, and its own derivative
        let slope = |theta: f64| {
            let f = Smooth::at(theta);
            let [u, v] = offset(theta, &f);
            let (du, dv) = (f.b + theta * theta * f.db, theta * f.da);
            let ddu = if theta == 0.0 {
                0.0
            } else {
                (theta.cos() - 2.0 * du) / theta
            };
            let ddv = -f.a - 2.0 * f.da;
            (u * du + v * dv, du * du + dv * dv + u * ddu + v * ddv)
        };

        // every minimum lies where the slope becomes positive, or at an end
        const SCAN: u32 = 256;
        let node = |k: u32| TAU * f64::from(k) / f64::from(SCAN);
        let mut best = (distance(0.0), 0.0);
        let mut consider = |theta: f64| {
            let d = distance(theta);
            if d < best.0 {
                best = (d, theta);
            }
        };
        let mut left = slope(0.0).0;
        for k in 0..SCAN {
            let right = slope(node(k + 1)).0;
            if left < 0.0 && right >= 0.0 {
                consider(root(slope, node(k), node(k + 1)));
            }
            left = right;
        }
        consider(TAU);
        let (miss, theta) = best;
        let direction = if rho == 0.0 {
            [1.0, 0.0]
        } else {
            [position[0] / rho, position[1] / rho]
        };
        let arc = Arc {
            bend: direction.map(|c| c * theta),
            length,
        };
        finite("the distance to the tip", &[miss * length], "m")?;
        Ok((arc, miss * length))
    }
}

/// Zero in [low, high] of a function that is negative below and positive above it, by Newton's
/// method safeguarded by bisection.
pub(crate) fn root(f: impl Fn(f64) -> (f64, f64), mut low: f64, mut high: f64) -> f64 {
    let mut t = 0.5 * (low + high);
    for _ in 0..100 {
        let (value, derivative) = f(t);
        if value < 0.0 {
            low = t;
        } else {
            high = t;
        }
        let mut next = t - value / derivative;
        if !(next >= low && next <= high) {
            next = 0.5 * (low + high);
        }
        let step = (next - t).abs();
        t = next;
        if step <= 2.0 * f64::EPSILON * t {
            break;
        }
    }
    t
}

/// Derivative of (bend x, bend y, length) with respect to (kappa, phi, length).
pub fn bend_jacobian(kappa: f64, phi: f64, length: f64) -> [[f64; 3]; 3] {
    let (s, c) = phi.sin_cos();
    [
        [length * c, -kappa * length * s, kappa * c],
        [length * s, kappa * length * c, kappa * s],
        [0.0, 0.0, 1.0],
    ]
}

/// Share of the size of a routing below which holes are on one line.
const ALIGNED: f64 = 1e-6;

/// Least-squares map from tendon lengths to an arc, for tendons at any holes.
///
/// Minimises the sum of squares of l_i - (length - hole_i . bend) (theory Eq. 1.3). For three tendons
/// the residual is zero; at 120 degrees the solution is theory Eq. 1.4 (Amouri 2019, Eq. 2-4). Holes
/// on a line through the axis determine the bend in one direction.
#[derive(Debug, Clone)]
pub struct TendonFit {
    holes: Vec<Hole>,
    hold_length: bool,
    mean_hole: Hole,
    /// Derivative of the bend vector with respect to length differences.
    weights: Vec<[f64; 2]>,
    /// Bend vector (rad) at equal lengths.
    offset: [f64; 2],
    /// Whether there are as many lengths as unknowns.
    exact: bool,
}

impl TendonFit {
    /// Prepares the fit. With `hold_length` the arc's length is given and only the bend is fitted.
    pub fn new(holes: &[Hole], hold_length: bool) -> Result<Self, Error> {
        Self::of(holes, hold_length, |hole| hole, [0.0; 2])
    }

    /// Prepares the fit for a backbone that a tension at a hole bends towards `soft(hole)`, and that
    /// has the bend `rest` (rad) without load. Holds the arc's length where the holes need it.
    pub(crate) fn of_backbone(
        holes: &[Hole],
        hold_length: bool,
        soft: impl Fn(Hole) -> [f64; 2],
        rest: [f64; 2],
    ) -> Result<Self, Error> {
        let found = Self::of(holes, hold_length, &soft, rest);
        match found {
            Err(_) if !hold_length => Self::of(holes, true, soft, rest),
            _ => found,
        }
    }

    fn of(
        holes: &[Hole],
        hold_length: bool,
        soft: impl Fn(Hole) -> [f64; 2],
        rest: [f64; 2],
    ) -> Result<Self, Error> {
        let count = holes.len();
        if count == 0 {
            return input("an arc from tendon lengths needs a tendon".into());
        }
        finite("a tendon's hole position", holes.as_flattened(), "m")?;
        let mean = |k: usize| holes.iter().map(|h| h[k]).sum::<f64>() / count as f64;
        let mean_hole = [mean(0), mean(1)];
        let centre = if hold_length { [0.0; 2] } else { mean_hole };

        // thin QR of the holes about their centroid; the second pass restores orthogonality
        let mut first: Vec<f64> = holes.iter().map(|h| h[0] - centre[0]).collect();
        let mut second: Vec<f64> = holes.iter().map(|h| h[1] - centre[1]).collect();
        let size = dot(&first, &first) + dot(&second, &second);
        let r11 = dot(&first, &first).sqrt();
        let mut r12 = 0.0;
        if r11 > 0.0 {
            first.iter_mut().for_each(|c| *c /= r11);
            for _ in 0..2 {
                let d = dot(&first, &second);
                r12 += d;
                second.iter_mut().zip(&first).for_each(|(c, f)| *c -= d * f);
            }
        }
        let r22 = dot(&second, &second).sqrt();
        // r11 r22 is the product of the singular values, size the sum of their squares
        let fit = |weights, offset, unknowns| TendonFit {
            holes: holes.to_vec(),
            hold_length,
            mean_hole,
            weights,
            offset,
            exact: count + usize::from(hold_length) == unknowns,
        };
        if !(r11 * r22 > ALIGNED * size) {
            let (weights, offset) = in_one_direction(holes, hold_length, soft, rest)?;
            return Ok(fit(weights, offset, 2));
        }
        let weights = first
            .iter()
            .zip(&second)
            .map(|(q1, q2)| {
                let y = q2 / (r22 * r22);
                [-(q1 - r12 * y) / r11, -y]
            })
            .collect();
        Ok(fit(weights, [0.0; 2], 3))
    }

    /// `length` if the fit holds it.
    pub fn held(&self, length: f64) -> Option<f64> {
        self.hold_length.then_some(length)
    }

    /// The arc for these tendon `lengths` (m), and the misfit: the root mean square residual of the
    /// lengths (m; zero for as many tendons as unknowns). `length` is the held length of the
    /// arc. Whether a backbone can have the arc, [`TendonFit::check`] says.
    pub fn fit(&self, lengths: &[f64], length: Option<f64>) -> Result<(Arc, f64), Error> {
        let count = self.holes.len();
        one_a_hole("tendon lengths", lengths, &self.holes)?;
        for (i, &l) in lengths.iter().enumerate() {
            positive(format_args!("the length of tendon {i}"), l, "m")?;
        }
        if length.is_some() != self.hold_length {
            return input("a held length goes with a fit that holds it".into());
        }
        // differences of close lengths are exact, so the bend stays accurate near the straight pose
        let reference = length.unwrap_or(lengths[0]);
        let mut bend = self.offset;
        let mut mean = 0.0;
        for (weight, l) in self.weights.iter().zip(lengths) {
            bend[0] += weight[0] * (l - reference);
            bend[1] += weight[1] * (l - reference);
            mean += (l - reference) / count as f64;
        }
        let free = reference + mean + self.mean_hole[0] * bend[0] + self.mean_hole[1] * bend[1];
        let arc = Arc {
            bend,
            length: length.unwrap_or(free),
        };
        let misfit = if self.exact {
            0.0
        } else {
            let sum: f64 = self
                .holes
                .iter()
                .zip(lengths)
                .map(|(hole, l)| (l - arc.parallel_length(*hole)).powi(2))
                .sum();
            (sum / count as f64).sqrt()
        };
        finite("the misfit of the tendon lengths", &[misfit], "m")?;
        finite("the arc's length", &[arc.length], "m")?;
        Ok((arc, misfit))
    }

    /// Checks that the arc bends less than a full turn and not inside the pitch radius.
    pub fn check(&self, arc: &Arc) -> Result<(), Error> {
        let theta = arc.theta();
        let reach = self
            .holes
            .iter()
            .map(|h| h[0].hypot(h[1]))
            .fold(0.0, f64::max);
        if !(arc.length > 0.0 && theta * reach < arc.length) {
            return input(format!(
                "no arc has these tendon lengths: they need a radius of curvature of {:.4} m, inside the pitch radius of {reach:.4} m",
                (arc.length / theta).max(0.0)
            ));
        }
        if theta > TAU * (1.0 + 1e-9) {
            return input(format!(
                "no arc has these tendon lengths: they would bend it by {theta:.4} rad, more than a full turn"
            ));
        }
        Ok(())
    }

    /// Derivative of (bend x, bend y, length) with respect to the tendon lengths: three rows, one
    /// column for each tendon.
    pub fn jacobian(&self) -> [Vec<f64>; 3] {
        let count = self.holes.len() as f64;
        let mut rows = [Vec::new(), Vec::new(), Vec::new()];
        for weight in &self.weights {
            rows[0].push(weight[0]);
            rows[1].push(weight[1]);
            rows[2].push(if self.hold_length {
                0.0
            } else {
                1.0 / count + self.mean_hole[0] * weight[0] + self.mean_hole[1] * weight[1]
            });
        }
        rows
    }
}

/// Weights and offset of [`TendonFit`] for holes on a line through the axis: the lengths say how far
/// the backbone bends, and its flexibility in which direction.
fn in_one_direction(
    holes: &[Hole],
    hold_length: bool,
    soft: impl Fn(Hole) -> [f64; 2],
    rest: [f64; 2],
) -> Result<(Vec<[f64; 2]>, [f64; 2]), Error> {
    let far = holes.iter().fold([0.0; 2], |far: Hole, hole| {
        match hole[0].hypot(hole[1]) > far[0].hypot(far[1]) {
            true => *hole,
            false => far,
        }
    });
    let square = dot(&far, &far);
    if !(square > 0.0 && square.is_finite()) {
        return input(
            "the tendons run on its axis, so their lengths do not determine its bend".into(),
        );
    }
    let [x, y] = soft(far);
    let towards = [x, y].map(|c| c / x.hypot(y));
    let arms: Vec<_> = holes.iter().map(|hole| dot(hole, &towards)).collect();
    let centre = match hold_length {
        true => 0.0,
        false => arms.iter().sum::<f64>() / arms.len() as f64,
    };
    let spread: f64 = arms.iter().map(|arm| (arm - centre).powi(2)).sum();
    let beside = |hole: &Hole| (hole[0] * far[1] - hole[1] * far[0]).abs() > ALIGNED * square;
    if holes.iter().any(beside) || spread <= (ALIGNED * ALIGNED) * square {
        return input(
            "the lengths of tendons at these holes determine its bend only if the length of the arc is given".into(),
        );
    }
    let weights: Vec<_> = arms
        .iter()
        .map(|arm| towards.map(|c| -c * (arm - centre) / spread))
        .collect();
    let mut offset = rest;
    for (weight, hole) in weights.iter().zip(holes) {
        let shorter = dot(hole, &rest);
        offset[0] += weight[0] * shorter;
        offset[1] += weight[1] * shorter;
    }
    Ok((weights, offset))
}

/// Sum of the tensions (N), and sum of tension times hole (N m).
pub(crate) fn tendon_load(tensions: &[f64], holes: &[Hole]) -> Result<(f64, [f64; 2]), Error> {
    one_a_hole("tensions", tensions, holes)?;
    let mut force = 0.0;
    let mut moment = [0.0; 2];
    finite("tensions", tensions, "N")?;
    for (&t, hole) in tensions.iter().zip(holes) {
        finite("a tendon's hole position", hole, "m")?;
        force += t;
        moment[0] += t * hole[0];
        moment[1] += t * hole[1];
    }
    Ok((force, moment))
}

/// The arc under `tensions` (N) by the linear law, theory Eq. 1.7: bend = (length/EI) sum of
/// tension times hole; the length is unchanged. For one tendon theta = F r l/(E I). It is also the
/// solution for a tendon that follows a parallel curve.
/// `bending_stiffness` is E I (N m^2).
pub fn linear_law(
    tensions: &[f64],
    holes: &[Hole],
    length: f64,
    bending_stiffness: f64,
) -> Result<Arc, Error> {
    let wrong = |t: &f64| !(*t >= 0.0 && t.is_finite());
    if let Some(i) = tensions.iter().position(wrong) {
        return input(format!(
            "the tension of tendon {i} must be finite and not negative, got {:?} N",
            tensions[i]
        ));
    }
    signed_linear_law(tensions, holes, length, bending_stiffness)
}

/// [`linear_law`] for tensions of either sign, of tendons that push too.
pub(crate) fn signed_linear_law(
    tensions: &[f64],
    holes: &[Hole],
    length: f64,
    bending_stiffness: f64,
) -> Result<Arc, Error> {
    positive("the arc's length", length, "m")?;
    positive("the bending stiffness", bending_stiffness, "N m^2")?;
    let (_, moment) = tendon_load(tensions, holes)?;
    let bend = moment.map(|m| m * length / bending_stiffness);
    angle(bend[0].hypot(bend[1]))?;
    Ok(Arc { bend, length })
}
