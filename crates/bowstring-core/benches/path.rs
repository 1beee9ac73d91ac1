//! Time of a solve under displacement control on one core, from the home pose, compared with one
//! under tension control: gravity and a transverse tip force, so that no two modules are equal.

#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::model::load::{Load, Model};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Tendon};
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::solver::{Solver, Status};
use common::{section, study_robot};
use criterion::{criterion_group, criterion_main, Criterion};

/// Robot with `segments` segments of `disks` disks and three tendons each.
fn segments(segments: usize, disks: usize) -> Robot {
    let count = segments * disks;
    let length = 0.0622;
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section(0.001, 50e9, 0.3, 6450.0).into(); segments],
        disks: (1..=count)
            .map(|k| Disk {
                hole_length: 0.0,
                station: length * k as f64 / disks as f64,
                clamped_length: 0.0,
                mass: 1.5e-4,
                inertia: [1e-9, 2e-9],
                segment: (k - 1) / disks,
            })
            .collect(),
        tendons: (0..segments)
            .flat_map(|s| {
                [0.0f64, 120.0, 240.0].map(move |a| {
                    let a = (a + 40.0 * s as f64).to_radians();
                    Tendon {
                        holes: vec![[0.0045 * a.cos(), 0.0045 * a.sin()]],
                        end_disk: (s + 1) * disks - 1,
                        pushes: false,
                    }
                })
            })
            .collect(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

fn compare(c: &mut Criterion, name: &str, robot: &Robot, tensions: &[f64], tip_force: f64) {
    let load = Load {
        tensions,
        gravity: [0.0, 0.0, -9.81],
        tip_force: [0.0, tip_force, 0.0],
        ..Load::default()
    };
    let mut solver = Solver::new(robot, Model::default(), 1).unwrap();
    assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
    c.bench_function(&format!("{name}_by_tension"), |b| {
        b.iter(|| solver.solve(&load).unwrap())
    });
    let tendons = &robot.spec().tendons;
    let displacements: Vec<_> = (0..tensions.len())
        .map(|i| {
            let straight = robot.spec().disks[tendons[i].end_disk].station;
            // tendons without tension get a slack length
            let surplus = if tensions[i] > 0.0 { 0.0 } else { 1e-3 };
            Command::Displacement(straight - solver.tendon_length(i).unwrap() - surplus)
        })
        .collect();
    let by_tension: Vec<_> = tensions.iter().map(|t| Command::Tension(*t)).collect();
    for (way, friction, commands) in [
        ("by_displacement", 0.0, &displacements),
        ("by_tension_with_friction", 0.1, &by_tension),
        ("by_displacement_with_friction", 0.1, &displacements),
    ] {
        let lines = vec![
            Line {
                friction,
                ..Line::default()
            };
            tensions.len()
        ];
        let mut path = PathSolver::new(robot, Model::default(), 1, &lines).unwrap();
        let found = path.step(commands, &load).unwrap();
        assert_eq!(found.status, Status::Converged);
        println!(
            "{name} {way}: {} steps in {} parts",
            found.iterations, found.increments
        );
        c.bench_function(&format!("{name}_{way}"), |b| {
            b.iter(|| {
                path.reset();
                path.step(commands, &load).unwrap()
            })
        });
    }
}

fn actuation(c: &mut Criterion) {
    compare(c, "study", &study_robot(9, 0.0), &[40.0, 10.0, 5.0], 1.0);
    compare(c, "slack", &study_robot(9, 0.0), &[40.0, 0.0, 0.0], 1.0);
    for (count, disks) in [(1, 10), (2, 10), (3, 10), (3, 20)] {
        let robot = segments(count, disks);
        let tensions = &[3.0, 1.0, 0.5, 4.0, 1.0, 1.5, 2.0, 0.5, 1.0][..3 * count];
        compare(c, &format!("{count}x{disks}"), &robot, tensions, 0.01);
    }
}

criterion_group! {
    name = group;
    config = Criterion::default()
        .warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = actuation
}
criterion_main!(group);
