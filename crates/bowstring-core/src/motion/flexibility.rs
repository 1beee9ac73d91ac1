//! Small motions about a rest: how all mass answers forces.

use super::Motion;
use crate::complementarity::Complementarity;
use crate::linalg::Vec3;
use crate::module::share;
use crate::real::Scalar;

/// Spans of a tendon that do not let it slip, together, in small oscillations.
pub(crate) struct Lock {
    pub tendon: usize,
    /// Tension by modules of one newton.
    pub spans: Vec<f64>,
    /// Stretch, m/N.
    pub compliance: f64,
}

impl<const A: usize> Motion<Scalar, A> {
    /// Finds the equilibrium under the present forces from the strain at hand.
    pub fn settle(&mut self) -> bool {
        self.begin_at_rest();
        for _ in 0..30 {
            if self.residual() < 1e-10 * self.constants[0].stiffness[0] {
                self.commit_at_rest(0.0);
                return true;
            }
            self.ready(true);
            self.substitute(0, None);
            self.combine(&[1.0]);
        }
        false
    }

    /// How all mass answers forces at rest: displacement of every freedom by a unit force on
    /// every other, m/N and so on, and the mass of every freedom. Freedoms are the translation
    /// of points from base to tip, base frame, and after that of each disk its rotation, in
    /// its own frame. Locked tendons keep their lengths but for their own stretch.
    /// None where that has no answer.
    pub fn flexibility(&mut self, locks: &[Lock]) -> Option<(Vec<f64>, Vec<f64>)> {
        let n = self.module_count();
        let per = 3 * A + 3;
        let size = n * per;
        let mut masses = vec![0.0; size];
        for k in 0..n {
            let [e1, e3] = self.directors[k];
            for a in 0..A {
                masses[k * per + 3 * a..][..3].fill(self.masses[k * A + a]);
            }
            masses[k * per + 3 * A..][..3].copy_from_slice(&[e1 + e3, e1 + e3, 2.0 * e1]);
        }
        self.begin_at_rest();
        self.residual();
        self.linearise();
        let mut matrix = vec![0.0; size * size];
        let (force, moment) = (self.force.clone(), self.moment.clone());
        let still: Vec<_> = self.rod.gradients.iter().map(|g| g.g).collect();
        let still_delta: Vec<_> = self.inertia.iter().map(|i| i.g_delta).collect();
        for column in 0..size {
            let (k, within, axis) = (column / per, column % per / 3, column % 3);
            let mut unit = Vec3::zero();
            unit[axis] = 1.0;
            self.force.copy_from_slice(&force);
            self.moment.copy_from_slice(&moment);
            if within < A {
                self.force[k * A + within] += unit;
            } else {
                self.moment[k] += self.rod.rotations[k + 1] * unit;
            }
            self.imbalance();
            for j in 0..n {
                for a in 0..A {
                    self.rod.gradients[j].g[a] -= still[j][a];
                }
                self.inertia[j].g_delta -= still_delta[j];
            }
            self.substitute(0, None);
            let moved = self.displacement(0);
            for (row, v) in moved.iter().enumerate() {
                matrix[row * size + column] = *v;
            }
        }
        self.force = force;
        self.moment = moment;
        self.lock(locks, &mut matrix).then_some((matrix, masses))
    }

    /// Takes off a flexibility what locked tendons hold.
    fn lock(&mut self, locks: &[Lock], matrix: &mut [f64]) -> bool {
        self.rod.measure_spans(false);
        let n = self.module_count();
        let mut moved = vec![];
        let mut problem = Complementarity::default();
        problem.resize(locks.len());
        for (c, lock) in locks.iter().enumerate() {
            self.substitute(1, Some((lock.tendon, &lock.spans)));
            self.rate_spans(1);
            moved.push(self.displacement(1));
            let rates = &self.columns[1].rates;
            for (r, row) in locks.iter().enumerate() {
                let spans = row.spans.iter().enumerate();
                let longer: f64 = spans.map(|(k, s)| s * rates[row.tendon * n + k]).sum();
                problem.matrix[r * locks.len() + c] = -longer;
            }
            problem.matrix[c * locks.len() + c] += lock.compliance;
        }
        let size = moved.first().map_or(0, Vec::len);
        for column in 0..size {
            // by reciprocity a tension's displacement tells what a force does to the length
            for (q, by_tension) in problem.q.iter_mut().zip(&moved) {
                *q = by_tension[column];
            }
            if !problem.solve() {
                return false;
            }
            for (tension, by_tension) in problem.z.iter().zip(&moved) {
                for (row, v) in by_tension.iter().enumerate() {
                    matrix[row * size + column] += tension * v;
                }
            }
        }
        true
    }

