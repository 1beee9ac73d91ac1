//! Rods in the number types that suit the processor, behind one interface.
//!
//! Each pass is compiled once for each number type with the processor instructions that it needs;
//! the algorithms that call the passes are written and compiled once.

use crate::math::instructions::Instructions;
use crate::math::lie::Pose;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real, Scalar};
#[cfg(target_arch = "x86_64")]
use crate::math::simd::{Avx2, Avx512, Modules, Robots, Simd};
use crate::memory;
use crate::model::error::InputError;
use crate::model::load::{Load, Model, TendonPath};
use crate::model::robot::Robot;
use crate::rod::chain::Rod;
use crate::rod::estimate::Correction;
use crate::rod::groups::get;
use crate::rod::newton_step::Step;
use crate::rod::responses::Sources;
use crate::rod::routed::RoutedRod;
use crate::rod::routes::in_group;
use crate::rod::sensitivity::{self, Jacobians};
use crate::step::{Damping, Motion, MotionsSideBySide, Moving, SideBySide};

/// The passes of one rod; see [`Rod`] for what each does.
pub trait Passes: RoutedRod + Send + Sync {
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
    /// Motion as of [`Correction`] by the step for the present gradient, after `estimate`.
    fn correct_step(&mut self) -> f64;
    /// Derivatives of tip and strain with respect to tensions, if the rod has them in its lanes.
    fn respond_to_tensions(&mut self, columns: &mut [[Vec3; 2]]) -> bool;
    fn add_strain_of_responses(&self, changes: &[f64], strain: &mut [Vec3]);

    fn load(&mut self, load: &Load);
    fn make_unloaded(&mut self);
    fn set_strains(&mut self, strain: &dyn Fn(usize) -> Vec3);
    fn strains(&self, visit: &mut dyn FnMut(usize, Vec3));
    /// See [`Rod::curvatures`].
    fn curvatures(&self, visit: &mut dyn FnMut(usize, Vec3));
    /// See [`Rod::set_unloaded_curvatures`].
    fn set_unloaded_curvatures(&mut self, of: &dyn Fn(usize) -> Vec3);
    /// Contact force of every module (N), in the frame of its start disk.
    fn contact_forces(&self, visit: &mut dyn FnMut(usize, Vec3));
    fn set_gradient(&mut self, value: &dyn Fn(usize) -> Vec3);
    /// Right-hand side of the next step, arc by arc from base to tip.
    fn gradients(&self, visit: &mut dyn FnMut(usize, Vec3));
    /// The last step, arc by arc from base to tip.
    fn steps(&self, visit: &mut dyn FnMut(usize, Vec3));
    /// Copies the step to the right-hand side, for inverse iteration.
    fn step_to_gradient(&mut self, scale: f64);
    fn save(&mut self);
    fn advance(&mut self, fraction: f64);
    /// Rotation of every disk by a unit moment on it (rad/(N m)), in its frame; see
    /// [`Rod::flexibilities`].
    fn flexibilities(&self, visit: &mut dyn FnMut(usize, Mat3));
    /// Number of negative eigenvalues of the second variation that was eliminated last.
    fn negative_pivots(&self) -> usize;
    fn span_tension(&self, k: usize, i: usize) -> f64;
    /// Length of a tendon at the last `finish` (m).
    fn length(&self, i: usize) -> f64;
    /// Error of a tendon's length at the last `estimate` (m).
    fn length_error(&self, i: usize) -> f64;
    fn disk(&self, k: usize) -> Pose;
    fn collision(&self) -> Option<usize>;
    /// Whether its modules can be divided at loads between two disks.
    fn divides(&self) -> bool;
    fn has_potential(&self) -> bool;
    fn module_count(&self) -> usize;
    fn energy_scale(&self, length: f64) -> f64;
    fn boxed_clone(&self) -> Box<dyn Passes>;
}

impl Clone for Box<dyn Passes> {
    fn clone(&self) -> Self {
        self.boxed_clone()
    }
}

