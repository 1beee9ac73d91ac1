//! Defect of a module's elements in the differential equations of the rod.
//!
//! Theory: docs/theory/statics.md (Discretisation error).
//!
//! Every element is integrated backward from its end (theory Eq. 2.1 and 3.5), under the wrench of
//! loads and tendons there, by a sixth-order Runge-Kutta method: with shear, extension and weight
//! at every section, and without the assumptions of the elements. The difference at the start of
//! the element is the defect of the element's strain.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::rod::constants::{Constants, Stiffness, Taper};
use crate::rod::continuous::PulledSection;
use crate::rod::coupling::Coupling;
use crate::rod::routes::Tendons;
use crate::rod::state::{Gradient, State};

/// Distance of the ends of a module, over its length, below which it counts as folded.
const FOLDED: f64 = 0.8;

/// Defect of a module, in the frame of its start.
#[derive(Clone, Copy)]
pub struct Defect<T> {
    /// Displacement of the end that the strain of the elements cannot represent (m).
    pub place: Vec3<T>,
    /// Moment about the start that the quadrature of the weight omits (N m).
    pub moment: Vec3<T>,
    /// Compression number: compressive force times squared length over bending stiffness.
    pub compression: T,
    /// Positive where the module has folded.
    pub folded: T,
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

/// Integration steps in an element: two orders above it, so that their own error is negligible.
const STEPS: usize = 2;

/// A section of the backbone: its pose, and the internal moment on it.
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

/// Weight of a module, and how its backbone is tapered.
#[derive(Clone, Copy)]
pub struct Weight<'a, T, const A: usize> {
    /// Mean weight per length (N/m), that of `mass_per_length`, and other forces per length.
    mean: Vec3<T>,
    /// Gravity (m/s^2), for the change of the weight along a tapered module.
    gravity: Vec3<T>,
    taper: Option<&'a Taper<T>>,
    /// Loads between the disks, if there are any.
    pub on_nodes: Option<&'a LoadsOnNodes<T, A>>,
}

/// Loads between two disks beside their forces, on the nodes before the elements in the frame of the
/// start of the module.
pub struct LoadsOnNodes<T, const A: usize> {
    /// Moments (N m).
    pub moments: [Vec3<T>; A],
    /// Couples on the tangents (N m) by Hermite's rule of the weight.
    pub couples: [Vec3<T>; A],
}

impl<'a, T: Real, const A: usize> Weight<'a, T, A> {
    pub fn new(mean: Vec3<T>, gravity: Vec3<T>, taper: Option<&'a Taper<T>>) -> Self {
        Weight {
            mean,
            gravity,
            taper,
            on_nodes: None,
        }
    }
}

/// What a section of the backbone is made of.
#[derive(Clone, Copy)]
struct Material<T> {
    /// Moment by curvature (N m^2), and its inverse.
    stiffness: Stiffness<T>,
    flexibility: Stiffness<T>,
    /// Shear and extension by force (1/N).
    shear: T,
    axial: T,
}

/// Properties and loads of one element; `VARIED`: it may be tapered, have coupled strains, or keep
/// a curvature.
struct Element<'a, T: Real, const A: usize, const VARIED: bool> {
    /// Mean of the module.
    material: Material<T>,
    taper: Option<&'a Taper<T>>,
    /// Curvature and twist without load at the start of the module (1/m), and their change along
    /// this element (1/m^2).
    rest_line: [Vec3<T>; 2],
    tendons: &'a Tendons<'a, T>,
    constants: &'a Constants<T, A>,
    /// Mean weight per length (N/m).
    weight: Vec3<T>,
    /// Gravity (m/s^2).
    gravity: Vec3<T>,
}

