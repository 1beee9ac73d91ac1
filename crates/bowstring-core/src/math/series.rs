//! Functions near zero by their series.

use crate::math::real::Real;

const FACTORIAL: [f64; 8] = [1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0];

/// Bound of `x` below which eight terms of the series are exact to rounding.
const SHORT_SERIES: f64 = 0.6;
/// Bound of `x` below which the long series is exact to rounding; above it sine and cosine lose
/// nothing.
const LONG_SERIES: f64 = 12.0;

/// Stumpff's functions `c_k(x) = sum_i (-x)^i / (k + 2 i)!`, `c_0` to `c_7` at `x >= 0`: cosine,
/// `sin(t) / t`, `(1 - cos(t)) / t^2` and so on at `x = t^2`.
#[inline(always)]
pub(crate) fn stumpff<T: Real>(x: T) -> [T; 8] {
    let largest = x.largest();
    if largest < SHORT_SERIES {
        downward(x, 8)
    } else if largest < LONG_SERIES {
        downward(x, 20)
    } else {
        stumpff_far(x)
    }
}

/// The two highest functions by their series (`n` terms), the others by `c_k = 1/k! - x c_{k+2}`.
#[inline(always)]
fn downward<T: Real>(x: T, n: usize) -> [T; 8] {
    let one = T::splat(1.0);
    let (mut c6, mut c7) = (one, one);
    for i in (1..n).rev() {
        let k = 2.0 * i as f64;
        c6 = (x * c6).mul_add(T::splat(-1.0 / ((k + 5.0) * (k + 6.0))), one);
        c7 = (x * c7).mul_add(T::splat(-1.0 / ((k + 6.0) * (k + 7.0))), one);
    }
    let mut c = [one; 8];
    c[6] = c6 * T::splat(1.0 / FACTORIAL[6]);
    c[7] = c7 * T::splat(1.0 / FACTORIAL[7]);
    for k in (0..6).rev() {
        c[k] = (-x).mul_add(c[k + 2], T::splat(1.0 / FACTORIAL[k]));
    }
    c
}

#[cold]
#[inline(never)]
fn stumpff_far<T: Real>(x: T) -> [T; 8] {
    let mut c = [T::zero(); 8];
    for (k, ck) in c.iter_mut().enumerate() {
        *ck = T::from_fn(|lane| {
            let x = x.lane(lane);
            if x < LONG_SERIES {
                return downward(x, 20)[k];
            }
            let theta = x.sqrt();
            let mut value = if k % 2 == 0 {
                theta.cos()
            } else {
                theta.sin() / theta
            };
            for i in (k % 2..k).step_by(2) {
                value = (1.0 / FACTORIAL[i] - value) / x;
            }
            value
        });
    }
    c
}

/// Arc tangent of a number up to 0.2.
#[inline(always)]
pub(crate) fn small_arc_tangent<T: Real>(tangent: T) -> T {
    let square = tangent * tangent;
    let mut sum = T::zero();
    for n in (0..11).rev() {
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        sum = sum.mul_add(square, T::splat(sign / (2 * n + 1) as f64));
    }
    sum * tangent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stumpff_is_continuous_across_its_branches() {
        for edge in [SHORT_SERIES, LONG_SERIES] {
            let (a, b) = (stumpff(edge * (1.0 - 1e-15)), stumpff(edge * (1.0 + 1e-15)));
            for k in 0..8 {
                let scale = 1.0 / FACTORIAL[k];
                assert!((a[k] - b[k]).abs() < 1e-13 * scale, "c{k} at {edge}");
            }
        }
        let far = stumpff(30.0);
        assert!((far[0] - 30f64.sqrt().cos()).abs() < 1e-15);
    }
}
