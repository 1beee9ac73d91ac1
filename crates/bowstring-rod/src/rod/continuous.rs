//! Continuous tendons: what they do to the sections of the backbone beside them.
//!
//! Theory: docs/theory/rod.md (Continuous tendons).
//!
//! A section with the curvature and twist `u` shears and stretches by the strain `g` that minimises
//! its energy and that of its tendons, `g.Cg/2 + sum T |e3 + g + u x b + b'| - n.g`, under a contact
//! force `n` of the loads. Along an arc that strain is constant, at the place and curvature of the
//! fourth-order commutator-free form.
//!
//! Lanes do not take them, and functions are not inlined: the passes of straight spans stay small.

use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::rod::constants::Constants;
use crate::rod::gauss::{fraction, FAR, NEAR};
use crate::rod::routes::{Holes, Tendons};

/// Residual of shear and extension from which one more Newton step is exact to rounding.
const SETTLED: f64 = 1e-11;
/// Most Newton iterations for shear and extension; three are usual.
const MAX_ROUNDS: usize = 6;

/// A section between continuous tendons.
#[derive(Clone, Copy)]
pub struct PulledSection<T> {
    /// Distance from the start of the flexible part (m).
    pub at: T,
    /// Curvature and twist (1/m).
    pub u: Vec3<T>,
    /// Shear and extension.
    pub g: Vec3<T>,
    /// Force and moment of the tendons on the section (N, N m), in its axes.
    pub pull: Vec3<T>,
    pub moment: Vec3<T>,
    /// Shear and extension by force, against the tendons as well (1/N).
    pub compliance: Mat3<T>,
    /// Derivative of the force of the tendons with respect to the curvature, with opposite sign (N m).
    mixed: Mat3<T>,
    /// Derivative of the moment with respect to the curvature, at constant shear and extension
    /// (N m^2).
    turning: Mat3<T>,
}

/// A tendon at a section: its place, its unit tangent, and the length per length of backbone.
#[inline(always)]
pub fn tendon<T: Real, const A: usize>(
    c: &Constants<T, A>,
    holes: &Holes<T>,
    at: T,
    u: Vec3<T>,
    g: Vec3<T>,
) -> (Vec3<T>, Vec3<T>, T) {
    let (hole, slope) = holes.between(c, at);
    let along = Vec3::ez() + g + slope + u.cross(hole);
    let speed = along.norm();
    (hole, along * (T::splat(1.0) / speed), speed)
}

impl<T: Real> PulledSection<T> {
    /// At a distance from the start of the flexible part (m), with its compliance to shear and
    /// extension (1/N), its curvature and twist, and the contact force in its axes.
    #[inline(never)]
    pub fn new<const A: usize>(
        c: &Constants<T, A>,
        t: &Tendons<T>,
        [shear, axial]: [T; 2],
        at: T,
        u: Vec3<T>,
        n: Vec3<T>,
    ) -> Self {
        let compliance = [shear, shear, axial];
        let mut g = Vec3([n[0] * shear, n[1] * shear, n[2] * axial]);
        for &tension in t.tensions {
            g.0[2] -= tension * axial;
        }
        let mut round = 1;
        loop {
            let (mut pull, mut stiffness) = (Vec3::zero(), Mat3::zero());
            for (holes, &tension) in t.holes.iter().zip(t.tensions) {
                let (_, along, speed) = tendon(c, holes, at, u, g);
                let s = tension / speed;
                pull += along * tension;
                stiffness = (along * -s)
                    .outer_add(along, stiffness)
                    .add_diagonal([s; 3]);
            }
            let mut miss = g;
            for q in 0..3 {
                miss.0[q] += (pull[q] - n[q]) * compliance[q];
            }
            let solve = stiffness
                .mirrored()
                .scale_rows(compliance)
                .add_diagonal([T::splat(1.0); 3])
                .inverse();
            g -= solve * miss;
            if !miss.max_abs().any_above(SETTLED) || round == MAX_ROUNDS {
                let mut out = PulledSection {
                    at,
                    u,
                    g,
                    pull: Vec3::zero(),
                    moment: Vec3::zero(),
                    compliance: (solve * Mat3::diagonal(compliance)).mirrored(),
                    mixed: Mat3::zero(),
                    turning: Mat3::zero(),
                };
                out.add_pulls(c, t);
                return out;
            }
            round += 1;
        }
    }

    #[inline(always)]
    fn add_pulls<const A: usize>(&mut self, c: &Constants<T, A>, t: &Tendons<T>) {
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            let (hole, along, speed) = tendon(c, holes, self.at, self.u, self.g);
            let s = tension / speed;
            let across = hole.cross(along);
            self.pull += along * tension;
            self.moment += across * tension;
            // P [b] and [b]' P [b] with P = I - t t'
            self.mixed = (along * s).outer_add(across, self.mixed + (hole * s).skew());
            self.turning = (across * -s)
                .outer_add(across, (hole * -s).outer_add(hole, self.turning))
                .add_diagonal([s * hole.norm2(); 3]);
        }
        self.turning = self.turning.mirrored();
    }

    /// Derivative of shear and extension with respect to the curvature (m).
    #[inline(always)]
    fn by_curvature(&self) -> Mat3<T> {
        self.compliance * self.mixed
    }

    /// Derivative of the moment with respect to the curvature (N m^2).
    #[inline(never)]
    pub fn stiffness(&self) -> Mat3<T> {
        (self.turning - self.mixed.tr_mat(self.by_curvature())).mirrored()
    }

    /// Energy of the tendons and of shear and extension, by length (N), without a contact force.
    #[inline(always)]
    fn energy<const A: usize>(&self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let mut sum = self.pull.dot(self.g) * T::splat(-0.5);
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            sum = tension.mul_add(tendon(c, holes, self.at, self.u, self.g).2, sum);
        }
        sum
    }

    /// Second derivative of `p . g` with respect to the curvature (N m^2).
    #[inline(always)]
    fn second<const A: usize>(&self, c: &Constants<T, A>, t: &Tendons<T>, p: Vec3<T>) -> Mat3<T> {
        let (y, by) = (self.compliance * p, self.by_curvature());
        let mut sum = Mat3::zero();
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            let (hole, along, speed) = tendon(c, holes, self.at, self.u, self.g);
            let s = tension / (speed * speed);
            // change of the tangent's direction, across and along it
            let moved = by - hole.skew();
            let (ty, across) = (along.dot(y), y - along * along.dot(y));
            let (on_t, on_y) = (moved.tr_mul(along), moved.tr_mul(across));
            sum += (on_t.outer(on_y).symmetric_part() * T::splat(2.0)
                + (moved.tr_mat(moved) - on_t.outer(on_t)) * ty)
                * s;
        }
        sum.mirrored()
    }
}

