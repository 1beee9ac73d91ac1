//! Curvature: how the derivatives of the tip change along the steps.
//!
//! Theory: docs/theory/inverse-kinematics.md (Curvature).

use super::task::{norm, Task};
use super::trust_region::NEAR;
use super::InverseSolver;
use crate::math::linalg::dot;
use crate::math::symmetric::diagonalise;

/// Least eigenvalue of the Hessian, over that of the squared tensions alone.
const LEAST_CURVATURE: f64 = 0.2;
/// Cosine between a step and the change that the update has to add, below which the symmetric
/// update of rank one is not defined well.
const LEAST_COSINE: f64 = 1e-2;
/// Share of the trace below which the normal equations of the multipliers are singular.
const SINGULAR: f64 = 1e-10;

/// What the derivatives of the residual are weighted with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weights {
    /// The residual: curvature of half its square, for a target that is not near.
    Residual,
    /// The multipliers of the least tensions with this tip.
    Multipliers,
}

/// Second derivative of the weighted residual by the tensions, from changes of its derivatives.
#[derive(Default)]
pub(super) struct Curvature {
    /// Symmetric matrix, and with what the residual is weighted; nothing before the first update.
    matrix: Vec<f64>,
    pub weights: Option<Weights>,
    /// Eigenvalues on the diagonal, and eigenvectors as rows, in descending `order`; of the present
    /// matrix alone if `is_split`.
    values: Vec<f64>,
    vectors: Vec<f64>,
    order: Vec<usize>,
    is_split: bool,
    columns: Vec<[f64; 6]>,
    /// Derivatives before the steps since they were exact, and the sum of these steps.
    former: Vec<[f64; 6]>,
    step: Vec<f64>,
    is_pending: bool,
    change: Vec<f64>,
    /// Whether the linear problem has it.
    pub is_used: bool,
    /// Square root of the Hessian, column by column, and the centre of its quadratic form.
    pub root: Vec<f64>,
    pub centre: Vec<f64>,
}

impl Curvature {
    /// Forgets the curvature.
    pub fn clear(&mut self) {
        self.weights = None;
        self.is_pending = false;
        self.is_used = false;
    }

    /// Forgets the last steps: the next derivatives do not follow from them.
    pub fn interrupt(&mut self) {
        self.is_pending = false;
    }

    /// Symmetric update of rank one by a step and the change of the gradient; of rank two (Powell's)
    /// where that is not defined well.
    fn update(&mut self) {
        let n = self.step.len();
        let Self {
            matrix,
            step,
            change,
            ..
        } = self;
        for (i, c) in change.iter_mut().enumerate() {
            *c -= dot(&matrix[i * n..][..n], step);
        }
        let (along, square) = (dot(change, step), dot(step, step));
        let rank_one = along.abs() >= LEAST_COSINE * norm(change) * square.sqrt();
        for i in 0..n {
            for j in 0..n {
                matrix[i * n + j] += if rank_one {
                    change[i] * change[j] / along
                } else {
                    (change[i] * step[j] + step[i] * change[j] - along / square * step[i] * step[j])
                        / square
                };
            }
        }
        self.is_split = false;
    }

    /// Square root of the Hessian of half the squared tensions, `scale` times the weighted residual
    /// and `stiffness` times half the squared change of the tip, made positive, for the change from
    /// `tensions`. `column` is the derivative of the residual by a tension.
    pub fn set_root(
        &mut self,
        tensions: &[f64],
        scale: f64,
        stiffness: f64,
        column: impl Fn(usize) -> [f64; 6],
    ) {
        let n = tensions.len();
        if !self.is_split || stiffness > 0.0 {
            self.values.clone_from(&self.matrix);
            if stiffness > 0.0 {
                self.columns.clear();
                self.columns.extend((0..n).map(column));
                for (i, of) in self.columns.iter().enumerate() {
                    for (j, by) in self.columns.iter().enumerate() {
                        self.values[i * n + j] += stiffness * dot(of, by);
                    }
                }
            }
            diagonalise(n, &mut self.values, &mut self.vectors);
            let values = &self.values;
            self.order.clear();
            self.order.extend(0..n);
            self.order
                .sort_by(|a, b| values[b * n + b].total_cmp(&values[a * n + a]));
            self.is_split = stiffness == 0.0;
        }
        self.root.resize(n * n, 0.0);
        self.centre.clear();
        for (row, k) in self.order.iter().enumerate() {
            let value = (1.0 + scale * self.values[k * n + k]).max(LEAST_CURVATURE);
            let root = value.sqrt();
            let vector = &self.vectors[k * n..][..n];
            for (i, v) in vector.iter().enumerate() {
                self.root[i * n + row] = root * v;
            }
            self.centre
                .push((root - 1.0 / root) * dot(vector, tensions));
        }
    }

    /// Quadratic form of the Hessian that `set_root` has made.
    pub fn square(&self, step: &[f64]) -> f64 {
        let n = step.len();
        let row = |r: usize| (0..n).map(|i| self.root[i * n + r] * step[i]).sum::<f64>();
        (0..n).map(|r| row(r).powi(2)).sum()
    }
}

