//! One implicit time step of the rod.
//!
//! All mass sits in points: disks, and the nodes between arcs, which carry the backbone by
//! Simpson's rule. A disk turns as its three directors do, so that kinetic energy is
//! quadratic in the velocities of points and directors `y`, with a constant mass matrix `M`,
//! and only strain `q` is unknown: `y = y(q)`, `J = dy/dq`. The scheme is the first-order
//! generalised-alpha method (Jansen, Whiting and Hulbert 2000) for `y` and its velocity, with
//! the balance of forces taken at the strain between the ends of the step:
//!
//! `J(q_a)' (M acceleration_a - forces_a) + dV/dq(q_a) = 0`,  `q_a = (1 - a) q_n + a q_(n+1)`
//!
//! Acceleration and velocity at `a` are linear in `y(q_(n+1))`. Without numerical damping this
//! is the energy-momentum form of the midpoint rule for a constrained system (Betsch and
//! Steinmann 2001): energy holds to third order in the strain of one step, however stiff the
//! rod and long the step. What this leaves is given back within the step by a force against the
//! velocity of all mass, of either sign ([`Motion::restore`]): a discrete gradient (Gonzalez 1996)
//! in the metric of the mass.
//!
//! Newton's matrix takes `J` at `q_a` on both sides, which keeps it symmetric: inertia adds to
//! the blocks of statics, and the sweep's state is rotation and translation of a disk. The
//! contact force of a module is unknown beside its arcs, as shear and extension have inertia.

use crate::math::lie::log;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{Load, Model, TendonPath, Theory};
use crate::model::robot::Robot;
use crate::rod::chain::{get, get_mat, in_group, lanes, put, Rod, Sources};
use crate::rod::elimination::{Blocks, Eliminated};
use crate::rod::module::{share, Constants, Gradient, Hessian, Span, State};

mod flexibility;
pub(crate) mod oscillation;
mod record;
#[cfg(test)]
mod tangent_tests;

pub(crate) use flexibility::{Lock, Rest};
pub use record::Fields;

/// The unknown of a module.
#[derive(Clone, Copy)]
struct Strain<T, const A: usize> {
    w: [Vec3<T>; A],
    n: Vec3<T>,
}

impl<T: Real, const A: usize> Strain<T, A> {
    fn zero() -> Self {
        Strain {
            w: [Vec3::zero(); A],
            n: Vec3::zero(),
        }
    }

    /// `self * s + o`
    #[inline(always)]
    fn scaled_add(&self, s: T, o: &Self) -> Self {
        let mut out = *o;
        for a in 0..A {
            out.w[a] = self.w[a].scaled_add(s, o.w[a]);
        }
        out.n = self.n.scaled_add(s, o.n);
        out
    }
}

/// Where all mass is, or how fast it moves: points from base to tip, the disk last in each
/// module, and the directors of the disks.
#[derive(Clone)]
struct Mass<T> {
    points: Vec<Vec3<T>>,
    frames: Vec<Mat3<T>>,
}

impl<T: Real> Mass<T> {
    fn zero(modules: usize, arcs: usize) -> Self {
        Mass {
            points: vec![Vec3::zero(); modules * arcs],
            frames: vec![Mat3::zero(); modules],
        }
    }
}

/// Blocks of a module that inertia needs beside those of statics; `delta` is the yielding of
/// the end to the contact force.
#[derive(Clone, Copy)]
struct Inertia<T, const A: usize> {
    /// Forces on the nodes inside.
    force: [Vec3<T>; A],
    /// Imbalance of the contact force.
    g_delta: Vec3<T>,
    /// Motion of the end by the rotation that each arc adds.
    j: [Mat3<T>; A],
    delta_u: [Mat3<T>; A],
    delta_delta: Mat3<T>,
    /// Rows of `delta`, columns of the start's rotation and translation.
    delta_x: Mat3<T>,
    delta_t: T,
    /// Inverse compliance.
    stiffness: Mat3<T>,
    /// Rows of the start's translation.
    tu: [Mat3<T>; A],
    tx: Mat3<T>,
    tt: T,
}

impl<T: Real, const A: usize> Inertia<T, A> {
    fn empty() -> Self {
        let (zero, matrix) = (Vec3::zero(), Mat3::zero());
        Inertia {
            force: [zero; A],
            g_delta: zero,
            j: [matrix; A],
            delta_u: [matrix; A],
            delta_delta: matrix,
            delta_x: matrix,
            delta_t: T::zero(),
            stiffness: matrix,
            tu: [matrix; A],
            tx: matrix,
            tt: T::zero(),
        }
    }
}

/// The chain's part of an eliminated module.
#[derive(Clone, Copy)]
struct Joint<T, const A: usize> {
    arcs: Eliminated<T, A, 2>,
    /// Inverse pivot of `delta`, and what stands beside it.
    inverse: Mat3<T>,
    u: [Mat3<T>; A],
    x: Mat3<T>,
    t: Mat3<T>,
    /// Answer of `delta` to the right-hand side.
    answer: Vec3<T>,
}

/// Answer of all arcs, contact forces and spans to a right-hand side.
#[derive(Clone)]
struct Column<L: Layout, const A: usize> {
    /// Rotation that every arc adds, and yielding of the ends, by groups.
    u: Vec<[Vec3<L::Module>; A]>,
    delta: Vec<Vec3<L::Module>>,
    /// Change of every span's length at the end of the step, by tendons and modules; zero where a
    /// tendon does not pass.
    rates: Vec<f64>,
}

/// What a dead moment at the tip, which has no potential, changes of an answer at rest: in the
/// tip's frame it is a skew stiffness `S` against the tip's rotation. With the answers `C` of that
/// rotation to moments, answers of the symmetric elimination are right once a moment
/// `-(I + S C)^-1 S` times their rotation of the tip is answered as well.
struct Swivel<L: Layout, const A: usize> {
    /// Answers to unit moments on the tip about its own axes: arcs, contact forces and disks.
    columns: [Column<L, A>; 3],
    disks: [Vec<[Vec3<L::Chain>; 2]>; 3],
    moment: Mat3<L::Chain>,
}

/// Numerical damping as three weights.
#[derive(Clone, Copy)]
struct Scheme {
    am: f64,
    af: f64,
    gamma: f64,
}

impl Scheme {
    /// From the spectral radius at infinite frequency: 1 damps nothing, 0 all at once.
    fn new(rho: f64) -> Self {
        let am = 0.5 * (3.0 - rho) / (1.0 + rho);
        let af = 1.0 / (1.0 + rho);
        Scheme {
            am,
            af,
            gamma: 0.5 + am - af,
        }
    }
}

/// Physical damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Force per mass and velocity, on all mass and inertia, 1/s.
    pub mass: f64,
    /// Kelvin-Voigt: stress of the strain's rate over that of the strain, s.
    pub material: f64,
}

/// Energies and work, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Kinetic energy (J).
    pub kinetic: f64,
    /// Elastic energy of the backbone, and of tendons that are pulled by a length (J).
    pub elastic: f64,
    /// Energy of weight (J): zero with all mass at the base.
    pub gravity: f64,
    /// Done by motors, tip load and forces on disks since the start.
    pub work: f64,
    /// Taken by physical damping, friction and tendons that catch, since the start.
    pub dissipated: f64,
}

impl Energies {
    /// What is left of what was put in: constant but for numerical damping and error.
    pub fn left(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity - self.work + self.dissipated
    }

    pub(crate) fn size(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity.abs()
    }
}

