//! What all robots and loads have in common: a row of the table for each of them, and in it the
//! properties, each with its numbers. A test is named after its row and its property.

#[path = "common/cases.rs"]
mod cases;
mod common;

use bowstring_core::dynamics::integrator::{Integrator, Simulator};
use bowstring_core::dynamics::modal::flexibility;
use bowstring_core::math::lie;
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, OwnedLoad, PointLoad, RodModel, TendonPath, Theory};
use bowstring_core::model::robot::{Payload, Profile, Robot, Section};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, sweep};
use bowstring_core::statics::designs::sweep_designs;
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::path_batch::{follow, solve_each, Steps};
use bowstring_core::statics::solver::{Outcome, Solver, Status};
use cases::{Case, Draw};
use common::{apart, by_tensions, disks, fixed_steps, go, rao_robot, study_robot};

/// A test for each property of each row; arguments are described at the properties.
macro_rules! table {
    ($($row:ident: $($property:ident($($argument:expr),*)),+;)+) => {$(
        mod $row {
            $(#[test]
            fn $property() {
                super::$property(super::rows::$row, $($argument),*);
            })+
        }
    )+};
}

table! {
    // robots
    routed: turns(40, 35, &[2], 1e-9), rod_equations(300, 271, 1), lengths(4, 2),
        stated_errors(200, 171, None, 0), reciprocity(100, 90, &[2]),
        batches(20, [1e-9, 2e-5], false), units(5);
    precurved: turns(40, 35, &[2], 1e-9), rod_equations(300, 261, 1),
        stated_errors(200, 166, None, 0), derivatives(20, 13, &[2], 1e-6),
        batches(20, [1e-9, 2e-5], true);
    tapered: turns(60, 50, &[2], 1e-9), rod_equations(200, 170, 1),
        stated_errors(200, 166, None, 0), derivatives(20, 13, &[2], 1e-6),
        batches(20, [1e-9, 2e-5], false);
    laden: turns(20, 15, &[2], 1e-9), rod_equations(100, 85, 1);
    coupled: turns(20, 15, &[2], 1e-9), rod_equations(50, 40, 1), derivatives(10, 6, &[2], 1e-6),
        batches(5, [1e-9, 2e-5], true);
    // loads
    tip_forces: derivatives(2, 2, &[1, 4], 2e-6), reciprocity(2, 2, &[1, 4]),
        batches(2, [1.5e-10, 1.5e-10], true);
    tip_moments: derivatives(3, 3, &[1], 2e-6), motion(2, &[1, 2]), motion_turns(2);
    disk_forces: turns(4, 4, &[1], 1e-11), rod_equations(4, 4, 1), derivatives(2, 2, &[1], 1e-6),
        reciprocity(2, 2, &[1]), probes(2, &[1, 2]), works(2), flexibilities(2),
        batches(2, [1e-9, 1e-9], true), motion(1, &[1]), motion_turns(1), held_forces(1), paths(1);
    disk_moments: turns(4, 4, &[1], 1e-11), rod_equations(4, 4, 1), derivatives(2, 2, &[1], 1e-6),
        batches(2, [1e-9, 1e-9], true), motion(1, &[1]), motion_turns(1), held_forces(1), paths(1),
        units(2);
    large_disk_loads: stated_errors(60, 31, Some(1), 31);
    points: turns(4, 4, &[1], 1e-12), rod_equations(4, 4, 1), dead_equivalents(20, &[1, 2]),
        derivatives(2, 2, &[1], 1e-6), reciprocity(2, 2, &[1]), probes(2, &[1, 2]), works(2),
        flexibilities(2), batches(2, [1e-9, 1e-9], true), motion(1, &[1]), motion_turns(1),
        held_forces(1), paths(1);
    followers: turns(10, 10, &[1], 1e-12), rod_equations(10, 10, 1),
        dead_equivalents(20, &[1, 2]), derivatives(5, 5, &[1], 1e-6),
        batches(2, [1e-9, 1e-9], true), motion(2, &[1]), motion_turns(2), paths(1), units(2);
    sections: turns(4, 4, &[2, 4, 8], 1e-12), rod_equations(4, 4, 2),
        derivatives(2, 2, &[2, 4, 8], 1e-7), reciprocity(2, 2, &[2, 4, 8]), probes(2, &[2, 4, 8]),
        batches(1, [1e-9, 1e-9], true);
    followers_on_sections: turns(4, 4, &[2, 4, 8], 1e-12), rod_equations(4, 4, 2),
        derivatives(2, 2, &[2, 4, 8], 1e-7);
    // models
    continuous: works(2);
}

/// The case of a number.
type Row = fn(usize) -> Case;

mod rows {
    use super::*;

    pub fn routed(number: usize) -> Case {
        let mut draw = Draw::new(21, number);
        Case::realistic(&mut draw).routed(&mut draw)
    }

    pub fn precurved(number: usize) -> Case {
        let mut draw = Draw::new(22, number);
        let case = Case::realistic(&mut draw).routed(&mut draw);
        case.precurved(&mut draw)
    }

    /// Also flat, curved and twisted without load.
    pub fn tapered(number: usize) -> Case {
        let mut draw = Draw::new(41, number);
        Case::realistic(&mut draw).tapered(&mut draw)
    }

    pub fn laden(number: usize) -> Case {
        tapered(3 * number).laden(&mut Draw::new(47, 3 * number))
    }

    pub fn coupled(number: usize) -> Case {
        let mut draw = Draw::new(23, number);
        Case::realistic(&mut draw).coupled(&mut draw)
    }

