//! Functions near zero by their series.

use crate::math::real::Real;

/// `1 / k!`
const PER_FACTORIAL: [f64; 46] = {
    let mut per = [1.0; 46];
    let mut k = 1;
    while k < per.len() {
        per[k] = per[k - 1] / k as f64;
        k += 1;
    }
    per
};

/// Bound of `x` below which eight terms of the series are exact to rounding.
const SHORT_SERIES: f64 = 0.6;
/// Bound of `x` below which the long series is exact to rounding; above it sine and cosine lose
/// nothing.
const LONG_SERIES: f64 = 12.0;

/// Stumpff's functions `c_k(x) = sum_i (-x)^i / (k + 2 i)!`, `c_0` to `c_7` at `x >= 0`: cosine,
/// `sin(t) / t`, `(1 - cos(t)) / t^2` and so on at `x = t^2`.
#[inline(always)]
pub fn stumpff<T: Real>(x: T) -> [T; 8] {
    if x.all_below(SHORT_SERIES) {
        downward(x, 8)
    } else if x.all_below(LONG_SERIES) {
        downward(x, 20)
    } else {
        // copied: what a call writes to stays in memory
        let [a, b, c, d, e, f, g, h] = stumpff_far(x);
        [a, b, c, d, e, f, g, h]
    }
}

/// The two highest functions by their series (`n` terms), the others by `c_k = 1/k! - x c_{k+2}`.
#[inline(always)]
fn downward<T: Real>(x: T, n: usize) -> [T; 8] {
    let last = 4 + 2 * n;
    let mut c = [T::zero(); 8];
    let (mut c6, mut c7) = (
        T::splat(PER_FACTORIAL[last]),
        T::splat(PER_FACTORIAL[last + 1]),
    );
    for i in (0..n - 1).rev() {
        c6 = (-x).mul_add(c6, T::splat(PER_FACTORIAL[6 + 2 * i]));
        c7 = (-x).mul_add(c7, T::splat(PER_FACTORIAL[7 + 2 * i]));
    }
    (c[6], c[7]) = (c6, c7);
    for k in (0..6).rev() {
        c[k] = (-x).mul_add(c[k + 2], T::splat(PER_FACTORIAL[k]));
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
                value = (PER_FACTORIAL[i] - value) / x;
            }
            value
        });
    }
    c
}

/// Arc tangent of a number up to 0.2.
#[inline(always)]
pub fn small_arc_tangent<T: Real>(tangent: T) -> T {
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
                let scale = PER_FACTORIAL[k];
                assert!((a[k] - b[k]).abs() < 1e-13 * scale, "c{k} at {edge}");
            }
        }
        let far = stumpff(30.0);
        assert!((far[0] - 30f64.sqrt().cos()).abs() < 1e-15);
    }
}
