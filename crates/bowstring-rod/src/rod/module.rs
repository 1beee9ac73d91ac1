//! One module: the backbone between two disks and the tendon spans beside it.
//!
//! Theory: docs/theory/rod.md (Kinematics, Energy) and docs/theory/statics.md (Consistent tangent).
//!
//! The strain is the only unknown. The backbone is `A` constant-curvature arcs, two to an element
//! (theory Eq. 2.2): the fourth-order commutator-free form of the exponential of a linear strain
//! (Blanes and Moan 2006). Let `rho0` and `S` be the end position and rotation of those arcs. The
//! contact force `N` displaces the end to (theory Eq. 2.5)
//!
//! `rho = rho0 + D N`
//!
//! where the compliance `D` holds shear, extension and the quadratic part of the strain that the
//! arcs omit. (It averages shear and extension over the module, and takes `N` constant, the mean
//! over the module: more elements refine bending and torsion only.) A point inside moves by its
//! share `xi` of the end's displacement `D N`. With dead loads `f` on the end, `p` on the points
//! inside and tensions `T`, the potential (theory Eq. 3.1) is
//!
//! `elastic(w) + N.D N / 2 + sum T |span(S, rho)| - f1 . rho - f2 . S e3 - f3 . e3 - sum p .
//! position`
//!
//! and `N = f1 + sum xi p - sum T span/|span|` makes it stationary in `rho`. All vectors are in the
//! frame of the module's start. Rotations are perturbed from the left, and an arc by the rotation
//! `u` that it adds there: `exp(w + dw)` rotates the part beyond it by `u`, to first order.

use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::rod::constants::Constants;
use crate::rod::continuous::{PulledArc, PulledElement, PulledSection};
use crate::rod::coupling::Sway;
use crate::rod::routes::Tendons;
use crate::rod::span::Span;
use crate::rod::state::{Arc, Gradient, Hessian, Response, State};

/// Motion of a module's end by the rotation added by each arc, and the forces that it causes.
struct ThroughEnd<'a, T, const A: usize> {
    /// Motion.
    j: [Mat3<T>; A],
    /// Motion along the contact force, without compliance.
    along: [Vec3<T>; A],
    /// Force on the end.
    force: [Mat3<T>; A],
    /// Moment on the end.
    torque: [Mat3<T>; A],
    /// Of a coupled section.
    sway: Option<&'a Sway<T, A>>,
}

impl<T, const A: usize> ThroughEnd<'_, T, A> {
    #[inline(always)]
    fn sway_if<const COUPLED: bool>(&self) -> Option<&Sway<T, A>> {
        self.sway.filter(|_| COUPLED)
    }
}

/// Tolerance of the residual of `rho`, over the module's length.
const SETTLED: f64 = 1e-13;
/// Most iterations for `rho` and `N`; two are usual.
const MAX_ROUNDS: usize = 12;

impl<T: Real, const A: usize> State<T, A> {
    /// First half of the forward pass: the shape for the present strain (theory Eq. 2.2).
    #[inline(always)]
    pub fn shape(&mut self, c: &Constants<T, A>, t: &Tendons<T>) {
        // by pairs: the compiler then knows the arcs of one element by number
        for e in 0..A / 2 {
            self.append(c, t, 2 * e);
            self.append(c, t, 2 * e + 1);
        }
        for i in 0..A {
            self.tail[i] = self.rho0 - self.tail[i];
        }
    }

    /// Appends an arc; its `tail` is the end so far.
    #[inline(always)]
    fn append(&mut self, c: &Constants<T, A>, t: &Tendons<T>, i: usize) {
        let map = ArcMap::new(self.w[i], c.arc_length(i));
        let (rotation, end) = (map.rotation(), self.arc_end(c, t, i, &map, T::splat(1.0)));
        let mut prefix = Mat3::identity();
        if i == 0 {
            self.rho0 = end;
            self.s = rotation;
        } else {
            prefix = self.s;
            self.rho0 += prefix * end;
            self.s = prefix * rotation;
        }
        self.tail[i] = self.rho0;
        self.arcs[i] = Arc { map, prefix };
    }

    /// End of a part of an arc, from its start.
    #[inline(always)]
    fn arc_end(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        i: usize,
        map: &ArcMap<T>,
        part: T,
    ) -> Vec3<T> {
        if t.are_continuous() {
            return map.end_along(PulledArc::new(c, t, i, self.w[i]).chord * part);
        }
        c.arc_end(map)
    }

