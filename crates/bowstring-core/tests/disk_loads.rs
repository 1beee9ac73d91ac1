//! Dead forces and moments on disks: closed forms, stability, large loads.

mod common;

use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, RodModel, TendonPath};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::solve_batch;
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::Solver;
use common::{apart, by_tensions, disks, kirchhoff, solved, study_robot, Draw};

const NONE: [f64; 3] = [0.0; 3];
const GRAVITY: [f64; 3] = [1.0, 2.0, -9.81];

/// The study's robot without mass, with `n` of its nine disks.
fn weightless(n: usize) -> Robot {
    let mut spec = study_robot(9, 0.003).spec().clone();
    spec.disks.truncate(n);
    spec.disks.iter_mut().for_each(|d| d.mass = 0.0);
    spec.tendons.iter_mut().for_each(|t| t.end_disk = n - 1);
    spec.backbone[0].sections_mut()[0].mass_per_length = 0.0;
    Robot::new(spec).unwrap()
}

/// No vector but that on one disk, of nine.
fn only(disk: usize, vector: [f64; 3]) -> [[f64; 3]; 9] {
    let mut all = [NONE; 9];
    all[disk] = vector;
    all
}

#[test]
fn a_load_on_the_last_disk_is_one_on_the_tip() {
    let robot = study_robot(9, 0.003);
    let (force, moment) = ([0.4, -0.8, 0.3], [0.05, -0.1, 0.2]);
    let given = Load {
        gravity: GRAVITY,
        ..by_tensions(&[30.0, 5.0, 10.0])
    };
    let continuous = Model {
        tendon: TendonPath::Continuous,
        ..Model::default()
    };
    for model in [Model::default(), kirchhoff(), continuous] {
        for elements in [1, 2] {
            let mut solver = Solver::new(&robot, model, elements).unwrap();
            for (force, moment) in [(force, NONE), (NONE, moment), (force, moment)] {
                let at_tip = Load {
                    tip_force: force,
                    tip_moment: moment,
                    ..given
                };
                let on_disk = Load {
                    disk_forces: &only(8, force),
                    disk_moments: &only(8, moment),
                    ..given
                };
                let tip = solved(&mut solver, &at_tip);
                let places = disks(&solver);
                let disk = solved(&mut solver, &on_disk);
                let off = apart(&places, &disks(&solver));
                // from different starts, to the tolerance of the residual
                assert!(off < 1e-10, "{model:?} {elements}: {off:e}");
                assert_eq!(tip.stable, disk.stable);
            }
        }
    }
}

/// A cantilever under a small transverse force or moment at a disk, against Bernoulli's beam.
#[test]
fn a_cantilever_follows_the_beam() {
    let robot = study_robot(9, 0.0);
    let bending = robot.spec().backbone[0].sections()[0].bending[0];
    let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
    let (f, m) = (1e-4, 1e-5);
    for k in [0, 3, 8] {
        let a = robot.spec().disks[k].station;
        for by_force in [true, false] {
            let load = Load {
                disk_forces: &only(k, [if by_force { f } else { 0.0 }, 0.0, 0.0]),
                disk_moments: &only(k, [0.0, if by_force { 0.0 } else { m }, 0.0]),
                ..by_tensions(&NONE)
            };
            solved(&mut solver, &load);
            for (disk, pose) in robot.spec().disks.iter().zip(disks(&solver)) {
                // bent up to the disk, straight beyond
                let x = f64::min(disk.station, a);
                let (bent, slope) = if by_force {
                    (f * x * x * (3.0 * a - x) / 6.0, f * x * (a - 0.5 * x))
                } else {
                    (m * x * x / 2.0, m * x)
                };
                let exact = (bent + slope * (disk.station - x)) / bending;
                let off = (pose.position[0] / exact - 1.0).abs();
                assert!(off < 1e-6, "disk {k}, {by_force}: {off:e}");
            }
        }
    }
}

/// Below a loaded disk the robot has the shape of one that ends there; beyond it is straight.
#[test]
fn the_unloaded_part_does_not_matter() {
    let (force, moment) = ([6.0, -3.0, -4.0], [0.3, 0.5, -0.2]);
    let whole = weightless(9);
    for k in [1, 4, 7] {
        let cut = weightless(k + 1);
        for (force, moment) in [(force, NONE), (NONE, moment), (force, moment)] {
            for elements in [1, 4] {
                let mut solver = Solver::new(&whole, Model::default(), elements).unwrap();
                let load = Load {
                    disk_forces: &only(k, force),
                    disk_moments: &only(k, moment),
                    ..by_tensions(&NONE)
                };
                let found = solved(&mut solver, &load);
                let mut shorter = Solver::new(&cut, Model::default(), elements).unwrap();
                let load = Load {
                    tip_force: force,
                    tip_moment: moment,
                    ..by_tensions(&NONE)
                };
                let alone = solved(&mut shorter, &load);
                let (all, below) = (disks(&solver), disks(&shorter));
                let off = apart(&all[..=k], &below);
                assert!(off < 1e-9, "disk {k}, {elements}: {off:e}");
                assert_eq!(found.stable, alone.stable, "disk {k}");
                let last = below[k];
                for (disk, pose) in whole.spec().disks.iter().zip(&all).skip(k + 1) {
                    let along = disk.station - whole.spec().disks[k].station;
                    let straight = last.position + last.rotation.column(2) * along;
                    assert!((pose.position - straight).norm() < 1e-9);
                }
            }
        }
    }
}

