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
use crate::rod::module::State;
use crate::rod::routes::{Holes, Tendons};

/// Residual of shear and extension from which one more Newton step is exact to rounding.
const SETTLED: f64 = 1e-11;
/// Most Newton iterations for shear and extension; three are usual.
const MAX_ROUNDS: usize = 6;

/// A section between continuous tendons.
#[derive(Clone, Copy)]
pub struct PulledSection<T> {
    /// Distance from the start of the flexible part (m).
    at: T,
    /// Curvature and twist (1/m).
    u: Vec3<T>,
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
fn tendon<T: Real, const A: usize>(
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
fn gauss_point<T: Real, const A: usize>(
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
    section: PulledSection<T>,
    length: T,
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

/// A module with continuous tendons, for their lengths.
pub struct PulledModule<T, const A: usize> {
    arcs: [PulledArc<T>; A],
    /// Mean contact force along each arc, in the axes of its sections (N).
    forces: [Vec3<T>; A],
    points: [PulledSection<T>; A],
    /// Change of the length of any tendon as its tension holds the shear by the loads (m).
    held: T,
}

impl<T: Real, const A: usize> PulledModule<T, A> {
    /// Nothing if the tendons are straight.
    #[inline(always)]
    pub fn of(state: &State<T, A>, c: &Constants<T, A>, t: &Tendons<T>) -> Option<Self> {
        t.are_continuous().then(
            #[inline(always)]
            || Self::new(state, c, t),
        )
    }

    #[inline(never)]
    fn new(state: &State<T, A>, c: &Constants<T, A>, t: &Tendons<T>) -> Self {
        let force = state.n + state.compliance_forces(c, t).0;
        PulledModule {
            arcs: std::array::from_fn(|i| PulledArc::new(c, t, i, state.w[i])),
            forces: std::array::from_fn(|i| {
                let arc = &state.arcs[i];
                arc.map.left_jacobian().tr_mul(arc.prefix.tr_mul(force))
            }),
            points: std::array::from_fn(|i| gauss_point(c, t, i, &state.w)),
            held: state.length_by_shear(c, t),
        }
    }

    /// Length of a tendon (m): the derivative of the potential with respect to its tension.
    #[inline(never)]
    pub fn length(&self, c: &Constants<T, A>, holes: &Holes<T>) -> T {
        let mut length = holes.beside_clamps(c) + self.by_loads(c, holes);
        for (i, p) in self.points.iter().enumerate() {
            length += tendon(c, holes, p.at, p.u, p.g).2 * c.arc_length(i);
        }
        length
    }

    /// Change of the length of a tendon by the shear and extension that the loads cause (m).
    #[inline(never)]
    fn by_loads(&self, c: &Constants<T, A>, holes: &Holes<T>) -> T {
        let mut change = self.held;
        for (arc, force) in self.arcs.iter().zip(&self.forces) {
            let s = &arc.section;
            let (_, along, _) = tendon(c, holes, s.at, s.u, s.g);
            change += (s.compliance * *force).dot(along) * arc.length;
        }
        change
    }

    /// Energy of shear and extension (J) beyond that of the contact force.
    #[inline(never)]
    pub fn strain_energy(&self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let mut energy = T::zero();
        for (i, p) in self.points.iter().enumerate() {
            energy -= p.pull.dot(p.g) * c.arc_length(i) * T::splat(0.5);
        }
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            energy -= tension * self.by_loads(c, holes);
        }
        energy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::load::{Model, TendonPath};
    use crate::model::robot::{Robot, Section, Tendon};
    use crate::parts;
    use crate::random::Draw;

    const STEP: f64 = 1e-5;
    const HOLE: [f64; 2] = [0.02, -0.013];
    const TENSIONS: [f64; 2] = [40.0, 15.0];

    /// A soft module: the tendons shorten it by a tenth.
    fn constants<const A: usize>() -> Constants<f64, A> {
        let section = Section {
            axial: 550.0,
            shear: 190.0,
            ..parts::section(0.11)
        };
        let mut spec = parts::robot(&[section], &[1], [0.07, 0.004], 0.0, &[0]);
        spec.tendons = vec![Tendon::parallel(HOLE, 0)];
        let robot = Robot::new(spec);
        Constants::new(&robot.unwrap(), 0, Model::default())
    }

    /// One tendon across the module, and one beside the backbone.
    const HOLES: [Holes<f64>; 2] = [
        Holes {
            start: [0.012, 0.015],
            end: HOLE,
            curve: None,
        },
        Holes {
            start: HOLE,
            end: HOLE,
            curve: None,
        },
    ];

    fn tendons(tensions: &[f64]) -> Tendons<'_, f64> {
        Tendons {
            holes: &HOLES,
            tensions,
            path: TendonPath::Continuous,
            on_nodes: &[],
        }
    }

    fn vector(draw: &mut Draw, size: f64) -> Vec3 {
        Vec3([0; 3].map(|_| draw.within(-size, size)))
    }

    /// Central differences of `f` along each axis, by columns.
    fn differences(f: impl Fn(Vec3) -> Vec3) -> Mat3 {
        Mat3([0, 1, 2].map(|axis| {
            let mut step = Vec3::zero();
            step[axis] = STEP;
            ((f(step) - f(-step)) * (0.5 / STEP)).0
        }))
        .transpose()
    }

    fn assert_near(found: Mat3, expected: Mat3, scale: f64) {
        let apart = (found - expected).rows().map(Vec3::max_abs);
        let most = apart.into_iter().fold(0.0, f64::max);
        assert!(
            most < 1e-8 * scale,
            "{found:?} against {expected:?}: {most}"
        );
    }

    fn derivatives_in_the_last_element<const A: usize>(number: usize) {
        let (c, t) = (constants::<A>(), tendons(&TENSIONS));
        let mut draw = Draw::new(32, number);
        let w = [0; A].map(|_| vector(&mut draw, 0.6 / A as f64));
        let (e, i) = (A / 2 - 1, A - 2);
        let element = |arc: usize, u: Vec3| {
            let mut w = w;
            w[arc] += u;
            PulledElement::new(&c, &t, e, &w)
        };
        let found = element(i, Vec3::zero());
        let energy = |arc, u| Vec3([element(arc, u).energy(&c, &t), 0.0, 0.0]);
        for (arc, gradient) in [i, i + 1].into_iter().zip(found.gradient()) {
            let by = differences(|u| energy(arc, u)).rows()[0];
            assert!((by - gradient).max_abs() < 1e-7, "{by:?}, {gradient:?}");
        }
        let [aa, ba, bb] = found.hessian();
        assert_near(differences(|u| element(i, u).gradient()[0]), aa, 1.0);
        assert_near(differences(|u| element(i, u).gradient()[1]), ba, 1.0);
        assert_near(differences(|u| element(i + 1, u).gradient()[1]), bb, 1.0);
        // an arc: its end, and the second derivatives of its parts along n
        let n = vector(&mut draw, 30.0);
        let arc = |u: Vec3| {
            let w = w[i] + u;
            (
                PulledArc::new(&c, &t, i, w),
                ArcMap::new(w, c.arc_length(i)),
            )
        };
        let (pulled, map) = arc(Vec3::zero());
        let end = |u| {
            let (pulled, map) = arc(u);
            map.end_along(pulled.chord)
        };
        assert_near(differences(end), pulled.end_jacobian(&map), 1.0);
        let by = |u| {
            let (pulled, map) = arc(u);
            pulled.end_jacobian(&map).tr_mul(n)
        };
        let hessian = pulled.hessian(&c, &t, &map, n, Vec3::zero());
        assert_near(differences(by), hessian, 10.0);
    }

    /// Derivatives of an element's energy and of an arc's end.
    #[test]
    fn derivatives_of_an_element() {
        for number in 0..13 {
            derivatives_in_the_last_element::<2>(number);
            derivatives_in_the_last_element::<4>(number);
            derivatives_in_the_last_element::<16>(number);
        }
    }

    /// On a stiff arc of constant curvature a continuous tendon has the length of the parallel arc.
    #[test]
    fn a_tendon_of_an_arc_is_the_parallel_arc() {
        let (c, t) = (constants::<2>(), tendons(&[0.0; 2]));
        for angle in [0.0, 0.1, -0.4, 1.2] {
            let mut state = State::<f64, 2>::straight();
            state.w = [Vec3([0.0, 0.5 * angle, 0.0]); 2];
            state.shape(&c, &t);
            let length = PulledModule::new(&state, &c, &t).length(&c, &HOLES[1]);
            // a bend about y shortens a tendon on the side of +x
            let expected = c.flexible + c.clamp[0] + c.clamp[1] - angle * HOLE[0];
            assert!((length - expected).abs() < 1e-12, "{angle}");
        }
    }

    /// The potential `elastic + pulled - f . rho`, whose derivatives are imbalance and lengths.
    fn potential<const A: usize>(tensions: [f64; 2], w: [Vec3; A], f: Vec3) -> State<f64, A> {
        let (c, t) = (constants::<A>(), tendons(&tensions));
        let mut state = State::straight();
        state.w = w;
        state.f[0] = f;
        state.shape(&c, &t);
        state.balance(&c, &t);
        state
    }

    /// A tendon's length is the derivative of the potential with respect to its tension, also where
    /// loads shear the section.
    #[test]
    fn lengths_are_derivatives_of_the_potential() {
        for number in 0..9 {
            let mut draw = Draw::new(33, number);
            let w = [0; 4].map(|_| vector(&mut draw, 0.2));
            let f = vector(&mut draw, 20.0);
            let c = constants::<4>();
            let state = potential(TENSIONS, w, f);
            let pulled = PulledModule::new(&state, &c, &tendons(&TENSIONS));
            for (i, holes) in HOLES.iter().enumerate() {
                let at = |step: f64| {
                    let mut tensions = TENSIONS;
                    tensions[i] += step;
                    potential(tensions, w, f).energy
                };
                let by_tension = (at(1e-3) - at(-1e-3)) / 2e-3;
                let length = pulled.length(&c, holes) - holes.beside_clamps(&c);
                assert!(
                    (length - by_tension).abs() < 1e-9,
                    "{length} against {by_tension}"
                );
            }
        }
    }
}