    /// A robot under a load; the theory alternates.
    fn case(robot: Robot, load: OwnedLoad, number: usize) -> Case {
        let model = [Default::default(), common::kirchhoff()][number % 2];
        Case {
            spec: robot.spec().clone(),
            load,
            compliances: vec![],
            model,
        }
    }

    /// The study's robot under tensions, gravity and further loads.
    fn study(number: usize, load: OwnedLoad) -> Case {
        let load = OwnedLoad {
            tensions: vec![30.0, 5.0, 10.0],
            gravity: [1.0, 2.0, -9.81],
            ..load
        };
        case(study_robot(9, 0.003), load, number)
    }

    fn vectors(draw: &mut Draw, count: usize, size: f64) -> Vec<[f64; 3]> {
        let mut component = |_| draw.within(-size, size);
        (0..count).map(|_| [0; 3].map(&mut component)).collect()
    }

    pub fn tip_forces(number: usize) -> Case {
        let load = OwnedLoad {
            tensions: vec![60.0, 15.0, 25.0],
            gravity: [1.0, 2.0, -9.81],
            tip_force: [-0.4, 0.8, 0.3],
            ..OwnedLoad::default()
        };
        case(study_robot(9, [0.003, 0.0][number % 2]), load, number)
    }

    /// The third is met by load stepping alone.
    pub fn tip_moments(number: usize) -> Case {
        let mut case = tip_forces(number);
        case.load.tip_moment = [0.05, -0.1, 0.2];
        if number == 2 {
            case.load = OwnedLoad {
                tensions: vec![20.0, 0.0, 0.0],
                tip_moment: [0.0, 12.0, 0.2],
                ..OwnedLoad::default()
            };
        }
        case
    }

    pub fn disk_forces(number: usize) -> Case {
        let load = OwnedLoad {
            tip_force: [0.2, 0.1, -0.3],
            disk_forces: vectors(&mut Draw::new(11, number), 9, 0.4),
            ..OwnedLoad::default()
        };
        study(number, load)
    }

    pub fn disk_moments(number: usize) -> Case {
        let mut case = disk_forces(number);
        case.load.tip_moment = [[0.05, -0.1, 0.2], [0.0; 3]][number % 2];
        case.load.disk_moments = vectors(&mut Draw::new(12, number), 9, 0.06);
        case
    }

    pub fn large_disk_loads(number: usize) -> Case {
        let robots = [study_robot(9, 0.003), rao_robot(), study_robot(4, 0.0)];
        let robot = robots[number % 3].clone();
        let mut draw = Draw::new(13, number);
        let (n, scale) = (robot.module_count(), robot.moment_scale());
        let force = 1.5 * scale / (robot.length() * (n as f64).sqrt());
        let mut load = OwnedLoad {
            tensions: vec![0.0; robot.tendon_count()],
            disk_forces: vectors(&mut draw, n, force),
            ..OwnedLoad::default()
        };
        if number.is_multiple_of(2) {
            load.disk_moments = vectors(&mut draw, n, 0.5 * scale / n as f64);
        }
        case(robot, load, 0)
    }

    fn point(draw: &mut Draw, follower: bool) -> PointLoad {
        let [point, force, moment] = [0.05, 0.4, 0.04].map(|size| vectors(draw, 1, size)[0]);
        PointLoad {
            disk: draw.count(0, 8),
            point,
            force,
            moment: if follower { moment } else { [0.0; 3] },
            follower,
            ..PointLoad::default()
        }
    }

    /// Dead forces beside the centres of disks, and forces per length.
    pub fn points(number: usize) -> Case {
        let mut draw = Draw::new(14, number);
        let load = OwnedLoad {
            point_loads: (0..3).map(|_| point(&mut draw, false)).collect(),
            line_forces: vectors(&mut draw, 9, 0.6),
            ..OwnedLoad::default()
        };
        study(number, load)
    }

    /// Followers, and a dead force and moment.
    pub fn followers(number: usize) -> Case {
        let mut draw = Draw::new(15, number);
        let mut case = points(number);
        let mut dead = point(&mut draw, true);
        dead.follower = false;
        case.load.point_loads = vec![point(&mut draw, true), dead, point(&mut draw, true)];
        case
    }

    /// A dead force beside the section at a quarter of the sixth module.
    pub fn sections(number: usize) -> Case {
        let mut draw = Draw::new(16, number);
        let mut own = point(&mut draw, false);
        own.force = own.force.map(|f| 3.0 * f);
        own.arc_length = Some(common::LENGTH / 9.0 * 5.25);
        let load = OwnedLoad {
            point_loads: vec![own],
            ..OwnedLoad::default()
        };
        study(number, load)
    }

    pub fn followers_on_sections(number: usize) -> Case {
        let mut case = sections(number);
        let own = &mut case.load.point_loads[0];
        own.follower = true;
        own.moment = vectors(&mut Draw::new(17, number), 1, 0.1)[0];
        case
    }

    /// Tendons along the backbone.
    pub fn continuous(number: usize) -> Case {
        let mut case = tip_forces(number);
        case.model.tendon = TendonPath::Continuous;
        case
    }
}

/// A solver in the equilibrium of a case; `None` where it finds none.
fn at_rest(case: &Case, elements: usize) -> Option<(Solver, Outcome)> {
    let robot = Robot::new(case.spec.clone()).unwrap();
    let mut solver = Solver::new(&robot, case.model, elements).unwrap();
    let outcome = solver.solve(&case.load.borrow()).unwrap();
    (outcome.status == Status::Converged).then_some((solver, outcome))
}

