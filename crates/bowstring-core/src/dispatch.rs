//! A rod in the numbers that suit the processor, behind one face.
//!
//! Each pass is compiled once for each kind of number, with the processor's features; what
//! calls one pass after the other is written, and compiled, once.

use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::math::real::{Real, Scalar};
use crate::memory;
use crate::model::load::{Load, Model};
use crate::model::robot::{InputError, Robot};
use crate::motion::{Damping, Energies, Fields, Motion, StepError};
use crate::rod::chain::{Rod, Sources, Step};
use crate::rod::estimate::Correction;
use crate::rod::sensitivity::{self, Jacobians};
use crate::tendon::RoutedRod;

/// The passes of one rod, see [`Rod`] for what each does.
pub(crate) trait Passes: RoutedRod + Send + Sync {
    fn evaluate(&mut self) -> f64;
    fn balance(&mut self) -> f64;
    fn gradient(&mut self) -> f64;
    fn linearise(&mut self);
    fn eliminate(&mut self, symmetric: bool, shift: f64) -> f64;
    fn newton_step(&mut self, symmetric: bool) -> Step<f64>;
    fn combine(&mut self, coefficients: &[f64]) -> f64;
    fn finish(&mut self);
    fn estimate(&mut self) -> Correction<f64>;
    fn correct(&mut self, coefficients: &[f64]) -> f64;

    fn load(&mut self, load: &Load);
    fn make_straight(&mut self);
    fn set_strains(&mut self, strain: &dyn Fn(usize) -> Vec3);
    fn strains(&self, visit: &mut dyn FnMut(usize, Vec3));
    fn contact_forces(&self, visit: &mut dyn FnMut(usize, Vec3));
    fn set_gradient(&mut self, value: &dyn Fn(usize) -> Vec3);
    fn step_to_gradient(&mut self, scale: f64);
    fn save(&mut self);
    fn advance(&mut self, fraction: f64);
    fn negative_pivots(&self) -> usize;
    fn span_tension(&self, k: usize, i: usize) -> f64;
    fn length(&self, i: usize) -> f64;
    fn length_error(&self, i: usize) -> f64;
    fn disk(&self, k: usize) -> Pose;
    fn collision(&self) -> Option<usize>;
    fn has_tip_moment(&self) -> bool;
    fn module_count(&self) -> usize;
    fn energy_scale(&self, length: f64) -> f64;
    fn boxed_clone(&self) -> Box<dyn Passes>;
}

impl Clone for Box<dyn Passes> {
    fn clone(&self) -> Self {
        self.boxed_clone()
    }
}

/// A pass compiled for a kind of number, with the processor's `$feature` that it needs.
macro_rules! hot {
    ([$($generic:tt)*] $rod:ty, []; $name:ident($($arg:ident: $type:ty),*) -> $out:ty |$self:ident| $code:expr) => {
        fn $name(&mut self $(, $arg: $type)*) -> $out {
            let $self = self;
            $code
        }
    };
    ([] $rod:ty, [$feature:literal]; $name:ident($($arg:ident: $type:ty),*) -> $out:ty |$self:ident| $code:expr) => {
        fn $name(&mut self $(, $arg: $type)*) -> $out {
            #[target_feature(enable = $feature)]
            fn pass($self: &mut $rod $(, $arg: $type)*) -> $out {
                $code
            }
            // SAFETY: such a rod is made only where the processor has the features
            unsafe { pass(self $(, $arg)*) }
        }
    };
}

