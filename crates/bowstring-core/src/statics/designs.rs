//! Sweeps of many robots with the same topology, over all cores.
//!
//! Theory: docs/theory/statics.md.

use crate::dispatch;
use crate::interrupt;
#[cfg(target_arch = "x86_64")]
use crate::lanes::loads::{LaneOutcome, Levels, FINER};
#[cfg(target_arch = "x86_64")]
use crate::lanes::MOST_LANES;
use crate::model::error::InputError;
use crate::model::load::{Load, RodModel};
use crate::model::robot::Robot;
#[cfg(target_arch = "x86_64")]
use crate::statics::adaptive::refine_to;
use crate::statics::adaptive::Adaptive;
use crate::statics::batch::{for_each, thread_count, Chunk, Solutions};
use crate::statics::loads::Loads;

/// Robots that one thread takes at a time: a multiple of the lanes.
pub(super) const ROBOTS: usize = 8;

/// Solves the loads of every robot in sequence, each from the previous solution, over `threads`
/// cores (0: all). The solutions do not depend on the number of threads.
///
/// The rows of `loads` are those of the first robot, then those of the second, and so on, as many
/// for each. Robots are put side by side in SIMD lanes where possible.
///
/// # Errors
/// If the robots differ in disks or in the end disks of their tendons, or a row is invalid.
pub fn sweep_designs(
    robots: &[Robot],
    model: &RodModel,
    loads: &Loads,
    threads: usize,
) -> Result<Solutions, InputError> {
    let each = rows_each(robots, loads.count)?;
    let first = &robots[0];
    Adaptive::of(first, model)?;
    let elements = model.elements.unwrap_or(1);
    dispatch::check_solvers(first, elements, 2 * ROBOTS * thread_count(threads))?;
    loads.check(first)?;
    for (i, robot) in robots.iter().enumerate() {
        let load = Load {
            point_loads: loads.point_loads,
            ..Load::default()
        };
        let checked = load
            .check_places(robot)
            .and_then(|()| load.check_sections(robot, &[]));
        let checked = checked.and_then(|()| loads.check_elements(robot, model.elements));
        checked.map_err(|e| e.in_row(i))?;
    }
    let mut solutions = Solutions::pending(first, loads.count, false)?;
    let mut chunks: Vec<_> = solutions.chunks(first, (ROBOTS * each).max(1)).collect();
    let scratch = || Scratch {
        #[cfg(target_arch = "x86_64")]
        lanes: Levels::new(first, model),
    };
    for_each(&mut chunks, threads, scratch, |scratch, chunk| {
        let at = chunk.first / each;
        let robots = &robots[at..robots.len().min(at + ROBOTS)];
        fill(chunk, scratch, robots, model, loads);
    });
    Ok(solutions)
}

/// Number of loads of each robot, when robots that differ in their numbers only share this many.
pub(super) fn rows_each(robots: &[Robot], count: usize) -> Result<usize, InputError> {
    let Some(first) = robots.first() else {
        return Err(InputError::other("there is no robot to solve"));
    };
    if let Some(i) = robots.iter().position(|robot| !alike(first, robot)) {
        return Err(InputError::other(format!(
            "robot {i} has other disks, end disks of tendons or kinds of sections than robot 0: \
             give robots that differ in their numbers only"
        )));
    }
    if !count.is_multiple_of(robots.len()) {
        return Err(InputError::other(format!(
            "{} loads cannot be divided among {} robots: give each the same number",
            count,
            robots.len()
        )));
    }
    Ok(count / robots.len())
}

/// Whether two robots have as many disks, tendons with the same end disks, and both or none coupled
/// sections.
fn alike(a: &Robot, b: &Robot) -> bool {
    let ends =
        |robot: &Robot| -> Vec<_> { robot.spec().tendons.iter().map(|t| t.end_disk).collect() };
    let same_kind = a.module_count() == b.module_count() && a.is_coupled() == b.is_coupled();
    same_kind && ends(a) == ends(b)
}

/// Solvers of a thread.
struct Scratch {
    #[cfg(target_arch = "x86_64")]
    lanes: Option<Levels>,
}

