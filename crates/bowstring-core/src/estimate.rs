//! How far a converged answer is from the rod's differential equation.
//!
//! Every element is integrated back from its end, under the wrench that loads and tendons leave
//! there, by a sixth-order Runge-Kutta method: with shear, extension and weight at every
//! section, and without anything that the elements assume. Where it misses the start of the
//! element, the miss is a defect of the element's strain. One substitution by the last Newton
//! step's elimination gives the change of the whole rod that takes all defects away, and so the
//! error of tip and lengths, also where a load near buckling magnifies it (defect correction:
//! Stetter 1978).

use crate::linalg::{Mat3, Vec3};
use crate::load::TendonPath;
use crate::module::{Constants, Gradient, Span, State, Tendons};
use crate::real::{Layout, Real};
use crate::rod::{get, get_mat, in_group, put, Rod};

/// Estimated discretisation error of an equilibrium.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// Of the position of any disk, the tip's among them, m.
    pub tip: f64,
    /// Of the tension of a tendon that is pulled by a length, N.
    pub tension: f64,
}

/// Estimated error of the tip, over the robot's length, that elements are chosen for.
pub const TIP_TOLERANCE: f64 = 1e-5;
/// The same of tensions, over the largest.
pub const TENSION_TOLERANCE: f64 = 1e-4;
/// Elements to choose from.
pub const LEVELS: [usize; 4] = [1, 2, 4, 8];
/// Compression of a module (force times squared length over bending stiffness; between two disks
/// it buckles at pi^2) above which stability depends on the elements.
const NEAR_BUCKLING: f64 = 5.0;
/// Largest compression of one element at which the critical force is found to 1e-3.
const FINE_COMPRESSION: f64 = 0.65;
/// What the estimate is multiplied by: it is first order in the defects.
const SAFETY: f64 = 3.0;
/// The same where a module has folded: defects of its elements cancel there, and underestimate
/// the error by up to 12 times.
const SAFETY_FOLDED: f64 = 12.0;
/// Distance of the ends of a module, over its length, below which it counts as folded.
const FOLDED: f64 = 0.8;

/// What is said of a converged answer by its estimate.
pub(crate) struct Verdict {
    pub error: ErrorEstimate,
    /// Taken back where so few elements cannot tell a stable equilibrium from an unstable one.
    pub stable: Option<bool>,
    /// Elements that bring the error below the tolerances, or all there are.
    pub needed: usize,
}

impl Verdict {
    /// Of an answer by `elements` in a module of a robot of some `length`; `tension`: estimated
    /// change of a tension, and the largest tension, N.
    pub fn new(
        found: &Correction<f64>,
        tension: [f64; 2],
        stable: Option<bool>,
        length: f64,
        elements: usize,
    ) -> Self {
        let safety = if found.folded > 0.0 {
            SAFETY_FOLDED
        } else {
            SAFETY
        };
        // an estimate that is not finite gives no bound
        let sound = |x: f64| {
            if x.is_finite() {
                safety * x
            } else {
                f64::INFINITY
            }
        };
        let error = ErrorEstimate {
            tip: sound(found.motion),
            tension: sound(tension[0]),
        };
        let ratio = error.tip / (TIP_TOLERANCE * length);
        let of_tension = if error.tension > 0.0 {
            error.tension / (TENSION_TOLERANCE * tension[1])
        } else {
            0.0
        };
        let tells = tells_stability(found.compression, elements);
        Verdict {
            error,
            stable: stable.filter(|stable| !stable || tells),
            needed: needed(elements, f64::max(ratio, of_tension), found.compression),
        }
    }
}

/// Whether the elements are fine enough to decide stability, by the largest compression of a
/// module.
fn tells_stability(compression: f64, elements: usize) -> bool {
    let own = compression / (elements * elements) as f64;
    // a NaN tells nothing
    compression <= NEAR_BUCKLING || own <= FINE_COMPRESSION
}

/// Elements that bring an error, `ratio` times what is tolerated, below it; the same number
/// where it is already, or where there are no more.
fn needed(elements: usize, ratio: f64, compression: f64) -> usize {
    let enough = |e: usize| {
        let finer = (e / elements) as f64;
        // a NaN is never enough
        (ratio <= 1.0 || ratio / finer.powi(4) <= 1.0) && tells_stability(compression, e)
    };
    let mut finer = LEVELS.into_iter().filter(|e| *e >= elements);
    finer.find(|e| enough(*e)).unwrap_or(LEVELS[3])
}

