//! Derivatives of an equilibrium: tip and tendon lengths with respect to tensions, tip wrench,
//! stiffness and gravity.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination).
//!
//! The elimination of the Newton step is applied to further right-hand sides: a parameter changes
//! the force on a module's end, the position of its end, and the moments on its arcs.
#![warn(missing_docs)]

use crate::interrupt;
use crate::math::copies;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Scalar;
use crate::rod::chain::Rod;
use crate::rod::routes::in_group;
use crate::rod::span::Span;
use crate::rod::state::Response;

/// Derivatives with respect to one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivative {
    /// Tip position (m).
    pub position: Vec3,
    /// Tip rotation as a rotation vector in the base frame (rad).
    pub rotation: Vec3,
    /// Tendon lengths from the base hole to the end disk's hole (m).
    pub lengths: Vec<f64>,
    /// Bend of the backbone from the base to the end disk of each tendon (rad).
    pub bends: Vec<f64>,
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
    /// With respect to gravity along x, y and z of the base frame (s^2/m); empty unless requested.
    pub gravity: Vec<Derivative>,
}

enum Parameter<'a> {
    Tension(usize),
    /// Tensions in proportion to these (N).
    Tensions(&'a [f64]),
    Force(usize),
    Moment(usize),
    Stiffness(usize),
    /// Gravity along an axis of the base frame, with its loads on the modules.
    Gravity(usize, &'a [[Vec3; 4]]),
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

/// Derivatives at the equilibrium held and evaluated by the rod, those with respect to gravity if
/// requested; `None` for continuous tendons and where they are not finite.
pub fn jacobians<const A: usize>(
    rod: &mut Rod<Scalar, A>,
    segments: &[usize],
    gravity: bool,
) -> Option<Jacobians> {
    if rod.path.is_continuous() {
        return None;
    }
    rod.gradient();
    rod.linearise();
    let jacobians = if rod.has_potential() {
        rod.eliminate::<true>(0.0);
        all::<A, true>(rod, segments, gravity)
    } else {
        rod.eliminate::<false>(0.0);
        all::<A, false>(rod, segments, gravity)
    };
    jacobians.is_finite().then_some(jacobians)
}

/// Derivatives of the tip's position (m/N) and, if wanted, rotation (rad/N) with respect to each
/// tension, at the equilibrium held and evaluated by the rod; false for continuous tendons and where
/// they are not finite.
///
/// With a potential, the tip moves by a unit tension as the tendon shortens by a unit force or moment
/// on the tip (Maxwell-Betti): with many tendons this takes fewer right-hand sides.
pub fn tip_by_tensions<const A: usize>(
    rod: &mut Rod<Scalar, A>,
    rotation: bool,
    columns: &mut [[Vec3; 2]],
) -> bool {
    if rod.path.is_continuous() {
        return false;
    }
    rod.gradient();
    rod.linearise();
    let symmetric = rod.has_potential();
    if symmetric {
        rod.eliminate::<true>(0.0);
    } else {
        rod.eliminate::<false>(0.0);
    }
    let wrenches = if rotation { 6 } else { 3 };
    if symmetric && columns.len() > wrenches {
        let mut scratch = Scratch::with_spans(rod);
        let mut lengths = vec![0.0; columns.len()];
        for i in 0..wrenches {
            lengths.fill(0.0);
            let wrench = match i < 3 {
                true => Parameter::Force(i),
                false => Parameter::Moment(i - 3),
            };
            substitute::<A, true>(rod, &[], &wrench, &mut scratch, [&mut lengths, &mut []]);
            for (column, length) in columns.iter_mut().zip(&lengths) {
                column[i / 3][i % 3] = -length;
            }
        }
    } else {
        let mut scratch = Scratch::new(rod);
        for (i, column) in columns.iter_mut().enumerate() {
            let tension = Parameter::Tension(i);
            *column = if symmetric {
                substitute::<A, true>(rod, &[], &tension, &mut scratch, [&mut [], &mut []])
            } else {
                substitute::<A, false>(rod, &[], &tension, &mut scratch, [&mut [], &mut []])
            };
        }
    }
    let mut entries = columns.iter().flatten().flat_map(|v| v.0);
    entries.all(f64::is_finite)
}

/// Adds the change of every arc's strain by changes of tension (N) to first order, after
/// `tip_by_tensions`.
pub fn add_strain_by_tensions<const A: usize>(
    rod: &Rod<Scalar, A>,
    changes: &[f64],
    strain: &mut [Vec3],
) {
    let mut scratch = Scratch::new(rod);
    let tensions = Parameter::Tensions(changes);
    if rod.newton.symmetric {
        substitute::<A, true>(rod, &[], &tensions, &mut scratch, [&mut [], &mut []]);
    } else {
        substitute::<A, false>(rod, &[], &tensions, &mut scratch, [&mut [], &mut []]);
    }
    for (k, (gradient, turns)) in rod.gradients.iter().zip(&scratch.solutions).enumerate() {
        for a in 0..A {
            strain[k * A + a] += gradient.to_strain[a] * turns[a];
        }
    }
}

/// Scratch memory of `substitute`, by modules.
struct Scratch<const A: usize> {
    sources: Vec<Source<A>>,
    /// Own solutions of the arcs.
    solutions: Vec<[Vec3; A]>,
    /// Change of the force beyond each module by followers, where its disks do not turn further.
    followers: Vec<Vec3>,
    /// Spans by modules and tendons; needed for changes of lengths only.
    spans: Vec<Span<f64>>,
}

impl<const A: usize> Scratch<A> {
    fn new(rod: &Rod<Scalar, A>) -> Self {
        let n = rod.module_count();
        Scratch {
            sources: Vec::with_capacity(n),
            solutions: copies([Vec3::zero(); A], n),
            followers: copies(Vec3::zero(), n),
            spans: vec![],
        }
    }

    fn with_spans(rod: &Rod<Scalar, A>) -> Self {
        let mut scratch = Scratch::new(rod);
        for (k, (state, c)) in rod.states.iter().zip(&rod.constants).enumerate() {
            let holes = rod.tendons.in_group(k).iter();
            let spans = holes.map(|holes| Span::new(c, holes, &state.s, state.rho));
            scratch.spans.extend(spans);
        }
        scratch
    }
}

impl Jacobians {
    fn is_finite(&self) -> bool {
        [
            &self.tensions,
            &self.tip_force,
            &self.tip_moment,
            &self.stiffness,
            &self.gravity,
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
    segments: &[usize],
    gravity: bool,
) -> Jacobians {
    let mut scratch = Scratch::with_spans(rod);
    let mut by = |p: Parameter<'_>| derivative::<A, SYMMETRIC>(rod, segments, &p, &mut scratch);
    let mut found = Jacobians {
        tensions: vec![],
        tip_force: vec![],
        tip_moment: vec![],
        stiffness: vec![],
        gravity: vec![],
    };
    for i in 0..rod.placed.lengths.len() {
        found.tensions.push(by(Parameter::Tension(i)));
    }
    for i in 0..3 {
        found.tip_force.push(by(Parameter::Force(i)));
        found.tip_moment.push(by(Parameter::Moment(i)));
        if gravity {
            let weights = rod.weights(unit(i));
            found.gravity.push(by(Parameter::Gravity(i, &weights)));
        }
    }
    for i in 0..=segments[segments.len() - 1] {
        found.stiffness.push(by(Parameter::Stiffness(i)));
    }
    found
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
    parameter: &Parameter<'_>,
) -> Source<A> {
    let (state, c, gradient) = (&rod.states[k], &rod.constants[k], &rod.gradients[k]);
    let t = in_group(&rod.tendons, &rod.tensions, rod.path, k);
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
        Parameter::Tensions(changes) => {
            for (i, change) in changes.iter().enumerate() {
                if k <= rod.tendons.end_disks[i] {
                    let span = Span::new(c, &rod.tendons.in_group(k)[i], &state.s, state.rho);
                    source.force -= span.direction * *change;
                    let moment = span.arm.cross(span.direction) * *change;
                    source.moment.iter_mut().for_each(|m| *m += moment);
                }
            }
        }
        Parameter::Force(i) => {
            let f = rod.rotations[k].tr_mul(unit(i));
            source.force = f;
            source.moment = [-tangent.cross(f) * c.clamp[1]; A];
            source.start = -state.offset(c).cross(f);
        }
        Parameter::Stiffness(segment) if segments[k] == segment => {
            let (on_end, on_tangent) = state.compliance_forces(c, &t);
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
            source.place = -(state.compliance(c, &t) * state.n);
        }
        Parameter::Gravity(_, weights) => {
            let [on_end, on_tangent, on_start, on_node] =
                weights[k].map(|f| rod.rotations[k].tr_mul(f));
            source.force = on_end;
            source.moment = [-tangent.cross(on_tangent); A];
            let of_start = Vec3([-on_start[1], on_start[0], 0.0]);
            source.start = -(state.rho.cross(on_end) + tangent.cross(on_tangent) + of_start);
            for node in 1..A / 2 {
                let load = on_node * c.node_weight(node);
                let share = load * c.fraction(2 * node);
                source.force += share;
                source.start -= state.inside(c, 2 * node - 1).cross(load);
                for i in 0..A {
                    // the contact force on the end is that without the share of the node
                    source.moment[i] += gradient.r[i].tr_mul(share);
                    if node > i / 2 {
                        source.moment[i] -=
                            gradient.r[i].tr_mul(load) - state.beyond(node).cross(load);
                    }
                }
            }
            if Rod::<Scalar, A>::BETWEEN && rod.attached.has_between() {
                for (arcs, torque) in rod.torques_by_weight(k, weights[k][3]) {
                    source.moment[..arcs].iter_mut().for_each(|m| *m += torque);
                    source.start += torque;
                }
            }
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
    segments: &[usize],
    parameter: &Parameter<'_>,
    scratch: &mut Scratch<A>,
) -> Derivative {
    let mut lengths = vec![0.0; rod.placed.lengths.len()];
    let mut bends = lengths.clone();
    let changes = [lengths.as_mut_slice(), bends.as_mut_slice()];
    let [position, rotation] =
        substitute::<A, SYMMETRIC>(rod, segments, parameter, scratch, changes);
    Derivative {
        position,
        rotation,
        lengths,
        bends,
    }
}

/// Motion of the tip (m, rad) for a unit of the parameter, with the rotations that the arcs add in
/// place of their own solutions; adds the changes of the tendons' lengths (m) and of the bends to
/// their end disks (rad) unless there is no place for them. Lengths need the spans in the scratch
/// memory.
fn substitute<const A: usize, const SYMMETRIC: bool>(
    rod: &Rod<Scalar, A>,
    segments: &[usize],
    parameter: &Parameter<'_>,
    scratch: &mut Scratch<A>,
    [lengths, bends]: [&mut [f64]; 2],
) -> [Vec3; 2] {
    let n = rod.module_count();
    if interrupt::work(n * (16 + 2 * rod.placed.lengths.len())) {
        return [Vec3::splat([f64::NAN; 3]); 2];
    }
    let responses = &rod.newton.responses;
    let Scratch {
        sources,
        solutions,
        followers,
        spans,
    } = scratch;
    sources.clear();
    for k in 0..n {
        sources.push(source(rod, &responses[k], segments, k, parameter));
    }
    let mut p = match *parameter {
        Parameter::Moment(i) => -rod.rotations[n].tr_mul(unit(i)),
        _ => Vec3::zero(),
    };
    let mut beyond = Vec3::zero();
    for k in (0..n).rev() {
        if let Parameter::Gravity(i, _) = *parameter {
            for payload in rod.fixed.payloads.iter().filter(|p| p.disk == k) {
                let weight = rod.rotations[k + 1].tr_mul(unit(i)) * payload.mass;
                p -= Vec3(payload.centre).cross(weight);
            }
        }
        let at_start = rod.states[k].s * p;
        let mut start = [at_start];
        for a in 0..A {
            solutions[k][a] = sources[k].moment[a] + at_start;
        }
        let follower = rod.attached.coupling(k);
        if let Some(coupling) = follower {
            beyond = rod.states[k].s * beyond;
            followers[k] = beyond;
            coupling.add_force(beyond, &mut solutions[k], &mut start[0]);
        }
        rod.newton.eliminated[k].backward::<SYMMETRIC>(&mut solutions[k], &mut start);
        if let Some(coupling) = follower {
            beyond = coupling.force_beyond(beyond, &solutions[k]);
            if Rod::<Scalar, A>::BETWEEN && rod.attached.has_between() {
                let between = &rod.attached.between;
                beyond -= between.force_by_arcs(k, |m| *m, &solutions[k]);
            }
        }
        p = start[0] + sources[k].start;
    }
    let mut x = Vec3::zero();
    let mut position = Vec3::zero();
    let count = rod.placed.lengths.len();
    for k in 0..n {
        let (state, c, response) = (&rod.states[k], &rod.constants[k], &responses[k]);
        let u = rod.newton.eliminated[k].forward(&solutions[k], &[x]);
        solutions[k] = u;
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
            if Rod::<Scalar, A>::BETWEEN && rod.attached.has_between() {
                force += rod.attached.between.stretching_by_turns(k, c, x, &u);
            }
        }
        let rho = response.m * moved + response.d_hat * force;
        let offset = x.cross(state.offset(c)) + rho + turn.cross(state.s.column(2)) * c.clamp[1];
        position += rod.rotations[k] * offset;
        for (i, length) in lengths.iter_mut().enumerate() {
            if k <= rod.tendons.end_disks[i] {
                let span = &spans[k * count + i];
                *length += span.direction.dot(rho + turn.cross(span.arm));
            }
        }
        if !bends.is_empty() {
            let bend = rod.bend_axis(k).map_or(0.0, |axis| axis.dot(turn));
            for (i, change) in bends.iter_mut().enumerate() {
                *change += f64::from(u8::from(k <= rod.tendons.end_disks[i])) * bend;
            }
        }
        x = state.s.tr_mul(x + turn);
    }
    let tip: Mat3 = rod.rotations[n];
    [position, tip * x]
}
