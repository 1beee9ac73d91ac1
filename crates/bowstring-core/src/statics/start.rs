//! Strain as a polynomial of the load, fitted to a sample of many loads: where the others start.
//!
//! Theory: docs/theory/statics.md (Globalisation).

use crate::interrupt;
use crate::lanes::polynomial::{Basis, Input, Number, StartPolynomial, Values};
use crate::math::mlcp::eliminate;
use crate::math::real::Real;
use crate::model::load::Load;
use crate::statics::loads::Loads;

/// Most terms: evaluating more takes longer than the Newton steps that it saves.
const MOST_TERMS: usize = 84;
const HIGHEST_DEGREE: usize = 6;
/// Loads to fit to, over the number of terms.
const OVERSAMPLING: usize = 2;
/// Loads to check a fit with, which it has not seen.
const CHECKS: usize = 16;
/// Loads for each one of the sample, so that the fit costs a small part of the solves.
const LOADS_PER_SAMPLE: usize = 16;
/// Largest error of a strain in the checks (rad in an element), and over the largest strain.
const LARGEST_ERROR: f64 = 0.02;
const LARGEST_SHARE: f64 = 0.1;
/// Ridge over the diagonal of the normal equations: loads may vary in fewer directions than numbers.
const RIDGE: f64 = 1e-12;

/// Numbers that differ by less, over their size, are taken as equal.
const ROUNDING: f64 = 1e-9;

/// Rows to solve before the fit, the last [`CHECKS`] of them for its check; empty where a fit
/// would not pay.
pub fn sample(loads: &Loads, tendons: usize) -> Vec<usize> {
    let inputs = varying(loads, tendons).len();
    let n = loads.count;
    let sizes = (1..=HIGHEST_DEGREE).map(|degree| Basis::size(inputs, degree));
    let fitting = sizes.take_while(|size| *size <= MOST_TERMS);
    let counts = fitting.map(|size| OVERSAMPLING * size + CHECKS);
    let Some(count) = counts
        .take_while(|count| count * LOADS_PER_SAMPLE <= n)
        .last()
    else {
        return vec![];
    };
    // a stride by the golden section, so that rows in the order of a grid are sampled evenly
    let golden = (n as f64 * 0.618_033_988_749_895) as usize;
    let stride = (golden..n).find(|stride| gcd(*stride, n) == 1);
    let stride = stride.unwrap_or(1);
    (0..count)
        .map(|j| (j as u128 * stride as u128 % n as u128) as usize)
        .collect()
}

/// The polynomial of the highest degree that agrees with the checks; none where the strain is
/// no smooth function of the load.
pub fn fit(loads: &Loads, tendons: usize, solved: &[(usize, Vec<f64>)]) -> Option<StartPolynomial> {
    let inputs = varying(loads, tendons);
    let (_, first) = solved.first()?;
    let (fitted, checks) = solved.split_at(solved.len().checked_sub(CHECKS)?);
    let largest = solved.iter().flat_map(|(_, strain)| strain);
    let largest = largest.fold(0.0, |m, w| f64::max(m, w.abs()));
    let allowed = LARGEST_ERROR.min(LARGEST_SHARE * largest);
    let degrees = (1..=HIGHEST_DEGREE).rev();
    let fitting = degrees.filter(|degree| {
        let size = Basis::size(inputs.len(), *degree);
        size <= MOST_TERMS && OVERSAMPLING * size <= fitted.len()
    });
    for degree in fitting {
        let basis = Basis::new(&inputs, degree);
        let row = |i: usize| loads.row(i, tendons);
        let Some(coefficients) = least_squares(&basis, fitted, row, first.len()) else {
            continue;
        };
        let start = StartPolynomial {
            basis,
            coefficients,
        };
        let mut found = vec![0.0; first.len()];
        let mut values = Values::empty();
        let error = checks.iter().fold(0.0, |error, (i, strain)| {
            start.evaluate(&[row(*i)], &mut values, |at, w: f64| found[at] = w);
            let errors = found.iter().zip(strain).map(|(a, b)| (a - b).abs());
            errors.fold(error, Real::max)
        });
        if error <= allowed {
            return Some(start);
        }
    }
    None
}

/// The numbers of the loads that differ between rows.
fn varying(loads: &Loads, tendons: usize) -> Vec<Input> {
    let column = |of: &[f64], width: usize, at: usize| {
        let column = of.iter().skip(at).step_by(width.max(1));
        column.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
            (low.min(x), high.max(x))
        })
    };
    let tensions = (0..tendons).map(|i| (Number::Tension(i), column(loads.tensions, tendons, i)));
    let gravity = (0..3).map(|q| (Number::Gravity(q), column(loads.gravity, 3, q)));
    let tip_force = (0..3).map(|q| (Number::TipForce(q), column(loads.tip_force, 3, q)));
    let width = 3 * loads.disks;
    let disk_forces = (0..width).filter(|_| !loads.disk_forces.is_empty());
    let disk_forces = disk_forces.map(|at| {
        let column = column(loads.disk_forces.as_flattened(), width, at);
        (Number::DiskForce(at / 3, at % 3), column)
    });
    let all = tensions.chain(gravity).chain(tip_force).chain(disk_forces);
    all.filter(|(_, (low, high))| high - low > ROUNDING * f64::max(high.abs(), low.abs()))
        .map(|(number, (low, high))| Input {
            number,
            middle: 0.5 * low + 0.5 * high,
            per_unit: 1.0 / (0.5 * high - 0.5 * low),
        })
        .collect()
}

