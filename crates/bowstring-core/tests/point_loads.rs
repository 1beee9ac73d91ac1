//! Loads at points fixed to disks, followers, and forces per length: closed forms, equivalent dead
//! loads, critical loads, and agreement of all solvers.

mod common;

use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator, Step};
use bowstring_core::math::lie;
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, PointLoad, Theory};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::solver::{Outcome, Solver, Status};
use common::{study_robot, Draw};
use std::f64::consts::PI;

const NONE: PointLoad = PointLoad {
    disk: 0,
    arc_length: None,
    point: [0.0; 3],
    force: [0.0; 3],
    moment: [0.0; 3],
    follower: false,
};

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

fn solved(solver: &mut Solver, load: &Load) -> Outcome {
    let outcome = solver.solve(load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{load:?}");
    outcome
}

/// Every point load as forces on disk centres and moments on disks, at the poses of a solution.
fn equivalent(solver: &Solver, loads: &[PointLoad]) -> [Vec<[f64; 3]>; 2] {
    let n = solver.robot().module_count();
    let (mut forces, mut moments) = (vec![Vec3::zero(); n], vec![Vec3::zero(); n]);
    for load in loads {
        let rotation = solver.disk(load.disk).unwrap().rotation;
        let given = [Vec3(load.force), Vec3(load.moment)];
        let [force, moment] = given.map(|v| if load.follower { rotation * v } else { v });
        forces[load.disk] += force;
        moments[load.disk] += (rotation * Vec3(load.point)).cross(force) + moment;
    }
    [forces, moments].map(|vectors| vectors.into_iter().map(|v| v.0).collect())
}

/// A straight beam of length 1 and bending stiffness 1 without tendon forces.
fn beam(modules: usize, torsion: f64, mass: f64) -> Robot {
    let section = Section {
        bending: [1.0; 2],
        principal_angle: 0.0,
        torsion,
        axial: 1e6,
        shear: 1e6,
        mass_per_length: mass,
        rotary_inertia: 0.0,
        rest_curvature: [0.0; 3],
    };
    let disks = (1..=modules).map(|k| Disk {
        hole_length: 0.0,
        station: k as f64 / modules as f64,
        clamped_length: 0.0,
        mass: 0.0,
        inertia: [1e-9; 2],
        segment: 0,
    });
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section.into()],
        disks: disks.collect(),
        tendons: vec![Tendon::parallel([0.01, 0.0], modules - 1)],
        gravity: [0.0; 3],
    })
    .unwrap()
}

fn drawn(draw: &mut Draw, disks: usize, size: f64, follower: bool) -> PointLoad {
    let mut vector = |size: f64| [0; 3].map(|_| draw.within(-size, size));
    let (point, force, moment) = (vector(0.05), vector(size), vector(0.1 * size));
    PointLoad {
        disk: (draw.within(0.0, disks as f64) as usize).min(disks - 1),
        arc_length: None,
        point,
        force,
        moment,
        follower,
    }
}

#[test]
fn point_loads_equal_the_dead_loads_that_they_are_in_equilibrium() {
    let robot = study_robot(9, 0.003);
    let mut draw = Draw(7);
    for trial in 0..40 {
        let loads: Vec<_> = (0..3)
            .map(|i| drawn(&mut draw, 9, 0.4, i % 2 == 0))
            .collect();
        let tensions = [0; 3].map(|_| draw.within(0.0, 30.0));
        let model = if trial % 2 == 0 {
            kirchhoff()
        } else {
            Model::default()
        };
        let mut solver = Solver::new(&robot, model, 1 + trial % 2).unwrap();
        let load = Load {
            tensions: &tensions,
            gravity: [0.0, 0.0, -9.81],
            point_loads: &loads,
            ..Load::default()
        };
        let outcome = solved(&mut solver, &load);
        assert!(outcome.iterations < 12, "{}", outcome.iterations);
        let tip = solver.tip().unwrap();
        let [disk_forces, disk_moments] = equivalent(&solver, &loads);
        let dead = Load {
            point_loads: &[],
            disk_forces: &disk_forces,
            disk_moments: &disk_moments,
            ..load
        };
        solved(&mut solver, &dead);
        let off = (solver.tip().unwrap().position - tip.position).norm();
        assert!(off < 1e-10, "{trial}: {off:e}");
    }
}