/// Robot and load in another unit of force.
fn in_units(mut case: Case, unit: f64) -> Case {
    for profile in &mut case.spec.backbone {
        for section in profile.sections_mut() {
            section.mass_per_length *= unit;
            section.rotary_inertia *= unit;
        }
        profile.scale_stiffness(unit);
    }
    for disk in &mut case.spec.disks {
        disk.mass *= unit;
        disk.inertia = disk.inertia.map(|x| x * unit);
    }
    for payload in &mut case.spec.payloads {
        payload.mass *= unit;
    }
    let gravity = case.load.gravity;
    case.load.scale(unit, unit);
    case.load.gravity = gravity;
    case
}

/// Robot and load turned about the backbone.
fn turned(mut case: Case, angle: f64) -> Case {
    let turn = lie::exp(Vec3([0.0, 0.0, angle]));
    let vector = |v: &mut [f64; 3]| *v = (turn * Vec3(*v)).0;
    let spec = &mut case.spec;
    for hole in spec.tendons.iter_mut().flat_map(|t| &mut t.holes) {
        let [x, y, _] = (turn * Vec3([hole[0], hole[1], 0.0])).0;
        *hole = [x, y];
    }
    let centres = spec.payloads.iter_mut().map(|p| &mut p.centre);
    centres.for_each(vector);
    let profiles = spec.backbone.iter_mut();
    for section in profiles.flat_map(Profile::sections_mut) {
        section.principal_angle += angle;
        vector(&mut section.rest_curvature);
    }
    for (profile, compliance) in spec.backbone.iter_mut().zip(&case.compliances) {
        let section = profile.sections()[0];
        let mut rest = section.rest_curvature;
        vector(&mut rest);
        // curvature and strain along the axes turn alike
        let both = |i: usize, j: usize| f64::from(i / 3 == j / 3) * turn.0[i % 3][j % 3];
        let own = cases::inverse(compliance);
        let by = |k: usize, j: usize| (0..6).map(|l| own[k][l] * both(j, l)).sum::<f64>();
        let of = |i: usize, j: usize| (0..6).map(|k| both(i, k) * by(k, j)).sum();
        let stiffness = std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)));
        let mass = (section.mass_per_length, section.rotary_inertia);
        *profile = Profile::of_stiffness(stiffness, mass.0, mass.1, rest);
    }
    let load = &mut case.load;
    let own = [&mut load.gravity, &mut load.tip_force, &mut load.tip_moment];
    let own = own.into_iter().chain(&mut load.disk_forces);
    let own = own
        .chain(&mut load.disk_moments)
        .chain(&mut load.line_forces);
    let points = load.point_loads.iter_mut();
    let points = points.flat_map(|p| [&mut p.point, &mut p.force, &mut p.moment]);
    own.chain(points).for_each(vector);
    case
}

