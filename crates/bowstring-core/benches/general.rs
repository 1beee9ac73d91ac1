//! Time of a static solve with general routing, sections and loads over that of the plain robot, and
//! of a branch diagram of 400 points, on one core.
//!
//! The plain robot is that of the study, with three tendons under tension, gravity and a transverse
//! tip force. Every other case changes one thing, the last two all of them. All are solved from
//! straight, so that their times also count their Newton iterations. Ratios are of the fastest of
//! many repetitions that take turns, because other work on the machine can only lengthen them.

#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::model::load::{Model, OwnedLoad, RodModel, Theory};
use bowstring_core::model::robot::{Profile, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::branches::{diagram, Diagram, LoadPath, Search};
use bowstring_core::statics::solver::{Solver, Status};
use common::{section, study_robot};
use criterion::{criterion_group, criterion_main, Criterion};
use std::f64::consts::{PI, TAU};
use std::time::{Duration, Instant};

const DISKS: usize = 9;
const TENSIONS: [f64; 3] = [80.0, 10.0, 5.0];

/// A robot and its load.
struct Case {
    name: &'static str,
    robot: Robot,
    load: OwnedLoad,
}

/// A change of the plain robot or of its load.
type Change = fn(&mut RobotSpec, &mut OwnedLoad);

impl Case {
    fn new(name: &'static str, changes: &[Change]) -> Self {
        let mut spec = study_robot(DISKS, 0.0).spec().clone();
        let mut load = OwnedLoad {
            tensions: TENSIONS.to_vec(),
            gravity: [0.0, 0.0, -9.81],
            tip_force: [0.0, 1.0, 0.0],
            ..OwnedLoad::default()
        };
        for change in changes {
            change(&mut spec, &mut load);
        }
        let robot = Robot::new(spec).unwrap();
        Case { name, robot, load }
    }
}

/// A sixth of a turn, converging to 70 % of the pitch radius.
fn oblique(spec: &mut RobotSpec, _: &mut OwnedLoad) {
    for tendon in &mut spec.tendons {
        let [x, y] = tendon.holes[0];
        let place = |k: usize| {
            let share = k as f64 / DISKS as f64;
            let (sin, cos) = (TAU / 6.0 * share).sin_cos();
            let size = 1.0 - 0.3 * share;
            [size * (cos * x - sin * y), size * (sin * x + cos * y)]
        };
        *tendon = Tendon::new((0..=DISKS).map(place).collect(), DISKS - 1);
    }
}

/// From 5.5 to 4.5 mm.
fn tapered(spec: &mut RobotSpec, _: &mut OwnedLoad) {
    let at = |i: usize| section(0.0055 - 0.00025 * i as f64, 35e9, 0.3, 1800.0);
    spec.backbone = vec![Profile::Tapered(Box::new(std::array::from_fn(at)))];
}

fn each_section(spec: &mut RobotSpec, change: impl Fn(&mut Section)) {
    let profiles = spec.backbone.iter_mut();
    profiles.flat_map(Profile::sections_mut).for_each(change);
}

/// Two bending stiffnesses, turned from the axes.
fn rectangular(spec: &mut RobotSpec, _: &mut OwnedLoad) {
    each_section(spec, |s| {
        s.bending[1] *= 1.5;
        s.principal_angle = 0.4;
    });
}

fn precurved(spec: &mut RobotSpec, _: &mut OwnedLoad) {
    each_section(spec, |s| s.rest_curvature = [0.3, 0.5, 0.4]);
}

fn disk_forces(_: &mut RobotSpec, load: &mut OwnedLoad) {
    let on = |k: usize| [0.1, 0.02 * k as f64, -0.3];
    load.disk_forces = (0..DISKS).map(on).collect();
}

/// Moments have no potential: stability is that of small motions.
fn disk_moments(_: &mut RobotSpec, load: &mut OwnedLoad) {
    let on = |k: usize| [2e-4, -1e-4 * k as f64, 1e-4];
    load.disk_moments = (0..DISKS).map(on).collect();
}

fn cases() -> Vec<Case> {
    let all: [Change; 6] = [
        oblique,
        tapered,
        rectangular,
        precurved,
        disk_forces,
        disk_moments,
    ];
    vec![
        Case::new("plain", &[]),
        Case::new("oblique", &[oblique]),
        Case::new("tapered", &[tapered]),
        Case::new("rectangular", &[rectangular]),
        Case::new("precurved", &[precurved]),
        Case::new("disk_forces", &[disk_forces]),
        Case::new("disk_moments", &[disk_moments]),
        Case::new("all", &all[..5]),
        Case::new("all_and_moments", &all),
    ]
}

/// Shortest time of a call of each function (s), in turns.
fn fastest(calls: &mut [Box<dyn FnMut() + '_>]) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; calls.len()];
    for _ in 0..400 {
        for (call, least) in calls.iter_mut().zip(&mut least) {
            let start = Instant::now();
            for _ in 0..20 {
                call();
            }
            *least = f64::min(*least, start.elapsed().as_secs_f64() / 20.0);
        }
    }
    least
}

fn solves(c: &mut Criterion) {
    for (theory, name) in [
        (Theory::Kirchhoff, "kirchhoff"),
        (Theory::Cosserat, "cosserat"),
    ] {
        let model = Model {
            theory,
            ..Model::default()
        };
        let cases = cases();
        let mut solvers: Vec<_> = cases
            .iter()
            .map(|case| Solver::new(&case.robot, model, 1).unwrap())
            .collect();
        let mut iterations = vec![];
        for (solver, case) in solvers.iter_mut().zip(&cases) {
            let outcome = solver.solve(&case.load.borrow()).unwrap();
            assert_eq!(outcome.status, Status::Converged, "{}", case.name);
            assert_eq!(outcome.stable, Some(true), "{}", case.name);
            iterations.push(outcome.iterations);
        }
        let mut calls: Vec<Box<dyn FnMut()>> = vec![];
        for (solver, case) in solvers.iter_mut().zip(&cases) {
            calls.push(Box::new(|| {
                solver.solve(&case.load.borrow()).unwrap();
            }));
        }
        let times = fastest(&mut calls);
        drop(calls);
        for ((case, time), count) in cases.iter().zip(&times).zip(&iterations) {
            println!(
                "{name} {:16} {:6.2} us, {:.2} of plain, {count} iterations",
                case.name,
                1e6 * time,
                time / times[0],
            );
        }
        let mut group = c.benchmark_group(format!("general_{name}"));
        for (solver, case) in solvers.iter_mut().zip(&cases) {
            let load = case.load.borrow();
            group.bench_function(case.name, |b| b.iter(|| solver.solve(&load).unwrap()));
        }
        group.finish();
    }
}

/// Diagram of the study's robot under three times Euler's load, with a tension and a transverse
/// force so that no branch has a symmetry: one branch from the unloaded robot, and one with a limit
/// point that only deflation finds.
fn branch_diagram(elements: Option<usize>, search: &Search) -> Diagram {
    let robot = study_robot(DISKS, 0.0);
    let bending = robot.spec().backbone[0].sections()[0].bending[0];
    let euler = PI * PI * bending / (4.0 * robot.length().powi(2));
    let from = OwnedLoad {
        tensions: vec![0.0; 3],
        ..OwnedLoad::default()
    };
    let to = OwnedLoad {
        tensions: vec![4.0, 0.0, 0.0],
        tip_force: [0.0, 0.02 * euler, -3.0 * euler],
        ..from.clone()
    };
    let model = RodModel {
        elements,
        ..RodModel::default()
    };
    diagram(&robot, &model, &LoadPath { from, to }, search).unwrap()
}

/// Steps are chosen for about 400 points.
fn branches(c: &mut Criterion) {
    let mut group = c.benchmark_group("diagram_400_points");
    group.sample_size(10);
    for (name, elements, deflation, step) in [
        ("one_element", Some(1), false, 0.022),
        ("one_element_deflation", Some(1), true, 0.05),
        ("chosen_elements", None, false, 0.022),
        ("chosen_elements_deflation", None, true, 0.05),
    ] {
        let search = Search {
            deflation,
            step,
            ..Search::default()
        };
        let found = branch_diagram(elements, &search);
        let points: usize = found.branches.iter().map(|b| b.points.len()).sum();
        let least = (0..5).map(|_| {
            let start = Instant::now();
            branch_diagram(elements, &search);
            start.elapsed().as_secs_f64()
        });
        println!(
            "{name}: {:.1} ms, {points} points, {} branches, {} elements",
            1e3 * least.fold(f64::INFINITY, f64::min),
            found.branches.len(),
            found.elements,
        );
        group.bench_function(name, |b| b.iter(|| branch_diagram(elements, &search)));
    }
    group.finish();
}

criterion_group! {
    name = group;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    targets = solves, branches
}
criterion_main!(group);
