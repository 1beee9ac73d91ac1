//! Mixed linear complementarity problems and dense linear systems.
//!
//! Theory: docs/theory/actuation.md (theory Eq. 4.2).

use crate::interrupt;
use crate::math::linalg::dot;

/// A mixed linear complementarity problem (theory Eq. 4.2) with its scratch memory: find `z`
/// between its bounds with `w = q + M z`, where `w >= 0` at a lower bound, `w <= 0` at an upper
/// one, and `w = 0` between.
#[derive(Clone, Default)]
pub struct Complementarity {
    pub size: usize,
    /// Matrix `M`, row by row.
    pub matrix: Vec<f64>,
    pub q: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Active bound of each unknown at the solution.
    pub z: Vec<f64>,
    pub side: Vec<Side>,
    w: Vec<f64>,
    work: Vec<f64>,
    index: Vec<usize>,
    wrong: Vec<(usize, Side)>,
    path: Path,
}

/// Problems with the right-hand side `q + s from`, from share `s = 1` to 0.
#[derive(Clone, Default)]
struct Path {
    from: Vec<f64>,
    /// Derivatives of `z` and `w` with respect to the share.
    dz: Vec<f64>,
    dw: Vec<f64>,
}

/// Unknown that changes its side.
#[derive(Clone, Copy)]
struct Pivot {
    unknown: usize,
    from: Side,
    to: Side,
}

/// Most block pivots; each costs an elimination.
const BLOCK_PIVOTS: usize = 15;
/// Block pivots without progress, after which only one unknown changes its side (Murty's rule).
const PATIENCE: usize = 3;
/// Most pivots along a path for each unknown; paths of friction took up to 1.3.
const PATH_PIVOTS: usize = 6;
/// Most Gauss-Seidel sweeps where the path does not reach the problem.
const RELAXATIONS: usize = 100;

/// How block pivoting ended.
enum Blocks {
    Solved,
    Cycle,
    Singular,
}

/// Position of an unknown relative to its bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Side {
    #[default]
    Between,
    Lower,
    Upper,
}

impl Complementarity {
    /// Resizes the problem and removes its bounds; keeps the sides.
    pub fn resize(&mut self, size: usize) {
        self.size = size;
        self.matrix.clear();
        self.matrix.resize(size * size, 0.0);
        for (v, value) in [
            (&mut self.q, 0.0),
            (&mut self.z, 0.0),
            (&mut self.w, 0.0),
            (&mut self.lower, f64::NEG_INFINITY),
            (&mut self.upper, f64::INFINITY),
        ] {
            v.clear();
            v.resize(size, value);
        }
        self.side.resize(size, Side::Between);
    }

    /// Solves the problem by block principal pivoting (Judice and Pires 1994), with Murty's rule and
    /// then parametric pivoting where that cycles; starts from the present sides. Where all fail, the
    /// solution is approximate. Returns false if the problem has no solution.
    pub fn solve(&mut self) -> bool {
        self.leave_infinite_bounds();
        match self.pivot_blocks() {
            Blocks::Solved => true,
            Blocks::Singular => false,
            Blocks::Cycle => self.follow_path() || self.relax(),
        }
    }

    fn leave_infinite_bounds(&mut self) {
        for i in 0..self.size {
            if self.bound(i).is_some_and(|bound| !bound.is_finite()) {
                self.side[i] = Side::Between;
            }
        }
    }

    /// Moves all unknowns that are on a wrong side together, or the last of them where that cycles.
    fn pivot_blocks(&mut self) -> Blocks {
        let n = self.size;
        let (mut fewest, mut patience) = (n + 1, PATIENCE);
        for _ in 0..BLOCK_PIVOTS {
            if !self.solve_between(false) {
                return Blocks::Singular;
            }
            let noise = 1e-15 * self.q.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            self.wrong.clear();
            for i in 0..n {
                let (z, w) = (self.z[i], self.w[i]);
                let to = match self.side[i] {
                    // equal bounds: either side will do
                    _ if self.lower[i] == self.upper[i] && w < 0.0 => Side::Upper,
                    _ if self.lower[i] == self.upper[i] => Side::Lower,
                    Side::Between if z < self.lower[i] => Side::Lower,
                    Side::Between if z > self.upper[i] => Side::Upper,
                    Side::Lower if w < -noise => Side::Between,
                    Side::Upper if w > noise => Side::Between,
                    side => side,
                };
                if self.lower[i] == self.upper[i] && self.side[i] != Side::Between {
                    self.side[i] = to;
                } else if to != self.side[i] {
                    self.wrong.push((i, to));
                }
            }
            if self.wrong.is_empty() {
                return Blocks::Solved;
            }
            if self.wrong.len() < fewest {
                (fewest, patience) = (self.wrong.len(), PATIENCE);
            } else {
                patience = patience.saturating_sub(1);
            }
            let all = patience > 0;
            let first = if all { 0 } else { self.wrong.len() - 1 };
            for &(i, to) in &self.wrong[first..] {
                self.side[i] = to;
            }
        }
        Blocks::Cycle
    }