pub(crate) struct Motion<L: Layout, const A: usize> {
    /// At the strain where forces balance.
    rod: Rod<L, A>,
    /// At the end of the step.
    next: Vec<State<L::Module, A>>,
    /// Stiffness with the material damping of this step.
    constants: Vec<Constants<L::Module>>,
    inertia: Vec<Inertia<L::Module, A>>,
    joints: Vec<Joint<L::Chain, A>>,
    /// Strain of the steps before, latest first, and the lengths of these steps.
    past: [Vec<Strain<L::Module, A>>; HISTORY],
    durations: [f64; HISTORY - 1],
    known: usize,
    /// Rate of the strain as the scheme remembers it, and what the material's damping takes off.
    rate: Vec<Strain<L::Module, A>>,
    offset: Vec<Strain<L::Module, A>>,
    /// kg by points; directors' share of the disks' inertia, kg m^2.
    masses: Vec<f64>,
    directors: Vec<[f64; 2]>,
    lane_masses: Vec<[L::Module; A]>,
    place: Mass<L::Chain>,
    velocity: Mass<L::Chain>,
    /// The scheme's memory of rate of place and acceleration.
    drift: Mass<L::Chain>,
    acceleration: Mass<L::Chain>,
    /// Mean of every disk over the step before.
    last_acceleration: Vec<Vec3<L::Chain>>,
    next_place: Mass<L::Chain>,
    next_velocity: Mass<L::Chain>,
    /// Acceleration, damping included, is `factor (next_place - place) + bias`.
    bias: Mass<L::Chain>,
    /// Inertial and gravity forces on points and moments on disks, base frame.
    force: Vec<Vec3<L::Chain>>,
    moment: Vec<Vec3<L::Chain>>,
    /// Those on points of the step before, which stand.
    standing: Vec<Vec3<L::Chain>>,
    gravity: Vec3<L::Chain>,
    disk_force: Vec<Vec3<L::Chain>>,
    tip_force: Vec3<L::Chain>,
    /// Lengths of spans, by modules and tendons; zero where a tendon does not pass.
    spans: Vec<f64>,
    next_spans: Vec<f64>,
    /// Of the tendons on the disks in the step that was finished, J.
    pub tendon_work: f64,
    pub energies: Energies,
    next_energies: Energies,
    /// Energy that a force of one per mass and velocity would take in this step, J s.
    loss_by_rate: f64,
    /// Force per mass and velocity that restores the energy in this step, 1/s.
    restoring: f64,
    /// Of all points, kg; and of the straight robot, m.
    mass: f64,
    length: f64,
    /// Whether shear and extension are but a device.
    rigid: bool,
    scheme: Scheme,
    damping: Damping,
    duration: f64,
    columns: Vec<Column<L, A>>,
    /// Inertia and damping that Newton's matrix was made for.
    made_for: (f64, f64),
    /// Of Newton's matrix as it was made last; not positive where the energy has no minimum.
    pub least_pivot: f64,
    /// Whether the scheme has no memory yet.
    fresh: bool,
    /// Rotation and translation of every disk by the last substitution, in its own frame.
    answer: Vec<[Vec3<L::Chain>; 2]>,
    /// Of the last tangent, at rest under a tip moment.
    swivel: Option<Box<Swivel<L, A>>>,
    /// How far chords and loaded spans point forward, the least of them.
    forward: f64,
}

/// Largest share of its velocity that restoring the energy takes from the mass in a step.
const MOST_RESTORING: f64 = 1e-2;
/// Steps that foresee the next.
const HISTORY: usize = 4;
/// Compliance of a Kirchhoff rod's module over that of its bending: small enough not to show,
/// large enough to divide by.
const NEARLY_RIGID: f64 = 1e-5;

impl<L: Layout, const A: usize> Motion<L, A> {
    pub fn new(
        layout: L,
        robot: &Robot,
        model: Model,
        gravity: [f64; 3],
        damping: Damping,
    ) -> Self {
        let mut rod = Rod::new(layout, robot, model);
        if model.theory == Theory::Kirchhoff {
            rod.make_yielding(NEARLY_RIGID);
        }
        let (n, groups) = (robot.module_count(), rod.states.len());
        let mut masses = vec![0.0; n * A];
        let mut directors = vec![[0.0; 2]; n];
        for k in 0..n {
            let (module, section) = (robot.modules[k], robot.section(k));
            let arc = module.flexible / A as f64;
            // Simpson's rule over each pair of arcs. The mass of a clamp and of the node where it
            // begins goes to the clamp's disk, which it is rigid with, and its second moment to the
            // director along the axis. Its first moment is zero where both sides of a disk are
            // alike. Elsewhere, as at the last disk, it is left out: it couples points with
            // directors, and M is diagonal.
            let lump = section.mass_per_length * arc / 3.0;
            for a in 0..A {
                masses[k * A + a] += lump * if a % 2 == 0 { 4.0 } else { 2.0 };
            }
            masses[k * A + A - 1] -= lump;
            let disk = &robot.spec().disks[k];
            let held = module.flexible / 2.0 + module.clamp[1];
            let [across, along] = disk.inertia;
            let rotary = section.rotary_inertia * held;
            directors[k][0] += along / 2.0 + rotary;
            let second =
                |clamp: f64| section.mass_per_length * clamp.powi(3) / 3.0 + lump * clamp.powi(2);
            directors[k][1] += f64::max(across - along / 2.0, 0.0) + second(module.clamp[1]);
            masses[k * A + A - 1] += disk.mass + section.mass_per_length * module.clamp[1];
            if k > 0 {
                let held = module.flexible / 2.0 + module.clamp[0];
                directors[k - 1][0] += section.rotary_inertia * held;
                directors[k - 1][1] += second(module.clamp[0]);
                masses[k * A - 1] += lump + section.mass_per_length * module.clamp[0];
            }
        }
        let lane_masses = (0..groups)
            .map(|g| {
                let mut lanes = [L::Module::zero(); A];
                for (a, lane) in lanes.iter_mut().enumerate() {
                    *lane = L::Module::from_fn(|i| {
                        let k = if L::WIDTH == 1 { g } else { g * L::WIDTH + i };
                        if k < n {
                            masses[k * A + a]
                        } else {
                            0.0
                        }
                    });
                }
                lanes
            })
            .collect();
        let total = masses.iter().sum();
        let mass = Mass::zero(n, A);
        let strain = vec![Strain::zero(); groups];
        let joint = Joint {
            arcs: Eliminated::empty(),
            inverse: Mat3::zero(),
            u: [Mat3::zero(); A],
            x: Mat3::zero(),
            t: Mat3::zero(),
            answer: Vec3::zero(),
        };
        Motion {
            next: rod.states.clone(),
            constants: rod.constants.clone(),
            inertia: vec![Inertia::empty(); groups],
            joints: vec![joint; n],
            past: std::array::from_fn(|_| strain.clone()),
            durations: [1.0; HISTORY - 1],
            known: 0,
            rate: strain.clone(),
            offset: strain,
            masses,
            directors,
            lane_masses,
            place: mass.clone(),
            velocity: mass.clone(),
            drift: mass.clone(),
            acceleration: mass.clone(),
            last_acceleration: vec![Vec3::zero(); n],
            next_place: mass.clone(),
            next_velocity: mass.clone(),
            bias: mass,
            force: vec![Vec3::zero(); n * A],
            standing: vec![Vec3::zero(); n * A],
            moment: vec![Vec3::zero(); n],
            gravity: Vec3::splat(gravity),
            disk_force: vec![Vec3::zero(); n],
            tip_force: Vec3::zero(),
            spans: vec![0.0; n * robot.tendon_count()],
            next_spans: vec![0.0; n * robot.tendon_count()],
            tendon_work: 0.0,
            energies: Energies::default(),
            next_energies: Energies::default(),
            loss_by_rate: 0.0,
            restoring: 0.0,
            mass: total,
            length: robot.length(),
            rigid: model.theory == Theory::Kirchhoff,
            scheme: Scheme::new(1.0),
            damping,
            duration: 0.0,
            columns: vec![],
            made_for: (f64::NAN, f64::NAN),
            least_pivot: f64::NAN,
            fresh: true,
            answer: vec![[Vec3::zero(); 2]; n],
            swivel: None,
            forward: 1.0,
            rod,
        }
    }

    /// Of an iteration, in units of `interrupt::work`.
    pub fn work(&self) -> usize {
        A * self.module_count() * (8 + self.rod.tendons.len())
    }

    pub fn layout(&self) -> L {
        self.rod.layout
    }

    pub fn module_count(&self) -> usize {
        self.directors.len()
    }

