//! The whole robot as a chain of modules: its data, loads and numbers. The passes of every solver are
//! in [`crate::rod::evaluation`], [`crate::rod::newton_step`] and [`crate::rod::responses`].
//!
//! Theory: docs/theory/statics.md.
//!
//! Work inside a module runs in SIMD lanes (`L::Module`); recursions from module to module, for
//! rotations, costate and elimination, run along the chain (`L::Chain`).

use crate::math::copies;
use crate::math::lie::Pose;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real, MOST_LANES};
use crate::model::load::{Model, PointLoad, TendonPath};
use crate::model::robot::{Payload, Robot};
use crate::rod::constants::{Constants, Taper};
use crate::rod::defect::Defect;
use crate::rod::elimination::Eliminated;
use crate::rod::groups::{get, put};
use crate::rod::routes::Routes;
#[cfg(doc)]
use crate::rod::routes::Tendons;
use crate::rod::span::Span;
use crate::rod::state::{Gradient, Hessian, Response, State};
use std::ops::Range;

/// A robot under load, with its scratch memory: no pass of a solve allocates.
#[derive(Clone)]
pub struct Rod<L: Layout, const A: usize> {
    /// Proof that the processor has these numbers.
    pub layout: L,
    /// Constants by groups of `L::WIDTH` modules, as states and gradients; the last group may hold
    /// idle lanes.
    pub constants: Vec<Constants<L::Module, A>>,
    /// Course of the backbone in the same groups; empty for robots without a taper.
    pub tapers: Vec<Taper<L::Module>>,
    pub states: Vec<State<L::Module, A>>,
    pub gradients: Vec<Gradient<L::Module, A>>,
    /// Rotations of the disks, base included.
    pub rotations: Vec<Mat3<L::Chain>>,
    pub tendons: Routes<L::Module>,
    pub path: TendonPath,
    /// Tension of every tendon in every group (N); zero where it does not pass.
    pub tensions: Vec<L::Module>,
    pub fixed: Fixed<L, A>,
    pub dead: DeadLoads<L::Chain>,
    pub attached: Attached<L::Chain, A>,
    /// Forces on the nodes between elements by groups; empty unless loads act between disks. See
    /// [`Tendons::on_nodes`].
    pub on_nodes: Vec<[Vec3<L::Module>; A]>,
    pub newton: Newton<L, A>,
    pub spans: Spans<L, A>,
    pub placed: Placed<L::Chain>,
    pub errors: Errors<L>,
}

/// Properties of the robot beside the constants of its modules.
#[derive(Clone)]
pub struct Fixed<L: Layout, const A: usize> {
    pub modules: Vec<Constants<L::Chain, A>>,
    /// Whether the unloaded curvature may vary along a module.
    pub keeps_curvature: bool,
    /// By modules; empty for robots without a taper.
    tapers: Vec<Taper<L::Chain>>,
    /// Robot and model of modules that a load between two disks can divide; `None` in lanes.
    pub source: Option<Box<(Robot, Model)>>,
    /// Masses of the disks (kg).
    masses: Vec<L::Chain>,
    /// Payloads of the first robot.
    pub payloads: Vec<Payload>,
    /// First tendon that passes each module.
    first_tendon: Vec<usize>,
    /// By groups and tendons: one where the tendon passes, otherwise zero.
    pub passes: Vec<L::Module>,
}

impl<L: Layout, const A: usize> Fixed<L, A> {
    /// Loads on a module (see [`State::f`]) by its weight and by the force beyond its disk (N), to
    /// which the weight of disk and module is added.
    #[inline(always)]
    fn weight_on(
        &self,
        k: usize,
        gravity: Vec3<L::Chain>,
        force: &mut Vec3<L::Chain>,
    ) -> [Vec3<L::Chain>; 4] {
        let c = &self.modules[k];
        let (h, [start, end]) = (c.flexible, c.clamp);
        let weight = gravity * c.mass_per_length;
        *force += gravity * self.masses[k];
        let mut loads = c.lumped(weight, *force);
        if let Some(taper) = self.tapers.get(k) {
            let (shift, turns) = taper.lumped(h, gravity);
            loads[0] += shift;
            loads[1] += turns[1] + gravity * taper.clamps[1];
            loads[2] += turns[0] + gravity * taper.clamps[0];
        }
        *force += weight * (h + start + end);
        loads
    }
}

