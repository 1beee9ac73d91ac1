//! Robots under displacement control: lengths, slack, elasticity and friction.

mod common;

use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, RodModel};
use bowstring_core::model::robot::{Robot, Tendon};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::path::{Command, History, Line, PathOutcome, PathSolver};
use bowstring_core::statics::path_batch::{
    commands, follow, follow_designs, solve_each, Designs, PathSolutions, Steps,
};
use bowstring_core::statics::solver::{Solver, Status};
use common::{
    apart, by_tensions, disks, displacements, hole, kirchhoff, rao_robot, solved, study_robot,
    tensions, Draw,
};

fn stiff(robot: &Robot) -> Vec<Line> {
    vec![Line::default(); robot.tendon_count()]
}

fn path_solver(robot: &Robot, model: Model) -> PathSolver {
    PathSolver::new(robot, model, 1, &stiff(robot)).unwrap()
}

/// Rows of values and their kinds, under gravity and a tip force.
fn steps<'a>(
    count: usize,
    values: &'a [f64],
    by_displacement: &'a [bool],
    gravity: &'a [f64],
    tip_force: &'a [f64],
) -> Steps<'a> {
    Steps {
        durations: &[],
        guesses: None,
        loads: Loads {
            count,
            tensions: values,
            gravity,
            tip_force,
            tip_moment: &[0.0; 3],
            ..Loads::default()
        },
        by_displacement,
    }
}

fn step(path: &mut PathSolver, commands: &[Command], load: &Load) -> PathOutcome {
    path.step(commands, load).unwrap()
}

/// Displacements of the tendons of a solution (m).
fn shortened(solver: &Solver) -> Vec<f64> {
    let (spec, tendons) = (solver.robot().spec(), solver.robot().spec().tendons.iter());
    let straight = tendons.map(|tendon| spec.disks[tendon.end_disk].station);
    let each = straight.enumerate();
    each.map(|(i, length)| length - solver.tendon_length(i).unwrap())
        .collect()
}

/// A step that is too long for one Newton iteration is divided.
#[test]
fn a_long_step_is_divided() {
    let robot = study_robot(9, 0.003);
    let mut path = path_solver(&robot, Model::default());
    let given = [150.0, 210.0, 90.0];
    let load = Load {
        gravity: [-8.0, 4.0, 4.0],
        tip_force: [6.0, 10.0, 0.0],
        ..Load::default()
    };
    let found = step(&mut path, &tensions(&given), &load);
    assert!(found.status == Status::Converged && found.increments > 1);
    let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
    let tensions = &given;
    solved(&mut solver, &Load { tensions, ..load });
    assert!(apart(&disks(path.solver()), &disks(&solver)) < 1e-9);
}

/// Lengths of a solve under tension control, used as displacements, return the tensions.
#[test]
fn lengths_return_tensions() {
    let mut draw = Draw(1);
    for (robot, most) in [
        (study_robot(9, 0.0), 60.0),
        (study_robot(9, 0.003), 60.0),
        (rao_robot(), 4.0),
    ] {
        let m = robot.tendon_count();
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        let mut path = path_solver(&robot, Model::default());
        let mut worst: f64 = 0.0;
        let mut steps = 0;
        for _ in 0..200 {
            let given_tensions: Vec<_> = (0..m).map(|_| draw.within(1.0, most)).collect();
            let load = Load {
                gravity: [0.0, 1.0, -3.0],
                tip_force: [draw.within(-0.1, 0.1), 0.0, 0.1],
                ..by_tensions(&given_tensions)
            };
            assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
            let given = shortened(&solver);
            path.reset();
            let found = step(&mut path, &displacements(&given), &load);
            assert_eq!(
                found.status,
                Status::Converged,
                "{given_tensions:?} {found:?}"
            );
            steps += found.iterations;
            assert_eq!(found.stable, Some(true));
            let largest = given_tensions.iter().fold(0.0, |a: f64, t| a.max(*t));
            for (t, back) in given_tensions.iter().zip(&path.history().tensions) {
                worst = worst.max((t - back).abs() / largest);
            }
            let apart = path.solver().tip().unwrap().position - solver.tip().unwrap().position;
            assert!(apart.norm() < 1e-11);
            assert!(path.slack().iter().all(|s| *s == 0.0));
        }
        println!("worst {worst:e}, {} steps", steps as f64 / 200.0);
        assert!(worst < 1e-8, "{worst:e}");
    }
}

