//! Motions of one robot side by side, one in each lane of the numbers.
//!
//! Theory: docs/theory/dynamics.md (Many motions).
//!
//! All motions take the same equal steps. A lane that has converged is not changed any more, and no
//! decision in one lane depends on another: a motion depends on those beside it by rounding errors
//! only (of the series that suits all lanes).

use super::kinematics::Kinematics;
use super::motion::Motion;
use super::moving::Moving;
use super::spans::CONTACT;
use super::strain::StrainHistory;
use crate::math::copies;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real, MOST_LANES};
use crate::model::load::{Load, TendonPath};
use crate::rod::continuous_module::PulledModule;
use crate::rod::routes::in_group;
use crate::rod::span::Span;

/// One truth value of each lane.
pub type Flags = [bool; MOST_LANES];

// Tuned constants. Moments are over (bending stiffness / length).

/// Most Newton iterations of a step; from the second of these numbers on the tangent is recomputed.
const MAX_ITERATIONS: usize = 10;
const ANEW: usize = 4;
/// The same of a search for an equilibrium, where it is recomputed in each iteration.
const MAX_ITERATIONS_AT_REST: usize = 40;
/// Energy gain in a period, over the larger of the energies at its ends, above which it is repeated
/// with shorter steps.
const MOST_GROWTH: f64 = 5e-2;
/// Most halvings of the step.
const MOST_HALVINGS: u32 = 5;

/// Problem to solve.
#[derive(Clone, Copy, PartialEq)]
enum Problem {
    Step,
    /// A step after a jump of the tensions, or one of a repeated period: the forces at its predictor
    /// are unrealistic, and left out of the first tangent.
    Unpredictable,
    Equilibrium,
}
/// Steps of a period.
#[derive(Clone, Copy, Debug)]
pub struct Period {
    /// Length of the period (s).
    pub duration: f64,
    /// Number of steps.
    pub steps: usize,
    /// Spectral radius at infinity.
    pub spectral_radius: f64,
    /// Whether tensions are constant in the period, otherwise they change linearly.
    pub held: bool,
    /// Tolerances of the moment imbalance of a step and of an equilibrium (N m).
    pub tolerance: f64,
    pub at_rest: f64,
}

/// Result of a period in a lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advanced {
    Done,
    StepFailed,
    Collision,
}

/// The last disk of a motion, in the base frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tip {
    pub position: [f64; 3],
    /// Rotation (body to base), row by row.
    pub rotation: [[f64; 3]; 3],
    pub velocity: [f64; 3],
    pub angular_velocity: [f64; 3],
}

/// Motions side by side; see [`SideBySide`] for what each method does.
pub trait MotionsSideBySide: Send + Sync {
    /// Number of motions that fit side by side.
    fn width(&self) -> usize;
    /// Brings the chosen lanes to rest in the equilibrium of tensions (N), by lanes and tendons, from
    /// its strain; returns where that succeeded. The others keep their state.
    fn rest(&mut self, chosen: Flags, tensions: &[f64], period: &Period) -> Flags;
    /// Sets the strain and contact forces from which a lane finds its equilibrium.
    fn set_strain(&mut self, lane: usize, strain: &[Vec3], force: &[Vec3]);
    /// Advances the chosen lanes by a period, under tensions (N) by lanes and tendons. Lanes that
    /// fail, and those not chosen, keep their state.
    fn advance(
        &mut self,
        chosen: Flags,
        tensions: &[f64],
        period: &Period,
    ) -> [Advanced; MOST_LANES];
    /// The tip in a lane.
    fn tip(&self, lane: usize) -> Tip;
    /// Length of a tendon in a lane (m).
    fn length(&self, lane: usize, tendon: usize) -> f64;
    /// Energy in a lane: kinetic, elastic and of gravity (J).
    fn energies(&self, lane: usize) -> [f64; 3];
    /// Number of periods of single lanes that were repeated with shorter steps.
    fn repeated(&self) -> usize;
}

