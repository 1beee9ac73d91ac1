//! Dynamics against independent engines, closed forms, convergence and balances.

mod common;

use bowstring_core::dynamics::integrator::{Damping, Fields, Integrator, Simulator, Step, Stop};
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, TendonPath};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::solver::Status;
use common::{by_tensions, fixed_steps, go, kirchhoff, rod, section, study_robot};

/// Starts from rest under the first tension of tendon 1, and sets a second one suddenly.
fn release(robot: &Robot, model: Model, elements: usize, s: Integrator, from: f64) -> Simulator {
    let mut simulator = Simulator::new(robot, model, elements, s).unwrap();
    let outcome = simulator.rest(&by_tensions(&[from, 0.0, 0.0])).unwrap();
    assert_eq!(outcome.status, Status::Converged);
    simulator.jump(&by_tensions(&[0.0; 3])).unwrap();
    simulator
}

/// Tip during the ramp from 0 to 80 N in 1 s and the hold, at 100 Hz.
fn ramp(model: Model, elements: usize, s: Integrator) -> Vec<Vec3> {
    let mut simulator = Simulator::new(&study_robot(9, 0.0), model, elements, s).unwrap();
    simulator.rest(&by_tensions(&[0.0; 3])).unwrap();
    (1..=130)
        .map(|i| {
            let tension = 80.0 * f64::min(i as f64 / 100.0, 1.0);
            go(&mut simulator, 0.01, &by_tensions(&[tension, 0.0, 0.0]));
            simulator.tip()
        })
        .collect()
}

/// Compares with two independent engines, which agree within 0.16 mm, and with our own converged
/// run.
#[test]
fn ramp_matches_independent_engines_and_its_own_limit() {
    let mut s = fixed_steps(1e-4, 1.0);
    s.damping.mass = 0.5;
    let limit = ramp(Model::default(), 4, s);
    for (step, elements, rho) in [(1e-3, 1, 1.0), (5e-4, 1, 0.8)] {
        s.step = Step::Fixed(step);
        s.spectral_radius = rho;
        let tip = ramp(Model::default(), elements, s);
        let peak = tip.iter().map(|p| p[0]).fold(0.0, f64::max);
        for (found, published) in [
            (tip[49][0], 0.198328),
            (tip[99][0], 0.370456),
            (peak, 0.4076),
        ] {
            assert!((found - published).abs() < 0.2e-3, "{found} {published}");
        }
        for i in [49, 99, 114] {
            let off = (tip[i] - limit[i]).norm();
            assert!(off < 0.02e-3, "{off} m off at output {i}");
        }
    }
}

/// The scheme is of second order in time, with and without numerical damping: release from 5 N of a
/// robot whose fast oscillations are damped, so that its motion is smooth.
#[test]
fn steps_converge_with_second_order() {
    for rho in [1.0, 0.6] {
        let end = |steps: usize| {
            let duration = 0.4;
            let mut s = fixed_steps(duration / steps as f64, 1.0);
            s.spectral_radius = rho;
            s.damping.material = 0.01;
            let robot = study_robot(9, 0.0);
            let mut simulator = release(&robot, Model::default(), 1, s, 5.0);
            go(&mut simulator, duration, &by_tensions(&[0.0; 3]));
            simulator.tip()
        };
        let finest = end(12_800);
        let errors: Vec<_> = [400, 800, 1600]
            .map(|steps| (end(steps) - finest).norm())
            .to_vec();
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!(
                (1.8..2.3).contains(&order),
                "order {order} at {rho}: {errors:?}"
            );
        }
    }
}

/// Modules of one element against four: fourth order in the module's length, as in statics.
#[test]
fn mesh_converges() {
    let mut s = fixed_steps(1e-3, 1.0);
    s.damping.mass = 0.5;
    for model in [Model::default(), kirchhoff()] {
        let [one, two, four] = [1, 2, 4].map(|elements| ramp(model, elements, s)[114]);
        assert!((one - four).norm() < 1e-5, "{:e}", (one - four).norm());
        assert!((two - four).norm() < 2e-6, "{:e}", (two - four).norm());
    }
}

