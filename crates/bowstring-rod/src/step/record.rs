//! Records of a motion: fields along the backbone, disks, tendons, energies.
//!
//! Theory: docs/theory/dynamics.md and docs/theory/rod.md.

use super::energy::Energies;
use super::motion::Motion;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::chain::Rod;
use crate::rod::constants::Constants;
use crate::rod::continuous_module::PulledModule;
use crate::rod::gauss::GAUSS;
use crate::rod::groups::{get, get_mat, put, put_mat};
use crate::rod::routes::Tendons;
use crate::rod::span::Span;
use crate::rod::state::State;

/// Fields at successive times, flat arrays in SI units, in the base frame unless stated otherwise.
#[derive(Clone, Debug, Default)]
pub struct Fields {
    /// Times (s).
    pub time: Vec<f64>,
    /// Energies at each time.
    pub energies: Vec<Energies>,
    /// Fields of the backbone.
    pub sections: SectionFields,
    /// Fields of the disks.
    pub disks: DiskFields,
    /// Fields of the tendons.
    pub tendons: TendonFields,
}

/// Fields of the backbone, by time and point.
///
/// Points lie along the flexible part of every module, from base to tip, and include both ends of
/// every module.
#[derive(Clone, Debug, Default)]
pub struct SectionFields {
    /// Points of the centreline (m).
    pub position: Vec<f64>,
    /// Section frames (body to base, row by row).
    pub rotation: Vec<f64>,
    /// Internal force (N) of the distal part on a section, in the section's own axes.
    pub force: Vec<f64>,
    /// Internal moment (N m) of the distal part on a section, in the section's own axes.
    pub moment: Vec<f64>,
}

/// Fields of the disks, by time and disk.
#[derive(Clone, Debug, Default)]
pub struct DiskFields {
    /// Positions (m).
    pub position: Vec<f64>,
    /// Rotations (body to base, row by row).
    pub rotation: Vec<f64>,
    /// Velocities (m/s).
    pub velocity: Vec<f64>,
    /// Angular velocities (rad/s), in base axes.
    pub angular_velocity: Vec<f64>,
}

/// Fields of the tendons, by time and tendon; those of spans by time, disk at the end, and tendon,
/// NaN where the tendon does not pass.
#[derive(Clone, Debug, Default)]
pub struct TendonFields {
    /// Tensions (N).
    pub tension: Vec<f64>,
    /// Lengths (m).
    pub length: Vec<f64>,
    /// Displacements from the home pose (m), of a robot actuated through tendon lines.
    pub displacement: Vec<f64>,
    /// Slack lengths (m), of a robot actuated through tendon lines.
    pub slack: Vec<f64>,
    /// Lengths of spans (m).
    pub span_length: Vec<f64>,
    /// Tensions of spans where forces balanced in the last step (N).
    pub span_tension: Vec<f64>,
}

impl Fields {
    /// Removes all times, and keeps the allocated memory.
    pub fn clear(&mut self) {
        self.energies.clear();
        let (sections, disks, tendons) = (&mut self.sections, &mut self.disks, &mut self.tendons);
        for values in [
            &mut self.time,
            &mut sections.position,
            &mut sections.rotation,
            &mut sections.force,
            &mut sections.moment,
            &mut disks.position,
            &mut disks.rotation,
            &mut disks.velocity,
            &mut disks.angular_velocity,
            &mut tendons.tension,
            &mut tendons.length,
            &mut tendons.displacement,
            &mut tendons.slack,
            &mut tendons.span_length,
            &mut tendons.span_tension,
        ] {
            values.clear();
        }
    }
}

/// Data of modules side by side, for the fields of their sections.
struct Pieces<T, const A: usize> {
    state: State<T, A>,
    /// Strain that corresponds to the moment, damping included, and contact force (N).
    strain: [Vec3<T>; A],
    force: Vec3<T>,
    /// Weight and inertial force per length, in the frame of the start (N/m).
    load: Vec3<T>,
    /// Force (N) and moment (N m) of loads between the disks on the nodes before the elements, in the
    /// frame of the start.
    on_nodes: [[Vec3<T>; 2]; A],
    /// Position of the disk at the start (m).
    origin: Vec3<T>,
    frame: Mat3<T>,
}

