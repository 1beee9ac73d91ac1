//! Backbones that are tapered or have two bending stiffnesses, against independent solutions.

#[path = "common/cases.rs"]
mod cases;
mod common;

use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, PointLoad, RodModel, Theory};
use bowstring_core::model::robot::{Disk, Profile, Robot, RobotSpec, Section};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::{Outcome, Solver, Status};
use cases::{Case, Draw};
use common::section;

/// Section of a rectangle; its first principal axis is along the width.
fn rectangle(width: f64, height: f64, young: f64, density: f64) -> Section {
    let round = section(height, young, 0.3, density);
    let shear = young / 2.6;
    Section {
        bending: [
            young * width * height.powi(3) / 12.0,
            young * height * width.powi(3) / 12.0,
        ],
        torsion: shear * 0.2 * width.min(height).powi(3) * width.max(height),
        axial: young * width * height,
        shear: shear * width * height,
        mass_per_length: density * width * height,
        ..round
    }
}

/// A round rod whose diameter changes in proportion to arc length.
fn tapered(start: f64, end: f64, young: f64, density: f64) -> Profile {
    let at = |i: usize| start + (end - start) * i as f64 / 4.0;
    Profile::Tapered(Box::new(std::array::from_fn(|i| {
        section(at(i), young, 0.3, density)
    })))
}

/// A backbone without tendons, in equal modules.
fn rod(profile: Profile, length: f64, modules: usize, gravity: [f64; 3]) -> Robot {
    let disk = |k: usize| Disk {
        hole_length: 0.0,
        station: length * k as f64 / modules as f64,
        clamped_length: 0.0,
        mass: 0.0,
        inertia: [0.0; 2],
        segment: 0,
    };
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![profile],
        disks: (1..=modules).map(disk).collect(),
        tendons: vec![],
        gravity,
    })
    .unwrap()
}

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

/// A random robot whose backbones are tapered, flat, curved and twisted without load.
fn general(number: usize) -> (Case, Robot) {
    let mut draw = Draw::new(41, number);
    let case = Case::realistic(&mut draw).tapered(&mut draw);
    let robot = Robot::new(case.spec.clone()).unwrap();
    (case, robot)
}

/// Five sections give the fourth power of a diameter exactly, and its means.
#[test]
fn a_linear_taper_is_exact() {
    let profile = tapered(0.006, 0.002, 60e9, 1000.0);
    for x in [0.0, 0.07, 0.31, 0.5, 0.83, 1.0] {
        let (found, expected) = (profile.at(x), section(0.006 - 0.004 * x, 60e9, 0.3, 1000.0));
        for (a, b) in [
            (found.bending[0], expected.bending[0]),
            (found.torsion, expected.torsion),
            (found.axial, expected.axial),
            (found.mass_per_length, expected.mass_per_length),
        ] {
            assert!((a - b).abs() < 1e-12 * b, "{x}: {a} {b}");
        }
    }
    // the mean of 1/d^4 from d0 to d1 is (1/d1^3 - 1/d0^3) / (3 (d0 - d1))
    let unit = std::f64::consts::PI * 60e9 / 64.0;
    let (a, b) = (0.006_f64, 0.002_f64);
    let expected = (b.powi(-3) - a.powi(-3)) / (3.0 * (a - b)) / unit;
    let found = profile.bending_flexibility();
    assert!((found[0] / expected - 1.0).abs() < 1e-6);
    assert_eq!(found[0], found[1]);
    assert_eq!(found[2], 0.0);
}