/// Passes of a rod in one kind of number; `$feature` are the processor's that it needs.
macro_rules! passes {
    ([$($generic:tt)*] $rod:ty $(, $feature:literal)?) => {
        impl<$($generic)*> Passes for $rod {
            hot!([$($generic)*] $rod, [$($feature)?]; evaluate() -> f64 |rod| rod.evaluate().lane(0));
            hot!([$($generic)*] $rod, [$($feature)?]; balance() -> f64 |rod| rod.balance().lane(0));
            hot!([$($generic)*] $rod, [$($feature)?]; gradient() -> f64 |rod| rod.gradient().lane(0));
            hot!([$($generic)*] $rod, [$($feature)?]; linearise() -> () |rod| rod.linearise());
            hot!([$($generic)*] $rod, [$($feature)?]; eliminate(symmetric: bool, shift: f64) -> f64 |rod| {
                let shift = Real::splat(shift);
                if symmetric {
                    rod.eliminate::<true>(shift).lane(0)
                } else {
                    rod.eliminate::<false>(shift).lane(0)
                }
            });
            hot!([$($generic)*] $rod, [$($feature)?]; newton_step(symmetric: bool) -> Step<f64> |rod| {
                let step = if symmetric {
                    rod.newton_step::<true>()
                } else {
                    rod.newton_step::<false>()
                };
                Step { slope: step.slope.lane(0), largest: step.largest.lane(0) }
            });
            hot!([$($generic)*] $rod, [$($feature)?]; combine(coefficients: &[f64]) -> f64 |rod| rod.combine(coefficients));
            hot!([$($generic)*] $rod, [$($feature)?]; advance(fraction: f64) -> () |rod| rod.advance(Real::splat(fraction)));
            hot!([$($generic)*] $rod, [$($feature)?]; finish() -> () |rod| rod.finish());
            hot!([$($generic)*] $rod, [$($feature)?]; estimate() -> Correction<f64> |rod| {
                rod.estimate().of_lane(0)
            });
            hot!([$($generic)*] $rod, [$($feature)?]; correct(coefficients: &[f64]) -> f64 |rod| {
                rod.combine_rotations(coefficients);
                rod.correction().lane(0)
            });

            fn load(&mut self, load: &Load) {
                Rod::load(self, load);
            }
            fn make_straight(&mut self) {
                Rod::make_straight(self);
            }
            fn set_strains(&mut self, strain: &dyn Fn(usize) -> Vec3) {
                Rod::set_strains(self, strain);
            }
            fn strains(&self, visit: &mut dyn FnMut(usize, Vec3)) {
                Rod::strains(self, visit);
            }
            fn contact_forces(&self, visit: &mut dyn FnMut(usize, Vec3)) {
                Rod::contact_forces(self, visit);
            }
            fn set_gradient(&mut self, value: &dyn Fn(usize) -> Vec3) {
                Rod::set_gradient(self, value);
            }
            fn step_to_gradient(&mut self, scale: f64) {
                Rod::step_to_gradient(self, scale);
            }
            fn save(&mut self) {
                Rod::save(self);
            }
            fn negative_pivots(&self) -> usize {
                Rod::negative_pivots(self)
            }
            fn span_tension(&self, k: usize, i: usize) -> f64 {
                Rod::span_tension(self, k, i)
            }
            fn length(&self, i: usize) -> f64 {
                self.lengths[i].lane(0)
            }
            fn length_error(&self, i: usize) -> f64 {
                self.length_errors[i].lane(0)
            }
            fn disk(&self, k: usize) -> Pose {
                Rod::disk(self, k, 0)
            }
            fn collision(&self) -> Option<usize> {
                Rod::collision(self, 0)
            }
            fn module_count(&self) -> usize {
                Rod::module_count(self)
            }
            fn has_tip_moment(&self) -> bool {
                Rod::has_tip_moment(self)
            }
            fn energy_scale(&self, length: f64) -> f64 {
                Rod::energy_scale(self, length, 0)
            }
            fn boxed_clone(&self) -> Box<dyn Passes> {
                Box::new(self.clone())
            }
        }

        impl<$($generic)*> RoutedRod for $rod {
            hot!([$($generic)*] $rod, [$($feature)?]; measure_spans(angles: bool) -> () |rod| rod.measure_spans(angles));
            hot!([$($generic)*] $rod, [$($feature)?]; respond(sources: Sources) -> () |rod| rod.respond(sources));
            fn span_lengths(&self) -> &[f64] {
                &self.span_lengths
            }
            fn angles(&self) -> &[f64] {
                &self.angles
            }
            fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
                Rod::beyond(self, hole, tendon, out);
            }
            fn set_span_tensions(&mut self, tensions: &[f64]) {
                let count = self.tendons.len();
                Rod::set_span_tensions(self, |k, i| tensions[k * count + i]);
            }
        }
    };
}

