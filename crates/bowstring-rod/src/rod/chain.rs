//! The whole robot as a chain of modules: the passes of every solver.
//!
//! Theory: docs/theory/statics.md.
//!
//! Work inside a module runs in SIMD lanes (`L::Module`); recursions from module to module, for
//! rotations, costate and elimination, run along the chain (`L::Chain`).

use crate::interrupt;
use crate::math::copies;
use crate::math::lie::Pose;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{Load, Model, TendonPath};
use crate::model::robot::{Payload, Robot};
use crate::rod::attached::Attached;
use crate::rod::constants::{Constants, Taper};
use crate::rod::defect::Defect;
use crate::rod::elimination::{Blocks, Eliminated};
use crate::rod::module::{Gradient, Hessian, Response, Span, State, Tendons};
use crate::rod::routes::Routes;

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
        let mut loads = lumped(weight, *force, c);
        if let Some(taper) = self.tapers.get(k) {
            let (shift, turns) = taper.lumped(h, gravity);
            loads[0] += shift;
            loads[1] += turns[1];
            loads[2] += turns[0];
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
    on_disks: bool,
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
    saved: Vec<[Vec3<L::Module>; A]>,
    /// Contact force to return to (N), as a start for the next balance.
    saved_force: Vec<Vec3<L::Module>>,
}

/// Spans of the last `measure_spans`, and their responses.
#[derive(Clone)]
pub struct Spans<L: Layout, const A: usize> {
    /// Spans by groups and tendons.
    spans: Vec<Span<L::Module>>,
    /// Lengths by modules and tendons (m); zero where the tendon does not pass.
    pub lengths: Vec<f64>,
    /// Angles of the tendons at the holes where spans begin, by modules and tendons (rad).
    pub angles: Vec<f64>,
    /// Responses to right-hand sides; see `respond`.
    responses: Vec<SourceResponses<L, A>>,
}

/// Positions and lengths of the last `finish`.
#[derive(Clone)]
pub struct Placed<C> {
    /// Positions of the disks (m).
    pub positions: Vec<Vec3<C>>,
    /// Lengths of the tendons (m).
    pub lengths: Vec<C>,
    /// Smallest forward component of a module's chord and its loaded spans.
    forward: Vec<C>,
}

/// Discretisation error of the last `estimate`.
#[derive(Clone)]
pub struct Errors<L: Layout> {
    /// Defects by groups.
    pub defects: Vec<Defect<L::Module>>,
    /// Errors of the tendon lengths (m).
    pub lengths: Vec<L::Chain>,
}

/// Responses of the rod, side by side in the lanes that hold modules elsewhere.
#[derive(Clone)]
pub struct SourceResponses<L: Layout, const A: usize> {
    /// By modules: rotation added by every arc, and force on the end.
    pub u: Vec<[Vec3<L::Module>; A]>,
    force: Vec<Vec3<L::Module>>,
    /// By modules and tendons: length change of a tendon from the start of the module on.
    beyond: Vec<L::Module>,
}

/// Right-hand sides: a change of tension in one tendon each.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub tendons: &'a [usize],
    /// Tensions by sources and modules (N).
    pub tensions: &'a [f64],
}

impl<'a> Sources<'a> {
    /// Tendon and tensions of each source, for a robot of `n` modules.
    pub fn iter(self, n: usize) -> impl Iterator<Item = (usize, &'a [f64])> {
        self.tendons
            .iter()
            .copied()
            .zip(self.tensions.chunks_exact(n))
    }
}

/// A vector of module `i` in its group, copied to all lanes.
#[inline(always)]
pub fn same<L: Layout>(v: &Vec3<L::Module>, i: usize) -> Vec3<L::Module> {
    let mut out = Vec3::<L::Module>::zero();
    for (x, y) in out.0.iter_mut().zip(&v.0) {
        *x = L::Module::splat(L::get(y, i).lane(0));
    }
    out
}

#[inline(always)]
pub fn same_mat<L: Layout>(m: &Mat3<L::Module>, i: usize) -> Mat3<L::Module> {
    widen::<L>(&get_mat::<L>(m, i))
}

#[inline(always)]
pub fn widen<L: Layout>(m: &Mat3<L::Chain>) -> Mat3<L::Module> {
    let mut out = Mat3::<L::Module>::zero();
    for (row, from) in out.0.iter_mut().zip(&m.0) {
        for (x, y) in row.iter_mut().zip(from) {
            *x = L::Module::splat(y.lane(0));
        }
    }
    out
}

/// Predicted effect of the step.
pub struct Step<T> {
    /// Directional derivative of the energy.
    pub slope: T,
    /// Largest rotation added by an arc (rad).
    pub largest: T,
}

/// The tendons in one group of modules.
#[inline(always)]
pub fn in_group<'a, M: Real>(
    tendons: &'a Routes<M>,
    tensions: &'a [M],
    path: TendonPath,
    group: usize,
) -> Tendons<'a, M> {
    let count = tendons.len();
    Tendons {
        holes: tendons.in_group(group),
        tensions: &tensions[group * count..(group + 1) * count],
        path,
        on_nodes: &[],
    }
}

/// Forces of loads between disks on the nodes of a group; see [`Tendons::on_nodes`].
#[inline(always)]
pub fn nodes_of<T, const A: usize>(on_nodes: &[[Vec3<T>; A]], group: usize) -> &[Vec3<T>] {
    match A {
        2 => &[],
        _ => on_nodes.get(group).map_or(&[], |nodes| nodes),
    }
}

