//! Loads at points fixed to disks, followers, and forces per length: closed forms and critical loads.

mod common;

use bowstring_core::dynamics::integrator::Simulator;
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, PointLoad};
use bowstring_core::model::robot::{Robot, Section};
use bowstring_core::statics::solver::Solver;
use common::{fixed_steps, kirchhoff, rod, solved, study_robot};
use std::f64::consts::PI;

/// A straight beam of length 1 and bending stiffness 1.
fn beam(modules: usize, torsion: f64, mass_per_length: f64) -> Robot {
    let section = Section {
        bending: [1.0; 2],
        principal_angle: 0.0,
        torsion,
        axial: 1e6,
        shear: 1e6,
        mass_per_length,
        rotary_inertia: 0.0,
        rest_curvature: [0.0; 3],
    };
    rod(section.into(), 1.0, modules)
}

/// The load of point loads alone.
fn of(point_loads: &[PointLoad]) -> Load<'_> {
    Load {
        point_loads,
        ..Load::default()
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
            ..PointLoad::default()
        };
        solved(&mut solver, &of(&[load]));
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
            ..PointLoad::default()
        };
        (solver.solve(&of(&[load])).unwrap(), solver.tip())
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
            ..PointLoad::default()
        };
        let outcome = solver.solve(&of(&[on(1.0), on(-1.0)])).unwrap();
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
    let mass = robot.spec().backbone[0].sections()[0].mass_per_length;
    let lines = [gravity.map(|g| g * mass); 9];
    for elements in [1, 2] {
        let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
        let weight = Load {
            tensions: &[10.0, 0.0, 4.0],
            gravity,
            ..Load::default()
        };
        let by_lines = Load {
            gravity: [0.0; 3],
            line_forces: &lines,
            ..weight
        };
        let [(tip, a), (other, b)] = [weight, by_lines].map(|load| {
            let mut outcome = solved(&mut solver, &load);
            solver.estimate_error(&mut outcome);
            (solver.tip().unwrap().position, outcome.error.unwrap().tip)
        });
        // from different starts, to the tolerance of the residual
        assert!((tip - other).norm() < 1e-10);
        assert!((a - b).abs() < 1e-3 * a + 1e-15, "{a:e} {b:e}");
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
            ..PointLoad::default()
        };
        let mut settings = fixed_steps(2e-3, 1.0);
        settings.damping.material = 1e-4;
        let mut moving = Simulator::new(&robot, kirchhoff(), 1, settings).unwrap();
        let point_loads = [load];
        let still = of(&point_loads);
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
