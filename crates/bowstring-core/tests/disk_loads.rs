//! Dead forces and moments on disks: closed forms, invariances, and agreement of all solvers.

mod common;

use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator, Step};
use bowstring_core::dynamics::modal::flexibility;
use bowstring_core::math::lie;
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Load, Model, OwnedLoad, RodModel, TendonPath, Theory};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::designs::sweep_designs;
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::path_batch::{follow, solve_each, Steps};
use bowstring_core::statics::solver::{Outcome, Pose, Solver, Status};
use common::{by_tensions, rao_robot, study_robot, Draw};

const NONE: [f64; 3] = [0.0; 3];
const GRAVITY: [f64; 3] = [1.0, 2.0, -9.81];

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

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

fn drawn(draw: &mut Draw, disks: usize, size: f64) -> Vec<[f64; 3]> {
    let mut component = || draw.within(-size, size);
    (0..disks)
        .map(|_| [component(), component(), component()])
        .collect()
}

fn solved(solver: &mut Solver, load: &Load) -> Outcome {
    let outcome = solver.solve(load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{load:?}");
    outcome
}

fn disks(solver: &Solver) -> Vec<Pose> {
    let n = solver.robot().module_count();
    (0..n).map(|k| solver.disk(k).unwrap()).collect()
}

fn apart(a: &[Pose], b: &[Pose]) -> f64 {
    let places = a.iter().zip(b);
    places.fold(0.0, |m, (a, b)| {
        f64::max(m, (a.position - b.position).norm())
    })
}

fn turned(angle: f64, v: [f64; 3]) -> [f64; 3] {
    let (s, c) = angle.sin_cos();
    [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
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

/// The elastic energy grows by the work of the forces.
#[test]
fn virtual_work() {
    let robot = weightless(9);
    let forces = drawn(&mut Draw(3), 9, 1.0);
    let settings = Integrator {
        gravity: NONE,
        damping: Damping {
            mass: 0.0,
            material: 0.0,
        },
        spectral_radius: 1.0,
        step: Step::Fixed(1e-3),
    };
    let mut spec = robot.spec().clone();
    // only for a motion to exist
    spec.disks.iter_mut().for_each(|d| d.mass = 0.02);
    let robot = Robot::new(spec).unwrap();
    let at = |factor: f64| {
        let forces: Vec<_> = forces.iter().map(|f| f.map(|x| x * factor)).collect();
        let load = Load {
            disk_forces: &forces,
            ..by_tensions(&NONE)
        };
        let mut simulator = Simulator::new(&robot, Model::default(), 1, settings).unwrap();
        simulator.rest(&load).unwrap();
        assert!(simulator.is_ready());
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        solved(&mut solver, &load);
        (simulator.energies().elastic, disks(&solver))
    };
    let h = 1e-3;
    let ((high, up), (low, down)) = (at(1.0 + h), at(1.0 - h));
    let moved = up.iter().zip(&down).map(|(u, d)| u.position - d.position);
    let work: f64 = moved.zip(&forces).map(|(m, f)| m.dot(Vec3(*f))).sum();
    assert!(work > 1e-4);
    let off = (high - low) / work - 1.0;
    assert!(off.abs() < 1e-5, "{off:e}");
}

/// Central differences of all poses with respect to one load.
fn differences(robot: &Robot, load: &OwnedLoad, change: impl Fn(&mut OwnedLoad, f64)) -> Vec<Pose> {
    let at = |step: f64| {
        let mut load = load.clone();
        change(&mut load, step);
        let mut solver = Solver::new(robot, Model::default(), 1).unwrap();
        solved(&mut solver, &load.borrow());
        disks(&solver)
    };
    let h = 1e-4;
    let (up, down) = (at(h), at(-h));
    let both = up.iter().zip(&down);
    both.map(|(u, d)| Pose {
        position: (u.position - d.position) * (0.5 / h),
        rotation: {
            let mut columns = Mat3::zero();
            let turn = lie::log(&(u.rotation * d.rotation.transpose())) * (0.5 / h);
            for q in 0..3 {
                columns.0[q][0] = turn[q];
            }
            columns
        },
    })
    .collect()
}

fn loaded(moments: bool) -> OwnedLoad {
    let mut draw = Draw(11);
    OwnedLoad {
        tensions: vec![30.0, 5.0, 10.0],
        gravity: GRAVITY,
        tip_force: [0.2, 0.1, -0.3],
        tip_moment: if moments { [0.05, -0.1, 0.2] } else { NONE },
        disk_forces: drawn(&mut draw, 9, 0.4),
        disk_moments: match moments {
            true => drawn(&mut draw, 9, 0.06),
            false => vec![],
        },
        ..OwnedLoad::default()
    }
}

/// Maxwell's reciprocity of two disks, and the derivatives of the tip under loads on disks.
#[test]
fn derivatives_under_loads_on_disks() {
    let robot = study_robot(9, 0.003);
    for moments in [false, true] {
        let load = loaded(moments);
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        solved(&mut solver, &load.borrow());
        let by = solver.jacobians(false).unwrap();
        for q in 0..3 {
            let force = differences(&robot, &load, |l, h| l.tip_force[q] += h);
            let moment = differences(&robot, &load, |l, h| l.tip_moment[q] += h);
            let tension = differences(&robot, &load, |l, h| l.tensions[q] += h);
            let last = differences(&robot, &load, |l, h| l.disk_forces[8][q] += h);
            assert!((last[8].position - force[8].position).norm() < 1e-8);
            for (found, exact) in [
                (&by.tip_force[q], &force[8]),
                (&by.tip_moment[q], &moment[8]),
                (&by.tensions[q], &tension[8]),
            ] {
                let turn = exact.rotation.column(0);
                let scale = exact.position.norm();
                assert!((found.position - exact.position).norm() < 1e-6 * scale);
                assert!((found.rotation - turn).norm() < 1e-6 * turn.norm());
            }
            if moments {
                continue; // without a potential there is no reciprocity
            }
            for p in 0..3 {
                let other = differences(&robot, &load, |l, h| l.disk_forces[3][p] += h);
                let (ours, theirs) = (other[8].position[q], force[3].position[p]);
                assert!((ours - theirs).abs() < 1e-8, "{ours} {theirs}");
            }
        }
    }
}

/// Small motions about the equilibrium respond as statics does.
#[test]
fn flexibility_is_that_of_statics() {
    let robot = study_robot(9, 0.003);
    let load = loaded(false);
    let (_, found) = flexibility(&robot, Model::default(), 1, &load.borrow()).unwrap();
    let mut found = found.unwrap();
    // translation of a disk after that of the inner points, rotation after it
    let per_disk = 3 * found.points + 3;
    let at = |k: usize| k * per_disk + 3 * (found.points - 1);
    let places: Vec<_> = (0..9).map(at).collect();
    let mut forces = vec![0.0; found.masses.len()];
    forces[places[4]] = 1.0;
    let moved = found.apply(&forces);
    let exact = differences(&robot, &load, |l, h| l.disk_forces[4][0] += h);
    for (k, pose) in exact.iter().enumerate() {
        for q in 0..3 {
            let off = (moved[places[k] + q] - pose.position[q]).abs();
            assert!(off < 2e-4 * exact[8].position.norm(), "{k} {q}: {off:e}");
        }
    }
}

/// A third of a turn of all loads, with the tensions, turns the robot.
#[test]
fn solutions_turn_with_the_loads() {
    let robot = study_robot(9, 0.003);
    let angle = 2.0 * std::f64::consts::FRAC_PI_3;
    for moments in [false, true] {
        let load = loaded(moments);
        let turn = |v: [f64; 3]| turned(angle, v);
        let [a, b, c] = load.tensions[..] else {
            unreachable!()
        };
        let other = OwnedLoad {
            tensions: vec![c, a, b],
            gravity: turn(load.gravity),
            tip_force: turn(load.tip_force),
            tip_moment: turn(load.tip_moment),
            disk_forces: load.disk_forces.iter().copied().map(turn).collect(),
            disk_moments: load.disk_moments.iter().copied().map(turn).collect(),
            ..OwnedLoad::default()
        };
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        let first = solved(&mut solver, &load.borrow());
        let places = disks(&solver);
        let second = solved(&mut solver, &other.borrow());
        assert_eq!(first.stable, second.stable);
        for (pose, found) in places.iter().zip(disks(&solver)) {
            let expected = Vec3(turned(angle, pose.position.0));
            let off = (expected - found.position).norm();
            assert!(off < 1e-11, "{off:e}");
        }
    }
}

fn settings(mass: f64) -> Integrator {
    Integrator {
        gravity: GRAVITY,
        damping: Damping {
            mass,
            material: 1e-3,
        },
        spectral_radius: 0.8,
        step: Step::Fixed(5e-3),
    }
}

/// A robot rests under its loads, a damped one comes to rest there, and work balances energy.
#[test]
fn motion_ends_in_the_static_equilibrium() {
    let robot = study_robot(9, 0.003);
    for moments in [false, true] {
        let load = loaded(moments);
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        solved(&mut solver, &load.borrow());
        let exact = solver.tip().unwrap().position;
        let mut rest = Simulator::new(&robot, Model::default(), 1, settings(0.0)).unwrap();
        rest.rest(&load.borrow()).unwrap();
        assert!(rest.is_ready());
        let start = rest.tip();
        // gravity by Simpson's rule here, by Hermite's in statics
        assert!((start - exact).norm() < 2e-6);
        rest.advance(0.1, &load.borrow()).unwrap();
        assert!((rest.tip() - start).norm() < 1e-8);

        let mut moving = Simulator::new(&robot, Model::default(), 1, settings(15.0)).unwrap();
        let none = by_tensions(&NONE);
        moving.rest(&none).unwrap();
        let energy = |s: &Simulator| s.energies().left();
        let before = energy(&moving);
        assert_eq!(moving.advance(0.2, &load.borrow()).unwrap().0, None);
        let work = moving.energies().work;
        assert!((energy(&moving) - before).abs() < 1e-2 * work.abs());
        assert_eq!(moving.advance(6.0, &load.borrow()).unwrap().0, None);
        let off = (moving.tip() - exact).norm();
        assert!((start - exact).norm() > 0.0 && off < 3e-6, "{off:e}");
    }
}

/// Held forces add to those of the load, and leave them when they are released.
#[test]
fn held_forces_add_to_those_of_the_load() {
    let robot = study_robot(9, 0.0);
    let load = loaded(false);
    let held = drawn(&mut Draw(5), 9, 0.3);
    let mut both = load.clone();
    for (to, from) in both.disk_forces.iter_mut().zip(&held) {
        for q in 0..3 {
            to[q] += from[q];
        }
    }
    let mut simulator = Simulator::new(&robot, Model::default(), 1, settings(0.0)).unwrap();
    simulator.rest(&both.borrow()).unwrap();
    let exact = simulator.tip();
    simulator.rest(&load.borrow()).unwrap();
    let alone = simulator.tip();
    assert_eq!(simulator.rest_with_disk_forces(&held, 3).unwrap(), None);
    assert!((simulator.tip() - exact).norm() < 1e-9);
    simulator.release_disk_forces();
    simulator.rest(&load.borrow()).unwrap();
    assert!((simulator.tip() - alone).norm() < 1e-12);
}

/// The estimate covers the difference to eight elements.
#[test]
fn the_error_estimate_covers_the_error() {
    let mut draw = Draw(21);
    let mut tight = 0;
    for robot in [study_robot(9, 0.003), rao_robot(), study_robot(4, 0.0)] {
        let n = robot.module_count();
        let softest = robot.moment_scale() / robot.length();
        for i in 0..20 {
            let forces = drawn(&mut draw, n, 1.5 * softest / (n as f64).sqrt());
            let moments = drawn(&mut draw, n, 0.5 * robot.moment_scale() / n as f64);
            let none = vec![0.0; robot.tendon_count()];
            let load = Load {
                disk_forces: &forces,
                disk_moments: if i % 2 == 0 { &moments } else { &[] },
                ..by_tensions(&none)
            };
            let mut coarse = Solver::new(&robot, Model::default(), 1).unwrap();
            let mut outcome = coarse.solve(&load).unwrap();
            if outcome.status != Status::Converged {
                continue;
            }
            coarse.estimate_error(&mut outcome);
            let mut fine = Solver::new(&robot, Model::default(), 8).unwrap();
            solved(&mut fine, &load);
            let error = outcome.error.unwrap().tip;
            let off = apart(&disks(&coarse), &disks(&fine));
            assert!(off <= error + 1e-12, "{n} {i}: {off:e} {error:e}");
            tight += usize::from(error < 100.0 * off + 1e-12);
        }
    }
    assert!(tight > 30, "{tight}");
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
        let mut load = loaded(true);
        let moments = load.disk_moments.iter_mut().chain([&mut load.tip_moment]);
        moments.flatten().for_each(|m| *m *= share);
        let outcome = solved(&mut solver, &load.borrow());
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
    let outcome = solver.solve(&load).unwrap();
    assert!(outcome.residual < 1e-6 || outcome.status != Status::Converged);
    assert_eq!(outcome.status, Status::Converged, "{outcome:?}");
}

/// Loads of rows as flat arrays.
struct Rows {
    tensions: Vec<f64>,
    forces: Vec<[f64; 3]>,
    moments: Vec<[f64; 3]>,
}

impl Rows {
    fn new(count: usize, moments: bool) -> Self {
        let mut draw = Draw(count as u64);
        Rows {
            tensions: (0..3 * count).map(|_| draw.within(0.0, 30.0)).collect(),
            forces: drawn(&mut draw, 9 * count, 0.3),
            moments: match moments {
                true => drawn(&mut draw, 9 * count, 0.03),
                false => vec![],
            },
        }
    }

    fn loads(&self) -> Loads<'_> {
        Loads {
            count: self.tensions.len() / 3,
            tensions: &self.tensions,
            gravity: &GRAVITY,
            tip_force: &[0.1, 0.0, 0.2],
            tip_moment: &NONE,
            disks: 9,
            disk_forces: &self.forces,
            disk_moments: &self.moments,
            ..Loads::default()
        }
    }
}

#[test]
fn many_loads_equal_single_ones() {
    let robot = study_robot(9, 0.003);
    let settings = RodModel::default();
    for moments in [false, true] {
        for common in [false, true] {
            let mut rows = Rows::new(21, moments);
            if common {
                rows.forces.truncate(9);
                rows.moments.truncate(9);
            }
            let loads = rows.loads();
            let batch = solve_batch(&robot, &settings, &loads, 2, true).unwrap();
            let warm = sweep(&robot, &settings, &loads, true, true).unwrap();
            let designs = vec![robot.clone(); 3];
            let each = sweep_designs(&designs, &settings, &loads, 1).unwrap();
            let mut solver = Adaptive::of(&robot, &settings).unwrap();
            for i in 0..21 {
                let outcome = solver.solve(&loads.row(i, 3)).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                assert_eq!(batch.outcomes[i].stable, outcome.stable);
                for (k, pose) in disks(solver.solver()).iter().enumerate() {
                    let at = 27 * i + 3 * k;
                    for found in [&batch.disk_position, &warm.disk_position] {
                        let place = &found[at..at + 3];
                        let off = (Vec3([place[0], place[1], place[2]]) - pose.position).norm();
                        assert!(off < 1e-9, "row {i}, disk {k}: {off:e}");
                    }
                }
                let place = &each.tip_position[3 * i..][..3];
                let tip = solver.solver().tip().unwrap().position;
                assert!((Vec3([place[0], place[1], place[2]]) - tip).norm() < 1e-9);
            }
        }
    }
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

/// Under displacement control the tensions found hold the same pose, also with friction and in
/// steps of the load.
#[test]
fn paths_take_loads_on_disks() {
    let robot = study_robot(9, 0.003);
    let lines = |friction: f64| {
        let line = Line {
            stiffness: 2e4,
            friction,
            pretension: 2.0,
            ..Line::default()
        };
        vec![line; 3]
    };
    let shortened = [0.012, -0.004, -0.006];
    let commands = shortened.map(Command::Displacement);
    for moments in [false, true] {
        let load = OwnedLoad {
            tensions: vec![],
            ..loaded(moments)
        };
        let mut path = PathSolver::new(&robot, Model::default(), 1, &lines(0.0)).unwrap();
        let outcome = path.step(&commands, &load.borrow()).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let tensions = path.history().tensions.clone();
        assert_eq!(path.history().load, load);
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        let by_tensions = Load {
            tensions: &tensions,
            ..load.borrow()
        };
        solved(&mut solver, &by_tensions);
        let off = apart(&disks(&solver), &disks(path.solver()));
        assert!(off < 1e-8, "{off:e}");
        // the disks move without the loads
        path.reset();
        path.step(&commands, &Load::default()).unwrap();
        assert!(apart(&disks(&solver), &disks(path.solver())) > 1e-3);
        // with friction, from a load to its opposite and in one step
        let mut rough = PathSolver::new(&robot, Model::default(), 1, &lines(0.2)).unwrap();
        let outcome = rough.step(&commands, &load.borrow()).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let loaded = rough.clone();
        rough.step(&commands, &Load::default()).unwrap();
        let rows = [load.disk_forces.clone(), vec![NONE; 9]].concat();
        let other = [load.disk_moments.clone(), vec![NONE; 9]].concat();
        let values = shortened.repeat(2);
        let steps = Steps {
            durations: &[],
            loads: Loads {
                count: 2,
                tensions: &values,
                gravity: &[load.gravity, NONE].concat(),
                tip_force: &[load.tip_force, NONE].concat(),
                tip_moment: &[load.tip_moment, NONE].concat(),
                disks: 9,
                disk_forces: &rows,
                disk_moments: if moments { &other } else { &[] },
                ..Loads::default()
            },
            by_displacement: &[true; 6],
        };
        let mut fresh = PathSolver::new(&robot, Model::default(), 1, &lines(0.2)).unwrap();
        let followed = follow(&mut fresh, &steps, true).unwrap();
        assert!(apart(&disks(fresh.solver()), &disks(rough.solver())) < 1e-9);
        let tip = loaded.solver().tip().unwrap().position;
        let place = &followed.poses.tip_position[..3];
        assert!((Vec3([place[0], place[1], place[2]]) - tip).norm() < 1e-9);
        // in lanes, each from home
        let mut smooth = PathSolver::new(&robot, Model::default(), 1, &lines(0.0)).unwrap();
        let each = solve_each(&mut smooth, &steps, 1, true).unwrap();
        let place = &each.poses.disk_position[..27];
        for (k, pose) in disks(&solver).iter().enumerate() {
            let found = Vec3([place[3 * k], place[3 * k + 1], place[3 * k + 2]]);
            assert!((found - pose.position).norm() < 1e-8);
        }
    }
}

#[test]
fn bad_loads_are_rejected() {
    let robot = study_robot(9, 0.0);
    let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
    let given = by_tensions(&NONE);
    let mut refused = |load: Load| solver.solve(&load).unwrap_err().to_string();
    let few = Load {
        disk_forces: &[NONE; 4],
        ..given
    };
    assert_eq!(
        refused(few),
        "dead force has 4 entries, it must have 9, one for each disk"
    );
    let nan = Load {
        disk_moments: &only(2, [0.0, f64::NAN, 0.0]),
        ..given
    };
    assert_eq!(
        refused(nan),
        "dead moment of disk 3 is [0.0, NaN, 0.0] N m, it must be finite"
    );
    let two = Rows::new(2, false);
    let rows = Loads {
        disk_forces: &[NONE; 10],
        ..two.loads()
    };
    let error = rows.check(&robot).unwrap_err().to_string();
    assert!(error.contains("10 forces on disks"), "{error}");
}
