//! What a moment of a motion leaves behind: fields along the backbone, disks, tendons, energies.

use super::energy::Energies;
use super::kinematics::of_lane;
use super::step::Motion;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::TendonPath;
use crate::model::robot::Tendon;
use crate::rod::chain::{get, get_mat, in_group, put, put_mat};
use crate::rod::constants::Constants;
use crate::rod::module::{Span, State, Tendons};

/// Fields at one time after the other, flat, SI, in the base frame unless said otherwise.
///
/// Points lie along the flexible part of every module, from base to tip, both ends of every module
/// among them.
#[derive(Clone, Debug, Default)]
pub struct Fields {
    /// Times (s).
    pub time: Vec<f64>,
    /// Energies by time.
    pub energies: Vec<Energies>,
    /// Points of the centreline (m), by time and point.
    pub position: Vec<f64>,
    /// Section frames (body to base, by rows), by time and point.
    pub rotation: Vec<f64>,
    /// Force of the part beyond on a section (N), in the section's own axes.
    pub force: Vec<f64>,
    /// Moment of the part beyond on a section (N m), in the section's own axes.
    pub moment: Vec<f64>,
    /// Positions of the disks (m), by time and disk.
    pub disk_position: Vec<f64>,
    /// Rotations of the disks (body to base, by rows).
    pub disk_rotation: Vec<f64>,
    /// Velocities of the disks (m/s).
    pub disk_velocity: Vec<f64>,
    /// Angular velocities of the disks (rad/s), in base axes.
    pub disk_angular_velocity: Vec<f64>,
    /// Tensions (N), by time and tendon.
    pub tension: Vec<f64>,
    /// Tendon lengths (m), by time and tendon.
    pub tendon_length: Vec<f64>,
    /// Lengths of spans (m), by time, disk at the end and tendon; NaN where the tendon does not
    /// pass.
    pub span_length: Vec<f64>,
    /// Tendon displacements since home (m), by time and tendon, of a robot that is driven through its
    /// lines.
    pub pull: Vec<f64>,
    /// Slack lengths (m), by time and tendon, of a robot that is driven through its lines.
    pub slack: Vec<f64>,
    /// Tensions of spans where forces balanced in the last step (N), as `span_length`.
    pub span_tension: Vec<f64>,
}

impl Fields {
    /// Forgets all times, not the room that they took.
    pub fn clear(&mut self) {
        let Fields {
            time,
            energies,
            position,
            rotation,
            force,
            moment,
            disk_position,
            disk_rotation,
            disk_velocity,
            disk_angular_velocity,
            tension,
            tendon_length,
            span_length,
            pull,
            slack,
            span_tension,
        } = self;
        energies.clear();
        for values in [
            time,
            position,
            rotation,
            force,
            moment,
            disk_position,
            disk_rotation,
            disk_velocity,
            disk_angular_velocity,
            tension,
            tendon_length,
            span_length,
            pull,
            slack,
            span_tension,
        ] {
            values.clear();
        }
    }

    #[inline(always)]
    fn disk(&mut self, position: Vec3, frame: &Mat3, velocity: Vec3, turning: &Mat3) {
        let ([x, y, z], [u, v, w]) = (frame.rows(), turning.rows());
        let spin = [
            w.dot(y) - v.dot(z),
            u.dot(z) - w.dot(x),
            v.dot(x) - u.dot(y),
        ];
        self.disk_position.extend_from_slice(&position.0);
        self.disk_rotation.extend_from_slice(frame.0.as_flattened());
        self.disk_velocity.extend_from_slice(&velocity.0);
        self.disk_angular_velocity
            .extend_from_slice(&spin.map(|x| 0.5 * x));
    }
}

