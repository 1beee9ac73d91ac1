//! One module: the backbone between two disks and the tendon spans beside it.
//!
//! Unknown is the strain alone. The backbone is `A` constant-curvature arcs, two to an
//! element: the fourth-order commutator-free form of the exponential of a linear strain
//! (Blanes and Moan 2006). Let `rho0` and `S` be the end of those arcs, in the frame of the
//! module's start. The contact force `N` moves the end on to
//!
//! `rho = rho0 + D N`
//!
//! where the compliance `D` holds shear, extension and the quadratic part of the strain
//! that the arcs leave out. With dead loads `f` and tensions `T` the potential is
//!
//! `elastic(w) + N.D N / 2 + sum T |span(S, rho)| - f1 . rho - f2 . S e3 - f3 . e3`
//!
//! and `N = f1 - sum T span/|span|` makes it stationary in `rho`. All vectors of a module
//! are in its start frame; derivatives perturb rotations from the left.

use crate::lie::ArcMap;
use crate::linalg::{Mat3, Vec3};
use crate::load::{Model, TendonPath, Theory};
use crate::real::Real;
use crate::robot::{Robot, Tendon};

/// What a module is, whatever its load.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Constants {
    /// Elastic length and the rigid lengths at start and end, m.
    pub flexible: f64,
    pub clamp: [f64; 2],
    pub mass_per_length: f64,
    pub first_tendon: usize,
    /// Bending, bending, torsion over the length of an element, N m.
    pub stiffness: [f64; 3],
    /// 1 / EA where the theory has extension.
    axial_compliance: f64,
    /// `D = d1 I + d2 t t' + d3 s s' + d4 |s|^2 I` with mean tangent `t`, change of tangent `s`.
    d: [f64; 4],
    continuous: bool,
}

impl Constants {
    pub fn new(robot: &Robot, k: usize, model: Model, elements: usize) -> Self {
        let m = robot.modules[k];
        let s = robot.section(k);
        let h = m.flexible / elements as f64;
        let (shear, axial) = match model.theory {
            Theory::Cosserat => (1.0 / s.shear, 1.0 / s.axial),
            Theory::Kirchhoff => (0.0, 0.0),
        };
        let torsion = s.torsion * if model.twist { 1.0 } else { 1e6 };
        // the quadratic strain that a force leaves in an element of length h gives way by
        // h^3 |s_e x N|^2 / (1440 EI); an element turns the tangent by s / elements
        let bubble = h.powi(3) / (720.0 * s.bending * elements as f64);
        let length = m.flexible;
        Constants {
            flexible: m.flexible,
            clamp: m.clamp,
            mass_per_length: s.mass_per_length,
            first_tendon: m.first_tendon,
            stiffness: [s.bending / h, s.bending / h, torsion / h],
            axial_compliance: axial,
            d: [
                length * shear,
                length * (axial - shear),
                length * (axial - shear) / 12.0 - bubble,
                bubble,
            ],
            continuous: model.tendon == TendonPath::Continuous,
        }
    }
}

/// Dead loads on a module in the base frame: see the potential above.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeadLoad<T> {
    pub f: [Vec3<T>; 3],
}

/// State of a module at its present strain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<T, const A: usize> {
    /// Rotation vectors of the arcs: the unknown.
    pub w: [Vec3<T>; A],
    /// Pose of the start disk in the base frame.
    pub rotation: Mat3<T>,
    pub position: Vec3<T>,
    pub arcs: [ArcMap<T>; A],
    /// Rotation from the module's start to the start of each arc.
    pub prefix: [Mat3<T>; A],
    /// From the end of each arc to the end of the module.
    tail: [Vec3<T>; A],
    /// Relative rotation and end of the flexible part, without and with compliance.
    pub s: Mat3<T>,
    pub rho0: Vec3<T>,
    pub rho: Vec3<T>,
    /// Contact force.
    pub n: Vec3<T>,
    /// Dead loads in the start frame.
    pub f: [Vec3<T>; 3],
    /// Moment of the spans about the end of the flexible part.
    pub span_torque: Vec3<T>,
    pub energy: T,
}