    /// Hessian of an arc; see [`ArcMap::hessian`].
    #[inline(always)]
    fn arc_hessian<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        i: usize,
        n: Vec3<T>,
        m: Vec3<T>,
    ) -> Mat3<T> {
        let map = &self.arcs[i].map;
        if t.are_continuous() {
            return PulledArc::new(c, t, i, self.w[i]).hessian(c, t, map, n, m);
        }
        c.arc_hessian::<COUPLED>(map, n, m)
    }

    /// Second half: contact force, end and energy (theory Eq. 3.1) under the dead loads in `f`.
    #[inline(always)]
    pub fn balance(&mut self, c: &Constants<T, A>, t: &Tendons<T>) {
        let tangent = self.s.column(2);
        let cable = match t.are_continuous() {
            true => self.balance_continuous(c, t),
            false => self.balance_straight(c, t),
        };
        self.end_force = self.n;
        if A > 2 {
            self.end_force -= self.stretching_load(c, t.on_nodes) - self.f[0];
        }
        self.energy = self.elastic_energy(c) + cable
            - self.f[0].dot(self.rho)
            - self.f[1].dot(tangent)
            - self.f[2][2];
        // the start's tangent is the z axis
        let on_start = Vec3([-self.f[2][1], self.f[2][0], T::zero()]);
        self.load_moment = self.rho.cross(self.f[0]) + tangent.cross(self.f[1]) + on_start;
        for node in 1..A / 2 {
            let (place, load) = (
                self.inside(c, 2 * node - 1),
                self.node_load(c, t.on_nodes, node),
            );
            self.energy -= load.dot(place);
            self.load_moment += place.cross(load);
        }
    }

    /// Contact force and end with continuous tendons; returns the energy of the tendons and
    /// of the shear and extension that they cause.
    #[inline(always)]
    fn balance_continuous(&mut self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        self.span_torque = Vec3::zero();
        self.n = self.stretching_load(c, t.on_nodes);
        self.rho = self.rho0 + self.compliance(c, t) * self.n;
        let mut cable = T::zero();
        for e in 0..A / 2 {
            cable += PulledElement::new(c, t, e, &self.w).energy(c, t);
        }
        cable
    }

    /// Contact force and end with straight spans; returns the sum of tension times length.
    #[inline(always)]
    fn balance_straight(&mut self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let compliance = self.compliance(c, t);
        let stretching = self.stretching_load(c, t.on_nodes);
        // Newton's method for rho and N; the compliance is small, so it converges at once
        self.rho = self.rho0 + compliance * self.n;
        let mut round = 1;
        loop {
            let (cable, pull, torque, g) = self.spans(c, t);
            self.span_torque = torque;
            self.n = stretching - pull;
            let miss = self.rho0 + compliance * self.n - self.rho;
            // a NaN propagates to the energy, where it is detected
            self.miss = miss.max_abs();
            let moves = (self.miss * c.per_flexible).any_above(SETTLED);
            if !moves || round == MAX_ROUNDS {
                return cable;
            }
            let unit = [T::splat(1.0); 3];
            self.rho += (compliance * g).add_diagonal(unit).inverse() * miss;
            round += 1;
        }
    }

    /// Position of the point at the end of an arc, from the start of the flexible part. Shear and
    /// extension move it by its share of the displacement of the end.
    #[inline(always)]
    pub fn inside(&self, c: &Constants<T, A>, arc: usize) -> Vec3<T> {
        (self.rho - self.rho0).scaled_add(c.share(arc), self.rho0 - self.tail[arc])
    }

    /// Dead load on the node before an element (N).
    #[inline(always)]
    pub fn node_load(&self, c: &Constants<T, A>, on_nodes: &[Vec3<T>], element: usize) -> Vec3<T> {
        let weight = self.f[3] * c.node_weight(element);
        on_nodes.get(element).map_or(weight, |own| weight + *own)
    }

    /// Dead load that causes shear and extension: the load on the end and, of the nodes between
    /// elements, the share that moves with the end.
    #[inline(always)]
    pub fn stretching_load(&self, c: &Constants<T, A>, on_nodes: &[Vec3<T>]) -> Vec3<T> {
        if A == 2 {
            return self.f[0];
        }
        let mut load = self.f[0];
        for node in 1..A / 2 {
            let own = self.node_load(c, on_nodes, node);
            load = own.scaled_add(c.fraction(2 * node), load);
        }
        load
    }

    /// Sums over all straight spans: tension times length, force and moment on the end, and
    /// stiffness with respect to the displacement of the end (theory Eq. 2.6 and 3.3).
    #[inline(always)]
    pub fn spans(&self, c: &Constants<T, A>, t: &Tendons<T>) -> (T, Vec3<T>, Vec3<T>, Mat3<T>) {
        let (mut cable, mut stiffness) = (T::zero(), Mat3::zero());
        let (mut pull, mut torque) = (Vec3::zero(), Vec3::zero());
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            let span = Span::new(c, holes, &self.s, self.rho);
            let force = span.direction * tension;
            pull += force;
            cable = tension.mul_add(span.length, cable);
            torque += span.arm.cross(force);
            stiffness = span.add_stiffness(tension, stiffness);
        }
        (cable, pull, torque, stiffness.mirrored())
    }

    /// Elastic energy of the backbone (theory Eq. 2.4, and the contact force's part of Eq. 3.1).
    #[inline(always)]
    pub fn elastic_energy(&self, c: &Constants<T, A>) -> T {
        let half = T::splat(0.5);
        let mut elastic = half * self.n.dot(self.rho - self.rho0);
        for e in 0..A / 2 {
            let i = 2 * e;
            let (a, b) = (self.w[i] - c.rest[i], self.w[i + 1] - c.rest[i + 1]);
            let moments = c.moments_of_element(e, [a, b]);
            elastic += (a.dot(moments[0]) + b.dot(moments[1])) * half;
        }
        elastic
    }

    /// Vector from a node between two elements to the end.
    #[inline(always)]
    pub fn beyond(&self, node: usize) -> Vec3<T> {
        self.tail[2 * node - 1]
    }

    /// Vector from the start disk to the end disk (m).
    #[inline(always)]
    pub fn offset(&self, c: &Constants<T, A>) -> Vec3<T> {
        let mut offset = self.rho + self.s.column(2) * c.clamp[1];
        offset.0[2] += c.clamp[0];
        offset
    }

    /// Change of the length of a continuous tendon (m) as its tension holds the shear by the loads.
    #[inline(always)]
    pub fn length_by_shear(&self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let (mean, change) = self.tangents(c, t);
        let (n, [d0, ..]) = (self.n, c.compliance_with(t));
        let ([along, turned], n2) = ([mean.dot(n), change.dot(n)], n.norm2());
        let sheared = n2 - along * along - turned * turned * T::splat(1.0 / 12.0);
        let held = d0 * d0 * c.per_flexible * sheared * T::splat(0.5);
        // the mean tangent is over the length without loads
        let (on_end, _) = self.compliance_forces(c, t);
        held - on_end.dot(self.rho0) * c.compliance[1] / c.stretch(t)
    }

    /// Force of continuous tendons on a section at a fraction of the flexible part, under a contact
    /// force of the loads, both in its axes (N).
    #[inline(always)]
    pub fn pull(&self, c: &Constants<T, A>, t: &Tendons<T>, fraction: f64, n: Vec3<T>) -> Vec3<T> {
        let arcs = c.arcs_before(fraction);
        let e = (arcs as usize / 2).min(A / 2 - 1);
        let middle = 0.5 * arcs - e as f64 - 0.5;
        let (a, b) = (self.w[2 * e], self.w[2 * e + 1]);
        let turned = (b - a).scaled_add(T::splat(3.0 * middle), a + b);
        let u = turned * (T::splat(0.5) / c.arc_length(2 * e));
        let at = c.flexible * T::splat(fraction);
        PulledSection::new(c, t, c.compliance, at, u, n).pull
    }

    /// Mean tangent t, and change s of the tangent from start to end (theory Eq. 2.5).
    #[inline(always)]
    fn tangents(&self, c: &Constants<T, A>, t: &Tendons<T>) -> (Vec3<T>, Vec3<T>) {
        (self.rho0 * c.per_length(t), self.s.column(2) - Vec3::ez())
    }

    #[inline(always)]
    pub fn compliance(&self, c: &Constants<T, A>, t: &Tendons<T>) -> Mat3<T> {
        let (mean, change) = self.tangents(c, t);
        let [d0, d1, d2, d3] = c.compliance_with(t);
        let diagonal = d3.mul_add(change.norm2(), d0);
        let plain = (mean * d1)
            .outer_add(mean, (change * d2).outer(change))
            .add_diagonal([diagonal; 3])
            .mirrored();
        if T::PLAIN {
            if let Some(coupling) = c.coupling() {
                return plain + self.coupled_compliance(c, coupling);
            }
        }
        plain
    }

    /// Force on `rho0` and moment on the end tangent due to the compliance at constant `N`, without
    /// that of a coupled section.
    #[inline(always)]
    pub fn compliance_forces(&self, c: &Constants<T, A>, t: &Tendons<T>) -> (Vec3<T>, Vec3<T>) {
        let (mean, change) = self.tangents(c, t);
        let [_, d1, d2, d3] = c.compliance_with(t);
        let n = self.n;
        (
            n * (d1 * mean.dot(n) * c.per_length(t)),
            n * (d2 * change.dot(n)) + change * (d3 * n.norm2()),
        )
    }

    /// Moment imbalance of each arc, with the costate in `lambda` (theory Eq. 3.2).
    #[inline(always)]
    pub fn gradient(&self, c: &Constants<T, A>, t: &Tendons<T>, out: &mut Gradient<T, A>) {
        if T::PLAIN && (Constants::<T, A>::FINE || c.coupling().is_some()) {
            self.coupled_gradient(c, t, out)
        } else {
            self.gradient_of::<false>(c, t, out)
        }
    }

    /// Gradient of a section that may be coupled; see [`State::gradient`]. It is not inlined, so that it
    /// does not slow the pass of plain sections.
    #[inline(never)]
    fn coupled_gradient(&self, c: &Constants<T, A>, t: &Tendons<T>, out: &mut Gradient<T, A>) {
        self.gradient_of::<true>(c, t, out);
    }

    /// Moment imbalance of each arc; `COUPLED`: the strains of the section may be.
    #[inline(always)]
    fn gradient_of<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        out: &mut Gradient<T, A>,
    ) {
        let tangent = self.s.column(2);
        let (on_end, on_tangent) = self.compliance_forces(c, t);
        out.torque = self.span_torque - tangent.cross(self.f[1] + on_tangent) + self.lambda;
        out.nu = self.end_force + on_end;
        let elastic = self.elastic_gradient(c, t);
        for e in 0..A / 2 {
            self.arc_gradient::<COUPLED>(c, t, 2 * e, elastic[2 * e], out);
            self.arc_gradient::<COUPLED>(c, t, 2 * e + 1, elastic[2 * e + 1], out);
        }
        if COUPLED {
            if let Some(coupling) = c.coupling() {
                let torques = self.sway_torques(c, coupling);
                for (g, torque) in out.g.iter_mut().zip(torques) {
                    *g += torque;
                }
            }
        }
    }

    /// Derivatives by one arc, whose elastic moment is `elastic`.
    #[inline(always)]
    fn arc_gradient<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        i: usize,
        elastic: Vec3<T>,
        out: &mut Gradient<T, A>,
    ) {
        let Arc { map: arc, prefix } = &self.arcs[i];
        let q = match t.are_continuous() {
            true => PulledArc::new(c, t, i, self.w[i]).end_jacobian(arc),
            false => c.arc_end_jacobian::<COUPLED>(arc),
        };
        let inverse = arc.left_jacobian_inverse();
        let tail = self.tail[i].skew();
        if i == 0 {
            out.to_strain[0] = inverse;
            out.r[0] = q * inverse - tail;
        } else {
            out.to_strain[i] = inverse * prefix.transpose();
            out.r[i] = *prefix * (q * out.to_strain[i]) - tail;
        }
        out.g[i] = out.to_strain[i].tr_mul(elastic) + out.torque - out.r[i].tr_mul(out.nu);
        for node in i / 2 + 1..A / 2 {
            // an arc moves a node like the end, except for the lever beyond the node
            let load = self.node_load(c, t.on_nodes, node);
            out.g[i] -= out.r[i].tr_mul(load) - self.beyond(node).cross(load);
        }
    }

    /// Derivatives of elastic energy and continuous tendons with respect to each arc's rotation
    /// vector.
    #[inline(always)]
    fn elastic_gradient(&self, c: &Constants<T, A>, t: &Tendons<T>) -> [Vec3<T>; A] {
        let mut g = c.elastic_moments(&self.w);
        if t.are_continuous() {
            for e in 0..A / 2 {
                let [a, b] = PulledElement::new(c, t, e, &self.w).gradient();
                g[2 * e] += a;
                g[2 * e + 1] += b;
            }
        }
        g
    }

    /// Second derivatives, and the response of the end. `CONDENSED`: the contact force is
    /// eliminated by static condensation; if not, it is constant.
    #[inline(always)]
    pub fn hessian<const CONDENSED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        out: &mut Hessian<T, A>,
    ) -> Response<T, A> {
        if T::PLAIN && (Constants::<T, A>::FINE || c.coupling().is_some()) {
            self.coupled_hessian::<CONDENSED>(c, t, grad, out)
        } else {
            self.hessian_of::<CONDENSED, false>(c, t, grad, out)
        }
    }

    /// Second derivatives of a section that may be coupled; see [`State::hessian`]. Not inlined either.
    #[inline(never)]
    fn coupled_hessian<const CONDENSED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        out: &mut Hessian<T, A>,
    ) -> Response<T, A> {
        self.hessian_of::<CONDENSED, true>(c, t, grad, out)
    }

    /// Second derivatives; `COUPLED`: the strains of the section may be.
    #[inline(always)]
    fn hessian_of<const CONDENSED: bool, const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        out: &mut Hessian<T, A>,
    ) -> Response<T, A> {
        let (g, k, mut e) = self.span_stiffness(c, t);
        e += self.tangent_stiffness(c, t);
        let (mut m, mut d_hat, mut g_hat) = (Mat3::identity(), Mat3::zero(), g);
        let (mut km, mut kd, mut core) = (k, Mat3::zero(), e);
        if CONDENSED {
            let compliance = self.compliance(c, t);
            m = (compliance * g).add_diagonal([T::splat(1.0); 3]).inverse();
            d_hat = (m * compliance).mirrored();
            g_hat = (g * m).mirrored();
            km = k * m;
            kd = k * d_hat;
            core = (-kd).mul_add(k.transpose(), core).mirrored();
        }
        let along = self.along_force(grad);
        let mut sway = None;
        if COUPLED {
            sway = c.coupling().map(|coupling| self.sway(c, coupling));
        }
        let mut j = self.end_motions(c, t, grad, &along);
        if let Some(sway) = &sway {
            for i in 0..A {
                j[i] += sway.motion[i];
            }
        }
        let mut through = ThroughEnd {
            j,
            along,
            force: j,
            torque: j,
            sway: sway.as_ref(),
        };
        for i in 0..A {
            through.force[i] = g_hat.mul_add(j[i], km.transpose());
            through.torque[i] = km.mul_add(j[i], core);
        }
        for e in 0..A / 2 {
            let (i, k) = (2 * e, 2 * e + 1);
            out.uu[i][i] = self.own_stiffness::<COUPLED>(c, t, grad, &through, i);
            out.uu[k][i] = self.stiffness_between::<COUPLED>(c, t, grad, &through, [i, k]);
            out.uu[k][k] = self.own_stiffness::<COUPLED>(c, t, grad, &through, k);
            for b in k + 1..A {
                out.uu[b][i] = self.stiffness_between::<COUPLED>(c, t, grad, &through, [i, b]);
                out.uu[b][k] = self.stiffness_between::<COUPLED>(c, t, grad, &through, [k, b]);
            }
        }
        // -[f1] [tangent] - [lambda] / 2
        let tangent = self.s.column(2);
        let on_x = (-tangent).outer_add(
            self.f[1],
            (self.lambda * T::splat(-0.5)).skew_and_scalar(tangent.dot(self.f[1])),
        );
        let mut moved = j;
        for i in 0..A {
            if CONDENSED {
                moved[i] = m.mul_add(j[i], -kd.transpose());
            }
            out.xu[i] = self.f[0].cross_mat(moved[i]) + on_x;
        }
        out.xx = self.start_stiffness::<CONDENSED>(c, t, &d_hat);
        if A > 2 {
            let mut weights = [Vec3::zero(); A];
            for node in 1..A / 2 {
                weights[2 * node - 1] = self.node_load(c, t.on_nodes, node);
            }
            self.add_dead_loads_of::<COUPLED>(c, t, grad, &weights, &moved, out);
        }
        Response {
            j,
            m,
            d_hat,
            g_hat,
            k,
        }
    }

    /// Sums of theory Eq. 3.3 over the spans: translation-translation (`g`), rotation-translation
    /// (`k`) and rotation-rotation (`e`).
    #[inline(always)]
    fn span_stiffness(&self, c: &Constants<T, A>, t: &Tendons<T>) -> (Mat3<T>, Mat3<T>, Mat3<T>) {
        let half = T::splat(0.5);
        let (mut g, mut k, mut e) = (Mat3::zero(), Mat3::zero(), Mat3::zero());
        if !t.are_continuous() {
            for (holes, &tension) in t.holes.iter().zip(t.tensions) {
                let span = Span::new(c, holes, &self.s, self.rho);
                let (arm, direction) = (span.arm, span.direction);
                let stiffness = tension * span.per_length;
                let across = arm.cross(direction);
                g = span.add_stiffness(tension, g);
                k = (across * -stiffness)
                    .outer_add(direction, k)
                    .add_skew(arm * stiffness);
                let lever = direction * (tension * half) - arm * (stiffness * half);
                let d = stiffness * arm.norm2() - tension * direction.dot(arm);
                let of_rotation = (across * -stiffness).outer_add(across, e);
                e = lever
                    .outer_add(arm, arm.outer_add(lever, of_rotation))
                    .add_diagonal([d; 3]);
            }
        }
        (g.mirrored(), k, e.mirrored())
    }

    /// Stiffness of the dead loads and the compliance that act on the end tangent.
    #[inline(always)]
    fn tangent_stiffness(&self, c: &Constants<T, A>, t: &Tendons<T>) -> Mat3<T> {
        let tangent = self.s.column(2);
        let [_, _, d2, d3] = c.compliance_with(t);
        let (_, on_tangent) = self.compliance_forces(c, t);
        let f2 = self.f[1] + on_tangent;
        let turn = self.n.cross(tangent);
        let bubble = d3 * self.n.norm2();
        let pulled = tangent * bubble - f2;
        (pulled.outer(tangent).symmetric_part() - (turn * d2).outer(turn))
            .add_diagonal([f2.dot(tangent) - bubble; 3])
    }

    /// Derivative of `rho0` along the contact force with respect to the rotation added by each arc.
    #[inline(always)]
    fn along_force(&self, grad: &Gradient<T, A>) -> [Vec3<T>; A] {
        let mut along = [self.n; A];
        for i in 0..A {
            along[i] = grad.r[i].tr_mul(self.n);
        }
        along
    }

    /// Derivative of the end's position with respect to the rotation added by each arc, at constant
    /// contact force.
    #[inline(always)]
    fn end_motions(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        along: &[Vec3<T>; A],
    ) -> [Mat3<T>; A] {
        let (mean, change) = self.tangents(c, t);
        let [_, d1, d2, d3] = c.compliance_with(t);
        let n = self.n;
        // motion of the end with its tangent, which a rotation u changes by u x tangent
        let by_tangent = ((change * d2).outer(n) + (n * (d3 + d3)).outer(change))
            .add_diagonal([d2 * change.dot(n); 3]);
        let tangent = self.s.column(2);
        let y = tangent.cross_mat(by_tangent.transpose()).transpose();
        // the mean tangent moves with the end
        let longer = T::splat(1.0) + d1 * mean.dot(n) * c.per_length(t);
        let stretched = mean * (d1 * c.per_length(t));
        let mut j = grad.r;
        for i in 0..A {
            j[i] = stretched.outer_add(along[i], grad.r[i].scaled_add(longer, y));
        }
        j
    }

    /// Coupling of two arcs: through the end, through the chain, and through a common element.
    #[inline(always)]
    fn stiffness_between<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        through: &ThroughEnd<'_, T, A>,
        [i, b]: [usize; 2],
    ) -> Mat3<T> {
        let mut block = self.stiffness_through_end(c, t, through, [i, b]);
        block += grad.nu.cross_mat(grad.r[b]).transpose();
        block = block.add_skew(grad.torque * T::splat(0.5));
        if let Some(sway) = through.sway_if::<COUPLED>() {
            block = block.add_skew(sway.torque[b] * T::splat(0.5)) + sway.stiffness[b];
        }
        if i % 2 == 0 && b == i + 1 {
            let strain = &grad.to_strain[i];
            let mut moment = c.mutual_times::<COUPLED>(i / 2, *strain);
            if t.are_continuous() {
                moment = self.continuous_blocks(c, t, i)[1].mul_add(*strain, moment);
            }
            block = grad.to_strain[b].transpose().mul_add(moment, block);
        }
        block
    }

    /// Stiffness of an arc: through the end, and its own.
    #[inline(always)]
    fn own_stiffness<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        through: &ThroughEnd<'_, T, A>,
        i: usize,
    ) -> Mat3<T> {
        let (nu, tail) = (-grad.nu, self.tail[i]);
        let p = &self.arcs[i].prefix;
        let mut torque = grad.torque;
        if let Some(sway) = through.sway_if::<COUPLED>() {
            torque += sway.torque[i];
        }
        let lever = p.tr_mul(torque + tail.cross(nu));
        let turned = self.arc_hessian::<COUPLED>(c, t, i, p.tr_mul(nu), lever);
        let mut local = c.plus_own::<COUPLED>(i, turned);
        if t.are_continuous() {
            local += self.continuous_blocks(c, t, i - i % 2)[2 * (i % 2)];
        }
        let lever = nu
            .outer(tail)
            .symmetric_part()
            .add_diagonal([-nu.dot(tail); 3]);
        let strain = &grad.to_strain[i];
        let mut block = self.stiffness_through_end(c, t, through, [i, i]) + lever;
        if let Some(sway) = through.sway_if::<COUPLED>() {
            block += sway.stiffness[i];
        }
        strain
            .transpose()
            .mul_add(local * *strain, block)
            .mirrored()
    }

    /// Part of a block that is due to spans and compliance at the end.
    #[inline(always)]
    fn stiffness_through_end(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        through: &ThroughEnd<'_, T, A>,
        [i, b]: [usize; 2],
    ) -> Mat3<T> {
        let along = &through.along;
        let per = c.per_length(t);
        let rank1 = c.compliance_with(t)[1] * per * per;
        let turned = (along[b] * -rank1).outer_add(along[i], through.torque[i]);
        through.j[b].transpose().mul_add(through.force[i], turned)
    }

    /// Second derivative with respect to the start's rotation.
    #[inline(always)]
    fn start_stiffness<const CONDENSED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        d_hat: &Mat3<T>,
    ) -> Mat3<T> {
        let mut xx = Mat3::zero();
        if CONDENSED {
            let stretching = self.stretching_load(c, t.on_nodes);
            xx -= stretching.cross_mat(stretching.cross_mat(*d_hat).transpose());
        }
        for (f, v) in [(self.f[0], self.rho), (self.f[1], self.s.column(2))] {
            let half = f * T::splat(-0.5);
            xx = half
                .outer_add(v, v.outer_add(half, xx))
                .add_diagonal([f.dot(v); 3]);
        }
        // the same for the start's tangent, the z axis
        let [x, y, z] = self.f[2].0;
        xx.0[2][0] -= x * T::splat(0.5);
        xx.0[2][1] -= y * T::splat(0.5);
        xx.0[0][0] += z;
        xx.0[1][1] += z;
        xx.mirrored()
    }

    /// Adds the second derivatives of dead loads on the points inside, by the arc at whose end each
    /// is; `moved` is the motion of the end due to the rotation added by each arc. Returns the
    /// share of these loads that causes shear and extension.
    #[inline(always)]
    pub fn add_dead_loads(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        loads: &[Vec3<T>; A],
        moved: &[Mat3<T>; A],
        out: &mut Hessian<T, A>,
    ) -> Vec3<T> {
        if T::PLAIN && (Constants::<T, A>::FINE || c.coupling().is_some()) {
            self.add_dead_loads_of::<true>(c, t, grad, loads, moved, out)
        } else {
            self.add_dead_loads_of::<false>(c, t, grad, loads, moved, out)
        }
    }

    /// The same; `COUPLED`: the strains of the section may be.
    #[inline(always)]
    fn add_dead_loads_of<const COUPLED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        loads: &[Vec3<T>; A],
        moved: &[Mat3<T>; A],
        out: &mut Hessian<T, A>,
    ) -> Vec3<T> {
        let mut stretching = Vec3::zero();
        for (a, load) in loads[..A - 1].iter().enumerate() {
            stretching += *load * c.share(a);
        }
        // sums over the points from an arc on: load, and its outer product with the vector to the
        // end
        let (mut load, mut product) = (Vec3::zero(), Mat3::<T>::zero());
        let mut crossed = [Mat3::zero(); A];
        for i in (0..A - 1).rev() {
            load += loads[i];
            product += loads[i].outer(self.tail[i]);
            let [x, y, z] = product.rows();
            let trace = x[0] + y[1] + z[2];
            // sum of load x (lever u) for the rotation u of an arc before the points
            crossed[i] = load.cross_mat(grad.r[i]) + product.transpose().add_diagonal([-trace; 3]);
            let moment = load.cross(self.tail[i]) - Vec3([y[2] - z[1], z[0] - x[2], x[1] - y[0]]);
            let p = &self.arcs[i].prefix;
            let local = self.arc_hessian::<COUPLED>(c, t, i, p.tr_mul(-load), p.tr_mul(moment));
            let lever = load.dot(self.tail[i]) - trace;
            out.uu[i][i] += grad.to_strain[i].tr_mat(local * grad.to_strain[i])
                + (product - load.outer(self.tail[i]))
                    .symmetric_part()
                    .add_diagonal([lever; 3]);
            for b in i + 1..A - 1 {
                out.uu[b][i] += crossed[b].transpose();
            }
            out.xu[i] += crossed[i];
        }
        for i in 0..A {
            out.xu[i] += stretching.cross_mat(moved[i] - grad.r[i]);
        }
        // sum of load and position
        let places = load.outer(self.rho0) - product + stretching.outer(self.rho - self.rho0);
        let [x, y, z] = places.rows();
        out.xx += (-places.symmetric_part()).add_diagonal([x[0] + y[1] + z[2]; 3]);
        stretching
    }

    /// Rotation of the node before an element, relative to the start.
    #[inline(always)]
    pub fn node(&self, element: usize) -> Mat3<T> {
        self.arcs[2 * element].prefix
    }

    /// Adds the second derivatives of a moment on the node after some arcs, whose imbalance is
    /// `torque`, without its change by the rotation of the node.
    pub fn add_moment_on_node(
        &self,
        grad: &Gradient<T, A>,
        arcs: usize,
        torque: Vec3<T>,
        out: &mut Hessian<T, A>,
    ) {
        let half = T::splat(0.5);
        for i in 0..arcs {
            let Arc { map, prefix: p } = &self.arcs[i];
            let strain = &grad.to_strain[i];
            let local = map.hessian(Vec3::zero(), p.tr_mul(torque));
            out.uu[i][i] += strain.tr_mat(local * *strain);
            for b in i + 1..arcs {
                out.uu[b][i] = out.uu[b][i].add_skew(torque * half);
            }
            out.xu[i] = out.xu[i].add_skew(torque * -half);
        }
    }

    /// Continuous tendons: second derivatives with respect to the rotation vectors of the two arcs
    /// of an element: first-first, second-first, second-second.
    #[inline(always)]
    fn continuous_blocks(&self, c: &Constants<T, A>, t: &Tendons<T>, i: usize) -> [Mat3<T>; 3] {
        PulledElement::new(c, t, i / 2, &self.w).hessian()
    }
}

