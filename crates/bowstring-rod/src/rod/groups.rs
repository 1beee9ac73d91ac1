//! Numbers of single modules in a group, whose modules lie side by side in lanes.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};

#[inline(always)]
pub fn get<L: Layout>(v: &Vec3<L::Module>, i: usize) -> Vec3<L::Chain> {
    Vec3([L::get(&v.0[0], i), L::get(&v.0[1], i), L::get(&v.0[2], i)])
}

#[inline(always)]
pub fn get_mat<L: Layout>(m: &Mat3<L::Module>, i: usize) -> Mat3<L::Chain> {
    let mut out = Mat3::zero();
    for (row, from) in out.0.iter_mut().zip(&m.0) {
        for (x, y) in row.iter_mut().zip(from) {
            *x = L::get(y, i);
        }
    }
    out
}

#[inline(always)]
pub fn put<L: Layout>(v: &mut Vec3<L::Module>, i: usize, c: Vec3<L::Chain>) {
    for q in 0..3 {
        L::put(&mut v.0[q], i, c.0[q]);
    }
}

#[inline(always)]
pub fn put_mat<L: Layout>(m: &mut Mat3<L::Module>, i: usize, c: &Mat3<L::Chain>) {
    for (row, from) in m.0.iter_mut().zip(&c.0) {
        for (x, y) in row.iter_mut().zip(from) {
            L::put(x, i, *y);
        }
    }
}

/// A number for every module of a group; zero in idle lanes.
#[inline(always)]
pub fn lanes<L: Layout>(n: usize, g: usize, of: impl Fn(usize) -> f64) -> L::Module {
    if L::WIDTH == 1 {
        return L::Module::splat(of(g));
    }
    L::Module::from_fn(|i| {
        let k = g * L::WIDTH + i;
        if k < n {
            of(k)
        } else {
            0.0
        }
    })
}