impl<L: Layout, const A: usize> Passes for Rod<L, A> {
    fn evaluate(&mut self) -> f64 {
        self.evaluate().lane(0)
    }
    fn balance(&mut self) -> f64 {
        self.balance().lane(0)
    }
    fn gradient(&mut self) -> f64 {
        self.gradient().lane(0)
    }
    fn linearise(&mut self) {
        self.linearise();
    }
    fn eliminate(&mut self, symmetric: bool, shift: f64) -> f64 {
        let shift = Real::splat(shift);
        let pivot = match symmetric {
            true => self.eliminate::<true>(shift),
            false => self.eliminate::<false>(shift),
        };
        pivot.lane(0)
    }
    fn newton_step(&mut self, symmetric: bool) -> Step<f64> {
        let step = match symmetric {
            true => self.newton_step::<true>(),
            false => self.newton_step::<false>(),
        };
        Step {
            slope: step.slope.lane(0),
            largest: step.largest.lane(0),
        }
    }
    fn combine(&mut self, coefficients: &[f64]) -> f64 {
        self.layout.vectorize(
            #[inline(always)]
            || self.combine(coefficients),
        )
    }
    fn advance(&mut self, fraction: f64) {
        self.layout.vectorize(
            #[inline(always)]
            || self.advance(Real::splat(fraction)),
        )
    }
    fn finish(&mut self) {
        self.finish();
    }
    fn estimate(&mut self) -> Correction<f64> {
        self.estimate().of_lane(0)
    }
    fn correct(&mut self, coefficients: &[f64]) -> f64 {
        self.combine_rotations(coefficients);
        self.correction().lane(0)
    }

    fn correct_step(&mut self) -> f64 {
        self.rotations_of_last_elimination();
        self.correction().lane(0)
    }
    fn respond_to_tensions(&mut self, columns: &mut [[Vec3; 2]]) -> bool {
        self.layout.vectorize(
            #[inline(always)]
            || self.respond_to_tensions(columns),
        )
    }
    fn add_strain_of_responses(&self, changes: &[f64], strain: &mut [Vec3]) {
        self.layout.vectorize(
            #[inline(always)]
            || self.add_strain_of_responses(changes, strain),
        )
    }
    fn load(&mut self, load: &Load) {
        Rod::load(self, load);
    }
    fn make_unloaded(&mut self) {
        Rod::make_unloaded(self);
    }
    fn set_strains(&mut self, strain: &dyn Fn(usize) -> Vec3) {
        Rod::set_strains(self, strain);
    }
    fn strains(&self, visit: &mut dyn FnMut(usize, Vec3)) {
        Rod::strains(self, visit);
    }
    fn curvatures(&self, visit: &mut dyn FnMut(usize, Vec3)) {
        Rod::curvatures(self, visit);
    }
    fn set_unloaded_curvatures(&mut self, of: &dyn Fn(usize) -> Vec3) {
        Rod::set_unloaded_curvatures(self, of);
    }
    fn contact_forces(&self, visit: &mut dyn FnMut(usize, Vec3)) {
        for k in 0..self.module_count() {
            let n = get::<L>(&self.states[k / L::WIDTH].n, k % L::WIDTH);
            visit(k, n.of_lane(0));
        }
    }
    fn set_gradient(&mut self, value: &dyn Fn(usize) -> Vec3) {
        Rod::set_gradient(self, value);
    }
    fn gradients(&self, visit: &mut dyn FnMut(usize, Vec3)) {
        self.each_arc(|g| &self.gradients[g].g, visit);
    }
    fn steps(&self, visit: &mut dyn FnMut(usize, Vec3)) {
        self.each_arc(|g| &self.newton.step[g], visit);
    }
    fn step_to_gradient(&mut self, scale: f64) {
        for (gradient, step) in self.gradients.iter_mut().zip(&self.newton.step) {
            for a in 0..A {
                gradient.g[a] = step[a] * L::Module::splat(scale);
            }
        }
    }
    fn save(&mut self) {
        Rod::save(self);
    }
    fn flexibilities(&self, visit: &mut dyn FnMut(usize, Mat3)) {
        self.layout.vectorize(
            #[inline(always)]
            || {
                self.flexibilities(
                    #[inline(always)]
                    |k, m| visit(k, m.of_lane(0)),
                )
            },
        )
    }
    fn negative_pivots(&self) -> usize {
        self.newton
            .eliminated
            .iter()
            .map(|e| e.negative_pivots())
            .sum()
    }
    fn span_tension(&self, k: usize, i: usize) -> f64 {
        Rod::span_tension(self, k, i)
    }
    fn length(&self, i: usize) -> f64 {
        self.placed.lengths[i].lane(0)
    }
    fn length_error(&self, i: usize) -> f64 {
        self.errors.lengths[i].lane(0)
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
    fn divides(&self) -> bool {
        self.fixed.source.is_some()
    }
    fn has_potential(&self) -> bool {
        Rod::has_potential(self)
    }
    fn energy_scale(&self, length: f64) -> f64 {
        Rod::energy_scale(self, length, 0)
    }
    fn boxed_clone(&self) -> Box<dyn Passes> {
        Box::new(self.clone())
    }
}

impl<L: Layout, const A: usize> RoutedRod for Rod<L, A> {
    fn measure_spans(&mut self, angles: bool) {
        self.measure_spans(angles);
    }
    fn respond(&mut self, sources: Sources) {
        self.respond(sources);
    }
    fn span_lengths(&self) -> &[f64] {
        &self.spans.lengths
    }
    fn angles(&self) -> &[f64] {
        &self.spans.angles
    }
    fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        Rod::beyond(self, hole, tendon, out);
    }
    fn bend(&self, module: usize) -> f64 {
        Rod::bend(self, module)
    }
    fn add_bending(&self, module: usize, factor: f64, out: &mut [f64]) {
        Rod::add_bending(self, module, factor, out);
    }
    fn set_span_tensions(&mut self, tensions: &[f64]) {
        let count = self.tendons.len();
        Rod::set_span_tensions(self, |k, i| tensions[k * count + i]);
    }
}