impl<L: Layout, const A: usize> Motion<L, A> {
    /// Appends all present fields: `points` points along the flexible part of every module, both
    /// ends included. With `points` zero, only fields of disks and tendons, without spans.
    #[inline(always)]
    pub(super) fn record_now(&self, time: f64, tensions: &[f64], points: usize, out: &mut Fields) {
        out.time.push(time);
        out.energies.push(self.energies.now);
        out.tendons.tension.extend_from_slice(tensions);
        let rod = &self.body.rod;
        for j in 0..tensions.len() {
            let spans = self.spans.now.iter().skip(j).step_by(tensions.len());
            let in_holes: L::Chain = rod.tendons.length_in_holes(j, rod.path);
            out.tendons
                .length
                .push(spans.sum::<f64>() + in_holes.lane(0));
        }
        if points > 0 {
            return self.record_modules(tensions, points, out);
        }
        for (k, place) in self.kinematics.position.iter().enumerate() {
            self.record_disk(k, &place.disk(), &place.frame, &mut out.disks);
        }
    }

    /// Appends disks, spans and sections of all modules.
    #[inline(always)]
    fn record_modules(&self, tensions: &[f64], points: usize, out: &mut Fields) {
        let (rod, n) = (&self.body.rod, self.module_count());
        let sections = &mut out.sections;
        let first = sections.position.len() / 3;
        for (v, size) in [
            (&mut sections.position, 3),
            (&mut sections.rotation, 9),
            (&mut sections.force, 3),
            (&mut sections.moment, 3),
        ] {
            v.resize(size * (first + n * points), 0.0);
        }
        let span_lengths = &mut out.tendons.span_length;
        let first_span = span_lengths.len();
        span_lengths.resize(first_span + n * tensions.len(), f64::NAN);
        let mut here = Vec::with_capacity(tensions.len());
        let mut frame = Mat3::<L::Chain>::identity();
        let mut origin = Vec3::<L::Chain>::zero();
        for g in 0..self.next.len() {
            let start = g * L::WIDTH;
            let count = L::WIDTH.min(n - start);
            here.clear();
            for (j, whole) in tensions.iter().enumerate() {
                here.push(rod.fixed.passes[g * tensions.len() + j] * L::Module::splat(*whole));
            }
            let t = Tendons {
                holes: rod.tendons.in_group(g),
                tensions: &here,
                path: rod.path,
                on_nodes: &[],
            };
            let mut c = rod.constants[g].clone();
            if self.body.scheme.rigid {
                // remove the compliance that only regularises a Kirchhoff rod
                c.d[0] = L::Module::zero();
            }
            let mut pieces = self.pieces(g, &c, &t);
            let end = pieces.state.offset(&c);
            for i in 0..count {
                let k = start + i;
                put::<L>(&mut pieces.origin, i, origin);
                put_mat::<L>(&mut pieces.frame, i, &frame);
                let load = self.load_by_length(k, &frame, L::get(&c.mass_per_length, i));
                put::<L>(&mut pieces.load, i, load);
                if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                    let state = &pieces.state;
                    let rotation = |arcs: usize| frame * get_mat::<L>(&state.node(arcs / 2), i);
                    let on_nodes = &mut pieces.on_nodes;
                    rod.each_between(k, rotation, |arcs, own| {
                        for (part, own) in on_nodes[arcs / 2].iter_mut().zip(own) {
                            put::<L>(part, i, frame.tr_mul(own));
                        }
                    });
                }
                origin += frame * get::<L>(&end, i);
                frame = frame * get_mat::<L>(&pieces.state.s, i);
                self.record_disk(k, &origin, &frame, &mut out.disks);
            }
            let state = &pieces.state;
            let pulled = PulledModule::of(state, &c, &t);
            for (j, holes) in t.holes.iter().enumerate() {
                let length = match &pulled {
                    None => Span::new(&c, holes, &state.s, state.rho).length,
                    Some(pulled) => pulled.length(&c, holes),
                };
                for k in start..(start + count).min(rod.tendons.end_disks[j] + 1) {
                    span_lengths[first_span + k * tensions.len() + j] = length.lane(k - start);
                }
            }
            let at = first + start * points..first + (start + count) * points;
            pieces.record(&c, &t, points, at, sections);
        }
    }

    /// Present data of a group of modules, without their positions.
    #[inline(always)]
    fn pieces(
        &self,
        g: usize,
        c: &Constants<L::Module, A>,
        t: &Tendons<L::Module>,
    ) -> Pieces<L::Module, A> {
        let (now, rate) = (&self.strain.start()[g], &self.strain.rate[g]);
        let mut state = State::<L::Module, A>::straight();
        state.w = now.w;
        state.n = now.n;
        let mut strain = now.w;
        let mut force = now.n;
        let tau = L::Module::splat(self.body.scheme.damping.material);
        for a in 0..A {
            strain[a] = rate.w[a].scaled_add(tau, strain[a]);
        }
        if !self.body.scheme.rigid {
            force = rate.n.scaled_add(tau, force);
        }
        state.shape(c, t);
        state.rho = state.rho0 + state.compliance(c, t) * state.n;
        Pieces {
            state,
            strain,
            force,
            load: Vec3::zero(),
            on_nodes: [[Vec3::zero(); 2]; A],
            origin: Vec3::zero(),
            frame: Mat3::zero(),
        }
    }

    /// Weight, inertial and given force of a module's backbone per length, in the frame of its start
    /// (N/m).
    #[inline(always)]
    fn load_by_length(
        &self,
        k: usize,
        frame: &Mat3<L::Chain>,
        mass_per_length: L::Chain,
    ) -> Vec3<L::Chain> {
        let (mut load, mut mass) = (Vec3::zero(), 0.0);
        for a in 0..A - 1 {
            load += self.residual.last_force[k * A + a];
            mass += self.body.mass.points[k * A + a];
        }
        let share = if mass > 0.0 { 1.0 / mass } else { 0.0 };
        load = load * (mass_per_length * L::Chain::splat(share));
        if let Some(line) = self.residual.line_forces.get(k) {
            load += Vec3::splat(*line);
        }
        frame.tr_mul(load)
    }

    #[inline(always)]
    fn record_disk(
        &self,
        k: usize,
        position: &Vec3<L::Chain>,
        frame: &Mat3<L::Chain>,
        out: &mut DiskFields,
    ) {
        let velocity = &self.kinematics.velocity[k];
        let frame = frame.of_lane(0);
        let ([x, y, z], [u, v, w]) = (frame.rows(), velocity.frame.of_lane(0).rows());
        let spin = [
            w.dot(y) - v.dot(z),
            u.dot(z) - w.dot(x),
            v.dot(x) - u.dot(y),
        ];
        out.position.extend(position.of_lane(0).0);
        out.rotation.extend_from_slice(frame.0.as_flattened());
        out.velocity.extend(velocity.disk().of_lane(0).0);
        out.angular_velocity.extend(spin.map(|x| 0.5 * x));
    }
}

