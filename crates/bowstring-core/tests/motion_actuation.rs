//! Motion with displacement control, slack tendons and friction.

mod common;

use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator, Step};
use bowstring_core::model::load::{Load, Model, Theory};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::solver::Status;
use common::{by_tensions, displacements, fixed_steps, go, rao_robot, study_robot, tensions, Draw};

fn lines(robot: &Robot, line: Line) -> Vec<Line> {
    vec![line; robot.tendon_count()]
}

/// A simulator at rest in the equilibrium of commands.
fn at_rest(
    robot: &Robot,
    model: Model,
    s: Integrator,
    line: Line,
    commands: &[Command],
    load: &Load,
) -> (Simulator, PathSolver) {
    let mut simulator = Simulator::new(robot, model, 1, s).unwrap();
    let mut path = simulator.path_solver(&lines(robot, line)).unwrap();
    let outcome = path.step(commands, load).unwrap();
    assert_eq!(outcome.status, Status::Converged);
    assert_eq!(simulator.rest_at(&path).unwrap(), None);
    (simulator, path)
}

/// Kinetic, elastic and gravitational energy, less work, plus dissipation.
fn left(simulator: &Simulator) -> f64 {
    let e = simulator.energies();
    e.kinetic + e.elastic + e.gravity - e.work + e.dissipated
}

fn elastic() -> Line {
    Line {
        stiffness: 3e4,
        free_length: 0.1,
        compliance: 1e-6,
        ..Line::default()
    }
}

/// Through inextensible frictionless lines, tensions give the same motion as without lines.
#[test]
fn inextensible_frictionless_lines_change_nothing() {
    let robot = study_robot(9, 0.0);
    let model = Model::default();
    // only with numerical damping and tensions alone may steps keep an imbalance
    let s = fixed_steps(2e-3, 1.0);
    let nothing = by_tensions(&[0.0; 3]);
    let (mut actuated, _) = at_rest(
        &robot,
        model,
        s,
        Line::default(),
        &tensions(&[0.0; 3]),
        &nothing,
    );
    let mut plain = Simulator::new(&robot, model, 1, s).unwrap();
    plain.rest(&nothing).unwrap();
    for i in 1..=50 {
        let given = [i as f64, 0.0, 5.0];
        let load = by_tensions(&given);
        go(&mut actuated, 0.01, &load);
        go(&mut plain, 0.01, &load);
        assert!((actuated.tip() - plain.tip()).norm() < 1e-11);
        let (a, b) = (actuated.energies(), plain.energies());
        for (a, b) in [
            (a.work, b.work),
            (a.elastic, b.elastic),
            (a.dissipated, b.dissipated),
        ] {
            assert!((a - b).abs() < 1e-9 * plain.energies().work, "{a:e} {b:e}");
        }
    }
}

/// Displacements over time: second order in the step, also of tensions, for elastic and
/// inextensible tendons.
#[test]
fn steps_converge_with_second_order() {
    let robot = study_robot(9, 0.0);
    for line in [Line::default(), elastic()] {
        let line = Line {
            pretension: 20.0,
            ..line
        };
        for rho in [1.0, 0.7] {
            let end = |steps: usize| {
                let h = 0.4 / steps as f64;
                let mut s = fixed_steps(h, rho);
                s.damping = Damping {
                    mass: 1.0,
                    material: 2e-3,
                };
                let (mut simulator, _) = at_rest(
                    &robot,
                    Model::default(),
                    s,
                    line,
                    &displacements(&[0.0; 3]),
                    &by_tensions(&[0.0; 3]),
                );
                for i in 1..=steps {
                    // starts and ends smoothly
                    let t = i as f64 / steps as f64;
                    let p = 0.01 * t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
                    go(&mut simulator, h, &by_tensions(&[p, -0.5 * p, -0.5 * p]));
                }
                simulator.tip()
            };
            let tips = [end(100), end(200), end(400), end(1600)];
            let errors = [0, 1, 2].map(|i| (tips[i] - tips[3]).norm());
            for i in 0..2 {
                let order = (errors[i] / errors[i + 1]).log2();
                assert!(order > 1.8, "{rho}: {errors:?}");
            }
        }
    }
}

