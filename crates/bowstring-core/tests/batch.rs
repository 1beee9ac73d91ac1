//! Many loads in one call give the same as one call for each.

mod common;

#[path = "common/cases.rs"]
mod cases;

use bowstring_core::interrupt::{watched, Interrupted};
use bowstring_core::model::load::{Load, RodModel};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::Status;
use cases::{Case, Draw};
use common::study_robot;

fn loads<'a>(tensions: &'a [f64], gravity: &'a [f64], tip_force: &'a [f64]) -> Loads<'a> {
    Loads {
        count: tensions.len() / 3,
        tensions,
        gravity,
        tip_force,
        tip_moment: &[0.0; 3],
        ..Loads::default()
    }
}

/// Loads without repetition, without a random number generator.
fn tensions(n: usize) -> Vec<f64> {
    (0..3 * n).map(|i| (i * i * 7 % 61) as f64).collect()
}

fn assert_close(a: &[f64], b: &[f64]) {
    assert_eq!(a.len(), b.len());
    for (x, y) in a.iter().zip(b) {
        assert!((x - y).abs() < 1e-10, "{x} {y}");
    }
}

#[test]
fn batch_equals_one_by_one_for_any_number_of_threads() {
    let robot = study_robot(9, 0.003);
    for (n, elements) in [(0, 1), (1, 1), (31, 1), (100, 1), (65, 2)] {
        let (t, force) = (tensions(n), tensions(n));
        let force: Vec<f64> = force.iter().map(|f| 0.01 * f).collect();
        let loads = loads(&t, &[0.0, 0.0, -9.81], &force);
        let settings = RodModel {
            elements: Some(elements),
            ..RodModel::default()
        };
        let one = solve_batch(&robot, &settings, &loads, 1, true).unwrap();
        let many = solve_batch(&robot, &settings, &loads, 3, true).unwrap();
        let cold = sweep(&robot, &settings, &loads, false, true).unwrap();
        assert_eq!(one.outcomes.len(), n);
        assert_eq!(one.outcomes, many.outcomes);
        assert_eq!(one.disk_position, many.disk_position);
        assert_eq!(one.disk_rotation, many.disk_rotation);
        assert_eq!(one.tendon_length, many.tendon_length);
        // SIMD lanes start from straight, one by one from the linear response
        for (a, b) in one.outcomes.iter().zip(&cold.outcomes) {
            assert_eq!((a.status, a.stable), (b.status, b.stable));
        }
        assert_close(&one.disk_position, &cold.disk_position);
        assert_close(&one.disk_rotation, &cold.disk_rotation);
        assert_close(&one.tendon_length, &cold.tendon_length);
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        for i in (0..n).filter(|_| elements == 1) {
            let load = Load {
                tensions: &t[3 * i..][..3],
                gravity: [0.0, 0.0, -9.81],
                tip_force: [force[3 * i], force[3 * i + 1], force[3 * i + 2]],
                ..Load::default()
            };
            assert_eq!(solver.solve(&load).unwrap(), cold.outcomes[i]);
            let solver = solver.solver();
            assert_eq!(
                solver.tip().unwrap().position.0,
                cold.tip_position[3 * i..][..3]
            );
            let last = 3 * (9 * i + 8);
            assert_eq!(
                one.disk_position[last..][..3],
                one.tip_position[3 * i..][..3]
            );
            assert_eq!(
                solver.tendon_length(2).unwrap(),
                cold.tendon_length[3 * i + 2]
            );
        }
    }
}

