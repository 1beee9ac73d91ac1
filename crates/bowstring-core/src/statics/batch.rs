//! Many loads in one call: in sequence, each from the previous one, or independent over all cores.
//!
//! Theory: docs/theory/statics.md.

use crate::dispatch;
use crate::interrupt;
#[cfg(target_arch = "x86_64")]
use crate::lanes::loads::{LaneOutcome, Levels, SideBySide, FINER};
#[cfg(target_arch = "x86_64")]
use crate::lanes::polynomial::StartPolynomial;
#[cfg(target_arch = "x86_64")]
use crate::lanes::MOST_LANES;
use crate::math::linalg::Vec3;
use crate::memory::{filled, unknown};
use crate::model::error::InputError;
#[cfg(target_arch = "x86_64")]
use crate::model::load::Load;
use crate::model::load::RodModel;
use crate::model::robot::Robot;
#[cfg(target_arch = "x86_64")]
use crate::statics::adaptive::refine_to;
use crate::statics::adaptive::Adaptive;
use crate::statics::differentiator::Differentiator;
use crate::statics::loads::Loads;
use crate::statics::solver::{Outcome, Pose, Solver, Status};
#[cfg(target_arch = "x86_64")]
use crate::statics::start;
#[cfg(target_arch = "x86_64")]
use std::sync::Arc;

/// Solutions as flat arrays, row by row; SI units, base frame.
///
/// Rows that did not converge hold NaN. A rotation is its matrix row by row and maps body to base.
#[derive(Clone, Debug)]
pub struct Solutions {
    /// Outcome of each row.
    pub outcomes: Vec<Outcome>,
    /// Positions of the tip (m), n x 3.
    pub tip_position: Vec<f64>,
    /// Rotations of the tip, n x 9.
    pub tip_rotation: Vec<f64>,
    /// Lengths of the tendons (m), n x tendons.
    pub tendon_length: Vec<f64>,
    /// Positions of the disks (m), n x disks x 3; empty unless requested.
    pub disk_position: Vec<f64>,
    /// Rotations of the disks, n x disks x 9; empty unless requested.
    pub disk_rotation: Vec<f64>,
}

/// Solves loads in sequence, on one core. `warm` starts each from the previous solution, which is
/// faster for loads in a fine sequence and stays on the branch of solutions.
pub fn sweep(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    warm: bool,
    disks: bool,
) -> Result<Solutions, InputError> {
    sweep_with(robot, &mut Adaptive::of(robot, model)?, loads, warm, disks)
}

/// As [`sweep`], with an existing solver of the robot and model.
pub fn sweep_with(
    robot: &Robot,
    solver: &mut Adaptive,
    loads: &Loads,
    warm: bool,
    disks: bool,
) -> Result<Solutions, InputError> {
    loads.check(robot)?;
    loads.check_elements(robot, solver.given_elements())?;
    solver.reset();
    let mut solutions = Solutions::pending(robot, loads.count, disks)?;
    for mut chunk in solutions.chunks(robot, loads.count.max(1)) {
        chunk.solve_all(solver, loads, warm);
    }
    Ok(solutions)
}

/// Solves independent loads over `threads` cores (0: all).
///
/// Each starts from the straight backbone; of many loads in SIMD lanes, each starts from a
/// polynomial of the load that is fitted to the solutions of a sample of them. Where a load has
/// several stable equilibria, the start decides which of them is found.
///
/// The solutions do not depend on the number of threads. Without the feature `threads` it runs on
/// one core.
pub fn solve_batch(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    threads: usize,
    disks: bool,
) -> Result<Solutions, InputError> {
    solve_and_differentiate(robot, model, loads, threads, disks, &mut [])
}