/// Without extension, the tensions of three tendons of a straight segment are not unique: the
/// smallest are returned, and the pose is the same.
#[test]
fn least_tensions_without_extension() {
    let mut draw = Draw(2);
    for (robot, most) in [(study_robot(9, 0.0), 60.0), (rao_robot(), 4.0)] {
        let m = robot.tendon_count();
        let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
        let mut path = path_solver(&robot, kirchhoff());
        let mut worst: f64 = 0.0;
        for round in 0..100 {
            let common = if round % 10 == 0 { most / 2.0 } else { 0.0 };
            let given_tensions: Vec<_> = (0..m)
                .map(|_| {
                    if round % 10 == 0 {
                        common
                    } else {
                        draw.within(0.0, most)
                    }
                })
                .collect();
            let load = by_tensions(&given_tensions);
            solver.solve(&load).unwrap();
            let given = shortened(&solver);
            path.reset();
            let found = step(&mut path, &displacements(&given), &load);
            assert_eq!(
                found.status,
                Status::Converged,
                "{given_tensions:?} {found:?}"
            );
            let size = |t: &[f64]| t.iter().map(|t| t * t).sum::<f64>();
            let back = &path.history().tensions;
            assert!(
                size(back) <= size(&given_tensions) * (1.0 + 1e-6),
                "{given_tensions:?} {back:?}"
            );
            let apart = path.solver().tip().unwrap().position - solver.tip().unwrap().position;
            worst = worst.max(apart.norm() / robot.length());
            assert_eq!(
                found.undetermined,
                round % 10 == 0,
                "{given_tensions:?} {back:?}"
            );
            if round % 10 == 0 {
                assert!(size(back) < 1e-6 * size(&given_tensions), "{back:?}");
            }
        }
        println!("{worst:e}");
        assert!(worst < 1e-9, "{worst:e}");
    }
}

/// A lengthened tendon is slack: zero tension, and its slack length follows from geometry.
#[test]
fn slack_length_equals_surplus_length() {
    let robot = study_robot(9, 0.0);
    for model in [Model::default(), kirchhoff()] {
        let mut path = path_solver(&robot, model);
        let none = [0.0; 3];
        let found = step(
            &mut path,
            &displacements(&[0.02, -0.03, -0.03]),
            &by_tensions(&none),
        );
        assert_eq!(found.status, Status::Converged);
        let t = path.history().tensions.clone();
        assert!(t[0] > 1.0 && t[1] == 0.0 && t[2] == 0.0, "{t:?}");
        for i in 1..3 {
            let surplus = 0.641 + 0.03 - path.solver().tendon_length(i).unwrap();
            assert!((path.slack()[i] - surplus).abs() < 1e-12 && surplus > 1e-3);
        }
        assert_eq!(path.slack()[0], 0.0);
        // all lengthened by 10 mm: straight, and all slack
        let found = step(&mut path, &displacements(&[-0.01; 3]), &by_tensions(&none));
        assert_eq!(found.status, Status::Converged);
        assert_eq!(path.history().tensions, none);
        for s in path.slack() {
            assert!((s - 0.01).abs() < 1e-12, "{s}");
        }
    }
}

/// Random displacements: tendons shortened and lengthened.
#[test]
fn random_displacements() {
    let robot = rao_robot();
    let mut draw = Draw(3);
    let mut cold = path_solver(&robot, Model::default());
    let mut warm = path_solver(&robot, Model::default());
    let (mut failed, mut steps, mut most) = (0, 0, 0);
    let mut slack = 0;
    for round in 0..1000 {
        // displacements of a bend in each segment, lengthened in addition by up to 2 mm
        let mut given = vec![];
        let mut inner = [0.0; 2];
        for segment in 0..2 {
            let bend = [draw.within(-1.2, 1.2), draw.within(-1.2, 1.2)];
            for a in [90.0f64, -30.0, 210.0] {
                let (c, s) = (a.to_radians().cos(), a.to_radians().sin());
                let both = [bend[0] + inner[0], bend[1] + inner[1]];
                given.push(0.01 * (c * both[0] + s * both[1]) - draw.within(0.0, 0.002));
            }
            if segment == 0 {
                inner = bend;
            }
        }
        cold.reset();
        let none = [0.0; 6];
        let found = step(&mut cold, &displacements(&given), &by_tensions(&none));
        if found.status != Status::Converged {
            failed += 1;
            println!("{round}: {given:?} {found:?}");
            continue;
        }
        steps += found.iterations;
        most = most.max(found.iterations);
        let next = step(&mut warm, &displacements(&given), &by_tensions(&none));
        assert_eq!(next.status, Status::Converged);
        let apart = cold.solver().tip().unwrap().position - warm.solver().tip().unwrap().position;
        assert!(apart.norm() < 1e-9, "{round}: {:e} {given:?}", apart.norm());
        for (path, found) in [(&cold, &found), (&warm, &next)] {
            assert!(found.length_residual < 1e-12);
            for (t, s) in path.history().tensions.iter().zip(path.slack()) {
                assert!(*t >= 0.0 && *s > -1e-12 && t * s == 0.0);
            }
        }
        slack += cold.slack().iter().filter(|s| **s > 0.0).count();
    }
    println!(
        "failed {failed}, steps {} most {most}, slack {slack}",
        steps as f64 / 1000.0
    );
    assert_eq!(failed, 0);
}

fn with_friction(robot: &Robot, friction: f64) -> PathSolver {
    let line = Line {
        friction,
        ..Line::default()
    };
    PathSolver::new(
        robot,
        Model::default(),
        1,
        &vec![line; robot.tendon_count()],
    )
    .unwrap()
}

