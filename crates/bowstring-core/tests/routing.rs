//! Tendons whose holes differ from disk to disk.

mod common;

use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, TendonPath};
use bowstring_core::model::robot::{Robot, Tendon};
use bowstring_core::statics::solver::Solver;
use common::{by_tensions, kirchhoff, section, solved, study_robot};
use std::f64::consts::TAU;

/// A robot with disks at equal distances, and one tendon that winds around it half a turn and
/// converges to 60 % of its pitch radius.
fn helical(disks: usize) -> Robot {
    let mut spec = study_robot(disks, 0.0).spec().clone();
    spec.backbone = vec![section(0.002, 60e9, 0.3, 0.0).into()];
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
        tendon: path,
        ..kirchhoff()
    };
    let mut solver = Solver::new(robot, model, 2).unwrap();
    solved(&mut solver, &by_tensions(&[tension]));
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
            solved(&mut solver, &load);
            (
                solver.tip().unwrap().position,
                solver.tendon_length(1).unwrap(),
            )
        };
        let (a, b) = (find(&robot), find(&repeated));
        assert!((a.0 - b.0).norm() < 1e-12 && (a.1 - b.1).abs() < 1e-12);
    }
}