/// As [`solve_batch`]; fills `jacobians`, if it is not empty, with the derivatives of each row (see
/// [`Differentiator`]). Rows without a solution keep what was there.
pub(super) fn solve_and_differentiate(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    threads: usize,
    disks: bool,
    jacobians: &mut [f64],
) -> Result<Solutions, InputError> {
    Adaptive::of(robot, model)?;
    let elements = model.elements.unwrap_or(1);
    dispatch::check_solvers(robot, elements, 2 * thread_count(threads))?;
    loads.check(robot)?;
    loads.check_elements(robot, model.elements)?;
    let mut solutions = Solutions::pending(robot, loads.count, disks)?;
    let differentiate = !jacobians.is_empty();
    let each = jacobians.len().checked_div(loads.count).unwrap_or(0);
    let jacobians = pieces(jacobians, CHUNK * each);
    let mut chunks: Vec<_> = solutions.chunks(robot, CHUNK).zip(jacobians).collect();
    #[cfg(target_arch = "x86_64")]
    let start = start_polynomial(robot, model, loads, threads).map(Arc::new);
    let scratch = || Scratch {
        solver: Adaptive::of(robot, model).expect("checked above"),
        #[cfg(target_arch = "x86_64")]
        lanes: Levels::new(robot, model),
        #[cfg(target_arch = "x86_64")]
        start: start.clone(),
        differentiator: differentiate.then(|| Differentiator::new(robot, model)),
    };
    for_each(
        &mut chunks,
        threads,
        scratch,
        |scratch, (chunk, jacobians)| {
            if differentiate {
                chunk.keep_strains();
            }
            chunk.fill(scratch, loads);
            if let Some(differentiator) = &mut scratch.differentiator {
                chunk.differentiate(differentiator, loads, jacobians);
            }
        },
    );
    Ok(solutions)
}

/// Strain as a polynomial of the load, from the solutions of a sample of the loads.
#[cfg(target_arch = "x86_64")]
fn start_polynomial(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    threads: usize,
) -> Option<StartPolynomial> {
    // lanes solve dead forces on disks alone
    let moments = loads.tip_moment.iter();
    let mut moments = moments.chain(loads.disk_moments.as_flattened());
    let others = !(loads.point_loads.is_empty()
        && loads.line_forces.is_empty()
        && robot.spec().payloads.is_empty());
    if others || moments.any(|m| *m != 0.0) {
        return None;
    }
    let tendons = robot.tendon_count();
    let sample = start::sample(loads, tendons);
    let mut groups: Vec<_> = sample
        .chunks(MOST_LANES)
        .map(|rows| (rows, vec![]))
        .collect();
    let lanes = || Levels::new(robot, model).map(|levels| levels.first);
    for_each(&mut groups, threads, lanes, |lanes, (rows, strains)| {
        let Some(lanes) = lanes else { return };
        for rows in rows.chunks(lanes.width()) {
            let side_by_side = side_by_side(rows.len(), |lane| loads.row(rows[lane], tendons));
            let outcomes = lanes.solve(&side_by_side[..rows.len()]);
            for (lane, row) in rows.iter().enumerate() {
                if !matches!(outcomes[lane], LaneOutcome::Left) {
                    let strain = lanes.strain(lane).into_iter().flat_map(|w| w.0);
                    strains.push((*row, strain.collect::<Vec<_>>()));
                }
            }
        }
    });
    let solved: Vec<_> = groups
        .into_iter()
        .flat_map(|(_, strains)| strains)
        .collect();
    start::fit(loads, tendons, &solved)
}

/// Loads for the lanes; the last one also in the lanes beyond.
#[cfg(target_arch = "x86_64")]
fn side_by_side<'l>(count: usize, load: impl Fn(usize) -> Load<'l>) -> [Load<'l>; MOST_LANES] {
    std::array::from_fn(|lane| load(lane.min(count - 1)))
}

/// Solvers of a thread.
struct Scratch {
    solver: Adaptive,
    #[cfg(target_arch = "x86_64")]
    lanes: Option<Levels>,
    /// Where lanes start; from the straight backbone if there is none.
    #[cfg(target_arch = "x86_64")]
    start: Option<Arc<StartPolynomial>>,
    /// Where derivatives are wanted.
    differentiator: Option<Differentiator>,
}

/// Rows that the lanes with the fewest elements did not solve.
#[cfg(target_arch = "x86_64")]
#[derive(Default)]
struct Open {
    /// For the finer lanes: rows, Newton steps so far and strains to start from.
    finer: Vec<(usize, usize, Vec<Vec3>)>,
    /// For the globalised solver.
    left: Vec<usize>,
}

/// Loads that one thread takes at a time: a multiple of the lanes.
const CHUNK: usize = 64;