/// Something to construct in the number type of a layout, with `A` arcs in a module.
trait Build {
    type Built;
    fn build<L: Layout, const A: usize>(self, layout: L) -> Self::Built;
}

/// Whether lanes take a robot: not with coupled sections or continuous tendons, which are rare.
pub fn fits_lanes(robot: &Robot, model: Model) -> bool {
    !robot.is_coupled() && model.tendon == TendonPath::Straight
}

/// Constructs it in the fastest number type of this processor up to `most`. SIMD lanes are used for
/// one element in a module only.
#[cfg_attr(not(target_arch = "x86_64"), allow(unused_variables))]
fn build<B: Build>(
    in_lanes: bool,
    elements: usize,
    most: Instructions,
    of: B,
) -> Result<B::Built, InputError> {
    #[cfg(target_arch = "x86_64")]
    if elements == 1 && in_lanes {
        if let (Instructions::Avx512, Some(simd)) = (most, Avx512::detect()) {
            return Ok(of.build::<_, 2>(Modules(simd)));
        }
        if let (true, Some(simd)) = (most >= Instructions::Avx2, Avx2::detect()) {
            return Ok(of.build::<_, 2>(Modules(simd)));
        }
    }
    Ok(match elements {
        1 => of.build::<_, 2>(Scalar),
        2 => of.build::<_, 4>(Scalar),
        4 => of.build::<_, 8>(Scalar),
        8 => of.build::<_, 16>(Scalar),
        n => return Err(InputError::elements(n)),
    })
}

/// Refuses tendons along curves beside coupled sections, which would change their strains at every
/// place.
fn check_model(robot: &Robot, model: Model) -> Result<(), InputError> {
    if robot.is_coupled() && model.tendon.is_continuous() {
        return Err(InputError::other(
            "a backbone given by a stiffness matrix with couplings has straight tendons only: set the \
             tendon path to straight",
        ));
    }
    Ok(())
}

/// The fastest rod of this processor.
///
/// # Errors
/// If the model does not fit the robot, or elements are not 1, 2, 4 or 8.
pub fn quickest(
    robot: &Robot,
    model: Model,
    elements: usize,
) -> Result<Box<dyn Passes>, InputError> {
    up_to(Instructions::Avx512, robot, model, elements)
}

