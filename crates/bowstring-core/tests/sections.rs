//! Backbones that are tapered, have two bending stiffnesses, or are curved and twisted without load,
//! against independent solutions.

mod common;

use bowstring_core::math::lie::exp;
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Load, Model, RodModel};
use bowstring_core::model::robot::{Profile, Section};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::solver::{Solver, Status};
use common::{kirchhoff, rod, section, solved};

/// Section of a rectangle; its first principal axis is along the width.
fn rectangle(width: f64, height: f64, young: f64, density: f64) -> Section {
    let round = section(height, young, 0.3, density);
    let shear = young / 2.6;
    Section {
        bending: [
            young * width * height.powi(3) / 12.0,
            young * height * width.powi(3) / 12.0,
        ],
        torsion: shear * 0.2 * width.min(height).powi(3) * width.max(height),
        axial: young * width * height,
        shear: shear * width * height,
        mass_per_length: density * width * height,
        ..round
    }
}

/// A round rod whose diameter changes in proportion to arc length.
fn tapered(start: f64, end: f64, young: f64, density: f64) -> Profile {
    let at = |i: usize| start + (end - start) * i as f64 / 4.0;
    Profile::Tapered(Box::new(std::array::from_fn(|i| {
        section(at(i), young, 0.3, density)
    })))
}

/// Five sections give the fourth power of a diameter exactly, and its means.
#[test]
fn a_linear_taper_is_exact() {
    let profile = tapered(0.006, 0.002, 60e9, 1000.0);
    for x in [0.0, 0.07, 0.31, 0.5, 0.83, 1.0] {
        let (found, expected) = (profile.at(x), section(0.006 - 0.004 * x, 60e9, 0.3, 1000.0));
        for (a, b) in [
            (found.bending[0], expected.bending[0]),
            (found.torsion, expected.torsion),
            (found.axial, expected.axial),
            (found.mass_per_length, expected.mass_per_length),
        ] {
            assert!((a - b).abs() < 1e-12 * b, "{x}: {a} {b}");
        }
    }
    // the mean of 1/d^4 from d0 to d1 is (1/d1^3 - 1/d0^3) / (3 (d0 - d1))
    let unit = std::f64::consts::PI * 60e9 / 64.0;
    let (a, b) = (0.006_f64, 0.002_f64);
    let expected = (b.powi(-3) - a.powi(-3)) / (3.0 * (a - b)) / unit;
    let found = profile.bending_flexibility();
    assert!((found[0] / expected - 1.0).abs() < 1e-6);
    assert_eq!(found[0], found[1]);
    assert_eq!(found[2], 0.0);
}