/// Number of threads to run on: 0 means all cores.
pub fn thread_count(threads: usize) -> usize {
    match threads {
        _ if !cfg!(feature = "threads") => 1,
        0 => std::thread::available_parallelism().map_or(1, |n| n.get()),
        threads => threads,
    }
}

/// Processes every item, on `threads` threads (0: one for each core) with their own scratch memory;
/// on one thread without the feature `threads`. Interrupted work leaves the remaining items
/// unchanged.
#[cfg_attr(not(feature = "threads"), allow(unused_variables))]
pub fn for_each<T: Send, S>(
    items: &mut [T],
    threads: usize,
    scratch: impl Fn() -> S + Sync + Send,
    work: impl Fn(&mut S, &mut T) + Sync + Send,
) {
    #[cfg(feature = "threads")]
    if threads != 1 && items.len() > 1 {
        use rayon::prelude::*;
        let shared = interrupt::Shared::default();
        let join = shared.clone();
        // own pool: the global one would not survive a fork of the process
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.min(items.len()))
            .start_handler(move |_| join.join())
            .build();
        if let Ok(pool) = pool {
            return pool.in_place_scope(|scope| {
                let finisher = shared.finisher();
                scope.spawn(|_| {
                    let _finisher = finisher;
                    items
                        .par_iter_mut()
                        .for_each_init(&scratch, |s, item| work(s, item))
                });
                // only the calling thread receives an interruption
                shared.wait();
            });
        }
    }
    let mut s = scratch();
    items.iter_mut().for_each(|item| work(&mut s, item));
}

impl Solutions {
    /// Solutions for `n` rows, all NaN.
    pub(super) fn pending(robot: &Robot, n: usize, disks: bool) -> Result<Self, InputError> {
        let refused = || too_many(n);
        let nan = |columns: usize| unknown(n.checked_mul(columns), &refused);
        let all = if disks { robot.module_count() } else { 0 };
        Ok(Solutions {
            outcomes: filled(Outcome::pending(), Some(n), &refused)?,
            tip_position: nan(3)?,
            tip_rotation: nan(9)?,
            tendon_length: nan(robot.tendon_count())?,
            disk_position: nan(3 * all)?,
            disk_rotation: nan(9 * all)?,
        })
    }

    /// Solutions of no rows.
    pub(super) fn empty() -> Self {
        Solutions {
            outcomes: vec![],
            tip_position: vec![],
            tip_rotation: vec![],
            tendon_length: vec![],
            disk_position: vec![],
            disk_rotation: vec![],
        }
    }

    /// Adds the rows of others.
    pub(super) fn append(&mut self, others: Solutions) {
        self.outcomes.extend(others.outcomes);
        self.tip_position.extend(others.tip_position);
        self.tip_rotation.extend(others.tip_rotation);
        self.tendon_length.extend(others.tendon_length);
        self.disk_position.extend(others.disk_position);
        self.disk_rotation.extend(others.disk_rotation);
    }

    /// Disjoint chunks of `rows` rows, the last one possibly shorter.
    pub(super) fn chunks(&mut self, robot: &Robot, rows: usize) -> impl Iterator<Item = Chunk<'_>> {
        let (tendons, modules) = (robot.tendon_count(), robot.module_count());
        let disks = if self.disk_position.is_empty() {
            0
        } else {
            modules
        };
        let mut tip_position = pieces(&mut self.tip_position, 3 * rows);
        let mut tip_rotation = pieces(&mut self.tip_rotation, 9 * rows);
        let mut tendon_length = pieces(&mut self.tendon_length, tendons * rows);
        let mut disk_position = pieces(&mut self.disk_position, 3 * disks * rows);
        let mut disk_rotation = pieces(&mut self.disk_rotation, 9 * disks * rows);
        let chunks = self.outcomes.chunks_mut(rows).enumerate();
        chunks.map(move |(i, outcomes)| Chunk {
            first: i * rows,
            strains: vec![],
            tendons,
            modules,
            disks,
            outcomes,
            tip_position: tip_position.next().unwrap_or_default(),
            tip_rotation: tip_rotation.next().unwrap_or_default(),
            tendon_length: tendon_length.next().unwrap_or_default(),
            disk_position: disk_position.next().unwrap_or_default(),
            disk_rotation: disk_rotation.next().unwrap_or_default(),
        })
    }
}