/// First derivatives at the present strain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gradient<T, const A: usize> {
    /// Rotation of the end by each arc's strain.
    pub h: [Mat3<T>; A],
    /// Motion of `rho0` by each arc's strain.
    pub r: [Mat3<T>; A],
    /// Moment at the end that works on `h`, costate included, and force that works on `r`.
    pub torque: Vec3<T>,
    pub nu: Vec3<T>,
    /// Costate: moment from all beyond the end disk.
    pub lambda: Vec3<T>,
    /// Moment imbalance of each arc.
    pub g: [Vec3<T>; A],
}

/// Second derivatives in strain `u` and start rotation `x`, the modules beyond left out.
pub(crate) struct Hessian<T, const A: usize> {
    /// Lower blocks only.
    pub uu: [[Mat3<T>; A]; A],
    pub xu: [Mat3<T>; A],
    pub xx: Mat3<T>,
    pub response: Response<T, A>,
}

/// How the end of a module answers: `d rho = m (j du + dj) + d_hat (df - k' h du)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Response<T, const A: usize> {
    /// Motion of the end by each arc's strain at constant contact force.
    pub j: [Mat3<T>; A],
    pub m: Mat3<T>,
    pub d_hat: Mat3<T>,
    /// Stiffness of the spans between rotation (rows) and translation (columns).
    pub k: Mat3<T>,
}

impl<T: Real, const A: usize> Gradient<T, A> {
    pub fn empty() -> Self {
        let (zero, matrix) = (Vec3::zero(), Mat3::zero());
        Gradient {
            h: [matrix; A],
            r: [matrix; A],
            torque: zero,
            nu: zero,
            lambda: zero,
            g: [zero; A],
        }
    }
}

impl<T: Real, const A: usize> State<T, A> {
    pub fn straight() -> Self {
        let zero = Vec3::zero();
        State {
            w: [zero; A],
            rotation: Mat3::identity(),
            position: zero,
            arcs: [ArcMap::new(zero, T::zero()); A],
            prefix: [Mat3::identity(); A],
            tail: [zero; A],
            s: Mat3::identity(),
            rho0: zero,
            rho: zero,
            n: zero,
            f: [zero; 3],
            span_torque: zero,
            energy: T::zero(),
        }
    }

    /// Forward: geometry, contact force and energy from the strain and the start pose.
    #[inline(always)]
    pub fn evaluate(
        &mut self,
        c: &Constants,
        load: &DeadLoad<T>,
        tendons: &[Tendon],
        tensions: &[T],
    ) {
        let active = c.first_tendon..tendons.len();
        let (tendons, tensions) = (&tendons[active.clone()], &tensions[active]);
        let half = T::splat(0.5);
        let stretch = self.stretch(c, tensions);
        let arc_length = T::splat(c.flexible / A as f64) * stretch;
        let mut elastic = T::zero();
        (self.s, self.rho0) = (Mat3::identity(), Vec3::zero());
        for i in 0..A {
            let arc = ArcMap::new(self.w[i], arc_length);
            self.prefix[i] = self.s;
            self.rho0 += self.s * arc.end;
            self.tail[i] = self.rho0;
            self.s = self.s * arc.rotation;
            self.arcs[i] = arc;
        }
        for i in 0..A {
            self.tail[i] = self.rho0 - self.tail[i];
        }
        for i in (0..A).step_by(2) {
            let (a, b) = (self.w[i], self.w[i + 1]);
            let sum = scaled(a + b, c.stiffness).dot(a + b);
            let difference = scaled(a - b, c.stiffness).dot(a - b);
            elastic += half * sum + T::splat(0.375) * difference;
        }
        for i in 0..3 {
            self.f[i] = self.rotation.tr_mul(load.f[i]);
        }
        let t = self.s.column(2);
        let compliance = self.compliance(c);
        let mut cable = T::zero();
        self.span_torque = Vec3::zero();
        if c.continuous {
            self.n = self.f[0];
            self.rho = self.rho0 + compliance * self.n;
            for i in (0..A).step_by(2) {
                for (tendon, &tension) in tendons.iter().zip(tensions) {
                    let path = ParallelPath::new(c, A, tendon, stretch, self.w[i], self.w[i + 1]);
                    cable += tension * path.length;
                }
            }
        } else {
            // rho and N together; the compliance is small, so this settles at once
            self.rho = self.rho0 + compliance * self.n;
            for round in 0..MAX_ROUNDS {
                let mut g = Mat3::zero();
                let mut pull = Vec3::zero();
                cable = T::zero();
                self.span_torque = Vec3::zero();
                for (tendon, &tension) in tendons.iter().zip(tensions) {
                    let span = Span::new(c, tendon, &self.s, self.rho);
                    let m = span.direction * tension;
                    pull += m;
                    cable += tension * span.length;
                    self.span_torque += span.arm.cross(m);
                    g += span.stiffness(tension);
                }
                self.n = self.f[0] - pull;
                let miss = self.rho0 + compliance * self.n - self.rho;
                let size = miss.max_abs().largest();
                // a NaN passes on to the energy, where it is seen
                if !(size > 1e-15 * c.flexible) || round + 1 == MAX_ROUNDS {
                    break;
                }
                self.rho += (Mat3::identity() + compliance * g).inverse() * miss;
            }
        }
        self.energy = elastic + half * self.n.dot(self.rho - self.rho0) + cable
            - self.f[0].dot(self.rho)
            - self.f[1].dot(t)
            - self.f[2][2];
    }