/// What a module's elements miss, in the frame of its start.
#[derive(Clone, Copy)]
pub(crate) struct Defect<T> {
    /// Motion of the end that no strain of the elements gives, m.
    place: Vec3<T>,
    /// Moment about the start that the quadrature of the weight leaves out, N m.
    moment: Vec3<T>,
    /// Compressive force times squared length over bending stiffness.
    pub compression: T,
    /// Positive where the module has folded.
    folded: T,
}

impl<T: Real> Defect<T> {
    pub fn none() -> Self {
        Defect {
            place: Vec3::zero(),
            moment: Vec3::zero(),
            compression: T::zero(),
            folded: T::zero(),
        }
    }
}

/// Steps of the integration through an element: two orders above it, so that their own error
/// does not show.
const STEPS: usize = 2;

/// A section of the backbone: its pose, and the moment of all beyond.
#[derive(Clone, Copy)]
struct Section<T> {
    rotation: Mat3<T>,
    place: Vec3<T>,
    moment: Vec3<T>,
}

impl<T: Real> Section<T> {
    #[inline(always)]
    fn plus_weighted(&self, rates: &[Self; 7], weights: [f64; 7], h: T) -> Self {
        let mut out = *self;
        for (rate, weight) in rates.iter().zip(weights) {
            if weight != 0.0 {
                out = out.plus(rate, h * T::splat(weight));
            }
        }
        out
    }

    #[inline(always)]
    fn plus(&self, rate: &Self, h: T) -> Self {
        let mut out = *self;
        for (row, by) in out.rotation.0.iter_mut().zip(&rate.rotation.0) {
            for (x, y) in row.iter_mut().zip(by) {
                *x = y.mul_add(h, *x);
            }
        }
        out.place = rate.place.scaled_add(h, self.place);
        out.moment = rate.moment.scaled_add(h, self.moment);
        out
    }
}

/// What one element is made of and carries.
struct Element<'a, T> {
    length: T,
    /// Inverse bending and torsion stiffness, 1/(N m^2).
    flexibility: Vec3<T>,
    /// Shear and extension by force, 1/N.
    shear: T,
    axial: T,
    stretch: T,
    tendons: &'a Tendons<'a, T>,
    /// Weight by length, N/m.
    weight: Vec3<T>,
}

impl<T: Real> Element<'_, T> {
    /// Curvature and twist under a moment in body axes.
    #[inline(always)]
    fn curvature(&self, moment: Vec3<T>) -> Vec3<T> {
        let scaled = |m: Vec3<T>| {
            let f = self.flexibility;
            Vec3([m[0] * f[0], m[1] * f[1], m[2] * f[2]])
        };
        let mut u = scaled(moment);
        if self.tendons.path == TendonPath::Continuous {
            // the tendons take their part of the moment, which depends on the curvature
            for _ in 0..NEWTON_ROUNDS {
                let mut residual = moment;
                let mut stiffness = Mat3::zero();
                for q in 0..3 {
                    residual.0[q] -= u[q] * (T::splat(1.0) / self.flexibility[q]);
                    stiffness.0[q][q] = T::splat(1.0) / self.flexibility[q];
                }
                for (tendon, &tension) in self.tendons.tendons.iter().zip(self.tendons.tensions) {
                    let hole = Vec3::splat([tendon.hole[0], tendon.hole[1], 0.0]);
                    let mut along = u.cross(hole);
                    along.0[2] += self.stretch;
                    let per = T::splat(1.0) / along.norm();
                    let direction = along * per;
                    let across = hole.cross(direction);
                    residual -= across * tension;
                    let square = Mat3::scalar(hole.norm2()) - hole.outer(hole);
                    stiffness += (square - across.outer(across)) * (tension * per);
                }
                u += stiffness.inverse() * residual;
            }
        }
        u
    }

    #[inline(always)]
    fn rate(&self, at: &Section<T>, force: Vec3<T>) -> Section<T> {
        let r = &at.rotation;
        let curvature = self.curvature(r.tr_mul(at.moment));
        let n = r.tr_mul(force);
        let along = *r
            * Vec3([
                n[0] * self.shear,
                n[1] * self.shear,
                n[2].mul_add(self.axial, self.stretch),
            ]);
        Section {
            rotation: *r * curvature.skew(),
            place: along,
            moment: -along.cross(force),
        }
    }

    /// Goes back from the end, where `force` acts, to the start.
    #[inline(always)]
    fn back(&self, end: Section<T>, force: Vec3<T>) -> Section<T> {
        let h = self.length * T::splat(-1.0 / STEPS as f64);
        let mut at = end;
        let mut force = force;
        for _ in 0..STEPS {
            let mut rates = [end; 7];
            // one by one: constant weights make a warm sweep 4 % faster than a loop
            rates[0] = self.stage::<0>(&at, &rates, force, h);
            rates[1] = self.stage::<1>(&at, &rates, force, h);
            rates[2] = self.stage::<2>(&at, &rates, force, h);
            rates[3] = self.stage::<3>(&at, &rates, force, h);
            rates[4] = self.stage::<4>(&at, &rates, force, h);
            rates[5] = self.stage::<5>(&at, &rates, force, h);
            rates[6] = self.stage::<6>(&at, &rates, force, h);
            at = at.plus_weighted(&rates, WEIGHTS, h);
            force = self.weight.scaled_add(-h, force);
        }
        at
    }

    #[inline(always)]
    fn stage<const I: usize>(
        &self,
        at: &Section<T>,
        rates: &[Section<T>; 7],
        force: Vec3<T>,
        h: T,
    ) -> Section<T> {
        let (place, weights) = STAGES[I];
        let here = at.plus_weighted(rates, weights, h);
        self.rate(&here, self.weight.scaled_add(h * T::splat(-place), force))
    }
}

