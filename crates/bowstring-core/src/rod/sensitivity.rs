//! Derivatives of an equilibrium: tip and tendon lengths with respect to tensions, tip wrench and
//! stiffness.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination).
//!
//! The elimination of the Newton step is applied to further right-hand sides: a parameter changes
//! the force on a module's end, the position of its end, and the moments on its arcs.

use crate::interrupt;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Scalar;
use crate::model::load::TendonPath;
use crate::rod::chain::Rod;
use crate::rod::module::{Response, Span};

/// Derivatives with respect to one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivative {
    /// Tip position (m).
    pub position: Vec3,
    /// Tip rotation as a rotation vector in the base frame (rad).
    pub rotation: Vec3,
    /// Tendon lengths from the base hole to the end disk's hole (m).
    pub lengths: Vec<f64>,
}

/// Derivatives of an equilibrium with respect to its load and stiffness, each per unit of the
/// parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Jacobians {
    /// With respect to each tension (1/N).
    pub tensions: Vec<Derivative>,
    /// With respect to the tip force along x, y and z of the base frame (1/N).
    pub tip_force: Vec<Derivative>,
    /// With respect to the tip moment about x, y and z of the base frame (1/(N m)).
    pub tip_moment: Vec<Derivative>,
    /// With respect to the relative change of all stiffnesses of each segment's backbone (d/d ln
    /// E).
    pub stiffness: Vec<Derivative>,
}

enum Parameter {
    Tension(usize),
    Force(usize),
    Moment(usize),
    Stiffness(usize),
}

/// Partial derivatives of a module with respect to a parameter, at fixed strain.
struct Source<const A: usize> {
    /// Contact force.
    force: Vec3,
    /// Position of the end.
    place: Vec3,
    /// Moment imbalance of each arc.
    moment: [Vec3; A],
    /// Moment imbalance of the start.
    start: Vec3,
}

/// Derivatives at the equilibrium held and evaluated by the rod; `None` for continuous tendons and
/// where they are not finite.
pub(crate) fn jacobians<const A: usize>(
    rod: &mut Rod<Scalar, A>,
    segments: &[usize],
) -> Option<Jacobians> {
    if rod.path == TendonPath::Continuous {
        return None;
    }
    rod.gradient();
    rod.linearise();
    let responses = rod.newton.responses.clone();
    let jacobians = if rod.has_potential() {
        rod.eliminate::<true>(0.0);
        all::<A, true>(rod, &responses, segments)
    } else {
        rod.eliminate::<false>(0.0);
        all::<A, false>(rod, &responses, segments)
    };
    jacobians.is_finite().then_some(jacobians)
}

impl Jacobians {
    fn is_finite(&self) -> bool {
        [
            &self.tensions,
            &self.tip_force,
            &self.tip_moment,
            &self.stiffness,
        ]
        .into_iter()
        .flatten()
        .all(|d| {
            let numbers = d.position.0.iter().chain(&d.rotation.0).chain(&d.lengths);
            numbers.copied().all(f64::is_finite)
        })
    }
}

fn all<const A: usize, const SYMMETRIC: bool>(
    rod: &Rod<Scalar, A>,
    responses: &[Response<f64, A>],
    segments: &[usize],
) -> Jacobians {
    let by = |p: Parameter| derivative::<A, SYMMETRIC>(rod, responses, segments, &p);
    let count = segments[segments.len() - 1] + 1;
    Jacobians {
        tensions: (0..rod.placed.lengths.len())
            .map(|i| by(Parameter::Tension(i)))
            .collect(),
        tip_force: (0..3).map(|i| by(Parameter::Force(i))).collect(),
        tip_moment: (0..3).map(|i| by(Parameter::Moment(i))).collect(),
        stiffness: (0..count).map(|i| by(Parameter::Stiffness(i))).collect(),
    }
}

fn unit(i: usize) -> Vec3 {
    let mut v = Vec3::zero();
    v[i] = 1.0;
    v
}