impl<const A: usize> State<f64, A> {
    /// A point of the backbone at a fraction of the distance to the end disk.
    pub fn point(&self, c: &Constants<f64, A>, t: &Tendons<f64>, fraction: f64) -> Vec3 {
        let [start, end] = c.clamp;
        let along = fraction * (start + c.flexible + end) - start;
        let (place, turn) = self.section(c, t, along / c.flexible);
        // beyond the flexible part the clamps continue straight
        let on = along - along.clamp(0.0, c.flexible);
        Vec3([0.0, 0.0, start]) + place + turn.column(2) * on
    }
}

impl<T: Real, const A: usize> State<T, A> {
    /// Position and orientation of a section at a fraction of the flexible part, relative to its
    /// start.
    #[inline(always)]
    pub fn section(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        fraction: f64,
    ) -> (Vec3<T>, Mat3<T>) {
        let fraction = fraction.clamp(0.0, 1.0);
        let at = c.arcs_before(fraction);
        let i = (at as usize).min(A - 1);
        let part = T::splat(at - i as f64);
        let arc = ArcMap::new(self.w[i] * part, self.arcs[i].map.length() * part);
        let mut from = (self.rho - self.rho0) * T::splat(fraction);
        for j in 0..i {
            from += self.arcs[j].prefix * self.arc_end(c, t, j, &self.arcs[j].map, T::splat(1.0));
        }
        let prefix = self.arcs[i].prefix;
        (
            from + prefix * self.arc_end(c, t, i, &arc, part),
            prefix * arc.rotation(),
        )
    }
}