/// Modules side by side, as what is recorded of their sections takes them.
struct Pieces<T, const A: usize> {
    state: State<T, A>,
    /// Strain that the moment answers, damping included, and contact force.
    strain: [Vec3<T>; A],
    force: Vec3<T>,
    /// Of all tendons that run along the backbone.
    tension: T,
    /// Weight and inertia by length, in the frame of the start.
    load: Vec3<T>,
    /// The disk at the start.
    origin: Vec3<T>,
    frame: Mat3<T>,
}

impl<L: Layout, const A: usize> Motion<L, A> {
    /// Appends all fields of now: `points` along the flexible part of every module, both ends
    /// among them. With none of them only what disks and tendons do, spans left out.
    #[inline(always)]
    pub fn record(&self, time: f64, tensions: &[f64], points: usize, out: &mut Fields) {
        out.time.push(time);
        out.energies.push(self.balance.now);
        out.tension.extend_from_slice(tensions);
        for j in 0..tensions.len() {
            let spans = self.spans.now.iter().skip(j).step_by(tensions.len());
            out.tendon_length.push(spans.sum());
        }
        if points > 0 {
            return self.record_modules(tensions, points, out);
        }
        let place = &self.kinematics.position;
        for k in 0..self.module_count() {
            self.record_disk(k, &place.points[k * A + A - 1], &place.frames[k], out);
        }
    }

    /// Appends disks, spans and sections of all modules.
    #[inline(always)]
    fn record_modules(&self, tensions: &[f64], points: usize, out: &mut Fields) {
        let n = self.module_count();
        let first = out.position.len() / 3;
        for v in [&mut out.position, &mut out.force, &mut out.moment] {
            v.resize(3 * (first + n * points), 0.0);
        }
        out.rotation.resize(9 * (first + n * points), 0.0);
        let tendons = &self.rod.tendons;
        let first_span = out.span_length.len();
        out.span_length
            .resize(first_span + n * tendons.len(), f64::NAN);
        let mut here = Vec::with_capacity(tendons.len());
        let mut frame = Mat3::<L::Chain>::identity();
        let mut origin = Vec3::<L::Chain>::zero();
        for g in 0..self.next.len() {
            let start = g * L::WIDTH;
            let count = L::WIDTH.min(n - start);
            here.clear();
            for (tendon, whole) in tendons.iter().zip(tensions) {
                here.push(tension_in_group::<L>(start, tendon, *whole));
            }
            let t = in_group(tendons, &here, self.rod.path, 0);
            let mut c = self.rod.constants[g];
            if self.scheme.rigid {
                // without the device that lets the scheme divide
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
                origin += frame * get::<L>(&end, i);
                frame = frame * get_mat::<L>(&pieces.state.s, i);
                self.record_disk(k, &origin, &frame, out);
            }
            for (j, tendon) in tendons.iter().enumerate() {
                let state = &pieces.state;
                let length = match self.rod.path {
                    TendonPath::Straight => Span::new(&c, tendon, &state.s, state.rho).length,
                    TendonPath::Continuous => state.parallel_length(&c, &t, tendon),
                };
                for k in start..(start + count).min(tendon.end_disk + 1) {
                    out.span_length[first_span + k * tendons.len() + j] = length.lane(k - start);
                }
            }
            let sections = first + start * points..first + (start + count) * points;
            pieces.record(&c, points, sections, out);
        }
    }

    /// A group of modules now, not yet placed.
    #[inline(always)]
    fn pieces(
        &self,
        g: usize,
        c: &Constants<L::Module>,
        t: &Tendons<L::Module>,
    ) -> Pieces<L::Module, A> {
        let (now, rate) = (&self.strain.start()[g], &self.strain.rate[g]);
        let mut state = State::<L::Module, A>::straight();
        state.w = now.w;
        state.n = now.n;
        let mut strain = now.w;
        let mut force = now.n;
        let tau = L::Module::splat(self.scheme.damping.material);
        for a in 0..A {
            strain[a] = rate.w[a].scaled_add(tau, strain[a]);
        }
        if !self.scheme.rigid {
            force = rate.n.scaled_add(tau, force);
        }
        let mut tension = L::Module::zero();
        if t.path == TendonPath::Continuous {
            for own in t.tensions {
                tension += *own;
            }
        }
        state.shape(c, t);
        state.rho = state.rho0 + state.compliance(c) * state.n;
        Pieces {
            state,
            strain,
            force,
            tension,
            load: Vec3::zero(),
            origin: Vec3::zero(),
            frame: Mat3::zero(),
        }
    }