/// Angles of a tendon at its holes, from the poses of the disks alone.
fn bends(path: &PathSolver, i: usize) -> Vec<f64> {
    let tendon = &path.robot().spec().tendons[i];
    let [x, y] = tendon.holes[0];
    let mut hole = Vec3([x, y, 0.0]);
    let mut before = Vec3([0.0, 0.0, 1.0]);
    (0..=tendon.end_disk)
        .map(|k| {
            let disk = path.solver().disk(k).unwrap();
            let next = disk.position + disk.rotation * Vec3([x, y, 0.0]);
            let span = (next - hole) * (1.0 / (next - hole).norm());
            let angle = before.cross(span).norm().atan2(before.dot(span));
            (hole, before) = (next, span);
            angle
        })
        .collect()
}

/// Where every hole slips, tensions follow the capstan equation over the accumulated bends.
#[test]
fn capstan_equation_in_full_slip() {
    let robot = study_robot(9, 0.0);
    for friction in [0.01, 0.1, 0.3, 0.8] {
        for commands in [
            tensions(&[40.0, 0.0, 0.0]),
            displacements(&[0.02, -0.05, -0.05]),
        ] {
            let mut path = with_friction(&robot, friction);
            let found = step(&mut path, &commands, &by_tensions(&[0.0; 3]));
            assert_eq!(found.status, Status::Converged, "{friction} {found:?}");
            println!("{friction} {} steps", found.iterations);
            let mut expected = path.history().tensions[0];
            for (k, angle) in bends(&path, 0).into_iter().enumerate() {
                assert!(angle > 0.01);
                expected *= (-friction * angle).exp();
                let off = path.span_tension(k, 0) / expected - 1.0;
                assert!(off.abs() < 1e-12, "{friction} {k}: {off:e}");
            }
        }
    }
}

/// Iterations of a solution: friction, which is not in the tangent, must not increase them much.
#[test]
fn friction_takes_few_steps() {
    for (robot, given) in [
        (study_robot(9, 0.0), vec![40.0, 10.0, 5.0]),
        (rao_robot(), vec![3.0, 1.0, 0.5, 2.0, 1.0, 1.5]),
    ] {
        let load = Load {
            gravity: [0.0, 0.0, -9.81],
            ..by_tensions(&given)
        };
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
        let taken_in = shortened(&solver);
        for commands in [tensions(&given), displacements(&taken_in)] {
            let found = step(&mut with_friction(&robot, 0.1), &commands, &load);
            println!("{} steps", found.iterations);
            assert_eq!(found.status, Status::Converged);
            assert!(found.iterations <= 12, "{found:?}");
        }
    }
}

/// Dissipation by friction in one step, and work of the motors (J): with mean values over the step.
fn work(path: &PathSolver, before: &History, displacements_before: &[f64]) -> (f64, f64) {
    let (n, m) = (path.robot().module_count(), path.robot().tendon_count());
    let now = path.history();
    let (mut given, mut taken) = (0.0, 0.0);
    for i in 0..m {
        let carried = |history: &History| {
            let mut tension = history.tensions[i];
            let mut all = vec![tension];
            for k in 0..=path.robot().spec().tendons[i].end_disk {
                tension *= (-history.drops[k * m + i]).exp();
                all.push(tension);
            }
            all
        };
        let (a, b) = (carried(before), carried(now));
        let mean = |k: usize| 0.5 * (a[k] + b[k]);
        given += mean(0) * (path.displacement(i) - displacements_before[i]);
        let mut slipped = 0.0;
        for k in (0..n.min(a.len() - 1)).rev() {
            slipped -= now.spans[k * m + i] - before.spans[k * m + i];
            taken += (mean(k) - mean(k + 1)) * slipped;
        }
    }
    (given, taken)
}

/// Loading, unloading and loading again with friction at the holes: a closed hysteresis loop, in
/// which the work of the motors equals the dissipation, and which shorter steps hardly change.
#[test]
fn hysteresis() {
    let robot = study_robot(9, 0.0);
    let load = Load {
        gravity: [0.0, 3.0, -5.0],
        ..by_tensions(&[0.0; 3])
    };
    let mut ends = vec![];
    for (count, stretchy) in [(20, false), (200, false), (2000, false), (2000, true)] {
        let lines = vec![
            Line {
                friction: 0.1,
                stiffness: if stretchy { 2e4 } else { f64::INFINITY },
                free_length: 0.3,
                ..Line::default()
            };
            3
        ];
        let mut path = PathSolver::new(&robot, Model::default(), 1, &lines).unwrap();
        let at = |i: usize| {
            let phase = std::f64::consts::TAU * i as f64 / count as f64;
            tensions(&[25.0 - 15.0 * phase.cos(), 10.0, 5.0 + 3.0 * phase.sin()])
        };
        let mut steps = 0;
        let (mut given, mut taken, mut least) = (0.0, 0.0, f64::INFINITY);
        let (mut half, mut closed) = (vec![], vec![]);
        for i in 0..=2 * count {
            let before = path.history().clone();
            let displacements_before: Vec<_> = (0..3).map(|i| path.displacement(i)).collect();
            let found = step(&mut path, &at(i), &load);
            assert_eq!(found.status, Status::Converged, "{count} {i} {found:?}");
            steps += found.iterations;
            let tip = path.solver().tip().unwrap().position;
            if i > count {
                let (g, t) = work(&path, &before, &displacements_before);
                given += g;
                taken += t;
                least = f64::min(least, t);
            }
            if i == count + count / 2 {
                half.push(tip);
            }
            if i % count == 0 && i > 0 {
                closed.push(tip);
            }
        }
        println!(
            "{count} {stretchy}: {given:e} {taken:e} {} steps",
            steps as f64 / count as f64 / 2.0
        );
        let off = (closed[0] - closed[1]).norm();
        assert!(off < 1e-6, "{count}: {off:e}");
        assert!(given > 1e-3 && least > -1e-9, "{given:e} {least:e}");
        if count == 2000 {
            assert!(
                (given - taken).abs() < 1e-6 * given,
                "{:e}",
                given / taken - 1.0
            );
        }
        ends.push((half[0], given));
    }
    // the error decreases with the step
    let off = |i: usize| (ends[i].0 - ends[2].0).norm();
    println!("{:e} {:e}", off(0), off(1));
    assert!(
        off(0) < 1e-3 && off(1) < 0.2 * off(0) + 1e-12,
        "{:e} {:e}",
        off(0),
        off(1)
    );
}