    /// A point of the backbone at a fraction of the way to the end disk, in the start frame.
    pub fn point(&self, c: &Constants, fraction: f64) -> Vec3<T> {
        let [start, end] = c.clamp;
        let along = fraction * (start + c.flexible + end) - start;
        let at = along / c.flexible * A as f64;
        if at <= 0.0 {
            return Vec3::splat([0.0, 0.0, along + start]);
        }
        let clamped = Vec3::splat([0.0, 0.0, start]);
        let yielded = (self.rho - self.rho0) * T::splat((at / A as f64).min(1.0));
        if at >= A as f64 {
            let beyond = T::splat(along - c.flexible);
            return clamped + self.rho + self.s.column(2) * beyond;
        }
        let i = at as usize;
        let part = T::splat(at - i as f64);
        let arc = ArcMap::new(self.w[i] * part, self.arcs[i].length() * part);
        let mut from = Vec3::zero();
        for j in 0..i {
            from += self.prefix[j] * self.arcs[j].end;
        }
        clamped + from + self.prefix[i] * arc.end + yielded
    }

    /// Pose of the end disk in the base frame.
    #[inline(always)]
    pub fn end_pose(&self, c: &Constants) -> (Mat3<T>, Vec3<T>) {
        (
            self.rotation * self.s,
            self.position + self.rotation * self.offset(c),
        )
    }

    /// From the start disk to the end disk.
    #[inline(always)]
    fn offset(&self, c: &Constants) -> Vec3<T> {
        let [start, end] = c.clamp.map(T::splat);
        let mut offset = self.rho + self.s.column(2) * end;
        offset.0[2] += start;
        offset
    }

    /// Extension of the backbone by tendons that run along it.
    #[inline(always)]
    pub fn stretch(&self, c: &Constants, tensions: &[T]) -> T {
        let one = T::splat(1.0);
        if !c.continuous {
            return one;
        }
        let mut sum = T::zero();
        for &t in tensions {
            sum += t;
        }
        one - sum * T::splat(c.axial_compliance)
    }

    #[inline(always)]
    fn tangents(&self, c: &Constants) -> (Vec3<T>, Vec3<T>) {
        let mean = self.rho0 * T::splat(1.0 / c.flexible);
        (mean, self.s.column(2) - Vec3::ez())
    }

    #[inline(always)]
    fn compliance(&self, c: &Constants) -> Mat3<T> {
        let (mean, change) = self.tangents(c);
        let d = c.d.map(T::splat);
        Mat3::scalar(d[0] + d[3] * change.norm2())
            + (mean * d[1]).outer(mean)
            + (change * d[2]).outer(change)
    }

