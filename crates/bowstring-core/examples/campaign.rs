//! Millions of random solves: no panic, no NaN, no solution with a larger error than stated.
//!
//! `cargo run --release -p bowstring-core --example campaign -- SOLVES [STATE]`
//!
//! Robots are drawn one after the other, each under several loads; every solution is checked:
//!
//! - each number is finite, and the residual is below its tolerance;
//! - a batch gives the same as single solves;
//! - eight elements in a module, started from the solution's strain, move no disk by more than
//!   the stated error;
//! - the poses of these satisfy the rod's differential equations, integrated under the wrench
//!   that tendons and loads exert on the backbone, independently of the solver's residual.
//!
//! Counts are saved in STATE (default `target/campaign.txt`) after every thousand robots and at the
//! end; a further run continues from there.

#[path = "../tests/common/cases.rs"]
mod cases;
#[path = "../tests/common/mod.rs"]
mod common;

use bowstring_core::model::load::{Load, RodModel, TendonPath};
use bowstring_core::model::robot::Robot;
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{solve_batch, Solutions};
use bowstring_core::statics::loads::Loads;
use bowstring_core::statics::solver::{Outcome, Solver, Status, TOLERANCE};
use cases::{hostile, Case, Draw};
use std::io::Write;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Loads of a realistic robot, and of a hostile one, most of whose loads have no equilibrium and
/// take about as long as a thousand others each.
const LOADS: usize = 64;
const HOSTILE_LOADS: usize = 2;
/// Fraction of hostile robots.
const HOSTILE: f64 = 0.1;
/// Most robots between two saves of the state.
const CHUNK: usize = 1000;
/// Loads of a robot that are also solved with eight elements.
const COMPARED: usize = 2;
/// Negligible gap of a module, over its length or in rad.
const BALANCED: f64 = 1e-3;

/// Names and values of the counters.
macro_rules! counts {
    ($($name:ident: $text:literal),* $(,)?) => {
        #[derive(Clone, Copy, Debug, Default)]
        struct Counts {
            $($name: u64,)*
        }

        impl Counts {
            const TEXTS: &'static [&'static str] = &[$($text),*];

            fn values(&self) -> Vec<u64> {
                vec![$(self.$name),*]
            }

            fn from_values(values: &[u64]) -> Self {
                let mut next = values.iter().copied();
                Counts { $($name: next.next().unwrap_or(0)),* }
            }

            fn add(&mut self, other: &Self) {
                $(self.$name += other.$name;)*
            }
        }
    };
}

counts! {
    robots: "robots drawn",
    refused: "refused, with a sentence",
    solves: "solves",
    converged: "converged",
    panics: "panics",
    nan: "converged with a number that is none",
    residual: "converged above the tolerance",
    batch: "batch and single solve apart",
    unconfirmed: "not confirmed by eight elements",
    checked: "integrated from the outside",
    unchecked: "too taut or too soft to be",
    unbalanced: "not balanced",
    compared: "compared with eight elements",
    no_reference: "no better known by those",
    beyond: "off by more than stated",
    uncertain: "stated to be less exact than 1e-5 of length",
    unbounded: "stated to have no bound",
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let target: u64 = match arguments.next().map(|text| text.parse()) {
        Some(Ok(n)) => n,
        _ => {
            eprintln!("campaign: give the number of solves, such as 1000000");
            std::process::exit(2);
        }
    };
    let path = arguments.next().unwrap_or("target/campaign.txt".into());
    let (mut total, mut first) = read(&path);
    std::panic::set_hook(Box::new(|panic| eprintln!("\n{panic}")));
    let begun = Instant::now();
    let before = total.solves;
    while total.solves < target {
        let missing = (target - total.solves).div_ceil(LOADS as u64);
        let chunk = CHUNK.min(missing.try_into().unwrap_or(CHUNK));
        let next = AtomicUsize::new(first);
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        let parts: Vec<Counts> = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .map(|_| {
                    scope.spawn(|| {
                        let mut counts = Counts::default();
                        loop {
                            let number = next.fetch_add(1, Ordering::Relaxed);
                            if number >= first + chunk {
                                return counts;
                            }
                            counts.add(&robot(number));
                        }
                    })
                })
                .collect();
            workers.into_iter().map(|w| w.join().unwrap()).collect()
        });
        for part in &parts {
            total.add(part);
        }
        first += chunk;
        write(&path, &total, first);
        let rate = (total.solves - before) as f64 / begun.elapsed().as_secs_f64();
        eprint!(
            "\r{} of {target} solves, {rate:.0} a second; {} panics, {} off by more than stated ",
            total.solves, total.panics, total.beyond
        );
    }
    eprintln!();
    for (text, value) in Counts::TEXTS.iter().zip(total.values()) {
        println!("{value:>12}  {text}");
    }
    let broken =
        total.panics + total.nan + total.residual + total.batch + total.beyond + total.unbalanced;
    std::process::exit(i32::from(broken > 0));
}