/// Dead loads in the base frame.
#[derive(Clone)]
pub struct DeadLoads<C> {
    /// Forces (N) and moments (N m) by modules; see [`State::f`].
    pub modules: Vec<[Vec3<C>; 4]>,
    /// Gravity (m/s^2).
    pub gravity: Vec3<C>,
    /// Whether forces act on disks other than the tip: they may nearly cancel at the base.
    pub on_disks: bool,
}

/// Moments and point loads on the disks of a robot.
#[derive(Clone)]
pub struct Attached<C, const A: usize> {
    /// Dead moments on the disks in the base frame (N m), that on the tip included; empty if there
    /// are none.
    pub moments: Vec<Vec3<C>>,
    /// By disks from base to tip.
    pub loads: Vec<PointLoad>,
    pub between: Between<C>,
    /// Modules before the last follower force.
    pub followed: usize,
    /// Loads on the modules without followers; empty if there are none.
    pub constant: Vec<[Vec3<C>; 4]>,
    /// By modules before the last follower force, from the last elimination.
    pub couplings: Vec<Coupling<C, A>>,
    /// Change of the force of the part beyond a disk by its rotation (N), during an elimination.
    pub by_turn: Mat3<C>,
}

/// Effect on a module of a change of the force beyond it, in the frame of its start.
#[derive(Clone, Copy)]
pub struct Coupling<T, const A: usize> {
    /// Change of the force by the rotation of the module's end (N).
    pub by_turn: Mat3<T>,
    /// Moment imbalance of each arc and of the start by the force (m).
    pub arcs: [Mat3<T>; A],
    pub start: Mat3<T>,
}

/// Loads between disks, and the sections on which they act, both from base to tip.
#[derive(Clone)]
pub struct Between<C> {
    /// By sections; `disk` is the one after them.
    pub loads: Vec<PointLoad>,
    pub sections: Vec<LoadedSection<C>>,
}

/// A section of the backbone, at the node before an element.
#[derive(Clone)]
pub struct LoadedSection<C> {
    /// Module, and fraction of its flexible part.
    pub module: usize,
    pub fraction: f64,
    /// The element after it.
    pub element: usize,
    /// Its loads in the list of all.
    pub loads: Range<usize>,
    /// Sum of their forces in the base frame (N).
    pub force: Vec3<C>,
    /// Couple on the tangent by Hermite's rule of the weight, in the base frame (N m).
    pub couple: Vec3<C>,
    /// Imbalance of the moment (N m), in the frame of the module's start, from the last gradient.
    pub torque: Vec3<C>,
    /// Change of the force by the rotation of the section (N), in the same frame, from the last
    /// elimination.
    pub by_turn: Mat3<C>,
}

/// Data of a Newton step.
#[derive(Clone)]
pub struct Newton<L: Layout, const A: usize> {
    pub hessians: Vec<Hessian<L::Module, A>>,
    /// Responses of the ends of modules, from the last `linearise`.
    pub responses: Vec<Response<L::Module, A>>,
    /// Eliminated blocks, by modules.
    pub eliminated: Vec<Eliminated<L::Chain, A, 1>>,
    /// Whether the last elimination was that of a symmetric tangent.
    pub symmetric: bool,
    pub step: Vec<[Vec3<L::Module>; A]>,
    /// Strain to return to.
    pub saved: Vec<[Vec3<L::Module>; A]>,
    /// Contact force to return to (N), as a start for the next balance.
    pub saved_force: Vec<Vec3<L::Module>>,
}

/// Spans of the last `measure_spans`, and their responses.
#[derive(Clone)]
pub struct Spans<L: Layout, const A: usize> {
    /// Spans by groups and tendons.
    pub spans: Vec<Span<L::Module>>,
    /// Lengths by modules and tendons (m); zero where the tendon does not pass.
    pub lengths: Vec<f64>,
    /// Angles of the tendons at the holes where spans begin, by modules and tendons (rad).
    pub angles: Vec<f64>,
    /// Responses to right-hand sides; see `respond`.
    pub responses: Vec<SourceResponses<L, A>>,
}

/// Responses of the rod, side by side in the lanes that hold modules elsewhere.
#[derive(Clone)]
pub struct SourceResponses<L: Layout, const A: usize> {
    /// By modules: rotation added by every arc, and force on the end.
    pub u: Vec<[Vec3<L::Module>; A]>,
    pub force: Vec<Vec3<L::Module>>,
    /// By modules and tendons: length change of a tendon from the start of the module on.
    pub beyond: Vec<L::Module>,
}

