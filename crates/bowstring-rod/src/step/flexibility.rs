//! Small motions about a rest: displacement response of all mass to forces.
//!
//! Theory: docs/theory/dynamics.md (Modal analysis).

use super::mass::LumpedMass;
use super::motion::Motion;
use super::moving::Moving;
use crate::interrupt;
use crate::math::linalg::{dot, principal_axes, Mat3, Vec3};
use crate::math::mlcp::eliminate;
use crate::math::real::Scalar;
use crate::rod::routed::RoutedRod;

/// Spans of a tendon that keep their total length in small oscillations.
pub struct Lock {
    pub tendon: usize,
    /// Tension of each module's span for a unit tension of the lock.
    pub spans: Vec<f64>,
    /// Compliance (m/N).
    pub compliance: f64,
}

/// A linearised state of rest.
pub struct Rest<const A: usize> {
    /// Forces on points (N) and moments on disks (N m).
    force: Vec<Vec3>,
    moment: Vec<Vec3>,
    /// Residual imbalance of arcs and contact forces due to rounding.
    gradients: Vec<[Vec3; A]>,
    deltas: Vec<Vec3>,
    /// Displacement by locks and degrees of freedom, for a unit tension of the lock (m/N).
    moved: Vec<f64>,
    /// Inverse of the matrix of lock lengths with respect to lock tensions (N/m).
    inverse: Vec<f64>,
}

/// Mass of a disk with its payload, about their common centre of mass.
struct CentralFrame {
    mass: f64,
    /// Centre of mass from the centre of the disk, in the frame of the disk (m).
    centre: Vec3,
    /// Principal axes, as columns, and moments of inertia (kg m^2).
    axes: Mat3,
    inertia: [f64; 3],
}

impl CentralFrame {
    fn of<const A: usize>(mass: &LumpedMass<Scalar, A>, k: usize) -> Self {
        let (point, [e1, e3]) = (mass.points[k * A + A - 1], mass.directors[k]);
        let own = [e1 + e3, e1 + e3, 2.0 * e1];
        let Some(body) = mass.body(k) else {
            return CentralFrame {
                mass: point,
                centre: Vec3::zero(),
                axes: Mat3::identity(),
                inertia: own,
            };
        };
        let total = point + body.mass;
        let centre = match total > 0.0 {
            true => body.first * (1.0 / total),
            false => Vec3::zero(),
        };
        let shift = (centre * total).outer(centre);
        let about_disk = body.inertia().add_diagonal(own);
        let trace = centre.norm2() * total;
        let (inertia, axes) = principal_axes((about_disk + shift).add_diagonal([-trace; 3]));
        CentralFrame {
            mass: total,
            centre,
            axes,
            inertia: inertia.map(|x| x.max(0.0)),
        }
    }
}

impl<const A: usize> Rest<A> {
    /// Subtracts from a displacement the part that locked tendons prevent.
    fn hold(&self, forces: &[f64], displacement: &mut [f64]) {
        let size = forces.len();
        // by reciprocity, the displacement due to a tension gives the length change due to a force
        let moved = self.moved.chunks_exact(size);
        let longer: Vec<_> = moved.clone().map(|moved| dot(moved, forces)).collect();
        let rows = self.inverse.chunks_exact(longer.len().max(1));
        for (row, moved) in rows.zip(moved) {
            let tension = -dot(row, &longer);
            for (to, by_tension) in displacement.iter_mut().zip(moved) {
                *to += tension * by_tension;
            }
        }
    }
}

impl<const A: usize> Motion<Scalar, A> {
    /// Finds the equilibrium under the present forces, from the present strain.
    pub fn settle(&mut self) -> bool {
        self.begin_at_rest();
        for _ in 0..30 {
            if self.residual() < 1e-10 * self.body.constants[0].own[0].bending[0] {
                self.commit_at_rest(0.0);
                return true;
            }
            self.ready(true);
            self.substitute();
            self.combine(&[1.0]);
        }
        false
    }

    /// Mass of every degree of freedom (kg and kg m^2).
    pub fn masses_of_freedoms(&self) -> Vec<f64> {
        let mass = &self.body.mass;
        let mut masses = vec![];
        for (k, points) in mass.points.chunks_exact(A).enumerate() {
            let frame = CentralFrame::of(mass, k);
            for m in &points[..A - 1] {
                masses.extend([*m; 3]);
            }
            masses.extend([frame.mass; 3]);
            masses.extend(frame.inertia);
        }
        masses
    }

    /// Motion of the disks with payloads by their degrees of freedom: displacement in the base frame
    /// and rotation in the disk's.
    pub fn motion_of_loaded_disks(&self) -> Vec<(usize, [[f64; 6]; 6])> {
        let mass = &self.body.mass;
        let of = |(k, _): &(usize, _)| {
            let frame = CentralFrame::of(mass, *k);
            let turned = self.body.rod.rotations[k + 1] * frame.centre.skew() * frame.axes;
            let mut motion = [[0.0; 6]; 6];
            for r in 0..3 {
                motion[r][r] = 1.0;
                for c in 0..3 {
                    motion[r][3 + c] = turned.0[r][c];
                    motion[3 + r][3 + c] = frame.axes.0[r][c];
                }
            }
            (*k, motion)
        };
        mass.bodies.iter().map(of).collect()
    }

