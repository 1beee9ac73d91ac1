//! Backbones that are curved and twisted without load.

#[path = "common/cases.rs"]
mod cases;
mod common;

use bowstring_core::math::lie::exp;
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Load, Model, RodModel, Theory};
use bowstring_core::model::robot::{Disk, Profile, Robot, RobotSpec, Section};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::{Solver, Status};
use cases::{Case, Draw};
use common::section;

fn precurved(number: usize) -> (Case, Robot) {
    let mut draw = Draw::new(22, number);
    let case = Case::realistic(&mut draw);
    let case = case.routed(&mut draw).precurved(&mut draw);
    let robot = Robot::new(case.spec.clone()).unwrap();
    (case, robot)
}

/// A backbone without mass or tendons, in equal modules.
fn rod(section: Section, length: f64, modules: usize) -> Robot {
    let disk = |k: usize| Disk {
        hole_length: 0.0,
        station: length * k as f64 / modules as f64,
        clamped_length: 0.0,
        mass: 0.0,
        inertia: [0.0; 2],
        segment: 0,
    };
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section.into()],
        disks: (1..=modules).map(disk).collect(),
        tendons: vec![],
        gravity: [0.0; 3],
    })
    .unwrap()
}

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

/// Wrench and shape, with random routing too, satisfy the equations of a precurved rod.
#[test]
fn random_robots_satisfy_the_rod_equations() {
    let (mut converged, mut tensions) = (0, vec![]);
    for number in 0..300 {
        let (case, robot) = precurved(number);
        let mut gap = |elements: usize| {
            let mut solver = Solver::new(&robot, case.model(), elements).unwrap();
            let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
            (outcome.status == Status::Converged)
                .then(|| case.gap(&robot, &solver, 100).unwrap_or(0.0))
        };
        let (Some(coarse), Some(fine)) = (gap(1), gap(8)) else {
            continue;
        };
        converged += 1;
        let most = match case.theory {
            Theory::Kirchhoff => f64::max(1e-6, coarse / 300.0),
            Theory::Cosserat => f64::max(1e-5, coarse / 40.0),
        };
        assert!(fine < most, "draw {number}: {fine} of {coarse}");
    }
    assert!(converged > 260, "{converged}");
}

