//! Tendons whose holes differ from disk to disk: helical, converging, with random errors.

#[path = "common/cases.rs"]
mod cases;
mod common;

use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, RodModel, TendonPath, Theory};
use bowstring_core::model::robot::{Robot, RobotSpec, Tendon};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::{Solver, Status};
use cases::{Case, Draw};
use common::{section, study_robot};
use std::f64::consts::TAU;

const THEORIES: [Theory; 2] = [Theory::Cosserat, Theory::Kirchhoff];

fn routed(number: usize) -> (Case, Robot) {
    let mut draw = Draw::new(21, number);
    let case = Case::realistic(&mut draw).routed(&mut draw);
    let robot = Robot::new(case.spec.clone()).unwrap();
    (case, robot)
}

/// The wrench of the spans, computed from the poses alone, bends the rod to the poses found.
#[test]
fn random_routing_satisfies_the_rod_equations() {
    let (mut converged, mut tensions) = (0, vec![]);
    for number in 0..300 {
        let (case, robot) = routed(number);
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
        // fourth order; shear and extension are averaged over a module whatever its elements
        let most = match case.theory {
            Theory::Kirchhoff => f64::max(1e-6, coarse / 300.0),
            Theory::Cosserat => f64::max(1e-5, coarse / 40.0),
        };
        assert!(
            fine < most,
            "draw {number}: {fine} of {coarse} {:?}",
            case.theory
        );
    }
    assert!(converged > 270, "{converged}");
}

/// A choice of elements states an error that the finest mesh confirms.
#[test]
fn stated_errors_hold_with_random_routing() {
    let (mut compared, mut tensions) = (0, vec![]);
    for number in 0..200 {
        let (case, robot) = routed(number);
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
        compared += 1;
        let tip = solver.solver().tip().unwrap().position;
        let error = (tip - fine.tip().unwrap().position).norm();
        let stated = outcome.error.unwrap().tip + 1e-9 * robot.length();
        assert!(error <= stated, "draw {number}: {error} of {stated}");
    }
    assert!(compared > 170, "{compared}");
}

/// At an equilibrium the derivatives of lengths by tensions are symmetric: the tensions do work on
/// the lengths, and on nothing else.
#[test]
fn lengths_and_tensions_are_reciprocal() {
    for number in 0..100 {
        let (case, robot) = routed(number);
        let mut tensions = vec![];
        let mut solver = Solver::new(&robot, case.model(), 2).unwrap();
        let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
        let Some(jacobians) = solver.jacobians(false) else {
            continue;
        };
        if outcome.status != Status::Converged {
            continue;
        }
        let count = robot.tendon_count();
        let of = |i: usize, j: usize| jacobians.tensions[j].lengths[i];
        let largest = (0..count).fold(0.0, |m, i| f64::max(m, of(i, i).abs()));
        for i in 0..count {
            for j in 0..i {
                let gap = (of(i, j) - of(j, i)).abs();
                assert!(gap < 1e-12 * largest, "draw {number}: {gap} of {largest}");
            }
        }
    }
}

/// Lengths of the solver are those between the holes of the poses.
#[test]
fn lengths_are_those_from_hole_to_hole() {
    let (case, robot) = routed(3);
    let mut tensions = vec![];
    let mut solver = Solver::new(&robot, case.model(), 2).unwrap();
    let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
    assert_eq!(outcome.status, Status::Converged);
    for (i, tendon) in robot.spec().tendons.iter().enumerate() {
        let place = |at: usize| {
            let [x, y] = tendon.hole(at);
            let hole = Vec3([x, y, 0.0]);
            match at {
                0 => hole,
                _ => {
                    let disk = solver.disk(at - 1).unwrap();
                    disk.position + disk.rotation * hole
                }
            }
        };
        let spans = (0..=tendon.end_disk).map(|k| (place(k + 1) - place(k)).norm());
        let (expected, found) = (spans.sum::<f64>(), solver.tendon_length(i).unwrap());
        assert!((expected - found).abs() < 1e-14, "{expected} {found}");
    }
}

/// Turning routing, gravity and loads about the backbone turns the answer.
#[test]
fn the_answer_turns_with_the_robot() {
    for (number, theory) in (0..40).zip(THEORIES.into_iter().cycle()) {
        let (mut case, robot) = routed(number);
        case.theory = theory;
        let angle: f64 = 0.7 + number as f64;
        let (sin, cos) = angle.sin_cos();
        let turn = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let turn3 = |v: [f64; 3]| {
            let [x, y] = turn([v[0], v[1]]);
            Vec3([x, y, v[2]])
        };
        let mut other = case.clone();
        for tendon in &mut other.spec.tendons {
            tendon.holes.iter_mut().for_each(|hole| *hole = turn(*hole));
        }
        other.spec.gravity = turn3(case.spec.gravity).0;
        other.tip_force = turn3(case.tip_force.0);
        let turned = Robot::new(other.spec.clone()).unwrap();
        let tip = |case: &Case, robot: &Robot| {
            let mut tensions = vec![];
            let mut solver = Solver::new(robot, case.model(), 2).unwrap();
            let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
            (outcome.status == Status::Converged).then(|| solver.tip().unwrap().position)
        };
        let (a, b) = (tip(&case, &robot), tip(&other, &turned));
        assert_eq!(a.is_some(), b.is_some(), "draw {number}");
        let (Some(a), Some(b)) = (a, b) else { continue };
        let gap = (turn3(a.0) - b).norm() / robot.length();
        // the residual that ends the iteration is 1e-10
        assert!(gap < 1e-9, "draw {number}: {gap}");
    }
}