/// State of the motions between two periods, beside that in the rod.
struct State<L: Layout, const A: usize> {
    /// Tensions (N), and lengths of the tendons (m).
    tensions: Vec<L::Chain>,
    lengths: Vec<L::Chain>,
    /// Kinetic and elastic energy, and that of gravity (J).
    energies: [L::Chain; 3],
    /// Work of the tendons in this period (J).
    work: L::Chain,
}

impl<L: Layout, const A: usize> State<L, A> {
    fn new(tendons: usize) -> Self {
        State {
            tensions: copies(L::Chain::zero(), tendons),
            lengths: copies(L::Chain::zero(), tendons),
            energies: [L::Chain::zero(); 3],
            work: L::Chain::zero(),
        }
    }

    fn copy_from(&mut self, o: &Self) {
        self.tensions.copy_from_slice(&o.tensions);
        self.lengths.copy_from_slice(&o.lengths);
        self.energies = o.energies;
    }

    fn take_lane(&mut self, o: &Self, lane: usize) {
        let own = self.tensions.iter_mut().chain(&mut self.lengths);
        let other = o.tensions.iter().chain(&o.lengths).chain(&o.energies);
        for (own, other) in own.chain(&mut self.energies).zip(other) {
            own.set_lane(lane, other.lane(lane));
        }
    }
}

/// The motions in their present state.
struct Now<L: Layout, const A: usize> {
    motion: Motion<L, A>,
    state: State<L, A>,
}

/// A stored state.
struct Saved<L: Layout, const A: usize> {
    strain: StrainHistory<L, A>,
    kinematics: Kinematics<L::Chain, A>,
    state: State<L, A>,
}

impl<L: Layout, const A: usize> Saved<L, A> {
    fn new(modules: usize, tendons: usize) -> Self {
        Saved {
            strain: StrainHistory::new(modules),
            kinematics: Kinematics::new(modules),
            state: State::new(tendons),
        }
    }

    fn copy_from(&mut self, now: &Now<L, A>) {
        self.strain.copy_from(&now.motion.strain);
        self.kinematics.copy_from(&now.motion.kinematics);
        self.state.copy_from(&now.state);
    }

    /// Takes over a lane that has come here by steps shorter by this factor.
    fn take_lane(&mut self, now: &Now<L, A>, lane: usize, factor: usize) {
        let m = &now.motion;
        self.strain.take_lane(&m.strain, lane, factor as f64);
        self.kinematics.take_lane(&m.kinematics, lane);
        self.state.take_lane(&now.state, lane);
    }
}

impl<L: Layout, const A: usize> Now<L, A> {
    /// Returns to a stored state.
    fn restore(&mut self, from: &Saved<L, A>) {
        self.motion.strain.copy_from(&from.strain);
        self.motion.kinematics.copy_from(&from.kinematics);
        self.state.copy_from(&from.state);
    }

    /// Returns to a stored state in one lane.
    fn restore_lane(&mut self, from: &Saved<L, A>, lane: usize) {
        let m = &mut self.motion;
        m.strain.take_lane(&from.strain, lane, 1.0);
        m.kinematics.take_lane(&from.kinematics, lane);
        self.state.take_lane(&from.state, lane);
    }
}

/// Motions in lanes. The layout has one module in a group.
pub struct SideBySide<L: Layout, const A: usize> {
    now: Now<L, A>,
    /// Tensions at the end of the period (N).
    target: Vec<L::Chain>,
    /// State before the period, and at its end in lanes that are done.
    before: Saved<L, A>,
    done: Saved<L, A>,
    /// Number of periods of single motions that were repeated with shorter steps.
    repeated: usize,
}

impl<L: Layout, const A: usize> SideBySide<L, A> {
    /// Motions without a state, under a dead force on the tip.
    pub fn new(mut motion: Motion<L, A>, load: &Load) -> Self {
        assert!(L::WIDTH == 1 && L::Chain::LANES <= MOST_LANES);
        motion.body.rod.set_attached(load);
        motion.residual.tip_force = Vec3::splat(load.tip_force);
        let (modules, tendons) = (motion.next.len(), motion.body.rod.tendons.len());
        let saved = || Saved::new(modules, tendons);
        SideBySide {
            target: copies(L::Chain::zero(), tendons),
            before: saved(),
            done: saved(),
            repeated: 0,
            now: Now {
                motion,
                state: State::new(tendons),
            },
        }
    }

