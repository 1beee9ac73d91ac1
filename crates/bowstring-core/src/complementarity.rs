//! Small dense systems, and which of their unknowns are held at zero.

/// A mixed linear complementarity problem, with its scratch memory: find `z` with
/// `w = q + M z`, where `z >= 0`, `w >= 0` and `z w = 0` for each bounded unknown, and `w = 0`
/// for each free one.
#[derive(Clone, Default)]
pub(crate) struct Complementarity {
    pub size: usize,
    /// By rows.
    pub matrix: Vec<f64>,
    pub q: Vec<f64>,
    pub bounded: Vec<bool>,
    pub z: Vec<f64>,
    /// Of the answer: whether `w = 0` was solved for.
    pub taken: Vec<bool>,
    w: Vec<f64>,
    work: Vec<f64>,
    index: Vec<usize>,
}

impl Complementarity {
    pub fn resize(&mut self, size: usize) {
        self.size = size;
        self.matrix.clear();
        self.matrix.resize(size * size, 0.0);
        for v in [&mut self.q, &mut self.z, &mut self.w] {
            v.clear();
            v.resize(size, 0.0);
        }
        self.bounded.clear();
        self.bounded.resize(size, false);
        self.taken.resize(size, true);
    }

    /// Solves it by block principal pivoting (Judice and Pires 1994), with Murty's rule where
    /// that does not get ahead; starts from what was taken last. False if it finds no answer.
    pub fn solve(&mut self) -> bool {
        let n = self.size;
        for i in 0..n {
            self.taken[i] |= !self.bounded[i];
        }
        let mut fewest = n + 1;
        let mut patience = 3;
        for _ in 0..50 + 10 * n {
            if !self.solve_taken() {
                return false;
            }
            let scale = self.q.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            let wrong = |i: usize| {
                self.bounded[i]
                    && if self.taken[i] {
                        self.z[i] < 0.0
                    } else {
                        self.w[i] < -1e-15 * scale
                    }
            };
            let count = (0..n).filter(|&i| wrong(i)).count();
            if count == 0 {
                return true;
            }
            if count < fewest {
                (fewest, patience) = (count, 3);
            } else {
                patience -= 1;
            }
            if patience > 0 {
                let flips: Vec<_> = (0..n).filter(|&i| wrong(i)).collect();
                for i in flips {
                    self.taken[i] = !self.taken[i];
                }
            } else if let Some(last) = (0..n).rev().find(|&i| wrong(i)) {
                self.taken[last] = !self.taken[last];
            }
        }
        false
    }

    /// Solves for the unknowns that are taken; the others are zero.
    fn solve_taken(&mut self) -> bool {
        let n = self.size;
        self.index.clear();
        self.index.extend((0..n).filter(|&i| self.taken[i]));
        let m = self.index.len();
        self.work.clear();
        for &i in &self.index {
            for &j in &self.index {
                self.work.push(self.matrix[i * n + j]);
            }
            self.work.push(-self.q[i]);
        }
        if !eliminate(&mut self.work, m) {
            return false;
        }
        self.z.fill(0.0);
        for (row, &i) in self.index.iter().enumerate() {
            self.z[i] = self.work[row * (m + 1) + m];
        }
        for i in 0..n {
            let row = &self.matrix[i * n..(i + 1) * n];
            let sum: f64 = row.iter().zip(&self.z).map(|(a, z)| a * z).sum();
            self.w[i] = if self.taken[i] { 0.0 } else { self.q[i] + sum };
        }
        true
    }

    /// Negative eigenvalues of the part of `M` that is taken, whose symmetric part is meant.
    pub fn negative_eigenvalues(&mut self) -> usize {
        let n = self.size;
        self.index.clear();
        self.index.extend((0..n).filter(|&i| self.taken[i]));
        let m = self.index.len();
        self.work.clear();
        for &i in &self.index {
            for &j in &self.index {
                self.work
                    .push(0.5 * (self.matrix[i * n + j] + self.matrix[j * n + i]));
            }
        }
        // Jacobi's rotations: a handful of unknowns, and no pivot to fear
        let a = &mut self.work;
        for _ in 0..30 {
            let mut off = 0.0;
            for p in 0..m {
                for q in p + 1..m {
                    let apq = a[p * m + q];
                    off += apq * apq;
                    if apq == 0.0 {
                        continue;
                    }
                    let theta = 0.5 * (a[q * m + q] - a[p * m + p]) / apq;
                    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                    let c = 1.0 / t.hypot(1.0);
                    let s = t * c;
                    for k in 0..m {
                        let (x, y) = (a[k * m + p], a[k * m + q]);
                        (a[k * m + p], a[k * m + q]) = (c * x - s * y, s * x + c * y);
                    }
                    for k in 0..m {
                        let (x, y) = (a[p * m + k], a[q * m + k]);
                        (a[p * m + k], a[q * m + k]) = (c * x - s * y, s * x + c * y);
                    }
                }
            }
            let size: f64 = (0..m).map(|i| a[i * m + i] * a[i * m + i]).sum();
            if off <= 1e-28 * size {
                break;
            }
        }
        (0..m).filter(|&i| a[i * m + i] < 0.0).count()
    }
}

/// Gauss's elimination with row pivoting of `m` rows of `m + 1`; the answer is the last column.
/// False where the matrix is singular.
fn eliminate(a: &mut [f64], m: usize) -> bool {
    let width = m + 1;
    for column in 0..m {
        let size = |row: usize| a[row * width + column].abs();
        let best = (column..m).fold(column, |b, row| if size(row) > size(b) { row } else { b });
        let pivot = a[best * width + column];
        if !(pivot.abs() > 0.0 && pivot.is_finite()) {
            return false;
        }
        for j in column..width {
            a.swap(column * width + j, best * width + j);
        }
        for row in 0..m {
            let factor = a[row * width + column] / pivot;
            if row != column && factor != 0.0 {
                for j in column..width {
                    a[row * width + j] -= factor * a[column * width + j];
                }
            }
        }
    }
    for row in 0..m {
        let answer = a[row * width + m] / a[row * width + row];
        a[row * width + m] = answer;
    }
    true
}
