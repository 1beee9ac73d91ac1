//! One Newton step: block elimination backward over the modules, substitution forward.
//!
//! The recursion of optimal control. State is the rotation `x` of a disk (left
//! perturbation, in the disk's own frame), control is the strain `u` of the module after it:
//! dead loads couple modules through rotation alone, so the state has three numbers and the
//! cost grows with the number of modules. The gradient comes from the exact costate, so the
//! linear term `p` starts from zero at the tip and the step is Newton's.
//!
//! A dead moment at the tip has no potential: it adds a skew part to the state matrix, and
//! the elimination then keeps both triangles (`SYMMETRIC = false`).

use crate::linalg::{Mat3, Vec3};
use crate::module::{Gradient, Hessian, Response};
use crate::real::Real;

/// An eliminated module: its strain answers its start's rotation by `u = -(k + gain x)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eliminated<T, const A: usize> {
    /// Inverse diagonal blocks and the blocks beside them.
    inverse: [Mat3<T>; A],
    lower: [[Mat3<T>; A]; A],
    upper: [[Mat3<T>; A]; A],
    gain: [Mat3<T>; A],
    xu: [Mat3<T>; A],
    pub response: Response<T, A>,
}

/// Value of a state beyond a module: `x . matrix x / 2`, and the least pivot met so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Value<T> {
    pub matrix: Mat3<T>,
    /// Not positive when the modules beyond are not at a minimum (or hold a NaN).
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
            response: Response {
                j: [zero; A],
                m: zero,
                d_hat: zero,
                k: zero,
            },
        }
    }

    /// Eliminates the module's strain; `value` is that of its end disk, in its own frame, and
    /// becomes that of its start. `shift` is added to the diagonal.
    #[inline(always)]
    pub fn eliminate<const SYMMETRIC: bool>(
        &mut self,
        hessian: Hessian<T, A>,
        gradient: &Gradient<T, A>,
        s: &Mat3<T>,
        shift: T,
        value: &mut Value<T>,
    ) {
        let Hessian {
            mut uu,
            mut xu,
            xx,
            response,
        } = hessian;
        let h = &gradient.h;
        let p = *s * value.matrix * s.transpose();
        let even = if SYMMETRIC { p } else { p.symmetric_part() };
        let mut ux = [Mat3::zero(); A];
        for i in 0..A {
            let ph = even * h[i];
            for b in i..A {
                uu[b][i] += h[b].tr_mat(ph);
            }
            for q in 0..3 {
                uu[i][i].0[q][q] += shift;
            }
            xu[i] += ph;
            ux[i] = xu[i].transpose();
        }
        if !SYMMETRIC {
            let odd = p - even;
            for i in 0..A {
                for b in i + 1..A {
                    uu[i][b] = uu[b][i].transpose();
                }
            }
            for i in 0..A {
                let oh = odd * h[i];
                for b in 0..A {
                    uu[b][i] += h[b].tr_mat(oh);
                }
                xu[i] += oh;
                ux[i] += h[i].tr_mat(odd);
            }
        }
        for i in 0..A {
            let (inverse, minors) = uu[i][i].inverse_and_minors();
            self.inverse[i] = inverse;
            let scale = minors[0].abs();
            let normalised = [minors[0], minors[1] / scale, minors[2] / (scale * scale)];
            for m in normalised {
                value.least_pivot = -((-value.least_pivot).max(-m));
            }
            for b in i + 1..A {
                let l = uu[b][i] * inverse;
                self.lower[b][i] = l;
                if SYMMETRIC {
                    for a in i + 1..=b {
                        let update = l * uu[a][i].transpose();
                        uu[b][a] -= update;
                    }
                } else {
                    for a in i + 1..A {
                        let update = l * uu[i][a];
                        uu[b][a] -= update;
                    }
                }
            }
        }
        self.upper = uu;
        self.xu = xu;
        let mut matrix = xx + p;
        let mut rhs = ux;
        for i in 0..A {
            for b in i + 1..A {
                let update = self.lower[b][i] * rhs[i];
                rhs[b] -= update;
            }
        }
        for i in (0..A).rev() {
            if SYMMETRIC {
                rhs[i] = self.inverse[i] * rhs[i];
                for b in i + 1..A {
                    let update = self.lower[b][i].tr_mat(rhs[b]);
                    rhs[i] -= update;
                }
            } else {
                for b in i + 1..A {
                    let update = self.upper[i][b] * rhs[b];
                    rhs[i] -= update;
                }
                rhs[i] = self.inverse[i] * rhs[i];
            }
            matrix -= xu[i] * rhs[i];
        }
        self.gain = rhs;
        self.response = response;
        value.matrix = if SYMMETRIC {
            matrix.symmetric_part()
        } else {
            matrix
        };
    }

    /// Solves for the module's strain alone.
    #[inline(always)]
    pub fn solve<const SYMMETRIC: bool>(&self, mut v: [Vec3<T>; A]) -> [Vec3<T>; A] {
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
        v
    }

    /// Backward substitution: the module's own answer `k` to the right-hand side `g`, and the
    /// linear term `p` taken from its end (in the start's frame) to its start.
    #[inline(always)]
    pub fn backward<const SYMMETRIC: bool>(
        &self,
        h: &[Mat3<T>; A],
        mut g: [Vec3<T>; A],
        p: Vec3<T>,
    ) -> ([Vec3<T>; A], Vec3<T>) {
        for i in 0..A {
            g[i] += h[i].tr_mul(p);
        }
        let k = self.solve::<SYMMETRIC>(g);
        let mut p = p;
        for i in 0..A {
            p -= self.xu[i] * k[i];
        }
        (k, p)
    }

    /// Forward substitution: strain and the rotation of the end disk, in the start's frame,
    /// from the rotation of the start disk.
    #[inline(always)]
    pub fn forward(
        &self,
        h: &[Mat3<T>; A],
        k: &[Vec3<T>; A],
        x: Vec3<T>,
    ) -> ([Vec3<T>; A], Vec3<T>) {
        let mut u = [Vec3::zero(); A];
        let mut end = x;
        for i in 0..A {
            u[i] = -(k[i] + self.gain[i] * x);
            end += h[i] * u[i];
        }
        (u, end)
    }
}
