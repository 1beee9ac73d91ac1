//! Random solves by the million: no panic, no NaN, no answer with a larger error than stated.
//!
//! `cargo run --release -p bowstring-core --example campaign -- SOLVES [STATE]`
//!
//! Robots are drawn one after the other, each under several loads; every answer is looked at:
//!
//! - each number is finite, the residual below its tolerance;
//! - a batch gives what single solves give;
//! - eight elements a module, from the answer's own strain, move no disk by more than both say;
//! - poses of those satisfy the rod's differential equation, integrated under the wrench that
//!   tendons and loads leave to the backbone: nothing of it is the solver's own residual.
//!
//! What was found is kept in STATE (default `target/campaign.txt`) after every thousand robots,
//! and a further run goes on from there.

#[path = "../tests/common/cases.rs"]
mod cases;

use bowstring_core::adaptive::Adaptive;
use bowstring_core::batch::{solve_batch, Loads, Settings};
use bowstring_core::load::{Load, TendonPath};
use bowstring_core::robot::Robot;
use bowstring_core::statics::{Solver, Status, TOLERANCE};
use cases::{hostile, Case, Draw};
use std::io::Write;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Loads of a robot of realistic size, and of one with numbers that no maker would give: its
/// loads are mostly past hope, and each takes as long as a thousand others.
const LOADS: usize = 64;
const HOSTILE_LOADS: usize = 2;
/// Robots between two writings of the state.
const CHUNK: usize = 1000;
/// Of the loads of a robot, those that eight elements solve as well.
const COMPARED: usize = 2;

