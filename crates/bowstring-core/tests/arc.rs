//! Constant curvature from Rust; the 50-digit reference is in
//! tests/test_constant_curvature_arcs.py.

use bowstring_core::arc::{linear_law, Arc, Error, Hole, TendonFit};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

const LENGTH: f64 = 0.641;
const STIFFNESS: f64 = 1.073786552;

fn holes(count: usize) -> Vec<Hole> {
    (0..count)
        .map(|i| {
            let alpha = TAU * i as f64 / count as f64;
            [0.029 * alpha.cos(), 0.029 * alpha.sin()]
        })
        .collect()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} {b}");
}

#[test]
fn tendon_one_shortened_bends_towards_x() {
    let fit = TendonFit::new(&holes(3), false).unwrap();
    let (arc, misfit) = fit.fit(&[0.631, 0.646, 0.646], None).unwrap();
    let (kappa, phi) = arc.curvature();
    close(kappa, 0.01 / 0.029 / 0.641, 1e-12);
    close(phi, 0.0, 1e-13);
    assert_eq!(misfit, 0.0);
    assert!(arc.pose().position[0] > 0.1);
}

#[test]
fn linear_law_matches_its_reference() {
    let tensions = [80.0, 0.0, 0.0];
    let arc = linear_law(&tensions, &holes(3), LENGTH, STIFFNESS).unwrap();
    let tip = arc.pose().position;
    close(tip[0], 0.377307635, 1e-9);
    close(tip[2], 0.454867397, 1e-9);
}

#[test]
fn quarter_circle() {
    let arc = Arc::from_curvature(PI / 2.0, PI / 2.0, 1.0).unwrap();
    let pose = arc.pose();
    for (got, want) in pose.position.iter().zip([0.0, 2.0 / PI, 2.0 / PI]) {
        close(*got, want, 1e-15);
    }
    for (got, want) in pose.rotation[1].iter().zip([0.0, 0.0, 1.0]) {
        close(*got, want, 1e-15);
    }
}

#[test]
fn straight_is_exact() {
    let arc = Arc::from_curvature(0.0, 0.0, LENGTH).unwrap();
    assert_eq!(arc.pose().position, [0.0, 0.0, LENGTH]);
    close(arc.tendon_length([0.029, 0.0]).unwrap(), LENGTH, 1e-15);
    assert!(arc.curvature_jacobian().is_none());
}

#[test]
fn invalid_input_gives_one_sentence() {
    let all = [
        Arc::from_curvature(f64::NAN, 0.0, 1.0).map(|_| ()),
        Arc::through([0.0, 0.0, -1.0]).map(|_| ()),
        Arc::nearest([0.0, 0.0, 1.0], 0.0).map(|_| ()),
        TendonFit::new(&holes(1), false).map(|_| ()),
        TendonFit::new(&[[0.0, 0.0]; 3], true).map(|_| ()),
        TendonFit::new(&[[1.0, 0.0]; 3], false).map(|_| ()),
        linear_law(&[1.0], &holes(3), 1.0, 1.0).map(|_| ()),
        linear_law(&[1.0, f64::NAN, 0.0], &holes(3), 1.0, 1.0).map(|_| ()),
    ];
    for result in all {
        let Err(Error::Input(text)) = result else {
            panic!("no input error: {result:?}");
        };
        assert!(!text.contains('\n') && text.len() > 20);
    }
}

proptest! {
    #[test]
    fn lengths_round_trip(theta in 0.0..6.2f64, phi in -PI..PI, count in 3usize..8) {
        let arc = Arc::from_curvature(theta / LENGTH, phi, LENGTH).unwrap();
        let lengths: Vec<f64> = holes(count)
            .iter()
            .map(|h| arc.tendon_length(*h).unwrap())
            .collect();
        let fit = TendonFit::new(&holes(count), false).unwrap();
        let (got, misfit) = fit.fit(&lengths, None).unwrap();
        prop_assert!(misfit < 1e-15);
        prop_assert!((got.length - LENGTH).abs() < 1e-12);
        prop_assert!((got.bend[0] - arc.bend[0]).abs() < 1e-11);
        prop_assert!((got.bend[1] - arc.bend[1]).abs() < 1e-11);
    }

    #[test]
    fn tips_round_trip(theta in 0.0..6.2f64, phi in -PI..PI, length in 0.01..10.0f64) {
        let arc = Arc::from_curvature(theta / length, phi, length).unwrap();
        let tip = arc.pose().position;
        let through = Arc::through(tip).unwrap();
        let (_, miss) = Arc::nearest(tip, length).unwrap();
        prop_assert!((through.length / length - 1.0).abs() < 1e-11);
        prop_assert!(miss < 1e-14 * length);
    }

    #[test]
    fn jacobian_is_the_derivative(x in -4.0..4.0f64, y in -4.0..4.0f64) {
        let at = |k: usize, h: f64| {
            let mut arc = Arc { bend: [x, y], length: LENGTH };
            match k {
                2 => arc.length += h,
                _ => arc.bend[k] += h,
            }
            arc
        };
        let jacobian = at(0, 0.0).pose_jacobian();
        for k in 0..3 {
            let (up, down) = (at(k, 1e-6).pose(), at(k, -1e-6).pose());
            for i in 0..3 {
                let slope = (up.position[i] - down.position[i]) / 2e-6;
                prop_assert!((jacobian[i][k] - slope).abs() < 1e-8);
            }
        }
    }
}
