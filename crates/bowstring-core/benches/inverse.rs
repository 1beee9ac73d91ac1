//! Time of an inverse for a tip position on one core: targets without a start, and rows of a path.
//!
//! Targets are tips of forward solves with tensions up to a quarter turn of each segment by the
//! linear law. The tensions of the path are splines through random ones, so that targets move
//! steadily. The third case is a path whose targets lie beyond reach, with the default margin.
//!
//! Arguments: names of robots, and `rows=N` for the length of the path (10000 by default). Without
//! `--bench`, which `cargo bench` adds, it is a test and takes few targets and rows.

#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::model::load::{Load, Model, RodModel};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Tendon};
use bowstring_core::statics::inverse::{InverseSolver, InverseStatus, Limits, Target};
use bowstring_core::statics::solver::{Solver, Status};
use common::{rao_robot, section, study_robot, Draw};
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

/// Targets without a start.
const TARGETS: usize = 3000;
/// Rows from one random control point of the path to the next.
const ROWS_PER_POINT: usize = 50;
/// Outward shift of the unreachable path over the robot's length.
const BEYOND: f64 = 0.3;
/// Permitted distance beyond that of the nearest tip, over the length.
const MARGIN: f64 = 1e-3;

/// FTDCR v4 of the Continuum Robotics Laboratory, Toronto: three segments, nine tendons.
fn crl_robot() -> Robot {
    let lengths = [0.06, 0.0625, 0.064];
    let bases = [0.0, 0.06, 0.1225];
    let disks = (0..30).map(|k| Disk {
        hole_length: 0.0,
        station: bases[k / 10] + lengths[k / 10] * (k % 10 + 1) as f64 / 10.0,
        clamped_length: 0.0,
        mass: 1.5e-4,
        inertia: [1e-9, 2e-9],
        segment: k / 10,
    });
    let first_angles = [-3.0589f64, -2.5615, -2.0506];
    let tendons = (0..9).map(|i| {
        let angle = first_angles[i / 3] + [0.0, 120.0f64, 240.0][i % 3].to_radians();
        Tendon {
            holes: vec![[0.0045 * angle.cos(), 0.0045 * angle.sin()]],
            end_disk: 10 * (i / 3) + 9,
            pushes: false,
        }
    });
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section(0.001, 50e9, 0.3, 6450.0).into(); 3],
        disks: disks.collect(),
        tendons: tendons.collect(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

/// Tensions that bend each tendon's segment by a quarter turn by the linear law (N), for a bending
/// stiffness.
fn largest_tensions(robot: &Robot, stiffness: f64) -> Vec<f64> {
    let spec = robot.spec();
    let largest = spec.tendons.iter().map(|tendon| {
        let disk = tendon.end_disk;
        let segment = spec.disks[disk].segment;
        let before = spec.disks.iter().rev().find(|d| d.segment < segment);
        let length = spec.disks[disk].station - before.map_or(0.0, |d| d.station);
        let [x, y] = tendon.hole(0);
        FRAC_PI_2 * stiffness / (length * x.hypot(y))
    });
    largest.collect()
}

/// Tips of forward solves; those that do not converge are left out.
fn tips(robot: &Robot, tensions: impl Iterator<Item = Vec<f64>>) -> Vec<[f64; 3]> {
    let mut solver = Solver::new(robot, Model::default(), 4).unwrap();
    let mut found = vec![];
    for tensions in tensions {
        let load = Load {
            tensions: &tensions,
            ..Load::default()
        };
        if solver.solve(&load).unwrap().status == Status::Converged {
            found.push(solver.tip().unwrap().position.0);
        }
    }
    found
}

/// Cubic B-splines with random control points, which stay within their range.
fn smooth_tensions(most: &[f64], rows: usize) -> impl Iterator<Item = Vec<f64>> + '_ {
    let mut draw = Draw(7);
    let points: Vec<Vec<f64>> = (0..rows / ROWS_PER_POINT + 4)
        .map(|_| most.iter().map(|m| draw.within(0.0, 0.8 * m)).collect())
        .collect();
    (0..rows).map(move |row| {
        let at = row / ROWS_PER_POINT;
        let t = (row % ROWS_PER_POINT) as f64 / ROWS_PER_POINT as f64;
        let weights = [
            (1.0 - t).powi(3) / 6.0,
            (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
            (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
            t.powi(3) / 6.0,
        ];
        let tendon = |i: usize| (0..4).map(|k| weights[k] * points[at + k][i]).sum();
        (0..most.len()).map(tendon).collect()
    })
}

fn measure(name: &str, case: &str, robot: &Robot, targets: &[[f64; 3]], most: &[f64], warm: bool) {
    let mut solver = InverseSolver::new(robot, RodModel::default(), MARGIN).unwrap();
    let least = vec![0.0; most.len()];
    let limits = Limits {
        least: &least,
        most,
    };
    let (mut times, mut iterations, mut reached, mut restarted) = (vec![], 0, 0, 0);
    let (mut squares, mut farthest, mut distance) = (0.0, 0.0_f64, 0.0);
    for position in targets {
        let target = Target {
            position: *position,
            direction: None,
        };
        let start = Instant::now();
        let found = solver.solve(&Load::default(), &target, &limits, warm);
        times.push(1e3 * start.elapsed().as_secs_f64());
        iterations += found.iterations;
        distance += found.nearest;
        farthest = farthest.max(found.nearest);
        reached += usize::from(found.status == InverseStatus::Reached);
        restarted += usize::from(found.restarted);
        squares += solver.tensions().iter().map(|t| t * t).sum::<f64>();
    }
    let count = targets.len() as f64;
    let mean = times.iter().sum::<f64>() / count;
    times.sort_by(f64::total_cmp);
    let [half, most, nearly, last] =
        [0.5, 0.95, 0.99, 0.999].map(|p| times[(p * (count - 1.0)) as usize]);
    println!(
        "{name:12} {case:12} ms: mean {mean:.3} median {half:.3} 95 % {most:.3} 99 % {nearly:.3} \
         99.9 % {last:.3}; {:.2} iterations; reached {reached} of {}, {restarted} restarted; mean \
         |T|^2 {:.6} N^2, distance {:.6} mm, {:.6} at most",
        iterations as f64 / count,
        targets.len(),
        squares / count,
        1e3 * distance / count,
        1e3 * farthest,
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let rows = arguments.iter().find_map(|a| a.strip_prefix("rows="));
    let as_test = !arguments.iter().any(|a| a == "--bench");
    let (targets, most_rows) = if as_test { (5, 10) } else { (TARGETS, 10_000) };
    let rows = rows.map_or(most_rows, |n| n.parse().expect("rows=N needs a number"));
    let chosen: Vec<_> = arguments
        .iter()
        .filter(|a| !a.contains(['=', '-']))
        .collect();
    for (name, robot, section) in [
        (
            "amouri2019",
            study_robot(9, 0.0),
            section(0.005, 35e9, 0.3, 0.0),
        ),
        ("rao2021", rao_robot(), section(0.0014, 54e9, 0.3, 0.0)),
        ("crl", crl_robot(), section(0.001, 50e9, 0.3, 0.0)),
    ] {
        if !(chosen.is_empty() || chosen.iter().any(|c| *c == name)) {
            continue;
        }
        let most = largest_tensions(&robot, section.bending[0]);
        let mut draw = Draw(1);
        let random = (0..targets).map(|_| most.iter().map(|m| draw.within(0.0, *m)).collect());
        let cold = tips(&robot, random);
        measure(name, "cold", &robot, &cold, &most, false);
        let path = tips(&robot, smooth_tensions(&most, rows));
        measure(name, "path", &robot, &path, &most, true);
        let beyond = path.iter().take(1000.min(rows)).map(|p| {
            let [x, y, z] = *p;
            let out = BEYOND * robot.length() / x.hypot(y).hypot(z);
            [x, y, z].map(|x| x * (1.0 + out))
        });
        measure(
            name,
            "unreachable",
            &robot,
            &beyond.collect::<Vec<_>>(),
            &most,
            true,
        );
    }
}