passes!([const A: usize] Rod<Scalar, A>);
#[cfg(target_arch = "x86_64")]
passes!([] Rod<crate::math::simd::Modules<crate::math::simd::F64x4>, 2>, "avx2,fma");
#[cfg(target_arch = "x86_64")]
passes!([] Rod<crate::math::simd::Modules<crate::math::simd::F64x8>, 2>, "avx512f,avx512vl,avx512dq,avx2,fma");

/// The quickest rod of this processor. Lanes are for the default of one element alone: finer
/// rods serve to check it.
pub(crate) fn quickest(
    robot: &Robot,
    model: Model,
    elements: usize,
) -> Result<Box<dyn Passes>, InputError> {
    #[cfg(target_arch = "x86_64")]
    if elements == 1 {
        if crate::math::simd::has_avx512() {
            return Ok(avx512(robot, model));
        }
        if crate::math::simd::has_avx2() {
            return Ok(avx2(robot, model));
        }
    }
    Ok(Plain::new(robot, model, elements)?.boxed())
}

#[cfg(target_arch = "x86_64")]
pub(crate) fn avx512(robot: &Robot, model: Model) -> Box<dyn Passes> {
    assert!(crate::math::simd::has_avx512());
    Box::new(Rod::<crate::math::simd::Modules<crate::math::simd::F64x8>, 2>::new(robot, model))
}

#[cfg(target_arch = "x86_64")]
pub(crate) fn avx2(robot: &Robot, model: Model) -> Box<dyn Passes> {
    assert!(crate::math::simd::has_avx2());
    Box::new(Rod::<crate::math::simd::Modules<crate::math::simd::F64x4>, 2>::new(robot, model))
}

/// Memory of a rod in bytes, and of `columns` answers to single tensions; the lanes take about
/// the same.
fn bytes(robot: &Robot, elements: usize, columns: usize) -> f64 {
    match elements {
        1 => Rod::<Scalar, 2>::bytes(robot, columns),
        2 => Rod::<Scalar, 4>::bytes(robot, columns),
        4 => Rod::<Scalar, 8>::bytes(robot, columns),
        _ => Rod::<Scalar, 16>::bytes(robot, columns),
    }
}

fn size(robot: &Robot) -> String {
    format!(
        "a robot with {} disks and {} tendons",
        robot.module_count(),
        robot.tendon_count()
    )
}

/// Checks that `solvers` at a time fit into memory.
pub(crate) fn check_solvers(
    robot: &Robot,
    elements: usize,
    solvers: usize,
) -> Result<(), InputError> {
    let bytes = solvers as f64 * bytes(robot, elements, 0);
    memory::check(bytes, || size(robot), "use fewer disks")
}

/// Checks that a robot in motion fits into memory: two rods, and what inertia adds.
pub(crate) fn check_moving(robot: &Robot, elements: usize) -> Result<(), InputError> {
    let bytes = 4.0 * bytes(robot, elements, 0);
    memory::check(bytes, || size(robot), "use fewer disks")
}

/// Arrays of a transmission by modules and tendons, of its history and their copies.
const TRANSMISSION_ARRAYS: f64 = 20.0;