/// Without damping: 100 periods of the slowest mode at 1 ms.
#[test]
fn release_keeps_its_energy() {
    let robot = study_robot(9, 0.0);
    let mut simulator = release(&robot, Model::default(), 1, fixed_steps(1e-3, 1.0), 40.0);
    let start = simulator.energies().elastic;
    let mut worst = 0.0f64;
    for _ in 0..100 {
        go(&mut simulator, 1.0 / 2.2804, &by_tensions(&[0.0; 3]));
        let e = simulator.energies();
        assert_eq!(e.work, 0.0);
        worst = worst.max(((e.kinetic + e.elastic) / start - 1.0).abs());
    }
    assert!(worst < 1e-3, "{worst}");
}

/// Energy never grows at any step length, with and without numerical damping.
#[test]
fn energy_never_grows_at_any_step() {
    let robot = study_robot(9, 0.0);
    for model in [Model::default(), kirchhoff()] {
        for rho in [1.0, 0.9, 0.6, 0.0] {
            for step in [1e-4, 1e-3, 5e-3, 1e-2, 2e-2, 5e-2] {
                let mut s = fixed_steps(step, 1.0);
                s.spectral_radius = rho;
                let mut simulator = release(&robot, model, 1, s, 40.0);
                let start = simulator.energies().elastic;
                for _ in 0..20 {
                    go(
                        &mut simulator,
                        f64::min(50.0 * step, 1.0),
                        &by_tensions(&[0.0; 3]),
                    );
                    let e = simulator.energies();
                    let left = (e.kinetic + e.elastic) / start;
                    assert!(left < 1.01, "{left} at step {step}, radius {rho}");
                }
            }
        }
    }
}

/// Work is stored and dissipated: ramp, gravity, tip load, both dampings.
#[test]
fn energy_balances() {
    let mut s = fixed_steps(1e-3, 1.0);
    s.gravity = [3.0, -4.0, -9.0];
    s.damping = Damping {
        mass: 0.7,
        material: 1e-3,
    };
    let load = |tension: f64, force: f64| Load {
        tip_force: [0.0, force, -force],
        ..by_tensions(Vec::leak(vec![tension, 0.0, 0.3 * tension]))
    };
    for model in [Model::default(), kirchhoff()] {
        for path in [TendonPath::Straight, TendonPath::Continuous] {
            let model = Model {
                tendon: path,
                ..model
            };
            let mut simulator = Simulator::new(&study_robot(9, 0.004), model, 1, s).unwrap();
            simulator.rest(&load(5.0, 0.0)).unwrap();
            let left = |s: &Simulator| {
                let e = s.energies();
                e.kinetic + e.elastic + e.gravity - e.work + e.dissipated
            };
            let start = left(&simulator);
            for i in 1..=20 {
                go(&mut simulator, 0.02, &load(5.0 + i as f64, 0.02 * i as f64));
            }
            let e = *simulator.energies();
            assert!(e.work > 0.05 && e.dissipated > 1e-3, "{e:?}");
            let error = (left(&simulator) - start).abs() / e.work;
            // continuous tendons change its length at once
            let most = if path == TendonPath::Straight {
                1e-4
            } else {
                1e-3
            };
            assert!(error < most, "{path:?}: {error}");
        }
    }
}