/// Half a cycle in 10 and in 1000 steps ends in the same state, to the order of the step.
#[test]
fn coarse_and_fine_paths() {
    let robot = study_robot(9, 0.0);
    for by_displacement in [false, true] {
        let mut ends: Vec<(Vec3, f64)> = vec![];
        for count in [10, 100, 1000] {
            let mut path = with_friction(&robot, 0.2);
            for i in 0..=count {
                let share = i as f64 / count as f64;
                // loading, and most of unloading
                let up = (2.4 * share).sin();
                let commands = if by_displacement {
                    displacements(&[0.025 * up, -0.015 * up, -0.015 * up])
                } else {
                    tensions(&[40.0 * up, 2.0, 2.0])
                };
                let found = step(&mut path, &commands, &by_tensions(&[0.0; 3]));
                assert_eq!(found.status, Status::Converged, "{count} {i} {found:?}");
            }
            let tip = path.solver().tip().unwrap().position;
            ends.push((tip, path.history().tensions[0]));
        }
        let off = |i: usize| (ends[i].0 - ends[2].0).norm();
        println!("{by_displacement} {:e} {:e} {:?}", off(0), off(1), ends);
        assert!(off(0) < 5e-3 && off(1) < 5e-4);
    }
}

/// Random paths with friction: every step has a solution that obeys Coulomb's law.
#[test]
fn random_paths_with_friction() {
    let mut draw = Draw(7);
    let (mut steps, mut count, mut failed) = (0, 0, 0);
    for (robot, most) in [(study_robot(9, 0.003), 40.0), (rao_robot(), 4.0)] {
        let (n, m) = (robot.module_count(), robot.tendon_count());
        for round in 0..40 {
            let lines: Vec<_> = (0..m)
                .map(|_| Line {
                    friction: draw.within(0.0, 0.4),
                    stiffness: if round % 2 == 0 { 1e4 } else { f64::INFINITY },
                    free_length: draw.within(0.0, 0.5),
                    ..Line::default()
                })
                .collect();
            let mut path = PathSolver::new(&robot, Model::default(), 1, &lines).unwrap();
            let none = vec![0.0; m];
            let load = Load {
                gravity: [draw.within(-3.0, 3.0), 0.0, draw.within(-3.0, 3.0)],
                ..by_tensions(&none)
            };
            for _ in 0..15 {
                let given: Vec<_> = (0..m).map(|_| draw.within(0.0, most)).collect();
                let before = path.history().clone();
                let found = step(&mut path, &tensions(&given), &load);
                count += 1;
                if found.status != Status::Converged {
                    failed += 1;
                    eprintln!("FAILED {round} {found:?}");
                    continue;
                }
                steps += found.iterations;
                if found.increments > 1 {
                    continue;
                }
                let now = path.history();
                for i in 0..m {
                    let angles = bends(&path, i);
                    let mut slipped = 0.0;
                    for k in (0..angles.len()).rev() {
                        let at = k * m + i;
                        slipped -= now.spans[at] - before.spans[at];
                        let bound = lines[i].friction * angles[k];
                        let drop = now.drops[at];
                        assert!(drop.abs() <= bound * (1.0 + 1e-9) + 1e-12);
                        if slipped.abs() > 1e-9 {
                            assert!((drop - bound * slipped.signum()).abs() < 1e-9, "{k} of {n}");
                        }
                    }
                }
            }
        }
    }
    println!(
        "{failed} of {count} failed, {} steps each",
        steps as f64 / count as f64
    );
    assert_eq!(failed, 0);
}

