//! Linear least squares within bounds, by an active set.
//!
//! Theory: docs/theory/inverse-kinematics.md (Eq. 10.4).

/// Rounding of a gradient's entry, over the terms that nearly cancel in it.
const GRADIENT_NOISE: f64 = 1e-11;

/// Scratch memory of `min |A x - b|^2 + |R x - c|^2` for `lower <= x <= upper`, with rows of `A` that
/// may be much larger than one, and a square matrix `R`, the identity if it is empty. No solve
/// allocates once the sizes are known.
#[derive(Clone, Debug, Default)]
pub struct BoundedLeastSquares {
    /// Unknowns inside their bounds.
    free: Vec<bool>,
    /// Columns of the unknowns inside their bounds, each with the rows of `A` and of `R`.
    columns: Vec<f64>,
    /// Right-hand side of the same rows.
    rhs: Vec<f64>,
    /// Solution for the unknowns inside their bounds.
    trial: Vec<f64>,
    /// `b - A x`, and `c - R x`.
    residual: Vec<f64>,
}

/// A problem; the matrices column by column.
pub struct Problem<'a> {
    pub a: &'a [f64],
    pub b: &'a [f64],
    /// Regular matrix, or nothing for the identity. Its larger rows stand first.
    pub root: &'a [f64],
    pub centre: &'a [f64],
    pub lower: &'a [f64],
    pub upper: &'a [f64],
}

impl BoundedLeastSquares {
    /// Replaces `x`, which need not be within the bounds, by the minimum. It is unique: the problem
    /// is strictly convex.
    pub fn solve(&mut self, p: &Problem, x: &mut [f64]) {
        let (m, n) = (p.b.len(), x.len());
        self.free.clear();
        for i in 0..n {
            x[i] = x[i].max(p.lower[i]).min(p.upper[i]);
            self.free.push(p.lower[i] < x[i] && x[i] < p.upper[i]);
        }
        let mut freed = None;
        for _ in 0..10 * (n + 1) {
            if self.free.contains(&true) {
                self.solve_free(p, x);
                if let Some((at, fraction)) = self.step(p, x) {
                    if freed == Some(at) && fraction == 0.0 {
                        // by rounding alone it seemed to decrease the sum of squares inside
                        return;
                    }
                    freed = None;
                    continue;
                }
            }
            freed = self.leaves_bound(p, x, m);
            match freed {
                Some(at) => self.free[at] = true,
                None => return,
            }
        }
    }

    /// Minimum over the free unknowns, in `trial`: Householder's QR factorisation, for which the
    /// large rows stand first.
    fn solve_free(&mut self, p: &Problem, x: &[f64]) {
        let m = p.b.len();
        let count = self.free.iter().filter(|f| **f).count();
        let n = x.len();
        let identity = p.root.is_empty();
        let rows = if identity { m + count } else { m + n };
        self.columns.clear();
        self.columns.resize(rows * count, 0.0);
        self.rhs.clear();
        self.rhs.extend_from_slice(p.b);
        if !identity {
            self.rhs.extend_from_slice(p.centre);
        }
        let mut at = 0;
        for (i, column) in p.a.chunks_exact(m).enumerate() {
            if self.free[i] {
                self.columns[at * rows..][..m].copy_from_slice(column);
                if identity {
                    self.columns[at * rows + m + at] = 1.0;
                    self.rhs.push(p.centre[i]);
                } else {
                    let root = &p.root[i * n..][..n];
                    self.columns[at * rows + m..][..n].copy_from_slice(root);
                }
                at += 1;
            } else {
                for (b, a) in self.rhs[..m].iter_mut().zip(column) {
                    *b -= a * x[i];
                }
                if !identity {
                    let root = &p.root[i * n..][..n];
                    for (c, r) in self.rhs[m..].iter_mut().zip(root) {
                        *c -= r * x[i];
                    }
                }
            }
        }
        for j in 0..count {
            let (head, tail) = self.columns.split_at_mut((j + 1) * rows);
            let v = &mut head[j * rows + j..];
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            let diagonal = if v[0] > 0.0 { -norm } else { norm };
            v[0] -= diagonal;
            let scale = -1.0 / (diagonal * v[0]);
            let columns = tail.chunks_exact_mut(rows).map(|c| &mut c[j..]);
            for column in columns.chain(std::iter::once(&mut self.rhs[j..])) {
                let dot: f64 = v.iter().zip(&*column).map(|(a, b)| a * b).sum();
                for (a, b) in v.iter().zip(column) {
                    *b -= scale * dot * a;
                }
            }
            v[0] = diagonal;
        }
        self.trial.clear();
        self.trial.resize(count, 0.0);
        for j in (0..count).rev() {
            let known = (j + 1..count).map(|c| self.columns[c * rows + j] * self.trial[c]);
            self.trial[j] = (self.rhs[j] - known.sum::<f64>()) / self.columns[j * rows + j];
        }
    }

