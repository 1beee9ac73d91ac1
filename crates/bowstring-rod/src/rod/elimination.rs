//! One Newton step: block-tridiagonal elimination backward over the modules, substitution forward.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination, Eq. 3.4).
//!
//! The Riccati-type recursion of optimal control. The state `x` is the motion of a disk, the
//! control is the rotations `u` added by the arcs of the module after it (all left perturbations,
//! in the disk's own frame). Dead loads couple modules through rotation only, so the state of
//! statics is one block of three; inertia couples them through translation as well, so that of
//! dynamics is two. The cost is linear in the number of modules. The gradient comes from the exact
//! costate, so the linear term `p` starts from zero at the tip and the step is Newton's.
//!
//! A dead moment has no potential: it adds a skew part to the state matrix of its disk, and the
//! elimination then keeps both triangles (`SYMMETRIC = false`).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;

/// Second variation of a module and the distal part: arcs (U of theory Eq. 3.4), state of the start
/// disk (Z), and coupling (X).
pub struct Blocks<T, const A: usize, const S: usize> {
    /// U: lower blocks; all blocks where it is not symmetric.
    pub uu: [[Mat3<T>; A]; A],
    /// X: rows of state, columns of arcs; and its transpose.
    pub xu: [[Mat3<T>; S]; A],
    pub ux: [[Mat3<T>; S]; A],
    pub xx: [[Mat3<T>; S]; S],
}

/// An eliminated module: its arcs respond to the motion of its start by `u = -(k + gain x)`
/// (theory Eq. 3.4).
#[derive(Clone, Copy, Debug)]
pub struct Eliminated<T, const A: usize, const S: usize> {
    /// Inverse diagonal blocks and the off-diagonal blocks.
    inverse: [Mat3<T>; A],
    lower: [[Mat3<T>; A]; A],
    upper: [[Mat3<T>; A]; A],
    gain: [[Mat3<T>; S]; A],
    xu: [[Mat3<T>; S]; A],
}

impl<T: Real, const A: usize, const S: usize> Blocks<T, A, S> {
    #[inline(always)]
    pub fn empty() -> Self {
        let zero = Mat3::zero();
        Blocks {
            uu: [[zero; A]; A],
            xu: [[zero; S]; A],
            ux: [[zero; S]; A],
            xx: [[zero; S]; S],
        }
    }
}

impl<T: Real, const A: usize, const S: usize> Eliminated<T, A, S> {
    pub fn empty() -> Self {
        let zero = Mat3::zero();
        Eliminated {
            inverse: [zero; A],
            lower: [[zero; A]; A],
            upper: [[zero; A]; A],
            gain: [[zero; S]; A],
            xu: [[zero; S]; A],
        }
    }