impl<T: Real, const A: usize> Constants<T, A> {
    /// Coefficients of the compliance D, where continuous tendons resist shear with their tensions.
    #[inline(always)]
    pub fn compliance_with(&self, t: &Tendons<T>) -> [T; 4] {
        if !t.are_continuous() {
            return self.d;
        }
        let mut force = T::zero();
        for &tension in t.tensions {
            force += tension;
        }
        let [free, d1, _, d3] = self.d;
        let per = (free * self.per_flexible).mul_add(force, T::splat(1.0));
        let d0 = free / per;
        let d1 = d1 + free - d0;
        [d0, d1, d1 * T::splat(1.0 / 12.0) - d3, d3]
    }

    /// Inverse of the length without loads (1/m).
    #[inline(always)]
    fn per_length(&self, t: &Tendons<T>) -> T {
        if t.are_continuous() {
            return self.per_flexible / self.stretch(t);
        }
        self.per_flexible
    }

    /// Axial stretch of the backbone under continuous tendons.
    #[inline(always)]
    pub fn stretch(&self, t: &Tendons<T>) -> T {
        let mut stretch = T::splat(1.0);
        if t.are_continuous() {
            for &tension in t.tensions {
                stretch -= tension * self.compliance[1];
            }
        }
        stretch
    }
}