/// Checks that a robot that is driven through its tendons fits into memory, with `unknowns`
/// tensions and holes that stick, so many times.
pub(crate) fn check_driven(
    robot: &Robot,
    elements: usize,
    unknowns: usize,
    copies: usize,
) -> Result<(), InputError> {
    let (n, m, k) = (
        robot.module_count() as f64,
        robot.tendon_count() as f64,
        unknowns as f64,
    );
    let transmission = 8.0 * (n * m * TRANSMISSION_ARRAYS + 2.0 * k * n + 2.0 * k * k);
    let bytes = copies as f64 * (transmission + bytes(robot, elements, unknowns + 1));
    let what = || match unknowns {
        0 => size(robot),
        _ => format!("{}, {unknowns} tensions of which are unknown,", size(robot)),
    };
    memory::check(bytes, what, "use fewer disks, or pull fewer tendons")
}

/// A rod in plain numbers, by elements in a module.
pub(crate) enum Plain {
    One(Box<Rod<Scalar, 2>>),
    Two(Box<Rod<Scalar, 4>>),
    Four(Box<Rod<Scalar, 8>>),
    Eight(Box<Rod<Scalar, 16>>),
}

/// The same code for whichever rod it is.
macro_rules! with_plain {
    ($plain:expr, $rod:ident => $code:expr) => {
        match $plain {
            Plain::One($rod) => $code,
            Plain::Two($rod) => $code,
            Plain::Four($rod) => $code,
            Plain::Eight($rod) => $code,
        }
    };
}

impl Plain {
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Result<Self, InputError> {
        Ok(match elements {
            1 => Plain::One(Box::new(Rod::new(robot, model))),
            2 => Plain::Two(Box::new(Rod::new(robot, model))),
            4 => Plain::Four(Box::new(Rod::new(robot, model))),
            8 => Plain::Eight(Box::new(Rod::new(robot, model))),
            n => return Err(wrong_elements(n)),
        })
    }

    pub fn boxed(self) -> Box<dyn Passes> {
        with_plain!(self, rod => rod)
    }

    /// Takes on load, tensions and strain of another rod of `arcs` arcs, and evaluates them.
    pub fn take(&mut self, load: &Load, from: &dyn Passes, arcs: usize) {
        let mut strains = vec![Vec3::zero(); arcs];
        from.strains(&mut |i, w| strains[i] = w);
        with_plain!(self, rod => {
            rod.load(load);
            rod.set_span_tensions(|k, i| from.span_tension(k, i));
            rod.set_strains(|i| strains[i]);
            rod.evaluate();
            rod.finish();
        });
    }

    /// Points of the backbone, `per_module` in each module, base and tip included, m.
    pub fn centerline(&self, per_module: usize) -> Vec<Vec3> {
        let mut points = vec![Vec3::zero()];
        let mut from = Vec3::zero();
        with_plain!(self, rod => {
            for (k, (state, c)) in rod.states.iter().zip(&rod.constants).enumerate() {
                for j in 1..per_module {
                    let local = state.point(c, j as f64 / per_module as f64);
                    points.push(from + rod.rotations[k] * local);
                }
                from = rod.positions[k];
                points.push(from);
            }
        });
        points
    }

    pub fn jacobians(&mut self, segments: &[usize]) -> Option<Jacobians> {
        with_plain!(self, rod => sensitivity::jacobians(rod, segments))
    }
}

/// The passes of one moving rod, see [`Motion`] for what each does.
pub(crate) trait Moving: RoutedRod + Send + Sync {
    fn begin(&mut self, duration: f64, rho: f64);
    fn residual(&mut self) -> f64;
    fn imbalance(&mut self) -> f64;
    fn ready(&mut self, anew: bool) -> bool;
    fn substitute(&mut self);
    fn combine(&mut self, coefficients: &[f64]);
    fn finish(&mut self, load: &Load);
    fn restore(&mut self, excess: f64) -> bool;
    fn local_error(&mut self) -> Option<StepError>;
    fn commit(&mut self);
    fn record(&mut self, time: f64, tensions: &[f64], points: usize, out: &mut Fields);