#[test]
fn derivatives_under_followers_are_those_of_differences() {
    let robot = study_robot(9, 0.003);
    let mut draw = Draw(8);
    for _ in 0..5 {
        let loads: Vec<_> = (0..3).map(|i| drawn(&mut draw, 9, 0.4, i != 1)).collect();
        let tensions = [20.0, 5.0, 8.0];
        let load = |tensions: &[f64; 3], tip_force: [f64; 3], loads: &[PointLoad]| {
            let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
            let load = Load {
                tensions,
                tip_force,
                point_loads: loads,
                ..Load::default()
            };
            solved(&mut solver, &load);
            solver
        };
        let found = load(&tensions, [0.0; 3], &loads).jacobians(false).unwrap();
        let h = 1e-4;
        let tip = |tensions: [f64; 3], force: f64| {
            let solver = load(&tensions, [force, 0.0, 0.0], &loads);
            (
                solver.tip().unwrap().position,
                solver.tendon_length(1).unwrap(),
            )
        };
        let pairs = [
            (
                &found.tensions[0],
                tip([20.0 + h, 5.0, 8.0], 0.0),
                tip([20.0 - h, 5.0, 8.0], 0.0),
            ),
            (&found.tip_force[0], tip(tensions, h), tip(tensions, -h)),
        ];
        for (derivative, up, down) in pairs {
            let moved = (up.0 - down.0) * (0.5 / h);
            assert!((moved - derivative.position).norm() < 1e-6 * moved.norm());
            let longer = (up.1 - down.1) * (0.5 / h);
            assert!((longer - derivative.lengths[1]).abs() < 1e-6 * moved.norm());
        }
    }
}

/// A follower across the tip bends a beam as its exact solution says: in the frame of the tip the
/// beam is an elastica under a dead load.
#[test]
fn a_follower_at_the_tip_makes_an_elastica_seen_from_the_tip() {
    let robot = beam(40, 1.0, 0.0);
    let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
    for force in [0.5, 2.0, 5.0] {
        let load = PointLoad {
            disk: 39,
            force: [force, 0.0, 0.0],
            follower: true,
            ..NONE
        };
        solved(
            &mut solver,
            &Load {
                tensions: &[0.0],
                point_loads: &[load],
                ..Load::default()
            },
        );
        let tip = solver.tip().unwrap();
        // angle of the tangent seen from the tip, by its distance: phi'' = -force cos(phi), phi(0) = 0,
        // phi'(0) = 0, from tip to base
        let (mut phi, mut rate, mut place) = (0.0f64, 0.0f64, [0.0f64; 2]);
        let steps = 20000;
        let h = 1.0 / f64::from(steps);
        for _ in 0..steps {
            let slope = |y: [f64; 2]| [y[1], force * y[0].cos()];
            let k1 = slope([phi, rate]);
            let k2 = slope([phi + 0.5 * h * k1[0], rate + 0.5 * h * k1[1]]);
            let middle = phi + 0.5 * h * rate + h * h / 8.0 * k2[1];
            let k3 = slope([phi + 0.5 * h * k2[0], rate + 0.5 * h * k2[1]]);
            let k4 = slope([phi + h * k3[0], rate + h * k3[1]]);
            let next = phi + h / 6.0 * (k1[0] + 2.0 * k2[0] + 2.0 * k3[0] + k4[0]);
            rate += h / 6.0 * (k1[1] + 2.0 * k2[1] + 2.0 * k3[1] + k4[1]);
            for (sum, part) in place.iter_mut().zip([f64::sin as fn(f64) -> f64, f64::cos]) {
                *sum += h / 6.0 * (part(phi) + 4.0 * part(middle) + part(next));
            }
            phi = next;
        }
        // the base is clamped: turn the shape by the angle at the base
        let [across, along] = place;
        let (s, c) = phi.sin_cos();
        let expected = [c * -across + s * along, 0.0, s * across + c * along];
        let off = (tip.position - Vec3(expected)).norm();
        assert!(
            off < 1e-6,
            "{force}: {off:e} {:?} {expected:?}",
            tip.position
        );
    }
}

/// Beck 1952: a follower along a clamped beam makes it flutter at 20.05 EI/L^2; there is no static
/// critical load.
#[test]
fn becks_column_is_stable_to_its_flutter_load() {
    let robot = beam(24, 1e3, 1.0);
    let critical = 20.0509;
    let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
    let mut stable = |share: f64| {
        let load = PointLoad {
            disk: 23,
            force: [0.0, 0.0, -share * critical],
            follower: true,
            ..NONE
        };
        let load = Load {
            tensions: &[0.0],
            point_loads: &[load],
            ..Load::default()
        };
        (solver.solve(&load).unwrap(), solver.tip())
    };
    for share in [0.2, 0.8, 0.995] {
        let (outcome, tip) = stable(share);
        assert_eq!(outcome.stable, Some(true), "{share}");
        // beyond Euler's load, pi^2/4
        assert!((tip.unwrap().position - Vec3([0.0, 0.0, 1.0])).norm() < 1e-4);
    }
    for share in [1.005, 1.2] {
        assert_ne!(stable(share).0.stable, Some(true), "{share}");
    }
}