    /// Displacement of all freedoms by an answer, the one that was found last.
    fn displacement(&self, column: usize) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.module_count() * (3 * A + 3));
        let mut start = [Vec3::zero(); 2];
        for (j, state) in self.rod.states.iter().enumerate() {
            let frame = self.rod.rotations[j];
            // what shear and extension add to the motion of the end
            let mut stretched = self.columns[column].delta[j];
            for i in 0..A {
                let lever = self.inertia[j].j[i] - self.rod.gradients[j].r[i];
                stretched += lever * self.columns[column].u[j][i];
            }
            for a in 0..A - 1 {
                let mut place = state.inside(a);
                place.0[2] += self.rod.modules[j].clamp[0];
                let mut moved = start[1] + start[0].cross(place);
                moved += stretched * share::<f64, A>(a);
                for i in 0..=a {
                    let lever = self.rod.gradients[j].r[i] + state.tail[a].skew();
                    moved += lever * self.columns[column].u[j][i];
                }
                out.extend((frame * moved).0);
            }
            start = self.answer[j];
            out.extend((self.rod.rotations[j + 1] * start[1]).0);
            out.extend(start[0].0);
        }
        out
    }
}

#[cfg(test)]
impl<const A: usize> Motion<Scalar, A> {
    /// How far the tangent at rest misses the change of the residual by finite differences, at
    /// strains and contact forces along a line; the forces start from the balance of all ends.
    pub(crate) fn tangent_error(
        &mut self,
        strain: impl Fn(usize, f64) -> Vec3,
        force: impl Fn(usize, f64) -> Vec3,
    ) -> f64 {
        let n = self.module_count();
        self.begin_at_rest();
        let mut balanced: Vec<Vec3> = (0..n).map(|k| force(k, 0.0)).collect();
        let at = |motion: &mut Self, step: f64, balanced: &[Vec3]| {
            for k in 0..n {
                for a in 0..A {
                    motion.next[k].w[a] = strain(k * A + a, step);
                }
                motion.next[k].n = balanced[k] + (force(k, step) - force(k, 0.0));
            }
            motion.residual();
            let mut out = vec![];
            for k in 0..n {
                let gradient = &motion.rod.gradients[k];
                for a in 0..A {
                    out.push(gradient.to_strain[a].inverse().tr_mul(gradient.g[a]));
                }
                out.push(motion.inertia[k].g_delta);
            }
            out
        };
        for _ in 0..200 {
            let off = at(self, 0.0, &balanced);
            for (k, n) in balanced.iter_mut().enumerate() {
                *n -= off[k * (A + 1) + A] * 0.5;
            }
        }
        let h = 1e-5;
        let (up, down) = (at(self, h, &balanced), at(self, -h, &balanced));
        at(self, 0.0, &balanced);
        self.ready(true);
        for k in 0..n {
            for a in 0..=A {
                let change = (up[k * (A + 1) + a] - down[k * (A + 1) + a]) * (0.5 / h);
                if a < A {
                    let gradient = &mut self.rod.gradients[k];
                    gradient.g[a] = gradient.to_strain[a].tr_mul(change);
                } else {
                    self.inertia[k].g_delta = change;
                }
            }
        }
        self.substitute(0, None);
        self.combine(&[1.0]);
        let mut worst: f64 = 0.0;
        for k in 0..n {
            for a in 0..A {
                let back = strain(k * A + a, 1.0) - strain(k * A + a, 0.0);
                let moved = self.next[k].w[a] - strain(k * A + a, 0.0);
                worst = worst.max((moved + back).max_abs());
            }
            let back = force(k, 1.0) - force(k, 0.0);
            let moved = self.next[k].n - balanced[k];
            worst = worst.max((moved + back).max_abs() / 10.0);
        }
        worst
    }
}