/// A cone under an end moment: its angle is the integral of M/(E I), in closed form; the position
/// by quadrature of that angle.
#[test]
fn a_tapered_cantilever_under_an_end_moment() {
    let (length, young) = (0.5, 60e9);
    let (a, b) = (0.005_f64, 0.003_f64);
    let unit = std::f64::consts::PI * young / 64.0;
    let moment = 0.3;
    let angle = |s: f64| {
        let d = a + (b - a) * s / length;
        moment * length / (3.0 * (a - b) * unit) * (d.powi(-3) - a.powi(-3))
    };
    // Simpson's rule, far beyond the asserted digits
    let count = 20_000;
    let h = length / count as f64;
    let (mut x, mut z) = (0.0, 0.0);
    for i in 0..=count {
        let weight = match i {
            0 => 1.0,
            i if i == count => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let theta = angle(h * i as f64);
        x += weight * h / 3.0 * theta.sin();
        z += weight * h / 3.0 * theta.cos();
    }
    let mut errors = vec![];
    for elements in [1, 2, 4, 8] {
        let robot = rod(tapered(a, b, young, 0.0), length, 10);
        let settings = RodModel {
            model: kirchhoff(),
            elements: Some(elements),
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let load = Load {
            tip_moment: [0.0, moment, 0.0],
            ..Load::default()
        };
        let outcome = solver.solve(&load).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let tip = solver.solver().tip().unwrap();
        let gap = (tip.position - Vec3([x, 0.0, z])).norm() / length;
        let turned = tip.rotation.0[0][2].atan2(tip.rotation.0[2][2]) - angle(length);
        errors.push(gap.max(turned.abs()));
        if elements < 8 {
            let stated = outcome.error.unwrap().tip + 1e-10 * length;
            assert!(gap * length <= stated, "{elements}: {gap} {stated}");
        }
    }
    assert!(errors[3] < 1e-8, "{errors:?}");
    // fourth order
    assert!(errors[1] < errors[0] / 10.0, "{errors:?}");
    assert!(errors[2] < errors[1] / 10.0, "{errors:?}");
}

/// A cone under its own weight across and a small load: Euler-Bernoulli's deflection by quadrature.
#[test]
fn a_tapered_cantilever_under_its_weight() {
    let (length, young, density) = (0.5, 60e9, 6000.0);
    let (a, b) = (0.005_f64, 0.002_f64);
    let gravity = 0.1;
    let at = |s: f64| section(a + (b - a) * s / length, young, 0.3, density);
    let count = 2_000;
    let h = length / count as f64;
    let place = |i: usize| (i as f64 + 0.5) * h;
    // deflection by unit force: integral of the moment times (L - s) over E I
    let expected: f64 = (0..count)
        .map(|i| {
            let s = place(i);
            let moment: f64 = (i..count)
                .map(|j| {
                    let inner = if j == i { 0.25 * h } else { place(j) - s };
                    let share = if j == i { 0.5 } else { 1.0 };
                    at(place(j)).mass_per_length * gravity * inner * share * h
                })
                .sum();
            moment * (length - s) / at(s).bending[0] * h
        })
        .sum();
    for elements in [1, 2, 4] {
        let across = [gravity, 0.0, 0.0];
        let robot = rod(tapered(a, b, young, density), length, 4);
        let settings = RodModel {
            model: kirchhoff(),
            elements: Some(elements),
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let load = Load {
            gravity: across,
            ..Load::default()
        };
        let outcome = solver.solve(&load).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let found = solver.solver().tip().unwrap().position[0];
        let stated = outcome.error.unwrap().tip;
        assert!(
            (found - expected).abs() < stated,
            "{elements}: {found} {expected} {stated}"
        );
        assert!(stated < 1e-3 * expected);
    }
}

/// Bent about one principal axis, a flat rod is a round one with that stiffness.
#[test]
fn a_flat_rod_bends_as_a_round_one_about_each_axis() {
    let flat = rectangle(0.012, 0.003, 60e9, 0.0);
    for (axis, force) in [(0, [0.0, 2.0, -1.0]), (1, [2.0, 0.0, -1.0])] {
        let round = Section {
            bending: [flat.bending[axis]; 2],
            ..flat
        };
        let tip = |section: Section| {
            let robot = rod(section.into(), 0.4, 6);
            let mut solver = Solver::new(&robot, Model::default(), 4).unwrap();
            let load = Load {
                tip_force: force,
                ..Load::default()
            };
            solved(&mut solver, &load);
            solver.tip().unwrap().position
        };
        // the coefficient of the quadratic strain is a mean over both axes
        assert!((tip(flat) - tip(round)).norm() < 1e-9);
    }
}

/// Without load the backbone is the helix of its curvature and twist.
#[test]
fn the_unloaded_shape_is_a_helix() {
    for rest in [[0.0, 3.0, 0.0], [2.0, -1.0, 4.0], [0.0, 0.0, 5.0]] {
        let mut helix = section(0.004, 60e9, 0.3, 0.0);
        helix.rest_curvature = rest;
        let robot = rod(helix.into(), 0.5, 5);
        for model in [Model::default(), kirchhoff()] {
            let mut solver = Solver::new(&robot, model, 1).unwrap();
            let outcome = solver.solve(&Load::default()).unwrap();
            assert_eq!(outcome.stable, Some(true));
            assert_eq!(outcome.iterations, 0);
            for k in 0..5 {
                let (disk, s) = (solver.disk(k).unwrap(), 0.1 * (k + 1) as f64);
                let expected = exp(Vec3(rest) * s);
                let apart: Mat3 = disk.rotation - expected;
                let apart = apart.rows().iter().map(|v| v.norm()).fold(0.0, f64::max);
                assert!(apart < 1e-13, "{rest:?} {apart}");
            }
        }
    }
}

/// A moment in the plane of a precurved rod bends it into another arc.
#[test]
fn an_arc_under_an_end_moment_is_an_arc() {
    let (length, rest, moment) = (0.5, 1.6, 0.9);
    let mut curved = section(0.004, 60e9, 0.3, 0.0);
    curved.rest_curvature = [0.0, rest, 0.0];
    for (modules, elements) in [(1, 1), (4, 1), (4, 2)] {
        let robot = rod(curved.into(), length, modules);
        let mut solver = Solver::new(&robot, kirchhoff(), elements).unwrap();
        let load = Load {
            tip_moment: [0.0, moment, 0.0],
            ..Load::default()
        };
        solved(&mut solver, &load);
        let curvature = rest + moment / curved.bending[0];
        let turn: f64 = curvature * length;
        let expected = Vec3([1.0 - turn.cos(), 0.0, turn.sin()]) * (1.0 / curvature);
        let gap = (solver.tip().unwrap().position - expected).norm() / length;
        assert!(gap < 1e-9, "{gap}");
    }
}

/// Simo and Vu-Quoc (1986): an arc of 45 degrees under a dead force out of its plane.
#[test]
fn bend_of_45_degrees() {
    let bend = |torsion_constant: f64, force: f64| {
        let (modulus, shear, area, inertia) = (1e7, 5e6, 1.0, 1.0 / 12.0);
        let robot = rod(
            Section {
                bending: [modulus * inertia; 2],
                principal_angle: 0.0,
                torsion: shear * torsion_constant,
                axial: modulus * area,
                shear: shear * area,
                mass_per_length: 0.0,
                rotary_inertia: 0.0,
                rest_curvature: [0.0, 0.01, 0.0],
            }
            .into(),
            100.0 * std::f64::consts::FRAC_PI_4,
            32,
        );
        let mut solver = Solver::new(&robot, Model::default(), 8).unwrap();
        let load = Load {
            tip_force: [0.0, force, 0.0],
            ..Load::default()
        };
        assert_eq!(solved(&mut solver, &load).stable, Some(true));
        let [x, y, z] = solver.tip().unwrap().position.0;
        [z, x, y] // the published axes: x along the clamped tangent, z along the force
    };
    for (constant, force, expected) in [
        (0.141, 300.0, [58.5405, 22.1152, 40.4748]),
        (0.141, 450.0, [51.9748, 18.372, 48.701]),
        (1.0 / 6.0, 600.0, [47.1504, 15.6848, 53.4749]),
    ] {
        let found = bend(constant, force);
        for q in 0..3 {
            assert!(
                (found[q] - expected[q]).abs() < 1e-3,
                "{found:?} {expected:?}"
            );
        }
    }
}