    /// Goes to `trial`, or to the first bound before it, which becomes active and is returned with
    /// the fraction of the way to it.
    fn step(&mut self, p: &Problem, x: &mut [f64]) -> Option<(usize, f64)> {
        let (mut fraction, mut blocking) = (1.0_f64, None);
        let mut at = 0;
        for i in 0..x.len() {
            if !self.free[i] {
                continue;
            }
            let to = self.trial[at];
            at += 1;
            let bound = if to < p.lower[i] {
                p.lower[i]
            } else if to > p.upper[i] {
                p.upper[i]
            } else {
                continue;
            };
            let here = (bound - x[i]) / (to - x[i]);
            if blocking.is_none() || here < fraction {
                (fraction, blocking) = (here.max(0.0), Some((i, bound)));
            }
        }
        let mut at = 0;
        for i in 0..x.len() {
            if self.free[i] {
                let to = x[i] + fraction * (self.trial[at] - x[i]);
                x[i] = to.max(p.lower[i]).min(p.upper[i]);
                at += 1;
            }
        }
        let (i, bound) = blocking?;
        x[i] = bound;
        self.free[i] = false;
        Some((i, fraction))
    }

    /// The unknown at a bound whose motion inside decreases the sum of squares most, if any does.
    fn leaves_bound(&mut self, p: &Problem, x: &[f64], m: usize) -> Option<usize> {
        self.residual.clear();
        self.residual.extend_from_slice(p.b);
        for (column, x) in p.a.chunks_exact(m).zip(x) {
            for (r, a) in self.residual.iter_mut().zip(column) {
                *r -= a * x;
            }
        }
        let n = x.len();
        if !p.root.is_empty() {
            self.residual.extend_from_slice(p.centre);
            for (column, x) in p.root.chunks_exact(n).zip(x) {
                for (r, a) in self.residual[m..].iter_mut().zip(column) {
                    *r -= a * x;
                }
            }
        }
        let mut best = None;
        for (i, column) in p.a.chunks_exact(m).enumerate() {
            if self.free[i] || p.lower[i] == p.upper[i] {
                continue;
            }
            let terms = column.iter().zip(&self.residual).map(|(a, r)| a * r);
            let noise = GRADIENT_NOISE * terms.clone().map(f64::abs).sum::<f64>();
            let mut descent = terms.sum::<f64>();
            let mut noise = noise;
            if p.root.is_empty() {
                descent += p.centre[i] - x[i];
            } else {
                let root = p.root[i * n..][..n].iter();
                let terms = root.zip(&self.residual[m..]).map(|(a, r)| a * r);
                noise += GRADIENT_NOISE * terms.clone().map(f64::abs).sum::<f64>();
                descent += terms.sum::<f64>();
            }
            let inward = if x[i] == p.lower[i] {
                descent
            } else {
                -descent
            };
            if inward > noise + 1e-14 && best.is_none_or(|(_, most)| inward > most) {
                best = Some((i, inward));
            }
        }
        best.map(|(i, _)| i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Draw;

    /// The conditions of Karush, Kuhn and Tucker, which a convex problem fulfils at its minimum
    /// only.
    #[test]
    fn conditions_of_the_minimum_hold() {
        let mut draw = Draw::new(5, 0);
        let mut solver = BoundedLeastSquares::default();
        for case in 0..2000 {
            let (m, n) = (1 + case % 6, 1 + case % 13);
            let weight = [1.0, 1e3, 1e7][case % 3];
            let mut numbers = |count: usize, size: f64| -> Vec<f64> {
                (0..count).map(|_| draw.within(-size, size)).collect()
            };
            let (a, b) = (numbers(m * n, weight), numbers(m, weight));
            let (centre, mut x) = (numbers(n, 1.0), numbers(n, 2.0));
            let mut root = match case % 2 {
                0 => vec![],
                _ => numbers(n * n, 1.0),
            };
            if case % 2 == 1 {
                (0..n).for_each(|i| root[i * n + i] += n as f64);
            }
            let (lower, width) = (numbers(n, 1.0), numbers(n, 1.0));
            let upper: Vec<_> = (0..n).map(|i| lower[i] + width[i].max(0.0)).collect();
            let problem = Problem {
                a: &a,
                b: &b,
                root: &root,
                centre: &centre,
                lower: &lower,
                upper: &upper,
            };
            solver.solve(&problem, &mut x);
            let left: Vec<_> = (0..m)
                .map(|r| b[r] - (0..n).map(|i| a[i * m + r] * x[i]).sum::<f64>())
                .collect();
            let entry = |r: usize, i: usize| match case % 2 {
                0 => f64::from(u8::from(r == i)),
                _ => root[i * n + r],
            };
            let beside: Vec<_> = (0..n)
                .map(|r| (0..n).map(|i| entry(r, i) * x[i]).sum::<f64>() - centre[r])
                .collect();
            for i in 0..n {
                assert!(lower[i] <= x[i] && x[i] <= upper[i]);
                let column = &a[i * m..][..m];
                let along: f64 = column.iter().zip(&left).map(|(a, r)| a * r).sum();
                let size: f64 = column.iter().zip(&left).map(|(a, r)| (a * r).abs()).sum();
                let own: f64 = (0..n).map(|r| entry(r, i) * beside[r]).sum();
                let gradient = own - along;
                let small = 1e-9 * (1.0 + size) + 1e-14 * weight * weight;
                if x[i] > lower[i] {
                    assert!(gradient < small, "{case}, {i}: {gradient}");
                }
                if x[i] < upper[i] {
                    assert!(gradient > -small, "{case}, {i}: {gradient}");
                }
            }
        }
    }
}
