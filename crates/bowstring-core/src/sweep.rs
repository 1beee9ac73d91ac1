//! One Newton step: block elimination backward over the modules, substitution forward.
//!
//! The recursion of optimal control. State is the rotation `x` of a disk, control the
//! rotations `u` that the arcs of the module after it add (both left perturbations, in the
//! disk's own frame): dead loads couple modules through rotation alone, so the state has
//! three numbers and the cost grows with the number of modules. The gradient comes from the
//! exact costate, so the linear term `p` starts from zero at the tip and the step is Newton's.
//!
//! A dead moment at the tip has no potential: it adds a skew part to the state matrix, and
//! the elimination then keeps both triangles (`SYMMETRIC = false`).

use crate::linalg::{Mat3, Vec3};
use crate::module::Hessian;
use crate::real::Real;

/// An eliminated module: its arcs answer its start's rotation by `u = -(k + gain x)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eliminated<T, const A: usize> {
    /// Inverse diagonal blocks and the blocks beside them.
    inverse: [Mat3<T>; A],
    lower: [[Mat3<T>; A]; A],
    upper: [[Mat3<T>; A]; A],
    gain: [Mat3<T>; A],
    xu: [Mat3<T>; A],
}

/// Value of a disk's rotation by all beyond it, `x . matrix x / 2`, and the least pivot so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Value<T> {
    pub matrix: Mat3<T>,
    /// Not positive when what is beyond is not at a minimum; N m.
    pub least_pivot: T,
}

impl<T: Real, const A: usize> Eliminated<T, A> {
    pub fn empty() -> Self {
        let zero = Mat3::zero();
        Eliminated {
            inverse: [zero; A],
            lower: [[zero; A]; A],
            upper: [[zero; A]; A],
            gain: [zero; A],
            xu: [zero; A],
        }
    }

    /// Eliminates the module's arcs; `value` is that of its end disk, in its own frame, and
    /// becomes that of its start. `shift` is added to the diagonal; `s` is the rotation
    /// over the module.
    #[inline(always)]
    pub fn eliminate<const SYMMETRIC: bool>(
        &mut self,
        mut hessian: Hessian<T, A>,
        s: &Mat3<T>,
        shift: T,
        value: &mut Value<T>,
    ) {
        let p = *s * value.matrix * s.transpose();
        let uu = &mut hessian.uu;
        let xu = &mut self.xu;
        *xu = hessian.xu;
        let mut ux = [Mat3::zero(); A];
        for i in 0..A {
            ux[i] = xu[i].transpose();
        }
        if SYMMETRIC {
            for i in 0..A {
                for b in i..A {
                    uu[b][i] += p;
                }
            }
        } else {
            for i in 0..A {
                for b in i + 1..A {
                    uu[i][b] = uu[b][i].transpose();
                }
            }
            for row in uu.iter_mut() {
                for block in row {
                    *block += p;
                }
            }
        }
        for i in 0..A {
            uu[i][i] = uu[i][i].add_diagonal([shift; 3]);
            xu[i] += p;
            ux[i] += p;
        }
        for i in 0..A {
            let (inverse, [m1, m2, m3]) = uu[i][i].inverse_and_minors();
            self.inverse[i] = inverse;
            // leading minors as pivots; where one is not positive the least is not either
            let per = T::splat(1.0) / m1.abs();
            let least = min(min(m1, m2 * per), m3 * per * per);
            value.least_pivot = min(value.least_pivot, least);
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
                let update = self.lower[b][i] * ux[i];
                ux[b] -= update;
            }
        }
        let mut matrix = hessian.xx + p;
        for i in (0..A).rev() {
            if SYMMETRIC {
                ux[i] = self.inverse[i] * ux[i];
                for b in i + 1..A {
                    let update = self.lower[b][i].tr_mat(ux[b]);
                    ux[i] -= update;
                }
            } else {
                for b in i + 1..A {
                    let update = uu[i][b] * ux[b];
                    ux[i] -= update;
                }
                ux[i] = self.inverse[i] * ux[i];
            }
            matrix -= xu[i] * ux[i];
        }
        self.gain = ux;
        if SYMMETRIC {
            value.matrix = matrix.symmetric_part();
        } else {
            self.upper = *uu;
            value.matrix = matrix;
        }
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

    /// Backward substitution: the arcs' own answer `k` to the right-hand side `g`, and the
    /// linear term `p` taken from the module's end (in the start's frame) to its start.
    #[inline(always)]
    pub fn backward<const SYMMETRIC: bool>(
        &self,
        mut g: [Vec3<T>; A],
        mut p: Vec3<T>,
    ) -> ([Vec3<T>; A], Vec3<T>) {
        for gi in &mut g {
            *gi += p;
        }
        self.solve::<SYMMETRIC>(&mut g);
        for i in 0..A {
            p -= self.xu[i] * g[i];
        }
        (g, p)
    }

    /// Forward substitution: arcs, and rotation of the end disk in the start's frame, from
    /// the rotation of the start disk.
    #[inline(always)]
    pub fn forward(&self, k: &[Vec3<T>; A], x: Vec3<T>) -> ([Vec3<T>; A], Vec3<T>) {
        let mut u = *k;
        let mut end = x;
        for i in 0..A {
            u[i] = -(k[i] + self.gain[i] * x);
            end += u[i];
        }
        (u, end)
    }
}

#[inline(always)]
fn min<T: Real>(a: T, b: T) -> T {
    -((-a).max(-b))
}