    /// Tensions by tendons, in lanes.
    fn set_target(&mut self, tensions: &[f64]) {
        let count = self.target.len();
        for (i, target) in self.target.iter_mut().enumerate() {
            *target = L::Chain::from_fn(|lane| tensions[lane * count + i]);
        }
    }

    /// Solves for the strain at the end of the step, or of an equilibrium; returns the lanes that
    /// converged. Lanes that are not to be solved keep their predictor.
    fn solve(&mut self, chosen: &Flags, tolerance: &[f64; MOST_LANES], problem: Problem) -> Flags {
        let m = &mut self.now.motion;
        let (most, anew) = match problem {
            Problem::Equilibrium => (MAX_ITERATIONS_AT_REST, 0),
            Problem::Unpredictable => (MAX_ITERATIONS, 1),
            Problem::Step => (MAX_ITERATIONS, ANEW),
        };
        let mut converged = [false; MOST_LANES];
        for iteration in 0..=most {
            let imbalance = m.forces();
            let mut all = true;
            for lane in 0..L::Chain::LANES {
                converged[lane] |= imbalance.lane(lane) <= tolerance[lane];
                all &= converged[lane] || !chosen[lane];
            }
            if all || iteration == most {
                break;
            }
            if iteration == 0 || iteration >= anew {
                if iteration < anew && problem == Problem::Unpredictable {
                    m.drop_forces();
                }
                m.linearise();
            }
            let (rod, tangent) = (&m.body.rod, &mut m.tangent);
            m.response.solve_imbalance(rod, tangent, &m.residual);
            let factor =
                L::Module::from_fn(|lane| f64::from(u8::from(chosen[lane] && !converged[lane])));
            m.response.columns[0].add(&m.body, &m.tangent, factor, &mut m.next);
        }
        converged
    }

    /// Takes all steps of the period, each divided by `parts`; returns the result in each lane.
    fn integrate(
        &mut self,
        chosen: &Flags,
        tensions: &[f64],
        period: &Period,
        parts: usize,
    ) -> [Advanced; MOST_LANES] {
        let steps = period.steps * parts;
        let step = period.duration / steps as f64;
        let mut found = [Advanced::Done; MOST_LANES];
        let mut active = *chosen;
        let mut tolerance = [0.0; MOST_LANES];
        self.now.motion.body.scheme.fresh = period.held;
        self.now.state.work = L::Chain::zero();
        if period.held {
            self.jump();
        }
        for i in 0..steps {
            // where a period is repeated, none of its predictors is trusted
            let problem = match parts > 1 || (period.held && i == 0) {
                true => Problem::Unpredictable,
                false => Problem::Step,
            };
            if problem == Problem::Unpredictable {
                let m = &mut self.now.motion;
                m.strain.reset_predictor(&m.body.scheme);
            }
            self.now.motion.begin(step, period.spectral_radius);
            if !period.held {
                let share = (i as f64 + self.now.motion.body.scheme.af) / steps as f64;
                self.set_tensions(share);
            }
            if i == 0 {
                tolerance = self.tolerances(period.tolerance, tensions);
            }
            let converged = self.solve(&active, &tolerance, problem);
            let forward = self.finish();
            if !period.held {
                self.add_work();
            }
            for lane in 0..L::Chain::LANES {
                if !active[lane] {
                    continue;
                }
                if !converged[lane] {
                    found[lane] = Advanced::StepFailed;
                } else if !(forward.lane(lane) > 0.0) {
                    found[lane] = Advanced::Collision;
                }
                active[lane] = found[lane] == Advanced::Done;
            }
            if !active.contains(&true) {
                return found;
            }
        }
        if period.held {
            self.add_work();
        }
        self.measure();
        let grown = self.energy_gain();
        for lane in 0..L::Chain::LANES {
            // a NaN fails this test
            if active[lane] && !(grown.lane(lane) <= MOST_GROWTH) {
                found[lane] = Advanced::StepFailed;
            }
        }
        found
    }