/// Coefficients of the best fit, by components of the strain, then by terms.
fn least_squares<'l>(
    basis: &Basis,
    solved: &[(usize, Vec<f64>)],
    row: impl Fn(usize) -> Load<'l>,
    components: usize,
) -> Option<Vec<f64>> {
    let m = basis.terms.len() + 1;
    let width = m + components;
    // normal equations, with the strains on the right
    let mut a = vec![0.0; m * width];
    let mut values = Values::empty();
    for (i, strain) in solved {
        if interrupt::work(m * width / 64) {
            return None;
        }
        basis.evaluate(&[row(*i)], &mut values);
        for (line, p) in a.chunks_exact_mut(width).zip(&values.terms) {
            for (x, q) in line.iter_mut().zip(values.terms.iter().chain(strain)) {
                *x += p * q;
            }
        }
    }
    let ridge = RIDGE * (0..m).fold(0.0, |most, j| f64::max(most, a[j * width + j]));
    for j in 0..m {
        a[j * width + j] += ridge;
    }
    if !eliminate(&mut a, m) {
        return None;
    }
    let of = |component: usize| (0..m).map(move |j| (j, m + component));
    let all = (0..components).flat_map(of);
    Some(all.map(|(j, column)| a[j * width + column]).collect())
}

fn gcd(a: usize, b: usize) -> usize {
    match b {
        0 => a,
        _ => gcd(b, a % b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Draw;

    /// Random tensions of two tendons and random tip forces, without gravity.
    struct Rows {
        tensions: Vec<f64>,
        tip_force: Vec<f64>,
    }

    impl Rows {
        fn new(count: usize) -> Self {
            let mut draw = Draw::new(1, count);
            let mut many = |n: usize| (0..n).map(|_| draw.within(0.0, 40.0)).collect();
            Rows {
                tensions: many(2 * count),
                tip_force: many(3 * count),
            }
        }

        fn loads(&self) -> Loads<'_> {
            Loads {
                count: self.tensions.len() / 2,
                tensions: &self.tensions,
                gravity: &[0.0, 0.0, -9.81],
                tip_force: &self.tip_force,
                tip_moment: &[0.0; 3],
                ..Loads::default()
            }
        }
    }

    /// Two components of a strain: a polynomial of the third degree.
    fn cubic(load: &Load) -> Vec<f64> {
        let (a, b, f) = (load.tensions[0], load.tensions[1], load.tip_force);
        let cubic = 1e-2 * a - 2e-6 * a * a * b + 3e-6 * f[0] * b * f[2];
        vec![cubic, 0.1 - 1e-4 * f[1] * f[1]]
    }

    fn solved(loads: &Loads, of: impl Fn(&Load) -> Vec<f64>) -> Vec<(usize, Vec<f64>)> {
        let sample = sample(loads, 2);
        sample.iter().map(|i| (*i, of(&loads.row(*i, 2)))).collect()
    }

    #[test]
    fn a_polynomial_is_reproduced_in_every_row() {
        let rows = Rows::new(5000);
        let loads = rows.loads();
        let start = fit(&loads, 2, &solved(&loads, cubic)).unwrap();
        let mut values = Values::empty();
        for i in 0..loads.count {
            let load = loads.row(i, 2);
            let wanted = cubic(&load);
            start.evaluate(&[load], &mut values, |at, w: f64| {
                assert!((w - wanted[at]).abs() < 1e-8, "{w} {}", wanted[at])
            });
        }
    }

    #[test]
    fn a_jump_between_branches_has_no_polynomial() {
        let rows = Rows::new(5000);
        let loads = rows.loads();
        let jump = |load: &Load| vec![if load.tensions[0] > 20.0 { 0.3 } else { -0.3 }];
        assert!(fit(&loads, 2, &solved(&loads, jump)).is_none());
    }

    #[test]
    fn a_sample_is_spread_over_the_rows_and_small() {
        let rows = Rows::new(5000);
        let mut chosen = sample(&rows.loads(), 2);
        chosen.sort_unstable();
        chosen.dedup();
        assert!((100..=5000 / LOADS_PER_SAMPLE).contains(&chosen.len()));
        let gaps = chosen.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(gaps.max().unwrap() < 5 * 5000 / chosen.len());
        assert!(sample(&Rows::new(100).loads(), 2).is_empty());
        assert!(sample(&Rows::new(0).loads(), 2).is_empty());
    }

    /// Rows on a line in the space of the loads: the normal equations are singular.
    #[test]
    fn loads_on_a_line_are_fitted() {
        let mut rows = Rows::new(2000);
        for i in 0..2000 {
            let t = i as f64 / 50.0;
            rows.tensions[2 * i..][..2].copy_from_slice(&[t, 10.0 + t]);
            rows.tip_force[3 * i..][..3].copy_from_slice(&[0.0, 1.0, t]);
        }
        let loads = rows.loads();
        let smooth = |load: &Load| vec![(0.05 * load.tensions[0]).sin()];
        let start = fit(&loads, 2, &solved(&loads, smooth)).unwrap();
        let mut values = Values::empty();
        for i in 0..loads.count {
            let load = loads.row(i, 2);
            let wanted = smooth(&load)[0];
            start.evaluate(&[load], &mut values, |_, w: f64| {
                assert!((w - wanted).abs() < 1e-3, "{w} {wanted}")
            });
        }
    }
}