/// A dead couple of two forces on a lever across the tip (a quasi-tangential moment) has a
/// potential; it buckles a clamped rod at pi EI/(2 L) (Ziegler 1952).
#[test]
fn a_couple_of_dead_forces_buckles_a_rod_at_zieglers_moment() {
    let robot = beam(16, 1e6, 0.0);
    let mut solver = Solver::new(&robot, kirchhoff(), 1).unwrap();
    let arm = 0.5;
    for (share, expected) in [(0.5, true), (0.999, true), (1.001, false)] {
        let force = share * 0.5 * PI / (2.0 * arm);
        let on = |side: f64| PointLoad {
            disk: 15,
            point: [side * arm, 0.0, 0.0],
            force: [0.0, side * force, 0.0],
            ..NONE
        };
        let loads = [on(1.0), on(-1.0)];
        let outcome = solver
            .solve(&Load {
                tensions: &[0.0],
                point_loads: &loads,
                ..Load::default()
            })
            .unwrap();
        let straight = solver
            .tip()
            .is_some_and(|tip| (tip.position - Vec3([0.0, 0.0, 1.0])).norm() < 1e-6);
        let stable = outcome.stable == Some(true) && straight && !outcome.left_unstable;
        assert_eq!(stable, expected, "{share}: {outcome:?}");
    }
}

#[test]
fn a_force_per_length_is_a_weight() {
    let robot = study_robot(9, 0.003);
    let mut spec = robot.spec().clone();
    spec.disks.iter_mut().for_each(|d| d.mass = 0.0);
    let robot = Robot::new(spec).unwrap();
    let gravity = [3.0, -5.0, -9.81];
    let mass = match &robot.spec().backbone[0] {
        bowstring_core::model::robot::Profile::Uniform(section) => section.mass_per_length,
        _ => unreachable!(),
    };
    let lines = [gravity.map(|g| g * mass); 9];
    for elements in [1, 2] {
        let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
        let weight = Load {
            tensions: &[10.0, 0.0, 4.0],
            gravity,
            ..Load::default()
        };
        let mut outcome = solved(&mut solver, &weight);
        let tip = solver.tip().unwrap().position;
        solver.estimate_error(&mut outcome);
        let mut by_line = solved(
            &mut solver,
            &Load {
                gravity: [0.0; 3],
                line_forces: &lines,
                ..weight
            },
        );
        solver.estimate_error(&mut by_line);
        // from different starts, to the tolerance of the residual
        assert!((solver.tip().unwrap().position - tip).norm() < 1e-10);
        let (a, b) = (outcome.error.unwrap().tip, by_line.error.unwrap().tip);
        assert!((a - b).abs() < 1e-3 * a + 1e-15, "{a:e} {b:e}");
    }
}

/// Turning gravity, loads and tendons about the axis turns the answer.
#[test]
fn answers_turn_with_the_loads() {
    let mut draw = Draw(9);
    let angle = 2.0 * PI / 3.0;
    let turn = lie::exp(Vec3([0.0, 0.0, angle]));
    let turned = |v: [f64; 3]| (turn * Vec3(v)).0;
    let robot = study_robot(9, 0.003);
    for _ in 0..10 {
        let loads: Vec<_> = (0..3)
            .map(|i| drawn(&mut draw, 9, 0.4, i % 2 == 0))
            .collect();
        let other: Vec<_> = loads
            .iter()
            .map(|load| PointLoad {
                point: turned(load.point),
                force: turned(load.force),
                moment: turned(load.moment),
                ..*load
            })
            .collect();
        let lines: Vec<_> = (0..9)
            .map(|_| [0; 3].map(|_| draw.within(-1.0, 1.0)))
            .collect();
        let other_lines: Vec<_> = lines.iter().copied().map(turned).collect();
        let gravity = [1.0, 2.0, -9.81];
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        solved(
            &mut solver,
            &Load {
                tensions: &[20.0, 6.0, 3.0],
                gravity,
                point_loads: &loads,
                line_forces: &lines,
                ..Load::default()
            },
        );
        let tip = solver.tip().unwrap().position;
        solved(
            &mut solver,
            &Load {
                tensions: &[3.0, 20.0, 6.0],
                gravity: turned(gravity),
                point_loads: &other,
                line_forces: &other_lines,
                ..Load::default()
            },
        );
        let off = (solver.tip().unwrap().position - turn * tip).norm();
        assert!(off < 1e-12, "{off:e}");
    }
}