/// Elastic tendons converge to the inextensible limit to first order in their compliance.
#[test]
fn elastic_tendons_converge_to_inextensible_ones() {
    let robot = rao_robot();
    let given = [0.004, -0.003, -0.003, 0.009, -0.006, -0.007];
    let none = [0.0; 6];
    for model in [Model::default(), kirchhoff()] {
        let mut limit = path_solver(&robot, model);
        assert_eq!(
            step(&mut limit, &displacements(&given), &by_tensions(&none)).status,
            Status::Converged
        );
        let end = limit.solver().tip().unwrap().position;
        let mut errors = vec![];
        for stiffness in [1e4, 1e5, 1e6] {
            let lines = vec![
                Line {
                    stiffness,
                    free_length: 0.2,
                    compliance: 1.0 / stiffness,
                    ..Line::default()
                };
                6
            ];
            let mut soft = PathSolver::new(&robot, model, 1, &lines).unwrap();
            let found = step(&mut soft, &displacements(&given), &by_tensions(&none));
            assert_eq!(found.status, Status::Converged, "{found:?}");
            errors.push((soft.solver().tip().unwrap().position - end).norm());
            // Hooke's law for the elongation
            for i in 0..6 {
                let t = soft.history().tensions[i];
                let rest = robot.spec().disks[robot.spec().tendons[i].end_disk].station - given[i];
                let longer = soft.solver().tendon_length(i).unwrap() - rest;
                let straight = rest + given[i];
                let hooke = t * ((straight + 0.2) / stiffness + 1.0 / stiffness);
                assert!(
                    t == 0.0 || (longer - hooke).abs() < 1e-13,
                    "{longer:e} {hooke:e}"
                );
            }
        }
        println!("{errors:?}");
        for pair in errors.windows(2) {
            assert!((pair[0] / pair[1] - 10.0).abs() < 0.5, "{errors:?}");
        }
    }
}

/// An equilibrium under tension control is also one under control by its displacements.
#[test]
fn tension_and_displacement_control_agree() {
    let robot = rao_robot();
    let mut draw = Draw(11);
    for _ in 0..30 {
        let mut path = with_friction(&robot, 0.1);
        let given: Vec<_> = (0..6).map(|_| draw.within(0.5, 3.0)).collect();
        let load = by_tensions(&[0.0; 6]);
        step(&mut path, &tensions(&given), &load);
        let held: Vec<_> = (0..6).map(|i| path.displacement(i)).collect();
        let tip = path.solver().tip().unwrap().position;
        let found = step(&mut path, &displacements(&held), &load);
        assert_eq!(found.status, Status::Converged, "{given:?} {found:?}");
        let moved = (path.solver().tip().unwrap().position - tip).norm();
        assert!(moved < 1e-9, "{moved:e}");
        for (t, now) in given.iter().zip(&path.history().tensions) {
            assert!((t - now).abs() < 1e-6, "{given:?} {now}");
        }
    }
}

/// A column that its tendons would buckle is unstable under every kind of actuation.
#[test]
fn buckled_columns_are_unstable() {
    let robot = study_robot(9, 0.0);
    for mut path in [
        path_solver(&robot, Model::default()),
        with_friction(&robot, 0.3),
    ] {
        let found = step(
            &mut path,
            &displacements(&[0.002; 3]),
            &by_tensions(&[0.0; 3]),
        );
        assert_eq!(found.status, Status::Converged, "{found:?}");
        path.reset();
        let found = step(
            &mut path,
            &displacements(&[0.003; 3]),
            &by_tensions(&[0.0; 3]),
        );
        assert_ne!(found.status, Status::Converged, "{found:?}");
        assert!(path.solver().tip().is_none());
    }
}

/// The tensions of four tendons at one disk are not unique: the smallest are returned.
#[test]
fn least_tensions_of_four_tendons() {
    let mut spec = study_robot(9, 0.0).spec().clone();
    let angles = [0.0, 90.0, 180.0, 270.0];
    spec.tendons = angles.map(|a| Tendon::parallel(hole(0.029, a), 8)).to_vec();
    let robot = Robot::new(spec).unwrap();
    let mut path = path_solver(&robot, Model::default());
    let none = by_tensions(&[0.0; 4]);
    step(&mut path, &tensions(&[5.0, 4.0, 3.0, 2.0]), &none);
    let held: Vec<_> = (0..4).map(|i| path.displacement(i)).collect();
    let tip = path.solver().tip().unwrap().position;
    path.reset();
    let found = step(&mut path, &displacements(&held), &none);
    assert_eq!(found.status, Status::Converged);
    assert!(found.undetermined);
    let t = &path.history().tensions;
    let along = t[0] - t[1] + t[2] - t[3];
    assert!(
        along.abs() < 1e-2,
        "the part that moves nothing is least: {t:?}"
    );
    assert!((path.solver().tip().unwrap().position - tip).norm() < 1e-9);
}

/// Rows in one call equal single steps: in sequence, and each from the present state of the path.
#[test]
fn rows_match_single_steps() {
    let robot = study_robot(9, 0.0);
    let (rows, m) = (40, robot.tendon_count());
    let mut draw = Draw(17);
    let values: Vec<f64> = (0..rows)
        .flat_map(|i| [1e-4 * i as f64, 5.0, draw.within(0.0, 3.0)])
        .collect();
    let by_displacement = [true, false, false].repeat(rows);
    let steps = steps(
        rows,
        &values,
        &by_displacement,
        &[0.0, 0.0, -9.81],
        &[0.1, 0.0, 0.0],
    );
    let home = with_friction(&robot, 0.1);
    let path = follow(&mut home.clone(), &steps, true).unwrap();
    let each = solve_each(&mut home.clone(), &steps, 2, false).unwrap();
    assert!(each.poses.disk_position.is_empty());
    let mut in_order = home.clone();
    for i in 0..rows {
        let load = steps.loads.row(i, m);
        let given = commands(&by_displacement[i * m..][..m], load.tensions);
        let mut fresh = home.clone();
        for (solver, found) in [(&mut in_order, &path), (&mut fresh, &each)] {
            assert_eq!(step(solver, &given, &load).status, Status::Converged);
            assert_eq!(found.poses.outcomes[i].status, Status::Converged);
            let tip = solver.solver().tip().unwrap().position;
            assert_eq!(found.poses.tip_position[3 * i..][..3], tip.0);
            assert_eq!(found.tensions[i * m..][..m], solver.history().tensions);
            assert_eq!(found.displacements[i * m], solver.displacement(0));
            let spans = solver.span_tensions();
            assert_eq!(found.span_tensions[i * spans.len()..][..spans.len()], spans);
        }
    }
}