/// Names and values of what is counted.
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
    checked: "integrated from the outside",
    unbalanced: "not balanced by more than a coarse answer may be",
    compared: "compared with eight elements",
    beyond: "off by more than stated",
    uncertain: "stated to be less exact than 1e-5 of length",
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let wanted: u64 = match arguments.next().map(|text| text.parse()) {
        Some(Ok(n)) => n,
        _ => {
            eprintln!("campaign: give the number of solves, such as 1000000");
            std::process::exit(2);
        }
    };
    let path = arguments.next().unwrap_or("target/campaign.txt".into());
    let (mut total, mut first) = read(&path);
    std::panic::set_hook(Box::new(|_| {}));
    let begun = Instant::now();
    let before = total.solves;
    while total.solves < wanted {
        let next = AtomicUsize::new(first);
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        let parts: Vec<Counts> = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .map(|_| {
                    scope.spawn(|| {
                        let mut counts = Counts::default();
                        loop {
                            let number = next.fetch_add(1, Ordering::Relaxed);
                            if number >= first + CHUNK {
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
        first += CHUNK;
        write(&path, &total, first);
        let rate = (total.solves - before) as f64 / begun.elapsed().as_secs_f64();
        eprint!(
            "\r{} of {wanted} solves, {rate:.0} a second; {} panics, {} off by more than stated ",
            total.solves, total.panics, total.beyond
        );
    }
    eprintln!();
    for (text, value) in Counts::TEXTS.iter().zip(total.values()) {
        println!("{value:>12}  {text}");
    }
    let broken = total.panics + total.nan + total.residual + total.batch + total.beyond;
    std::process::exit(i32::from(broken + total.unbalanced > 0));
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

/// Whole or not at all.
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
    let hard = draw.often(0.2);
    let mut case = if hard {
        hostile(&mut draw)
    } else {
        Case::realistic(&mut draw)
    };
    if !hard && draw.often(0.05) {
        case.tendon = TendonPath::Continuous;
    }
    let Ok(robot) = Robot::new(case.spec.clone()) else {
        counts.refused += 1;
        return counts;
    };
    let tendons = robot.tendon_count();
    if case.tensions.len() != tendons {
        counts.refused += 1;
        return counts;
    }
    // each tension, tip force and moment a share of what was drawn
    let (mut tensions, mut forces, mut moments) = (vec![], vec![], vec![]);
    let count = if hard { HOSTILE_LOADS } else { LOADS };
    for _ in 0..count {
        tensions.extend(case.tensions.iter().map(|t| t * draw.within(0.0, 1.0)));
        let share = draw.within(0.0, 1.0);
        forces.extend(case.tip_force.0.map(|f| f * share));
        moments.extend(case.tip_moment.0.map(|m| m * share));
    }
    let gravity = case.spec.gravity;
    let loads = Loads {
        count,
        tensions: &tensions,
        gravity: &gravity,
        tip_force: &forces,
        tip_moment: &moments,
    };
    let settings = Settings {
        model: case.model(),
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
        let error = outcome.error.expect("each answer carries one");
        let numbers = found.tip_position[3 * i..][..3]
            .iter()
            .chain(&found.tip_rotation[9 * i..][..9])
            .chain(&found.tendon_length[tendons * i..][..tendons]);
        if !numbers.copied().all(f64::is_finite) || error.tip.is_nan() {
            counts.nan += 1;
            eprintln!("\nrobot {number}, load {i}: not a number");
        }
        counts.residual += u64::from(outcome.residual.is_nan() || outcome.residual > TOLERANCE);
        counts.uncertain += u64::from(error.tip > 1e-5 * length);
    }
    for i in 0..COMPARED {
        let i = i * count / COMPARED;
        if found.outcomes[i].status == Status::Converged {
            compare(
                number,
                i,
                &case,
                &robot,
                &loads.row(i, tendons),
                &mut counts,
            );
        }
    }
    counts
}

/// The same load by a single solve, and that by eight elements, checked from the outside.
fn compare(number: usize, i: usize, case: &Case, robot: &Robot, load: &Load, counts: &mut Counts) {
    let length = robot.length();
    let mut single = Adaptive::new(robot, case.model(), None).unwrap();
    let outcome = single.solve(load).unwrap();
    let settings = Settings {
        model: case.model(),
        elements: None,
    };
    let batch = solve_batch(robot, &settings, &loads_of(load), 1, false).unwrap();
    let Some(tip) = single.solver().tip() else {
        counts.batch += 1;
        eprintln!("\nrobot {number}, load {i}: batch converged, single solve did not");
        return;
    };
    let apart = (0..3).map(|q| (batch.tip_position[q] - tip.position[q]).abs());
    if apart.fold(0.0, f64::max) > 1e-8 * length {
        counts.batch += 1;
        eprintln!("\nrobot {number}, load {i}: batch and single solve apart");
    }
    let stated = outcome.error.unwrap();
    let (fine, found) = single.refined(load, 8).unwrap();
    let Some(rest) = found.error else {
        return;
    };
    if case.tendon == TendonPath::Straight {
        counts.checked += 1;
        let mut here = case.clone();
        here.tensions = load.tensions.to_vec();
        here.tip_force.0 = load.tip_force;
        here.tip_moment.0 = load.tip_moment;
        let gap = gap(&here, robot, &fine);
        // the gap is that of one module; where the answer says it is exact, so must each be
        if !(gap < 1e-3 || rest.tip > 1e-5 * length) {
            counts.unbalanced += 1;
            eprintln!("\nrobot {number}, load {i}: a module is off by {gap:.1e}");
        }
    }
    if single.solver().elements() == 8 {
        return;
    }
    counts.compared += 1;
    let off = (0..robot.module_count())
        .map(|k| {
            let [a, b] = [single.solver(), &fine].map(|s| s.disk(k).unwrap().position);
            (a - b).norm()
        })
        .fold(0.0, f64::max);
    // what rounding leaves of an ill-conditioned answer is no discretisation error
    if off > stated.tip + rest.tip + 1e-9 * length {
        counts.beyond += 1;
        eprintln!(
            "\nrobot {number}, load {i}: off by {:.1e} of length, stated {:.1e}",
            off / length,
            stated.tip / length
        );
    }
}

/// The largest gap of a module, integrated with as many steps as it takes.
fn gap(case: &Case, robot: &Robot, solver: &Solver) -> f64 {
    let mut gap = f64::INFINITY;
    for steps in [24, 96, 384, 1536] {
        gap = case.gap(robot, solver, steps);
        if gap < 1e-4 {
            break;
        }
    }
    gap
}

fn loads_of<'a>(load: &'a Load) -> Loads<'a> {
    Loads {
        count: 1,
        tensions: load.tensions,
        gravity: &load.gravity,
        tip_force: &load.tip_force,
        tip_moment: &load.tip_moment,
    }
}