/// A cone under an end moment: its angle is the integral of M/(E I), in closed form; the position
/// by quadrature of that angle.
#[test]
fn a_tapered_cantilever_under_an_end_moment() {
    let (length, young) = (0.5, 60e9);
    let (a, b) = (0.005_f64, 0.003_f64);
    let unit = std::f64::consts::PI * young / 64.0;
    let moment = 0.3;
    let angle = |s: f64| {
        let d = a + (b - a) * s / length;
        moment * length / (3.0 * (a - b) * unit) * (d.powi(-3) - a.powi(-3))
    };
    // Simpson's rule, far beyond the asserted digits
    let count = 20_000;
    let h = length / count as f64;
    let (mut x, mut z) = (0.0, 0.0);
    for i in 0..=count {
        let weight = match i {
            0 => 1.0,
            i if i == count => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let theta = angle(h * i as f64);
        x += weight * h / 3.0 * theta.sin();
        z += weight * h / 3.0 * theta.cos();
    }
    let mut errors = vec![];
    for elements in [1, 2, 4, 8] {
        let robot = rod(tapered(a, b, young, 0.0), length, 10, [0.0; 3]);
        let settings = RodModel {
            model: kirchhoff(),
            elements: Some(elements),
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let load = Load {
            tip_moment: [0.0, moment, 0.0],
            ..Load::default()
        };
        let outcome = solver.solve(&load).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let tip = solver.solver().tip().unwrap();
        let gap = (tip.position - Vec3([x, 0.0, z])).norm() / length;
        let turned = tip.rotation.0[0][2].atan2(tip.rotation.0[2][2]) - angle(length);
        errors.push(gap.max(turned.abs()));
        if elements < 8 {
            let stated = outcome.error.unwrap().tip + 1e-10 * length;
            assert!(gap * length <= stated, "{elements}: {gap} {stated}");
        }
    }
    assert!(errors[3] < 1e-8, "{errors:?}");
    // fourth order
    assert!(errors[1] < errors[0] / 10.0, "{errors:?}");
    assert!(errors[2] < errors[1] / 10.0, "{errors:?}");
}

/// A cone under its own weight across and a small load: Euler-Bernoulli's deflection by quadrature.
#[test]
fn a_tapered_cantilever_under_its_weight() {
    let (length, young, density) = (0.5, 60e9, 6000.0);
    let (a, b) = (0.005_f64, 0.002_f64);
    let gravity = 0.1;
    let at = |s: f64| section(a + (b - a) * s / length, young, 0.3, density);
    let count = 2_000;
    let h = length / count as f64;
    let place = |i: usize| (i as f64 + 0.5) * h;
    // deflection by unit force: integral of the moment times (L - s) over E I
    let expected: f64 = (0..count)
        .map(|i| {
            let s = place(i);
            let moment: f64 = (i..count)
                .map(|j| {
                    let inner = if j == i { 0.25 * h } else { place(j) - s };
                    let share = if j == i { 0.5 } else { 1.0 };
                    at(place(j)).mass_per_length * gravity * inner * share * h
                })
                .sum();
            moment * (length - s) / at(s).bending[0] * h
        })
        .sum();
    for elements in [1, 2, 4] {
        let across = [gravity, 0.0, 0.0];
        let robot = rod(tapered(a, b, young, density), length, 4, across);
        let settings = RodModel {
            model: kirchhoff(),
            elements: Some(elements),
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let load = Load {
            gravity: across,
            ..Load::default()
        };
        let outcome = solver.solve(&load).unwrap();
        assert_eq!(outcome.status, Status::Converged);
        let found = solver.solver().tip().unwrap().position[0];
        let stated = outcome.error.unwrap().tip;
        assert!(
            (found - expected).abs() < stated,
            "{elements}: {found} {expected} {stated}"
        );
        assert!(stated < 1e-3 * expected);
    }
}

/// Bent about one principal axis, a flat rod is a round one with that stiffness.
#[test]
fn a_flat_rod_bends_as_a_round_one_about_each_axis() {
    let flat = rectangle(0.012, 0.003, 60e9, 0.0);
    for (axis, force) in [(0, [0.0, 2.0, -1.0]), (1, [2.0, 0.0, -1.0])] {
        let round = Section {
            bending: [flat.bending[axis]; 2],
            ..flat
        };
        let tip = |section: Section| {
            let robot = rod(section.into(), 0.4, 6, [0.0; 3]);
            let mut solver = Solver::new(&robot, Model::default(), 4).unwrap();
            let load = Load {
                tip_force: force,
                ..Load::default()
            };
            assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
            solver.tip().unwrap().position
        };
        // the coefficient of the quadratic strain is a mean over both axes
        assert!((tip(flat) - tip(round)).norm() < 1e-9);
    }
}

/// Sections, loads and answer turn together about z.
#[test]
fn a_turned_section_turns_the_answer() {
    let mut tensions = vec![];
    for number in 0..60 {
        let (case, robot) = general(number);
        let angle: f64 = 0.7;
        let turn = |v: [f64; 3]| {
            let (sin, cos) = angle.sin_cos();
            [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]]
        };
        let mut other = case.clone();
        for section in other
            .spec
            .backbone
            .iter_mut()
            .flat_map(Profile::sections_mut)
        {
            section.principal_angle += angle;
            section.rest_curvature = turn(section.rest_curvature);
        }
        for tendon in &mut other.spec.tendons {
            for hole in &mut tendon.holes {
                let [x, y, _] = turn([hole[0], hole[1], 0.0]);
                *hole = [x, y];
            }
        }
        other.spec.gravity = turn(case.spec.gravity);
        other.tip_force = Vec3(turn(case.tip_force.0));
        other.tip_moment = Vec3(turn(case.tip_moment.0));
        let turned = Robot::new(other.spec.clone()).unwrap();
        let mut tip = |case: &Case, robot: &Robot| {
            let mut solver = Solver::new(robot, case.model(), 2).unwrap();
            let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
            (outcome.status == Status::Converged).then(|| solver.tip().unwrap().position)
        };
        let (a, b) = (tip(&case, &robot), tip(&other, &turned));
        let (Some(a), Some(b)) = (a, b) else { continue };
        let gap = (Vec3(turn(a.0)) - b).norm() / robot.length();
        assert!(gap < 1e-9, "draw {number}: {gap}");
    }
}

/// Wrench and shape of random robots satisfy the equations of their rods.
#[test]
fn random_robots_satisfy_the_rod_equations() {
    let (mut converged, mut tensions) = (0, vec![]);
    for number in 0..300 {
        let (mut case, mut robot) = general(number);
        if number % 3 == 0 {
            case = case.laden(&mut Draw::new(47, number));
            robot = Robot::new(case.spec.clone()).unwrap();
        }
        let mut gap = |elements: usize| {
            let mut solver = Solver::new(&robot, case.model(), elements).unwrap();
            let outcome = solver.solve(&case.at(1.0, &mut tensions)).unwrap();
            (outcome.status == Status::Converged)
                .then(|| case.gap(&robot, &solver, 100).unwrap_or(0.0))
        };
        let (Some(coarse), Some(fine)) = (gap(1), gap(8)) else {
            continue;
        };
        converged += 1;
        let most = match case.theory {
            Theory::Kirchhoff => f64::max(1e-6, coarse / 300.0),
            Theory::Cosserat => f64::max(1e-5, coarse / 40.0),
        };
        assert!(fine < most, "draw {number}: {fine} of {coarse}");
    }
    assert!(converged > 250, "{converged}");
}

#[test]
fn stated_errors_hold() {
    let (mut compared, mut tensions) = (0, vec![]);
    for number in 0..200 {
        let (case, robot) = general(number);
        let load = case.at(1.0, &mut tensions);
        let settings = RodModel {
            model: case.model(),
            elements: None,
        };
        let mut solver = Adaptive::of(&robot, &settings).unwrap();
        let outcome = solver.solve(&load).unwrap();
        let mut fine = Solver::new(&robot, case.model(), 8).unwrap();
        let exact = fine.solve(&load).unwrap();
        if (outcome.status, exact.status) != (Status::Converged, Status::Converged) {
            continue;
        }
        let tip = solver.solver().tip().unwrap().position;
        let error = (tip - fine.tip().unwrap().position).norm();
        if error > 1e-2 * robot.length() {
            continue; // another equilibrium
        }
        compared += 1;
        let stated = outcome.error.unwrap().tip + 1e-9 * robot.length();
        assert!(error <= stated, "draw {number}: {error} of {stated}");
    }
    assert!(compared > 165, "{compared}");
}

/// Derivatives with respect to stiffness and tension, against differences.
#[test]
fn derivatives_are_those_of_differences() {
    let mut compared = 0;
    for number in 0..20 {
        let (case, robot) = general(number);
        let mut tensions = vec![];
        let load = case.at(0.6, &mut tensions);
        let tip = |robot: &Robot, load: &Load| {
            let mut solver = Solver::new(robot, case.model(), 2).unwrap();
            let outcome = solver.solve(load).unwrap();
            (outcome.status == Status::Converged && outcome.stable == Some(true))
                .then(|| (solver.tip().unwrap().position, solver))
        };
        let Some((_, solver)) = tip(&robot, &load) else {
            continue;
        };
        let Some(found) = solver.jacobians(false) else {
            continue;
        };
        let stiffer = |factor: f64| {
            let mut spec = case.spec.clone();
            for s in spec.backbone[0].sections_mut() {
                let [x, y] = &mut s.bending;
                for v in [x, y, &mut s.torsion, &mut s.axial, &mut s.shear] {
                    *v *= factor;
                }
            }
            tip(&Robot::new(spec).unwrap(), &load).unwrap().0
        };
        let step: f64 = 1e-4;
        let expected = (stiffer(step.exp()) - stiffer((-step).exp())) * (0.5 / step);
        let gap = (found.stiffness[0].position - expected).norm();
        assert!(
            gap < 1e-5 * (expected.norm() + robot.length() * 1e-3),
            "draw {number}: {gap}"
        );
        compared += 1;
    }
    assert!(compared > 12, "{compared}");
}

/// Lanes and single solves agree, also where robots with and without a taper are side by side.
#[test]
fn batches_equal_one_by_one() {
    for number in 0..20 {
        let (case, robot) = general(number);
        let tensions: Vec<f64> = (0..30)
            .flat_map(|i| case.tensions.iter().map(move |t| t * i as f64 / 30.0))
            .collect();
        let loads = Loads {
            count: 30,
            tensions: &tensions,
            gravity: &case.spec.gravity,
            tip_force: &case.tip_force.0,
            tip_moment: &[0.0; 3],
            ..Loads::default()
        };
        let settings = RodModel {
            model: case.model(),
            elements: None,
        };
        let a = solve_batch(&robot, &settings, &loads, 2, false).unwrap();
        let b = sweep(&robot, &settings, &loads, true, false).unwrap();
        for i in 0..30 {
            let found = |o: &[Outcome]| o[i].status == Status::Converged;
            assert_eq!(found(&a.outcomes), found(&b.outcomes), "draw {number}");
            for q in 3 * i..3 * i + 3 {
                let gap = (a.tip_position[q] - b.tip_position[q]).abs();
                assert!(!(gap > 2e-5 * robot.length()), "draw {number}: {gap}");
            }
        }
    }
}

#[test]
fn impossible_sections_are_refused() {
    let robot = |profile: Profile| {
        let good = rod(section(0.004, 60e9, 0.3, 0.0).into(), 0.5, 5, [0.0; 3]);
        Robot::new(RobotSpec {
            payloads: vec![],
            backbone: vec![profile],
            ..good.spec().clone()
        })
    };
    let mut flat = rectangle(0.012, 0.003, 60e9, 0.0);
    flat.bending[1] = 0.0;
    assert!(robot(flat.into())
        .unwrap_err()
        .to_string()
        .contains("bending stiffness"));
    flat = rectangle(0.012, 0.003, 60e9, 0.0);
    flat.principal_angle = f64::NAN;
    assert!(robot(flat.into()).is_err());
    // positive at the five places, but not between them
    let mut sections = [section(0.004, 60e9, 0.3, 0.0); 5];
    for (s, factor) in sections.iter_mut().zip([1.0, 1e-3, 1.0, 1e-3, 1.0]) {
        s.torsion *= factor;
    }
    assert!(robot(Profile::Tapered(Box::new(sections))).is_err());
}

/// 2 000 robots with all of it: tapered, flat, precurved, routed freely through thick holes, with
/// payloads, and with forces on disks, beside their centres and along the backbone. Where a path in small steps reaches a stable equilibrium, a single solve finds one too, and wherever
/// one is found its shape satisfies the equations of the rod.
#[test]
fn robots_with_everything_converge() {
    let (mut known, mut found, mut worst) = (0, 0, 0.0_f64);
    let mut tensions = vec![];
    for number in 0..2000 {
        let (case, _) = general(number);
        let mut draw = Draw::new(43, number);
        let case = case.routed(&mut draw).laden(&mut draw);
        let robot = Robot::new(case.spec.clone()).unwrap();
        // small beside the tensions and the force on the tip
        let size = 0.2 * robot.moment_scale() / robot.length();
        let forces: Vec<[f64; 3]> = (0..robot.module_count())
            .map(|_| (draw.direction() * (size * draw.within(0.0, 1.0))).0)
            .collect();
        let n = robot.module_count();
        let points: Vec<PointLoad> = (0..2)
            .map(|_| PointLoad {
                disk: (draw.within(0.0, n as f64) as usize).min(n - 1),
                point: (draw.direction() * draw.within(0.0, 0.05 * robot.length())).0,
                force: (draw.direction() * (size * draw.within(0.0, 1.0))).0,
                ..PointLoad::default()
            })
            .collect();
        let line = (draw.direction() * (size / robot.length() * draw.within(0.0, 1.0))).0;
        let (mut lines, mut at_points) = (vec![line; n], points.clone());
        let mut scaled = forces.clone();
        let mut path = Solver::new(&robot, case.model(), 1).unwrap();
        let mut before: Option<Vec3> = None;
        let reached = (0..=24).all(|step| {
            let fraction = f64::from(step) / 24.0;
            for (to, from) in scaled.iter_mut().zip(&forces) {
                *to = from.map(|f| f * fraction);
            }
            for (to, from) in at_points.iter_mut().zip(&points) {
                to.force = from.force.map(|f| f * fraction);
            }
            lines.fill(line.map(|f| f * fraction));
            let load = Load {
                disk_forces: &scaled,
                point_loads: &at_points,
                line_forces: &lines,
                ..case.at(fraction, &mut tensions)
            };
            let outcome = path.solve_next(&load).unwrap();
            let Some(tip) = path.tip().map(|t| t.position) else {
                return false;
            };
            let near = before.is_none_or(|b| (tip - b).norm() < 0.25 * robot.length());
            before = Some(tip);
            let stable = outcome.stable == Some(true) && !outcome.left_unstable;
            outcome.status == Status::Converged && stable && near
        });
        if !reached {
            continue;
        }
        known += 1;
        let load = Load {
            disk_forces: &forces,
            point_loads: &points,
            line_forces: &vec![line; n],
            ..case.at(1.0, &mut tensions)
        };
        let mut solver = Solver::new(&robot, case.model(), 1).unwrap();
        let outcome = solver.solve(&load).unwrap();
        if outcome.status == Status::Converged {
            found += 1;
            assert_ne!(outcome.stable, Some(false), "draw {number}");
            let again = solver.tip().unwrap().position;
            worst = worst.max((again - before.unwrap()).norm() / robot.length());
        }
    }
    println!("{found} of {known} known equilibria found; farthest tip {worst:.2}");
    assert!(known > 1200, "{known}");
    assert!(found as f64 >= 0.99 * known as f64, "{found} of {known}");
}