/// Random displacements of a robot with segments of three tendons (m), row by row, with slack; every
/// fourth row has the first tendon under tension control (N).
fn random_rows(robot: &Robot, rows: usize, draw: &mut Draw) -> (Vec<f64>, Vec<bool>) {
    let tendons = &robot.spec().tendons;
    let (mut values, mut by_displacement) = (vec![], vec![]);
    for row in 0..rows {
        let mut before = [0.0; 2];
        for three in tendons.chunks(3) {
            let bend = [0, 1].map(|q| before[q] + draw.within(-1.0, 1.0));
            for tendon in three {
                let slackened = draw.within(0.0, 0.002);
                let [x, y] = tendon.holes[0];
                values.push(x * bend[0] + y * bend[1] - slackened);
                by_displacement.push(true);
            }
            before = bend;
        }
        if row % 4 == 3 {
            let at = row * tendons.len();
            values[at] = draw.within(0.0, 2.0);
            by_displacement[at] = false;
        }
    }
    (values, by_displacement)
}

/// Compares row `i` of solutions of many rows with that of a single step.
fn assert_same_step(found: &PathSolutions, i: usize, path: &PathSolver, alone: &PathOutcome) {
    let m = path.robot().tendon_count();
    assert_eq!(found.poses.outcomes[i].status, alone.status, "row {i}");
    if alone.status != Status::Converged {
        return;
    }
    assert_eq!(found.poses.outcomes[i].stable, alone.stable, "row {i}");
    let length = path.robot().length();
    let tip = path.solver().tip().unwrap().position;
    let apart = (Vec3([0, 1, 2].map(|q| found.poses.tip_position[3 * i + q])) - tip).norm();
    assert!(apart < 1e-10 * length, "row {i}: tips {apart:e} m apart");
    let now = path.history();
    let tautest = now.tensions.iter().fold(0.0, |a: f64, t| a.max(*t));
    for j in 0..m {
        let close = |name: &str, a: f64, b: f64, most: f64| {
            assert!(
                (a - b).abs() <= most,
                "row {i}: {name} of {j} is {a}, alone {b}"
            );
        };
        let at = i * m + j;
        close(
            "tension",
            found.tensions[at],
            now.tensions[j],
            1e-7 * tautest,
        );
        close("slack", found.slack[at], path.slack()[j], 1e-10 * length);
        let displacement = found.displacements[at];
        close(
            "displacement",
            displacement,
            path.displacement(j),
            1e-10 * length,
        );
    }
    let spans = path.span_tensions();
    for (a, b) in found.span_tensions[i * spans.len()..].iter().zip(&spans) {
        assert!(
            (a - b).abs() <= 1e-7 * tautest,
            "row {i}: span tensions {a} and {b}"
        );
    }
    let (error, other) = (found.poses.outcomes[i].error.unwrap(), alone.error.unwrap());
    for (a, b) in [(error.tip, other.tip), (error.tension, other.tension)] {
        assert!(
            (a - b).abs() <= 1e-2 * b.abs(),
            "row {i}: estimates {a:e} and {b:e}"
        );
    }
}

/// Displacements side by side give what single steps give, also where tendons become slack, and
/// where a step is left to the path's own solver.
#[test]
fn displacements_side_by_side() {
    let elastic = Line {
        stiffness: 3e4,
        compliance: 1e-5,
        pretension: 0.5,
        ..Line::default()
    };
    let mut slack = 0;
    for (robot, rows) in [(study_robot(9, 0.003), 200), (rao_robot(), 100)] {
        let m = robot.tendon_count();
        let mut draw = Draw(41);
        let (values, by_displacement) = random_rows(&robot, rows, &mut draw);
        let tip_force: Vec<f64> = (0..3 * rows).map(|_| draw.within(-0.02, 0.02)).collect();
        let steps = steps(
            rows,
            &values,
            &by_displacement,
            &[0.0, 0.0, -9.81],
            &tip_force,
        );
        for line in [Line::default(), elastic] {
            let home = PathSolver::new(&robot, Model::default(), None, &vec![line; m]).unwrap();
            let each = solve_each(&mut home.clone(), &steps, 2, false).unwrap();
            for i in 0..rows {
                let load = steps.loads.row(i, m);
                let given = commands(&by_displacement[i * m..][..m], load.tensions);
                let mut alone = home.clone();
                let found = step(&mut alone, &given, &load);
                assert_same_step(&each, i, &alone, &found);
                slack += alone.slack().iter().filter(|s| **s > 0.0).count();
            }
        }
    }
    assert!(slack > 100, "only {slack} tendons were slack");
}