    /// Weight and inertia of a module's backbone by length, in the frame of its start, N/m.
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
            mass += self.mass.points[k * A + a];
        }
        if mass == 0.0 {
            return Vec3::zero();
        }
        frame.tr_mul(load) * (mass_per_length * L::Chain::splat(1.0 / mass))
    }

    #[inline(always)]
    fn record_disk(
        &self,
        k: usize,
        position: &Vec3<L::Chain>,
        frame: &Mat3<L::Chain>,
        out: &mut Fields,
    ) {
        let velocity = &self.kinematics.velocity;
        let turning = of_lane(&velocity.frames[k]);
        let velocity = velocity.points[k * A + A - 1].of_lane(0);
        out.disk(position.of_lane(0), &of_lane(frame), velocity, &turning);
    }
}

/// Tension of a tendon in the modules of a group from `start` on; zero where it does not pass.
#[inline(always)]
fn tension_in_group<L: Layout>(start: usize, tendon: &Tendon, whole: f64) -> L::Module {
    L::Module::from_fn(|i| {
        if start + i <= tendon.end_disk {
            whole
        } else {
            0.0
        }
    })
}

impl<T: Real, const A: usize> Pieces<T, A> {
    /// The sections of all modules. Mean moment is the backbone's own; how it varies comes from
    /// the balance of the piece beyond.
    #[inline(always)]
    fn record(
        &self,
        c: &Constants<T>,
        points: usize,
        sections: std::ops::Range<usize>,
        out: &mut Fields,
    ) {
        let (state, load) = (&self.state, self.load);
        let elements = (A / 2) as f64;
        // the contact force is the mean over the module
        let force = self.force - load * (c.flexible * T::splat(0.5));
        let (mut moment, mut centre) = (Vec3::zero(), Vec3::zero());
        let gauss = 3f64.sqrt() / 6.0;
        let weight = T::splat(0.5 / elements);
        for element in 0..A / 2 {
            for side in [-gauss, gauss] {
                let xi = 0.5 + side;
                let (a, b) = (self.strain[2 * element], self.strain[2 * element + 1]);
                let curved = (b - a).scaled_add(T::splat(3.0 * side), a + b);
                let (place, turn) = state.section((element as f64 + xi) / elements);
                moment += (turn * c.moment(curved)) * weight;
                centre += place * weight;
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
                _ => state.section(xi),
            };
            let left = c.flexible * T::splat(1.0 - xi);
            let lever = T::splat(0.5) * left * left - c.flexible * c.flexible * T::splat(1.0 / 6.0);
            let m = along.scaled_add(lever, moment + (centre - place).cross(force));
            let f = load.scaled_add(left, force);
            // tendons along the backbone carry their own part of what is beyond
            let mut own = turn.tr_mul(f);
            own.0[2] -= self.tension;
            spread(position, p, points, &(clamp + self.frame * place).0);
            spread(rotation, p, points, (self.frame * turn).0.as_flattened());
            spread(forces, p, points, &own.0);
            spread(moments, p, points, &turn.tr_mul(m).0);
        }
    }
}

/// Writes the numbers of a point of every module where that point has its place.
#[inline(always)]
fn spread<T: Real>(out: &mut [f64], point: usize, points: usize, values: &[T]) {
    let size = values.len();
    for (i, module) in out.chunks_exact_mut(points * size).enumerate() {
        for (to, from) in module[point * size..][..size].iter_mut().zip(values) {
            *to = from.lane(i);
        }
    }
}
