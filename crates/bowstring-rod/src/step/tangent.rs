//! Tangent of a step: the blocks of statics with inertia and contact forces, and their
//! block-tridiagonal elimination from tip to base.
//!
//! Theory: docs/theory/dynamics.md (Time integration) and docs/theory/statics.md (Eq. 3.4).
//!
//! The contact force of a module is condensed statically before its arcs are eliminated.

use super::body::Body;
use super::mass::wide;
use super::residual::Residual;
use super::scheme::Scheme;
use crate::math::copies;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::chain::Rod;
use crate::rod::constants::Constants;
use crate::rod::elimination::{negative_pivots, Blocks, Eliminated};
use crate::rod::groups::{get, get_mat};
use crate::rod::routes::in_group;
use crate::rod::state::{Gradient, Hessian, State};

/// Relative change of inertia or stiffness above which the tangent is recomputed.
const TANGENT_CHANGE: f64 = 1e-3;

/// Tangent at the present strain, and its elimination.
pub(super) struct Tangent<L: Layout, const A: usize> {
    pub contact: Vec<ContactBlocks<L::Module, A>>,
    pub eliminated: Vec<EliminatedModule<L::Chain, A>>,
    /// Coefficients of mass and stiffness in this tangent; NaN where it must not be reused.
    made_for: [f64; 2],
    /// Smallest pivot; not positive where the energy has no minimum.
    pub least_pivot: f64,
}

/// Blocks of a module beyond those of statics: of `delta`, the displacement of the end due to the
/// contact force, and of the start's translation.
#[derive(Clone, Copy)]
pub(super) struct ContactBlocks<T, const A: usize> {
    /// Derivative of the end's position with respect to the rotation added by each arc.
    pub j: [Mat3<T>; A],
    delta_u: [Mat3<T>; A],
    delta_delta: Mat3<T>,
    /// Rows of `delta`, columns of the start's rotation and translation.
    delta_x: Mat3<T>,
    delta_t: T,
    /// Inverse compliance.
    pub stiffness: Mat3<T>,
    /// Rows of the start's translation.
    tu: [Mat3<T>; A],
    tx: Mat3<T>,
    tt: T,
}

/// A module after elimination.
#[derive(Clone, Copy)]
pub(super) struct EliminatedModule<T, const A: usize> {
    pub arcs: Eliminated<T, A, 2>,
    /// Inverse pivot of `delta`, and its off-diagonal blocks.
    pub inverse: Mat3<T>,
    pub u: [Mat3<T>; A],
    pub x: Mat3<T>,
    pub t: Mat3<T>,
    /// Solution of `delta` for the right-hand side alone.
    pub solution: Vec3<T>,
}

/// Relative pose of the two disks of a module.
#[derive(Clone, Copy)]
pub(super) struct ModulePose<T> {
    /// Rotation of the end relative to the start.
    pub s: Mat3<T>,
    /// Offset from the start disk to the end of the flexible part, and from there to the end disk
    /// (m).
    pub o: Vec3<T>,
    pub b: Vec3<T>,
}

impl<T: Real> ModulePose<T> {
    #[inline(always)]
    pub fn of<L: Layout<Chain = T>, const A: usize>(rod: &Rod<L, A>, k: usize) -> Self {
        let (state, i) = (&rod.states[k / L::WIDTH], k % L::WIDTH);
        let [start, end] = rod.fixed.modules[k].clamp;
        let s = get_mat::<L>(&state.s, i);
        let mut o = get::<L>(&state.rho, i);
        o.0[2] += start;
        let b = s.column(2) * end;
        ModulePose { s, o, b }
    }

    /// Transforms the second variation of the end disk and the distal part from the frame of the
    /// end disk to the end of the flexible part, in the frame of the start: blocks of rotation
    /// (`r`) and translation (`t`).
    #[inline(always)]
    fn at_flexible_end(&self, [[rr, _], [tr, tt]]: [[Mat3<T>; 2]; 2]) -> [Mat3<T>; 3] {
        let (s, b) = (self.s, self.b);
        let back = s.transpose();
        let tt = s * tt * back;
        let mut tr = s * tr * back;
        let crossed = b.cross_mat(tr).transpose();
        tr += b.cross_mat(tt).transpose();
        [s * rr * back + crossed + b.cross_mat(tr), tr, tt]
    }
}