    /// Backward: moment imbalance, and the costate handed on to the module before.
    ///
    /// `lambda` is the costate in the frame of the end disk; returns it in that of the start.
    #[inline(always)]
    pub fn gradient(
        &self,
        c: &Constants,
        tendons: &[Tendon],
        tensions: &[T],
        lambda: Vec3<T>,
        out: &mut Gradient<T, A>,
    ) -> Vec3<T> {
        let t = self.s.column(2);
        let (mean, change) = self.tangents(c);
        let n = self.n;
        let d = c.d.map(T::splat);
        let nu = n + n * (d[1] * mean.dot(n) * T::splat(1.0 / c.flexible));
        let mu = n * (d[2] * change.dot(n)) + change * (d[3] * n.norm2());
        out.lambda = self.s * lambda;
        out.torque = self.span_torque - t.cross(self.f[1] + mu) + out.lambda;
        out.nu = nu;
        for i in 0..A {
            out.h[i] = self.prefix[i] * self.arcs[i].left_jacobian();
            out.r[i] =
                self.prefix[i] * self.arcs[i].end_jacobian() - self.tail[i].skew() * out.h[i];
            out.g[i] = out.h[i].tr_mul(out.torque) - out.r[i].tr_mul(nu);
        }
        for i in (0..A).step_by(2) {
            let (sum, difference) = (
                self.w[i] + self.w[i + 1],
                (self.w[i] - self.w[i + 1]) * T::splat(0.75),
            );
            out.g[i] += scaled(sum + difference, c.stiffness);
            out.g[i + 1] += scaled(sum - difference, c.stiffness);
            if c.continuous {
                let stretch = self.stretch(c, &tensions[c.first_tendon..]);
                for k in c.first_tendon..tendons.len() {
                    let path =
                        ParallelPath::new(c, A, &tendons[k], stretch, self.w[i], self.w[i + 1]);
                    for (j, g) in path.gradient().into_iter().enumerate() {
                        out.g[i + j] += g * tensions[k];
                    }
                }
            }
        }
        out.lambda - self.rho.cross(self.f[0]) - t.cross(self.f[1]) - Vec3::ez().cross(self.f[2])
    }