impl<T: Real, const A: usize, const VARIED: bool> Element<'_, T, A, VARIED> {
    /// Material at a distance from the start of the module (m).
    #[inline(always)]
    fn material(&self, at: T) -> Material<T> {
        let (true, Some(taper)) = (VARIED, self.taper) else {
            return self.material;
        };
        let (stiffness, shear, axial) = taper.at(at * self.constants.per_flexible);
        Material {
            stiffness,
            flexibility: stiffness.inverse(),
            shear,
            axial,
        }
    }

    /// Curvature and twist without load (1/m), at a distance from the start of the module (m).
    #[inline(always)]
    fn rest(&self, at: T) -> Vec3<T> {
        if VARIED {
            self.rest_line[1].scaled_add(at, self.rest_line[0])
        } else {
            self.rest_line[0]
        }
    }

    /// Force of the weight between two distances from the start of the module (N).
    #[inline(always)]
    fn weight_between(&self, from: T, to: T) -> Vec3<T> {
        let (c, mut weight) = (self.constants, self.weight);
        if let (true, Some(taper)) = (VARIED, self.taper) {
            let [line, parabola] = taper.mass;
            let middle = (from + to) * T::splat(0.5) * c.per_flexible - T::splat(0.5);
            let part = (to - from) * c.per_flexible;
            let square = middle * middle + (part * part - T::splat(1.0)) * T::splat(1.0 / 12.0);
            weight = self
                .gravity
                .scaled_add(line * middle + parabola * square, weight);
        }
        weight * (to - from)
    }

    /// Curvature and twist, and the strain along the backbone, under a moment and a force in body
    /// axes.
    #[inline(always)]
    fn strain(
        &self,
        material: &Material<T>,
        moment: Vec3<T>,
        force: Vec3<T>,
        at: T,
    ) -> (Vec3<T>, Vec3<T>) {
        let rest = self.rest(at);
        let mut u = rest + material.flexibility.times(moment);
        let compliance = [material.shear, material.axial];
        if self.tendons.are_continuous() {
            // continuous tendons carry part of moment and force, which depends on the strain
            let section = |u: Vec3<T>| {
                PulledSection::new(self.constants, self.tendons, compliance, at, u, force)
            };
            for _ in 0..NEWTON_ROUNDS {
                let section = section(u);
                let residual = moment - material.stiffness.times(u - rest) - section.moment;
                u += material.stiffness.plus_mat(section.stiffness()).inverse() * residual;
            }
            return (u, Vec3::ez() + section(u).g);
        }
        let [shear, axial] = compliance;
        let along = Vec3([
            force[0] * shear,
            force[1] * shear,
            force[2].mul_add(axial, T::splat(1.0)),
        ]);
        (u, along)
    }

    #[inline(always)]
    fn rate(&self, at: &Section<T>, force: Vec3<T>, from_start: T) -> Section<T> {
        let r = &at.rotation;
        if T::PLAIN {
            if let (true, Some(coupling)) = (VARIED, self.constants.coupling()) {
                return self.coupled_rate(coupling, at, force);
            }
        }
        let material = self.material(from_start);
        let (moment, n) = (r.tr_mul(at.moment), r.tr_mul(force));
        let (curvature, along) = self.strain(&material, moment, n, from_start);
        let along = *r * along;
        Section {
            rotation: r.mul_skew(curvature),
            place: along,
            moment: -along.cross(force),
        }
    }

    /// The rate of a coupled section.
    #[cold]
    #[inline(never)]
    fn coupled_rate(&self, coupling: &Coupling<T>, at: &Section<T>, force: Vec3<T>) -> Section<T> {
        let r = &at.rotation;
        let n = r.tr_mul(force);
        let moment = r.tr_mul(at.moment) + coupling.shift.tr_mul(n);
        let curvature = self.rest_line[0] + coupling.flexibility * moment;
        let along = *r * (coupling.along + coupling.shift * curvature + coupling.compliance * n);
        Section {
            rotation: r.mul_skew(curvature),
            place: along,
            moment: -along.cross(force),
        }
    }

    /// Integrates backward from the end of an element, where `force` acts, to its start, both as
    /// distances from the start of the module (m).
    #[inline(always)]
    fn back(&self, end: Section<T>, force: Vec3<T>, [from, to]: [T; 2]) -> Section<T> {
        let (length, from_start) = (to - from, to);
        let h = length * T::splat(-1.0 / STEPS as f64);
        let mut at = end;
        let (mut force, mut from_start) = (force, from_start);
        for _ in 0..STEPS {
            let mut rates = [end; 7];
            // unrolled: constant weights make a warm sweep 4 % faster than a loop
            rates[0] = self.stage::<0>(&at, &rates, (force, from_start), h);
            rates[1] = self.stage::<1>(&at, &rates, (force, from_start), h);
            rates[2] = self.stage::<2>(&at, &rates, (force, from_start), h);
            rates[3] = self.stage::<3>(&at, &rates, (force, from_start), h);
            rates[4] = self.stage::<4>(&at, &rates, (force, from_start), h);
            rates[5] = self.stage::<5>(&at, &rates, (force, from_start), h);
            rates[6] = self.stage::<6>(&at, &rates, (force, from_start), h);
            at = at.plus_weighted(&rates, WEIGHTS, h);
            force += self.weight_between(from_start + h, from_start);
            from_start += h;
        }
        at
    }

    #[inline(always)]
    fn stage<const I: usize>(
        &self,
        at: &Section<T>,
        rates: &[Section<T>; 7],
        (force, from_start): (Vec3<T>, T),
        h: T,
    ) -> Section<T> {
        let (place, weights) = STAGES[I];
        let here = at.plus_weighted(rates, weights, h);
        let there = h.mul_add(T::splat(place), from_start);
        self.rate(&here, force + self.weight_between(there, from_start), there)
    }
}