    /// Tolerances by lanes, no tighter than rounding allows in the present step.
    fn tolerances(&self, tolerance: f64, tensions: &[f64]) -> [f64; MOST_LANES] {
        let mut out = [tolerance; MOST_LANES];
        let rows = tensions.chunks_exact(self.target.len().max(1));
        for (out, row) in out.iter_mut().zip(rows) {
            *out = f64::max(tolerance, self.now.motion.noise(row));
        }
        out
    }

    /// Sets the tensions at a share of the period, to the last digit at its end.
    fn set_tensions(&mut self, share: f64) {
        let (from, to) = (&self.now.state.tensions, &self.target);
        let [start, end] = [1.0 - share, share].map(L::Chain::splat);
        let between = |i: usize| from[i] * start + to[i] * end;
        self.now.motion.body.rod.set_tensions(between);
    }

    /// Sets the tensions at once.
    fn jump(&mut self) {
        let m = &mut self.now.motion;
        if m.body.rod.path == TendonPath::Straight || m.body.scheme.rigid {
            return self.set_tensions(1.0);
        }
        self.set_tensions(0.0);
        let m = &mut self.now.motion;
        let rod = &m.body.rod;
        rod.layout.vectorize(
            #[inline(always)]
            || {
                for (k, state) in m.next.iter_mut().enumerate() {
                    let (c, start) = (&rod.constants[k], &m.strain.start()[k]);
                    let t = in_group(&rod.tendons, &rod.tensions, rod.path, k);
                    (state.w, state.n) = (start.w, start.n);
                    state.shape(c, &t);
                    state.rho = state.rho0 + state.compliance(c, &t) * state.n;
                }
            },
        );
        self.set_tensions(1.0);
        self.now.motion.keep_disks();
    }

    /// Accepts the end of the step; returns the smallest forward component of chords and loaded spans,
    /// not positive where disks have collided.
    fn finish(&mut self) -> L::Chain {
        let m = &mut self.now.motion;
        m.body.rod.layout.vectorize(
            #[inline(always)]
            || {
                m.kinematics.set_velocities(&m.body.scheme);
                m.kinematics.commit(&m.body.scheme);
                m.strain.commit(&m.body.scheme, &m.next);
                m.body.scheme.fresh = false;
                m.forward()
            },
        )
    }

    /// Measures the energies of the present state.
    fn measure(&mut self) {
        let m = &self.now.motion;
        self.now.state.energies = m.body.rod.layout.vectorize(
            #[inline(always)]
            || m.stored_by_lanes(),
        );
    }

    /// Measures the lengths, and adds the work of the present tensions since the last time.
    fn add_work(&mut self) {
        let (m, state) = (&self.now.motion, &mut self.now.state);
        m.body.rod.layout.vectorize(
            #[inline(always)]
            || {
                for (j, length) in state.lengths.iter_mut().enumerate() {
                    let now = m.length_of(j);
                    state.work += m.tension_of(j) * (*length - now);
                    *length = now;
                }
            },
        );
    }

    /// Energy gained in the period beyond the work of tendons and tip load, over the larger of the
    /// energies at its ends. What damping dissipates counts as a loss.
    fn energy_gain(&self) -> L::Chain {
        let (before, now) = (&self.before.state, &self.now.state);
        let (mut gain, mut scale) = (L::Chain::zero(), L::Chain::zero());
        for (energies, sign) in [(&now.energies, 1.0), (&before.energies, -1.0)] {
            let [kinetic, elastic, gravity] = *energies;
            gain += (kinetic + elastic + gravity) * L::Chain::splat(sign);
            scale = scale.max(kinetic + elastic + gravity.abs());
        }
        gain -= now.work;
        let last = self.now.motion.next.len() - 1;
        let [from, to] = [&self.before.kinematics, &self.now.motion.kinematics];
        let moved = to.position[last].disk() - from.position[last].disk();
        gain -= self.now.motion.residual.tip_force.dot(moved);
        // the work of what hardly moves is below rounding
        gain / (scale + L::Chain::splat(f64::MIN_POSITIVE))
    }
}