/// Many loads start from a polynomial of the load: as many converge, and to the same equilibria.
#[test]
fn many_loads_of_random_robots_equal_one_by_one() {
    const ROWS: usize = 2000;
    let (mut solved, mut more, mut fewer, mut elsewhere) = (0, 0, 0, 0);
    let (mut steps, mut cold_steps) = (0, 0);
    for number in 0..16 {
        let mut draw = Draw::new(7, number);
        let case = Case::realistic(&mut draw);
        let robot = Robot::new(case.spec.clone()).unwrap();
        // beyond the loads of use, so that some rows have several equilibria, or none
        let mut load = |of: &[f64]| -> Vec<f64> {
            let each = (0..ROWS).flat_map(|_| {
                of.iter()
                    .map(|x| x * draw.within(0.0, 1.1))
                    .collect::<Vec<_>>()
            });
            each.collect()
        };
        let (tensions, tip_force) = (load(&case.load.tensions), load(&case.load.tip_force));
        let loads = Loads {
            count: ROWS,
            tensions: &tensions,
            gravity: &case.load.gravity,
            tip_force: &tip_force,
            tip_moment: &[0.0; 3],
            ..Loads::default()
        };
        let settings = RodModel {
            model: case.model,
            elements: None,
        };
        let batch = solve_batch(&robot, &settings, &loads, 2, false).unwrap();
        let cold = sweep(&robot, &settings, &loads, false, false).unwrap();
        for (i, (a, b)) in batch.outcomes.iter().zip(&cold.outcomes).enumerate() {
            let converged = (a.status == Status::Converged, b.status == Status::Converged);
            match converged {
                (true, true) => solved += 1,
                (true, false) => more += 1,
                (false, true) => fewer += 1,
                (false, false) => {}
            }
            if converged.0 {
                assert!(a.residual <= 1e-10 && a.stable == Some(true), "{a:?}");
            }
            if converged != (true, true) {
                continue;
            }
            steps += a.iterations;
            cold_steps += b.iterations;
            let gap = (0..3).map(|q| batch.tip_position[3 * i + q] - cold.tip_position[3 * i + q]);
            let gap = gap.fold(0.0, |m: f64, d| m.max(d.abs())) / robot.length();
            let stated = a.error.unwrap().tip + b.error.unwrap().tip;
            // rows may take different numbers of elements at the limit of the estimate
            if !(gap < 1e-8 + stated / robot.length()) {
                elsewhere += 1;
            }
        }
    }
    println!("{solved} solved by both, {more} more, {fewer} fewer, {elsewhere} elsewhere; steps {steps} and {cold_steps}");
    assert!(solved > 25_000 && fewer <= more.max(5) && 1000 * elsewhere < solved);
    assert!(steps < cold_steps);
}

#[test]
fn a_failed_row_is_nan_and_others_are_unaffected() {
    let robot = study_robot(9, 0.0);
    let t = [10.0, 0.0, 0.0, 2e4, 2e4, 2e4, 20.0, 0.0, 0.0];
    for warm in [false, true] {
        let found = sweep(
            &robot,
            &RodModel::default(),
            &loads(&t, &[0.0; 3], &[0.0; 3]),
            warm,
            true,
        )
        .unwrap();
        let status = found.outcomes.iter().map(|o| o.status == Status::Converged);
        assert_eq!(status.collect::<Vec<_>>(), [true, false, true]);
        assert!(found.tip_position[3..6].iter().all(|x| x.is_nan()));
        assert!(found.disk_rotation[81..162].iter().all(|x| x.is_nan()));
        assert!(found.tendon_length[6..].iter().all(|x| x.is_finite()));
    }
}

#[test]
fn input_is_checked_before_work_begins() {
    let robot = study_robot(9, 0.0);
    let refused = |loads: &Loads, elements: usize| {
        let settings = RodModel {
            elements: Some(elements),
            ..RodModel::default()
        };
        let a = sweep(&robot, &settings, loads, true, true).unwrap_err();
        let b = solve_batch(&robot, &settings, loads, 0, true).unwrap_err();
        assert_eq!(a.to_string(), b.to_string()); // as text, because NaN is not equal to itself
        a.to_string()
    };
    let mut t = tensions(40);
    t[3 * 17 + 1] = f64::NAN;
    let bad = refused(&loads(&t, &[0.0; 3], &[0.0; 3]), 1);
    assert!(
        bad.starts_with("row 18: tension of tendon 2 is NaN"),
        "{bad}"
    );
    let good = tensions(40);
    assert!(refused(&loads(&good, &[0.0; 3], &[0.0; 3]), 3).contains("elements is 3"));
    assert!(refused(&loads(&good, &[0.0; 6], &[0.0; 3]), 1).starts_with("gravity has 6 numbers"));
    let many = Loads {
        disks: 9,
        disk_forces: &[[0.0; 3]; 10],
        ..loads(&good, &[0.0; 3], &[0.0; 3])
    };
    assert!(refused(&many, 1).contains("10 forces on disks"));
    let short = Loads {
        count: usize::MAX,
        ..loads(&good, &[0.0; 3], &[0.0; 3])
    };
    assert!(refused(&short, 1).contains("tensions were given"));
}

#[test]
fn many_loads_are_interrupted_on_all_threads() {
    let robot = study_robot(9, 0.0);
    let t = tensions(100_000);
    let loads = loads(&t, &[0.0; 3], &[0.0; 3]);
    let settings = RodModel {
        elements: Some(8),
        ..RodModel::default()
    };
    for threads in [1, 3] {
        let batch = || solve_batch(&robot, &settings, &loads, threads, false);
        assert_eq!(watched(|| true, batch).err(), Some(Interrupted));
    }
    let rows = || sweep(&robot, &settings, &loads, true, false);
    assert_eq!(watched(|| true, rows).err(), Some(Interrupted));
    let few = Loads {
        count: 10,
        tensions: &t[..30],
        ..loads
    };
    let batch = || solve_batch(&robot, &settings, &few, 3, false).unwrap();
    let done = watched(|| false, batch).unwrap();
    assert_eq!(done.outcomes.len(), 10);
}