impl InverseSolver {
    /// Notes a step, before it is taken, with the derivatives before it.
    pub(super) fn note_step(&mut self, task: &Task) {
        let mut curvature = std::mem::take(&mut self.curvature);
        if self.drift == 0.0 && self.linearised && self.plain_level == self.point.level {
            curvature.former.clear();
            let columns = (0..self.step.len()).map(|i| self.column(i, &task.target));
            curvature.former.extend(columns);
            curvature.step.clone_from(&self.step);
            curvature.is_pending = true;
        } else if curvature.is_pending {
            for (sum, d) in curvature.step.iter_mut().zip(&self.step) {
                *sum += d;
            }
        }
        self.curvature = curvature;
    }

    /// Corrects the curvature by the change of the derivatives along the steps since the last exact
    /// ones.
    pub(super) fn correct_curvature(&mut self, task: &Task) {
        if !std::mem::take(&mut self.curvature.is_pending) || self.drift > 0.0 {
            return;
        }
        let near = self.point.size < NEAR;
        let weights = if near {
            Weights::Multipliers
        } else {
            Weights::Residual
        };
        let by = match weights {
            Weights::Residual => self.point.residual,
            Weights::Multipliers => match self.multipliers(task) {
                Some(found) => found,
                None => return,
            },
        };
        let mut curvature = std::mem::take(&mut self.curvature);
        let n = curvature.step.len();
        if curvature.weights != Some(weights) {
            curvature.matrix.clear();
            curvature.matrix.resize(n * n, 0.0);
            curvature.weights = Some(weights);
        }
        curvature.change.clear();
        for (i, former) in curvature.former.iter().enumerate() {
            let column = self.column(i, &task.target);
            let terms = (0..task.rows).map(|q| by[q] * (column[q] - former[q]));
            curvature.change.push(terms.sum());
        }
        curvature.update();
        self.curvature = curvature;
    }

    /// Multipliers of the tip among tensions inside their limits, by least squares; `None` where
    /// the tip leaves them no choice.
    pub(super) fn multipliers(&self, task: &Task) -> Option<[f64; 6]> {
        let m = task.rows;
        let (mut a, mut x) = ([[0.0; 6]; 6], [0.0; 6]);
        let mut free = 0;
        for (i, t) in self.point.tensions.iter().enumerate() {
            if *t == task.lower[i] || *t == task.upper[i] {
                continue;
            }
            free += 1;
            let column = self.column(i, &task.target);
            for p in 0..m {
                x[p] -= column[p] * t;
                for q in 0..=p {
                    a[p][q] += column[p] * column[q];
                }
            }
        }
        if free <= m {
            return None;
        }
        // Cholesky
        let trace: f64 = (0..m).map(|p| a[p][p]).sum();
        for p in 0..m {
            for q in 0..=p {
                let known: f64 = (0..q).map(|k| a[p][k] * a[q][k]).sum();
                let left = a[p][q] - known;
                a[p][q] = if p > q {
                    left / a[q][q]
                } else if left > SINGULAR * trace {
                    left.sqrt()
                } else {
                    return None;
                };
            }
        }
        for p in 0..m {
            let known: f64 = (0..p).map(|k| a[p][k] * x[k]).sum();
            x[p] = (x[p] - known) / a[p][p];
        }
        for p in (0..m).rev() {
            let known: f64 = (p + 1..m).map(|k| a[k][p] * x[k]).sum();
            x[p] = (x[p] - known) / a[p][p];
        }
        Some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Draw;

    /// Steps as many as the unknowns give the Hessian of a quadratic function, and its root.
    #[test]
    fn updates_find_the_hessian_of_a_quadratic() {
        let n = 5;
        let mut draw = Draw::new(9, 0);
        let mut exact = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let x = draw.within(-0.2, 0.2);
                (exact[i * n + j], exact[j * n + i]) = (x, x);
            }
        }
        let mut curvature = Curvature {
            matrix: vec![0.0; n * n],
            ..Curvature::default()
        };
        let mut random = || (0..n).map(|_| draw.within(-1.0, 1.0)).collect::<Vec<_>>();
        for _ in 0..n {
            curvature.step = random();
            let row = |i: usize| dot(&exact[i * n..][..n], &curvature.step);
            curvature.change = (0..n).map(row).collect();
            curvature.update();
        }
        for (found, wanted) in curvature.matrix.iter().zip(&exact) {
            assert!((found - wanted).abs() < 1e-10);
        }
        // half of s' (1 + C) s + t' s is the same as half of |R (t + s) - c|^2, but for a constant
        let tensions = random();
        curvature.set_root(&tensions, 0.5, 0.0, |_| [0.0; 6]);
        let value = |step: &[f64]| {
            let rows = (0..n).map(|r| {
                let x = (0..n).map(|i| curvature.root[i * n + r] * (tensions[i] + step[i]));
                x.sum::<f64>() - curvature.centre[r]
            });
            0.5 * rows.map(|x| x * x).sum::<f64>()
        };
        let nothing = value(&[0.0; 5]);
        for _ in 0..4 {
            let step = random();
            let bent = (0..n).map(|i| step[i] * dot(&exact[i * n..][..n], &step));
            let square = dot(&step, &step) + 0.5 * bent.sum::<f64>();
            let wanted = 0.5 * square + dot(&tensions, &step);
            assert!((value(&step) - nothing - wanted).abs() < 1e-10);
            assert!((curvature.square(&step) - square).abs() < 1e-10);
        }
    }
}