fn read(path: &str) -> (Counts, usize) {
    let Ok(text) = std::fs::read_to_string(path) else {
        return Default::default();
    };
    let numbers: Vec<u64> = text.split_whitespace().flat_map(|w| w.parse()).collect();
    if numbers.len() != 1 + Counts::TEXTS.len() {
        eprintln!("campaign: {path} holds no state of this campaign; remove it to begin anew");
        std::process::exit(2);
    }
    (Counts::from_values(&numbers[1..]), numbers[0] as usize)
}

/// Writes the state atomically.
fn write(path: &str, counts: &Counts, first: usize) {
    let values = counts
        .values()
        .iter()
        .map(u64::to_string)
        .collect::<Vec<_>>();
    let draft = format!("{path}.part");
    let done = std::fs::File::create(&draft)
        .and_then(|mut file| writeln!(file, "{first} {}", values.join(" ")))
        .and_then(|()| std::fs::rename(&draft, path));
    if let Err(error) = done {
        eprintln!("campaign: {path}: {error}");
        std::process::exit(1);
    }
}

/// One robot under all its loads.
fn robot(number: usize) -> Counts {
    let mut counts = Counts {
        robots: 1,
        ..Counts::default()
    };
    let done = catch_unwind(AssertUnwindSafe(|| trial(number)));
    match done {
        Ok(found) => counts.add(&found),
        Err(_) => {
            counts.panics = 1;
            eprintln!("\nrobot {number}: panic");
        }
    }
    counts
}

fn trial(number: usize) -> Counts {
    let mut counts = Counts::default();
    let mut draw = Draw::new(28, number);
    let hard = draw.often(HOSTILE);
    let mut case = if hard {
        hostile(&mut draw)
    } else {
        Case::realistic(&mut draw)
    };
    if !hard {
        case = varied(case, &mut draw);
    }
    let Ok(robot) = Robot::new(case.spec.clone()) else {
        counts.refused += 1;
        return counts;
    };
    let tendons = robot.tendon_count();
    if !hard && draw.often(0.05) {
        let [first, ..] = &case.spec.backbone[..] else {
            unreachable!("a robot has a section")
        };
        let size = first.sections()[0].bending[0] / robot.length() * draw.within(0.0, 1.0);
        case.load.tip_moment = (draw.direction() * size).0;
    }
    // each tension, tip force and moment a fraction of the drawn value
    let (mut tensions, mut forces, mut moments) = (vec![], vec![], vec![]);
    let count = if hard { HOSTILE_LOADS } else { LOADS };
    for _ in 0..count {
        tensions.extend(case.load.tensions.iter().map(|t| t * draw.within(0.0, 1.0)));
        let share = draw.within(0.0, 1.0);
        forces.extend(case.load.tip_force.map(|f| f * share));
        moments.extend(case.load.tip_moment.map(|m| m * share));
    }
    let loads = Loads {
        count,
        tensions: &tensions,
        gravity: &case.load.gravity,
        tip_force: &forces,
        tip_moment: &moments,
        point_loads: &case.load.point_loads,
        ..Loads::default()
    };
    let settings = RodModel {
        model: case.model,
        elements: None,
    };
    let Ok(found) = solve_batch(&robot, &settings, &loads, 1, false) else {
        counts.refused += 1;
        return counts;
    };
    counts.solves += count as u64;
    let length = robot.length();
    for (i, outcome) in found.outcomes.iter().enumerate() {
        if outcome.status != Status::Converged {
            continue;
        }
        counts.converged += 1;
        let error = outcome.error.expect("each solution has one");
        let numbers = found.tip_position[3 * i..][..3]
            .iter()
            .chain(&found.tip_rotation[9 * i..][..9])
            .chain(&found.tendon_length[tendons * i..][..tendons]);
        if !numbers.copied().all(f64::is_finite) {
            counts.nan += 1;
            eprintln!("\nrobot {number}, load {i}: not a number");
        }
        counts.residual += u64::from(outcome.residual.is_nan() || outcome.residual > TOLERANCE);
        counts.uncertain += u64::from(error.tip > 1e-5 * length);
        counts.unbounded += u64::from(!error.tip.is_finite());
    }
    for _ in 0..COMPARED {
        let i = draw.count(0, count - 1);
        let load = loads.row(i, tendons);
        let mut single = Adaptive::new(&robot, case.model, None).unwrap();
        let outcome = single.solve(&load).unwrap();
        if !same(&single, &outcome, &found, i) {
            counts.batch += 1;
            eprintln!("\nrobot {number}, load {i}: batch and single solve apart");
        }
        if outcome.status == Status::Converged {
            let name = format!("robot {number}, load {i}");
            let stated = outcome.error.map_or(f64::NAN, |error| error.tip);
            compare(&name, &case, &single, stated, &load, &mut counts);
        }
    }
    counts
}