/// The fastest rod with these instructions at most.
///
/// # Errors
/// As [`quickest`].
pub fn up_to(
    most: Instructions,
    robot: &Robot,
    model: Model,
    elements: usize,
) -> Result<Box<dyn Passes>, InputError> {
    check_model(robot, model)?;
    struct AtRest<'a>(&'a Robot, Model);
    impl Build for AtRest<'_> {
        type Built = Box<dyn Passes>;
        fn build<L: Layout, const A: usize>(self, layout: L) -> Self::Built {
            Box::new(Rod::<L, A>::new(layout, self.0, self.1))
        }
    }
    // two elements are often chosen; finer rods are rare, and verify these. Where a load acts between
    // two disks, plain numbers take their place ([`Passes::divides`]).
    #[cfg(target_arch = "x86_64")]
    if elements == 2 && fits_lanes(robot, model) {
        if let (Instructions::Avx512, Some(simd)) = (most, Avx512::detect()) {
            return Ok(AtRest(robot, model).build::<_, 4>(Modules(simd)));
        }
        if let (true, Some(simd)) = (most >= Instructions::Avx2, Avx2::detect()) {
            return Ok(AtRest(robot, model).build::<_, 4>(Modules(simd)));
        }
    }
    let in_lanes = fits_lanes(robot, model);
    build(in_lanes, elements, most, AtRest(robot, model))
}

/// Memory of a rod (bytes) and of the responses to `columns` single tensions; a rod in SIMD lanes
/// takes about the same.
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

/// Checks that `solvers` concurrent solvers fit into memory.
pub fn check_solvers(robot: &Robot, elements: usize, solvers: usize) -> Result<(), InputError> {
    let bytes = solvers as f64 * bytes(robot, elements, 0);
    memory::check(bytes, || size(robot), "use fewer disks")
}

/// Checks that `solvers` concurrent inverse solvers fit into memory: two rods each, one of which
/// responds to every tension.
pub fn check_inverses(robot: &Robot, elements: usize, solvers: usize) -> Result<(), InputError> {
    let columns = robot.tendon_count() + 1;
    let rods = bytes(robot, elements, 0) + bytes(robot, elements, columns);
    let advice = "use fewer disks, or fewer tendons";
    memory::check(solvers as f64 * rods, || size(robot), advice)
}

/// Checks that a robot in motion fits into memory: two rods, and the arrays of inertia.
pub fn check_moving(robot: &Robot, elements: usize) -> Result<(), InputError> {
    check_solvers(robot, elements, 4)
}

/// Number of arrays by modules and tendons in a transmission, its history and their copies.
const TRANSMISSION_ARRAYS: f64 = 20.0;

/// Checks that a robot with a transmission fits into memory, with `unknowns` tensions and sticking
/// holes, so many times.
pub fn check_path(
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
    memory::check(bytes, what, "use fewer disks, or fewer tendons")
}

/// A rod in plain numbers, with the queries beside its passes.
pub trait Plain: Passes {
    /// Copies load, tensions and strain of another rod of `arcs` arcs, and evaluates them.
    fn take(&mut self, load: &Load, from: &dyn Passes, arcs: usize);
    /// Takes a load, and the strain of every arc at its equilibrium, and evaluates them.
    fn take_strain(&mut self, load: &Load, strain: &[Vec3]);
    /// Points of the backbone (m), `per_module` in each module, base and tip included.
    fn centerline(&self, per_module: usize) -> Vec<Vec3>;
    /// Elastic energy of the backbone (J).
    fn elastic_energy(&self) -> f64;
    /// Derivatives of tip and lengths; see [`sensitivity::jacobians`].
    fn jacobians(&mut self, segments: &[usize], gravity: bool) -> Option<Jacobians>;
    /// Derivatives of the tip alone; see [`sensitivity::tip_by_tensions`].
    fn tip_by_tensions(&mut self, rotation: bool, columns: &mut [[Vec3; 2]]) -> bool;
    /// Change of strain; see [`sensitivity::add_strain_by_tensions`].
    fn add_strain_by_tensions(&self, changes: &[f64], strain: &mut [Vec3]);
}

impl<const A: usize> Plain for Rod<Scalar, A> {
    fn take(&mut self, load: &Load, from: &dyn Passes, arcs: usize) {
        let mut strains = vec![Vec3::zero(); arcs];
        from.strains(&mut |i, w| strains[i] = w);
        self.load(load);
        // discards the contact forces of an earlier state, from which the balance would start
        Rod::make_unloaded(self);
        Rod::set_span_tensions(self, |k, i| from.span_tension(k, i));
        self.set_strains(|i| strains[i]);
        self.evaluate();
        self.finish();
    }