fn source<const A: usize>(
    rod: &Rod<Scalar, A>,
    response: &Response<f64, A>,
    segments: &[usize],
    k: usize,
    parameter: &Parameter,
) -> Source<A> {
    let (state, c, gradient) = (&rod.states[k], &rod.constants[k], &rod.gradients[k]);
    let tangent = state.s.column(2);
    let zero = Vec3::zero();
    let mut source = Source {
        force: zero,
        place: zero,
        moment: [zero; A],
        start: zero,
    };
    match *parameter {
        Parameter::Tension(i) if k <= rod.tendons.end_disks[i] => {
            let span = Span::new(c, &rod.tendons.in_group(k)[i], &state.s, state.rho);
            source.force = -span.direction;
            source.moment = [span.arm.cross(span.direction); A];
        }
        Parameter::Force(i) => {
            let f = rod.rotations[k].tr_mul(unit(i));
            source.force = f;
            source.moment = [-tangent.cross(f) * c.clamp[1]; A];
            source.start = -state.offset(c).cross(f);
        }
        Parameter::Stiffness(segment) if segments[k] == segment => {
            let (on_end, on_tangent) = state.compliance_forces(c);
            let elastic = c.elastic_moments(&state.w);
            for i in 0..A {
                source.moment[i] = gradient.to_strain[i].tr_mul(elastic[i])
                    + tangent.cross(on_tangent)
                    + gradient.r[i].tr_mul(on_end);
            }
            if let Some(coupling) = c.coupling() {
                let torques = state.sway_torques(c, coupling);
                for (moment, torque) in source.moment.iter_mut().zip(torques) {
                    *moment -= torque;
                }
            }
            source.place = -(state.compliance(c) * state.n);
        }
        _ => {}
    }
    // effect of force and position on arcs and start, through the response of the end
    let Response {
        j,
        m,
        d_hat,
        g_hat,
        k: coupling,
    } = response;
    let (force, place) = (source.force, source.place);
    for i in 0..A {
        source.moment[i] += *coupling * (*d_hat * force + *m * place)
            + j[i].tr_mul(*g_hat * place - m.tr_mul(force));
    }
    source.start += state
        .stretching_load(c, rod.on_nodes(k))
        .cross(*d_hat * force + *m * place);
    source
}

fn derivative<const A: usize, const SYMMETRIC: bool>(
    rod: &Rod<Scalar, A>,
    responses: &[Response<f64, A>],
    segments: &[usize],
    parameter: &Parameter,
) -> Derivative {
    let n = rod.module_count();
    if interrupt::work(n * (16 + 2 * rod.placed.lengths.len())) {
        return Derivative {
            position: Vec3::splat([f64::NAN; 3]),
            rotation: Vec3::zero(),
            lengths: vec![],
        };
    }
    let sources: Vec<_> = (0..n)
        .map(|k| source(rod, &responses[k], segments, k, parameter))
        .collect();
    let mut p = match *parameter {
        Parameter::Moment(i) => -rod.rotations[n].tr_mul(unit(i)),
        _ => Vec3::zero(),
    };
    let mut solutions = vec![[Vec3::zero(); A]; n];
    // change of the force beyond each module by followers, where its disks do not turn further
    let mut followers = vec![Vec3::zero(); n];
    let mut beyond = Vec3::zero();
    for k in (0..n).rev() {
        let at_start = rod.states[k].s * p;
        let mut start = [at_start];
        solutions[k] = sources[k].moment.map(|m| m + at_start);
        let follower = rod.attached.coupling(k);
        if let Some(coupling) = follower {
            beyond = rod.states[k].s * beyond;
            followers[k] = beyond;
            coupling.add_force(beyond, &mut solutions[k], &mut start[0]);
        }
        rod.newton.eliminated[k].backward::<SYMMETRIC>(&mut solutions[k], &mut start);
        if let Some(coupling) = follower {
            beyond = coupling.force_beyond(beyond, &solutions[k]);
            if rod.attached.has_between() {
                let between = &rod.attached.between;
                beyond -= between.force_by_arcs(k, |m| *m, &solutions[k]);
            }
        }
        p = start[0] + sources[k].start;
    }
    let mut x = Vec3::zero();
    let mut position = Vec3::zero();
    let mut lengths = vec![0.0; rod.placed.lengths.len()];
    for k in 0..n {
        let (state, c, response) = (&rod.states[k], &rod.constants[k], &responses[k]);
        let u = rod.newton.eliminated[k].forward(&solutions[k], &[x]);
        let mut turn = Vec3::zero();
        let mut moved = sources[k].place;
        for i in 0..A {
            turn += u[i];
            moved += response.j[i] * u[i];
        }
        let mut force = sources[k].force + state.stretching_load(c, rod.on_nodes(k)).cross(x)
            - response.k.tr_mul(turn);
        if let Some(coupling) = rod.attached.coupling(k) {
            force += followers[k] + coupling.by_turn(x + turn);
            if rod.attached.has_between() {
                force += rod.attached.between.stretching_by_turns(k, c, x, &u);
            }
        }
        let rho = response.m * moved + response.d_hat * force;
        let offset = x.cross(state.offset(c)) + rho + turn.cross(state.s.column(2)) * c.clamp[1];
        position += rod.rotations[k] * offset;
        for (i, length) in lengths.iter_mut().enumerate() {
            if k <= rod.tendons.end_disks[i] {
                let span = Span::new(c, &rod.tendons.in_group(k)[i], &state.s, state.rho);
                *length += span.direction.dot(rho + turn.cross(span.arm));
            }
        }
        x = state.s.tr_mul(x + turn);
    }
    let tip: Mat3 = rod.rotations[n];
    Derivative {
        position,
        rotation: tip * x,
        lengths,
    }
}
