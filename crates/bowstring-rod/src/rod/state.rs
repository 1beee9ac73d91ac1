//! State of a module and its derivatives: what the passes of `rod::module` compute.
//!
//! Theory: docs/theory/rod.md (Kinematics, Energy) and docs/theory/statics.md (Consistent tangent).

use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;

/// An arc of constant curvature in its module.
#[derive(Clone, Copy, Debug)]
pub struct Arc<T> {
    pub map: ArcMap<T>,
    /// Rotation from the module's start to the start of the arc.
    pub prefix: Mat3<T>,
}

/// State of a module at its present strain.
#[derive(Clone, Copy, Debug)]
pub struct State<T, const A: usize> {
    /// Rotation vectors of the arcs (rad): the unknowns.
    pub w: [Vec3<T>; A],
    pub arcs: [Arc<T>; A],
    /// Vector from the end of each arc to the end of the flexible part, without compliance (m).
    pub tail: [Vec3<T>; A],
    /// Rotation S from the start to the end of the flexible part.
    pub s: Mat3<T>,
    /// Position of the end of the flexible part, without compliance (m).
    pub rho0: Vec3<T>,
    /// Position of the end of the flexible part (m).
    pub rho: Vec3<T>,
    /// Contact force, mean over the module (N).
    pub n: Vec3<T>,
    /// Force of tendons and loads on the end (N).
    pub end_force: Vec3<T>,
    /// Dead loads: force on the end (N), moments on the end's tangent and on the start's tangent (N
    /// m), and the mean weight of an element (N), which acts on every node between two elements.
    pub f: [Vec3<T>; 4],
    /// Moment of the spans about the end of the flexible part (N m).
    pub span_torque: Vec3<T>,
    /// Moment of the dead loads about the start (N m).
    pub load_moment: Vec3<T>,
    /// Costate at the end disk: moment of the distal part (N m), with the opposite sign of
    /// theory Eq. 3.2.
    pub lambda: Vec3<T>,
    /// Residual of `rho = rho0 + D N` (m).
    pub miss: T,
    /// Potential energy, without dead moments (J).
    pub energy: T,
}

impl<T: Real, const A: usize> State<T, A> {
    #[inline(always)]
    pub fn straight() -> Self {
        let zero = Vec3::zero();
        State {
            w: [zero; A],
            arcs: [Arc {
                map: ArcMap::new(zero, T::zero()),
                prefix: Mat3::identity(),
            }; A],
            tail: [zero; A],
            s: Mat3::identity(),
            rho0: zero,
            rho: zero,
            n: zero,
            end_force: zero,
            f: [zero; 4],
            span_torque: zero,
            load_moment: zero,
            lambda: zero,
            miss: T::zero(),
            energy: T::zero(),
        }
    }
}

/// First derivatives at the present strain.
#[derive(Clone, Copy, Debug)]
pub struct Gradient<T, const A: usize> {
    /// Derivative of each arc's rotation vector with respect to the rotation that it adds.
    pub to_strain: [Mat3<T>; A],
    /// Derivative of `rho0` with respect to the rotation added by each arc (m).
    pub r: [Mat3<T>; A],
    /// Moment at the end, costate included (N m).
    pub torque: Vec3<T>,
    /// Force on `rho0` (N).
    pub nu: Vec3<T>,
    /// Moment imbalance of each arc (N m).
    pub g: [Vec3<T>; A],
}

impl<T: Real, const A: usize> Gradient<T, A> {
    pub fn empty() -> Self {
        let (zero, matrix) = (Vec3::zero(), Mat3::zero());
        Gradient {
            to_strain: [matrix; A],
            r: [matrix; A],
            torque: zero,
            nu: zero,
            g: [zero; A],
        }
    }

    /// Keeps the imbalance, but removes its contribution to the tangent.
    pub fn drop_forces(&mut self) {
        self.torque = Vec3::zero();
        self.nu = Vec3::zero();
    }
}

/// Second derivatives with respect to arc rotations `u` and start rotation `x`, at constant
/// costate.
#[derive(Clone, Copy, Debug)]
pub struct Hessian<T, const A: usize> {
    /// Lower blocks only.
    pub uu: [[Mat3<T>; A]; A],
    pub xu: [Mat3<T>; A],
    pub xx: Mat3<T>,
}

impl<T: Real, const A: usize> Hessian<T, A> {
    pub fn empty() -> Self {
        let zero = Mat3::zero();
        Hessian {
            uu: [[zero; A]; A],
            xu: [zero; A],
            xx: zero,
        }
    }
}

/// Response of a module's end: `d rho = m (sum j u + dj) + d_hat (df - k' sum u)`.
#[derive(Clone, Copy, Debug)]
pub struct Response<T, const A: usize> {
    /// Derivative of the end's position with respect to the rotation added by each arc, at constant
    /// contact force.
    pub j: [Mat3<T>; A],
    pub m: Mat3<T>,
    pub d_hat: Mat3<T>,
    /// Stiffness of the spans in series with the compliance.
    pub g_hat: Mat3<T>,
    /// Stiffness of the spans, coupling rotation (rows) and translation (columns).
    pub k: Mat3<T>,
}

impl<T: Real, const A: usize> Response<T, A> {
    pub fn empty() -> Self {
        let matrix = Mat3::zero();
        Response {
            j: [matrix; A],
            m: matrix,
            d_hat: matrix,
            g_hat: matrix,
            k: matrix,
        }
    }
}