/// The rate of momentum equals the load less the reaction of the base, from the strain of the
/// backbone at the base and the force of its tendons.
#[test]
fn momentum_balances_with_the_base() {
    let mut s = fixed_steps(2e-4, 1.0);
    s.damping.material = 2e-3;
    s.gravity = [1.0, 2.0, -9.0];
    let robot = study_robot(9, 0.0);
    let mut simulator = Simulator::new(&robot, Model::default(), 4, s).unwrap();
    let tensions = [20.0, 0.0, 5.0];
    let load = Load {
        tip_force: [0.0, 0.3, 0.1],
        ..by_tensions(&tensions)
    };
    simulator.rest(&load).unwrap();
    let none = Load {
        tip_force: [0.0; 3],
        ..load
    };
    simulator.jump(&none).unwrap();
    // an interval of smooth motion
    go(&mut simulator, 0.2, &none);
    let mass = 0.18 + s_mass();
    let step = 2e-4;
    let mut fields = Fields::default();
    let mut momentum = vec![];
    for _ in 0..5 {
        simulator.record(2, &mut fields);
        momentum.push(simulator.linear_momentum());
        go(&mut simulator, step, &none);
    }
    let per_time = fields.sections.force.len() / 5;
    let holes = &robot.spec().tendons;
    let base = |i: usize| {
        let part = |v: &[f64], at: usize| Vec3([v[at], v[at + 1], v[at + 2]]);
        let mut held = part(&fields.sections.force, i * per_time);
        // the first span pulls the first disk towards the base
        let disk = part(&fields.disks.position, i * 27);
        let r = &fields.disks.rotation[i * 81..][..9];
        for (tendon, tension) in holes.iter().zip(tensions) {
            let [x, y] = tendon.holes[0];
            let hole = disk
                + Vec3([
                    r[0] * x + r[1] * y,
                    r[3] * x + r[4] * y,
                    r[6] * x + r[7] * y,
                ]);
            let span = hole - Vec3([x, y, 0.0]);
            held += span * (tension / span.norm());
        }
        Vec3(s.gravity) * mass - held
    };
    // central difference over the records before and after
    let rate = (momentum[3] - momentum[1]) * (0.5 / step);
    let force = base(2);
    let off = (rate - force).norm() / (Vec3(s.gravity) * mass).norm();
    assert!(rate.norm() > 0.02, "it moves: {rate:?}");
    assert!(off < 1e-4, "{off}: {rate:?} {force:?}");
}

/// Mass of the backbone (kg).
fn s_mass() -> f64 {
    section(0.005, 35e9, 0.3, 1800.0).mass_per_length * common::LENGTH
}

/// A soft and heavy silicone robot is released from a bend under its own weight.
#[test]
fn soft_robot_under_gravity_gains_no_energy() {
    let soft = section(0.02, 0.5e6, 0.49, 1100.0);
    let mut spec = rod(soft.into(), 0.2, 8).spec().clone();
    for disk in &mut spec.disks {
        (disk.clamped_length, disk.mass, disk.inertia) = (0.002, 0.002, [1e-7, 2e-7]);
    }
    let robot = Robot::new(spec).unwrap();
    let load = |force: f64| Load {
        tip_force: [force, 0.0, 0.0],
        ..Load::default()
    };
    for rho in [1.0, 0.8] {
        for step in [5e-4, 2e-3, 1e-2] {
            let mut s = fixed_steps(step, 1.0);
            s.gravity = [0.0, 2.0, 9.81];
            s.spectral_radius = rho;
            let mut simulator = Simulator::new(&robot, Model::default(), 1, s).unwrap();
            let outcome = simulator.rest(&load(0.3)).unwrap();
            assert_eq!(outcome.status, Status::Converged);
            assert!(simulator.tip()[0] > 0.05);
            simulator.jump(&load(0.0)).unwrap();
            let energy = |s: &Simulator| {
                let e = s.energies();
                e.kinetic + e.elastic + e.gravity
            };
            let start = energy(&simulator);
            for _ in 0..10 {
                go(&mut simulator, 0.1, &load(0.0));
                let size = simulator.energies().elastic + simulator.energies().kinetic;
                assert!(energy(&simulator) < start + 0.02 * size, "{step} {rho}");
            }
        }
    }
}

/// Damping ratio of a mode: alpha/(2 omega) from mass damping, tau omega/2 from the material.
#[test]
fn small_oscillations_decay_by_rayleigh_damping() {
    let robot = study_robot(9, 0.0);
    let omega = 2.0 * std::f64::consts::PI * 2.28023;
    for (mass, material) in [(0.3, 0.0), (0.0, 2e-3)] {
        let mut s = fixed_steps(1e-3, 1.0);
        s.damping = Damping { mass, material };
        s.spectral_radius = 0.6;
        let mut simulator = release(&robot, Model::default(), 1, s, 1.0);
        let rate = mass / 2.0 + material * omega * omega / 2.0;
        // after the fast modes have decayed
        go(&mut simulator, 1.0, &by_tensions(&[0.0; 3]));
        let energy = |s: &Simulator| s.energies().kinetic + s.energies().elastic;
        let first = energy(&simulator);
        let period = 1.0 / 2.28023;
        go(&mut simulator, 20.0 * period, &by_tensions(&[0.0; 3]));
        let found = (first / energy(&simulator)).ln() / (2.0 * 20.0 * period);
        assert!((found / rate - 1.0).abs() < 0.02, "{found} {rate}");
    }
}