    /// Parametric principal pivoting (Cottle, Pang and Stone 1992, section 4.5): follows the solution
    /// from that of a problem with another `q`, for which the present sides are right, to that of
    /// this one. One unknown changes its side at a time; the path may turn back, and then the share
    /// of the other `q` grows for a while. Returns false if the path does not reach this problem.
    fn follow_path(&mut self) -> bool {
        let n = self.size;
        if !self.solve_between(false) {
            return false;
        }
        for i in 0..n {
            self.z[i] = self.z[i].max(self.lower[i]).min(self.upper[i]);
            if self.z[i] == self.lower[i] {
                self.side[i] = Side::Lower;
            } else if self.z[i] == self.upper[i] {
                self.side[i] = Side::Upper;
            }
        }
        self.path.from.clear();
        for i in 0..n {
            let w = self.q[i] + dot(&self.matrix[i * n..(i + 1) * n], &self.z);
            self.path.from.push(match self.side[i] {
                Side::Between => -w,
                Side::Lower => w.abs() - w,
                Side::Upper => -w.abs() - w,
            });
        }
        let (mut share, mut last) = (1.0, None);
        for _ in 0..PATH_PIVOTS * n {
            if !self.solve_between(true) {
                return false;
            }
            let sign = last.map_or(-1.0, |pivot| self.direction(pivot));
            let (way, next) = self.next_pivot(share, sign, last);
            if sign < 0.0 && way >= share {
                // `z` is that of share 0
                return true;
            }
            let Some(pivot) = next else {
                return false;
            };
            share += sign * way;
            self.side[pivot.unknown] = pivot.to;
            last = next;
        }
        false
    }

    /// Sign of the change of the share that moves an unknown away from its last change of side.
    fn direction(&self, last: Pivot) -> f64 {
        let (dz, dw) = (self.path.dz[last.unknown], self.path.dw[last.unknown]);
        let inwards = match last.to {
            Side::Between if last.from == Side::Lower => dz,
            Side::Between => -dz,
            Side::Lower => dw,
            Side::Upper => -dw,
        };
        inwards.signum()
    }

    /// First unknown that reaches the end of its side as the share changes, and the change of the
    /// share until then; infinite if no unknown does.
    fn next_pivot(&self, share: f64, sign: f64, last: Option<Pivot>) -> (f64, Option<Pivot>) {
        let (mut least, mut next) = (f64::INFINITY, None);
        for i in 0..self.size {
            let (lower, upper, from) = (self.lower[i], self.upper[i], self.side[i]);
            let (dz, dw) = (self.path.dz[i], self.path.dw[i]);
            let (z, w) = (self.z[i] + share * dz, self.w[i] + share * dw);
            let (dz, dw) = (sign * dz, sign * dw);
            // its `w` is zero but for rounding
            let moved = last.is_some_and(|last| last.unknown == i);
            let (way, to) = match from {
                _ if lower == upper => continue,
                Side::Between if dz < 0.0 => ((lower - z) / dz, Side::Lower),
                Side::Between if dz > 0.0 => ((upper - z) / dz, Side::Upper),
                Side::Lower if dw < 0.0 && !moved => (-w / dw, Side::Between),
                Side::Upper if dw > 0.0 && !moved => (-w / dw, Side::Between),
                _ => continue,
            };
            let way = f64::max(way, 0.0);
            if way < least {
                let pivot = Pivot {
                    unknown: i,
                    from,
                    to,
                };
                (least, next) = (way, Some(pivot));
            }
        }
        (least, next)
    }

