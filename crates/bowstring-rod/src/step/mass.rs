//! Mass and inertia, lumped into points and disks.
//!
//! Theory: docs/theory/dynamics.md (Mass and coordinates).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::robot::{Payload, Robot};
use crate::rod::constants::Constants;

/// A vector at every mass point of a module, the disk last, and a matrix of the disk's directors.
#[derive(Clone, Copy)]
pub(super) struct Nodal<T, const A: usize> {
    pub points: [Vec3<T>; A],
    pub frame: Mat3<T>,
}

impl<T: Real, const A: usize> Nodal<T, A> {
    pub fn zero() -> Self {
        Nodal {
            points: [Vec3::zero(); A],
            frame: Mat3::zero(),
        }
    }

    #[inline(always)]
    pub fn disk(&self) -> Vec3<T> {
        self.points[A - 1]
    }

    /// `self * s + o * t`
    #[inline(always)]
    pub fn combined(&self, s: f64, o: &Self, t: f64) -> Self {
        let (s, t) = (T::splat(s), T::splat(t));
        let mut out = *o;
        for (out, own) in out.points.iter_mut().zip(self.points) {
            *out = own.scaled_add(s, *out * t);
        }
        out.frame = self.frame * s + o.frame * t;
        out
    }

    /// Copies the numbers of a lane.
    pub fn take_lane(&mut self, o: &Self, lane: usize) {
        for (own, other) in self.points.iter_mut().zip(&o.points) {
            own.take_lane(other, lane);
        }
        for (own, other) in self.frame.0.iter_mut().zip(&o.frame.0) {
            for (own, other) in own.iter_mut().zip(other) {
                own.set_lane(lane, other.lane(lane));
            }
        }
    }

    #[inline(always)]
    pub fn minus(&self, o: &Self) -> Self {
        self.combined(1.0, o, -1.0)
    }
}

/// Lumped mass: points from base to tip, the disk last in each module, and the directors of disks.
pub(super) struct LumpedMass<L: Layout, const A: usize> {
    /// Masses of the points (kg).
    pub points: Vec<f64>,
    /// Director inertia of the disks (kg m^2): of each director perpendicular to the axis, and of
    /// that along it.
    pub directors: Vec<[f64; 2]>,
    /// Masses of the points by groups of modules (kg).
    pub lanes: Vec<[L::Module; A]>,
    /// Total mass (kg).
    pub total: f64,
    /// Disks with payloads, and the sum of these.
    pub bodies: Vec<(usize, Body)>,
}

/// A rigid body fixed to a disk, by its moments about the centre of the disk in its frame.
#[derive(Clone, Copy)]
pub(super) struct Body {
    /// Mass (kg).
    pub mass: f64,
    /// Mass times the position of the centre of mass (kg m).
    pub first: Vec3,
    /// Second moments, the integral of x x' over the mass (kg m^2).
    pub second: Mat3,
}

impl Body {
    fn of(payload: &Payload) -> Self {
        let [a, b, c] = payload.inertia;
        let own = [b + c - a, c + a - b, a + b - c].map(|twice| f64::max(0.5 * twice, 0.0));
        let centre = Vec3(payload.centre);
        let first = centre * payload.mass;
        Body {
            mass: payload.mass,
            first,
            second: first.outer(centre).add_diagonal(own),
        }
    }

    fn add(&mut self, o: &Body) {
        self.mass += o.mass;
        self.first += o.first;
        self.second += o.second;
    }

    /// Tensor of inertia about the centre of the disk (kg m^2).
    pub fn inertia(&self) -> Mat3 {
        let [a, b, c] = [0, 1, 2].map(|q| self.second.0[q][q]);
        (-self.second).add_diagonal([a + b + c; 3])
    }

    /// Mass-weighted inner product of two vectors of a disk.
    #[inline(always)]
    fn product<T: Real, const A: usize>(&self, u: &Nodal<T, A>, v: &Nodal<T, A>) -> T {
        let (p, q) = (u.disk(), v.disk());
        let (first, second) = (wide(self.first), Mat3::splat(&self.second));
        let mut sum = p.dot(q) * T::splat(self.mass);
        sum += p.dot(v.frame * first) + q.dot(u.frame * first);
        let weighted = u.frame * second;
        for (a, b) in weighted.rows().into_iter().zip(v.frame.rows()) {
            sum += a.dot(b);
        }
        sum
    }
}

/// The same vector in all lanes.
#[inline(always)]
pub(super) fn wide<T: Real>(v: Vec3) -> Vec3<T> {
    Vec3::splat(v.0)
}

