//! Sections, and stiffness matrices of sections: curvature, twist, shear and extension.
#![allow(dead_code)]

use super::random::Draw;
use bowstring_core::model::robot::Section;

pub type Stiffness = [[f64; 6]; 6];

/// A round section.
pub fn section(diameter: f64, young: f64, poisson: f64, density: f64) -> Section {
    let area = std::f64::consts::PI * diameter * diameter / 4.0;
    let inertia = std::f64::consts::PI * diameter.powi(4) / 64.0;
    let shear = young / (2.0 * (1.0 + poisson));
    Section {
        bending: [young * inertia; 2],
        principal_angle: 0.0,
        torsion: shear * 2.0 * inertia,
        axial: young * area,
        shear: shear * area,
        mass_per_length: density * area,
        rotary_inertia: density * inertia,
        rest_curvature: [0.0; 3],
    }
}

/// A random matrix of these sizes in which couplings are this share of the largest possible.
pub fn coupled(draw: &mut Draw, sizes: [f64; 6], share: f64) -> Stiffness {
    // sum of squares over more rows than columns
    let rows: Vec<[f64; 6]> = (0..9)
        .map(|_| [0; 6].map(|_| draw.within(-1.0, 1.0)))
        .collect();
    let product = |i: usize, j: usize| rows.iter().map(|r| r[i] * r[j]).sum::<f64>();
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let (own, size) = (product(i, i) * product(j, j), sizes[i] * sizes[j]);
            let cosine = product(i, j) / own.sqrt();
            size.sqrt() * if i == j { 1.0 } else { share * cosine }
        })
    })
}

/// Inverse by Gauss's elimination with pivoting.
pub fn inverse(m: &Stiffness) -> Stiffness {
    let mut a = *m;
    let mut b: Stiffness = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    for c in 0..6 {
        let p = (c..6).max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs()));
        let p = p.unwrap();
        a.swap(c, p);
        b.swap(c, p);
        for i in (0..6).filter(|&i| i != c) {
            let f = a[i][c] / a[c][c];
            for j in 0..6 {
                a[i][j] -= f * a[c][j];
                b[i][j] -= f * b[c][j];
            }
        }
    }
    std::array::from_fn(|i| std::array::from_fn(|j| b[i][j] / a[i][i]))
}