    fn begin_at_rest(&mut self);
    fn commit_at_rest(&mut self, tendons: f64);
    fn take_strain(&mut self, strain: &[Vec3], force: &[Vec3]);
    fn set_load(&mut self, load: &Load);
    fn set_disk_force(&mut self, disk: usize, force: Vec3);
    fn jump_tensions(&mut self, tensions: &[f64]);
    fn restart(&mut self);
    fn reset_predictor(&mut self);
    fn forget_forces(&mut self);
    fn is_fresh(&self) -> bool;
    fn is_apart(&self) -> bool;
    fn balance_time(&self) -> f64;
    fn noise(&self, tensions: &[f64]) -> f64;
    fn effort(&self, distance: f64) -> f64;
    fn disk(&self, k: usize) -> Vec3;
    fn linear_momentum(&self) -> Vec3;
    fn energies(&self) -> &Energies;
    fn next_energies(&self) -> &Energies;
    fn tendon_work(&self) -> f64;
    fn account(&mut self, tendons: &Energies);
    fn put_in(&mut self, energy: f64);
    fn is_stable(&self, held: usize) -> bool;
    /// Of an iteration, in units of `interrupt::work`.
    fn work(&self) -> usize;
}

/// The same for a moving rod.
macro_rules! moving {
    ([$($generic:tt)*] $motion:ty $(, $feature:literal)?) => {
        impl<$($generic)*> Moving for $motion {
            hot!([$($generic)*] $motion, [$($feature)?]; begin(duration: f64, rho: f64) -> () |motion| motion.begin(duration, rho));
            hot!([$($generic)*] $motion, [$($feature)?]; residual() -> f64 |motion| motion.residual());
            hot!([$($generic)*] $motion, [$($feature)?]; imbalance() -> f64 |motion| motion.imbalance());
            hot!([$($generic)*] $motion, [$($feature)?]; ready(anew: bool) -> bool |motion| motion.ready(anew));
            hot!([$($generic)*] $motion, [$($feature)?]; substitute() -> () |motion| motion.substitute());
            hot!([$($generic)*] $motion, [$($feature)?]; combine(coefficients: &[f64]) -> () |motion| motion.combine(coefficients));
            hot!([$($generic)*] $motion, [$($feature)?]; finish(load: &Load) -> () |motion| motion.finish(load));
            hot!([$($generic)*] $motion, [$($feature)?]; local_error() -> Option<StepError> |motion| Motion::local_error(motion));
            hot!([$($generic)*] $motion, [$($feature)?]; commit() -> () |motion| motion.commit());
            hot!([$($generic)*] $motion, [$($feature)?]; record(time: f64, tensions: &[f64], points: usize, out: &mut Fields) -> () |motion| {
                Motion::record(motion, time, tensions, points, out)
            });

            fn restore(&mut self, excess: f64) -> bool {
                Motion::restore(self, excess)
            }
            fn begin_at_rest(&mut self) {
                Motion::begin_at_rest(self);
            }
            fn commit_at_rest(&mut self, tendons: f64) {
                Motion::commit_at_rest(self, tendons);
            }
            fn take_strain(&mut self, strain: &[Vec3], force: &[Vec3]) {
                Motion::take_strain(self, |i| strain[i], |k| force[k]);
            }
            fn set_load(&mut self, load: &Load) {
                Motion::set_load(self, load);
            }
            fn set_disk_force(&mut self, disk: usize, force: Vec3) {
                Motion::set_disk_force(self, disk, force);
            }
            fn jump_tensions(&mut self, tensions: &[f64]) {
                Motion::jump_tensions(self, tensions);
            }
            fn restart(&mut self) {
                Motion::restart(self);
            }
            fn forget_forces(&mut self) {
                Motion::forget_forces(self);
            }
            fn reset_predictor(&mut self) {
                Motion::reset_predictor(self);
            }
            fn is_fresh(&self) -> bool {
                Motion::is_fresh(self)
            }
            fn is_apart(&self) -> bool {
                Motion::is_apart(self)
            }
            fn balance_time(&self) -> f64 {
                Motion::balance_time(self)
            }
            fn noise(&self, tensions: &[f64]) -> f64 {
                Motion::noise(self, tensions)
            }
            fn effort(&self, distance: f64) -> f64 {
                Motion::effort(self, distance)
            }
            fn disk(&self, k: usize) -> Vec3 {
                Motion::disk(self, k)
            }
            fn linear_momentum(&self) -> Vec3 {
                Motion::linear_momentum(self)
            }
            fn energies(&self) -> &Energies {
                Motion::energies(self)
            }
            fn next_energies(&self) -> &Energies {
                Motion::next_energies(self)
            }
            fn tendon_work(&self) -> f64 {
                Motion::tendon_work(self)
            }
            fn account(&mut self, tendons: &Energies) {
                Motion::account(self, tendons);
            }
            fn put_in(&mut self, energy: f64) {
                Motion::put_in(self, energy);
            }
            fn is_stable(&self, held: usize) -> bool {
                Motion::is_stable(self, held)
            }
            fn work(&self) -> usize {
                Motion::work(self)
            }
        }

        impl<$($generic)*> RoutedRod for $motion {
            hot!([$($generic)*] $motion, [$($feature)?]; measure_spans(angles: bool) -> () |motion| motion.measure_spans(angles));
            hot!([$($generic)*] $motion, [$($feature)?]; respond(sources: Sources) -> () |motion| motion.respond(sources));
            fn span_lengths(&self) -> &[f64] {
                Motion::span_lengths(self)
            }
            fn angles(&self) -> &[f64] {
                Motion::angles(self)
            }
            fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
                Motion::beyond(self, hole, tendon, out);
            }
            fn set_span_tensions(&mut self, tensions: &[f64]) {
                let count = tensions.len() / self.module_count();
                Motion::set_span_tensions(self, |k, i| tensions[k * count + i]);
            }
        }
    };
}