impl<L: Layout, const A: usize> MotionsSideBySide for SideBySide<L, A> {
    fn width(&self) -> usize {
        L::Chain::LANES
    }

    fn set_strain(&mut self, lane: usize, strain: &[Vec3], force: &[Vec3]) {
        for (k, (strain, force)) in strain.chunks_exact(A).zip(force).enumerate() {
            let state = &mut self.now.motion.next[k];
            for (own, strain) in state.w.iter_mut().zip(strain) {
                for q in 0..3 {
                    own.0[q].set_lane(lane, strain[q]);
                }
            }
            for q in 0..3 {
                state.n.0[q].set_lane(lane, force[q]);
            }
        }
    }

    fn rest(&mut self, chosen: Flags, tensions: &[f64], period: &Period) -> Flags {
        self.before.copy_from(&self.now);
        self.set_target(tensions);
        self.set_tensions(1.0);
        // the strain before would leave its rounding errors
        self.now.motion.strain.fill_at_rest(&self.now.motion.next);
        self.now.motion.begin_at_rest();
        let tolerance = self.tolerances(period.at_rest, tensions);
        let mut found = self.solve(&chosen, &tolerance, Problem::Equilibrium);
        let m = &mut self.now.motion;
        m.strain.fill_at_rest(&m.next);
        m.strain
            .set_durations(period.duration / period.steps as f64);
        m.kinematics.commit_at_rest();
        m.body.stiffen();
        self.now.state.tensions.copy_from_slice(&self.target);
        self.add_work();
        self.measure();
        for lane in 0..L::Chain::LANES {
            found[lane] &= chosen[lane];
            if !found[lane] {
                self.now.restore_lane(&self.before, lane);
            }
        }
        found
    }

    fn advance(
        &mut self,
        chosen: Flags,
        tensions: &[f64],
        period: &Period,
    ) -> [Advanced; MOST_LANES] {
        self.before.copy_from(&self.now);
        self.set_target(tensions);
        let mut found = self.integrate(&chosen, tensions, period, 1);
        let fails = |found: &[Advanced; MOST_LANES]| {
            std::array::from_fn(|lane| chosen[lane] && found[lane] != Advanced::Done)
        };
        let mut failed: Flags = fails(&found);
        if failed.contains(&true) {
            self.repeat(&mut failed, &mut found, tensions, period);
        }
        self.now.state.tensions.copy_from_slice(&self.target);
        for lane in 0..L::Chain::LANES {
            if !chosen[lane] || failed[lane] {
                self.now.restore_lane(&self.before, lane);
            }
        }
        found
    }

    fn tip(&self, lane: usize) -> Tip {
        let kinematics = &self.now.motion.kinematics;
        let last = kinematics.position.len() - 1;
        let (place, velocity) = (&kinematics.position[last], &kinematics.velocity[last]);
        let rotation = place.frame.of_lane(lane);
        let ([x, y, z], [u, v, w]) = (rotation.rows(), velocity.frame.of_lane(lane).rows());
        let spin = [
            w.dot(y) - v.dot(z),
            u.dot(z) - w.dot(x),
            v.dot(x) - u.dot(y),
        ];
        Tip {
            position: place.disk().of_lane(lane).0,
            rotation: rotation.0,
            velocity: velocity.disk().of_lane(lane).0,
            angular_velocity: spin.map(|x| 0.5 * x),
        }
    }

    fn length(&self, lane: usize, tendon: usize) -> f64 {
        self.now.state.lengths[tendon].lane(lane)
    }

    fn energies(&self, lane: usize) -> [f64; 3] {
        self.now.state.energies.map(|energy| energy.lane(lane))
    }

    fn repeated(&self) -> usize {
        self.repeated
    }
}