    /// Prepares [`Self::respond_to_forces`] at the rest found by `settle`. Locked tendons keep
    /// their lengths except for their own elongation. `None` where the linearised equations are singular.
    pub fn linearise_at_rest(&mut self, locks: &[Lock]) -> Option<Rest<A>> {
        self.begin_at_rest();
        self.residual();
        self.linearise();
        let mut rest = Rest {
            force: self.residual.force.clone(),
            moment: self.residual.moment.clone(),
            gradients: self.body.rod.gradients.iter().map(|g| g.g).collect(),
            deltas: self.residual.modules.iter().map(|m| m.imbalance).collect(),
            moved: vec![],
            inverse: vec![],
        };
        self.lock(locks, &mut rest).then_some(rest)
    }

    /// Displacement of every degree of freedom due to forces on all of them: m and rad for N and N
    /// m. The degrees of freedom are the translation of points from base to tip in the base frame
    /// and, after that of each disk, its rotation in its own frame. The point of a disk with a
    /// payload is their common centre of mass, and the axes of its rotation are principal axes.
    pub fn respond_to_forces(&mut self, forces: &[f64], rest: &Rest<A>) -> Vec<f64> {
        let (n, per) = (self.module_count(), 3 * A + 3);
        // scaled: very small forces would be lost beside those of the rest
        let largest = forces.iter().fold(0.0, |m: f64, f| m.max(f.abs()));
        if largest == 0.0 {
            return vec![0.0; forces.len()];
        }
        for k in 0..n {
            let vector = |at: usize| {
                let v = &forces[k * per + 3 * at..][..3];
                Vec3([v[0], v[1], v[2]]) * (1.0 / largest)
            };
            for a in 0..A {
                self.residual.force[k * A + a] = rest.force[k * A + a] + vector(a);
            }
            let rotation = self.body.rod.rotations[k + 1];
            let mut moment = vector(A);
            if self.body.mass.body(k).is_some() {
                let frame = CentralFrame::of(&self.body.mass, k);
                let force = rotation.tr_mul(vector(A - 1));
                moment = frame.axes * moment + frame.centre.cross(force);
            }
            self.residual.moment[k] = rest.moment[k] + rotation * moment;
        }
        self.imbalance();
        for j in 0..n {
            for a in 0..A {
                self.body.rod.gradients[j].g[a] -= rest.gradients[j][a];
            }
            self.residual.modules[j].imbalance -= rest.deltas[j];
        }
        self.substitute();
        let mut out = self.displacement(0);
        for v in &mut out {
            *v *= largest;
        }
        rest.hold(forces, &mut out);
        out
    }

    /// Computes the response of the locked tendons; false where it is singular.
    fn lock(&mut self, locks: &[Lock], rest: &mut Rest<A>) -> bool {
        self.measure_spans(false);
        let (n, m) = (self.module_count(), locks.len());
        let mut problem = vec![0.0; 2 * m * m];
        for (c, lock) in locks.iter().enumerate() {
            if interrupt::work(self.work() + n * m) {
                return false;
            }
            let source = (lock.tendon, &lock.spans[..]);
            let (body, tangent) = (&self.body, &mut self.tangent);
            self.response.solve_tension(&body.rod, tangent, 1, source);
            self.response.rate_spans(body, tangent, 1);
            rest.moved.extend(self.displacement(1));
            let rates = &self.response.columns[1].rates;
            for (r, row) in locks.iter().enumerate() {
                let spans = row.spans.iter().enumerate();
                let longer: f64 = spans.map(|(k, s)| s * rates[row.tendon * n + k]).sum();
                problem[r * 2 * m + c] = -longer;
            }
            problem[c * 2 * m + c] += lock.compliance;
            problem[c * 2 * m + m + c] = 1.0;
        }
        if !eliminate(&mut problem, m) {
            return false;
        }
        for row in problem.chunks_exact(2 * m.max(1)) {
            rest.inverse.extend(&row[m..]);
        }
        true
    }

    /// Displacement of all degrees of freedom for the last solution.
    fn displacement(&self, column: usize) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.module_count() * (3 * A + 3));
        let mut start = [Vec3::zero(); 2];
        let column = &self.response.columns[column];
        let rod = &self.body.rod;
        for (j, (state, c)) in rod.states.iter().zip(&rod.constants).enumerate() {
            let frame = self.body.rod.rotations[j];
            // motion of the end due to shear and extension
            let mut stretched = column.delta[j];
            for i in 0..A {
                let lever = self.tangent.contact[j].j[i] - self.body.rod.gradients[j].r[i];
                stretched += lever * column.u[j][i];
            }
            for a in 0..A - 1 {
                let mut place = state.inside(c, a);
                place.0[2] += self.body.rod.fixed.modules[j].clamp[0];
                let mut moved = start[1] + start[0].cross(place);
                moved += stretched * c.share(a);
                for i in 0..=a {
                    let lever = self.body.rod.gradients[j].r[i] + state.tail[a].skew();
                    moved += lever * column.u[j][i];
                }
                out.extend((frame * moved).0);
            }
            start = column.disks[j];
            let [mut turn, mut moved] = start;
            if self.body.mass.body(j).is_some() {
                let frame = CentralFrame::of(&self.body.mass, j);
                moved += turn.cross(frame.centre);
                turn = frame.axes.tr_mul(turn);
            }
            out.extend((self.body.rod.rotations[j + 1] * moved).0);
            out.extend(turn.0);
        }
        out
    }
}