/// A realistic robot with some of all that one may have.
fn varied(mut case: Case, draw: &mut Draw) -> Case {
    if draw.often(0.05) {
        case.model.tendon = TendonPath::Continuous;
    }
    match draw.count(0, 9) {
        0 | 1 => case = case.tapered(draw),
        2 | 3 => case = case.precurved(draw),
        4 | 5 => case = case.coupled(draw),
        _ => {}
    }
    if draw.often(0.3) {
        case = case.routed(draw);
    }
    if draw.often(0.3) {
        case = case.laden(draw);
    }
    if draw.often(0.3) {
        case = case.loaded(draw);
    }
    if draw.often(0.2) {
        case = case.pushed(draw);
    }
    case
}

/// Whether a row of a batch equals a single solve, up to rounding.
fn same(single: &Adaptive, outcome: &Outcome, batch: &Solutions, i: usize) -> bool {
    let other = &batch.outcomes[i];
    if (other.status, other.stable, other.left_unstable)
        != (outcome.status, outcome.stable, outcome.left_unstable)
    {
        return false;
    }
    let Some(tip) = single.solver().tip() else {
        return outcome.status != Status::Converged;
    };
    let length = single.solver().robot().length();
    let tendons = single.solver().robot().tendon_count();
    // due to rounding, either may choose more elements
    let stated = |o: &Outcome| o.error.map_or(f64::NAN, |error| error.tip);
    let slack = 1e-8 + (stated(outcome) + stated(other)) / length;
    let close = |a: f64, b: f64, unit: f64| (a - b).abs() <= slack * unit;
    let rotation = tip.rotation.0.as_flattened();
    (0..3).all(|q| close(batch.tip_position[3 * i + q], tip.position[q], length))
        && (0..9).all(|q| close(batch.tip_rotation[9 * i + q], rotation[q], 1.0))
        && (0..tendons).all(|j| {
            let [x, y] = single.solver().robot().spec().tendons[j].holes[0];
            let there = single.solver().tendon_length(j).unwrap();
            let unit = there.max(length).max(x.hypot(y));
            close(batch.tendon_length[i * tendons + j], there, unit)
        })
}

/// Compares a solution with one of eight elements, and checks both independently.
fn compare(
    name: &str,
    case: &Case,
    single: &Adaptive,
    stated: f64,
    load: &Load,
    counts: &mut Counts,
) {
    let robot = single.solver().robot();
    let length = robot.length();
    let (mut fine, mut found) = single.refined(load, 8).unwrap();
    if found.status != Status::Converged {
        // a tip moment may have led here from a stable equilibrium
        found = fine.solve(load).unwrap();
        fine.estimate_error(&mut found);
    }
    let Some(rest) = found.error else {
        // rounding of stiffnesses with a ratio of 1e8, as hostile robots have them
        counts.unconfirmed += 1;
        return;
    };
    // the gap is that of one module; where the stated error is tiny, the gap of each must be too
    if case.model.tendon == TendonPath::Straight && rest.tip <= 1e-5 * length {
        let mut here = case.clone();
        here.load.set(load);
        match largest_gap(&here, robot, &fine) {
            None => counts.unchecked += 1,
            Some(gap) => {
                counts.checked += 1;
                if !(gap <= BALANCED) {
                    counts.unbalanced += 1;
                    eprintln!("\n{name}: a module is off by {gap:.1e}");
                }
            }
        }
    }
    if single.solver().elements() == 8 {
        return;
    }
    if !(rest.tip <= f64::max(0.1 * stated, 1e-7 * length)) {
        counts.no_reference += 1;
        return;
    }
    counts.compared += 1;
    // rounding errors of an ill-conditioned solution are no discretisation error
    let bound = stated + 1e-8 * length;
    let off = |k: usize| {
        let [a, b] = [single.solver(), &fine].map(|s| s.disk(k).unwrap().position);
        (a - b).norm()
    };
    if !(0..robot.module_count()).all(|k| off(k) <= bound) {
        counts.beyond += 1;
        let off = (0..robot.module_count()).map(off).fold(0.0, f64::max);
        eprintln!(
            "\n{name}: off by {:.1e} of length, stated {:.1e}",
            off / length,
            stated / length
        );
    }
}

/// The largest gap of a module, integrated with as many steps as necessary; `None` where the
/// integration amplifies differences too much, or where a section is so soft that the remaining
/// residual rotates it far.
fn largest_gap(case: &Case, robot: &Robot, solver: &Solver) -> Option<f64> {
    let soft = (robot.spec().backbone.iter().flat_map(|p| p.sections()))
        .any(|s| s.torsion < 1e-4 * s.bending[0]);
    let mut gap = None;
    if soft {
        return gap;
    }
    for steps in [24, 96, 384, 1536, 6144, 24576] {
        gap = case.gap(robot, solver, steps);
        if gap.is_none_or(|gap| gap < BALANCED) {
            break;
        }
    }
    gap
}