/// Equal displacements of opposing tendons compress a robot that hardly moves: the tangent changes
/// by the tensions alone, and beyond the critical load no step is stable.
#[test]
fn opposing_displacements_side_by_side_are_unstable_beyond_buckling() {
    let robot = study_robot(9, 0.0);
    let line = Line {
        stiffness: 1e4,
        pretension: 1.0,
        ..Line::default()
    };
    let home = PathSolver::new(&robot, Model::default(), 1, &[line; 3]).unwrap();
    let rows = 60;
    let values: Vec<f64> = (0..3 * rows).map(|at| 2e-3 * (at / 3) as f64).collect();
    let steps = steps(rows, &values, &[true; 3 * 60], &[0.0; 3], &[0.0; 3]);
    let each = solve_each(&mut home.clone(), &steps, 1, false).unwrap();
    let mut unstable = 0;
    for i in 0..rows {
        let load = steps.loads.row(i, 3);
        let mut alone = home.clone();
        let found = step(&mut alone, &displacements(load.tensions), &load);
        assert_eq!(each.poses.outcomes[i].status, found.status, "row {i}");
        unstable += usize::from(found.status != Status::Converged);
    }
    assert!((10..rows).contains(&unstable), "{unstable} unstable");
}

/// Rows of tendons that end at different disks do not depend on the rows solved before them.
#[test]
fn rows_side_by_side_do_not_depend_on_those_before() {
    let robot = rao_robot();
    let home = path_solver(&robot, Model::default());
    let rows = 160;
    let by_displacement: Vec<bool> = (0..6 * rows)
        .map(|at| at % 6 == if at / 6 / 16 % 2 == 0 { 0 } else { 3 })
        .collect();
    let mut draw = Draw(8);
    let values: Vec<f64> = by_displacement
        .iter()
        .map(|by_displacement| match by_displacement {
            true => draw.within(0.0, 0.008),
            false => draw.within(0.0, 0.5),
        })
        .collect();
    let steps = steps(rows, &values, &by_displacement, &[0.0; 3], &[0.0; 3]);
    let one = solve_each(&mut home.clone(), &steps, 1, false).unwrap();
    for from in (0..rows).step_by(16) {
        let part = Steps {
            durations: &[],
            guesses: None,
            loads: Loads {
                count: 16,
                tensions: &values[6 * from..][..96],
                ..steps.loads
            },
            by_displacement: &by_displacement[6 * from..][..96],
        };
        let alone = solve_each(&mut home.clone(), &part, 1, false).unwrap();
        let whole = &one.poses.tip_position[3 * from..][..48];
        assert_eq!(whole, alone.poses.tip_position, "rows from {from}");
        let outcomes = one.poses.outcomes[from..].iter().zip(&alone.poses.outcomes);
        for (a, b) in outcomes {
            assert_eq!((a.iterations, a.error), (b.iterations, b.error));
        }
    }
}

/// Every row is checked against its own robot.
#[test]
fn displacements_beyond_the_length_of_a_shorter_robot() {
    let long = study_robot(9, 0.0);
    let mut spec = long.spec().clone();
    for disk in &mut spec.disks {
        disk.station *= 0.3;
    }
    let short = Robot::new(spec).unwrap();
    let values = [0.01, 0.0, 0.0, 0.25, 0.0, 0.0].repeat(2);
    let steps = steps(4, &values, &[true; 12], &[0.0; 3], &[0.0; 3]);
    for (robots, place) in [
        ([long.clone(), short.clone()], "robot 1, load 1"),
        ([short, long], "robot 0, load 1"),
    ] {
        let designs = Designs {
            robots: &robots,
            lines: &[Line::default(); 6],
        };
        let refused = follow_designs(&designs, &RodModel::default(), &steps, 1);
        let message = refused.unwrap_err().to_string();
        assert!(message.starts_with(place), "{message}");
    }
}

/// Paths of several robots in one call are those of each robot alone, with and without friction.
#[test]
fn paths_of_several_robots() {
    let (each, mut draw) = (12, Draw(5));
    let robots: Vec<Robot> = (0..11).map(|i| study_robot(9, 2e-4 * i as f64)).collect();
    let m = robots[0].tendon_count();
    let (values, by_displacement) = random_rows(&robots[0], each * robots.len(), &mut draw);
    let steps = steps(
        each * robots.len(),
        &values,
        &by_displacement,
        &[0.0, 3.0, -9.81],
        &[0.01, 0.0, 0.0],
    );
    for with_friction in [0, 3, robots.len()] {
        let lines: Vec<Line> = (0..robots.len() * m)
            .map(|at| Line {
                friction: if at / m < with_friction { 0.1 } else { 0.0 },
                stiffness: 1e4 + 1e3 * (at / m) as f64,
                ..Line::default()
            })
            .collect();
        let designs = Designs {
            robots: &robots,
            lines: &lines,
        };
        let model = RodModel::default();
        let found = follow_designs(&designs, &model, &steps, 2).unwrap();
        let on_one_core = follow_designs(&designs, &model, &steps, 1).unwrap();
        assert_eq!(found.tensions, on_one_core.tensions);
        for (r, robot) in robots.iter().enumerate() {
            let own = &lines[r * m..][..m];
            let mut path = PathSolver::new(robot, model.model, None, own).unwrap();
            for i in r * each..(r + 1) * each {
                let load = steps.loads.row(i, m);
                let given = commands(&by_displacement[i * m..][..m], load.tensions);
                let alone = step(&mut path, &given, &load);
                assert_same_step(&found, i, &path, &alone);
                if alone.status != Status::Converged {
                    let rest = &found.poses.outcomes[i..(r + 1) * each];
                    assert!(rest.iter().all(|outcome| outcome.status == alone.status));
                    assert!(found.poses.tip_position[3 * i..3 * (r + 1) * each]
                        .iter()
                        .all(|x| x.is_nan()));
                    break;
                }
            }
        }
    }
}