    /// Takes strain and contact force from an equilibrium.
    pub fn take_strain(&mut self, strain: impl Fn(usize) -> Vec3, force: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let state = &mut self.next[g];
            for a in 0..A {
                put::<L>(&mut state.w[a], i, Vec3::splat(strain(k * A + a).0));
            }
            put::<L>(&mut state.n, i, Vec3::splat(force(k).0));
        }
        // whatever was before does not count
        self.remember_strain();
    }

    /// Sets tensions and tip load; gravity stays.
    pub fn set_load(&mut self, load: &Load) {
        self.rod.set_tensions(|i| L::Chain::splat(load.tensions[i]));
        self.rod.dead.tip_moment = Vec3::splat(load.tip_moment);
        self.tip_force = Vec3::splat(load.tip_force);
    }

    /// Dead forces on the disks beside the loads, N, base frame.
    pub fn set_disk_force(&mut self, disk: usize, force: Vec3) {
        self.disk_force[disk] = Vec3::splat(force.0);
    }

    /// Prepares a search for the equilibrium at the present forces: a step without inertia.
    pub fn begin_at_rest(&mut self) {
        self.duration = f64::INFINITY;
        self.restoring = 0.0;
        self.scheme = Scheme {
            am: 1.0,
            af: 1.0,
            gamma: 1.0,
        };
        self.stiffen();
        // it tells of stability, so it must be that of these forces
        self.made_for = (f64::NAN, f64::NAN);
        self.offset.fill(Strain::zero());
        for v in &mut self.bias.points {
            *v = Vec3::zero();
        }
        for m in &mut self.bias.frames {
            *m = Mat3::zero();
        }
    }

    /// Takes the equilibrium that was found as the state at rest, with the energy of the tendons.
    pub fn commit_at_rest(&mut self, tendons: f64) {
        self.remember_strain();
        self.known = 1;
        self.fresh = true;
        self.measure();
        self.energies = self.stored_energies();
        self.energies.elastic += tendons;
        std::mem::swap(&mut self.spans, &mut self.next_spans);
        self.place = self.next_place.clone();
        for mass in [&mut self.velocity, &mut self.drift, &mut self.acceleration] {
            mass.points.fill(Vec3::zero());
            mass.frames.fill(Mat3::zero());
        }
        self.rate.fill(Strain::zero());
        self.stiffen();
    }

    /// Lets tensions jump, which moves no disk at once: where tendons run along the backbone the
    /// contact forces jump with them. Points inside a module have none of their own and are put
    /// where the new tensions hold them.
    pub fn jump_tensions(&mut self, tensions: &[f64]) {
        if self.rigid || self.rod.path != TendonPath::Continuous {
            return;
        }
        self.rod.set_tensions(|i| L::Chain::splat(tensions[i]));
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let (c, state) = (&self.rod.constants[g], &mut self.next[g]);
            let end = state.rho;
            state.shape(c, &t);
            state.n = state.compliance(c).inverse() * (end - state.rho0);
            state.rho = end;
            self.past[0][g].n = state.n;
        }
        self.place_mass();
        self.place.points.copy_from_slice(&self.next_place.points);
        self.measure();
        self.spans.copy_from_slice(&self.next_spans);
    }

    /// Lets the next step go without the scheme's memory and its numerical damping.
    pub fn restart(&mut self) {
        self.fresh = true;
    }

    /// Starts the next step's search from the present strain and its rate, which do not jump:
    /// what was before misleads. Where a constraint holds even the rate may mislead.
    pub fn stop_foreseeing(&mut self) {
        let again = self.rigid && self.known <= 2;
        self.known = self.known.min(if again { 1 } else { 2 });
    }

    /// Whether the scheme has no memory.
    pub fn is_fresh(&self) -> bool {
        self.fresh
    }

    /// Whether no two disks have met, as of the step that was finished.
    pub fn is_apart(&self) -> bool {
        self.forward > 0.0
    }

    /// Position of a disk now.
    pub fn disk(&self, k: usize) -> Vec3 {
        plain(&self.place.points[k * A + A - 1])
    }

    /// Of all mass now, kg m/s.
    pub fn linear_momentum(&self) -> Vec3 {
        let mut sum = Vec3::zero();
        for (v, mass) in self.velocity.points.iter().zip(&self.masses) {
            sum += *v * L::Chain::splat(*mass);
        }
        plain(&sum)
    }

    /// Scales the stiffness by what material damping adds to it in this step.
    #[inline(always)]
    fn stiffen(&mut self) {
        let factor = L::Module::splat(self.strain_factor());
        for (c, elastic) in self.constants.iter_mut().zip(&self.rod.constants) {
            c.stiffness = [elastic.stiffness[0] * factor, elastic.stiffness[1] * factor];
        }
    }

    /// Prepares a step: loads are those at [`Motion::balance_time`].
    #[inline(always)]
    pub fn begin(&mut self, duration: f64, rho: f64) {
        self.scheme = Scheme::new(if self.fresh { 1.0 } else { rho });
        self.duration = duration;
        self.restoring = 0.0;
        let Scheme { am, af, gamma } = self.scheme;
        let per = 1.0 / (gamma * duration);
        let keep = 1.0 - am / gamma;
        // acceleration + damping * rate
        let (swift, slow) = (am * per / af, am * per / af + self.damping.mass);
        let splat = L::Chain::splat;
        let (on_drift, on_velocity, on_acceleration) =
            (splat(slow * keep), splat(-swift), splat(keep));
        for p in 0..self.bias.points.len() {
            self.bias.points[p] = self.drift.points[p].scaled_add(
                on_drift,
                self.velocity.points[p]
                    .scaled_add(on_velocity, self.acceleration.points[p] * on_acceleration),
            );
        }
        for k in 0..self.bias.frames.len() {
            self.bias.frames[k] = self.drift.frames[k] * on_drift
                + self.velocity.frames[k] * on_velocity
                + self.acceleration.frames[k] * on_acceleration;
        }
        // moment of w + tau rate, with rate = am per (w - w_n) / af + keep rate_n
        let tau = self.damping.material;
        if tau != 0.0 {
            self.stiffen();
            let by_start = L::Module::splat(tau * am * per / af);
            let by_rate = L::Module::splat(-tau * keep);
            for g in 0..self.offset.len() {
                let start = self.past[0][g].scaled_add(by_start, &Strain::zero());
                self.offset[g] = self.rate[g].scaled_add(by_rate, &start);
                if self.rigid {
                    self.offset[g].n = Vec3::zero();
                }
            }
        }
        self.predict();
    }

    /// Stiffness of this step over the elastic one.
    #[inline(always)]
    fn strain_factor(&self) -> f64 {
        let Scheme { am, af, gamma } = self.scheme;
        1.0 + self.damping.material * am / (gamma * self.duration * af)
    }

    /// The same for shear and extension, which a Kirchhoff rod has too little of to damp.
    #[inline(always)]
    fn force_factor(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.strain_factor()
        }
    }

    /// Where in the step the contact forces are taken. Those of a Kirchhoff rod hold a
    /// constraint: only where forces balance do they mean anything.
    #[inline(always)]
    fn force_share(&self) -> f64 {
        if self.rigid {
            1.0
        } else {
            self.scheme.af
        }
    }

    /// Where in the step forces balance, as a fraction.
    pub fn balance_time(&self) -> f64 {
        self.scheme.af
    }

    /// Starts from the strain of the last steps, continued.
    #[inline(always)]
    fn predict(&mut self) {
        // Lagrange's polynomial through the last steps
        let mut at = [0.0; HISTORY];
        for q in 1..HISTORY {
            at[q] = at[q - 1] - self.durations[q - 1];
        }
        let mut weight = [0.0; HISTORY];
        for q in 0..self.known {
            weight[q] = 1.0;
            for r in 0..self.known {
                if r != q {
                    weight[q] *= (self.duration - at[r]) / (at[q] - at[r]);
                }
            }
        }
        for g in 0..self.next.len() {
            let mut strain = Strain::zero();
            for q in 0..self.known {
                strain = self.past[q][g].scaled_add(L::Module::splat(weight[q]), &strain);
            }
            self.next[g].w = strain.w;
            // what holds a constraint may jump with the load
            let jumps = self.rigid && self.known <= 2;
            self.next[g].n = if jumps { self.past[0][g].n } else { strain.n };
        }
    }

    /// Acceleration by distance in this step, 1/s^2; zero in a search for equilibrium.
    #[inline(always)]
    fn factor(&self) -> f64 {
        let Scheme { am, af, gamma } = self.scheme;
        let per = 1.0 / (gamma * self.duration);
        let damping = self.damping.mass + self.restoring;
        (am * per / af + if per > 0.0 { damping } else { 0.0 }) * am * per
    }

    /// Moment that rounding leaves of the forces of this step, N m.
    pub fn noise(&self, tensions: &[f64]) -> f64 {
        let pull: f64 = tensions.iter().sum();
        let weight = self.gravity.norm().lane(0) * self.mass;
        let inertia = self.effort(1.0);
        let force = pull + weight + inertia + self.tip_force.norm().lane(0);
        4.0 * f64::EPSILON * force * self.length
    }

    /// Moment that moves all mass by so much further within this step, N m.
    pub fn effort(&self, distance: f64) -> f64 {
        distance * self.factor() * self.mass * self.length
    }

    /// Forces at the present strain; returns the largest moment imbalance, N m.
    #[inline(always)]
    pub fn residual(&mut self) -> f64 {
        let af = L::Module::splat(self.scheme.af);
        let af_force = L::Module::splat(self.force_share());
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.rod.constants[g];
            let (now, next) = (&mut self.rod.states[g], &mut self.next[g]);
            let start = &self.past[0][g];
            for a in 0..A {
                now.w[a] = (next.w[a] - start.w[a]).scaled_add(af, start.w[a]);
            }
            now.n = (next.n - start.n).scaled_add(af_force, start.n);
            for state in [now, next] {
                state.shape(c, &t);
                state.rho = state.rho0 + state.compliance(c) * state.n;
            }
        }
        self.place_mass();
        self.forces();
        self.imbalance()
    }

    /// Imbalance of arcs and contact forces under the present tensions and forces on all mass;
    /// returns the largest, N m.
    #[inline(always)]
    pub fn imbalance(&mut self) -> f64 {
        let n = self.module_count();
        // loads on every module, from the tip, in the frame of its start
        let mut total = self.tip_force;
        let splat = L::Chain::splat;
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let rotation = self.rod.rotations[k];
            total += self.force[k * A + A - 1] + self.disk_force[k];
            let state = &mut self.rod.states[g];
            let here = rotation.tr_mul(total);
            put::<L>(&mut state.f[0], i, here);
            put::<L>(&mut state.f[1], i, here * splat(end));
            for a in 0..A - 1 {
                let force = self.force[k * A + a];
                total += force;
                put::<L>(&mut self.inertia[g].force[a], i, rotation.tr_mul(force));
            }
            put::<L>(&mut state.f[2], i, rotation.tr_mul(total) * splat(start));
        }
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.constants[g];
            let state = &mut self.rod.states[g];
            state.end_force = state.f[0];
            state.span_torque = Vec3::zero();
            if t.path == TendonPath::Straight {
                let (_, pull, torque, _) = state.spans(c, &t);
                state.end_force -= pull;
                state.span_torque = torque;
            }
            let tangent = state.s.column(2);
            state.load_moment = state.rho.cross(state.f[0])
                + tangent.cross(state.f[1])
                + Vec3::ez().cross(state.f[2]);
            for a in 0..A - 1 {
                state.load_moment += state.inside(a).cross(self.inertia[g].force[a]);
            }
        }
        let mut lambda = -self.rod.rotations[n].tr_mul(self.rod.dead.tip_moment);
        for k in (0..n).rev() {
            let (state, i) = (&mut self.rod.states[k / L::WIDTH], k % L::WIDTH);
            lambda -= self.rod.rotations[k + 1].tr_mul(self.moment[k]);
            lambda = get_mat::<L>(&state.s, i) * lambda;
            put::<L>(&mut state.lambda, i, lambda);
            lambda -= get::<L>(&state.load_moment, i);
        }
        let stiffer = L::Module::splat(self.force_factor());
        let mut largest = L::Module::zero();
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.constants[g];
            let (state, out) = (&self.rod.states[g], &mut self.rod.gradients[g]);
            state.gradient(c, &t, out);
            let inertia = &mut self.inertia[g];
            let damped = self.rod.constants[g].bending_moments(&self.offset[g].w);
            for i in 0..A {
                out.g[i] -= out.to_strain[i].tr_mul(damped[i]);
                for a in i..A - 1 {
                    let force = inertia.force[a];
                    out.g[i] -= out.r[i].tr_mul(force) - state.tail[a].cross(force);
                }
                largest = largest.max(out.g[i].max_abs());
            }
            inertia.g_delta = state.n * stiffer - self.offset[g].n - state.end_force;
            for a in 0..A - 1 {
                inertia.g_delta -= inertia.force[a] * share::<_, A>(a);
            }
            largest = largest.max(inertia.g_delta.max_abs() * c.flexible);
        }
        // idle lanes repeat the last module without its loads
        let mut worst = 0.0;
        for i in 0..L::WIDTH.min(n) {
            let value = L::get(&largest, i).largest();
            worst = Real::max(worst, value);
        }
        worst
    }

    /// Rotations where forces balance, and all mass at the end of the step.
    #[inline(always)]
    fn place_mass(&mut self) {
        let n = self.module_count();
        let mut rotation = Mat3::identity();
        let (mut frame, mut position) = (Mat3::identity(), Vec3::zero());
        let mut inside = [Vec3::zero(); A];
        for k in 0..n {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (now, next) = (&self.rod.states[g], &self.next[g]);
            if i == 0 {
                for (a, place) in inside[..A - 1].iter_mut().enumerate() {
                    *place = next.inside(a);
                }
            }
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let ahead = frame.column(2) * L::Chain::splat(start);
            let base = position + ahead;
            for a in 0..A - 1 {
                let inside = get::<L>(&inside[a], i);
                self.next_place.points[k * A + a] = base + frame * inside;
            }
            position = base + frame * get::<L>(&next.rho, i);
            frame = frame * get_mat::<L>(&next.s, i);
            position += frame.column(2) * L::Chain::splat(end);
            self.next_place.points[k * A + A - 1] = position;
            self.next_place.frames[k] = frame;
            rotation = rotation * get_mat::<L>(&now.s, i);
            self.rod.rotations[k + 1] = rotation;
        }
    }

    /// Gravity and inertia.
    #[inline(always)]
    fn forces(&mut self) {
        let factor = L::Chain::splat(self.factor());
        for p in 0..self.force.len() {
            let moved = self.next_place.points[p] - self.place.points[p];
            let acceleration = moved.scaled_add(factor, self.bias.points[p]);
            self.force[p] = (self.gravity - acceleration) * L::Chain::splat(self.masses[p]);
        }
        for k in 0..self.moment.len() {
            let [e1, e3] = self.directors[k].map(L::Chain::splat);
            let moved = self.next_place.frames[k] - self.place.frames[k];
            let mut acceleration = moved * factor + self.bias.frames[k];
            for row in &mut acceleration.0 {
                *row = [row[0] * e1, row[1] * e1, row[2] * e3];
            }
            // sum of director x acceleration
            let q = acceleration * self.rod.rotations[k + 1].transpose();
            self.moment[k] = Vec3([
                q.0[1][2] - q.0[2][1],
                q.0[2][0] - q.0[0][2],
                q.0[0][1] - q.0[1][0],
            ]);
        }
    }

    /// Readies Newton's matrix. That of a step before is nearly that of this one, and costs five
    /// times a residual: it is made anew where it is asked for, or where the step or scheme
    /// differ. Returns whether it was.
    #[inline(always)]
    pub fn ready(&mut self, anew: bool) -> bool {
        let (inertia, damping) = (self.factor() / self.scheme.af, self.strain_factor());
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-3 * b;
        let made = anew || !near(self.made_for.0, inertia) || !near(self.made_for.1, damping);
        if made {
            self.linearise();
            self.made_for = (inertia, damping);
        }
        made
    }

    /// Leaves the forces of the present strain out of the next Newton matrix, but not what tendons
    /// and stiffness do: the first guess of a short step may ask for forces that bend the rod over,
    /// and only the mass tells where it really goes.
    pub fn forget_forces(&mut self) {
        for (state, gradient) in self.rod.states.iter_mut().zip(&mut self.rod.gradients) {
            state.f[..2].fill(Vec3::zero());
            state.lambda = Vec3::zero();
            gradient.forget_forces();
        }
    }

    /// Moves the end of the step by a sum of answers.
    #[inline(always)]
    pub fn combine(&mut self, coefficients: &[f64]) {
        for (column, factor) in self.columns.iter().zip(coefficients) {
            let ahead = L::Module::splat(factor / self.scheme.af);
            for g in 0..self.next.len() {
                let (next, inertia) = (&mut self.next[g], &self.inertia[g]);
                let gradient: &Gradient<_, A> = &self.rod.gradients[g];
                for a in 0..A {
                    let step = gradient.to_strain[a] * column.u[g][a];
                    next.w[a] = step.scaled_add(ahead, next.w[a]);
                }
                let step = inertia.stiffness * column.delta[g];
                next.n = step.scaled_add(ahead, next.n);
            }
        }
    }

    /// Whether an equilibrium is a minimum of the energy where pulls hold this many directions in
    /// which it is not.
    pub fn is_stable(&self, held: usize) -> bool {
        if held == 0 {
            return self.least_pivot > 0.0;
        }
        let of = |joint: &Joint<L::Chain, A>| {
            let ends = crate::rod::elimination::negative_pivots(&joint.inverse);
            joint.arcs.negative_pivots() + ends
        };
        self.joints.iter().map(of).sum::<usize>() <= held
    }

    /// Second variation at the present strain, and its elimination from tip to base.
    #[inline(always)]
    fn linearise(&mut self) {
        let n = self.module_count();
        let stiff = self.factor() / self.scheme.af;
        // an answer moves the end of the step by 1 / af, also where contact forces are taken there
        let stiffer = L::Module::splat(self.force_factor() * self.force_share() / self.scheme.af);
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.constants[g];
            let (state, gradient) = (&self.rod.states[g], &self.rod.gradients[g]);
            let hessian = &mut self.rod.newton.hessians[g];
            let response = state.hessian::<false>(c, &t, gradient, hessian);
            let inertia = &mut self.inertia[g];
            let stiffness = state.compliance(c).inverse();
            inertia.stiffness = stiffness;
            inertia.delta_delta = response.g_hat + stiffness * stiffer;
            for i in 0..A {
                inertia.delta_u[i] = response.g_hat * response.j[i] + response.k.transpose();
            }
            inertia.j = response.j;
            let stretching = state.add_dead_loads(gradient, &inertia.force, &response.j, hessian);
            inertia.delta_x = -(state.f[0] + stretching).skew();
            inertia.add_nodes(c, state, gradient, hessian, &self.lane_masses[g], stiff);
        }
        let splat = L::Chain::splat;
        // of a disk and all beyond it, in its own frame
        let mut value = [[Mat3::zero(); 2]; 2];
        let mut least_pivot = splat(f64::INFINITY);
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [e1, e3] = self.directors[k];
            let (across, along) = (splat(stiff * (e1 + e3)), splat(stiff * 2.0 * e1));
            value[0][0] = value[0][0].add_diagonal([across, across, along]);
            value[1][1] = value[1][1].add_diagonal([splat(stiff * self.masses[k * A + A - 1]); 3]);
            let (state, hessian) = (&self.rod.states[g], &self.rod.newton.hessians[g]);
            let inertia = &self.inertia[g];
            let s = get_mat::<L>(&state.s, i);
            let back = s.transpose();
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let mut rr = s * value[0][0] * back;
            let mut tr = s * value[1][0] * back;
            let tt = s * value[1][1] * back;
            // from the disk to the end of the flexible part
            let b = s.column(2) * splat(end);
            let crossed = b.cross_mat(tr).transpose();
            tr += b.cross_mat(tt).transpose();
            rr += crossed + b.cross_mat(tr);
            let mut o = get::<L>(&state.rho, i);
            o.0[2] += splat(start);

            let tr_x = tr + o.cross_mat(tt).transpose();
            let rr_x = rr + o.cross_mat(tr).transpose();
            let rt = tr.transpose();
            let joint = &mut self.joints[k];
            let mut blocks = Blocks::empty();
            let (mut j, mut tr_u) = ([Mat3::zero(); A], [Mat3::zero(); A]);
            for a in 0..A {
                j[a] = get_mat::<L>(&inertia.j[a], i);
                tr_u[a] = tt.mul_add(j[a], tr);
                let rr_u = rt.mul_add(j[a], rr);
                blocks.xu[a] = [
                    get_mat::<L>(&hessian.xu[a], i) + rr_u + o.cross_mat(tr_u[a]),
                    get_mat::<L>(&inertia.tu[a], i) + tr_u[a],
                ];
                joint.u[a] = get_mat::<L>(&inertia.delta_u[a], i) + tr_u[a];
                // rows of the later arc, columns of the earlier
                for b in a..A {
                    let later = if b == a {
                        j[a]
                    } else {
                        get_mat::<L>(&inertia.j[b], i)
                    };
                    blocks.uu[b][a] =
                        get_mat::<L>(&hessian.uu[b][a], i) + rr_u + later.tr_mat(tr_u[a]);
                }
            }
            joint.x = tr_x + get_mat::<L>(&inertia.delta_x, i);
            joint.t = tt.add_diagonal([L::get(&inertia.delta_t, i); 3]);
            let inverse = (get_mat::<L>(&inertia.delta_delta, i) + tt).inverse();
            joint.inverse = inverse;
            let (by_x, by_t) = (inverse * joint.x, inverse * joint.t);
            for a in 0..A {
                let by_u = inverse * joint.u[a];
                blocks.xu[a][0] -= joint.x.tr_mat(by_u);
                blocks.xu[a][1] -= joint.t.tr_mat(by_u);
                blocks.ux[a] = [blocks.xu[a][0].transpose(), blocks.xu[a][1].transpose()];
                for b in a..A {
                    let update = joint.u[b].tr_mat(by_u);
                    blocks.uu[b][a] -= update;
                }
            }
            blocks.xx[0][0] =
                get_mat::<L>(&hessian.xx, i) + rr_x + o.cross_mat(tr_x) - joint.x.tr_mat(by_x);
            blocks.xx[1][0] = get_mat::<L>(&inertia.tx, i) + tr_x - joint.t.tr_mat(by_x);
            blocks.xx[1][1] = (tt - joint.t.tr_mat(by_t)).add_diagonal([L::get(&inertia.tt, i); 3]);
            value = joint.arcs.eliminate::<true>(blocks, &mut least_pivot);
        }
        self.least_pivot = least_pivot.lane(0);
        self.swivel = None;
        if self.duration.is_infinite() && self.rod.has_tip_moment() {
            self.swivel = Some(Box::new(self.answer_tip_moments()));
        }
    }

    #[cold]
    fn answer_tip_moments(&mut self) -> Swivel<L, A> {
        let n = self.module_count();
        let mut flexibility = Mat3::zero();
        let mut disks = [const { vec![] }; 3];
        let columns = [0, 1, 2].map(|axis| {
            let mut column = self.empty_column();
            let mut unit = Vec3::zero();
            unit[axis] = L::Chain::splat(1.0);
            self.eliminate_back(&mut column, [-unit, Vec3::zero()]);
            let turned = self.answer[n - 1][0];
            for row in 0..3 {
                flexibility.0[row][axis] = turned[row];
            }
            disks[axis] = self.answer.clone();
            column
        });
        // as in statics: a rotation in its log chart sees half of the moment
        let moment = self.rod.rotations[n].tr_mul(self.rod.dead.tip_moment);
        let stiffness = (moment * L::Chain::splat(-0.5)).skew();
        let back = (stiffness * flexibility).add_diagonal([L::Chain::splat(1.0); 3]);
        Swivel {
            columns,
            disks,
            moment: back.inverse() * stiffness * L::Chain::splat(-1.0),
        }
    }

    fn empty_column(&self) -> Column<L, A> {
        let groups = self.next.len();
        Column {
            u: vec![[Vec3::zero(); A]; groups],
            delta: vec![Vec3::zero(); groups],
            rates: vec![0.0; groups * L::WIDTH * self.rod.tendons.len()],
        }
    }

    /// Answer of arcs, contact forces and disks to the present imbalance, or to more tension.
    #[inline(always)]
    pub fn substitute(&mut self, column: usize, source: Option<(usize, &[f64])>) {
        let n = self.module_count();
        let groups = self.next.len();
        while self.columns.len() <= column {
            let empty = self.empty_column();
            self.columns.push(empty);
        }
        let mut out = std::mem::replace(
            &mut self.columns[column],
            Column {
                u: vec![],
                delta: vec![],
                rates: vec![],
            },
        );
        for g in 0..groups {
            match source {
                None => {
                    let (gradient, inertia) = (&self.rod.gradients[g], &self.inertia[g]);
                    // an arc takes the end along by shear and extension as well
                    for a in 0..A {
                        let lever = inertia.j[a] - gradient.r[a];
                        out.u[g][a] = gradient.g[a] + lever.tr_mul(inertia.g_delta);
                    }
                    out.delta[g] = inertia.g_delta;
                }
                Some((tendon, tension)) => {
                    let w = lanes::<L>(n, g, |k| tension[k]);
                    let span = self.rod.span(g, tendon);
                    let force = span.direction * w;
                    let torque = span.arm.cross(force);
                    for a in 0..A {
                        out.u[g][a] = torque + self.inertia[g].j[a].tr_mul(force);
                    }
                    out.delta[g] = force;
                }
            }
        }
        self.eliminate_back(&mut out, [Vec3::zero(); 2]);
        if let Some(swivel) = &self.swivel {
            let moment = swivel.moment * self.answer[n - 1][0];
            for axis in 0..3 {
                let (part, disks) = (&swivel.columns[axis], &swivel.disks[axis]);
                let share = L::Module::splat(moment[axis].lane(0));
                for g in 0..groups {
                    for a in 0..A {
                        out.u[g][a] = part.u[g][a].scaled_add(share, out.u[g][a]);
                    }
                    out.delta[g] = part.delta[g].scaled_add(share, out.delta[g]);
                }
                for (disk, part) in self.answer.iter_mut().zip(disks) {
                    for q in 0..2 {
                        disk[q] = part[q].scaled_add(moment[axis], disk[q]);
                    }
                }
            }
        }
        self.columns[column] = out;
    }

    /// Answers a right-hand side, which it takes the place of, by the present elimination; `p` is
    /// what stands on the tip beside it.
    #[inline(always)]
    fn eliminate_back(&mut self, out: &mut Column<L, A>, mut p: [Vec3<L::Chain>; 2]) {
        let n = self.module_count();
        let splat = L::Chain::splat;
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (state, inertia) = (&self.rod.states[g], &self.inertia[g]);
            let joint = &mut self.joints[k];
            let s = get_mat::<L>(&state.s, i);
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let push = s * p[1];
            let turn = s * p[0] + (s.column(2) * splat(end)).cross(push);
            let mut o = get::<L>(&state.rho, i);
            o.0[2] += splat(start);
            let answer = joint.inverse * (get::<L>(&out.delta[g], i) + push);
            joint.answer = answer;
            let mut u = [Vec3::zero(); A];
            for a in 0..A {
                u[a] =
                    get::<L>(&out.u[g][a], i) + turn + get_mat::<L>(&inertia.j[a], i).tr_mul(push)
                        - joint.u[a].tr_mul(answer);
            }
            p = [
                turn + o.cross(push) - joint.x.tr_mul(answer),
                push - joint.t.tr_mul(answer),
            ];
            joint.arcs.backward::<true>(&mut u, &mut p);
            for a in 0..A {
                put::<L>(&mut out.u[g][a], i, u[a]);
            }
        }
        let mut x = [Vec3::zero(); 2];
        for k in 0..n {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (state, inertia) = (&self.rod.states[g], &self.inertia[g]);
            let joint = &self.joints[k];
            let mut answer = [Vec3::zero(); A];
            for a in 0..A {
                answer[a] = get::<L>(&out.u[g][a], i);
            }
            let u = joint.arcs.forward(&answer, &x);
            let mut pulled = joint.x * x[0] + joint.t * x[1];
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let s = get_mat::<L>(&state.s, i);
            let mut o = get::<L>(&state.rho, i);
            o.0[2] += splat(start);
            let mut turn = x[0];
            let mut moved = x[1] + x[0].cross(o);
            for a in 0..A {
                pulled += joint.u[a] * u[a];
                turn += u[a];
                moved += get_mat::<L>(&inertia.j[a], i) * u[a];
                put::<L>(&mut out.u[g][a], i, u[a]);
            }
            let delta = -(joint.answer + joint.inverse * pulled);
            put::<L>(&mut out.delta[g], i, delta);
            moved += delta + turn.cross(s.column(2) * splat(end));
            x = [s.tr_mul(turn), s.tr_mul(moved)];
            self.answer[k] = x;
        }
    }

    /// Measures the spans where forces balance, and their lengths at the end of the step.
    #[inline(always)]
    pub fn measure_spans(&mut self, angles: bool) {
        self.rod.measure_spans(angles);
        self.measure();
    }

    /// By modules and tendons, at the end of the step, m.
    pub fn span_lengths(&self) -> &[f64] {
        &self.next_spans
    }

    /// Of the tendons at the holes, where forces balance, rad.
    pub fn angles(&self) -> &[f64] {
        &self.rod.spans.angles
    }

    /// Change of a tendon's length from a hole on, by each of the answers.
    pub fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        let n = self.module_count();
        let stride = self.next.len() * L::WIDTH;
        for (out, column) in out.iter_mut().zip(&self.columns) {
            *out = column.rates[tendon * stride..][hole..n].iter().sum();
        }
    }

    pub fn set_span_tensions(&mut self, tension: impl Fn(usize, usize) -> f64) {
        self.rod.set_span_tensions(tension);
    }

    /// Answers right-hand sides by the present elimination and measured spans: the own imbalance
    /// in the first column, more tension in the next.
    #[inline(always)]
    pub fn respond(&mut self, sources: Sources) {
        let n = self.module_count();
        let own = std::iter::once(None);
        for (column, source) in own.chain(sources.iter(n).map(Some)).enumerate() {
            if crate::interrupt::work(n * (16 + 2 * self.rod.tendons.len())) {
                return;
            }
            self.substitute(column, source);
            self.rate_spans(column);
        }
    }

    /// How an answer changes the lengths of all spans at the end of the step; by the spans where
    /// forces balance, which is near enough for Newton's method.
    #[inline(always)]
    fn rate_spans(&mut self, column: usize) {
        let groups = self.next.len();
        let count = self.rod.tendons.len();
        let ahead = L::Module::splat(1.0 / self.scheme.af);
        let column = &mut self.columns[column];
        for g in 0..self.next.len() {
            let (mut turn, mut moved) = (Vec3::zero(), column.delta[g]);
            for a in 0..A {
                turn += column.u[g][a];
                moved += self.inertia[g].j[a] * column.u[g][a];
            }
            for j in 0..count {
                let span = self.rod.span(g, j);
                let rate = span.direction.dot(moved + turn.cross(span.arm)) * ahead;
                let rate = rate * self.rod.fixed.passes[g * count + j];
                let out = &mut column.rates[(j * groups + g) * L::WIDTH..][..L::WIDTH];
                for (i, out) in out.iter_mut().enumerate() {
                    *out = L::get(&rate, i).lane(0);
                }
            }
        }
    }

    /// Velocities, lengths and energies at the end of the step.
    #[inline(always)]
    pub fn finish(&mut self, load: &Load) {
        let Scheme { am, af, gamma } = self.scheme;
        let per = 1.0 / (gamma * self.duration);
        let splat = L::Chain::splat;
        // rate = am per (next - now) + keep drift; velocity = (rate - (1 - af) velocity) / af
        let keep = 1.0 - am / gamma;
        let (a, b, c) = (
            splat(am * per / af),
            splat(keep / af),
            splat(1.0 - 1.0 / af),
        );
        let (mut lost, mut half_kinetic) = (L::Chain::zero(), L::Chain::zero());
        let mut push = L::Chain::zero();
        for p in 0..self.force.len() {
            let moved = self.next_place.points[p] - self.place.points[p];
            let rate = moved.scaled_add(splat(am * per), self.drift.points[p] * splat(keep));
            let mass = splat(self.masses[p]);
            lost += rate.dot(moved) * mass;
            let velocity = moved.scaled_add(
                a,
                self.drift.points[p].scaled_add(b, self.velocity.points[p] * c),
            );
            half_kinetic += velocity.norm2() * mass;
            self.next_velocity.points[p] = velocity;
            if p % A == A - 1 {
                push += self.disk_force[p / A].dot(moved);
            }
        }
        for k in 0..self.moment.len() {
            let moved = self.next_place.frames[k] - self.place.frames[k];
            let rate = moved * splat(am * per) + self.drift.frames[k] * splat(keep);
            let velocity = moved * a + self.drift.frames[k] * b + self.velocity.frames[k] * c;
            let [e1, e3] = self.directors[k].map(splat);
            for q in 0..3 {
                let (r, m, v) = (rate.0[q], moved.0[q], velocity.0[q]);
                lost += (r[0] * m[0] + r[1] * m[1]) * e1 + r[2] * m[2] * e3;
                half_kinetic += (v[0] * v[0] + v[1] * v[1]) * e1 + v[2] * v[2] * e3;
            }
            self.next_velocity.frames[k] = velocity;
        }
        self.loss_by_rate = lost.lane(0);
        let mut dissipated = self.damping.mass * self.loss_by_rate;
        if self.damping.material != 0.0 {
            dissipated += self.damping.material * self.strain_loss(am * per, keep);
        }
        self.measure();
        let n = self.module_count();
        let mut pulled = 0.0;
        let tendons = load.tensions.len();
        for (at, (next, now)) in self.next_spans.iter().zip(&self.spans).enumerate() {
            pulled -= self.rod.span_tension(at / tendons, at % tendons) * (next - now);
        }
        self.tendon_work = pulled;
        let mut work = push.lane(0) + pulled;
        let tip = self.next_place.points[n * A - 1] - self.place.points[n * A - 1];
        work += Vec3(load.tip_force).dot(plain(&tip));
        if load.tip_moment != [0.0; 3] {
            let turn = self.next_place.frames[n - 1] * self.place.frames[n - 1].transpose();
            work += Vec3(load.tip_moment).dot(log(&plain_mat(&turn)));
        }
        self.next_energies = Energies {
            kinetic: 0.5 * half_kinetic.lane(0),
            work: self.energies.work + work,
            dissipated: self.energies.dissipated + dissipated,
            ..self.stored_energies()
        };
    }

    /// Takes this much energy out of the step that was finished, once it is solved again; not all
    /// of it where hardly anything moves. Without numerical damping only. Returns whether that
    /// changes the step.
    pub fn restore(&mut self, excess: f64) -> bool {
        let most = MOST_RESTORING / self.duration;
        let wanted = self.restoring + excess / self.loss_by_rate;
        // nothing that moves gives a NaN or an infinity
        let restoring = if wanted.is_finite() {
            wanted.clamp(-most, most)
        } else {
            self.restoring
        };
        let changes = restoring != self.restoring;
        self.restoring = restoring;
        changes
    }

    /// Rate of the strain times its change, by stiffness, J/s.
    #[inline(always)]
    fn strain_loss(&self, by_change: f64, by_rate: f64) -> f64 {
        let (by_change, by_rate) = (L::Module::splat(by_change), L::Module::splat(by_rate));
        let mut total = 0.0;
        for g in 0..self.next.len() {
            let (c, next, start) = (&self.rod.constants[g], &self.next[g], &self.past[0][g]);
            let now = Strain {
                w: next.w,
                n: next.n,
            };
            let change = start.scaled_add(L::Module::splat(-1.0), &now);
            let kept = self.rate[g].scaled_add(by_rate, &Strain::zero());
            let rate = change.scaled_add(by_change, &kept);
            let moments = c.bending_moments(&rate.w);
            let mut lost = L::Module::zero();
            if !self.rigid {
                lost = rate.n.dot(next.compliance(c) * change.n);
            }
            for a in 0..A {
                lost += moments[a].dot(change.w[a]);
            }
            total += self.over_modules(g, &lost);
        }
        total
    }

    /// Sum over the modules of a group.
    #[inline(always)]
    fn over_modules(&self, g: usize, value: &L::Module) -> f64 {
        let mut sum = 0.0;
        for i in 0..L::WIDTH.min(self.module_count() - g * L::WIDTH) {
            sum += L::get(value, i).lane(0);
        }
        sum
    }

    /// Lengths of the tendons at the end of the step.
    #[inline(always)]
    fn measure(&mut self) {
        let n = self.module_count();
        self.forward = f64::INFINITY;
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let (c, state) = (&self.rod.constants[g], &self.next[g]);
            let mean = state.s.column(2) + Vec3::ez();
            let chord = state.rho.dot(mean);
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                // a NaN counts as backward
                self.forward = -Real::max(-self.forward, -L::get(&chord, i).lane(0));
            }
            for (j, tendon) in t.tendons.iter().enumerate() {
                let (length, forward) = match t.path {
                    TendonPath::Straight => {
                        let span = Span::new(c, tendon, &state.s, state.rho);
                        // below a hundredth of the module's length its ends have met
                        let gap = span.length * c.per_flexible - L::Module::splat(0.01);
                        let forward = span.direction.dot(mean);
                        (span.length, -(-gap).max(-forward))
                    }
                    TendonPath::Continuous => (state.parallel_length(c, &t, tendon), c.stretch(&t)),
                };
                for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                    if g * L::WIDTH + i > tendon.end_disk {
                        break;
                    }
                    let at = (g * L::WIDTH + i) * t.tendons.len() + j;
                    self.next_spans[at] = L::get(&length, i).lane(0);
                    if L::get(&t.tensions[j], i).lane(0) > 0.0 {
                        self.forward = -Real::max(-self.forward, -L::get(&forward, i).lane(0));
                    }
                }
            }
        }
    }

    /// Elastic and gravity energy at the end of the step.
    #[inline(always)]
    fn stored_energies(&self) -> Energies {
        let mut elastic = 0.0;
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.rod.constants[g];
            let state = &self.next[g];
            let along = state.rho0 * (L::Module::splat(1.0) / state.rho0.norm());
            let longer = along.dot(state.rho - state.rho0);
            let energy = state.elastic_energy(c) + c.stretch_energy(&t, longer);
            elastic += self.over_modules(g, &energy);
        }
        let mut weight = Vec3::zero();
        for (p, mass) in self.next_place.points.iter().zip(&self.masses) {
            weight += *p * L::Chain::splat(*mass);
        }
        Energies {
            elastic,
            gravity: -self.gravity.dot(weight).lane(0),
            ..Energies::default()
        }
    }

    /// Adds what the tendons did in the step that was finished beside pulling on the disks: their
    /// own energy, and work and loss since the start.
    pub fn account(&mut self, tendons: &Energies) {
        self.next_energies.elastic += tendons.elastic;
        self.next_energies.work += tendons.work;
        self.next_energies.dissipated += tendons.dissipated;
    }

    /// Energies at the end of the step that was finished.
    pub fn outlook(&self) -> &Energies {
        &self.next_energies
    }

    /// Estimated error of a disk's position in this step, m: the largest, and that of the tip;
    /// infinite while unknown.
    #[inline(always)]
    pub fn local_errors(&self) -> [f64; 2] {
        if self.fresh || self.known < 2 {
            return [f64::INFINITY; 2];
        }
        // h^3 y''' / 12, y''' from the change of acceleration since the last step
        let h = self.duration;
        let scale = h * h / 12.0 * (2.0 * h / (h + self.durations[0]));
        let (mut largest, mut tip) = (0.0, 0.0);
        for k in 0..self.module_count() {
            let change = plain(&(self.mean_acceleration(k) - self.last_acceleration[k]));
            tip = scale * change.norm();
            largest = f64::max(largest, tip);
        }
        [largest, tip]
    }

    /// Of a disk over this step.
    #[inline(always)]
    fn mean_acceleration(&self, k: usize) -> Vec3<L::Chain> {
        let p = k * A + A - 1;
        let gained = self.next_velocity.points[p] - self.velocity.points[p];
        gained * L::Chain::splat(1.0 / self.duration)
    }

    /// Takes the end of the step as the start of the next.
    #[inline(always)]
    pub fn commit(&mut self) {
        let gamma = self.scheme.gamma;
        let per = L::Chain::splat(1.0 / (gamma * self.duration));
        let keep = L::Chain::splat(-(1.0 - gamma) / gamma);
        let once = L::Chain::splat(1.0 / self.duration);
        for k in 0..self.module_count() {
            self.last_acceleration[k] = self.mean_acceleration(k);
        }
        for p in 0..self.force.len() {
            let moved = self.next_place.points[p] - self.place.points[p];
            let gained = self.next_velocity.points[p] - self.velocity.points[p];
            if self.fresh {
                self.drift.points[p] = self.next_velocity.points[p];
                self.acceleration.points[p] = gained * once;
            } else {
                self.drift.points[p] = moved.scaled_add(per, self.drift.points[p] * keep);
                self.acceleration.points[p] =
                    gained.scaled_add(per, self.acceleration.points[p] * keep);
            }
        }
        for k in 0..self.moment.len() {
            let moved = self.next_place.frames[k] - self.place.frames[k];
            let gained = self.next_velocity.frames[k] - self.velocity.frames[k];
            if self.fresh {
                self.drift.frames[k] = self.next_velocity.frames[k];
                self.acceleration.frames[k] = gained * once;
            } else {
                self.drift.frames[k] = moved * per + self.drift.frames[k] * keep;
                self.acceleration.frames[k] = gained * per + self.acceleration.frames[k] * keep;
            }
        }
        if self.damping.material != 0.0 {
            // a scheme without memory has no use for an old rate, which would never fade
            let forgets = self.fresh || self.scheme.am == gamma;
            let gamma = if forgets { 1.0 } else { gamma };
            let per = L::Module::splat(1.0 / (gamma * self.duration));
            let keep = L::Module::splat(-(1.0 - gamma) / gamma);
            for g in 0..self.next.len() {
                let now = Strain {
                    w: self.next[g].w,
                    n: self.next[g].n,
                };
                let change = self.past[0][g].scaled_add(L::Module::splat(-1.0), &now);
                let kept = self.rate[g].scaled_add(keep, &Strain::zero());
                self.rate[g] = change.scaled_add(per, &kept);
            }
        }
        self.remember_strain();
        self.known = (self.known + 1).min(HISTORY);
        self.durations.rotate_right(1);
        self.durations[0] = self.duration;
        self.fresh = false;
        std::mem::swap(&mut self.place, &mut self.next_place);
        std::mem::swap(&mut self.velocity, &mut self.next_velocity);
        std::mem::swap(&mut self.spans, &mut self.next_spans);
        self.energies = self.next_energies;
    }

    #[inline(always)]
    fn remember_strain(&mut self) {
        self.standing.copy_from_slice(&self.force);
        self.past.rotate_right(1);
        for (past, state) in self.past[0].iter_mut().zip(&self.next) {
            *past = Strain {
                w: state.w,
                n: state.n,
            };
        }
    }
}