impl<L: Layout, const A: usize> SideBySide<L, A> {
    /// Repeats the period in the lanes that failed, with shorter steps.
    #[cold]
    fn repeat(
        &mut self,
        failed: &mut Flags,
        found: &mut [Advanced; MOST_LANES],
        tensions: &[f64],
        period: &Period,
    ) {
        self.repeated += failed.iter().filter(|failed| **failed).count();
        self.done.copy_from(&self.now);
        for halving in 1..=MOST_HALVINGS {
            self.now.restore(&self.before);
            let parts = 1 << halving;
            let again = self.integrate(failed, tensions, period, parts);
            for lane in 0..L::Chain::LANES {
                if !failed[lane] {
                    continue;
                }
                found[lane] = again[lane];
                if again[lane] == Advanced::Done {
                    failed[lane] = false;
                    self.done.take_lane(&self.now, lane, parts);
                }
            }
            if !failed.contains(&true) {
                break;
            }
        }
        self.now.restore(&self.done);
    }
}

impl<L: Layout, const A: usize> Motion<L, A> {
    /// Smallest forward component of chords and loaded spans at the end of the step; see
    /// [`super::spans::SpanLengths`].
    #[inline(always)]
    fn forward(&self) -> L::Chain {
        let rod = &self.body.rod;
        // the largest of the opposite
        let mut backward = L::Module::splat(f64::NEG_INFINITY);
        for (k, state) in self.next.iter().enumerate() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, k);
            let c = &rod.constants[k];
            let mean = state.s.column(2) + Vec3::ez();
            backward = backward.max(-state.rho.dot(mean));
            for (j, holes) in t.holes.iter().enumerate() {
                let tension = t.tensions[j];
                if !tension.any_above(0.0) {
                    continue;
                }
                let forward = match t.path {
                    TendonPath::Straight => {
                        let span = Span::new(c, holes, &state.s, state.rho);
                        let gap = span.length * c.per_flexible - L::Module::splat(CONTACT);
                        -(-gap).max(-span.direction.dot(mean))
                    }
                    TendonPath::Continuous | TendonPath::Embedded => c.stretch(&t),
                };
                let own = L::Module::from_fn(|lane| match tension.lane(lane) > 0.0 {
                    true => -forward.lane(lane),
                    false => f64::NEG_INFINITY,
                });
                backward = backward.max(own);
            }
        }
        L::get(&-backward, 0)
    }

    /// Tension of a tendon where forces balance (N).
    #[inline(always)]
    fn tension_of(&self, j: usize) -> L::Chain {
        // every tendon passes the first module
        L::get(&self.body.rod.tensions[j], 0)
    }

    /// Length of a tendon at the end of the step (m).
    #[inline(always)]
    fn length_of(&self, j: usize) -> L::Chain {
        let rod = &self.body.rod;
        let mut length = rod.tendons.length_in_holes(j, rod.path);
        for (k, state) in self.next.iter().enumerate() {
            if k > rod.tendons.end_disks[j] {
                break;
            }
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, k);
            let c = &rod.constants[k];
            let holes = &t.holes[j];
            let span = match PulledModule::of(state, c, &t) {
                None => Span::new(c, holes, &state.s, state.rho).length,
                Some(pulled) => pulled.length(c, holes),
            };
            length += L::get(&span, 0);
        }
        length
    }

    /// Kinetic and elastic energy, and that of gravity, at the end of the step (J).
    #[inline(always)]
    fn stored_by_lanes(&self) -> [L::Chain; 3] {
        let (mut kinetic, mut elastic) = (L::Chain::zero(), L::Chain::zero());
        for (k, velocity) in self.kinematics.velocity.iter().enumerate() {
            kinetic += self.body.mass.product(k, velocity, velocity);
            elastic += L::get(&self.elastic_energy(k), 0);
        }
        let weight = self.body.mass.sum(&self.kinematics.position);
        [
            kinetic * L::Chain::splat(0.5),
            elastic,
            -self.residual.gravity.dot(weight),
        ]
    }
}
