//! One Newton step: block elimination backward over the modules, substitution forward.
//!
//! The recursion of optimal control. State is the motion of a disk, control the rotations `u`
//! that the arcs of the module after it add (all left perturbations, in the disk's own
//! frame). Dead loads couple modules through rotation alone, so the state of statics is one
//! block of three; inertia couples them through translation as well, so that of dynamics is
//! two. The cost grows with the number of modules. The gradient comes from the exact costate,
//! so the linear term `p` starts from zero at the tip and the step is Newton's.
//!
//! A dead moment at the tip has no potential: it adds a skew part to the state matrix, and
//! the elimination then keeps both triangles (`SYMMETRIC = false`).

use crate::linalg::{Mat3, Vec3};
use crate::real::Real;

/// Second variation of a module and all beyond it: arcs, state of the start disk, and between.
pub(crate) struct Blocks<T, const A: usize, const S: usize> {
    /// Lower blocks; all of them where it is not symmetric.
    pub uu: [[Mat3<T>; A]; A],
    /// Rows of state, columns of arcs; and the other way round.
    pub xu: [[Mat3<T>; S]; A],
    pub ux: [[Mat3<T>; S]; A],
    pub xx: [[Mat3<T>; S]; S],
}

/// An eliminated module: its arcs answer its start's motion by `u = -(k + gain x)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eliminated<T, const A: usize, const S: usize> {
    /// Inverse diagonal blocks and the blocks beside them.
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

    /// Eliminates the module's arcs; returns what is left for the state. `least_pivot` falls
    /// to the least pivot, which is not positive when the module and all beyond it are not at
    /// a minimum.
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
            let (inverse, [m1, m2, m3]) = uu[i][i].inverse_and_minors();
            self.inverse[i] = inverse;
            // leading minors as pivots; where one is not positive the least is not either
            let per = T::splat(1.0) / m1.abs();
            let least = min(min(m1, m2 * per), m3 * per * per);
            *least_pivot = min(*least_pivot, least);
            for b in i + 1..A {
                let l = uu[b][i] * inverse;
                self.lower[b][i] = l;
                for a in i + 1..if SYMMETRIC { b + 1 } else { A } {
                    let beside = if SYMMETRIC {
                        uu[a][i].transpose()
                    } else {
                        uu[i][a]
                    };
                    let update = l * beside;
                    uu[b][a] -= update;
                }
            }
        }
        for i in 0..A {
            for b in i + 1..A {
                for q in 0..S {
                    let update = self.lower[b][i] * ux[i][q];
                    ux[b][q] -= update;
                }
            }
        }
        for i in (0..A).rev() {
            for q in 0..S {
                if SYMMETRIC {
                    ux[i][q] = self.inverse[i] * ux[i][q];
                    for b in i + 1..A {
                        let update = self.lower[b][i].tr_mat(ux[b][q]);
                        ux[i][q] -= update;
                    }
                } else {
                    for b in i + 1..A {
                        let update = uu[i][b] * ux[b][q];
                        ux[i][q] -= update;
                    }
                    ux[i][q] = self.inverse[i] * ux[i][q];
                }
                for p in 0..S {
                    if !SYMMETRIC || p >= q {
                        xx[p][q] -= xu[i][p] * ux[i][q];
                    }
                }
            }
        }
        self.gain = ux;
        if SYMMETRIC {
            for q in 0..S {
                xx[q][q] = xx[q][q].symmetric_part();
                for p in q + 1..S {
                    xx[q][p] = xx[p][q].transpose();
                }
            }
        } else {
            self.upper = uu;
        }
        xx
    }

    /// The same in other numbers.
    #[inline(always)]
    pub fn map<W: Real>(&self, f: impl Fn(Mat3<T>) -> Mat3<W>) -> Eliminated<W, A, S> {
        Eliminated {
            inverse: self.inverse.map(&f),
            lower: self.lower.map(|row| row.map(&f)),
            upper: self.upper.map(|row| row.map(&f)),
            gain: self.gain.map(|row| row.map(&f)),
            xu: self.xu.map(|row| row.map(&f)),
        }
    }

    /// Negative eigenvalues of the arcs' pivots.
    pub fn negative_pivots(&self) -> usize {
        self.inverse.iter().map(negative_pivots).sum()
    }

    /// Solves for the module's arcs alone.
    #[inline(always)]
    fn solve<const SYMMETRIC: bool>(&self, v: &mut [Vec3<T>; A]) {
        for i in 0..A {
            for b in i + 1..A {
                let update = self.lower[b][i] * v[i];
                v[b] -= update;
            }
        }
        for i in (0..A).rev() {
            if SYMMETRIC {
                v[i] = self.inverse[i] * v[i];
                for b in i + 1..A {
                    let update = self.lower[b][i].tr_mul(v[b]);
                    v[i] -= update;
                }
            } else {
                for b in i + 1..A {
                    let update = self.upper[i][b] * v[b];
                    v[i] -= update;
                }
                v[i] = self.inverse[i] * v[i];
            }
        }
    }

    /// Backward substitution: turns the right-hand side `g` of the arcs into their own answer
    /// `k`, and takes their part off the linear term `p` of the state.
    #[inline(always)]
    pub fn backward<const SYMMETRIC: bool>(&self, g: &mut [Vec3<T>; A], p: &mut [Vec3<T>; S]) {
        self.solve::<SYMMETRIC>(g);
        for i in 0..A {
            for q in 0..S {
                p[q] -= self.xu[i][q] * g[i];
            }
        }
    }

    /// Forward substitution: arcs from their own answer and the motion of the start disk.
    #[inline(always)]
    pub fn forward(&self, k: &[Vec3<T>; A], x: &[Vec3<T>; S]) -> [Vec3<T>; A] {
        let mut u = *k;
        for i in 0..A {
            for q in 0..S {
                u[i] += self.gain[i][q] * x[q];
            }
            u[i] = -u[i];
        }
        u
    }
}

/// Negative eigenvalues of a symmetric matrix or its inverse, in the first lane.
pub(crate) fn negative_pivots<T: Real>(matrix: &Mat3<T>) -> usize {
    let (_, minors) = matrix.inverse_and_minors();
    let signs = minors.map(|m| m.lane(0) < 0.0);
    let before = [false, signs[0], signs[1]];
    (0..3).filter(|&i| before[i] != signs[i]).count()
}

#[inline(always)]
fn min<T: Real>(a: T, b: T) -> T {
    -((-a).max(-b))
}