    /// The bound at which an unknown is; `None` between the bounds.
    fn bound(&self, i: usize) -> Option<f64> {
        match self.side[i] {
            Side::Between => None,
            Side::Lower => Some(self.lower[i]),
            Side::Upper => Some(self.upper[i]),
        }
    }

    /// Approximates the solution by projected Gauss-Seidel sweeps.
    fn relax(&mut self) -> bool {
        let n = self.size;
        for i in 0..n {
            self.z[i] = 0f64.max(self.lower[i]).min(self.upper[i]);
        }
        for _ in 0..RELAXATIONS {
            if interrupt::work(n * n / 8) {
                return false;
            }
            for i in 0..n {
                let row = &self.matrix[i * n..(i + 1) * n];
                let to = self.z[i] - (self.q[i] + dot(row, &self.z)) / row[i];
                (self.z[i], self.side[i]) = if to <= self.lower[i] {
                    (self.lower[i], Side::Lower)
                } else if to >= self.upper[i] {
                    (self.upper[i], Side::Upper)
                } else {
                    (to, Side::Between)
                };
            }
        }
        self.z.iter().all(|z| z.is_finite())
    }

    /// Solves for the unknowns between their bounds, with the others at theirs; with `along`, also
    /// for their derivatives along the path.
    fn solve_between(&mut self, along: bool) -> bool {
        let n = self.size;
        self.index.clear();
        for i in 0..n {
            let bound = self.bound(i);
            if bound.is_none() {
                self.index.push(i);
            }
            self.z[i] = bound.unwrap_or(0.0);
        }
        let m = self.index.len();
        let width = m + 1 + usize::from(along);
        self.work.clear();
        for &i in &self.index {
            let row = &self.matrix[i * n..(i + 1) * n];
            self.work.extend(self.index.iter().map(|&j| row[j]));
            self.work.push(-self.q[i] - dot(row, &self.z));
            if along {
                self.work.push(-self.path.from[i]);
            }
        }
        if !eliminate(&mut self.work, m) {
            return false;
        }
        for (row, &i) in self.work.chunks(width).zip(&self.index) {
            self.z[i] = row[m];
        }
        for i in 0..n {
            self.w[i] = match self.side[i] {
                Side::Between => 0.0,
                _ => self.q[i] + dot(&self.matrix[i * n..(i + 1) * n], &self.z),
            };
        }
        if along {
            let Path { from, dz, dw } = &mut self.path;
            dz.clear();
            dz.resize(n, 0.0);
            for (row, &i) in self.work.chunks(width).zip(&self.index) {
                dz[i] = row[m + 1];
            }
            dw.clear();
            dw.extend((0..n).map(|i| match self.side[i] {
                Side::Between => 0.0,
                _ => from[i] + dot(&self.matrix[i * n..(i + 1) * n], dz),
            }));
        }
        true
    }

