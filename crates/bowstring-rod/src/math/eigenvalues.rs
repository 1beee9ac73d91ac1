//! The largest eigenvalues of an unsymmetric matrix: Arnoldi's iteration, and the QR algorithm on
//! the small Hessenberg matrix that it leaves (Golub and Van Loan, Matrix Computations, 7.5, 10.5).
//!
//! Theory: docs/theory/statics.md (Stability).

use crate::math::linalg::dot;

/// Norm, over that of the matrix, below which a vector adds no direction.
const NEGLIGIBLE: f64 = 1e-13;
/// Most QR steps for one eigenvalue.
const MAX_STEPS: usize = 60;

/// Eigenvalues `[re, im]` of a matrix given by its product with a vector, the largest among them,
/// `most` at most. `None` where they are not finite.
pub fn largest(
    size: usize,
    most: usize,
    mut apply: impl FnMut(&[f64], &mut [f64]),
) -> Option<Vec<[f64; 2]>> {
    let most = most.min(size);
    // a fixed start vector without symmetry
    let mut start: Vec<f64> = (0..size).map(|i| 1.0 + (1.7 * i as f64).sin()).collect();
    scale(&mut start, 1.0);
    let mut basis = vec![start];
    let mut rows = vec![vec![0.0; most]; most];
    let mut count = most;
    let mut next = vec![0.0; size];
    for j in 0..most {
        apply(&basis[j], &mut next);
        let whole = dot(&next, &next).sqrt();
        // two passes keep them orthogonal
        for _ in 0..2 {
            for (i, v) in basis.iter().enumerate() {
                let share = dot(&next, v);
                rows[i][j] += share;
                next.iter_mut().zip(v).for_each(|(n, v)| *n -= share * v);
            }
        }
        let left = dot(&next, &next).sqrt();
        if !left.is_finite() {
            return None;
        }
        if j + 1 == most {
            break;
        }
        if left <= NEGLIGIBLE * whole {
            count = j + 1;
            break;
        }
        rows[j + 1][j] = left;
        let mut unit = next.clone();
        scale(&mut unit, 1.0);
        basis.push(unit);
    }
    rows.truncate(count);
    for row in &mut rows {
        row.truncate(count);
    }
    hessenberg(rows)
}

fn scale(v: &mut [f64], length: f64) {
    let factor = length / dot(v, v).sqrt();
    v.iter_mut().for_each(|x| *x *= factor);
}

/// Eigenvalues of an upper Hessenberg matrix, given row by row, by Francis' double-shift QR
/// algorithm.
fn hessenberg(mut h: Vec<Vec<f64>>) -> Option<Vec<[f64; 2]>> {
    let size = h.len();
    let mut found = Vec::with_capacity(size);
    let norm: f64 = h.iter().flatten().map(|x| x.abs()).sum();
    let mut end = size;
    let mut steps = 0;
    while end > 0 {
        let last = end - 1;
        // start of the trailing unreduced block
        let mut start = last;
        while start > 0 {
            let mut near = h[start - 1][start - 1].abs() + h[start][start].abs();
            if near == 0.0 {
                near = norm;
            }
            if h[start][start - 1].abs() <= f64::EPSILON * near {
                h[start][start - 1] = 0.0;
                break;
            }
            start -= 1;
        }
        if start == last {
            found.push([h[last][last], 0.0]);
            end -= 1;
            steps = 0;
            continue;
        }
        let (a, b) = (h[last - 1][last - 1], h[last - 1][last]);
        let (c, d) = (h[last][last - 1], h[last][last]);
        if start + 1 == last {
            found.extend(pair(a, b, c, d));
            end -= 2;
            steps = 0;
            continue;
        }
        if steps == MAX_STEPS {
            return None;
        }
        steps += 1;
        let (mut sum, mut product) = (a + d, a * d - b * c);
        if steps % 10 == 0 {
            // exceptional shift, against a cycle
            let size = c.abs() + h[last - 1][last - 2].abs();
            (sum, product) = (1.5 * size, size * size);
        }
        let (p, q) = (h[start][start], h[start + 1][start]);
        let mut x = p * p + h[start][start + 1] * q - sum * p + product;
        let mut y = q * (p + h[start + 1][start + 1] - sum);
        let mut z = q * h[start + 2][start + 1];
        for k in start..last {
            let three = k + 2 <= last;
            let mut v = [x, y, if three { z } else { 0.0 }];
            let length = dot(&v, &v).sqrt();
            if length > 0.0 {
                v[0] += length.copysign(v[0]);
                let factor = 2.0 / dot(&v, &v);
                let width = if three { 3 } else { 2 };
                for j in k.saturating_sub(1).max(start)..size {
                    let along: f64 = (0..width).map(|i| v[i] * h[k + i][j]).sum();
                    (0..width).for_each(|i| h[k + i][j] -= factor * along * v[i]);
                }
                for row in h.iter_mut().take((k + 4).min(end)) {
                    let along: f64 = (0..width).map(|i| v[i] * row[k + i]).sum();
                    (0..width).for_each(|i| row[k + i] -= factor * along * v[i]);
                }
            }
            x = h[k + 1][k];
            y = if three { h[k + 2][k] } else { 0.0 };
            z = if k + 3 <= last { h[k + 3][k] } else { 0.0 };
        }
    }
    let finite = found.iter().flatten().all(|x| x.is_finite());
    finite.then_some(found)
}