moving!([const A: usize] Motion<Scalar, A>);
#[cfg(target_arch = "x86_64")]
moving!([] Motion<crate::math::simd::Modules<crate::math::simd::F64x4>, 2>, "avx2,fma");
#[cfg(target_arch = "x86_64")]
moving!([] Motion<crate::math::simd::Modules<crate::math::simd::F64x8>, 2>, "avx512f,avx512vl,avx512dq,avx2,fma");

/// The quickest moving rod of this processor, as [`quickest`].
pub(crate) fn moving(
    robot: &Robot,
    model: Model,
    elements: usize,
    gravity: [f64; 3],
    damping: Damping,
) -> Result<Box<dyn Moving>, InputError> {
    #[cfg(target_arch = "x86_64")]
    if elements == 1 {
        if crate::math::simd::has_avx512() {
            return Ok(Box::new(Motion::<
                crate::math::simd::Modules<crate::math::simd::F64x8>,
                2,
            >::new(robot, model, gravity, damping)));
        }
        if crate::math::simd::has_avx2() {
            return Ok(Box::new(Motion::<
                crate::math::simd::Modules<crate::math::simd::F64x4>,
                2,
            >::new(robot, model, gravity, damping)));
        }
    }
    Ok(match elements {
        1 => Box::new(Motion::<Scalar, 2>::new(robot, model, gravity, damping)),
        2 => Box::new(Motion::<Scalar, 4>::new(robot, model, gravity, damping)),
        4 => Box::new(Motion::<Scalar, 8>::new(robot, model, gravity, damping)),
        8 => Box::new(Motion::<Scalar, 16>::new(robot, model, gravity, damping)),
        n => return Err(wrong_elements(n)),
    })
}

fn wrong_elements(n: usize) -> InputError {
    InputError(format!("elements is {n}, it must be 1, 2, 4 or 8"))
}