/// Stages of Butcher's sixth-order method (1964): where each is, and what it takes of the rates
/// before it.
const STAGES: [(f64, [f64; 7]); 7] = [
    (0.0, [0.0; 7]),
    (1.0 / 3.0, [1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    (2.0 / 3.0, [0.0, 2.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    (
        1.0 / 3.0,
        [1.0 / 12.0, 1.0 / 3.0, -1.0 / 12.0, 0.0, 0.0, 0.0, 0.0],
    ),
    (0.5, [-0.0625, 1.125, -0.1875, -0.375, 0.0, 0.0, 0.0]),
    (0.5, [0.0, 1.125, -0.375, -0.75, 0.5, 0.0, 0.0]),
    (
        1.0,
        [
            9.0 / 44.0,
            -9.0 / 11.0,
            63.0 / 44.0,
            18.0 / 11.0,
            0.0,
            -16.0 / 11.0,
            0.0,
        ],
    ),
];
const WEIGHTS: [f64; 7] = [
    11.0 / 120.0,
    0.0,
    27.0 / 40.0,
    27.0 / 40.0,
    -4.0 / 15.0,
    -4.0 / 15.0,
    11.0 / 120.0,
];

/// Newton steps for the curvature under continuous tendons.
const NEWTON_ROUNDS: usize = 3;

impl<T: Real, const A: usize> State<T, A> {
    /// What the elements miss; `rhs` becomes the imbalance of the arcs whose Newton step takes
    /// the defects of their strain away, and what is left of their own.
    #[inline(always)]
    fn defect(
        &self,
        c: &Constants<T>,
        t: &Tendons<T>,
        gradient: &Gradient<T, A>,
        weight: Vec3<T>,
        rhs: &mut [Vec3<T>; A],
    ) -> Defect<T> {
        let elements = A / 2;
        let length = c.flexible * T::splat(1.0 / elements as f64);
        let one = T::splat(1.0);
        let per = one / length;
        let flexibility = c.stiffness.map(|s| one / (s * length));
        let [bending, torsion] = flexibility;
        let shear = c.d[0] * c.per_flexible;
        let element = Element {
            length,
            flexibility: Vec3([bending, bending, torsion]),
            shear,
            axial: shear + c.d[1] * c.per_flexible,
            stretch: c.stretch(t),
            tendons: t,
            weight,
        };
        let tangent = self.s.column(2);
        // the weight's own moment and force, not those of Hermite's rule
        let couple = weight.scaled_add(length * length * T::splat(1.0 / 12.0), self.f[1]);
        let mut force = weight.scaled_add(length * T::splat(-0.5), self.end_force);
        let mut section = Section {
            rotation: self.s,
            place: self.rho,
            moment: tangent.cross(couple) - self.span_torque - self.lambda,
        };
        let mut place = Vec3::zero();
        for e in (0..elements).rev() {
            let end = section.place;
            section = element.back(section, force);
            let (rotation, start) = match e {
                0 => (Mat3::identity(), Vec3::zero()),
                _ => (self.prefix[2 * e], self.inside(2 * e - 1)),
            };
            // turned so that the starts agree, how far the ends are apart
            let turned = rotation * section.rotation.transpose();
            let [x, y, z] = turned.rows();
            let turn = Vec3([z[1] - y[2], x[2] - z[0], y[0] - x[1]]) * T::splat(0.5);
            let gap = start + turned * (end - section.place) - end;
            let along = (end - start) * per;
            // The integrated curve lies off the element by about a cubic, and is turned by its
            // slope: force and moment bend it further through both. The tangent contains that
            // part already.
            let (miss, slope) = (start - section.place, turn.cross(along) * length);
            let mean = miss.scaled_add(T::splat(0.5), slope * T::splat(1.0 / 12.0));
            let first = miss.scaled_add(T::splat(0.35), slope * T::splat(0.05));
            let twist = along * along.dot(turn);
            let turned = [
                twist.scaled_add(T::splat(0.5), along.cross(miss) * -per),
                twist.scaled_add(T::splat(1.0 / 3.0), along.cross(mean - miss) * per),
            ];
            let middle = weight.scaled_add(length * T::splat(0.5), force);
            let moment = section.moment - along.cross(middle) * (length * T::splat(0.5));
            let bent_by = |offset: Vec3<T>, turned: Vec3<T>| {
                let moment = (offset.cross(middle) + turned.cross(moment)) * length;
                let twist = along * (along.dot(moment) * (torsion - bending));
                moment.scaled_add(bending, twist)
            };
            let turn = turn - bent_by(mean, turned[0]);
            let gap = gap - bent_by(first, turned[1]).cross(along) * length;
            // rotations of the two arcs that give it
            let bend = turn - along * along.dot(turn);
            let apart = along.cross(gap) * (per * T::splat(4.0)) - bend * T::splat(2.0);
            let half = T::splat(0.5);
            let (i, j) = (2 * e, 2 * e + 1);
            let u = [(turn + apart) * half, (turn - apart) * half];
            let beyond = self.tail[j];
            place += gap;
            for (arc, u) in [(i, u[0]), (j, u[1])] {
                place -= gradient.r[arc] * u + beyond.cross(u);
            }
            let (a, b) = (gradient.to_strain[i] * u[0], gradient.to_strain[j] * u[1]);
            let (sum, difference) = (a + b, (a - b) * T::splat(0.75));
            rhs[i] = gradient.g[i] - gradient.to_strain[i].tr_mul(c.moment(sum + difference));
            rhs[j] = gradient.g[j] - gradient.to_strain[j].tr_mul(c.moment(sum - difference));
            // on from the solver's pose
            force = weight.scaled_add(length, force);
            section.moment += (section.place - start).cross(force);
            section.rotation = rotation;
            section.place = start;
        }
        let pull = self.f[0] - self.end_force;
        let exact = section.moment + self.rho.cross(pull) + self.span_torque;
        let mut assumed = self.rho.cross(self.f[0]) + tangent.cross(self.f[1]) - self.lambda;
        // Hermite's couple at the start stands with the clamp's weight
        assumed += Vec3::ez().cross(weight * (length * length * T::splat(1.0 / 12.0)));
        for node in 1..elements {
            assumed += self.inside(2 * node - 1).cross(self.f[3]);
        }
        // of the force on the end; its part along a chord falls as the module folds
        let compression = -self.n.dot(self.rho) * c.flexible * bending;
        let chord = T::splat(FOLDED * FOLDED) * c.flexible * c.flexible - self.rho.norm2();
        Defect {
            place,
            moment: exact - assumed,
            compression,
            folded: chord,
        }
    }
}

/// What takes the defects of an answer away, and what the residual has left.
#[derive(Clone, Copy)]
pub(crate) struct Correction<T> {
    /// Motion of the end of each module from its start, summed, m: no disk moves further, and
    /// modules do not cancel by chance.
    pub motion: T,
    /// Largest compressive force of a module times its squared length over its bending
    /// stiffness; between two disks the backbone buckles at pi^2.
    pub compression: T,
    /// Positive where a module has folded.
    pub folded: T,
}

impl<T: Real> Correction<T> {
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> Correction<f64> {
        Correction {
            motion: self.motion.lane(lane),
            compression: self.compression.lane(lane),
            folded: self.folded.lane(lane),
        }
    }
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Error of the equilibrium that was found last, at its tensions; lengths are in
    /// `length_errors`.
    #[inline(always)]
    pub fn estimate(&mut self) -> Correction<L::Chain> {
        let n = self.module_count();
        let mut compression = L::Chain::zero();
        let mut folded = L::Chain::splat(-1.0);
        for g in 0..self.states.len() {
            let c = &self.constants[g];
            let mut weight = Vec3::zero();
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                let k = g * L::WIDTH + i;
                put::<L>(&mut weight, i, self.rotations[k].tr_mul(self.dead[k][3]));
            }
            let weight = weight * (c.per_flexible * L::Module::splat((A / 2) as f64));
            let t = in_group(&self.tendons, &self.tensions, self.path, g);
            let mut rhs = [Vec3::zero(); A];
            let defect = self.states[g].defect(c, &t, &self.gradients[g], weight, &mut rhs);
            self.gradients[g].g = rhs;
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                compression = compression.max(L::get(&defect.compression, i));
                folded = folded.max(L::get(&defect.folded, i));
            }
            self.defects[g] = defect;
        }
        let mut missing = Vec3::<L::Chain>::zero();
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            missing = get_mat::<L>(&self.states[g].s, i) * missing;
            for rhs in &mut self.gradients[g].g {
                let sum = get::<L>(rhs, i) + missing;
                put::<L>(rhs, i, sum);
            }
            missing -= get::<L>(&self.defects[g].moment, i);
        }
        if self.symmetric {
            self.rotations_of_step::<true>();
        } else {
            self.rotations_of_step::<false>();
        }
        Correction {
            motion: self.correction(),
            compression,
            folded,
        }
    }

    /// Motion by the rotations in `step` and the defects, see [`Correction`]; measures the change of
    /// the lengths.
    #[inline(always)]
    pub fn correction(&mut self) -> L::Chain {
        let n = self.module_count();
        for length in &mut self.length_errors {
            *length = L::Chain::zero();
        }
        let mut motion = L::Chain::zero();
        let mut x = Vec3::<L::Chain>::zero();
        for g in 0..self.states.len() {
            let (c, state, gradient) = (&self.constants[g], &self.states[g], &self.gradients[g]);
            let (mut turn, mut moved) = (Vec3::zero(), self.defects[g].place);
            for a in 0..A {
                turn += self.step[g][a];
                moved += gradient.r[a] * self.step[g][a];
            }
            let here = L::WIDTH.min(n - g * L::WIDTH);
            for (j, tendon) in self.tendons.iter().enumerate() {
                let span = Span::new(c, tendon, &state.s, state.rho);
                let longer = span.direction.dot(moved + turn.cross(span.arm));
                for i in 0..here {
                    if g * L::WIDTH + i <= tendon.end_disk {
                        self.length_errors[j] += L::get(&longer, i);
                    }
                }
            }
            let offset = state.offset(c);
            let end = moved + turn.cross(state.s.column(2) * c.clamp[1]);
            for i in 0..here {
                let own = x.cross(get::<L>(&offset, i)) + get::<L>(&end, i);
                motion += own.norm();
                x = get_mat::<L>(&state.s, i).tr_mul(x + get::<L>(&turn, i));
            }
        }
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needed_elements_follow_error_and_compression() {
        assert_eq!(needed(1, 0.9, 0.5), 1);
        assert_eq!(needed(1, 1.1, 0.5), 2);
        assert_eq!(needed(1, 17.0, 0.5), 4);
        assert_eq!(needed(2, 17.0, 0.5), 8);
        assert_eq!(needed(8, 17.0, 0.5), 8);
        assert_eq!(needed(1, 0.1, 9.0), 4);
        assert_eq!(needed(1, f64::NAN, 0.5), 8);
        assert_eq!(needed(1, 0.1, f64::NAN), 8);
    }
}