impl<T: Real, const A: usize> Inertia<T, A> {
    /// Adds the inertia of the nodes inside to the blocks.
    #[inline(always)]
    fn add_nodes(
        &mut self,
        c: &Constants<T>,
        state: &State<T, A>,
        gradient: &Gradient<T, A>,
        hessian: &mut Hessian<T, A>,
        masses: &[T; A],
        stiff: f64,
    ) {
        self.tu = [Mat3::zero(); A];
        self.tx = Mat3::zero();
        self.tt = T::zero();
        self.delta_t = T::zero();
        for a in 0..A - 1 {
            let m = masses[a] * T::splat(stiff);
            let share = share::<T, A>(a);
            let beyond = state.tail[a].skew();
            let mut place = state.inside(a);
            place.0[2] += c.clamp[0];
            // motion of the point by the rotation that each arc adds, bending first, then shear
            // and extension
            let mut moved = [Mat3::zero(); A];
            for i in 0..A {
                moved[i] = (self.j[i] - gradient.r[i]) * share;
                if i <= a {
                    moved[i] += gradient.r[i] + beyond;
                }
            }
            let on_delta = m * share;
            for i in 0..A {
                let inertia = moved[i] * m;
                for b in i..A {
                    hessian.uu[b][i] += moved[b].tr_mat(inertia);
                }
                hessian.xu[i] += place.cross_mat(inertia);
                self.tu[i] += inertia;
                self.delta_u[i] += moved[i] * on_delta;
            }
            hessian.xx += (place * -m)
                .outer(place)
                .add_diagonal([m * place.norm2(); 3]);
            self.tx -= (place * m).skew();
            self.tt += m;
            self.delta_x -= (place * on_delta).skew();
            self.delta_t += on_delta;
            self.delta_delta = self.delta_delta.add_diagonal([on_delta * share; 3]);
        }
    }
}