#[inline(always)]
pub fn get<L: Layout>(v: &Vec3<L::Module>, i: usize) -> Vec3<L::Chain> {
    Vec3([L::get(&v.0[0], i), L::get(&v.0[1], i), L::get(&v.0[2], i)])
}

#[inline(always)]
pub fn get_mat<L: Layout>(m: &Mat3<L::Module>, i: usize) -> Mat3<L::Chain> {
    let mut out = Mat3::zero();
    for (row, from) in out.0.iter_mut().zip(&m.0) {
        for (x, y) in row.iter_mut().zip(from) {
            *x = L::get(y, i);
        }
    }
    out
}

#[inline(always)]
pub fn put<L: Layout>(v: &mut Vec3<L::Module>, i: usize, c: Vec3<L::Chain>) {
    for q in 0..3 {
        L::put(&mut v.0[q], i, c.0[q]);
    }
}

#[inline(always)]
pub fn put_mat<L: Layout>(m: &mut Mat3<L::Module>, i: usize, c: &Mat3<L::Chain>) {
    for (row, from) in m.0.iter_mut().zip(&c.0) {
        for (x, y) in row.iter_mut().zip(from) {
            L::put(x, i, *y);
        }
    }
}

/// A number for every module of a group; zero in idle lanes.
#[inline(always)]
pub fn lanes<L: Layout>(n: usize, g: usize, of: impl Fn(usize) -> f64) -> L::Module {
    if L::WIDTH == 1 {
        return L::Module::splat(of(g));
    }
    L::Module::from_fn(|i| {
        let k = g * L::WIDTH + i;
        if k < n {
            of(k)
        } else {
            0.0
        }
    })
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
fn lanes_of<P>(of: &[P], modules: usize, robots: usize, width: usize, group: usize) -> [&P; 8] {
    std::array::from_fn(|lane| match width {
        1 => &of[lane.min(robots - 1) * modules + group],
        _ => &of[(group * width + lane).min(modules - 1)],
    })
}

/// Loads on a module (see [`State::f`]) by a force per length on its backbone, whose flexible part
/// has some length between two clamps, and a force on its end disk. Hermite's rule: half of the
/// force on an element at each end, and a couple.
#[inline(always)]
pub fn lumped<T: Real, const A: usize>(
    line: Vec3<T>,
    force: Vec3<T>,
    c: &Constants<T, A>,
) -> [Vec3<T>; 4] {
    let half = T::splat(0.5);
    let (flexible, [start, end]) = (c.flexible, c.clamp);
    let element = flexible * T::splat(2.0 / A as f64);
    let [first, last] = [element * c.part(0), element * c.part(A / 2 - 1)];
    let [at_start, at_end] = [first, last].map(|length| length * length / T::splat(12.0));
    [
        force + line * (last * half + end),
        force * end + line * (end * end * half - at_end),
        force * start + line * (start * (start * half + flexible + end) + at_start),
        line * element,
    ]
}

/// Second variation of module `i` of a group and of the distal part, whose own is `value` in the
/// frame of the end disk; `s` is the rotation of the end.
#[inline(always)]
pub fn blocks<L: Layout, const A: usize, const SYMMETRIC: bool>(
    of: &Hessian<L::Module, A>,
    i: usize,
    s: &Mat3<L::Chain>,
    value: Mat3<L::Chain>,
    shift: L::Chain,
) -> Blocks<L::Chain, A, 1> {
    // second variation of the disk at the end, in the frame of the start
    let mut p = *s * value * s.transpose();
    if SYMMETRIC {
        p = p.mirrored();
    }
    let mut blocks = Blocks::empty();
    for a in 0..A {
        for b in 0..A {
            if b < a {
                continue;
            }
            blocks.uu[b][a] = get_mat::<L>(&of.uu[b][a], i) + p;
            if !SYMMETRIC && b > a {
                blocks.uu[a][b] = get_mat::<L>(&of.uu[b][a], i).transpose() + p;
            }
        }
        blocks.uu[a][a] = blocks.uu[a][a].add_diagonal([shift; 3]);
        let xu = get_mat::<L>(&of.xu[a], i);
        blocks.xu[a][0] = xu + p;
        blocks.ux[a][0] = xu.transpose() + p;
    }
    blocks.xx[0][0] = get_mat::<L>(&of.xx, i) + p;
    blocks
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Whether loads can act between two disks; see [`Attached::BETWEEN`].
    pub const BETWEEN: bool = Attached::<L::Chain, A>::BETWEEN;

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
                tapers: vec![],
                source: None,
            },
            dead: DeadLoads {
                modules: copies([Vec3::zero(); 4], n),
                gravity: Vec3::zero(),
                on_disks: false,
            },
            attached: Attached::none(),
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
                put::<L>(&mut group.rest, i, Vec3::zero());
            }
            self.constants.push(group);
        }
        self.set_tapers(robots, model);
        self.fixed.masses.clear();
        for k in 0..n {
            let mut mass = L::Chain::zero();
            for lane in 0..L::Chain::LANES {
                let robot = &robots[lane.min(robots.len() - 1)];
                mass.set_lane(lane, robot.spec().disks[k].mass);
            }
            self.fixed.masses.push(mass);
        }
        self.fixed.payloads.clear();
        self.fixed.payloads.extend(&robots[0].spec().payloads);
        self.tendons.set::<L>(robots);
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

    /// Sets dead moments and point loads; returns whether this divides modules anew.
    pub fn set_attached(&mut self, load: &Load) -> bool {
        let divided = self.attached.has_between();
        self.attached.set(load, &self.fixed.modules);
        if Self::BETWEEN {
            return (divided || self.attached.has_between()) && self.divide();
        }
        false
    }

    /// Sets a load that has been checked.
    pub fn load(&mut self, load: &Load) {
        let on_disks = |k: usize| Vec3::splat(load.disk_forces[k]);
        // divides modules, so before their weight
        self.set_attached(load);
        self.set_load(
            |i| L::Chain::splat(load.tensions[i]),
            Vec3::splat(load.gravity),
            Vec3::splat(load.tip_force),
            (!load.disk_forces.is_empty()).then_some(on_disks),
        );
        self.attached
            .add_weights(&self.fixed.payloads, load.gravity);
        self.add_forces(load.line_forces);
    }

    /// Increases the compliance of all module ends by this fraction of their bending compliance, so
    /// that it can be inverted.
    pub fn add_compliance(&mut self, share: f64) {
        for c in &mut self.constants {
            c.d[0] += c.d[3] * L::Module::splat(share);
        }
    }

    /// The path of the tendons.
    #[inline(always)]
    pub fn path(&self) -> TendonPath {
        match L::CONTINUOUS {
            Some(true) => TendonPath::Continuous,
            Some(false) => TendonPath::Straight,
            None => self.path,
        }
    }

    /// Whether all loads have a potential.
    pub fn has_potential(&self) -> bool {
        self.attached.has_potential()
    }

    /// The shape without loads and tensions.
    pub fn make_unloaded(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || {
                for (s, c) in self.states.iter_mut().zip(&self.constants) {
                    for a in 0..A {
                        s.w[a] = c.rest_of(a);
                    }
                    s.n = Vec3::zero();
                }
            },
        );
    }

    /// Forward pass: shapes, rotations (theory Eq. 2.3) and forces; returns the potential energy
    /// (theory Eq. 3.1, without loads that have no potential).
    #[inline(always)]
    pub fn evaluate(&mut self) -> L::Chain {
        if self.attached.has_forces() {
            return self.evaluate_attached();
        }
        self.evaluate_module_loads()
    }

    /// Shapes and rotations of the disks.
    #[inline(never)]
    pub fn turn_disks(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.turn_disks_in_lanes(),
        )
    }

    #[inline(always)]
    fn turn_disks_in_lanes(&mut self) {
        let (path, n) = (self.path(), self.module_count());
        let mut rotation = Mat3::identity();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            state.shape(c, &in_group(&self.tendons, &self.tensions, path, g));
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                rotation = rotation * get_mat::<L>(&state.s, i);
                self.rotations[g * L::WIDTH + i + 1] = rotation;
            }
        }
    }

    /// Notes that forces act on disks other than the tip.
    pub fn has_forces_on_disks(&mut self) {
        self.dead.on_disks = true;
    }

    /// `evaluate` with the loads on modules as they are.
    #[inline(never)]
    pub fn evaluate_module_loads(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.evaluate_module_loads_in_lanes(),
        )
    }

    #[inline(always)]
    fn evaluate_module_loads_in_lanes(&mut self) -> L::Chain {
        let path = self.path();
        let n = self.module_count();
        let mut rotation = Mat3::identity();
        let mut energy = L::Chain::zero();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            let mut t = in_group(&self.tendons, &self.tensions, path, g);
            state.shape(c, &t);
            let here = L::WIDTH.min(n - g * L::WIDTH);
            for i in 0..here {
                let k = g * L::WIDTH + i;
                // the last is for nodes between elements
                let used = if A > 2 { 4 } else { 3 };
                for (f, dead) in state.f[..used].iter_mut().zip(&self.dead.modules[k]) {
                    put::<L>(f, i, rotation.tr_mul(*dead));
                }
                if Self::BETWEEN && self.attached.has_between() {
                    let forces = &self.attached.between;
                    forces.put_forces::<L, A>(k, &rotation, &mut self.on_nodes[g]);
                }
                rotation = rotation * get_mat::<L>(&state.s, i);
                self.rotations[k + 1] = rotation;
            }
            t.on_nodes = nodes_of(&self.on_nodes, g);
            state.balance(c, &t);
            for i in 0..here {
                energy += L::get(&state.energy, i);
            }
        }
        energy
    }

    /// The second half of `evaluate`: forces, where only tensions of straight spans have changed.
    #[inline(never)]
    pub fn balance(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.balance_in_lanes(),
        )
    }

    #[inline(always)]
    fn balance_in_lanes(&mut self) -> L::Chain {
        let (tendons, tensions, path) = (&self.tendons, &self.tensions, self.path());
        let n = self.module_count();
        let mut energy = L::Chain::zero();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            let mut t = in_group(tendons, tensions, path, g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            state.balance(c, &t);
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                energy += L::get(&state.energy, i);
            }
        }
        energy
    }

    /// Backward pass: gradient by the exact costate (theory Eq. 3.2, with the opposite sign);
    /// returns the largest moment imbalance (N m).
    #[inline(never)]
    pub fn gradient(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.gradient_in_lanes(),
        )
    }

    #[inline(always)]
    fn gradient_in_lanes(&mut self) -> L::Chain {
        let path = self.path();
        let n = self.module_count();
        let mut lambda = Vec3::zero();
        let mut residual = L::Module::zero();
        for (g, (state, c)) in self
            .states
            .iter_mut()
            .zip(&self.constants)
            .enumerate()
            .rev()
        {
            for i in (0..L::WIDTH.min(n - g * L::WIDTH)).rev() {
                let k = g * L::WIDTH + i;
                if self.attached.acts() {
                    lambda -= self.attached.moment(k, &self.rotations[k + 1]);
                }
                lambda = get_mat::<L>(&state.s, i) * lambda;
                put::<L>(&mut state.lambda, i, lambda);
                lambda -= get::<L>(&state.load_moment, i);
                if Self::BETWEEN && self.attached.has_between() {
                    let start = &self.rotations[k];
                    let between = &mut self.attached.between;
                    lambda += between.torque_on::<L, A>(k, start, state);
                }
            }
            let mut t = in_group(&self.tendons, &self.tensions, path, g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            let out = &mut self.gradients[g];
            state.gradient(c, &t, out);
            if Self::BETWEEN && self.attached.has_between() {
                self.attached.between.add_torques::<L, A>(n, g, out);
            }
            for v in &out.g {
                residual = residual.max(v.max_abs());
            }
            // the residual of the end's position, times its force, is an imbalance as well
            residual = residual.max(state.miss * state.n.max_abs());
        }
        let mut largest = L::get(&residual, 0);
        for i in 1..L::WIDTH {
            largest = largest.max(L::get(&residual, i));
        }
        largest
    }

    /// Second derivatives of all modules, and the responses of their ends.
    #[inline(never)]
    pub fn linearise(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.linearise_in_lanes(),
        )
    }

    #[inline(always)]
    fn linearise_in_lanes(&mut self) {
        for g in 0..self.states.len() {
            let mut t = in_group(&self.tendons, &self.tensions, self.path(), g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            let (state, gradient) = (&self.states[g], &self.gradients[g]);
            let out = &mut self.newton.hessians[g];
            let response = state.hessian::<true>(&self.constants[g], &t, gradient, out);
            self.newton.responses[g] = response;
            if Self::BETWEEN && self.attached.has_between() {
                self.linearise_torques(g);
            }
        }
    }

    /// Backward pass: eliminates every arc (theory Eq. 3.4); returns the least pivot, positive at a
    /// minimum.
    #[inline(never)]
    pub fn eliminate<const SYMMETRIC: bool>(&mut self, shift: L::Chain) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.eliminate_in_lanes::<SYMMETRIC>(shift),
        )
    }

    #[inline(always)]
    fn eliminate_in_lanes<const SYMMETRIC: bool>(&mut self, shift: L::Chain) -> L::Chain {
        let n = self.module_count();
        self.newton.symmetric = SYMMETRIC;
        let mut value = Mat3::zero();
        let mut least_pivot = L::Chain::splat(f64::INFINITY);
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let s = get_mat::<L>(&self.states[g].s, i);
            if self.attached.acts() {
                value += self
                    .attached
                    .stiffness::<SYMMETRIC>(k, &self.rotations[k + 1]);
            }
            let mut blocks =
                blocks::<L, A, SYMMETRIC>(&self.newton.hessians[g], i, &s, value, shift);
            if Self::BETWEEN && self.attached.has_between() {
                self.add_stiffness_between::<SYMMETRIC, 1>(k, &mut blocks);
            }
            if !SYMMETRIC {
                self.couple_followers(k, &mut blocks);
            }
            [[value]] = self.newton.eliminated[k].eliminate::<SYMMETRIC>(blocks, &mut least_pivot);
            if !SYMMETRIC {
                self.eliminate_followers(k);
            }
        }
        least_pivot
    }

    /// `linearise` and `eliminate` in one pass, without shift, for a symmetric tangent: keeps the
    /// eliminated modules only.
    #[inline(never)]
    pub fn linearise_and_eliminate(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.linearise_and_eliminate_in_lanes(),
        )
    }

    #[inline(always)]
    fn linearise_and_eliminate_in_lanes(&mut self) -> L::Chain {
        let n = self.module_count();
        self.newton.symmetric = true;
        let mut value = Mat3::zero();
        let mut least_pivot = L::Chain::splat(f64::INFINITY);
        for g in (0..self.states.len()).rev() {
            let t = in_group(&self.tendons, &self.tensions, self.path(), g);
            let (state, gradient) = (&self.states[g], &self.gradients[g]);
            let mut hessian = Hessian::empty();
            state.hessian::<true>(&self.constants[g], &t, gradient, &mut hessian);
            for i in (0..L::WIDTH.min(n - g * L::WIDTH)).rev() {
                let s = get_mat::<L>(&state.s, i);
                if self.attached.acts() {
                    let k = g * L::WIDTH + i;
                    value += self.attached.stiffness::<true>(k, &self.rotations[k + 1]);
                }
                let blocks = blocks::<L, A, true>(&hessian, i, &s, value, L::Chain::zero());
                let eliminated = &mut self.newton.eliminated[g * L::WIDTH + i];
                [[value]] = eliminated.eliminate::<true>(blocks, &mut least_pivot);
            }
        }
        least_pivot
    }

    /// Newton step for the present gradient and elimination.
    #[inline(always)]
    pub fn newton_step<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        let step = self.rotations_of_step::<SYMMETRIC>();
        self.step_to_strain();
        step
    }

    /// Converts the step from rotations added by the arcs to strain.
    #[inline(never)]
    pub fn step_to_strain(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.step_to_strain_in_lanes(),
        )
    }

    #[inline(always)]
    fn step_to_strain_in_lanes(&mut self) {
        for (step, gradient) in self.newton.step.iter_mut().zip(&self.gradients) {
            for a in 0..A {
                step[a] = gradient.to_strain[a] * step[a];
            }
        }
    }

    /// Newton step as rotations added by the arcs.
    #[inline(never)]
    pub fn rotations_of_step<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        self.layout.vectorize(
            #[inline(always)]
            || self.rotations_of_step_in_lanes::<SYMMETRIC>(),
        )
    }

    #[inline(always)]
    fn rotations_of_step_in_lanes<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        self.backward_step::<SYMMETRIC>(
            #[inline(always)]
            |_, _| (),
        );
        self.forward_step()
    }

    /// From tip to base: own solution of the arcs for the present gradient, in `step`. Visits the
    /// right-hand side of each module, the distal part included.
    #[inline(always)]
    pub fn backward_step<const SYMMETRIC: bool>(
        &mut self,
        mut visit: impl FnMut(usize, &[Vec3<L::Chain>; A]),
    ) {
        let (mut p, mut force) = (Vec3::zero(), Vec3::zero());
        for k in (0..self.module_count()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let s = get_mat::<L>(&self.states[g].s, i);
            p = s * p;
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = get::<L>(&self.gradients[g].g[a], i) + p;
            }
            let mut start = [p];
            let follower = (!SYMMETRIC).then(|| self.attached.coupling(k)).flatten();
            if let Some(coupling) = follower {
                force = s * force;
                coupling.add_force(force, &mut solution, &mut start[0]);
            }
            visit(k, &solution);
            self.newton.eliminated[k].backward::<SYMMETRIC>(&mut solution, &mut start);
            if let Some(coupling) = follower {
                force = coupling.force_beyond(force, &solution);
                if Self::BETWEEN && self.attached.has_between() {
                    let between = &self.attached.between;
                    force -= between.force_by_arcs(k, |m| *m, &solution);
                }
            }
            for a in 0..A {
                put::<L>(&mut self.newton.step[g][a], i, solution[a]);
            }
            [p] = start;
        }
    }

    /// From base to tip: rotations of the arcs, from their own solutions in `step`.
    #[inline(always)]
    pub fn forward_step(&mut self) -> Step<L::Chain> {
        let mut x = Vec3::zero();
        let (mut slope, mut largest) = (L::Chain::zero(), L::Chain::zero());
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = get::<L>(&self.newton.step[g][a], i);
            }
            let u = self.newton.eliminated[k].forward(&solution, &[x]);
            let mut end = x;
            for a in 0..A {
                end += u[a];
            }
            x = get_mat::<L>(&self.states[g].s, i).tr_mul(end);
            for a in 0..A {
                put::<L>(&mut self.newton.step[g][a], i, u[a]);
                slope += get::<L>(&self.gradients[g].g[a], i).dot(u[a]);
                largest = largest.max(u[a].max_abs());
            }
        }
        Step { slope, largest }
    }

    /// The same for the last elimination, symmetric or not.
    #[inline(always)]
    pub fn rotations_of_last_elimination(&mut self) {
        if self.newton.symmetric {
            self.rotations_of_step::<true>();
        } else {
            self.rotations_of_step::<false>();
        }
    }

    /// Measures the lengths of all spans and, if `angles`, the angles of the tendons at the holes.
    #[inline(never)]
    pub fn measure_spans(&mut self, angles: bool) {
        self.layout.vectorize(
            #[inline(always)]
            || self.measure_spans_in_lanes(angles),
        )
    }

    #[inline(always)]
    fn measure_spans_in_lanes(&mut self, angles: bool) {
        let (n, count) = (self.module_count(), self.tendons.len());
        let zero = Vec3::zero();
        self.spans
            .spans
            .resize_with(self.states.len() * count, || Span {
                arm: zero,
                length: L::Module::zero(),
                per_length: L::Module::zero(),
                direction: zero,
            });
        for (g, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            for (j, holes) in self.tendons.in_group(g).iter().enumerate() {
                let span = Span::new(c, holes, &state.s, state.rho);
                for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.spans.lengths[k * count + j] = L::get(&span.length, i).lane(0);
                }
                self.spans.spans[g * count + j] = span;
            }
        }
        if angles {
            self.measure_angles();
        }
    }

    #[inline(always)]
    fn measure_angles(&mut self) {
        let count = self.tendons.len();
        for j in 0..count {
            // before the base hole the tendon is parallel to z
            let mut last = Vec3::<L::Chain>::ez();
            for (g, state) in self.states.iter().enumerate() {
                let after = self.spans.spans[g * count + j].direction;
                let next = state.s.tr_mul(after);
                let mut before = next;
                for i in 0..L::WIDTH {
                    put::<L>(&mut before, i, last);
                    last = get::<L>(&next, i);
                }
                let angle = before.angle(after);
                for i in 0..L::WIDTH {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.spans.angles[k * count + j] = L::get(&angle, i).lane(0);
                }
            }
        }
    }

    /// Span of a group and tendon, as measured last.
    pub fn span(&self, g: usize, tendon: usize) -> &Span<L::Module> {
        &self.spans.spans[g * self.tendons.len() + tendon]
    }

    /// Responses of the rod, for the present elimination and measured spans: to its own gradient in
    /// the first column, and to changes of tension in the others. Without sources the present
    /// columns are kept.
    #[inline(always)]
    pub fn respond(&mut self, sources: Sources) {
        let (n, count) = (self.module_count(), self.tendons.len());
        if sources.tendons.is_empty() && !self.spans.responses.is_empty() {
            return self.respond_to_gradient();
        }
        let total = 1 + sources.tendons.len();
        self.reserve_responses(total);
        for part in 0..total.div_ceil(L::WIDTH) {
            let first = part * L::WIDTH;
            if interrupt::work(L::WIDTH * n * (16 + 2 * count)) {
                return;
            }
            self.substitute(part, first..total.min(first + L::WIDTH), &sources);
        }
    }

    /// Makes place for so many responses.
    pub fn reserve_responses(&mut self, total: usize) {
        let (n, count) = (self.module_count(), self.tendons.len());
        while self.spans.responses.len() * L::WIDTH < total {
            self.spans.responses.push(SourceResponses {
                u: copies([Vec3::zero(); A], n),
                force: copies(Vec3::zero(), n),
                beyond: copies(L::Module::zero(), n * count),
            });
        }
    }

    /// The responses in groups of lanes.
    pub fn responses(&self) -> &[SourceResponses<L, A>] {
        &self.spans.responses
    }

    /// Takes a group of responses out of the rod, to be put back.
    #[inline(always)]
    pub fn take_responses(&mut self, part: usize) -> SourceResponses<L, A> {
        let empty = SourceResponses {
            u: vec![],
            force: vec![],
            beyond: vec![],
        };
        std::mem::replace(&mut self.spans.responses[part], empty)
    }

    #[inline(always)]
    pub fn put_responses(&mut self, part: usize, responses: SourceResponses<L, A>) {
        self.spans.responses[part] = responses;
    }

    /// Response to the own gradient only, with modules in the lanes.
    #[inline(never)]
    fn respond_to_gradient(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.respond_to_gradient_in_lanes(),
        )
    }

    #[inline(always)]
    fn respond_to_gradient_in_lanes(&mut self) {
        self.rotations_of_last_elimination();
        let (n, count) = (self.module_count(), self.tendons.len());
        let out = &mut self.spans.responses[0];
        let mut x = Vec3::<L::Chain>::zero();
        for (g, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            let here = L::WIDTH.min(n - g * L::WIDTH);
            let mut start = Vec3::<L::Module>::zero();
            let (response, step) = (&self.newton.responses[g], &self.newton.step[g]);
            let (mut turn, mut moved) = (Vec3::<L::Module>::zero(), Vec3::<L::Module>::zero());
            for a in 0..A {
                turn += step[a];
                moved += response.j[a] * step[a];
            }
            for i in 0..here {
                put::<L>(&mut start, i, x);
                x = get_mat::<L>(&state.s, i).tr_mul(x + get::<L>(&turn, i));
                for a in 0..A {
                    let u = get::<L>(&step[a], i);
                    for q in 0..3 {
                        out.u[g * L::WIDTH + i][a].0[q].set_lane(0, u.0[q].lane(0));
                    }
                }
            }
            let force = state
                .stretching_load(c, nodes_of(&self.on_nodes, g))
                .cross(start)
                - response.k.tr_mul(turn);
            let rho = response.m * moved + response.d_hat * force;
            for j in 0..count {
                let span = &self.spans.spans[g * count + j];
                let longer = span.direction.dot(rho + turn.cross(span.arm));
                let longer = longer * self.fixed.passes[g * count + j];
                for i in 0..here {
                    let place = &mut out.beyond[(g * L::WIDTH + i) * count + j];
                    place.set_lane(0, L::get(&longer, i).lane(0));
                }
            }
        }
        for at in (0..(n - 1) * count).rev() {
            let all = out.beyond[at].lane(0) + out.beyond[at + count].lane(0);
            out.beyond[at].set_lane(0, all);
        }
    }

    /// Substitutes some of the columns along the chain.
    #[inline(never)]
    fn substitute(&mut self, part: usize, columns: std::ops::Range<usize>, sources: &Sources) {
        self.layout.vectorize(
            #[inline(always)]
            || self.substitute_in_lanes(part, columns, sources),
        )
    }

    #[inline(always)]
    fn substitute_in_lanes(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        self.substitute_backward(part, columns, sources);
        let count = self.tendons.len();
        let mut out = self.take_responses(part);
        self.substitute_forward(
            &mut out,
            #[inline(always)]
            |beyond, k, [_, rho, turn]| {
                let (g, i) = (k / L::WIDTH, k % L::WIDTH);
                for (j, end_disk) in self.tendons.end_disks.iter().enumerate() {
                    beyond[k * count + j] = if k <= *end_disk {
                        let span = &self.spans.spans[g * count + j];
                        let (arm, along) = (same::<L>(&span.arm, i), same::<L>(&span.direction, i));
                        along.dot(rho + turn.cross(arm))
                    } else {
                        L::Module::zero()
                    };
                }
            },
        );
        for at in (0..out.beyond.len() - count).rev() {
            let further = out.beyond[at + count];
            out.beyond[at] += further;
        }
        self.put_responses(part, out);
    }

    /// Force on the end of module `k` due to the sources in some columns, and its arm.
    #[inline(always)]
    fn source_force(
        &self,
        k: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) -> [Vec3<L::Module>; 2] {
        let (n, count) = (self.module_count(), self.tendons.len());
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let mut force = Vec3::<L::Module>::zero();
        let mut arm = Vec3::<L::Module>::zero();
        for (lane, column) in columns.enumerate() {
            if column == 0 {
                continue;
            }
            let w = sources.tensions[(column - 1) * n + k];
            if w == 0.0 {
                continue;
            }
            let span = &self.spans.spans[g * count + sources.tendons[column - 1]];
            for q in 0..3 {
                let along = L::get(&span.direction.0[q], i).lane(0);
                force.0[q].set_lane(lane, -along * w);
                arm.0[q].set_lane(lane, L::get(&span.arm.0[q], i).lane(0));
            }
        }
        [force, arm]
    }

    /// From tip to base: eliminates the right-hand sides of the arcs.
    #[inline(never)]
    pub fn substitute_backward(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        self.layout.vectorize(
            #[inline(always)]
            || self.substitute_backward_in_lanes(part, columns, sources),
        )
    }

    #[inline(always)]
    fn substitute_backward_in_lanes(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        let mut p = Vec3::<L::Module>::zero();
        let mut following = Vec3::<L::Module>::zero();
        for k in (0..self.module_count()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [force, arm] = self.source_force(k, columns.clone(), sources);
            let (state, response) = (&self.states[g], &self.newton.responses[g]);
            let moved = same_mat::<L>(&response.d_hat, i) * force;
            let turned = same_mat::<L>(&response.k, i) * moved - arm.cross(force);
            let on_end = same_mat::<L>(&response.m, i).tr_mul(force);
            p = same_mat::<L>(&state.s, i) * p;
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = turned - same_mat::<L>(&response.j[a], i).tr_mul(on_end);
                if columns.start == 0 {
                    let own = get::<L>(&self.gradients[g].g[a], i);
                    for q in 0..3 {
                        solution[a].0[q].set_lane(0, own.0[q].lane(0));
                    }
                }
                solution[a] += p;
            }
            let mut start = [p];
            let eliminated = &self.newton.eliminated[k];
            if self.newton.symmetric {
                eliminated.backward_as::<_, true>(widen::<L>, &mut solution, &mut start);
            } else {
                let follower = self.attached.coupling(k).map(|c| c.each(widen::<L>));
                if let Some(coupling) = &follower {
                    following = same_mat::<L>(&state.s, i) * following;
                    coupling.add_force(following, &mut solution, &mut start[0]);
                }
                eliminated.backward_as::<_, false>(widen::<L>, &mut solution, &mut start);
                if let Some(coupling) = &follower {
                    following = coupling.force_beyond(following, &solution);
                    if Self::BETWEEN && self.attached.has_between() {
                        let between = &self.attached.between;
                        following -= between.force_by_arcs(k, widen::<L>, &solution);
                    }
                }
            }
            let stretching = state.stretching_load(&self.constants[g], self.on_nodes(g));
            p = start[0] + same::<L>(&stretching, i).cross(moved);
            let out = &mut self.spans.responses[part];
            out.u[k] = solution;
            out.force[k] = force;
        }
    }

    /// From base to tip: rotations of the arcs, in place of their own solutions. Visits the place
    /// for changes of length and, for each module, the rotation of its start, and the motion and
    /// rotation of its end that its arcs add.
    #[inline(always)]
    pub fn substitute_forward(
        &self,
        out: &mut SourceResponses<L, A>,
        mut visit: impl FnMut(&mut [L::Module], usize, [Vec3<L::Module>; 3]),
    ) {
        let mut x = Vec3::<L::Module>::zero();
        for k in 0..self.dead.modules.len() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (state, response) = (&self.states[g], &self.newton.responses[g]);
            let u = self.newton.eliminated[k].forward_as(widen::<L>, &out.u[k], &[x]);
            let (mut turn, mut moved) = (Vec3::<L::Module>::zero(), Vec3::<L::Module>::zero());
            for a in 0..A {
                turn += u[a];
                moved += same_mat::<L>(&response.j[a], i) * u[a];
            }
            let stretching = state.stretching_load(&self.constants[g], nodes_of(&self.on_nodes, g));
            let load = same::<L>(&stretching, i).cross(x);
            let force = out.force[k] + load - same_mat::<L>(&response.k, i).tr_mul(turn);
            let rho =
                same_mat::<L>(&response.m, i) * moved + same_mat::<L>(&response.d_hat, i) * force;
            visit(&mut out.beyond, k, [x, rho, turn]);
            out.u[k] = u;
            x = same_mat::<L>(&state.s, i).tr_mul(x + turn);
        }
    }

    /// Length change of a tendon from a hole on, for each of the responses.
    pub fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        let at = hole * self.tendons.len() + tendon;
        for (part, responses) in out.chunks_mut(L::WIDTH).zip(&self.spans.responses) {
            for (lane, value) in part.iter_mut().enumerate() {
                *value = responses.beyond[at].lane(lane);
            }
        }
    }

    /// Sets the step to a linear combination of responses; returns the largest rotation added by an
    /// arc (rad).
    #[inline(always)]
    pub fn combine(&mut self, coefficients: &[f64]) -> f64 {
        self.combine_rotations(coefficients);
        let mut largest = L::Module::zero();
        for (step, gradient) in self.newton.step.iter_mut().zip(&self.gradients) {
            for a in 0..A {
                largest = largest.max(step[a].max_abs());
                step[a] = gradient.to_strain[a] * step[a];
            }
        }
        largest.largest()
    }

    /// The same as rotations added by the arcs.
    #[inline(always)]
    pub fn combine_rotations(&mut self, coefficients: &[f64]) {
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            for a in 0..A {
                let mut sum = [0.0; 3];
                for (part, responses) in coefficients.chunks(L::WIDTH).zip(&self.spans.responses) {
                    let u = &responses.u[k][a];
                    for (lane, factor) in part.iter().enumerate() {
                        for q in 0..3 {
                            sum[q] += factor * u.0[q].lane(lane);
                        }
                    }
                }
                put::<L>(&mut self.newton.step[g][a], i, Vec3::splat(sum));
            }
        }
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

    /// Magnitude of the terms that nearly cancel in the energy of one robot (N m).
    #[inline(always)]
    pub fn energy_scale(&self, length: f64, robot: usize) -> f64 {
        // all tendons pass the first module, and all dead loads act on it
        let reach = if self.dead.on_disks {
            self.module_count()
        } else {
            1
        };
        let resultants = self.dead.modules[..reach].iter();
        let mut force = resultants.fold(0.0, |most, module| {
            f64::max(most, module[0].norm().lane(robot))
        });
        force = f64::max(force, self.attached.between.largest_force(robot));
        for t in &self.tensions[..self.tendons.len()] {
            force += L::get(t, 0).lane(robot);
        }
        force * length
    }

    /// Sets the right-hand side of the next step, arc by arc from base to tip.
    pub fn set_gradient(&mut self, value: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            for (a, g) in self.gradients[k / L::WIDTH].g.iter_mut().enumerate() {
                put::<L>(g, k % L::WIDTH, Vec3::splat(value(k * A + a).0));
            }
        }
    }

    pub fn save(&mut self) {
        for (g, state) in self.states.iter().enumerate() {
            self.newton.saved[g] = state.w;
            self.newton.saved_force[g] = state.n;
        }
    }

    /// Moves from the saved strain by a fraction of the step.
    #[inline(always)]
    pub fn advance(&mut self, fraction: L::Module) {
        for (g, state) in self.states.iter_mut().enumerate() {
            for i in 0..A {
                state.w[i] = self.newton.step[g][i].scaled_add(fraction, self.newton.saved[g][i]);
            }
            state.n = self.newton.saved_force[g];
        }
    }

    /// Positions of the disks (theory Eq. 2.3), lengths of the tendons, and forward components of
    /// their spans.
    #[inline(never)]
    pub fn finish(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.finish_in_lanes(),
        )
    }

    #[inline(always)]
    fn finish_in_lanes(&mut self) {
        let n = self.module_count();
        let mut position = Vec3::zero();
        let path = self.path();
        for (j, length) in self.placed.lengths.iter_mut().enumerate() {
            *length = self.tendons.length_in_holes(j, path);
        }
        for (g, (c, state)) in self.constants.iter().zip(&self.states).enumerate() {
            let t = in_group(&self.tendons, &self.tensions, self.path(), g);
            let here = L::WIDTH.min(n - g * L::WIDTH);
            let offset = state.offset(c);
            let mean = state.s.column(2) + Vec3::ez();
            let chord = state.rho.dot(mean) * c.per_flexible;
            for i in 0..here {
                let k = g * L::WIDTH + i;
                position += self.rotations[k] * get::<L>(&offset, i);
                self.placed.positions[k] = position;
                self.placed.forward[k] = L::get(&chord, i);
            }
            for (j, holes) in t.holes.iter().enumerate() {
                let (length, forward) = match self.path() {
                    TendonPath::Straight => {
                        let span = Span::new(c, holes, &state.s, state.rho);
                        (span.length, span.direction.dot(mean))
                    }
                    TendonPath::Continuous => (state.parallel_length(c, &t, j), c.stretch(&t)),
                };
                for i in 0..here {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.placed.lengths[j] += L::get(&length, i);
                    let (tension, forward) = (L::get(&t.tensions[j], i), L::get(&forward, i));
                    for robot in 0..L::Chain::LANES {
                        let least = self.placed.forward[k].lane(robot);
                        // a NaN counts as backward
                        if tension.lane(robot) > 0.0 && !(forward.lane(robot) >= least) {
                            self.placed.forward[k].set_lane(robot, forward.lane(robot));
                        }
                    }
                }
            }
        }
    }

    /// The first module of a robot in which a loaded span points backward: its two disks would have
    /// to penetrate each other. From the last `finish`.
    pub fn collision(&self, robot: usize) -> Option<usize> {
        self.placed
            .forward
            .iter()
            .position(|f| !(f.lane(robot) > 0.0))
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

    pub fn set_rest(&mut self, rest: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            let module = &mut self.fixed.modules[k];
            let element = module.flexible * Real::splat(2.0 / A as f64);
            module.rest = Vec3::splat(rest(k).0) * element;
            put::<L>(
                &mut self.constants[k / L::WIDTH].rest,
                k % L::WIDTH,
                module.rest,
            );
        }
    }
}