    /// Second derivatives at constant costate.
    #[inline(always)]
    pub fn hessian(
        &self,
        c: &Constants,
        tendons: &[Tendon],
        tensions: &[T],
        grad: &Gradient<T, A>,
    ) -> Hessian<T, A> {
        let half = T::splat(0.5);
        let t = self.s.column(2);
        let (mean, change) = self.tangents(c);
        let d = c.d.map(T::splat);
        let n = self.n;
        let (mean_n, change_n, n2) = (mean.dot(n), change.dot(n), n.norm2());
        let mu = n * (d[2] * change_n) + change * (d[3] * n2);

        // stiffness of the spans: translation g, rotation e, and between them k
        let (mut g, mut k, mut e) = (Mat3::zero(), Mat3::zero(), Mat3::zero());
        if !c.continuous {
            for i in c.first_tendon..tendons.len() {
                let span = Span::new(c, &tendons[i], &self.s, self.rho);
                let (arm, direction) = (span.arm, span.direction);
                let tension = tensions[i];
                let stiffness = tension / span.length;
                let across = arm.cross(direction);
                g += span.stiffness(tension);
                k += (arm.skew() - across.outer(direction)) * stiffness;
                let m = direction * tension;
                e += (arm * (-stiffness)).outer(arm) - (across * stiffness).outer(across)
                    + (m.outer(arm)).symmetric_part()
                    + Mat3::scalar(stiffness * arm.norm2() - m.dot(arm));
            }
        }
        // dead loads and compliance act on the end tangent
        let f2 = self.f[1] + mu;
        e += Mat3::scalar(f2.dot(t)) - f2.outer(t).symmetric_part();
        let turn = n.cross(t);
        e -= (turn * d[2]).outer(turn);
        e -= (Mat3::scalar(t.norm2()) - t.outer(t)) * (d[3] * n2);

        let compliance = self.compliance(c);
        let m = (Mat3::identity() + compliance * g).inverse();
        let d_hat = (m * compliance).symmetric_part();
        let g_hat = (g * m).symmetric_part();
        let h_inv = T::splat(1.0 / c.flexible);
        let x =
            Mat3::scalar(T::splat(1.0) + d[1] * mean_n * h_inv) + (mean * (d[1] * h_inv)).outer(n);
        // motion of the end by its tangent: s (s.N) d3 + |s|^2 N d4, s turned by -[t]
        let y = -((Mat3::scalar(d[2] * change_n)
            + (change * d[2]).outer(n)
            + (n * (T::splat(2.0) * d[3])).outer(change))
            * t.skew());
        let mut j = [Mat3::zero(); A];
        for i in 0..A {
            j[i] = x * grad.r[i] + y * grad.h[i];
        }
        let km = k * m;
        let core = e - k * d_hat * k.transpose();

        let mut uu = [[Mat3::zero(); A]; A];
        let mut xu = [Mat3::zero(); A];
        let f1 = self.f[0].skew();
        let lambda = (grad.lambda * half).skew();
        let on_h = -(self.f[1].skew() * t.skew()) - lambda - f1 * d_hat * k.transpose();
        let on_j = f1 * m;
        let rank1 = d[1] * h_inv * h_inv;
        let nu = -grad.nu;
        let nu_skew = nu.skew();
        let torque_skew = (grad.torque * half).skew();
        for i in 0..A {
            let (hi, ji) = (grad.h[i], j[i]);
            let along_h = core * hi + km * ji;
            let along_j = g_hat * ji + km.tr_mat(hi);
            let rn = grad.r[i].tr_mul(n);
            for b in i..A {
                let mut block = grad.h[b].tr_mat(along_h) + j[b].tr_mat(along_j);
                block -= (grad.r[b].tr_mul(n) * rank1).outer(rn);
                if b > i {
                    // rows of the later arc: transpose of -h_i' ([nu] r_b + [lambda] h_b)
                    block +=
                        (nu_skew * grad.r[b] + torque_skew * grad.h[b]).tr_mat(hi) * T::splat(-1.0);
                } else {
                    let y = self.tail[i];
                    let p = self.prefix[i];
                    block +=
                        self.arcs[i].hessian(p.tr_mul(nu), p.tr_mul(grad.torque + y.cross(nu)));
                    let tail = nu.outer(y).symmetric_part() - Mat3::scalar(nu.dot(y));
                    block += hi.tr_mat(tail * hi);
                }
                uu[b][i] = block;
            }
            xu[i] = on_h * hi + on_j * ji;
        }
        for i in (0..A).step_by(2) {
            for q in 0..3 {
                let s = c.stiffness[q];
                uu[i][i].0[q][q] += T::splat(1.75 * s);
                uu[i + 1][i + 1].0[q][q] += T::splat(1.75 * s);
                uu[i + 1][i].0[q][q] += T::splat(0.25 * s);
            }
            if c.continuous {
                let stretch = self.stretch(c, &tensions[c.first_tendon..]);
                for k in c.first_tendon..tendons.len() {
                    let path =
                        ParallelPath::new(c, A, &tendons[k], stretch, self.w[i], self.w[i + 1]);
                    let [aa, ba, bb] = path.hessian();
                    uu[i][i] += aa * tensions[k];
                    uu[i + 1][i] += ba * tensions[k];
                    uu[i + 1][i + 1] += bb * tensions[k];
                }
            }
        }
        let mut xx = f1 * d_hat * f1;
        for (f, v) in self.f.iter().zip([self.rho, t, Vec3::ez()]) {
            xx += Mat3::scalar(f.dot(v)) - f.outer(v).symmetric_part();
        }
        Hessian {
            uu,
            xu,
            xx,
            response: Response { j, m, d_hat, k },
        }
    }
}