/// Forces have a potential: a column that is compressed at a disk buckles at Euler's load of the
/// part below it. Small moments keep the equilibrium stable.
#[test]
fn stability_is_determined() {
    let robot = study_robot(9, 0.0);
    let bending = robot.spec().backbone[0].sections()[0].bending[0];
    let mut solver = Solver::new(&robot, kirchhoff(), 4).unwrap();
    for k in [3, 6] {
        let a = robot.spec().disks[k].station;
        let euler = std::f64::consts::PI.powi(2) * bending / (4.0 * a * a);
        for (share, buckles) in [(0.98, false), (1.02, true)] {
            let load = Load {
                disk_forces: &only(k, [0.0, 0.0, -share * euler]),
                ..by_tensions(&NONE)
            };
            let outcome = solved(&mut solver, &load);
            assert_eq!(outcome.stable, Some(true));
            assert_eq!(outcome.left_unstable, buckles, "disk {k} at {share}");
            let tip = solver.tip().unwrap().position;
            assert_eq!(tip[0].hypot(tip[1]) > 1e-2, buckles);
        }
    }
    // large moments need more damping than 1 %
    for (share, stable) in [(0.1, Some(true)), (1.0, None)] {
        let mut draw = Draw(11);
        let [forces, moments] = [0.4, share * 0.06].map(|size| {
            let mut component = |_| draw.within(-size, size);
            let vectors = (0..9).map(|_| [0; 3].map(&mut component));
            vectors.collect::<Vec<_>>()
        });
        let load = Load {
            gravity: GRAVITY,
            tip_force: [0.2, 0.1, -0.3],
            tip_moment: [0.05, -0.1, 0.2].map(|m| share * m),
            disk_forces: &forces,
            disk_moments: &moments,
            ..by_tensions(&[30.0, 5.0, 10.0])
        };
        let outcome = solved(&mut solver, &load);
        assert_eq!(outcome.stable, stable, "{share} of the moments");
    }
    // moments on opposite sides of a disk are felt between them only
    let mut pair = [NONE; 9];
    (pair[2], pair[5]) = ([0.0, -0.4, 0.0], [0.0, 0.4, 0.0]);
    let load = Load {
        disk_moments: &pair,
        ..by_tensions(&NONE)
    };
    let outcome = solved(&mut solver, &load);
    assert_eq!(outcome.stable, Some(true));
    let places = disks(&solver);
    assert!(places[2].position[0].abs() < 1e-9 && places[8].position[0] > 0.01);
}

/// Large moments on disks are met, by load stepping where necessary.
#[test]
fn large_loads_are_met() {
    let robot = study_robot(9, 0.003);
    let mut solver = Solver::new(&robot, Model::default(), 2).unwrap();
    let load = Load {
        disk_forces: &only(4, [0.0, 40.0, -30.0]),
        disk_moments: &only(6, [2.0, 0.0, 0.0]),
        ..by_tensions(&[40.0, 0.0, 0.0])
    };
    assert!(solved(&mut solver, &load).residual < 1e-6);
}

/// So many loads on a disk that they start from a polynomial.
#[test]
fn a_polynomial_of_disk_forces_starts_a_batch() {
    let robot = study_robot(9, 0.003);
    let settings = RodModel::default();
    let count = 2000;
    let mut forces = vec![NONE; 9 * count];
    for i in 0..count {
        forces[9 * i + 4] = [0.0, 2.0 * (i as f64 / count as f64) - 1.0, 0.0];
    }
    let tensions = [20.0, 0.0, 0.0].repeat(count);
    let loads = Loads {
        count,
        tensions: &tensions,
        gravity: &GRAVITY,
        tip_force: &NONE,
        tip_moment: &NONE,
        disks: 9,
        disk_forces: &forces,
        ..Loads::default()
    };
    let batch = solve_batch(&robot, &settings, &loads, 1, false).unwrap();
    let mut solver = Adaptive::of(&robot, &settings).unwrap();
    for i in (0..count).step_by(97) {
        solver.solve(&loads.row(i, 3)).unwrap();
        let tip = solver.solver().tip().unwrap().position;
        let place = &batch.tip_position[3 * i..][..3];
        assert!((Vec3([place[0], place[1], place[2]]) - tip).norm() < 1e-9);
    }
}