/// Section at a Gauss point of its element: that near arc `i`, by the rotation vectors of all arcs.
#[inline(always)]
pub fn gauss_point<T: Real, const A: usize>(
    c: &Constants<T, A>,
    t: &Tendons<T>,
    i: usize,
    w: &[Vec3<T>; A],
) -> PulledSection<T> {
    let [near, far] = slopes(c, i / 2);
    let u = w[i] * near + w[i ^ 1] * far;
    PulledSection::new(
        c,
        t,
        c.compliance,
        c.within(i / 2, fraction(i)),
        u,
        Vec3::zero(),
    )
}

/// Derivatives of a Gauss point's curvature with respect to the nearer and the farther arc of its
/// element (1/m).
#[inline(always)]
fn slopes<T: Real, const A: usize>(c: &Constants<T, A>, element: usize) -> [T; 2] {
    let half = T::splat(0.5) / c.arc_length(2 * element);
    [half * T::splat(NEAR), half * T::splat(FAR)]
}

/// An element between continuous tendons: its sections at the two Gauss points, each of which
/// represents the length of an arc.
pub struct PulledElement<T> {
    points: [PulledSection<T>; 2],
    weight: T,
    slopes: [T; 2],
}

impl<T: Real> PulledElement<T> {
    #[inline(never)]
    pub fn new<const A: usize>(
        c: &Constants<T, A>,
        t: &Tendons<T>,
        element: usize,
        w: &[Vec3<T>; A],
    ) -> Self {
        let [a, b] = [2 * element, 2 * element + 1];
        PulledElement {
            points: [gauss_point(c, t, a, w), gauss_point(c, t, b, w)],
            weight: c.arc_length(a),
            slopes: slopes(c, element),
        }
    }

    /// Energy of tendons, shear and extension (J).
    #[inline(never)]
    pub fn energy<const A: usize>(&self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let [p, q] = &self.points;
        (p.energy(c, t) + q.energy(c, t)) * self.weight
    }

    /// Derivatives of the energy with respect to the rotation vectors of the two arcs.
    #[inline(never)]
    pub fn gradient(&self) -> [Vec3<T>; 2] {
        let [p, q] = [self.points[0].moment, self.points[1].moment];
        let [near, far] = self.slopes.map(|slope| slope * self.weight);
        [p * near + q * far, p * far + q * near]
    }

    /// Second derivatives: blocks first-first, second-first, second-second.
    #[inline(never)]
    pub fn hessian(&self) -> [Mat3<T>; 3] {
        let p = self.points[0].stiffness() * self.weight;
        let q = self.points[1].stiffness() * self.weight;
        let [n, f] = self.slopes;
        [
            p * (n * n) + q * (f * f),
            (p + q) * (n * f),
            p * (f * f) + q * (n * n),
        ]
    }
}

/// An arc between continuous tendons: its vector from start to end without its rotation.
pub struct PulledArc<T> {
    pub section: PulledSection<T>,
    pub length: T,
    pub chord: Vec3<T>,
}

impl<T: Real> PulledArc<T> {
    /// Arc `i` of a module, with its rotation vector.
    #[inline(never)]
    pub fn new<const A: usize>(c: &Constants<T, A>, t: &Tendons<T>, i: usize, w: Vec3<T>) -> Self {
        let length = c.arc_length(i);
        // a strain that is linear in the element has its mean over the commutator-free arc here
        let place = if i.is_multiple_of(2) {
            1.0 / 6.0
        } else {
            5.0 / 6.0
        };
        let u = w * (T::splat(1.0) / length);
        let at = c.within(i / 2, place);
        let section = PulledSection::new(c, t, c.compliance, at, u, Vec3::zero());
        PulledArc {
            section,
            length,
            chord: (Vec3::ez() + section.g) * length,
        }
    }

    /// Derivative of the end point with respect to the rotation vector (m).
    #[inline(never)]
    pub fn end_jacobian(&self, map: &ArcMap<T>) -> Mat3<T> {
        map.end_along_jacobian(self.chord) + map.left_jacobian() * self.section.by_curvature()
    }

    /// Hessian of `n . end(w) + m . eta(w)`; see [`ArcMap::hessian`].
    #[inline(never)]
    pub fn hessian<const A: usize>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        map: &ArcMap<T>,
        n: Vec3<T>,
        m: Vec3<T>,
    ) -> Mat3<T> {
        let mixed = self
            .section
            .by_curvature()
            .tr_mat(map.transposed_jacobian(n));
        let p = map.left_jacobian().tr_mul(n);
        map.hessian_along(self.chord, n, m)
            + mixed
            + mixed.transpose()
            + self.section.second(c, t, p) * (T::splat(1.0) / self.length)
    }
}