impl<L: Layout, const A: usize> Tangent<L, A> {
    pub fn new(modules: usize) -> Self {
        let empty = EliminatedModule {
            arcs: Eliminated::empty(),
            inverse: Mat3::zero(),
            u: [Mat3::zero(); A],
            x: Mat3::zero(),
            t: Mat3::zero(),
            solution: Vec3::zero(),
        };
        Tangent {
            contact: copies(ContactBlocks::empty(), modules.div_ceil(L::WIDTH)),
            eliminated: copies(empty, modules),
            made_for: [f64::NAN; 2],
            least_pivot: f64::NAN,
        }
    }

    /// Marks the tangent as not reusable.
    pub fn invalidate(&mut self) {
        self.made_for = [f64::NAN; 2];
    }

    /// Whether the tangent of an earlier step is close to that of this one.
    #[inline(always)]
    pub fn serves(&self, scheme: &Scheme) -> bool {
        let coefficients = [scheme.tangent_inertia(), scheme.strain_factor()];
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= TANGENT_CHANGE * b;
        self.made_for.iter().zip(&coefficients).all(near)
    }

    /// Whether an equilibrium is a minimum of the energy, given that displacement control holds
    /// `held` directions in which the energy has none.
    pub fn is_stable(&self, held: usize) -> bool {
        if held == 0 {
            return self.least_pivot > 0.0;
        }
        let of = |module: &EliminatedModule<L::Chain, A>| {
            module.arcs.negative_pivots() + negative_pivots(&module.inverse)
        };
        self.eliminated.iter().map(of).sum::<usize>() <= held
    }

    /// Assembles the tangent at the present strain and eliminates it.
    #[inline(always)]
    pub fn make(&mut self, body: &mut Body<L, A>, residual: &Residual<L, A>) {
        self.assemble(body, residual);
        self.eliminate(body, residual);
        self.made_for = [body.scheme.tangent_inertia(), body.scheme.strain_factor()];
    }