    fn take_strain(&mut self, load: &Load, strain: &[Vec3]) {
        self.load(load);
        // as in `take`
        Rod::make_unloaded(self);
        self.set_strains(|i| strain[i]);
        self.evaluate();
        self.finish();
    }

    fn centerline(&self, per_module: usize) -> Vec<Vec3> {
        let mut points = vec![Vec3::zero()];
        let mut from = Vec3::zero();
        for (k, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            let t = in_group(&self.tendons, &self.tensions, self.path, k);
            for j in 1..per_module {
                let local = state.point(c, &t, j as f64 / per_module as f64);
                points.push(from + self.rotations[k] * local);
            }
            from = self.placed.positions[k];
            points.push(from);
        }
        points
    }

    fn elastic_energy(&self) -> f64 {
        let modules = self.states.iter().zip(&self.constants);
        modules.map(|(state, c)| state.elastic_energy(c)).sum()
    }

    fn jacobians(&mut self, segments: &[usize], gravity: bool) -> Option<Jacobians> {
        sensitivity::jacobians(self, segments, gravity)
    }

    fn tip_by_tensions(&mut self, rotation: bool, columns: &mut [[Vec3; 2]]) -> bool {
        sensitivity::tip_by_tensions(self, rotation, columns)
    }

    fn add_strain_by_tensions(&self, changes: &[f64], strain: &mut [Vec3]) {
        sensitivity::add_strain_by_tensions(self, changes, strain);
    }
}

/// A rod in plain numbers, by elements in a module.
pub fn plain(robot: &Robot, model: Model, elements: usize) -> Result<Box<dyn Plain>, InputError> {
    Ok(match elements {
        1 => Box::new(Rod::<_, 2>::new(Scalar, robot, model)),
        2 => Box::new(Rod::<_, 4>::new(Scalar, robot, model)),
        4 => Box::new(Rod::<_, 8>::new(Scalar, robot, model)),
        8 => Box::new(Rod::<_, 16>::new(Scalar, robot, model)),
        n => return Err(InputError::elements(n)),
    })
}

/// The fastest moving rod of this processor.
pub fn moving(
    robot: &Robot,
    model: Model,
    elements: usize,
    gravity: [f64; 3],
    damping: Damping,
) -> Result<Box<dyn Moving>, InputError> {
    check_model(robot, model)?;
    struct InMotion<'a>(&'a Robot, Model, [f64; 3], Damping);
    impl Build for InMotion<'_> {
        type Built = Box<dyn Moving>;
        fn build<L: Layout, const A: usize>(self, layout: L) -> Self::Built {
            let InMotion(robot, model, gravity, damping) = self;
            Box::new(Motion::<L, A>::new(layout, robot, model, gravity, damping))
        }
    }
    let of = InMotion(robot, model, gravity, damping);
    let in_lanes = fits_lanes(robot, model);
    build(in_lanes, elements, Instructions::Avx512, of)
}

/// Motions side by side in the lanes of this processor, under a dead force on the tip: eight, four or
/// one. Lanes take straight tendons and one element in a module.
pub fn motions_side_by_side(
    robot: &Robot,
    model: Model,
    elements: usize,
    damping: Damping,
    load: &Load,
) -> Result<Box<dyn MotionsSideBySide>, InputError> {
    check_model(robot, model)?;
    fn make<L: Layout, const A: usize>(
        layout: L,
        (robot, model, damping, load): (&Robot, Model, Damping, &Load),
    ) -> Box<dyn MotionsSideBySide> {
        let motion = Motion::<L, A>::new(layout, robot, model, load.gravity, damping);
        Box::new(SideBySide::new(motion, load))
    }
    let of = (robot, model, damping, load);
    #[cfg(target_arch = "x86_64")]
    if elements == 1 && fits_lanes(robot, model) {
        if let Some(simd) = Avx512::detect() {
            return Ok(make::<_, 2>(Robots(simd), of));
        }
        if let Some(simd) = Avx2::detect() {
            return Ok(make::<_, 2>(Robots(simd), of));
        }
    }
    Ok(match elements {
        1 => make::<_, 2>(Scalar, of),
        2 => make::<_, 4>(Scalar, of),
        4 => make::<_, 8>(Scalar, of),
        8 => make::<_, 16>(Scalar, of),
        n => return Err(InputError::elements(n)),
    })
}