impl<T: Real, const A: usize> Pieces<T, A> {
    /// Moment about a place of the loads on the nodes beyond some arcs (N m).
    #[inline(always)]
    fn moment_beyond(&self, c: &Constants<T, A>, arcs: usize, place: Vec3<T>) -> Vec3<T> {
        let mut sum = Vec3::zero();
        for node in arcs / 2 + 1..A / 2 {
            let [force, moment] = self.on_nodes[node];
            let lever = self.state.inside(c, 2 * node - 1) - place;
            sum += moment + lever.cross(force);
        }
        sum
    }

    /// Fields at the sections of all modules. The mean moment is that of the backbone's strain; its
    /// variation follows from the balance of the distal piece.
    #[inline(always)]
    fn record(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        points: usize,
        sections: std::ops::Range<usize>,
        out: &mut SectionFields,
    ) {
        let (state, load) = (&self.state, self.load);
        let elements = (A / 2) as f64;
        // the contact force is the mean over the module
        let mut force = self.force - load * (c.flexible * T::splat(0.5));
        for node in 1..A / 2 {
            force -= self.on_nodes[node][0] * c.fraction(2 * node);
        }
        let (mut moment, mut centre) = (Vec3::zero(), Vec3::zero());
        for element in 0..A / 2 {
            let part = c.part(element);
            let weight = part * T::splat(0.5 / elements);
            for side in [-GAUSS, GAUSS] {
                let xi = 0.5 + side;
                let [a, b] =
                    [2 * element, 2 * element + 1].map(|arc| self.strain[arc] - c.rest[arc]);
                let curved = (b - a).scaled_add(T::splat(3.0 * side), a + b);
                let stiffness = &c.at_gauss_points(element)[usize::from(side > 0.0)];
                let from = c.fraction(2 * element).lane(0);
                let (place, turn) = state.section(c, t, from + part.lane(0) * xi / elements);
                let mut own = stiffness.times(curved);
                if T::PLAIN {
                    if let Some(coupling) = c.coupling() {
                        let per_element = c.per_flexible * T::splat(elements) / part;
                        own = coupling.moment_at(curved, per_element, turn.tr_mul(self.force));
                    }
                }
                moment += (turn * own) * weight;
                centre += place * weight;
                // the mean moment has that of the loads on the nodes beyond as well
                moment -= self.moment_beyond(c, 2 * element, place) * weight;
            }
        }
        let along = (state.rho * c.per_flexible).cross(load);
        let mut clamp = self.origin;
        clamp += self.frame.column(2) * c.clamp[0];
        let position = &mut out.position[3 * sections.start..3 * sections.end];
        let rotation = &mut out.rotation[9 * sections.start..9 * sections.end];
        let forces = &mut out.force[3 * sections.start..3 * sections.end];
        let moments = &mut out.moment[3 * sections.start..3 * sections.end];
        for p in 0..points {
            let xi = p as f64 / (points - 1) as f64;
            let (place, turn) = match p {
                0 => (Vec3::zero(), Mat3::identity()),
                _ if p == points - 1 => (state.rho, state.s),
                _ => state.section(c, t, xi),
            };
            let left = c.flexible * T::splat(1.0 - xi);
            let lever = T::splat(0.5) * left * left - c.flexible * c.flexible * T::splat(1.0 / 6.0);
            let mut m = along.scaled_add(lever, moment + (centre - place).cross(force));
            let mut f = load.scaled_add(left, force);
            if A > 2 {
                let arcs = c.arcs_before(xi) as usize;
                m += self.moment_beyond(c, arcs, place);
                for node in arcs / 2 + 1..A / 2 {
                    f += self.on_nodes[node][0];
                }
            }
            // continuous tendons carry their own part of the distal force
            let mut own = turn.tr_mul(f);
            if t.are_continuous() {
                own -= state.pull(c, t, xi, own);
            }
            spread(position, p, points, &(clamp + self.frame * place).0);
            spread(rotation, p, points, (self.frame * turn).0.as_flattened());
            spread(forces, p, points, &own.0);
            spread(moments, p, points, &turn.tr_mul(m).0);
        }
    }
}

/// Writes the values at a point of every module to their positions.
#[inline(always)]
fn spread<T: Real>(out: &mut [f64], point: usize, points: usize, values: &[T]) {
    let size = values.len();
    for (i, module) in out.chunks_exact_mut(points * size).enumerate() {
        for (to, from) in module[point * size..][..size].iter_mut().zip(values) {
            *to = from.lane(i);
        }
    }
}