/// Eigenvalues of a 2x2 matrix.
fn pair(a: f64, b: f64, c: f64, d: f64) -> [[f64; 2]; 2] {
    let (mean, half) = (0.5 * (a + d), 0.5 * (a - d));
    let inside = half * half + b * c;
    let root = inside.abs().sqrt();
    if inside < 0.0 {
        return [[mean, root], [mean, -root]];
    }
    // the larger root first, without cancellation
    let far = mean + root.copysign(mean);
    let near = if far == 0.0 {
        0.0
    } else {
        (a * d - b * c) / far
    };
    [[far, 0.0], [near, 0.0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(mut values: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        values.sort_by(|a, b| a.partial_cmp(b).unwrap());
        values
    }

    /// Eigenvalues of a block-diagonal matrix are recovered after a non-orthogonal change of basis.
    #[test]
    fn eigenvalues_match_the_blocks() {
        let size = 12;
        let mut matrix = vec![vec![0.0; size]; size];
        for i in 0..4 {
            let (re, im) = (3.05 - i as f64, 0.5 + 0.3 * i as f64);
            matrix[2 * i][2 * i] = re;
            matrix[2 * i + 1][2 * i + 1] = re;
            matrix[2 * i][2 * i + 1] = im;
            matrix[2 * i + 1][2 * i] = -im;
        }
        for i in 8..size {
            matrix[i][i] = 0.1 * i as f64;
        }
        // adds a multiple of one row to another, and subtracts it from the columns
        for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
            if i != j && (i + 2 * j) % 3 == 0 {
                let share = 0.3 * ((i * 5 + j) as f64).sin();
                for q in 0..size {
                    matrix[i][q] += share * matrix[j][q];
                }
                for row in &mut matrix {
                    row[j] -= share * row[i];
                }
            }
        }
        let apply = |x: &[f64], out: &mut [f64]| {
            for (row, out) in matrix.iter().zip(out) {
                *out = dot(row, x);
            }
        };
        let mut expected: Vec<_> = (8..size).map(|i| [0.1 * i as f64, 0.0]).collect();
        for i in 0..4 {
            let (re, im) = (3.05 - i as f64, 0.5 + 0.3 * i as f64);
            expected.extend([[re, im], [re, -im]]);
        }
        let found = largest(size, size, apply).unwrap();
        assert_eq!(found.len(), size);
        for (a, b) in sorted(found).into_iter().zip(sorted(expected)) {
            assert!((a[0] - b[0]).abs() < 1e-9, "{a:?} {b:?}");
            assert!((a[1].abs() - b[1].abs()).abs() < 1e-9, "{a:?} {b:?}");
        }
    }

    #[test]
    fn few_vectors_give_the_largest() {
        let size = 200;
        let apply = |x: &[f64], out: &mut [f64]| {
            for i in 0..size {
                out[i] = x[i] / (1 + i * i) as f64;
            }
            // a rotating pair
            out[0] += 0.01 * x[1];
            out[1] += 0.5 * x[1] - 0.01 * x[0];
        };
        let found = largest(size, 30, apply).unwrap();
        let largest = found
            .iter()
            .map(|[re, im]| re.hypot(*im))
            .fold(0.0, f64::max);
        // of [[1, 0.01], [-0.01, 1]]
        assert!((largest - 1.0f64.hypot(0.01)).abs() < 1e-9, "{largest}");
        let turning = found.iter().map(|[_, im]| im.abs()).fold(0.0, f64::max);
        assert!((turning - 0.01).abs() < 1e-9, "{turning}");
    }
}