pub(super) fn too_many(n: usize) -> InputError {
    InputError::other(format!(
        "the solutions of {n} loads do not fit into memory: give fewer at a time or leave the disks out"
    ))
}

/// Pieces of `len` entries of a column, the last one possibly shorter, and empty ones after it.
pub(super) fn pieces<T>(column: &mut [T], len: usize) -> impl Iterator<Item = &mut [T]> {
    let beyond = std::iter::repeat_with(Default::default);
    column.chunks_mut(len.max(1)).chain(beyond)
}

/// Consecutive rows and the storage of their solutions.
pub(super) struct Chunk<'a> {
    pub first: usize,
    /// Strain of each row that is solved; empty unless it is kept.
    strains: Vec<Option<Vec<Vec3>>>,
    tendons: usize,
    modules: usize,
    /// Number of disks to write: all or none.
    disks: usize,
    pub outcomes: &'a mut [Outcome],
    tip_position: &'a mut [f64],
    tip_rotation: &'a mut [f64],
    tendon_length: &'a mut [f64],
    disk_position: &'a mut [f64],
    disk_rotation: &'a mut [f64],
}

impl Chunk<'_> {
    /// Solves every row from the straight backbone: in SIMD lanes where possible, otherwise one by
    /// one.
    fn fill(&mut self, scratch: &mut Scratch, loads: &Loads) {
        #[cfg(target_arch = "x86_64")]
        if scratch.lanes.is_some() {
            return self.fill_side_by_side(scratch, loads);
        }
        self.solve_all(&mut scratch.solver, loads, false);
    }

    /// Solves every row, one by one.
    fn solve_all(&mut self, solver: &mut Adaptive, loads: &Loads, warm: bool) {
        for i in 0..self.outcomes.len() {
            if interrupt::interrupted() {
                return;
            }
            self.solve(i, solver, loads, warm);
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn fill_side_by_side(&mut self, scratch: &mut Scratch, loads: &Loads) {
        let Some(lanes) = &mut scratch.lanes else {
            return;
        };
        let mut open = Open::default();
        let all: Vec<usize> = (0..self.outcomes.len()).collect();
        self.fill_first(lanes, &all, scratch.start.as_deref(), loads, &mut open);
        if scratch.start.is_some() {
            let left = std::mem::take(&mut open.left);
            self.fill_first(lanes, &left, None, loads, &mut open);
        }
        if let Some(finer) = &mut lanes.finer {
            self.fill_finer(&mut **finer, loads, &mut open);
        }
        for i in open.left {
            if interrupt::interrupted() {
                return;
            }
            self.solve(i, &mut scratch.solver, loads, false);
        }
    }

    /// Solves some rows in the lanes with the fewest elements.
    #[cfg(target_arch = "x86_64")]
    fn fill_first(
        &mut self,
        lanes: &mut Levels,
        rows: &[usize],
        start: Option<&StartPolynomial>,
        loads: &Loads,
        open: &mut Open,
    ) {
        let first = &mut lanes.first;
        for rows in rows.chunks(first.width()) {
            if interrupt::interrupted() {
                return;
            }
            let side_by_side = self.loads_of(loads, rows.len(), |lane| rows[lane]);
            let loads = &side_by_side[..rows.len()];
            let outcomes = match start {
                Some(start) => first.solve_from(start, loads),
                None => first.solve(loads),
            };
            for (lane, &i) in rows.iter().enumerate() {
                match outcomes[lane] {
                    LaneOutcome::Solved(outcome) => self.write_lane(i, &**first, lane, outcome),
                    LaneOutcome::NeedsElements {
                        elements: FINER,
                        iterations,
                    } if lanes.finer.is_some() => {
                        let strain = refine_to(first.strain(lane), FINER);
                        open.finer.push((i, iterations, strain));
                    }
                    _ => open.left.push(i),
                }
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn fill_finer(&mut self, lanes: &mut dyn SideBySide, loads: &Loads, open: &mut Open) {
        for some in open.finer.chunks(lanes.width()) {
            if interrupt::interrupted() {
                return;
            }
            lanes.leave_all();
            for (lane, (_, _, strain)) in some.iter().enumerate() {
                lanes.start_from(lane, strain);
            }
            let side_by_side = self.loads_of(loads, some.len(), |lane| some[lane].0);
            let outcomes = lanes.solve_next(&side_by_side[..some.len()]);
            for (lane, (i, before, _)) in some.iter().enumerate() {
                if let LaneOutcome::Solved(mut outcome) = outcomes[lane] {
                    outcome.iterations += before;
                    self.write_lane(*i, lanes, lane, outcome);
                } else {
                    open.left.push(*i);
                }
            }
        }
    }

    /// Keeps the strains of the rows that are solved from now on.
    pub fn keep_strains(&mut self) {
        self.strains.resize(self.outcomes.len(), None);
    }

    /// Writes the derivatives of the rows whose strains were kept.
    pub fn differentiate(
        &mut self,
        differentiator: &mut Differentiator,
        loads: &Loads,
        jacobians: &mut [f64],
    ) {
        let each = jacobians.len() / self.outcomes.len();
        let rows = self
            .strains
            .iter_mut()
            .zip(jacobians.chunks_exact_mut(each));
        for (i, (strain, jacobian)) in rows.enumerate() {
            if interrupt::interrupted() {
                return;
            }
            if let Some(strain) = strain.take() {
                let load = loads.row(self.first + i, self.tendons);
                differentiator.write(&load, &strain, jacobian);
            }
        }
    }

    /// Loads of some rows for the lanes.
    #[cfg(target_arch = "x86_64")]
    fn loads_of<'l>(
        &self,
        loads: &Loads<'l>,
        count: usize,
        row: impl Fn(usize) -> usize,
    ) -> [Load<'l>; MOST_LANES] {
        side_by_side(count, |lane| {
            loads.row(self.first + row(lane), self.tendons)
        })
    }

    /// Writes the solution in a lane.
    #[cfg(target_arch = "x86_64")]
    pub fn write_lane(&mut self, i: usize, lanes: &dyn SideBySide, lane: usize, outcome: Outcome) {
        self.outcomes[i] = outcome;
        let length = |j| lanes.tendon_length(j, lane);
        self.write(i, |k| lanes.disk(k, lane), length);
        if let Some(strain) = self.strains.get_mut(i) {
            *strain = Some(lanes.strain(lane));
        }
    }

    /// Solves one row.
    pub fn solve(&mut self, i: usize, solver: &mut Adaptive, loads: &Loads, warm: bool) {
        let load = loads.row(self.first + i, self.tendons);
        let outcome = if warm {
            solver.solve_next(&load)
        } else {
            solver.solve(&load)
        }
        .expect("all rows were checked");
        self.outcomes[i] = outcome;
        if outcome.status == Status::Converged {
            self.write_answer(i, solver.solver());
            if let Some(strain) = self.strains.get_mut(i) {
                *strain = solver.solver().last_strain();
            }
        }
    }

    /// Writes the solution of a converged solver.
    pub fn write_answer(&mut self, i: usize, solver: &Solver) {
        self.write(
            i,
            |k| solver.disk(k).expect("it converged"),
            |j| solver.tendon_length(j).expect("it converged"),
        );
    }

    pub fn write(
        &mut self,
        i: usize,
        disk: impl Fn(usize) -> Pose,
        tendon_length: impl Fn(usize) -> f64,
    ) {
        let tip = disk(self.modules - 1);
        write_pose(&tip, i, self.tip_position, self.tip_rotation);
        for j in 0..self.tendons {
            self.tendon_length[i * self.tendons + j] = tendon_length(j);
        }
        for k in 0..self.disks {
            let at = i * self.disks + k;
            write_pose(&disk(k), at, self.disk_position, self.disk_rotation);
        }
    }
}

/// Writes a pose to index `at` of flat arrays.
pub fn write_pose(pose: &Pose, at: usize, position: &mut [f64], rotation: &mut [f64]) {
    position[3 * at..][..3].copy_from_slice(&pose.position.0);
    for r in 0..3 {
        for c in 0..3 {
            rotation[9 * at + 3 * r + c] = pose.rotation.0[r][c];
        }
    }
}