#[test]
fn stated_errors_hold() {
    let (mut compared, mut tensions) = (0, vec![]);
    for number in 0..200 {
        let (case, robot) = precurved(number);
        let load = case.at(1.0, &mut tensions);
        let settings = RodModel {
            model: case.model(),
            elements: None,
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let outcome = solver.solve(&load).unwrap();
        let mut fine = Solver::new(&robot, case.model(), 8).unwrap();
        let exact = fine.solve(&load).unwrap();
        if (outcome.status, exact.status) != (Status::Converged, Status::Converged) {
            continue;
        }
        let tip = solver.solver().tip().unwrap().position;
        let error = (tip - fine.tip().unwrap().position).norm();
        if error > 1e-2 * robot.length() {
            continue; // another equilibrium
        }
        compared += 1;
        let stated = outcome.error.unwrap().tip + 1e-9 * robot.length();
        assert!(error <= stated, "draw {number}: {error} of {stated}");
    }
    assert!(compared > 165, "{compared}");
}

/// Without load the backbone is the helix of its curvature and twist.
#[test]
fn the_unloaded_shape_is_a_helix() {
    for rest in [[0.0, 3.0, 0.0], [2.0, -1.0, 4.0], [0.0, 0.0, 5.0]] {
        let mut helix = section(0.004, 60e9, 0.3, 0.0);
        helix.rest_curvature = rest;
        let robot = rod(helix, 0.5, 5);
        for theory in [Theory::Cosserat, Theory::Kirchhoff] {
            let model = Model {
                theory,
                ..Model::default()
            };
            let mut solver = Solver::new(&robot, model, 1).unwrap();
            let outcome = solver.solve(&Load::default()).unwrap();
            assert_eq!(outcome.stable, Some(true));
            assert_eq!(outcome.iterations, 0);
            for k in 0..5 {
                let (disk, s) = (solver.disk(k).unwrap(), 0.1 * (k + 1) as f64);
                let expected = exp(Vec3(rest) * s);
                let apart = Mat3(std::array::from_fn(|i| {
                    std::array::from_fn(|j| disk.rotation.0[i][j] - expected.0[i][j])
                }));
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
        let robot = rod(curved, length, modules);
        let mut solver = Solver::new(&robot, kirchhoff(), elements).unwrap();
        let load = Load {
            tip_moment: [0.0, moment, 0.0],
            ..Load::default()
        };
        assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
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
            },
            100.0 * std::f64::consts::FRAC_PI_4,
            32,
        );
        let mut solver = Solver::new(&robot, Model::default(), 8).unwrap();
        let load = Load {
            tip_force: [0.0, force, 0.0],
            ..Load::default()
        };
        let outcome = solver.solve(&load).unwrap();
        assert_eq!(
            (outcome.status, outcome.stable),
            (Status::Converged, Some(true))
        );
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

/// Turning the backbone with everything else turns the answer.
#[test]
fn the_answer_turns_with_the_robot() {
    let mut tensions = vec![];
    for number in 0..40 {
        let (case, robot) = precurved(number);
        let angle: f64 = 0.3 + number as f64;
        let (sin, cos) = angle.sin_cos();
        let turn = |v: [f64; 3]| [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]];
        let mut other = case.clone();
        for tendon in &mut other.spec.tendons {
            for hole in &mut tendon.holes {
                let [x, y, _] = turn([hole[0], hole[1], 0.0]);
                *hole = [x, y];
            }
        }
        for section in other
            .spec
            .backbone
            .iter_mut()
            .flat_map(Profile::sections_mut)
        {
            section.rest_curvature = turn(section.rest_curvature);
        }
        other.spec.gravity = turn(case.spec.gravity);
        other.tip_force = Vec3(turn(case.tip_force.0));
        let turned = Robot::new(other.spec.clone()).unwrap();
        let mut tip = |case: &Case, robot: &Robot| {
            let mut solver = Solver::new(robot, case.model(), 2).unwrap();
            let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
            (outcome.status == Status::Converged).then(|| solver.tip().unwrap().position)
        };
        let (a, b) = (tip(&case, &robot), tip(&other, &turned));
        let (Some(a), Some(b)) = (a, b) else { continue };
        let gap = (Vec3(turn(a.0)) - b).norm() / robot.length();
        assert!(gap < 1e-9, "draw {number}: {gap}");
    }
}

/// Derivatives with respect to the stiffness count the curvature that is elastic.
#[test]
fn derivative_with_respect_to_stiffness() {
    let (case, _) = precurved(5);
    let mut tensions = vec![];
    let load = case.at(0.6, &mut tensions);
    let solved = |factor: f64| {
        let mut spec = case.spec.clone();
        let s = &mut spec.backbone[0].sections_mut()[0];
        let [x, y] = &mut s.bending;
        for v in [x, y, &mut s.torsion, &mut s.axial, &mut s.shear] {
            *v *= factor;
        }
        let robot = Robot::new(spec).unwrap();
        let mut solver = Solver::new(&robot, case.model(), 2).unwrap();
        assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
        solver
    };
    let step: f64 = 1e-4;
    let tip = |factor: f64| solved(factor).tip().unwrap().position;
    let expected = (tip(step.exp()) - tip((-step).exp())) * (0.5 / step);
    let found = solved(1.0).jacobians(false).unwrap().stiffness[0].position;
    let size = expected.norm();
    assert!(
        (found - expected).norm() < 1e-6 * size,
        "{found:?} {expected:?}"
    );
}

#[test]
fn batches_equal_one_by_one() {
    for number in 0..20 {
        let (case, robot) = precurved(number);
        let tensions: Vec<f64> = (0..30)
            .flat_map(|i| case.tensions.iter().map(move |t| t * i as f64 / 30.0))
            .collect();
        let loads = Loads {
            count: 30,
            tensions: &tensions,
            gravity: &case.spec.gravity,
            tip_force: &case.tip_force.0,
            tip_moment: &[0.0; 3],
            ..Loads::default()
        };
        let settings = RodModel {
            model: case.model(),
            elements: None,
        };
        let a = solve_batch(&robot, &settings, &loads, 2, false).unwrap();
        let b = sweep(&robot, &settings, &loads, true, false).unwrap();
        for i in 0..30 {
            assert_eq!(a.outcomes[i].status, b.outcomes[i].status);
            for q in 3 * i..3 * i + 3 {
                let gap = (a.tip_position[q] - b.tip_position[q]).abs();
                assert!(!(gap > 2e-5 * robot.length()), "draw {number}: {gap}");
            }
        }
    }
}

#[test]
fn a_curvature_that_is_no_number_is_refused() {
    let (case, _) = precurved(0);
    let mut spec = case.spec;
    spec.backbone[0].sections_mut()[0].rest_curvature[1] = f64::NAN;
    let refused = Robot::new(spec).unwrap_err().to_string();
    assert!(refused.contains("curvature without load"), "{refused}");
}
