//! Time of a static solve on one core: the study's robot, three tendons under tension, gravity and
//! a transverse tip force, so that no two modules are equal.

#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::model::load::{Load, Model, RodModel, Theory};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::solve_batch;
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::{Solver, Status};
use common::study_robot;
use criterion::{criterion_group, criterion_main, Criterion};

fn load(tensions: &[f64; 3]) -> Load<'_> {
    Load {
        tensions,
        gravity: [0.0, 0.0, -9.81],
        tip_force: [0.0, 1.0, 0.0],
        ..Load::default()
    }
}

fn model(theory: Theory) -> Model {
    Model {
        theory,
        ..Model::default()
    }
}

fn statics(c: &mut Criterion) {
    let robot = study_robot(9, 0.0);
    for (name, theory) in [
        ("kirchhoff", Theory::Kirchhoff),
        ("cosserat", Theory::Cosserat),
    ] {
        let mut solver = Solver::new(&robot, model(theory), 1).unwrap();
        let outcome = solver.solve(&load(&[80.0, 10.0, 5.0])).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        println!("{name}: {} iterations", outcome.iterations);
        c.bench_function(&format!("cold_{name}"), |b| {
            b.iter(|| solver.solve(&load(&[80.0, 10.0, 5.0])).unwrap())
        });
        // elements chosen and errors estimated, as in a sweep of Python
        let settings = RodModel {
            model: model(theory),
            elements: None,
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        c.bench_function(&format!("warm17_{name}"), |b| {
            b.iter(|| {
                for i in 0..17 {
                    let tensions = [5.0 * i as f64, 10.0, 5.0];
                    let outcome = if i == 0 {
                        solver.solve(&load(&tensions))
                    } else {
                        solver.solve_next(&load(&tensions))
                    };
                    assert_eq!(outcome.unwrap().status, Status::Converged);
                }
            })
        });
    }
    // one core, with SIMD lanes: 4096 loads in a call
    let tensions: Vec<f64> = (0..4096)
        .flat_map(|i| [(i * 7 % 81) as f64, (i * 3 % 31) as f64, (i % 17) as f64])
        .collect();
    let loads = Loads {
        count: 4096,
        tensions: &tensions,
        gravity: &[0.0, 0.0, -9.81],
        tip_force: &[0.0, 1.0, 0.0],
        tip_moment: &[0.0; 3],
        ..Loads::default()
    };
    let settings = RodModel {
        model: model(Theory::Kirchhoff),
        elements: None,
    };
    c.bench_function("batch4096_kirchhoff", |b| {
        b.iter(|| solve_batch(&robot, &settings, &loads, 1, false).unwrap())
    });
    for disks in [9, 450] {
        let mut solver =
            Solver::new(&study_robot(disks, 0.0), model(Theory::Kirchhoff), 1).unwrap();
        c.bench_function(&format!("disks_{disks}"), |b| {
            b.iter(|| {
                let outcome = solver.solve(&load(&[80.0, 10.0, 5.0])).unwrap();
                assert_eq!(outcome.status, Status::Converged);
            })
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(std::time::Duration::from_millis(500))
        .measurement_time(std::time::Duration::from_secs(2));
    targets = statics
}
criterion_main!(benches);