/// SIMD lanes and plain numbers give the same motion.
#[test]
fn lanes_match_plain_numbers() {
    let mut s = fixed_steps(2e-3, 1.0);
    s.damping.mass = 0.5;
    let end = |elements| {
        let robot = study_robot(13, 0.001);
        let mut simulator = release(&robot, Model::default(), elements, s, 30.0);
        go(&mut simulator, 0.1, &by_tensions(&[0.0; 3]));
        simulator.tip()
    };
    assert!((end(1) - end(2)).norm() < 2e-5);
}

/// Adaptive steps keep their tolerance, and smaller tolerances cost more.
#[test]
fn adaptive_steps_keep_their_tolerance() {
    let mut s = fixed_steps(1e-4, 1.0);
    s.damping.mass = 0.5;
    let limit = ramp(Model::default(), 1, s);
    let mut last = f64::INFINITY;
    for tolerance in [1e-5, 1e-6, 1e-7] {
        s.step = Step::Adaptive {
            tolerance,
            longest: 0.01,
        };
        s.spectral_radius = 0.8;
        let tip = ramp(Model::default(), 1, s);
        let worst = tip
            .iter()
            .zip(&limit)
            .map(|(a, b)| (*a - *b).norm())
            .fold(0.0, f64::max);
        assert!(worst < 0.5 * last, "{worst} after {last}");
        assert!(
            worst < 600.0 * tolerance.powf(2.0 / 3.0) * 1e-2,
            "{worst} at {tolerance}"
        );
        last = worst;
    }
}

/// A load that closes the gap between disks stops the run, with its state kept and the reason
/// stated.
#[test]
fn collision_stops_the_run() {
    let robot = study_robot(2, 0.0);
    let mut s = fixed_steps(1e-3, 1.0);
    s.damping.mass = 5.0;
    let mut simulator = Simulator::new(&robot, Model::default(), 1, s).unwrap();
    simulator.rest(&by_tensions(&[0.0; 3])).unwrap();
    let mut stopped = None;
    for i in 1..400 {
        let tension = 10.0 * i as f64;
        let (stop, _) = simulator
            .advance(0.01, &by_tensions(&[tension, 0.0, 0.0]))
            .unwrap();
        if stop.is_some() {
            stopped = stop;
            break;
        }
    }
    assert!(
        matches!(stopped, Some(Stop::Collision | Stop::StepFailed)),
        "{stopped:?}"
    );
    assert!(simulator.tip().0.iter().all(|x| x.is_finite()));
}

#[test]
fn wrong_settings_are_rejected() {
    let robot = study_robot(3, 0.0);
    let wrong: [fn(&mut Integrator); 8] = [
        |s| s.step = Step::Fixed(0.0),
        |s| s.step = Step::Fixed(f64::NAN),
        |s| {
            s.step = Step::Adaptive {
                tolerance: -1.0,
                longest: 1.0,
            }
        },
        |s| s.damping.mass = -1.0,
        |s| s.damping.material = f64::INFINITY,
        |s| s.spectral_radius = 1.5,
        |s| s.spectral_radius = f64::NAN,
        |s| s.gravity = [f64::NAN, 0.0, 0.0],
    ];
    for change in wrong {
        let mut s = fixed_steps(1e-3, 1.0);
        change(&mut s);
        assert!(Simulator::new(&robot, Model::default(), 1, s).is_err());
    }
    assert!(Simulator::new(&robot, Model::default(), 3, fixed_steps(1e-3, 1.0)).is_err());
    let mut simulator =
        Simulator::new(&robot, Model::default(), 1, fixed_steps(1e-3, 1.0)).unwrap();
    assert!(simulator.rest(&by_tensions(&[1.0])).is_err());
    simulator.rest(&by_tensions(&[1.0, 0.0, 0.0])).unwrap();
    assert!(simulator.advance(-1.0, &by_tensions(&[0.0; 3])).is_err());
    assert!(simulator
        .advance(f64::NAN, &by_tensions(&[0.0; 3]))
        .is_err());
    assert!(simulator
        .advance(0.1, &by_tensions(&[-1.0, 0.0, 0.0]))
        .is_err());
}
