//! Time of a time step on one core: the study's robot, tendon 1 loaded and unloaded in ramps of 1
//! s, so that all states contribute.

#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator, Step};
use bowstring_core::model::load::{Model, Theory};
use common::{by_tensions, study_robot};
use criterion::{criterion_group, criterion_main, Criterion};

const STEP: f64 = 2e-3;

fn dynamics(c: &mut Criterion) {
    let model = Model {
        theory: Theory::Cosserat,
        ..Model::default()
    };
    let settings = Integrator {
        gravity: [0.0; 3],
        damping: Damping {
            mass: 0.5,
            material: 0.0,
        },
        spectral_radius: 0.8,
        step: Step::Fixed(STEP),
    };
    for disks in [9, 450] {
        let mut simulator = Simulator::new(&study_robot(disks, 0.0), model, 1, settings).unwrap();
        simulator.rest(&by_tensions(&[0.0; 3])).unwrap();
        let mut time = 0.0f64;
        c.bench_function(&format!("step_{disks}"), |b| {
            b.iter(|| {
                time += STEP;
                let tension = 80.0 * (1.0 - (time % 2.0 - 1.0).abs());
                let (stop, _) = simulator
                    .advance(STEP, &by_tensions(&[tension, 0.0, 0.0]))
                    .unwrap();
                assert_eq!(stop, None);
            })
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(std::time::Duration::from_millis(500))
        .measurement_time(std::time::Duration::from_secs(2));
    targets = dynamics
}
criterion_main!(benches);