    /// Eliminates the module's arcs (theory Eq. 3.4); returns the Schur complement of the state.
    /// `least_pivot` is reduced to the least pivot, which is not positive when the module and the
    /// distal part are not at a minimum.
    #[inline(always)]
    pub fn eliminate<const SYMMETRIC: bool>(
        &mut self,
        blocks: Blocks<T, A, S>,
        least_pivot: &mut T,
    ) -> [[Mat3<T>; S]; S] {
        let Blocks {
            mut uu,
            xu,
            mut ux,
            mut xx,
        } = blocks;
        self.xu = xu;
        for i in 0..A {
            let (mut inverse, [m1, m2, m3]) = uu[i][i].inverse_and_minors();
            if SYMMETRIC {
                inverse = inverse.mirrored();
            }
            self.inverse[i] = inverse;
            // leading minors as pivots; where one is not positive, neither is the least
            let per = T::splat(1.0) / m1.abs();
            let least = min(min(m1, m2 * per), m3 * per * per);
            *least_pivot = min(*least_pivot, least);
            for b in 0..A {
                if b <= i {
                    continue;
                }
                let l = uu[b][i] * inverse;
                self.lower[b][i] = l;
                for a in 0..A {
                    if a <= i || SYMMETRIC && a > b {
                        continue;
                    }
                    let beside = if SYMMETRIC {
                        uu[a][i].transpose()
                    } else {
                        uu[i][a]
                    };
                    uu[b][a] = (-l).mul_add(beside, uu[b][a]);
                    if SYMMETRIC && a == b {
                        uu[b][a] = uu[b][a].mirrored();
                    }
                }
            }
        }
        for i in 0..A {
            for b in 0..A {
                for q in 0..S {
                    if b > i {
                        ux[b][q] = (-self.lower[b][i]).mul_add(ux[i][q], ux[b][q]);
                    }
                }
            }
        }
        for i in (0..A).rev() {
            for q in 0..S {
                if SYMMETRIC {
                    ux[i][q] = self.inverse[i] * ux[i][q];
                }
                for b in 0..A {
                    if b > i {
                        let beside = if SYMMETRIC {
                            self.lower[b][i].transpose()
                        } else {
                            uu[i][b]
                        };
                        ux[i][q] = (-beside).mul_add(ux[b][q], ux[i][q]);
                    }
                }
                if !SYMMETRIC {
                    ux[i][q] = self.inverse[i] * ux[i][q];
                }
                for p in 0..S {
                    if !SYMMETRIC || p >= q {
                        xx[p][q] = (-xu[i][p]).mul_add(ux[i][q], xx[p][q]);
                    }
                }
            }
        }
        self.gain = ux;
        if SYMMETRIC {
            for q in 0..S {
                xx[q][q] = xx[q][q].mirrored();
                for p in q + 1..S {
                    xx[q][p] = xx[p][q].transpose();
                }
            }
        } else {
            self.upper = uu;
        }
        xx
    }

    /// Rotation taken back by all arcs where the start disk turns.
    #[inline(always)]
    pub fn turn_by_start(&self) -> Mat3<T> {
        self.turn_of_arcs_by_start(A)
    }

    /// Rotation taken back by the first `count` arcs where the start disk turns.
    #[inline(always)]
    pub fn turn_of_arcs_by_start(&self, count: usize) -> Mat3<T> {
        let mut sum = Mat3::zero();
        for gain in &self.gain[..count] {
            sum += gain[0];
        }
        sum
    }

    /// Sum of all blocks of the inverse of U, for a symmetric elimination: the rotation of the end
    /// by a unit moment on it, while the start is held.
    #[inline(always)]
    pub fn flexibility(&self) -> Mat3<T> {
        let mut sum = Mat3::zero();
        let mut columns = [Mat3::identity(); A];
        for i in 0..A {
            let column = columns[i];
            for b in i + 1..A {
                columns[b] = (-self.lower[b][i]).mul_add(column, columns[b]);
            }
            sum = column.tr_mat(self.inverse[i]).mul_add(column, sum);
        }
        sum
    }

    /// Number of negative eigenvalues of the arcs' pivots.
    pub fn negative_pivots(&self) -> usize {
        self.inverse.iter().map(negative_pivots).sum()
    }

    /// Solves for the module's arcs alone; see `backward_as` for `wide`.
    #[inline(always)]
    fn solve_as<W: Real, const SYMMETRIC: bool>(
        &self,
        wide: &impl Fn(&Mat3<T>) -> Mat3<W>,
        v: &mut [Vec3<W>; A],
    ) {
        for i in 0..A {
            for b in i + 1..A {
                let update = wide(&self.lower[b][i]) * v[i];
                v[b] -= update;
            }
        }
        for i in (0..A).rev() {
            if SYMMETRIC {
                v[i] = wide(&self.inverse[i]) * v[i];
                for b in i + 1..A {
                    let update = wide(&self.lower[b][i]).tr_mul(v[b]);
                    v[i] -= update;
                }
            } else {
                for b in i + 1..A {
                    let update = wide(&self.upper[i][b]) * v[b];
                    v[i] -= update;
                }
                v[i] = wide(&self.inverse[i]) * v[i];
            }
        }
    }