/// Solves the loads of some robots, whose rows are those of the chunk.
#[cfg_attr(not(target_arch = "x86_64"), allow(unused_variables))]
fn fill(
    chunk: &mut Chunk,
    scratch: &mut Scratch,
    robots: &[Robot],
    model: &RodModel,
    loads: &Loads,
) {
    let each = chunk.outcomes.len() / robots.len();
    #[cfg(target_arch = "x86_64")]
    if let Some(lanes) = &mut scratch.lanes {
        let width = lanes.first.width();
        for (i, robots) in robots.chunks(width).enumerate() {
            let rows = Rows {
                first: i * width * each,
                each,
            };
            fill_side_by_side(chunk, rows, lanes, robots, model, loads);
        }
        return;
    }
    for (i, robot) in robots.iter().enumerate() {
        let mut solver = Adaptive::of(robot, model).expect("checked before");
        for row in i * each..(i + 1) * each {
            if interrupt::interrupted() {
                return;
            }
            chunk.solve(row, &mut solver, loads, true);
        }
    }
}

/// Rows of robots in a chunk.
#[cfg(target_arch = "x86_64")]
struct Rows {
    first: usize,
    /// Number of loads of each robot.
    each: usize,
}

#[cfg(target_arch = "x86_64")]
impl Rows {
    fn of(&self, lane: usize, load: usize) -> usize {
        self.first + lane * self.each + load
    }
}

/// Solver that has the next load of a robot.
#[cfg(target_arch = "x86_64")]
enum Turn {
    First,
    Finer,
    /// A robot that was left to the globalised solver stays with it.
    Alone(Box<Adaptive>),
}

#[cfg(target_arch = "x86_64")]
fn fill_side_by_side(
    chunk: &mut Chunk,
    rows: Rows,
    lanes: &mut Levels,
    robots: &[Robot],
    model: &RodModel,
    loads: &Loads,
) {
    let tendons = robots[0].tendon_count();
    let alone = |lane: usize, strain| {
        let mut solver = Adaptive::of(&robots[lane], model).expect("checked before");
        solver.restart_from(strain);
        Turn::Alone(Box::new(solver))
    };
    let mut turns: [Turn; MOST_LANES] = [const { Turn::First }; MOST_LANES];
    lanes.first.set_robots(robots);
    if let Some(finer) = &mut lanes.finer {
        finer.set_robots(robots);
        finer.leave_all();
    }
    for load in 0..rows.each {
        if interrupt::interrupted() {
            return;
        }
        let side_by_side: [Load; MOST_LANES] = std::array::from_fn(|lane| {
            let lane = lane.min(robots.len() - 1);
            loads.row(chunk.first + rows.of(lane, load), tendons)
        });
        let side_by_side = &side_by_side[..robots.len()];
        // Newton steps before the finer lanes
        let mut before = [0; MOST_LANES];
        let turns = &mut turns[..robots.len()];
        if turns.iter().any(|turn| matches!(turn, Turn::First)) {
            let outcomes = lanes.first.solve_next(side_by_side);
            for (lane, turn) in turns.iter_mut().enumerate() {
                if !matches!(turn, Turn::First) {
                    continue;
                }
                *turn = match outcomes[lane] {
                    LaneOutcome::Solved(outcome) => {
                        let row = rows.of(lane, load);
                        chunk.write_lane(row, &*lanes.first, lane, outcome);
                        continue;
                    }
                    LaneOutcome::NeedsElements {
                        elements: FINER,
                        iterations,
                    } if lanes.finer.is_some() => {
                        let strain = refine_to(lanes.first.strain(lane), FINER);
                        if let Some(finer) = &mut lanes.finer {
                            finer.start_from(lane, &strain);
                        }
                        before[lane] = iterations;
                        Turn::Finer
                    }
                    _ => alone(lane, lanes.first.last_strain(lane)),
                };
            }
        }
        if turns.iter().any(|turn| matches!(turn, Turn::Finer)) {
            let finer = lanes.finer.as_mut().expect("a lane has its turn there");
            let outcomes = finer.solve_next(side_by_side);
            for (lane, turn) in turns.iter_mut().enumerate() {
                if !matches!(turn, Turn::Finer) {
                    continue;
                }
                if let LaneOutcome::Solved(mut outcome) = outcomes[lane] {
                    outcome.iterations += before[lane];
                    chunk.write_lane(rows.of(lane, load), &**finer, lane, outcome);
                    continue;
                }
                let strain = finer.last_strain(lane);
                *turn = alone(lane, strain.or_else(|| lanes.first.last_strain(lane)));
            }
        }
        for (lane, turn) in turns.iter_mut().enumerate() {
            if let Turn::Alone(solver) = turn {
                chunk.solve(rows.of(lane, load), solver, loads, true);
            }
        }
    }
}
