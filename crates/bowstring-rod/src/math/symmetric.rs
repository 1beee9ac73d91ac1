//! Eigenvalues of a small symmetric matrix by Jacobi's rotations (Golub and Van Loan, Matrix
//! Computations, 8.5).

/// Most passes over all pairs; convergence is quadratic.
const PASSES: usize = 12;
/// Largest entry beside the diagonal, over the largest entry, at which it ends.
const TOLERANCE: f64 = 1e-12;

/// Diagonalises a symmetric matrix of size `n` in place: its diagonal becomes the eigenvalues, and
/// row `k` of `vectors` the eigenvector of the `k`th.
pub fn diagonalise(n: usize, a: &mut [f64], vectors: &mut Vec<f64>) {
    vectors.clear();
    vectors.resize(n * n, 0.0);
    for i in 0..n {
        vectors[i * n + i] = 1.0;
    }
    let largest = a.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    for _ in 0..PASSES {
        let mut beside = 0.0_f64;
        for p in 0..n {
            for q in p + 1..n {
                let apq = a[p * n + q];
                beside = beside.max(apq.abs());
                if apq.abs() <= TOLERANCE * largest {
                    continue;
                }
                let half = (a[q * n + q] - a[p * n + p]) / (2.0 * apq);
                let tangent = half.signum() / (half.abs() + (half * half + 1.0).sqrt());
                let cos = 1.0 / (tangent * tangent + 1.0).sqrt();
                let sin = tangent * cos;
                for k in 0..n {
                    let (x, y) = (a[k * n + p], a[k * n + q]);
                    a[k * n + p] = cos * x - sin * y;
                    a[k * n + q] = sin * x + cos * y;
                }
                for matrix in [&mut *a, &mut vectors[..]] {
                    for k in 0..n {
                        let (x, y) = (matrix[p * n + k], matrix[q * n + k]);
                        matrix[p * n + k] = cos * x - sin * y;
                        matrix[q * n + k] = sin * x + cos * y;
                    }
                }
            }
        }
        if beside <= TOLERANCE * largest {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Draw;

    /// The vectors are orthonormal, and the sum of their squares times the eigenvalues is the
    /// matrix, also where entries of its diagonal are equal.
    #[test]
    fn vectors_and_values_make_the_matrix() {
        let mut draw = Draw::new(3, 0);
        for n in 1..12 {
            let mut a = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..=i {
                    let x = if i == j && i < 2 {
                        0.5
                    } else {
                        draw.within(-1.0, 1.0)
                    };
                    (a[i * n + j], a[j * n + i]) = (x, x);
                }
            }
            let (mut values, mut vectors) = (a.clone(), vec![]);
            diagonalise(n, &mut values, &mut vectors);
            let row = |k: usize| &vectors[k * n..][..n];
            for i in 0..n {
                for j in 0..n {
                    let dot: f64 = row(i).iter().zip(row(j)).map(|(x, y)| x * y).sum();
                    assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                    let entry = (0..n).map(|k| values[k * n + k] * row(k)[i] * row(k)[j]);
                    assert!((entry.sum::<f64>() - a[i * n + j]).abs() < 1e-11);
                }
            }
        }
    }
}
