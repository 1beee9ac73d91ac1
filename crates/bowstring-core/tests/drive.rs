//! Robots driven by pulls: lengths, slack, stretch and friction.

mod common;

use bowstring_core::drive::{Command, Drive, DriveOutcome, Line};
use bowstring_core::load::{Load, Model, Theory};
use bowstring_core::robot::Robot;
use bowstring_core::statics::{Solver, Status};
use common::{pull, rao_robot, study_robot, Draw};

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

fn stiff(robot: &Robot) -> Vec<Line> {
    vec![Line::default(); robot.tendon_count()]
}

fn drive(robot: &Robot, model: Model) -> Drive {
    Drive::new(robot, model, 1, &stiff(robot)).unwrap()
}

fn pulls(values: &[f64]) -> Vec<Command> {
    values.iter().map(|p| Command::Pull(*p)).collect()
}

fn tensions(values: &[f64]) -> Vec<Command> {
    values.iter().map(|t| Command::Tension(*t)).collect()
}

fn step(drive: &mut Drive, commands: &[Command], load: &Load) -> DriveOutcome {
    drive.step(commands, load).unwrap()
}

/// Lengths of a solve by tensions, fed back as pulls, return the tensions.
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
        let mut drive = drive(&robot, Model::default());
        let mut worst: f64 = 0.0;
        let mut steps = 0;
        for _ in 0..200 {
            let asked: Vec<_> = (0..m).map(|_| draw.within(1.0, most)).collect();
            let load = Load {
                gravity: [0.0, 1.0, -3.0],
                tip_force: [draw.within(-0.1, 0.1), 0.0, 0.1],
                ..pull(&asked)
            };
            assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
            let given: Vec<_> = (0..m)
                .map(|i| {
                    let end = robot.spec().tendons[i].end_disk;
                    robot.spec().disks[end].station - solver.tendon_length(i).unwrap()
                })
                .collect();
            drive.reset();
            let found = step(&mut drive, &pulls(&given), &load);
            assert_eq!(found.status, Status::Converged, "{asked:?} {found:?}");
            steps += found.iterations;
            assert_eq!(found.stable, Some(true));
            let largest = asked.iter().fold(0.0, |a: f64, t| a.max(*t));
            for (t, back) in asked.iter().zip(&drive.history().tensions) {
                worst = worst.max((t - back).abs() / largest);
            }
            let apart = drive.solver().tip().unwrap().position - solver.tip().unwrap().position;
            assert!(apart.norm() < 1e-11);
            assert!(drive.slack().iter().all(|s| *s == 0.0));
        }
        println!("worst {worst:e}, {} steps", steps as f64 / 200.0);
        assert!(worst < 1e-8, "{worst:e}");
    }
}

/// Without extension, three tendons of a straight segment may pull together as they like: the
/// least are given, and the pose is the same.
#[test]
fn least_tensions_without_extension() {
    let mut draw = Draw(2);
    for (robot, most) in [(study_robot(9, 0.0), 60.0), (rao_robot(), 4.0)] {
        let m = robot.tendon_count();
        let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
        let mut drive = drive(&robot, kirchhoff());
        let mut worst: f64 = 0.0;
        for round in 0..100 {
            let common = if round % 10 == 0 { most / 2.0 } else { 0.0 };
            let asked: Vec<_> = (0..m)
                .map(|_| {
                    if round % 10 == 0 {
                        common
                    } else {
                        draw.within(0.0, most)
                    }
                })
                .collect();
            let load = pull(&asked);
            solver.solve(&load).unwrap();
            let given: Vec<_> = (0..m)
                .map(|i| {
                    let end = robot.spec().tendons[i].end_disk;
                    robot.spec().disks[end].station - solver.tendon_length(i).unwrap()
                })
                .collect();
            drive.reset();
            let found = step(&mut drive, &pulls(&given), &load);
            assert_eq!(found.status, Status::Converged, "{asked:?} {found:?}");
            let size = |t: &[f64]| t.iter().map(|t| t * t).sum::<f64>();
            let back = &drive.history().tensions;
            assert!(
                size(back) <= size(&asked) * (1.0 + 1e-6),
                "{asked:?} {back:?}"
            );
            let apart = drive.solver().tip().unwrap().position - solver.tip().unwrap().position;
            worst = worst.max(apart.norm() / robot.length());
            assert_eq!(found.undetermined, round % 10 == 0, "{asked:?} {back:?}");
            if round % 10 == 0 {
                assert!(size(back) < 1e-6 * size(&asked), "{back:?}");
            }
        }
        println!("{worst:e}");
        assert!(worst < 1e-9, "{worst:e}");
    }
}

/// A tendon that is paid out hangs: no tension at all, and its slack is what geometry leaves.
#[test]
fn slack_is_the_surplus() {
    let robot = study_robot(9, 0.0);
    for model in [Model::default(), kirchhoff()] {
        let mut drive = drive(&robot, model);
        let none = [0.0; 3];
        let found = step(&mut drive, &pulls(&[0.02, -0.03, -0.03]), &pull(&none));
        assert_eq!(found.status, Status::Converged);
        let t = drive.history().tensions.clone();
        assert!(t[0] > 1.0 && t[1] == 0.0 && t[2] == 0.0, "{t:?}");
        for i in 1..3 {
            let surplus = 0.641 + 0.03 - drive.solver().tendon_length(i).unwrap();
            assert!((drive.slack()[i] - surplus).abs() < 1e-12 && surplus > 1e-3);
        }
        assert_eq!(drive.slack()[0], 0.0);
        // all paid out by 10 mm: straight, and all hang
        let found = step(&mut drive, &pulls(&[-0.01; 3]), &pull(&none));
        assert_eq!(found.status, Status::Converged);
        assert_eq!(drive.history().tensions, none);
        for s in drive.slack() {
            assert!((s - 0.01).abs() < 1e-12, "{s}");
        }
    }
}

/// Random pulls: tendons taken in and paid out.
#[test]
fn random_pulls() {
    let robot = rao_robot();
    let mut draw = Draw(3);
    let mut cold = drive(&robot, Model::default());
    let mut warm = drive(&robot, Model::default());
    let (mut failed, mut steps, mut most) = (0, 0, 0);
    let mut hang = 0;
    for round in 0..1000 {
        // pulls of a bend in each segment, and up to 2 mm paid out beside
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
        let found = step(&mut cold, &pulls(&given), &pull(&none));
        if found.status != Status::Converged {
            failed += 1;
            println!("{round}: {given:?} {found:?}");
            continue;
        }
        steps += found.iterations;
        most = most.max(found.iterations);
        let next = step(&mut warm, &pulls(&given), &pull(&none));
        assert_eq!(next.status, Status::Converged);
        let apart = cold.solver().tip().unwrap().position - warm.solver().tip().unwrap().position;
        assert!(apart.norm() < 1e-9, "{round}: {:e} {given:?}", apart.norm());
        for (drive, found) in [(&cold, &found), (&warm, &next)] {
            assert!(found.length_residual < 1e-12);
            for (t, s) in drive.history().tensions.iter().zip(drive.slack()) {
                assert!(*t >= 0.0 && *s > -1e-12 && t * s == 0.0);
            }
        }
        hang += cold.slack().iter().filter(|s| **s > 0.0).count();
    }
    println!(
        "failed {failed}, steps {} most {most}, slack {hang}",
        steps as f64 / 1000.0
    );
    assert_eq!(failed, 0);
}