/// Held by its tendons and released from a tip force, the robot keeps its energy without numerical
/// damping; tendons that become taut dissipate some, which is accounted for.
#[test]
fn release_keeps_its_energy() {
    let robot = study_robot(9, 0.0);
    let held = Load {
        tip_force: [0.5, 0.3, 0.0],
        ..by_tensions(&[0.0; 3])
    };
    for (name, line) in [("stiff", Line::default()), ("elastic", elastic())] {
        for (pretension, given) in [
            (10.0, [0.004, -0.002, -0.002]),
            (0.0, [0.01, -0.02, -0.02]),
            (0.0, [0.01, -0.003, -0.006]),
        ] {
            let line = Line { pretension, ..line };
            for model in [
                Model::default(),
                Model {
                    theory: Theory::Kirchhoff,
                    ..Model::default()
                },
            ] {
                let (mut simulator, _) = at_rest(
                    &robot,
                    model,
                    fixed_steps(1e-3, 1.0),
                    line,
                    &displacements(&given),
                    &held,
                );
                let start = left(&simulator);
                simulator.jump(&by_tensions(&given)).unwrap();
                let (mut off, mut lost, mut back): (f64, f64, f64) = (0.0, 0.0, 0.0);
                let mut size = simulator.energies().elastic;
                for _ in 0..200 {
                    go(&mut simulator, 0.01, &by_tensions(&given));
                    let e = simulator.energies();
                    size = size.max(e.kinetic + e.elastic);
                    off = off.max((left(&simulator) - start).abs());
                    back = back.max(lost - e.dissipated);
                    lost = e.dissipated;
                }
                assert!(off < 1e-3 * size, "{name} {given:?}: {off:e} of {size:e}");
                assert!(back < 1e-6 * size, "{name} {given:?}: {back:e} of {size:e}");
            }
        }
    }
}

/// Slow displacements follow the path of equilibria, friction included, and more closely the slower
/// they are.
#[test]
fn slow_motion_follows_the_path() {
    let robot = study_robot(9, 0.0);
    for (name, friction, by_displacement) in [
        ("displacements", 0.0, true),
        ("tensions with friction", 0.1, false),
        ("displacements with friction", 0.1, true),
    ] {
        let line = Line {
            friction,
            pretension: if by_displacement { 5.0 } else { 0.0 },
            ..elastic()
        };
        let apart = |duration: f64| {
            let mut s = fixed_steps(2e-3, 0.8);
            s.damping.mass = 20.0;
            let most = if by_displacement { 0.012 } else { 40.0 };
            let kind = if by_displacement {
                displacements
            } else {
                tensions
            };
            let (mut simulator, mut path) = at_rest(
                &robot,
                Model::default(),
                s,
                line,
                &kind(&[0.0; 3]),
                &by_tensions(&[0.0; 3]),
            );
            let mut worst: f64 = 0.0;
            for i in 1..=200 {
                let x = i as f64 / 100.0;
                let p = most * if x < 1.0 { x } else { 2.0 - x };
                let given = if by_displacement {
                    [p, -0.5 * p, -0.5 * p]
                } else {
                    [p, 0.0, 0.0]
                };
                let outcome = path.step(&kind(&given), &by_tensions(&[0.0; 3])).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                go(&mut simulator, duration / 100.0, &by_tensions(&given));
                worst = worst.max((simulator.tip() - path.solver().tip().unwrap().position).norm());
            }
            worst
        };
        let (fast, slow) = (apart(2.0), apart(16.0));
        assert!(
            slow < 0.25 * fast && slow < 4e-3,
            "{name}: {fast:e} {slow:e}"
        );
    }
}

#[test]
fn random_motions_with_cosserat_rods() {
    assert_eq!(random_motions(Theory::Cosserat), 0);
}

#[test]
fn random_motions_with_kirchhoff_rods() {
    let failed = random_motions(Theory::Kirchhoff);
    assert!(failed <= 1, "{failed}");
}