/// Few disks: the elements are chosen on the way, and the path is then that of these elements from
/// the home pose on, because spans that stick keep no error of the coarser ones.
#[test]
fn refined_paths_start_from_the_home_pose_of_their_elements() {
    let robot = study_robot(3, 0.0);
    let lines = vec![
        Line {
            friction: 0.2,
            pretension: 5.0,
            ..Line::default()
        };
        3
    ];
    let given = displacements(&[0.02, -0.012, -0.013]);
    let load = Load {
        gravity: [0.0, 2.0, -9.0],
        ..by_tensions(&[0.0; 3])
    };
    let mut path = PathSolver::new(&robot, Model::default(), None, &lines).unwrap();
    step(&mut path, &given, &load);
    let elements = path.solver().elements();
    assert!(elements > 1);
    let mut same = PathSolver::new(&robot, Model::default(), elements, &lines).unwrap();
    step(&mut same, &given, &load);
    let [a, b] = [&path, &same].map(|path| path.solver().tip().unwrap().position);
    assert!((a - b).norm() < 1e-12 * robot.length(), "{a:?} {b:?}");
}

/// Stated errors of tip and tensions along paths with friction, against eight elements: what a path
/// remembers has errors too.
#[test]
fn stated_errors_of_paths_cover_those_that_the_path_carries() {
    let mut draw = Draw(46);
    let (mut count, mut covered, mut close) = (0, 0, 0);
    for round in 0..5 {
        let robot = study_robot(3 + round % 4, 0.0);
        let lines: Vec<_> = (0..3)
            .map(|_| Line {
                friction: draw.within(0.05, 0.4),
                stiffness: if round % 2 == 0 { 1e4 } else { f64::INFINITY },
                pretension: 3.0,
                ..Line::default()
            })
            .collect();
        let build = |elements| PathSolver::new(&robot, Model::default(), elements, &lines).unwrap();
        let (mut path, mut fine) = (build(None), build(Some(8)));
        let none = [0.0; 3];
        let load = Load {
            gravity: [0.0, draw.within(-3.0, 3.0), -9.0],
            ..by_tensions(&none)
        };
        for _ in 0..20 {
            let bend = [draw.within(-0.7, 0.7), draw.within(-0.7, 0.7)];
            let by_bend = |i: usize| {
                let [x, y] = robot.spec().tendons[i].holes[0];
                x * bend[0] + y * bend[1] + 1e-4
            };
            let given = displacements(&[0, 1, 2].map(by_bend));
            let (found, best) = (
                step(&mut path, &given, &load),
                step(&mut fine, &given, &load),
            );
            assert_eq!([found.status, best.status], [Status::Converged; 2]);
            let [a, b] = [&path, &fine].map(|path| path.solver().tip().unwrap().position);
            let stated = found.error.unwrap();
            let of_tensions = (0..3)
                .map(|i| (path.history().tensions[i] - fine.history().tensions[i]).abs())
                .fold(0.0, f64::max);
            for (stated, error, least) in [
                (stated.tip, (a - b).norm(), 1e-9 * robot.length()),
                (stated.tension, of_tensions, 1e-6),
            ] {
                if error > least {
                    count += 1;
                    covered += usize::from(stated >= error);
                    close += usize::from(stated <= 30.0 * error);
                }
            }
        }
    }
    println!("{covered} of {count} covered, {close} within 30 times");
    assert!(covered * 100 >= count * 99 && close * 10 >= count * 9);
}

/// Many holes that change between stick and slip at displacements without an equilibrium: the step
/// ends at its bound of work, which lets a step that converges be.
#[test]
fn work_of_a_step_is_bounded() {
    let robot = study_robot(100, 0.0);
    let mut path = with_friction(&robot, 0.5);
    let load = by_tensions(&[0.0; 3]);
    let outcome = step(&mut path, &displacements(&[0.08, 0.08, -0.08]), &load);
    assert_eq!(outcome.status, Status::MaxIterations);
    // 407 by the limit of iterations alone
    assert!(outcome.iterations < 300, "{}", outcome.iterations);
    let outcome = step(&mut path, &displacements(&[0.02, -0.01, -0.01]), &load);
    assert_eq!(outcome.status, Status::Converged);
}