impl<L: Layout, const A: usize> LumpedMass<L, A> {
    /// Lumps the mass by Simpson's rule over each pair of arcs. A clamp has the mean mass per length of
    /// the flexible part, and the disk the rest. The clamp's mass, and that of the node where it begins, is
    /// added to the clamp's disk, to which it is rigidly connected; its second moment is added to
    /// the director along the axis. Its first moment is zero where both sides of a disk are equal.
    /// Elsewhere, as at the last disk, it is neglected: it would couple points with directors, and
    /// `M` is diagonal.
    pub fn new(robot: &Robot, modules: &[Constants<L::Chain, A>]) -> Self {
        let n = robot.module_count();
        let mut points = vec![0.0; n * A];
        let mut directors = vec![[0.0; 2]; n];
        for k in 0..n {
            let module = robot.modules[k];
            let c = &modules[k];
            let section = |a: usize| robot.section(k, c.fraction(a).lane(0));
            let arc = module.flexible / A as f64;
            let lump = |a: usize| section(a).mass_per_length * arc / 3.0 * c.simpson(a).lane(0);
            for a in 1..=A {
                points[k * A + a - 1] += lump(a);
            }
            let disk = &robot.spec().disks[k];
            let held = module.flexible / 2.0 + module.clamp[1];
            let [across, along] = disk.inertia;
            let rotary = section(A).rotary_inertia * held;
            directors[k][0] += along / 2.0 + rotary;
            let clamped = robot.mass_per_length(k);
            let second =
                |a: usize, clamp: f64| clamped * clamp.powi(3) / 3.0 + lump(a) * clamp.powi(2);
            directors[k][1] += f64::max(across - along / 2.0, 0.0) + second(A, module.clamp[1]);
            points[k * A + A - 1] += robot.disk_mass[k] + clamped * module.clamp[1];
            if k > 0 {
                let held = module.flexible / 2.0 + module.clamp[0];
                directors[k - 1][0] += section(0).rotary_inertia * held;
                directors[k - 1][1] += second(0, module.clamp[0]);
                points[k * A - 1] += lump(0) + clamped * module.clamp[0];
            }
        }
        let mut lanes = vec![[L::Module::zero(); A]; n.div_ceil(L::WIDTH)];
        for k in 0..n {
            for a in 0..A {
                let place = &mut lanes[k / L::WIDTH][a];
                L::put(place, k % L::WIDTH, L::Chain::splat(points[k * A + a]));
            }
        }
        let mut bodies: Vec<(usize, Body)> = vec![];
        for payload in &robot.spec().payloads {
            let body = Body::of(payload);
            match bodies.iter_mut().find(|(disk, _)| *disk == payload.disk) {
                Some((_, sum)) => sum.add(&body),
                None => bodies.push((payload.disk, body)),
            }
        }
        let of_bodies: f64 = bodies.iter().map(|(_, body)| body.mass).sum();
        LumpedMass {
            lanes,
            total: points.iter().sum::<f64>() + of_bodies,
            points,
            directors,
            bodies,
        }
    }

    /// Payload of a disk.
    #[inline(always)]
    pub fn body(&self, disk: usize) -> Option<&Body> {
        let found = self.bodies.iter().find(|(k, _)| *k == disk);
        found.map(|(_, body)| body)
    }

    /// Mass-weighted inner product of two vectors of a module.
    #[inline(always)]
    pub fn product(&self, k: usize, u: &Nodal<L::Chain, A>, v: &Nodal<L::Chain, A>) -> L::Chain {
        let splat = L::Chain::splat;
        let mut sum = L::Chain::zero();
        for a in 0..A {
            sum += u.points[a].dot(v.points[a]) * splat(self.points[k * A + a]);
        }
        let [e1, e3] = self.directors[k].map(splat);
        for (u, v) in u.frame.0.iter().zip(&v.frame.0) {
            sum += (u[0] * v[0] + u[1] * v[1]) * e1 + u[2] * v[2] * e3;
        }
        if !self.bodies.is_empty() {
            sum += self.product_of_body(k, u, v);
        }
        sum
    }

    #[cold]
    fn product_of_body(
        &self,
        k: usize,
        u: &Nodal<L::Chain, A>,
        v: &Nodal<L::Chain, A>,
    ) -> L::Chain {
        self.body(k)
            .map_or(L::Chain::zero(), |body| body.product(u, v))
    }

    /// Mass-weighted sum of a vector over all points.
    #[inline(always)]
    pub fn sum(&self, vectors: &[Nodal<L::Chain, A>]) -> Vec3<L::Chain> {
        let mut sum = Vec3::zero();
        for (k, v) in vectors.iter().enumerate() {
            for a in 0..A {
                sum += v.points[a] * L::Chain::splat(self.points[k * A + a]);
            }
        }
        for (k, body) in &self.bodies {
            let v = &vectors[*k];
            sum += v.disk() * L::Chain::splat(body.mass) + v.frame * wide(body.first);
        }
        sum
    }
}