/// Stages of Butcher's sixth-order method (1964): position of each stage, and its weights of the
/// earlier rates.
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

/// Rotation of an element, at whose middle the section has this orientation, due to a mean moment.
/// Not a closure: one that is not inlined is compiled without the processor's SIMD instructions.
#[inline(always)]
fn bent<T: Real>(moment: Vec3<T>, at: &Mat3<T>, spring: &Stiffness<T>) -> Vec3<T> {
    *at * spring.times(at.tr_mul(moment))
}

/// Newton iterations for the curvature under continuous tendons.
const NEWTON_ROUNDS: usize = 3;

impl<T: Real, const A: usize> State<T, A> {
    /// Computes the defect. `rhs` becomes the imbalance of the arcs whose Newton step removes the
    /// defects of their strain and their own residual. `VARIED`: the module may be tapered, have
    /// coupled strains, or keep a curvature.
    #[inline(always)]
    pub fn defect<const VARIED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        gradient: &Gradient<T, A>,
        load: &Weight<T, A>,
        rhs: &mut [Vec3<T>; A],
    ) -> Defect<T> {
        let elements = A / 2;
        let mean_length = c.flexible * T::splat(1.0 / elements as f64);
        let mean_per = T::splat(1.0) / mean_length;
        let weight = load.mean;
        let [shear, axial] = c.compliance;
        let stiffness = c.mutual(0).scaled(T::splat(4.0) * mean_length * c.part(0));
        let mut element = Element::<T, A, VARIED> {
            material: Material {
                stiffness,
                flexibility: stiffness.inverse(),
                shear,
                axial,
            },
            taper: load.taper,
            rest_line: c.rest_line(0),
            tendons: t,
            constants: c,
            weight,
            gravity: load.gravity,
        };
        // force and couples by which the change of the weight was replaced
        let (shift, turns) = match load.taper {
            Some(taper) if VARIED => taper.lumped(c.flexible, load.gravity),
            _ => (Vec3::zero(), [Vec3::zero(); 2]),
        };
        let tangent = self.s.column(2);
        // exact moment and force of the weight, instead of Hermite's rule
        let twelfth = T::splat(1.0 / 12.0);
        let last = mean_length * c.part(elements - 1);
        let couple = weight.scaled_add(last * last * twelfth, self.f[1]) - turns[1];
        let mut force = weight.scaled_add(last * T::splat(-0.5), self.end_force) - shift;
        let mut section = Section {
            rotation: self.s,
            place: self.rho,
            moment: tangent.cross(couple) - self.span_torque - self.lambda,
        };
        let mut place = Vec3::zero();
        for e in (0..elements).rev() {
            let length = mean_length * c.part(e);
            let per = T::splat(1.0) / length;
            let [from, to] = [2 * e, 2 * e + 2].map(|arcs| c.flexible * c.fraction(arcs));
            let end = section.place;
            if VARIED {
                element.rest_line = c.rest_line(e);
            }
            section = element.back(section, force, [from, to]);
            let (rotation, start) = match e {
                0 => (Mat3::identity(), Vec3::zero()),
                _ => (self.arcs[2 * e].prefix, self.inside(c, 2 * e - 1)),
            };
            // distance of the ends after a rotation that aligns the starts
            let turned = rotation * section.rotation.transpose();
            let [x, y, z] = turned.rows();
            let turn = Vec3([z[1] - y[2], x[2] - z[0], y[0] - x[1]]) * T::splat(0.5);
            let gap = start + turned * (end - section.place) - end;
            let along = (end - start) * per;
            // The integrated curve deviates from the element by about a cubic and rotates with its
            // slope: force and moment bend it further through both. The tangent already contains
            // that part.
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
            let at = self.arcs[2 * e + 1].prefix;
            // mean stiffness of the Gauss points
            let spring = c.mutual(e).scaled(T::splat(4.0)).inverse();
            let turn = turn - bent(mean.cross(middle) + turned[0].cross(moment), &at, &spring);
            let gap = gap
                - bent(first.cross(middle) + turned[1].cross(moment), &at, &spring).cross(along)
                    * length;
            // rotations of the two arcs that produce it
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
            let moments = c.moments_of_element(e, [a, b]);
            rhs[i] = gradient.g[i] - gradient.to_strain[i].tr_mul(moments[0]);
            rhs[j] = gradient.g[j] - gradient.to_strain[j].tr_mul(moments[1]);
            // continue from the solver's pose
            force += element.weight_between(from, to);
            section.moment += (section.place - start).cross(force);
            section.rotation = rotation;
            section.place = start;
            if let (Some(own), true) = (load.on_nodes, e > 0) {
                force += t.on_nodes[e];
                section.moment += own.moments[e];
            }
        }
        let force = self.f[0] - self.end_force;
        let exact = section.moment + self.rho.cross(force) + self.span_torque;
        let mut assumed = self.rho.cross(self.f[0]) + tangent.cross(self.f[1]) - self.lambda;
        // Hermite's couple at the start is stored with the clamp's weight
        let first = mean_length * c.part(0);
        assumed += Vec3::ez().cross(weight * (first * first * twelfth) + turns[0]);
        for node in 1..elements {
            let place = self.inside(c, 2 * node - 1);
            assumed += place.cross(self.node_load(c, t.on_nodes, node));
        }
        // from the force on the end; its component along a chord falls as the module folds
        let flexibility = c.largest_flexibility() * mean_per;
        let mut push = -self.n.dot(self.rho);
        if let Some(own) = load.on_nodes {
            let mut contact = self.end_force;
            push = push.max(-contact.dot(self.rho));
            for node in (1..elements).rev() {
                assumed += own.moments[node] + self.node(node).column(2).cross(own.couples[node]);
                contact += t.on_nodes[node];
                push = push.max(-contact.dot(self.rho));
            }
            // the longest element counts as if all were as long
            push = push * c.longest_part();
        }
        let compression = push * c.flexible * flexibility;
        let chord = T::splat(FOLDED * FOLDED) * c.flexible * c.flexible - self.rho.norm2();
        Defect {
            place,
            moment: exact - assumed,
            compression,
            folded: chord,
        }
    }
}