    /// Second variation of every module.
    #[inline(always)]
    fn assemble(&mut self, body: &mut Body<L, A>, residual: &Residual<L, A>) {
        let (rod, scheme) = (&mut body.rod, &body.scheme);
        let inertia = scheme.tangent_inertia();
        // a solution moves the end of the step by 1 / af, also where contact forces are taken at
        // the end
        let stiffer = L::Module::splat(scheme.force_factor() * scheme.force_share() / scheme.af);
        for g in 0..self.contact.len() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let c = &body.constants[g];
            let (state, gradient) = (&rod.states[g], &rod.gradients[g]);
            let hessian = &mut rod.newton.hessians[g];
            let response = state.hessian::<false>(c, &t, gradient, hessian);
            let contact = &mut self.contact[g];
            let stiffness = state.compliance(c, &t).inverse();
            contact.stiffness = stiffness;
            contact.delta_delta = response.g_hat + stiffness * stiffer;
            for i in 0..A {
                contact.delta_u[i] = response.g_hat * response.j[i] + response.k.transpose();
            }
            contact.j = response.j;
            let nodes = &residual.modules[g].nodes;
            let stretching = state.add_dead_loads(c, &t, gradient, nodes, &response.j, hessian);
            contact.delta_x = -(state.f[0] + stretching).skew();
            contact.add_nodes(c, state, gradient, hessian, &body.mass.lanes[g], inertia);
            if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                rod.linearise_torques(g);
            }
        }
    }

    /// Eliminates all modules from tip to base (theory Eq. 3.4).
    #[inline(always)]
    fn eliminate(&mut self, body: &Body<L, A>, residual: &Residual<L, A>) {
        let (rod, mass) = (&body.rod, &body.mass);
        let inertia = body.scheme.tangent_inertia();
        let splat = L::Chain::splat;
        // second variation of a disk and the distal part, in its own frame
        let mut value = [[Mat3::zero(); 2]; 2];
        let mut least_pivot = splat(f64::INFINITY);
        for k in (0..mass.directors.len()).rev() {
            let [e1, e3] = mass.directors[k];
            let (across, along) = (splat(inertia * (e1 + e3)), splat(inertia * 2.0 * e1));
            value[0][0] = value[0][0].add_diagonal([across, across, along]);
            let disk = splat(inertia * mass.points[k * A + A - 1]);
            value[1][1] = value[1][1].add_diagonal([disk; 3]);
            if let (false, Some(own)) = (mass.bodies.is_empty(), mass.body(k)) {
                let first = wide(own.first);
                let weight = rod.rotations[k + 1].tr_mul(residual.gravity);
                value[0][0] += Mat3::splat(&own.inertia()) * splat(inertia)
                    + (-weight.outer(first).symmetric_part()).add_diagonal([weight.dot(first); 3]);
                let lever = (first * splat(-inertia)).skew();
                value[1][0] += lever;
                value[0][1] += lever.transpose();
                value[1][1] = value[1][1].add_diagonal([splat(inertia * own.mass); 3]);
            }
            if rod.attached.has_forces() {
                value[0][0] += rod.attached.stiffness::<true>(k, &rod.rotations[k + 1]);
            }
            let mut blocks = self.condense(rod, k, value);
            if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                rod.add_stiffness_between::<true, 2>(k, &mut blocks);
            }
            let module = &mut self.eliminated[k];
            value = module.arcs.eliminate::<true>(blocks, &mut least_pivot);
        }
        self.least_pivot = least_pivot.lane(0);
    }

    /// Blocks of a module with the distal part, in the frame of the end disk; its contact force is
    /// condensed.
    #[inline(always)]
    fn condense(
        &mut self,
        rod: &Rod<L, A>,
        k: usize,
        beyond: [[Mat3<L::Chain>; 2]; 2],
    ) -> Blocks<L::Chain, A, 2> {
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let (hessian, contact) = (&rod.newton.hessians[g], &self.contact[g]);
        let pose = ModulePose::of(rod, k);
        let ([rr, tr, tt], o) = (pose.at_flexible_end(beyond), pose.o);
        let tr_x = tr + o.cross_mat(tt).transpose();
        let rr_x = rr + o.cross_mat(tr).transpose();
        let rt = tr.transpose();
        let module = &mut self.eliminated[k];
        let mut blocks = Blocks::empty();
        let (mut j, mut tr_u) = ([Mat3::zero(); A], [Mat3::zero(); A]);
        for a in 0..A {
            j[a] = get_mat::<L>(&contact.j[a], i);
            tr_u[a] = tt.mul_add(j[a], tr);
            let rr_u = rt.mul_add(j[a], rr);
            blocks.xu[a] = [
                get_mat::<L>(&hessian.xu[a], i) + rr_u + o.cross_mat(tr_u[a]),
                get_mat::<L>(&contact.tu[a], i) + tr_u[a],
            ];
            module.u[a] = get_mat::<L>(&contact.delta_u[a], i) + tr_u[a];
            // rows of the later arc, columns of the earlier
            for b in a..A {
                let later = if b == a {
                    j[a]
                } else {
                    get_mat::<L>(&contact.j[b], i)
                };
                blocks.uu[b][a] = get_mat::<L>(&hessian.uu[b][a], i) + rr_u + later.tr_mat(tr_u[a]);
            }
        }
        module.x = tr_x + get_mat::<L>(&contact.delta_x, i);
        module.t = tt.add_diagonal([L::get(&contact.delta_t, i); 3]);
        let inverse = (get_mat::<L>(&contact.delta_delta, i) + tt).inverse();
        module.inverse = inverse;
        let (by_x, by_t) = (inverse * module.x, inverse * module.t);
        for a in 0..A {
            let by_u = inverse * module.u[a];
            blocks.xu[a][0] -= module.x.tr_mat(by_u);
            blocks.xu[a][1] -= module.t.tr_mat(by_u);
            blocks.ux[a] = [blocks.xu[a][0].transpose(), blocks.xu[a][1].transpose()];
            for b in a..A {
                let update = module.u[b].tr_mat(by_u);
                blocks.uu[b][a] -= update;
            }
        }
        blocks.xx[0][0] =
            get_mat::<L>(&hessian.xx, i) + rr_x + o.cross_mat(tr_x) - module.x.tr_mat(by_x);
        blocks.xx[1][0] = get_mat::<L>(&contact.tx, i) + tr_x - module.t.tr_mat(by_x);
        blocks.xx[1][1] = (tt - module.t.tr_mat(by_t)).add_diagonal([L::get(&contact.tt, i); 3]);
        blocks
    }
}

impl<T: Real, const A: usize> ContactBlocks<T, A> {
    fn empty() -> Self {
        let matrix = Mat3::zero();
        ContactBlocks {
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

    /// Adds the inertia of the inner nodes to the blocks.
    #[inline(always)]
    fn add_nodes(
        &mut self,
        c: &Constants<T, A>,
        state: &State<T, A>,
        gradient: &Gradient<T, A>,
        hessian: &mut Hessian<T, A>,
        masses: &[T; A],
        inertia: f64,
    ) {
        self.tu = [Mat3::zero(); A];
        self.tx = Mat3::zero();
        self.tt = T::zero();
        self.delta_t = T::zero();
        for a in 0..A - 1 {
            let m = masses[a] * T::splat(inertia);
            let share = c.share(a);
            let beyond = state.tail[a].skew();
            let mut place = state.inside(c, a);
            place.0[2] += c.clamp[0];
            // motion of the point due to the rotation added by each arc: bending first, then shear
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