/// Checks a difference; `at` says where it is.
fn below(difference: f64, most: f64, at: &str) {
    assert!(
        difference < most,
        "{at}: {difference:e}, not below {most:e}"
    );
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Numbers of cases with numbers of elements.
fn pairs(count: usize, elements: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
    (0..count).flat_map(|number| elements.iter().map(move |elements| (number, *elements)))
}

/// Robot and load turned together turn the answer, to a share `most` of the length; `least` of the
/// cases have one.
fn turns(row: Row, count: usize, least: usize, elements: &[usize], most: f64) {
    let mut found = 0;
    for (number, elements) in pairs(count, elements) {
        let (case, angle) = (row(number), 0.7 + number as f64);
        let own = at_rest(&case, elements);
        let other = at_rest(&turned(case, angle), elements);
        assert_eq!(own.is_some(), other.is_some(), "case {number}");
        let Some(((own, outcome), (other, again))) = own.zip(other) else {
            continue;
        };
        found += 1;
        assert_eq!(outcome.stable, again.stable, "case {number}");
        let turn = lie::exp(Vec3([0.0, 0.0, angle]));
        for (a, b) in disks(&own).iter().zip(disks(&other)) {
            let off = (turn * a.position - b.position).norm() / own.robot().length();
            below(off, most, &format!("case {number}, {elements} elements"));
        }
    }
    assert!(found >= least * elements.len(), "{found}");
}

/// In other units of force the equilibrium under the load is the same, and so are those on a path
/// by tensions and then by displacements.
fn units(row: Row, count: usize) {
    for number in 0..count {
        let found = |unit: f64| {
            let mut case = in_units(row(number), unit);
            let rest = at_rest(&case, 1).map(|(solver, outcome)| (outcome.stable, disks(&solver)));
            let robot = Robot::new(case.spec.clone()).unwrap();
            let line = Line {
                stiffness: 1e5 * robot.moment_scale() / robot.length(),
                friction: 0.1,
                ..Line::default()
            };
            let lines = vec![line; robot.tendon_count()];
            let mut path = PathSolver::new(&robot, case.model, 1, &lines).unwrap();
            let tensions = std::mem::take(&mut case.load.tensions);
            let mut step = |commands: Vec<_>| {
                let outcome = path.step(&commands, &case.load.borrow()).unwrap();
                let found = (outcome.status == Status::Converged)
                    .then(|| (outcome.stable, disks(path.solver())));
                (found, path.history().displacements.clone())
            };
            let (first, displacements) = step(tensions.into_iter().map(Command::Tension).collect());
            let less = displacements.iter().map(|d| Command::Displacement(0.9 * d));
            [rest, first, step(less.collect()).0]
        };
        let exact = found(1.0);
        for unit in [1e-9, 1e6] {
            for (step, (own, exact)) in found(unit).iter().zip(&exact).enumerate() {
                let at = format!("case {number}, unit {unit:e}, step {step}");
                assert_eq!(own.is_some(), exact.is_some(), "{at}");
                if let (Some((stable, places)), Some((exact_stable, exact))) = (own, exact) {
                    assert_eq!(stable, exact_stable, "{at}");
                    below(
                        apart(places, exact),
                        1e-9 * places.last().unwrap().position.norm(),
                        &at,
                    );
                }
            }
        }
    }
}

/// Eight elements satisfy the rod's differential equations under the wrench computed from their
/// poses alone, better than `coarse` elements do: with the fourth order, but that shear and
/// extension are averaged over a module.
fn rod_equations(row: Row, count: usize, least: usize, coarse: usize) {
    let mut found = 0;
    for number in 0..count {
        let case = row(number);
        let gap = |elements: usize| {
            let (solver, _) = at_rest(&case, elements)?;
            Some(case.gap(solver.robot(), &solver, 100).unwrap_or(0.0))
        };
        let (Some(rough), Some(fine)) = (gap(coarse), gap(8)) else {
            continue;
        };
        found += 1;
        let most = match case.model.theory {
            Theory::Kirchhoff => f64::max(1e-6, rough / 300.0),
            Theory::Cosserat => f64::max(1e-5, rough / 40.0),
        };
        below(fine, most, &format!("case {number}"));
    }
    assert!(found >= least, "{found}");
}

/// The stated error covers the difference to eight elements at every disk; `close` of the stated
/// errors are at most a hundred times as large.
fn stated_errors(row: Row, count: usize, least: usize, elements: Option<usize>, close: usize) {
    let (mut found, mut near) = (0, 0);
    for number in 0..count {
        let case = row(number);
        let robot = Robot::new(case.spec.clone()).unwrap();
        let model = RodModel {
            model: case.model,
            elements,
        };
        let mut solver = Adaptive::of(&robot, &model).unwrap();
        let outcome = solver.solve(&case.load.borrow()).unwrap();
        let fine = at_rest(&case, 8).filter(|_| outcome.status == Status::Converged);
        let Some((fine, _)) = fine else {
            continue;
        };
        found += 1;
        let stated = outcome.error.unwrap().tip;
        let off = apart(&disks(solver.solver()), &disks(&fine));
        below(
            off,
            stated + 1e-9 * robot.length(),
            &format!("case {number}"),
        );
        near += usize::from(stated < 100.0 * off + 1e-12);
    }
    assert!(found >= least && near >= close, "{found} {near}");
}

/// Lengths of tendons are those between the holes of the poses.
fn lengths(row: Row, count: usize, elements: usize) {
    for number in 0..count {
        let Some((solver, _)) = at_rest(&row(number), elements) else {
            continue;
        };
        for (i, tendon) in solver.robot().spec().tendons.iter().enumerate() {
            let place = |at: usize| {
                let [x, y] = tendon.hole(at);
                let hole = Vec3([x, y, 0.0]);
                match at {
                    0 => hole,
                    _ => {
                        let disk = solver.disk(at - 1).unwrap();
                        disk.position + disk.rotation * hole
                    }
                }
            };
            let spans = (0..=tendon.end_disk).map(|k| (place(k + 1) - place(k)).norm());
            let off = spans.sum::<f64>() - solver.tendon_length(i).unwrap();
            below(off.abs(), 1e-14, &format!("case {number}, tendon {i}"));
        }
    }
}

/// Point loads are forces on the centres of disks and moments on disks, at the poses of the
/// equilibrium, which takes few iterations.
fn dead_equivalents(row: Row, count: usize, elements: &[usize]) {
    for (number, elements) in pairs(count, elements) {
        let case = row(number);
        let (solver, outcome) = at_rest(&case, elements).unwrap();
        assert!(outcome.iterations < 12, "case {number}: {outcome:?}");
        let mut dead = case.clone();
        dead.load.disk_forces.resize(9, [0.0; 3]);
        dead.load.disk_moments.resize(9, [0.0; 3]);
        for load in dead.load.point_loads.drain(..) {
            let rotation = solver.disk(load.disk).unwrap().rotation;
            let given = [Vec3(load.force), Vec3(load.moment)];
            let [force, own] = given.map(|v| if load.follower { rotation * v } else { v });
            let moment = (rotation * Vec3(load.point)).cross(force) + own;
            for q in 0..3 {
                dead.load.disk_forces[load.disk][q] += force[q];
                dead.load.disk_moments[load.disk][q] += moment[q];
            }
        }
        let other = at_rest(&dead, elements).unwrap().0;
        let off = apart(&disks(&solver), &disks(&other));
        below(off, 1e-10, &format!("case {number}, {elements} elements"));
    }
}

/// Derivatives at zero by differences of the fourth order.
fn slopes<const N: usize>(of: impl Fn(f64) -> [Vec<f64>; N]) -> [Vec<f64>; N] {
    let h = 1e-3;
    let [a, b, c, d] = [-h, -0.5 * h, 0.5 * h, h].map(of);
    std::array::from_fn(|part| {
        let [a, b, c, d] = [&a, &b, &c, &d].map(|at| &at[part]);
        let slope = |i: usize| (8.0 * (c[i] - b[i]) - (d[i] - a[i])) / (6.0 * h);
        (0..a.len()).map(slope).collect()
    })
}

/// Derivatives of tip and lengths are those of differences, relative to them.
fn derivatives(row: Row, count: usize, least: usize, elements: &[usize], most: f64) {
    type Change = fn(&mut Case, usize, f64);
    let changes: [Change; 5] = [
        |case, i, by| case.load.tensions[i] += by,
        |case, i, by| case.load.tip_force[i] += by,
        |case, i, by| case.load.tip_moment[i] += by,
        |case, i, by| case.load.gravity[i] += by,
        |case, i, by| case.spec.backbone[i].scale_stiffness(by.exp()),
    ];
    let mut compared = 0;
    for (number, elements) in pairs(count, elements) {
        let case = row(number);
        let Some((solver, _)) = at_rest(&case, elements) else {
            continue;
        };
        compared += 1;
        let found = solver.jacobians(true).unwrap();
        let (length, moment) = (solver.robot().length(), solver.robot().moment_scale());
        let force = moment / length;
        let tension = case.load.tensions.iter().copied().fold(force, f64::max);
        let kinds = [
            ("tension", &found.tensions, tension),
            ("tip force", &found.tip_force, force),
            ("tip moment", &found.tip_moment, moment),
            ("gravity", &found.gravity, force / solver.robot().mass()),
            ("stiffness", &found.stiffness, 1.0),
        ];
        let before = solver.tip().unwrap().rotation.transpose();
        for ((kind, found, scale), change) in kinds.into_iter().zip(changes) {
            for (i, found) in found.iter().enumerate() {
                if kind == "tension" && case.load.tensions[i] < 1e-2 * scale {
                    continue; // cannot be reduced
                }
                let [place, turn] = slopes(|share| {
                    let mut case = case.clone();
                    change(&mut case, i, share * scale);
                    let (moved, _) = at_rest(&case, elements).expect("beside one with a solution");
                    let (tip, count) = (moved.tip().unwrap(), moved.robot().tendon_count());
                    let lengths = (0..count).map(|j| moved.tendon_length(j).unwrap());
                    let place = tip.position.0.into_iter().chain(lengths).collect();
                    [place, lie::log(&(tip.rotation * before)).0.to_vec()]
                });
                let own = [found.position.0.as_slice(), &found.lengths].concat();
                let parts = [(own, place, length), (found.rotation.0.to_vec(), turn, 1.0)];
                for (own, exact, unit) in parts {
                    let off = own.iter().zip(&exact).map(|(a, b)| (scale * a - b).abs());
                    let off = off.fold(0.0, f64::max) / unit;
                    let size = norm(&exact) / unit;
                    let at = format!("case {number}, {elements} elements, {kind} {i}");
                    below(off, most * size.max(1e-3), &at);
                }
            }
        }
    }
    assert!(compared >= least * elements.len(), "{compared}");
}

/// The displacement of one force by another is that of the other by the one: tensions and tip
/// wrench, from the derivatives.
fn reciprocity(row: Row, count: usize, least: usize, elements: &[usize]) {
    let mut compared = 0;
    for (number, elements) in pairs(count, elements) {
        let case = row(number);
        let Some((solver, _)) = at_rest(&case, elements) else {
            continue;
        };
        let Some(found) = solver.jacobians(false) else {
            continue;
        };
        compared += 1;
        let (robot, m) = (solver.robot(), case.load.tensions.len());
        let lever = |i: usize| match i {
            i if i < m => norm(&case.spec.tendons[i].holes[0]),
            i if i < m + 3 => robot.length(),
            _ => 1.0,
        };
        let by = found.tensions.iter().chain(&found.tip_force);
        let by: Vec<_> = by.chain(&found.tip_moment).collect();
        let of = |i: usize, j: usize| {
            let moved = match i {
                i if i < m => -by[j].lengths[i],
                i if i < m + 3 => by[j].position[i - m],
                _ => by[j].rotation[i - m - 3],
            };
            moved * robot.moment_scale() / (lever(i) * lever(j))
        };
        let largest = (0..m + 6).map(|i| of(i, i).abs()).fold(0.0, f64::max);
        // a dead moment has no potential: no pair of two
        for (i, j) in (0..m + 6).flat_map(|i| (0..i.min(m + 3)).map(move |j| (i, j))) {
            let gap = (of(i, j) - of(j, i)).abs();
            below(gap, 1e-12 * largest, &format!("case {number}, {i} {j}"));
        }
    }
    assert!(compared >= least * elements.len(), "{compared}");
}

/// The displacement of a disk, and of a section between disks, by a force on the tip is that of the
/// tip by a force there.
fn probes(row: Row, count: usize, elements: &[usize]) {
    for (number, elements) in pairs(count, elements) {
        let case = row(number);
        let spec = &case.spec;
        let (n, length) = (spec.disks.len(), spec.disks.last().unwrap().station);
        let (disk, module) = (n / 3, 5 * n / 9);
        let start = spec.disks[module - 1].station;
        let section = start + 0.25 * (spec.disks[module].station - start);
        let size = Robot::new(spec.clone()).unwrap().moment_scale() / length;
        // tip, disk and section, which is loaded where a module has more than one element
        let places = if elements > 1 { 3 } else { 2 };
        let moved = |at: usize, axis: usize| {
            slopes(|force| {
                let (mut case, mut vectors) = (case.clone(), [[0.0; 3]; 3]);
                vectors[at][axis] = force * size;
                case.load.tip_force[axis] += vectors[0][axis];
                case.load.disk_forces.resize(n, [0.0; 3]);
                case.load.disk_forces[disk][axis] += vectors[1][axis];
                // also without force, so that the elements are the same
                if places == 3 {
                    case.load.point_loads.push(PointLoad {
                        arc_length: Some(section),
                        force: vectors[2],
                        ..PointLoad::default()
                    });
                }
                let (solver, _) = at_rest(&case, elements).unwrap();
                let line = solver.centerline(4).unwrap();
                let disk = solver.disk(disk).unwrap().position;
                let seen = [line[4 * n], disk, line[4 * module + 1]];
                seen.map(|place| (place * (1.0 / length)).0.to_vec())
            })
        };
        let by = |at| [0, 1, 2].map(|axis| moved(at, axis));
        let by: Vec<_> = (0..places).map(by).collect();
        for (at, p, q) in (1..places).flat_map(|at| (0..9).map(move |i| (at, i / 3, i % 3))) {
            let (there, here) = (by[0][p][at][q], by[at][q][0][p]);
            let at = format!("case {number}, {elements} elements, place {at}");
            below((there - here).abs(), 4e-8, &at);
        }
    }
}

/// The elastic energy grows by the work of tensions and forces.
fn works(row: Row, count: usize) {
    for number in 0..count {
        let mut case = row(number);
        case.load.gravity = [0.0; 3];
        case.load.line_forces.clear();
        let at = |share: f64| {
            let case = Case {
                load: case.at(1.0 + share),
                ..case.clone()
            };
            let (solver, _) = at_rest(&case, 1).unwrap();
            let mut simulator = simulator(&case, 1, fixed_steps(5e-3, 1.0));
            simulator.rest(&case.load.borrow()).unwrap();
            (simulator.energies().elastic, solver)
        };
        let h = 1e-3;
        let ((high, up), (low, down)) = (at(h), at(-h));
        let load = &case.load;
        let moved = |of: &dyn Fn(&Solver) -> Vec3| of(&up) - of(&down);
        let tip = moved(&|s| s.tip().unwrap().position);
        let mut work = tip.dot(Vec3(load.tip_force));
        for (i, tension) in load.tensions.iter().enumerate() {
            work -= tension * (up.tendon_length(i).unwrap() - down.tendon_length(i).unwrap());
        }
        for (k, force) in load.disk_forces.iter().enumerate() {
            work += moved(&|s| s.disk(k).unwrap().position).dot(Vec3(*force));
        }
        for own in &load.point_loads {
            let place = |s: &Solver| {
                let disk = s.disk(own.disk).unwrap();
                disk.position + disk.rotation * Vec3(own.point)
            };
            work += moved(&place).dot(Vec3(own.force));
        }
        assert!(work > 1e-4, "{work:e}");
        let off = (high - low) / work - 1.0;
        below(off.abs(), 1e-5, &format!("case {number}"));
    }
}

/// Small motions about the equilibrium respond to a force on a disk as statics does.
fn flexibilities(row: Row, count: usize) {
    for number in 0..count {
        let case = row(number);
        let robot = Robot::new(case.spec.clone()).unwrap();
        let (_, found) = flexibility(&robot, case.model, 1, &case.load.borrow()).unwrap();
        let mut found = found.unwrap();
        // translation of a disk after that of the inner points, rotation after it
        let place = |k: usize| k * (3 * found.points + 3) + 3 * (found.points - 1);
        let places: Vec<_> = (0..robot.module_count()).map(place).collect();
        let mut forces = vec![0.0; found.masses.len()];
        forces[places[4]] = 1.0;
        let moved = found.apply(&forces);
        let [exact] = slopes(|force| {
            let mut case = case.clone();
            case.load.disk_forces.resize(places.len(), [0.0; 3]);
            case.load.disk_forces[4][0] += force;
            let poses = disks(&at_rest(&case, 1).unwrap().0).into_iter();
            [poses.flat_map(|pose| pose.position.0).collect()]
        });
        let most = 2e-4 * norm(&exact[exact.len() - 3..]);
        for (i, exact) in exact.iter().enumerate() {
            let (disk, axis) = (i / 3, i % 3);
            let off = (moved[places[disk] + axis] - exact).abs();
            below(off, most, &format!("case {number}, disk {disk}"));
        }
    }
}

/// Many rows in one call, in lanes and in sequence, with the loads of the disks those of a row or
/// of all rows, equal single solves: to a share of the length `cold` from straight, `warm` each from
/// the one before, where rows may take other numbers of elements and, unless `same_failures`, fail
/// for other reasons.
fn batches(row: Row, count: usize, [cold, warm]: [f64; 2], same_failures: bool) {
    const ROWS: usize = 30;
    for (number, common) in (0..count).flat_map(|number| [(number, true), (number, false)]) {
        let case = row(number);
        let load = &case.load;
        if !common && load.disk_forces.is_empty() {
            continue;
        }
        let robot = Robot::new(case.spec.clone()).unwrap();
        let (n, m) = (robot.module_count(), robot.tendon_count());
        let share = |i: usize| i as f64 / ROWS as f64;
        let tensions = (0..ROWS).flat_map(|i| load.tensions.iter().map(move |t| t * share(i)));
        let tensions: Vec<f64> = tensions.collect();
        let each = |vectors: &[[f64; 3]]| match common {
            true => vectors.to_vec(),
            false => {
                let rows = (0..ROWS).map(|i| share(7 * i % ROWS));
                rows.flat_map(|by| vectors.iter().map(move |v| v.map(|x| by * x)))
                    .collect()
            }
        };
        let on_disks = [&load.disk_forces, &load.disk_moments].map(|vectors| each(vectors));
        let loads = Loads {
            count: ROWS,
            tensions: &tensions,
            gravity: &load.gravity,
            tip_force: &load.tip_force,
            tip_moment: &load.tip_moment,
            disks: n,
            disk_forces: &on_disks[0],
            disk_moments: &on_disks[1],
            point_loads: &load.point_loads,
            line_forces: &load.line_forces,
        };
        let model = RodModel {
            model: case.model,
            elements: None,
        };
        let mut found = vec![
            ("batch", solve_batch(&robot, &model, &loads, 2, true)),
            ("sweep", sweep(&robot, &model, &loads, true, true)),
        ];
        if number < 2 {
            let designs = vec![robot.clone(); 3];
            found.push(("designs", sweep_designs(&designs, &model, &loads, 1)));
        }
        let mut solver = Adaptive::of(&robot, &model).unwrap();
        for i in 0..ROWS {
            let outcome = solver.solve(&loads.row(i, m)).unwrap();
            let alone = outcome.status == Status::Converged;
            for (name, found) in &found {
                let (found, at) = (
                    found.as_ref().unwrap(),
                    format!("case {number}, row {i} of the {name}"),
                );
                let same = &found.outcomes[i];
                assert_eq!(same.status == Status::Converged, alone, "{at}");
                if *name == "batch" {
                    assert_eq!(
                        (same.status, same.stable),
                        (outcome.status, outcome.stable),
                        "{at}"
                    );
                } else if same_failures {
                    assert_eq!(same.status, outcome.status, "{at}");
                }
                if !alone {
                    continue;
                }
                let most = if *name == "batch" { cold } else { warm };
                let (tip, all) = (&found.tip_position[3 * i..][..3], &found.disk_position);
                let places = if all.is_empty() {
                    tip
                } else {
                    &all[3 * n * i..][..3 * n]
                };
                for (place, pose) in places
                    .chunks(3)
                    .rev()
                    .zip(disks(solver.solver()).iter().rev())
                {
                    let off = (Vec3([place[0], place[1], place[2]]) - pose.position).norm();
                    below(off, most * robot.length(), &at);
                }
            }
        }
    }
}

fn simulator(case: &Case, elements: usize, settings: Integrator) -> Simulator {
    let settings = Integrator {
        gravity: case.load.gravity,
        ..settings
    };
    let robot = Robot::new(case.spec.clone()).unwrap();
    Simulator::new(&robot, case.model, elements, settings).unwrap()
}

/// A robot rests under its loads, a damped one comes to rest there, and work balances energy.
fn motion(row: Row, count: usize, elements: &[usize]) {
    for (number, elements) in pairs(count, elements) {
        let case = row(number);
        let load = case.load.borrow();
        let exact = at_rest(&case, elements).unwrap().0.tip().unwrap().position;
        let mut rest = simulator(&case, elements, fixed_steps(5e-3, 1.0));
        rest.rest(&load).unwrap();
        assert!(rest.is_ready());
        let start = rest.tip();
        // gravity by Simpson's rule here, by Hermite's in statics; the Kirchhoff rod without the
        // quadratic part of its strain in inertia
        let off = (start - exact).norm();
        below(off, 2e-6, &format!("case {number}"));
        go(&mut rest, 1.0, &load);
        let off = (rest.tip() - start).norm();
        below(off, 1e-8, &format!("case {number}"));

        let mut settings = fixed_steps(5e-3, 0.8);
        (settings.damping.mass, settings.damping.material) = (15.0, 1e-3);
        let mut moving = simulator(&case, elements, settings);
        moving.rest(&by_tensions(&[0.0; 3])).unwrap();
        let before = moving.energies().left();
        go(&mut moving, 0.2, &load);
        let (work, gained) = (moving.energies().work, moving.energies().left() - before);
        assert!(
            gained.abs() < 1e-2 * work.abs(),
            "case {number}: {gained:e} of {work:e}"
        );
        go(&mut moving, 6.0, &load);
        let off = (moving.tip() - exact).norm();
        below(off, 3e-6, &format!("case {number}"));
    }
}

/// Robot and load turned together turn the motion after a tip force is removed.
fn motion_turns(row: Row, count: usize) {
    for number in 0..count {
        let end = |case: &Case| {
            let mut moving = simulator(case, 1, fixed_steps(2e-3, 1.0));
            moving.rest(&case.load.borrow()).unwrap();
            let without = Load {
                tip_force: [0.0; 3],
                ..case.load.borrow()
            };
            moving.jump(&without).unwrap();
            go(&mut moving, 0.3, &without);
            moving.tip()
        };
        let (case, turn) = (row(number), lie::exp(Vec3([0.0, 0.0, 2.1])));
        let off = (turn * end(&case) - end(&turned(case, 2.1))).norm();
        below(off, 1e-7, &format!("case {number}"));
    }
}

/// Under displacement control the tensions found hold the same pose; steps with friction, from a
/// load to none, equal those in one call, and steps from home those in lanes.
fn paths(row: Row, count: usize) {
    let shortened = [0.012, -0.004, -0.006];
    let commands = shortened.map(Command::Displacement);
    for number in 0..count {
        let mut case = row(number);
        case.load.tensions.clear();
        let robot = Robot::new(case.spec.clone()).unwrap();
        let path = |friction: f64| {
            let line = Line {
                stiffness: 2e4,
                friction,
                pretension: 2.0,
                ..Line::default()
            };
            PathSolver::new(&robot, case.model, 1, &[line; 3]).unwrap()
        };
        let converged = |path: &mut PathSolver, load: &OwnedLoad| {
            let outcome = path.step(&commands, &load.borrow()).unwrap();
            assert_eq!(outcome.status, Status::Converged);
            disks(path.solver())
        };
        let mut smooth = path(0.0);
        let exact = converged(&mut smooth, &case.load);
        assert_eq!(smooth.history().load, case.load);
        let mut held = case.clone();
        held.load.tensions.clone_from(&smooth.history().tensions);
        let off = apart(&disks(&at_rest(&held, 1).unwrap().0), &exact);
        assert!(off < 1e-8, "{off:e}");
        smooth.reset();
        // the disks move without the load
        assert!(apart(&converged(&mut smooth, &OwnedLoad::default()), &exact) > 1e-3);

        let load = &case.load;
        let mut then = load.clone();
        then.scale(0.0, 0.0);
        (then.point_loads, then.line_forces) = (load.point_loads.clone(), load.line_forces.clone());
        let mut rough = path(0.2);
        let first = converged(&mut rough, load);
        let last = converged(&mut rough, &then);
        let on_disks = [&load.disk_forces, &load.disk_moments].map(|v| {
            let none = vec![[0.0; 3]; v.len()];
            [v.as_slice(), &none].concat()
        });
        let steps = Steps {
            durations: &[],
            guesses: None,
            loads: Loads {
                count: 2,
                tensions: &shortened.repeat(2),
                gravity: &[load.gravity, then.gravity].concat(),
                tip_force: &[load.tip_force, then.tip_force].concat(),
                tip_moment: &[load.tip_moment, then.tip_moment].concat(),
                disks: 9,
                disk_forces: &on_disks[0],
                disk_moments: &on_disks[1],
                point_loads: &load.point_loads,
                line_forces: &load.line_forces,
            },
            by_displacement: &[true; 6],
        };
        let followed = follow(&mut path(0.2), &steps, true).unwrap();
        let each = solve_each(&mut path(0.0), &steps, 1, true).unwrap();
        for (places, exact, most) in [
            (&followed.poses.disk_position[..27], first, 1e-9),
            (&followed.poses.disk_position[27..], last, 1e-9),
            (&each.poses.disk_position[..27], exact, 1e-8),
        ] {
            for (place, pose) in places.chunks(3).zip(exact) {
                let off = (Vec3([place[0], place[1], place[2]]) - pose.position).norm();
                assert!(off < most, "{off:e}");
            }
        }
    }
}

/// Held forces on disks add to those of the load, and leave them when they are released.
fn held_forces(row: Row, count: usize) {
    for number in 0..count {
        let case = row(number);
        let held: Vec<_> = (0..9)
            .map(|k| [0.3, -0.2, 0.1].map(|f| f * f64::cos(k as f64)))
            .collect();
        let mut both = case.load.clone();
        both.disk_forces.resize(9, [0.0; 3]);
        for (to, from) in both
            .disk_forces
            .iter_mut()
            .flatten()
            .zip(held.iter().flatten())
        {
            *to += from;
        }
        let mut simulator = simulator(&case, 1, fixed_steps(5e-3, 1.0));
        let [exact, alone] = [&both, &case.load].map(|load| {
            simulator.rest(&load.borrow()).unwrap();
            simulator.tip()
        });
        assert!((exact - alone).norm() > 1e-3);
        assert_eq!(simulator.rest_with_disk_forces(&held, 3).unwrap(), None);
        assert!((simulator.tip() - exact).norm() < 1e-9);
        simulator.release_disk_forces();
        simulator.rest(&case.load.borrow()).unwrap();
        assert!((simulator.tip() - alone).norm() < 1e-12);
    }
}

/// Bad robots and loads are refused with a sentence that names the place.
#[test]
fn refusals() {
    type Change = fn(&mut Case);
    let refused: [(&str, Change); 13] = [
        (
            "dead force has 4 entries, it must have 9, one for each disk",
            |c| c.load.disk_forces.truncate(4),
        ),
        (
            "dead moment of disk 3 is [0.0, NaN, 0.0] N m, it must be finite",
            |c| c.load.disk_moments[2] = [0.0, f64::NAN, 0.0],
        ),
        ("force per length has 4 entries, it must have 9", |c| {
            c.load.line_forces = vec![[0.0; 3]; 4]
        }),
        (
            "point load 1 acts on disk 10, and the robot has 9 disks",
            |c| c.load.point_loads[0].disk = 9,
        ),
        (
            "of point load 1 is [NaN, 0.0, 0.0], it must be finite",
            |c| c.load.point_loads[0].point[0] = f64::NAN,
        ),
        ("tendon 2 has 4 holes", |c| {
            c.spec.tendons[1].holes = vec![[0.02, 0.0]; 4]
        }),
        ("tendon 2 has 0 holes", |c| c.spec.tendons[1].holes.clear()),
        ("hole position of tendon 2 is [NaN, 0.0] m", |c| {
            c.spec.tendons[1].holes = vec![[f64::NAN, 0.0]; 10]
        }),
        (
            "curvature without load of segment 1 is [0.0, NaN, 0.0] 1/m",
            |c| section(c).rest_curvature[1] = f64::NAN,
        ),
        (
            "bending stiffness of segment 1 is 0 N m^2, it must be positive",
            |c| section(c).bending[1] = 0.0,
        ),
        (
            "angle of the principal axes of segment 1 is [NaN] rad",
            |c| section(c).principal_angle = f64::NAN,
        ),
        ("moments of inertia of payload 1", |c| {
            c.spec.payloads = vec![Payload {
                disk: 0,
                mass: 0.1,
                centre: [0.0; 3],
                inertia: [1e-6, 1e-6, 3e-6],
            }]
        }),
        // positive at the five places, but not between them
        ("torsion stiffness of segment 1 is -0.07", |c| {
            let mut sections = [*section(c); 5];
            sections[1].torsion *= 1e-3;
            sections[3].torsion *= 1e-3;
            c.spec.backbone[0] = Profile::Tapered(Box::new(sections));
        }),
    ];
    fn section(case: &mut Case) -> &mut Section {
        &mut case.spec.backbone[0].sections_mut()[0]
    }
    for (text, change) in refused {
        let mut case = rows::disk_moments(0);
        case.load.point_loads.push(PointLoad::default());
        let found = |case: &Case| {
            let mut solver = Solver::new(&Robot::new(case.spec.clone())?, case.model, 1)?;
            solver.solve(&case.load.borrow())
        };
        assert!(found(&case).is_ok());
        change(&mut case);
        let error = found(&case).expect_err(text).to_string();
        assert!(error.contains(text), "{error}");
    }
}