    /// Backward substitution: replaces the right-hand side `g` of the arcs by their own solution
    /// `k`, and subtracts their part from the linear term `p` of the state.
    #[inline(always)]
    pub fn backward<const SYMMETRIC: bool>(&self, g: &mut [Vec3<T>; A], p: &mut [Vec3<T>; S]) {
        self.backward_as::<T, SYMMETRIC>(
            #[inline(always)]
            |m| *m,
            g,
            p,
        );
    }

    /// The same with right-hand sides in another number type, to which `wide` converts.
    #[inline(always)]
    pub fn backward_as<W: Real, const SYMMETRIC: bool>(
        &self,
        wide: impl Fn(&Mat3<T>) -> Mat3<W>,
        g: &mut [Vec3<W>; A],
        p: &mut [Vec3<W>; S],
    ) {
        self.solve_as::<W, SYMMETRIC>(&wide, g);
        for i in 0..A {
            for q in 0..S {
                p[q] -= wide(&self.xu[i][q]) * g[i];
            }
        }
    }

    /// Forward substitution (theory Eq. 3.4): arcs from their own solution and the motion of the
    /// start disk.
    #[inline(always)]
    pub fn forward(&self, k: &[Vec3<T>; A], x: &[Vec3<T>; S]) -> [Vec3<T>; A] {
        self.forward_as(
            #[inline(always)]
            |m| *m,
            k,
            x,
        )
    }

    /// The same with right-hand sides in another number type, to which `wide` converts.
    #[inline(always)]
    pub fn forward_as<W: Real>(
        &self,
        wide: impl Fn(&Mat3<T>) -> Mat3<W>,
        k: &[Vec3<W>; A],
        x: &[Vec3<W>; S],
    ) -> [Vec3<W>; A] {
        let mut u = *k;
        for i in 0..A {
            for q in 0..S {
                u[i] += wide(&self.gain[i][q]) * x[q];
            }
            u[i] = -u[i];
        }
        u
    }
}

/// Number of negative eigenvalues of a symmetric matrix or its inverse, in the first lane.
pub fn negative_pivots<T: Real>(matrix: &Mat3<T>) -> usize {
    let (_, minors) = matrix.inverse_and_minors();
    let signs = minors.map(|m| m.lane(0) < 0.0);
    let before = [false, signs[0], signs[1]];
    (0..3).filter(|&i| before[i] != signs[i]).count()
}