/// Rounds for `rho` and `N`; two are usual.
const MAX_ROUNDS: usize = 12;

#[inline(always)]
fn scaled<T: Real>(v: Vec3<T>, s: [f64; 3]) -> Vec3<T> {
    Vec3([
        v[0] * T::splat(s[0]),
        v[1] * T::splat(s[1]),
        v[2] * T::splat(s[2]),
    ])
}

/// A straight piece of tendon between two neighbouring holes.
pub(crate) struct Span<T> {
    /// From the end of the flexible backbone to the end hole.
    pub arm: Vec3<T>,
    pub length: T,
    pub direction: Vec3<T>,
}

impl<T: Real> Span<T> {
    #[inline(always)]
    pub fn new(c: &Constants, tendon: &Tendon, s: &Mat3<T>, rho: Vec3<T>) -> Self {
        let [x, y] = tendon.hole.map(T::splat);
        let [start, end] = c.clamp.map(T::splat);
        let arm = s.column(0) * x + s.column(1) * y + s.column(2) * end;
        let v = rho + arm - Vec3([x, y, -start]);
        let length = v.norm();
        Span {
            arm,
            length,
            direction: v * (T::splat(1.0) / length),
        }
    }

    /// Geometric stiffness: `T / length (I - d d')`.
    #[inline(always)]
    fn stiffness(&self, tension: T) -> Mat3<T> {
        let s = tension / self.length;
        Mat3::scalar(s) - (self.direction * s).outer(self.direction)
    }
}

/// A tendon along a curve parallel to one element, by two Gauss points.
pub(crate) struct ParallelPath<T> {
    pub length: T,
    hole: Vec3<T>,
    /// Unit tangent and speed at each Gauss point.
    points: [(Vec3<T>, T); 2],
    /// Length that a point stands for.
    weight: f64,
    /// Derivative of a Gauss point's curvature by the nearer and the farther arc.
    near: f64,
    far: f64,
}

impl<T: Real> ParallelPath<T> {
    #[inline(always)]
    pub fn new(
        c: &Constants,
        arcs: usize,
        tendon: &Tendon,
        stretch: T,
        a: Vec3<T>,
        b: Vec3<T>,
    ) -> Self {
        let h = c.flexible * 2.0 / arcs as f64;
        let slope = 3f64.sqrt() / 2.0;
        let (near, far) = ((1.0 + slope) / h, (1.0 - slope) / h);
        let hole = Vec3::splat([tendon.hole[0], tendon.hole[1], 0.0]);
        let mut length = T::zero();
        let points = [(a, b), (b, a)].map(|(first, other)| {
            let curvature = first * T::splat(near) + other * T::splat(far);
            let mut q = curvature.cross(hole);
            q.0[2] += stretch;
            let speed = q.norm();
            length += speed * T::splat(h / 2.0);
            (q * (T::splat(1.0) / speed), speed)
        });
        ParallelPath {
            length,
            hole,
            points,
            weight: h / 2.0,
            near,
            far,
        }
    }

    /// By the rotation vectors of the two arcs.
    #[inline(always)]
    fn gradient(&self) -> [Vec3<T>; 2] {
        let [p, q] = self.points.map(|(d, _)| self.hole.cross(d));
        let (near, far) = (
            T::splat(self.near * self.weight),
            T::splat(self.far * self.weight),
        );
        [p * near + q * far, p * far + q * near]
    }

    /// Blocks: first-first, second-first, second-second.
    #[inline(always)]
    fn hessian(&self) -> [Mat3<T>; 3] {
        let b = self.hole;
        let [p, q] = self.points.map(|(d, speed)| {
            let across = b.cross(d);
            (Mat3::scalar(b.norm2()) - b.outer(b) - across.outer(across))
                * (T::splat(self.weight) / speed)
        });
        let (n, f) = (self.near, self.far);
        let [nn, nf, ff] = [n * n, n * f, f * f].map(T::splat);
        [p * nn + q * ff, (p + q) * nf, p * ff + q * nn]
    }
}