#[test]
fn loads_beyond_the_robot_are_refused() {
    let robot = study_robot(9, 0.003);
    let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
    let mut refused = |load: PointLoad, lines: &[[f64; 3]]| {
        let load = Load {
            tensions: &[0.0; 3],
            point_loads: &[load],
            line_forces: lines,
            ..Load::default()
        };
        solver.solve(&load).unwrap_err().to_string()
    };
    let beyond = refused(PointLoad { disk: 9, ..NONE }, &[]);
    assert!(
        beyond.contains("disk 10") && beyond.contains("9 disks"),
        "{beyond}"
    );
    let nan = PointLoad {
        point: [f64::NAN, 0.0, 0.0],
        ..NONE
    };
    assert!(refused(nan, &[]).contains("point"));
    assert!(refused(NONE, &[[0.0; 3]; 4]).contains("4"));
}

fn settings(mass: f64) -> Integrator {
    Integrator {
        gravity: [0.0; 3],
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
    let mut draw = Draw(11);
    for follower in [false, true] {
        let loads: Vec<_> = (0..3).map(|_| drawn(&mut draw, 9, 0.3, follower)).collect();
        let lines: Vec<_> = (0..9)
            .map(|_| [0; 3].map(|_| draw.within(-0.4, 0.4)))
            .collect();
        let load = Load {
            tensions: &[25.0, 5.0, 10.0],
            point_loads: &loads,
            line_forces: &lines,
            ..Load::default()
        };
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        solved(&mut solver, &load);
        let exact = solver.tip().unwrap().position;
        let mut rest = Simulator::new(&robot, Model::default(), 1, settings(0.0)).unwrap();
        rest.rest(&load).unwrap();
        assert!(rest.is_ready());
        // forces per length by Simpson's rule here, by Hermite's in statics
        assert!((rest.tip() - exact).norm() < 2e-6);
        let start = rest.tip();
        rest.advance(0.1, &load).unwrap();
        assert!((rest.tip() - start).norm() < 1e-8);

        let mut moving = Simulator::new(&robot, Model::default(), 1, settings(15.0)).unwrap();
        moving
            .rest(&Load {
                tensions: &[0.0; 3],
                ..Load::default()
            })
            .unwrap();
        let energy = |s: &Simulator| s.energies().left();
        let before = energy(&moving);
        assert_eq!(moving.advance(0.2, &load).unwrap().0, None);
        let work = moving.energies().work;
        assert!((energy(&moving) - before).abs() < 1e-2 * work.abs());
        assert_eq!(moving.advance(6.0, &load).unwrap().0, None);
        let off = (moving.tip() - exact).norm();
        assert!(off < 3e-6, "{off:e}");
    }
}

/// Beck's column grows oscillations above its flutter load and loses them below, in the motion.
#[test]
fn becks_column_flutters_in_motion() {
    let robot = beam(16, 1e3, 1.0);
    let swing = |share: f64| {
        let load = PointLoad {
            disk: 15,
            force: [0.0, 0.0, -share * 20.05],
            follower: true,
            ..NONE
        };
        let undamped = Integrator {
            gravity: [0.0; 3],
            damping: Damping {
                mass: 0.0,
                material: 1e-4,
            },
            spectral_radius: 1.0,
            step: Step::Fixed(2e-3),
        };
        let mut moving = Simulator::new(&robot, kirchhoff(), 1, undamped).unwrap();
        let still = Load {
            tensions: &[0.0],
            point_loads: &[load],
            ..Load::default()
        };
        moving
            .rest(&Load {
                tip_force: [1e-4, 0.0, 0.0],
                ..still
            })
            .unwrap();
        moving.jump(&still).unwrap();
        let mut largest = [0.0f64; 2];
        for i in 0..600 {
            moving.advance(0.01, &still).unwrap();
            let off = moving.tip()[0].abs();
            let half = usize::from(i >= 300);
            largest[half] = largest[half].max(off);
        }
        largest[1] / largest[0]
    };
    let (below, above) = (swing(0.9), swing(1.1));
    assert!(below < 1.5 && above > 5.0, "{below} {above}");
}

/// Derivatives after load stepping are those of the whole load.
#[test]
fn derivatives_after_load_stepping() {
    let robot = study_robot(9, 0.003);
    let load = |tip_force: [f64; 3]| Load {
        tensions: &[20.0, 0.0, 0.0],
        tip_force,
        tip_moment: [0.0, 12.0, 0.2],
        ..Load::default()
    };
    let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
    solved(&mut solver, &load([0.0; 3]));
    let found = solver.jacobians(false).unwrap().tip_force[0].position;
    let h = 1e-4;
    let mut near = |force: f64| {
        solver.solve_next(&load([force, 0.0, 0.0])).unwrap();
        solver.tip().unwrap().position
    };
    let exact = (near(h) - near(-h)) * (0.5 / h);
    assert!(
        (found - exact).norm() < 1e-5 * exact.norm(),
        "{found:?} {exact:?}"
    );
}