/// Positions and lengths of the last `finish`.
#[derive(Clone)]
pub struct Placed<C> {
    /// Positions of the disks (m).
    pub positions: Vec<Vec3<C>>,
    /// Lengths of the tendons (m).
    pub lengths: Vec<C>,
    /// Smallest forward component of a module's chord and its loaded spans.
    pub forward: Vec<C>,
}

/// Discretisation error of the last `estimate`.
#[derive(Clone)]
pub struct Errors<L: Layout> {
    /// Defects by groups.
    pub defects: Vec<Defect<L::Module>>,
    /// Errors of the tendon lengths (m).
    pub lengths: Vec<L::Chain>,
}

/// A value of every module of every robot, by robots and modules.
fn of_modules<P>(robots: &[Robot], of: impl Fn(&Robot, usize) -> P) -> Vec<P> {
    let mut all = vec![];
    for robot in robots {
        for k in 0..robot.module_count() {
            all.push(of(robot, k));
        }
    }
    all
}

/// Values of the modules in the lanes of a group: `width` modules of the first robot, or one module
/// of several robots. The last of them is also in the lanes beyond.
fn lanes_of<P>(
    of: &[P],
    modules: usize,
    robots: usize,
    width: usize,
    group: usize,
) -> [&P; MOST_LANES] {
    std::array::from_fn(|lane| match width {
        1 => &of[lane.min(robots - 1) * modules + group],
        _ => &of[(group * width + lane).min(modules - 1)],
    })
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Whether loads can act between two disks. They need two elements, and plain numbers.
    pub const BETWEEN: bool = A > 2 && L::Chain::PLAIN;

    #[inline(never)]
    pub fn new(layout: L, robot: &Robot, model: Model) -> Self {
        layout.vectorize(
            #[inline(always)]
            || Self::new_in_lanes(layout, robot, model),
        )
    }

    #[inline(always)]
    fn new_in_lanes(layout: L, robot: &Robot, model: Model) -> Self {
        let n = robot.module_count();
        let groups = n.div_ceil(L::WIDTH);
        let zero = [Vec3::zero(); A];
        let tendons = robot.tendon_count();
        let mut passes = copies(L::Module::zero(), groups * tendons);
        for (i, tendon) in robot.spec().tendons.iter().enumerate() {
            for k in 0..=tendon.end_disk {
                let place = &mut passes[k / L::WIDTH * tendons + i];
                L::put(place, k % L::WIDTH, L::Chain::splat(1.0));
            }
        }
        let mut rod = Rod {
            layout,
            constants: vec![],
            tapers: vec![],
            states: copies(State::straight(), groups),
            gradients: copies(Gradient::empty(), groups),
            rotations: copies(Mat3::identity(), n + 1),
            tendons: Routes::empty(),
            path: model.tendon,
            tensions: copies(L::Module::zero(), groups * tendons),
            fixed: Fixed {
                masses: vec![],
                payloads: vec![],
                first_tendon: robot.modules.iter().map(|m| m.first_tendon).collect(),
                passes,
                modules: vec![],
                keeps_curvature: false,
                tapers: vec![],
                source: None,
            },
            dead: DeadLoads {
                modules: copies([Vec3::zero(); 4], n),
                gravity: Vec3::zero(),
                on_disks: false,
            },
            attached: Attached {
                moments: vec![],
                loads: vec![],
                between: Between {
                    loads: vec![],
                    sections: vec![],
                },
                followed: 0,
                constant: vec![],
                couplings: vec![],
                by_turn: Mat3::zero(),
            },
            on_nodes: vec![],
            newton: Newton {
                hessians: copies(Hessian::empty(), groups),
                responses: copies(Response::empty(), groups),
                eliminated: copies(Eliminated::empty(), n),
                symmetric: true,
                step: copies(zero, groups),
                saved: copies(zero, groups),
                saved_force: copies(Vec3::zero(), groups),
            },
            spans: Spans {
                spans: vec![],
                lengths: vec![0.0; n * tendons],
                angles: vec![0.0; n * tendons],
                responses: vec![],
            },
            placed: Placed {
                positions: copies(Vec3::zero(), n),
                lengths: copies(L::Chain::zero(), tendons),
                forward: copies(L::Chain::splat(1.0), n),
            },
            errors: Errors {
                defects: copies(Defect::none(), groups),
                lengths: copies(L::Chain::zero(), tendons),
            },
        };
        rod.set_robots(std::slice::from_ref(robot), model);
        if A > 2 && L::WIDTH == 1 && L::Chain::LANES == 1 {
            rod.fixed.source = Some(Box::new((robot.clone(), model)));
        }
        rod.make_unloaded();
        rod
    }

    /// Replaces the numbers of the robots, which have the topology of the rod's own: one for each
    /// lane of the chain, the last one also in the lanes beyond.
    #[inline(never)]
    pub fn set_robots(&mut self, robots: &[Robot], model: Model) {
        let n = self.module_count();
        let constants = |robot: &Robot, k: usize| Constants::new(robot, k, model);
        let plain: Vec<_> = of_modules(robots, constants);
        self.fixed.modules.clear();
        self.constants.clear();
        for k in 0..n {
            let chain = lanes_of(&plain, n, robots.len(), 1, k);
            self.fixed
                .modules
                .push(Constants::gather(&chain[..L::Chain::LANES]));
        }
        for g in 0..self.states.len() {
            let lanes = lanes_of(&plain, n, robots.len(), L::WIDTH, g);
            let mut group = Constants::gather(&lanes[..L::Module::LANES]);
            // idle lanes repeat the last module; straight, they stay without imbalance
            for i in (n - g * L::WIDTH).min(L::WIDTH)..L::WIDTH {
                for rest in &mut group.rest {
                    put::<L>(rest, i, Vec3::zero());
                }
            }
            self.constants.push(group);
        }
        self.set_tapers(robots, model);
        self.fixed.masses.clear();
        for k in 0..n {
            let mut mass = L::Chain::zero();
            for lane in 0..L::Chain::LANES {
                let robot = &robots[lane.min(robots.len() - 1)];
                mass.set_lane(lane, robot.disk_mass[k]);
            }
            self.fixed.masses.push(mass);
        }
        self.fixed.payloads.clear();
        self.fixed.payloads.extend(&robots[0].spec().payloads);
        self.tendons.set::<L>(robots, model.tendon);
    }

    fn set_tapers(&mut self, robots: &[Robot], model: Model) {
        self.tapers.clear();
        self.fixed.tapers.clear();
        if !robots.iter().any(Robot::has_taper) {
            return;
        }
        let n = self.module_count();
        let plain: Vec<_> = of_modules(robots, |robot, k| Taper::new(robot, k, model));
        for k in 0..n {
            let chain = lanes_of(&plain, n, robots.len(), 1, k);
            self.fixed
                .tapers
                .push(Taper::gather(&chain[..L::Chain::LANES]));
        }
        for g in 0..self.states.len() {
            let lanes = lanes_of(&plain, n, robots.len(), L::WIDTH, g);
            self.tapers.push(Taper::gather(&lanes[..L::Module::LANES]));
        }
    }

    /// Memory of a rod (bytes) and of the responses to `columns` single tensions.
    pub fn bytes(robot: &Robot, columns: usize) -> f64 {
        let tendons = robot.tendon_count();
        let module = size_of::<Constants<L::Module, A>>()
            + size_of::<Constants<f64, A>>()
            + size_of::<State<L::Module, A>>()
            + size_of::<Gradient<L::Module, A>>()
            + size_of::<Hessian<L::Module, A>>()
            + size_of::<Response<L::Module, A>>()
            + 2 * size_of::<[Vec3<L::Module>; A]>()
            + size_of::<Eliminated<L::Chain, A, 1>>()
            + 7 * size_of::<Vec3<L::Chain>>()
            + size_of::<Mat3<L::Chain>>()
            + tendons * (2 * size_of::<f64>() + 6 * size_of::<L::Module>());
        let responses = size_of::<[Vec3<L::Module>; A]>()
            + size_of::<Vec3<L::Module>>()
            + tendons * size_of::<L::Module>();
        let spans = if columns == 0 {
            0
        } else {
            tendons * size_of::<Span<L::Module>>()
        };
        let each = module as f64 + spans as f64 + columns as f64 * responses as f64;
        each * robot.module_count() as f64
    }

    /// Sets the tensions alone.
    #[inline(always)]
    pub fn set_tensions(&mut self, tension: impl Fn(usize) -> L::Chain) {
        let count = self.tendons.len();
        for i in 0..count {
            let t = tension(i);
            for (k, first) in self.fixed.first_tendon.iter().enumerate() {
                if i >= *first {
                    let place = &mut self.tensions[k / L::WIDTH * count + i];
                    L::put(place, k % L::WIDTH, t);
                }
            }
        }
    }

    /// Sets dead forces (theory Eq. 2.8) and tensions. `on_disks` are forces on each disk beside
    /// that on the tip.
    #[inline(always)]
    pub fn set_load(
        &mut self,
        tension: impl Fn(usize) -> L::Chain,
        gravity: Vec3<L::Chain>,
        tip_force: Vec3<L::Chain>,
        on_disks: Option<impl Fn(usize) -> Vec3<L::Chain>>,
    ) {
        self.set_tensions(tension);
        self.dead.on_disks = on_disks.is_some();
        self.dead.gravity = gravity;
        let mut force = tip_force;
        for k in (0..self.fixed.modules.len()).rev() {
            if let Some(on_disk) = &on_disks {
                force += on_disk(k);
            }
            self.dead.modules[k] = self.fixed.weight_on(k, gravity, &mut force);
        }
    }

    /// Loads on the modules by gravity alone, with the weights of payloads; see [`State::f`].
    pub fn weights(&self, gravity: Vec3<L::Chain>) -> Vec<[Vec3<L::Chain>; 4]> {
        let n = self.fixed.modules.len();
        let (mut loads, mut force) = (copies([Vec3::zero(); 4], n), Vec3::zero());
        for k in (0..n).rev() {
            for payload in self.fixed.payloads.iter().filter(|p| p.disk == k) {
                force += gravity * L::Chain::splat(payload.mass);
            }
            loads[k] = self.fixed.weight_on(k, gravity, &mut force);
        }
        loads
    }

    /// Increases the compliance of all module ends by this fraction of their bending compliance, so
    /// that it can be inverted.
    pub fn add_compliance(&mut self, share: f64) {
        for c in &mut self.constants {
            c.d[0] += c.d[3] * L::Module::splat(share);
        }
    }

    /// The shape without loads and tensions.
    pub fn make_unloaded(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || {
                for (s, c) in self.states.iter_mut().zip(&self.constants) {
                    for a in 0..A {
                        s.w[a] = c.rest[a];
                    }
                    s.n = Vec3::zero();
                }
            },
        );
    }

    /// Sets the tension of every span, by module and tendon.
    pub fn set_span_tensions(&mut self, tension: impl Fn(usize, usize) -> f64) {
        let count = self.tendons.len();
        for (i, end_disk) in self.tendons.end_disks.iter().enumerate() {
            for k in 0..=*end_disk {
                let place = &mut self.tensions[k / L::WIDTH * count + i];
                L::put(place, k % L::WIDTH, L::Chain::splat(tension(k, i)));
            }
        }
    }

    /// Tension of a span (N); zero where the tendon does not pass.
    pub fn span_tension(&self, k: usize, i: usize) -> f64 {
        let place = &self.tensions[k / L::WIDTH * self.tendons.len() + i];
        L::get(place, k % L::WIDTH).lane(0)
    }

    /// Sets the right-hand side of the next step, arc by arc from base to tip.
    pub fn set_gradient(&mut self, value: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            for (a, g) in self.gradients[k / L::WIDTH].g.iter_mut().enumerate() {
                put::<L>(g, k % L::WIDTH, Vec3::splat(value(k * A + a).0));
            }
        }
    }

    #[inline(always)]
    pub fn module_count(&self) -> usize {
        self.dead.modules.len()
    }

    /// Pose of disk `k` in one lane of the chain.
    pub fn disk(&self, k: usize, lane: usize) -> Pose {
        let mut pose = Pose {
            rotation: Mat3::zero(),
            position: Vec3::zero(),
        };
        for r in 0..3 {
            pose.position[r] = self.placed.positions[k][r].lane(lane);
            for c in 0..3 {
                pose.rotation.0[r][c] = self.rotations[k + 1].0[r][c].lane(lane);
            }
        }
        pose
    }

    /// Strains of all arcs from base to tip, of one robot.
    pub fn strains(&self, visit: impl FnMut(usize, Vec3)) {
        self.each_arc(|g| &self.states[g].w, visit);
    }

    /// Visits a vector of every arc from base to tip, of one robot; `of` is that of a group.
    pub fn each_arc<'a>(
        &'a self,
        of: impl Fn(usize) -> &'a [Vec3<L::Module>; A],
        mut visit: impl FnMut(usize, Vec3),
    ) {
        for k in 0..self.module_count() {
            for (a, v) in of(k / L::WIDTH).iter().enumerate() {
                visit(k * A + a, get::<L>(v, k % L::WIDTH).of_lane(0));
            }
        }
    }

    pub fn set_strains(&mut self, strain: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            for (a, v) in self.states[k / L::WIDTH].w.iter_mut().enumerate() {
                put::<L>(v, k % L::WIDTH, Vec3::splat(strain(k * A + a).0));
            }
        }
    }
}