#[inline(always)]
fn min<T: Real>(a: T, b: T) -> T {
    -((-a).max(-b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::mlcp;
    use crate::random::Draw;

    fn block(draw: &mut Draw) -> Mat3<f64> {
        Mat3([[0; 3]; 3].map(|row| row.map(|_| draw.within(-1.0, 1.0))))
    }

    /// A module and the part beyond it, dense and in blocks.
    fn random<const A: usize, const S: usize>(
        draw: &mut Draw,
        symmetric: bool,
    ) -> (Vec<f64>, Blocks<f64, A, S>) {
        let n = 3 * (A + S);
        let mut dense = vec![0.0; n * n];
        let mut blocks = Blocks::empty();
        for p in 0..A + S {
            for q in 0..=p {
                let mut here = block(draw);
                if p == q {
                    here += Mat3::scalar(6.0);
                    if symmetric {
                        here = here.symmetric_part();
                    }
                }
                let there = if symmetric {
                    here.transpose()
                } else {
                    block(draw)
                };
                for (i, j, m) in [(q, p, there), (p, q, here)] {
                    for r in 0..3 {
                        for c in 0..3 {
                            dense[(3 * i + r) * n + 3 * j + c] = m.0[r][c];
                        }
                    }
                    match (i < A, j < A) {
                        (true, true) => blocks.uu[i][j] = m,
                        (true, false) => blocks.ux[i][j - A] = m,
                        (false, true) => blocks.xu[j][i - A] = m,
                        (false, false) => blocks.xx[i - A][j - A] = m,
                    }
                }
            }
        }
        (dense, blocks)
    }

    fn agrees<const A: usize, const S: usize, const SYMMETRIC: bool>() {
        let mut draw = Draw::new(A as u64, S);
        for _ in 0..50 {
            let (dense, blocks) = random::<A, S>(&mut draw, SYMMETRIC);
            let mut eliminated = Eliminated::empty();
            let mut pivot = f64::INFINITY;
            let left = eliminated.eliminate::<SYMMETRIC>(blocks, &mut pivot);
            assert!(pivot > 0.0);
            // the dense system
            let n = 3 * (A + S);
            let g: Vec<f64> = (0..n).map(|_| draw.within(-1.0, 1.0)).collect();
            let mut whole = vec![];
            for row in 0..n {
                whole.extend_from_slice(&dense[row * n..(row + 1) * n]);
                whole.push(-g[row]);
            }
            assert!(mlcp::eliminate(&mut whole, n));
            let exact = |i: usize| whole[i * (n + 1) + n];
            // backward pass, the state, forward pass
            let vector = |i: usize| Vec3([g[3 * i], g[3 * i + 1], g[3 * i + 2]]);
            let mut solution: [Vec3<f64>; A] = std::array::from_fn(vector);
            let mut state: [Vec3<f64>; S] = std::array::from_fn(|q| vector(A + q));
            eliminated.backward::<SYMMETRIC>(&mut solution, &mut state);
            let mut rest = vec![];
            for p in 0..3 * S {
                rest.extend((0..3 * S).map(|q| left[p / 3][q / 3].0[p % 3][q % 3]));
                rest.push(-state[p / 3][p % 3]);
            }
            assert!(mlcp::eliminate(&mut rest, 3 * S));
            let x: [Vec3<f64>; S] = std::array::from_fn(|q| {
                Vec3([0, 1, 2].map(|r| rest[(3 * q + r) * (3 * S + 1) + 3 * S]))
            });
            let u = eliminated.forward(&solution, &x);
            for i in 0..n {
                let ours = if i < 3 * A {
                    u[i / 3][i % 3]
                } else {
                    x[i / 3 - A][i % 3]
                };
                assert!((ours - exact(i)).abs() < 1e-11, "{i}: {ours} {}", exact(i));
            }
        }
    }

    #[test]
    fn block_elimination_matches_dense() {
        agrees::<2, 1, true>();
        agrees::<2, 1, false>();
        agrees::<4, 1, true>();
        agrees::<4, 1, false>();
        agrees::<2, 2, true>();
        agrees::<8, 2, false>();
    }

    #[test]
    fn pivots_detect_an_indefinite_matrix() {
        let mut draw = Draw::new(9, 0);
        let (mut minima, mut others) = (0, 0);
        while minima < 20 || others < 20 {
            let (_, mut blocks) = random::<2, 1>(&mut draw, true);
            let shift = draw.within(0.0, 8.0);
            for i in 0..2 {
                blocks.uu[i][i] -= Mat3::scalar(shift);
            }
            let arcs = blocks.uu;
            let mut pivot = f64::INFINITY;
            let mut eliminated = Eliminated::empty();
            eliminated.eliminate::<true>(blocks, &mut pivot);
            // Sylvester's criterion on the arcs: all leading minors are positive
            let at = |r: usize, c: usize| {
                let (a, b) = (r.max(c), r.min(c));
                arcs[a / 3][b / 3].0[a % 3][b % 3]
            };
            let minimum = (1..=6).all(|size| determinant(size, &at) > 0.0);
            assert_eq!(pivot > 0.0, minimum);
            assert_eq!(eliminated.negative_pivots() == 0, minimum);
            minima += usize::from(minimum);
            others += usize::from(!minimum);
        }
    }

    fn determinant(size: usize, at: &dyn Fn(usize, usize) -> f64) -> f64 {
        let mut a: Vec<f64> = (0..size * size).map(|i| at(i / size, i % size)).collect();
        let mut product = 1.0;
        for k in 0..size {
            let pivot = a[k * size + k];
            product *= pivot;
            for row in k + 1..size {
                let factor = a[row * size + k] / pivot;
                for c in k..size {
                    a[row * size + c] -= factor * a[k * size + c];
                }
            }
        }
        product
    }
}