fn plain<T: Real>(v: &Vec3<T>) -> Vec3 {
    Vec3([v[0].lane(0), v[1].lane(0), v[2].lane(0)])
}

fn plain_mat<T: Real>(m: &Mat3<T>) -> Mat3 {
    let mut out = Mat3::zero();
    for r in 0..3 {
        for c in 0..3 {
            out.0[r][c] = m.0[r][c].lane(0);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::real::Scalar;
    use crate::model::robot::{Disk, RobotSpec, Section, Tendon};

    /// Turning as a whole, the straight robot has the inertia of its disks and of the whole rod,
    /// clamped lengths included.
    #[test]
    fn inertia_is_that_of_the_rod_with_its_clamps() {
        let section = Section {
            bending: 1.1,
            torsion: 0.8,
            axial: 7e5,
            shear: 2.6e5,
            mass_per_length: 0.035,
            rotary_inertia: 5.5e-8,
        };
        let disks = (0..4).map(|k| Disk {
            // 20 mm between all clamps; the last disk would clamp on one side alone, and has none
            station: if k < 3 { 0.045 + 0.07 * k as f64 } else { 0.23 },
            clamped_length: if k < 3 { 0.05 } else { 0.0 },
            mass: 0.002,
            inertia: [5.1e-6, 1.0e-5],
            segment: 0,
        });
        let robot = Robot::new(RobotSpec {
            sections: vec![section],
            disks: disks.collect(),
            tendons: vec![Tendon {
                hole: [0.02, 0.0],
                end_disk: 3,
            }],
            gravity: [0.0; 3],
        })
        .unwrap();
        let still = Damping {
            mass: 0.0,
            material: 0.0,
        };
        let model = Model::default();
        let mut motion = Motion::<Scalar, 2>::new(Scalar, &robot, model, [0.0; 3], still);
        assert!(motion.settle());
        let points = motion.masses.iter().zip(&motion.place.points);
        let lumped: f64 = points.map(|(m, p)| m * p.0[2].powi(2)).sum();
        // directors across the axis and along it move
        let turning: f64 = motion.directors.iter().map(|[e1, e3]| e1 + e3).sum();
        let length = robot.length();
        let mut whole = section.mass_per_length * length.powi(3) / 3.0;
        // the first half module's rotary inertia is the base's
        whole += section.rotary_inertia * (length - robot.modules[0].flexible / 2.0);
        for disk in &robot.spec().disks {
            whole += disk.mass * disk.station.powi(2) + disk.inertia[0];
        }
        let off = (lumped + turning) / whole - 1.0;
        assert!(off.abs() < 1e-12, "{off:e}");
    }

    /// The change of momentum in one step is the load less what the base holds, by the strain of
    /// the first module and the spans that leave the base. Its node between the arcs, whose
    /// weight goes into the base beside them, is left out on both sides.
    #[test]
    fn momentum_balances_with_the_base() {
        let section = Section {
            bending: 1.1,
            torsion: 0.8,
            axial: 7e5,
            shear: 2.6e5,
            mass_per_length: 0.035,
            rotary_inertia: 5.5e-8,
        };
        let disks = (0..9).map(|k| Disk {
            station: 0.07 * (k + 1) as f64,
            clamped_length: 0.0,
            mass: 0.02,
            inertia: [5.1e-6, 1.0e-5],
            segment: 0,
        });
        let tendons = (0..3).map(|i| Tendon {
            hole: [0.02 * (2.0 * i as f64).cos(), 0.02 * (2.0 * i as f64).sin()],
            end_disk: 8,
        });
        let robot = Robot::new(RobotSpec {
            sections: vec![section],
            disks: disks.collect(),
            tendons: tendons.collect(),
            gravity: [0.0; 3],
        })
        .unwrap();
        let gravity = Vec3([1.0, 2.0, -9.0]);
        let damping = Damping {
            mass: 0.7,
            material: 2e-3,
        };
        for rho in [1.0, 0.8, 0.5] {
            let mut motion =
                Motion::<Scalar, 2>::new(Scalar, &robot, Model::default(), gravity.0, damping);
            let tensions = [20.0, 0.0, 5.0];
            let mut load = Load {
                tensions: &tensions,
                gravity: gravity.0,
                tip_force: [0.0, 0.3, 0.1],
                tip_moment: [0.0; 3],
            };
            motion.set_load(&load);
            assert!(motion.settle());
            load.tip_force = [0.0; 3];
            motion.set_load(&load);
            let duration = 2e-3;
            let beyond: f64 = motion.masses[1..].iter().sum();
            let mut momentum = Vec3::zero();
            for step in 0..40 {
                let start = motion.acceleration.clone();
                motion.begin(duration, rho);
                for _ in 0..12 {
                    motion.residual();
                    motion.ready(true);
                    motion.substitute(0, None);
                    motion.combine(&[1.0]);
                }
                motion.residual();
                motion.finish(&load);
                // what the strain and the spans of the first module hold
                let (state, c) = (&motion.rod.states[0], &motion.rod.constants[0]);
                let strained = state.compliance(c).inverse() * (state.rho - state.rho0);
                let mut held = strained * motion.force_factor() - motion.offset[0].n;
                // that is the mean over the module: half of what is on its node does not reach it
                held -= motion.inertia[0].force[0] * 0.5;
                let end = state.offset(c);
                for (tendon, tension) in robot.spec().tendons.iter().zip(tensions) {
                    let hole = Vec3([tendon.hole[0], tendon.hole[1], 0.0]);
                    let span = end + state.s * hole - hole;
                    held += span * (tension / span.norm());
                }
                // the scheme's acceleration at the balance of forces, and its damping
                let Scheme { am, af, .. } = motion.scheme;
                let mut changes = Vec3::zero();
                let (duration, fresh) = (motion.duration, motion.fresh);
                motion.commit();
                for p in 1..motion.masses.len() {
                    let ends = if fresh {
                        motion.acceleration.points[p]
                    } else {
                        start.points[p] * (1.0 - am) + motion.acceleration.points[p] * am
                    };
                    let speed = motion.next_velocity.points[p] * (1.0 - af)
                        + motion.velocity.points[p] * af;
                    changes += (ends + speed * damping.mass) * motion.masses[p];
                }
                let force = gravity * beyond - held;
                let off = (changes - force).norm() / (gravity * beyond).norm();
                assert!(off < 1e-6, "{rho} {step}: {off:e}");
                // without numerical damping that is the gain of momentum itself
                let mut now = Vec3::zero();
                let mut drag = Vec3::zero();
                for p in 1..motion.masses.len() {
                    let speeds = motion.next_velocity.points[p] + motion.velocity.points[p];
                    now += motion.velocity.points[p] * motion.masses[p];
                    drag += speeds * (0.5 * damping.mass * motion.masses[p]);
                }
                let gain = (now - momentum) * (1.0 / duration);
                if rho == 1.0 {
                    let off = (gain + drag - force).norm() / (gravity * beyond).norm();
                    assert!(off < 1e-6, "{step}: {off:e}");
                    assert!(gain.norm() > 1e-3 || step > 0);
                }
                momentum = now;
            }
            assert!(momentum.norm() > 1e-3, "it moves");
        }
    }
}