/// Number of motions that fail, of 72 with random lines, displacements, durations and friction; in
/// none is energy generated. With a Kirchhoff rod one fails: one tendon is taut, the rod whips (0.2 J
/// of kinetic energy in 20 g), and Newton's method fails however short the step. It also fails
/// without friction, but not with half the tolerance or with steps of 0.1 ms.
fn random_motions(theory: Theory) -> usize {
    let mut failed = 0;
    let first = if theory == Theory::Cosserat { 0 } else { 36 };
    for trial in (first..first + 36).chain(first + 72..first + 108) {
        let mut draw = Draw(1000 + 77 * trial as u64);
        let (robot, most) = if trial % 2 == 0 {
            (study_robot(9, 0.0), 0.015)
        } else {
            (rao_robot(), 0.01)
        };
        let m = robot.tendon_count();
        let line = Line {
            stiffness: [f64::INFINITY, 3e4, 1e3][trial % 3],
            compliance: [0.0, 1e-6][trial / 3 % 2],
            friction: [0.0, 0.1, 0.3][trial / 6 % 3],
            pretension: [0.0, 2.0][trial / 18 % 2],
            ..Line::default()
        };
        let mut s = fixed_steps(1e-3, 0.8);
        s.step = Step::Adaptive {
            tolerance: 1e-6,
            longest: 0.01,
        };
        s.gravity = [0.0, 0.0, -9.81];
        s.damping.mass = 1.0;
        let load = Load {
            gravity: s.gravity,
            ..by_tensions(&[0.0; 3])
        };
        let zero = vec![0.0; m];
        let kinds: Vec<bool> = (0..m).map(|_| draw.within(0.0, 1.0) < 0.7).collect();
        let kind = |v: &[f64]| -> Vec<Command> {
            (0..m)
                .map(|i| {
                    if kinds[i] {
                        Command::Displacement(v[i])
                    } else {
                        Command::Tension(v[i])
                    }
                })
                .collect()
        };
        let model = Model {
            theory,
            ..Model::default()
        };
        let mut simulator = Simulator::new(&robot, model, 1, s).unwrap();
        let mut path = simulator.path_solver(&lines(&robot, line)).unwrap();
        let outcome = path
            .step(
                &kind(&zero),
                &Load {
                    tensions: &zero,
                    ..load
                },
            )
            .unwrap();
        assert_eq!(outcome.status, Status::Converged);
        assert_eq!(simulator.rest_at(&path).unwrap(), None);
        let start = left(&simulator);
        let mut stop = None;
        for _ in 0..4 {
            // a transverse force with a small axial part
            let (x, y) = (draw.within(-1.0, 1.0), draw.within(-1.0, 1.0));
            let given: Vec<_> = (0..m)
                .map(|i| {
                    let [hx, hy] = robot.spec().tendons[i].holes[0];
                    let along = (hx * x + hy * y) / hx.hypot(hy);
                    if kinds[i] {
                        most * (along - 0.1)
                    } else {
                        f64::max(3.0 * along, 0.0)
                    }
                })
                .collect();
            let (found, _) = simulator
                .advance(
                    draw.within(0.05, 0.6),
                    &Load {
                        tensions: &given,
                        ..load
                    },
                )
                .unwrap();
            stop = found;
            if stop.is_some() {
                break;
            }
        }
        let e = simulator.energies();
        let size = e.kinetic + e.elastic + e.work.abs() + e.dissipated;
        let grown = left(&simulator) - start;
        assert!(grown < 2e-3 * size, "{trial}: {grown:e} of {size:e}");
        failed += usize::from(stop.is_some());
    }
    failed
}

/// Motions with an invalid start or invalid commands are rejected.
#[test]
fn wrong_motions_are_rejected() {
    let robot = study_robot(9, 0.0);
    let nothing = by_tensions(&[0.0; 3]);
    let model = Model::default();
    let s = fixed_steps(1e-3, 0.8);
    let (mut stiff, path) = at_rest(
        &robot,
        model,
        s,
        Line::default(),
        &displacements(&[0.0; 3]),
        &nothing,
    );
    let jump = stiff.jump(&by_tensions(&[0.01, 0.0, 0.0])).unwrap_err();
    assert!(jump.to_string().contains("tendon 1 jumps"), "{jump}");
    let long = stiff
        .advance(0.1, &by_tensions(&[0.7, 0.0, 0.0]))
        .unwrap_err();
    assert!(
        long.to_string().contains("less than the tendon's length"),
        "{long}"
    );
    let (mut soft, _) = at_rest(
        &robot,
        model,
        s,
        elastic(),
        &displacements(&[0.0; 3]),
        &nothing,
    );
    soft.jump(&by_tensions(&[0.001, 0.0, 0.0])).unwrap();
    go(&mut soft, 0.01, &by_tensions(&[0.001, 0.0, 0.0]));
    let wide = Line {
        hole_clearance: 1e-4,
        ..elastic()
    };
    let (mut lossy, _) = at_rest(&robot, model, s, wide, &displacements(&[0.0; 3]), &nothing);
    assert!(lossy.advance(0.0, &nothing).is_ok());
    assert!(lossy.advance(0.01, &nothing).is_err());
    let mut other = Simulator::new(&rao_robot(), model, 1, s).unwrap();
    assert!(other.rest_at(&path).is_err());
    let mut heavy = s;
    heavy.gravity = [0.0, 0.0, -9.81];
    let mut other = Simulator::new(&robot, model, 1, heavy).unwrap();
    assert!(other
        .rest_at(&path)
        .unwrap_err()
        .to_string()
        .contains("gravity"));
}