    /// Number of negative eigenvalues of the symmetric part of `M`, restricted to unknowns between
    /// their bounds.
    pub fn negative_eigenvalues(&mut self) -> usize {
        let n = self.size;
        self.index.clear();
        self.index
            .extend((0..n).filter(|&i| self.side[i] == Side::Between));
        let m = self.index.len();
        self.work.clear();
        for &i in &self.index {
            for &j in &self.index {
                self.work
                    .push(0.5 * (self.matrix[i * n + j] + self.matrix[j * n + i]));
            }
        }
        // Jacobi's rotations: the matrix is small, and no pivot can fail
        let a = &mut self.work;
        for _ in 0..30 {
            let mut off = 0.0;
            for p in 0..m {
                if interrupt::work(m * m / 2) {
                    return 0;
                }
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

/// Gaussian elimination with row pivoting for `m` rows: a square matrix, with right-hand sides in
/// the columns after it, which become the solutions. False where the matrix is singular.
pub fn eliminate(a: &mut [f64], m: usize) -> bool {
    let width = a.len().checked_div(m).unwrap_or(0);
    for column in 0..m {
        if interrupt::work((m - column) * (width - column) / 32) {
            return false;
        }
        let size = |row: usize| a[row * width + column].abs();
        let best = (column..m).fold(column, |b, row| if size(row) > size(b) { row } else { b });
        let pivot = a[best * width + column];
        if !(pivot.abs() > 0.0 && pivot.is_finite()) {
            return false;
        }
        if best != column {
            for j in column..width {
                a.swap(column * width + j, best * width + j);
            }
        }
        let (above, below) = a.split_at_mut((column + 1) * width);
        let own = &above[column * width + column + 1..];
        for row in below.chunks_exact_mut(width) {
            let factor = row[column] / pivot;
            if factor != 0.0 {
                for (x, y) in row[column + 1..].iter_mut().zip(own) {
                    *x -= factor * y;
                }
            }
        }
    }
    for right in m..width {
        for row in (0..m).rev() {
            let mut sum = a[row * width + right];
            for j in row + 1..m {
                sum -= a[row * width + j] * a[j * width + right];
            }
            a[row * width + right] = sum / a[row * width + row];
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Draw;

    /// `M` with a positive definite symmetric part, plus a skew part of size `skew`.
    fn problem(draw: &mut Draw, n: usize, skew: f64) -> Complementarity {
        let mut problem = Complementarity::default();
        problem.resize(n);
        let root: Vec<f64> = (0..n * n).map(|_| draw.within(-1.0, 1.0)).collect();
        for i in 0..n {
            for j in 0..n {
                let product: f64 = (0..n).map(|k| root[i * n + k] * root[j * n + k]).sum();
                problem.matrix[i * n + j] += product + if i == j { 0.05 } else { 0.0 };
            }
            for j in 0..i {
                let beside = skew * draw.within(-1.0, 1.0);
                problem.matrix[i * n + j] += beside;
                problem.matrix[j * n + i] -= beside;
            }
            problem.q[i] = draw.within(-2.0, 2.0);
        }
        problem
    }

    /// Solution by trying every unknown between its bounds, at its lower and at its upper bound.
    fn by_brute_force(problem: &Complementarity) -> Option<Vec<f64>> {
        let n = problem.size;
        let mut trial = problem.clone();
        (0..3usize.pow(n as u32)).find_map(|code| {
            let mut rest = code;
            for i in 0..n {
                trial.side[i] = [Side::Between, Side::Lower, Side::Upper][rest % 3];
                rest /= 3;
            }
            let finite = (0..n).all(|i| match trial.side[i] {
                Side::Between => true,
                Side::Lower => trial.lower[i].is_finite(),
                Side::Upper => trial.upper[i].is_finite(),
            });
            (finite && trial.solve_between(false) && is_answer(&trial)).then(|| trial.z.clone())
        })
    }

    fn is_answer(problem: &Complementarity) -> bool {
        let (n, least) = (problem.size, 1e-9);
        (0..n).all(|i| {
            let row = &problem.matrix[i * n..(i + 1) * n];
            let w = problem.q[i] + row.iter().zip(&problem.z).map(|(a, z)| a * z).sum::<f64>();
            let (z, low, high) = (problem.z[i], problem.lower[i], problem.upper[i]);
            let inside = z >= low - least && z <= high + least;
            let at_low = (z - low).abs() <= least && w >= -least;
            let at_high = (z - high).abs() <= least && w <= least;
            inside && (w.abs() <= least || at_low || at_high)
        })
    }

    #[test]
    fn matches_brute_force() {
        let mut draw = Draw::new(1, 0);
        for round in 0..300 {
            let n = 1 + round % if round < 280 { 6 } else { 8 };
            let mut problem = bounded(&mut draw, n, if round % 2 == 0 { 0.0 } else { 0.3 });
            assert!(problem.solve(), "{round}");
            let exact = by_brute_force(&problem).expect("one solution");
            for i in 0..n {
                let off = (problem.z[i] - exact[i]).abs();
                assert!(off < 1e-8, "{round}: {:?} {exact:?}", problem.z);
            }
        }
    }

    /// A problem with bounds of all kinds, from sides at random.
    fn bounded(draw: &mut Draw, n: usize, skew: f64) -> Complementarity {
        let mut problem = problem(draw, n, skew);
        for i in 0..n {
            problem.lower[i] = [f64::NEG_INFINITY, -0.5, 0.0, 0.0][draw.count(0, 3)];
            let room = [f64::INFINITY, 1.0, 0.2, 0.0][draw.count(0, 3)];
            problem.upper[i] = problem.lower[i].max(-3.0) + room;
            problem.side[i] = [Side::Between, Side::Lower, Side::Upper][draw.count(0, 2)];
        }
        problem
    }

    #[test]
    fn a_path_leads_to_the_same_solution() {
        let mut draw = Draw::new(4, 0);
        for round in 0..300 {
            let n = 1 + round % 6;
            let mut problem = bounded(&mut draw, n, if round % 2 == 0 { 0.0 } else { 0.3 });
            problem.leave_infinite_bounds();
            assert!(problem.follow_path(), "{round}");
            let exact = by_brute_force(&problem).expect("one solution");
            for i in 0..n {
                let off = (problem.z[i] - exact[i]).abs();
                assert!(off < 1e-8, "{round}: {:?} {exact:?}", problem.z);
            }
        }
    }

    #[test]
    fn many_unknowns_with_narrow_bounds_are_solved() {
        let mut draw = Draw::new(5, 0);
        for round in 0..30 {
            let n = 40 + 2 * round;
            let mut problem = bounded(&mut draw, n, 0.3);
            // bounds that a block pivot passes, as those of friction where tendons are nearly slack
            for i in 0..n {
                if problem.upper[i] > problem.lower[i] && problem.upper[i].is_finite() {
                    problem.upper[i] = problem.lower[i].max(-3.0) + 1e-3;
                }
            }
            problem.leave_infinite_bounds();
            assert!(problem.follow_path(), "{round}");
            assert!(is_answer(&problem), "{round}");
            assert!(problem.solve(), "{round}");
            assert!(is_answer(&problem), "{round}");
        }
    }

    #[test]
    fn finds_a_degenerate_solution() {
        // degenerate: at the bound with w = 0
        let mut problem = Complementarity::default();
        problem.resize(2);
        problem.matrix = vec![2.0, 1.0, 1.0, 2.0];
        problem.q = vec![0.0, -3.0];
        problem.lower = vec![-1.5, 0.0];
        assert!(problem.solve());
        assert!((problem.z[0] + 1.0).abs() < 1e-15 && (problem.z[1] - 2.0).abs() < 1e-15);
        problem.lower = vec![-1.0, 0.0];
        assert!(problem.solve());
        assert!((problem.z[0] + 1.0).abs() < 1e-15 && (problem.z[1] - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_singular_matrix_has_no_solution() {
        let mut problem = Complementarity::default();
        problem.resize(2);
        problem.matrix = vec![1.0, 1.0, 1.0, 1.0];
        problem.q = vec![1.0, 2.0];
        assert!(!problem.solve());
    }

    #[test]
    fn counts_negative_eigenvalues() {
        let mut draw = Draw::new(2, 0);
        for n in 1..=6 {
            let mut problem = problem(&mut draw, n, 0.5);
            assert_eq!(problem.negative_eigenvalues(), 0);
            // a congruence preserves the inertia (Sylvester)
            let signs: Vec<f64> = (0..n).map(|_| draw.within(-1.0, 1.0).signum()).collect();
            let root: Vec<f64> = (0..n * n).map(|_| draw.within(-1.0, 1.0)).collect();
            for i in 0..n {
                for j in 0..n {
                    problem.matrix[i * n + j] = (0..n)
                        .map(|k| root[i * n + k] * signs[k] * root[j * n + k])
                        .sum();
                }
            }
            let negative = signs.iter().filter(|s| **s < 0.0).count();
            assert_eq!(problem.negative_eigenvalues(), negative, "{signs:?}");
        }
    }

    #[test]
    fn eliminates_several_right_hand_sides() {
        let mut draw = Draw::new(3, 0);
        for m in 1..=8 {
            let width = m + 3;
            let a: Vec<f64> = (0..m * width).map(|_| draw.within(-1.0, 1.0)).collect();
            let mut solution = a.clone();
            assert!(eliminate(&mut solution, m));
            for row in 0..m {
                for right in m..width {
                    let sum: f64 = (0..m)
                        .map(|k| a[row * width + k] * solution[k * width + right])
                        .sum();
                    assert!((sum - a[row * width + right]).abs() < 1e-10);
                }
            }
        }
    }
}