/// A robot with disks at equal distances, and one tendon that winds around it half a turn and
/// converges to 60 % of its pitch radius.
fn helical(disks: usize) -> Robot {
    let mut spec = RobotSpec {
        payloads: vec![],
        gravity: [0.0; 3],
        backbone: vec![section(0.002, 60e9, 0.3, 0.0).into()],
        ..study_robot(disks, 0.0).spec().clone()
    };
    for disk in &mut spec.disks {
        disk.mass = 0.0;
        disk.inertia = [0.0; 2];
    }
    let place = |k: usize| {
        let share = k as f64 / disks as f64;
        let (sin, cos) = (0.5 * TAU * share).sin_cos();
        [cos, sin].map(|x| 0.02 * (1.0 - 0.4 * share) * x)
    };
    spec.tendons = vec![Tendon::new((0..=disks).map(place).collect(), disks - 1)];
    Robot::new(spec).unwrap()
}

fn tip(robot: &Robot, path: TendonPath, tension: f64) -> Vec3 {
    let model = Model {
        theory: Theory::Kirchhoff,
        tendon: path,
        twist: true,
    };
    let mut solver = Solver::new(robot, model, 2).unwrap();
    let load = Load {
        tensions: &[tension],
        ..Load::default()
    };
    let outcome = solver.solve(&load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{outcome:?}");
    solver.tip().unwrap().position
}

/// Straight spans between many disks approach the continuous tendon with the second order.
#[test]
fn many_disks_approach_the_continuous_helical_tendon() {
    let gap = |disks: usize| {
        let robot = helical(disks);
        // between 600 disks a continuous tendon differs from the limit by far less
        let limit = tip(&helical(600), TendonPath::Continuous, 2.0);
        (tip(&robot, TendonPath::Straight, 2.0) - limit).norm() / robot.length()
    };
    let gaps = [10, 20, 40, 80].map(gap);
    assert!(gaps[0] < 0.05 && gaps[3] < 5e-4, "{gaps:?}");
    for pair in gaps.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.9..2.1).contains(&order), "{gaps:?}");
    }
    // it winds out of the plane of its first hole
    let bent = tip(&helical(40), TendonPath::Straight, 2.0);
    assert!(bent[1].abs() > 0.02, "{bent:?}");
}

/// The parallel and the continuous path of a tendon do not change when its one hole is repeated.
#[test]
fn repeated_holes_are_a_parallel_tendon() {
    let robot = study_robot(9, 0.003);
    let mut spec = robot.spec().clone();
    for tendon in &mut spec.tendons {
        let hole = tendon.holes[0];
        // as one hole in ten that differs by less than any effect
        let mut holes = vec![hole; 10];
        holes[4][0] += 1e-15;
        *tendon = Tendon::new(holes, 8);
        assert_eq!(tendon.holes.len(), 10);
        assert_eq!(Tendon::new(vec![hole; 10], 8), Tendon::parallel(hole, 8));
    }
    let repeated = Robot::new(spec).unwrap();
    for path in [TendonPath::Straight, TendonPath::Continuous] {
        let find = |robot: &Robot| {
            let model = Model {
                tendon: path,
                ..Model::default()
            };
            let mut solver = Solver::new(robot, model, 1).unwrap();
            let load = Load {
                tensions: &[60.0, 10.0, 5.0],
                gravity: [1.0, 2.0, -9.81],
                ..Load::default()
            };
            assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
            (
                solver.tip().unwrap().position,
                solver.tendon_length(1).unwrap(),
            )
        };
        let (a, b) = (find(&robot), find(&repeated));
        assert!((a.0 - b.0).norm() < 1e-12 && (a.1 - b.1).abs() < 1e-12);
    }
}

/// SIMD lanes and the scalar solver agree.
#[test]
fn batches_with_random_routing_equal_one_by_one() {
    for number in 0..20 {
        let (case, robot) = routed(number);
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
        let b = sweep(&robot, &settings, &loads, false, false).unwrap();
        for i in 0..30 {
            assert_eq!(a.outcomes[i].status, b.outcomes[i].status);
            for q in 3 * i..3 * i + 3 {
                let gap = (a.tip_position[q] - b.tip_position[q]).abs();
                assert!(!(gap > 1e-9 * robot.length()), "draw {number}: {gap}");
            }
        }
    }
}

#[test]
fn a_wrong_number_of_holes_is_refused() {
    let mut spec = study_robot(9, 0.0).spec().clone();
    spec.tendons[1].holes = vec![[0.02, 0.0]; 4];
    let refused = Robot::new(spec.clone()).unwrap_err().to_string();
    assert!(refused.starts_with("tendon 2 has 4 holes"), "{refused}");
    spec.tendons[1].holes = vec![];
    assert!(Robot::new(spec.clone()).is_err());
    spec.tendons[1].holes = vec![[f64::NAN, 0.0]; 10];
    assert!(Robot::new(spec).is_err());
}
