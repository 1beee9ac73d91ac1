//! A module with continuous tendons: their lengths, and the energy of shear and extension.
//!
//! Theory: docs/theory/rod.md (Continuous tendons).

use crate::math::linalg::Vec3;
use crate::math::real::Real;
use crate::rod::constants::Constants;
use crate::rod::continuous::{gauss_point, tendon, PulledArc, PulledSection};
use crate::rod::routes::{Holes, Tendons};
use crate::rod::state::State;

/// A module with continuous tendons.
pub struct PulledModule<T, const A: usize> {
    arcs: [PulledArc<T>; A],
    /// Mean contact force along each arc, in the axes of its sections (N).
    forces: [Vec3<T>; A],
    points: [PulledSection<T>; A],
    /// Change of the length of any tendon as its tension holds the shear by the loads (m).
    held: T,
}

impl<T: Real, const A: usize> PulledModule<T, A> {
    /// Nothing if the tendons are straight.
    #[inline(always)]
    pub fn of(state: &State<T, A>, c: &Constants<T, A>, t: &Tendons<T>) -> Option<Self> {
        t.are_continuous().then(
            #[inline(always)]
            || Self::new(state, c, t),
        )
    }

    #[inline(never)]
    fn new(state: &State<T, A>, c: &Constants<T, A>, t: &Tendons<T>) -> Self {
        let force = state.n + state.compliance_forces(c, t).0;
        PulledModule {
            arcs: std::array::from_fn(|i| PulledArc::new(c, t, i, state.w[i])),
            forces: std::array::from_fn(|i| {
                let arc = &state.arcs[i];
                arc.map.left_jacobian().tr_mul(arc.prefix.tr_mul(force))
            }),
            points: std::array::from_fn(|i| gauss_point(c, t, i, &state.w)),
            held: state.length_by_shear(c, t),
        }
    }

    /// Length of a tendon (m): the derivative of the potential with respect to its tension.
    #[inline(never)]
    pub fn length(&self, c: &Constants<T, A>, holes: &Holes<T>) -> T {
        let mut length = holes.beside_clamps(c) + self.by_loads(c, holes);
        for (i, p) in self.points.iter().enumerate() {
            length += tendon(c, holes, p.at, p.u, p.g).2 * c.arc_length(i);
        }
        length
    }

    /// Change of the length of a tendon by the shear and extension that the loads cause (m).
    #[inline(never)]
    fn by_loads(&self, c: &Constants<T, A>, holes: &Holes<T>) -> T {
        let mut change = self.held;
        for (arc, force) in self.arcs.iter().zip(&self.forces) {
            let s = &arc.section;
            let (_, along, _) = tendon(c, holes, s.at, s.u, s.g);
            change += (s.compliance * *force).dot(along) * arc.length;
        }
        change
    }

    /// Energy of shear and extension (J) beyond that of the contact force.
    #[inline(never)]
    pub fn strain_energy(&self, c: &Constants<T, A>, t: &Tendons<T>) -> T {
        let mut energy = T::zero();
        for (i, p) in self.points.iter().enumerate() {
            energy -= p.pull.dot(p.g) * c.arc_length(i) * T::splat(0.5);
        }
        for (holes, &tension) in t.holes.iter().zip(t.tensions) {
            energy -= tension * self.by_loads(c, holes);
        }
        energy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lie::ArcMap;
    use crate::math::linalg::Mat3;
    use crate::model::load::{Model, TendonPath};
    use crate::model::robot::{Robot, Section, Tendon};
    use crate::parts;
    use crate::random::Draw;
    use crate::rod::continuous::PulledElement;

    const STEP: f64 = 1e-5;
    const HOLE: [f64; 2] = [0.02, -0.013];
    const TENSIONS: [f64; 2] = [40.0, 15.0];

    /// A soft module: the tendons shorten it by a tenth.
    fn constants<const A: usize>() -> Constants<f64, A> {
        let section = Section {
            axial: 550.0,
            shear: 190.0,
            ..parts::section(0.11)
        };
        let mut spec = parts::robot(&[section], &[1], [0.07, 0.004], 0.0, &[0]);
        spec.tendons = vec![Tendon::parallel(HOLE, 0)];
        let robot = Robot::new(spec);
        Constants::new(&robot.unwrap(), 0, Model::default())
    }

    /// One tendon across the module, and one beside the backbone.
    const HOLES: [Holes<f64>; 2] = [
        Holes {
            start: [0.012, 0.015],
            end: HOLE,
            curve: None,
        },
        Holes {
            start: HOLE,
            end: HOLE,
            curve: None,
        },
    ];

    fn tendons(tensions: &[f64]) -> Tendons<'_, f64> {
        Tendons {
            holes: &HOLES,
            tensions,
            path: TendonPath::Continuous,
            on_nodes: &[],
        }
    }

    fn vector(draw: &mut Draw, size: f64) -> Vec3 {
        Vec3([0; 3].map(|_| draw.within(-size, size)))
    }

    /// Central differences of `f` along each axis, by columns.
    fn differences(f: impl Fn(Vec3) -> Vec3) -> Mat3 {
        Mat3([0, 1, 2].map(|axis| {
            let mut step = Vec3::zero();
            step[axis] = STEP;
            ((f(step) - f(-step)) * (0.5 / STEP)).0
        }))
        .transpose()
    }

    fn assert_near(found: Mat3, expected: Mat3, scale: f64) {
        let apart = (found - expected).rows().map(Vec3::max_abs);
        let most = apart.into_iter().fold(0.0, f64::max);
        assert!(
            most < 1e-8 * scale,
            "{found:?} against {expected:?}: {most}"
        );
    }

    fn derivatives_in_the_last_element<const A: usize>(number: usize) {
        let (c, t) = (constants::<A>(), tendons(&TENSIONS));
        let mut draw = Draw::new(32, number);
        let w = [0; A].map(|_| vector(&mut draw, 0.6 / A as f64));
        let (e, i) = (A / 2 - 1, A - 2);
        let element = |arc: usize, u: Vec3| {
            let mut w = w;
            w[arc] += u;
            PulledElement::new(&c, &t, e, &w)
        };
        let found = element(i, Vec3::zero());
        let energy = |arc, u| Vec3([element(arc, u).energy(&c, &t), 0.0, 0.0]);
        for (arc, gradient) in [i, i + 1].into_iter().zip(found.gradient()) {
            let by = differences(|u| energy(arc, u)).rows()[0];
            assert!((by - gradient).max_abs() < 1e-7, "{by:?}, {gradient:?}");
        }
        let [aa, ba, bb] = found.hessian();
        assert_near(differences(|u| element(i, u).gradient()[0]), aa, 1.0);
        assert_near(differences(|u| element(i, u).gradient()[1]), ba, 1.0);
        assert_near(differences(|u| element(i + 1, u).gradient()[1]), bb, 1.0);
        // an arc: its end, and the second derivatives of its parts along n
        let n = vector(&mut draw, 30.0);
        let arc = |u: Vec3| {
            let w = w[i] + u;
            (
                PulledArc::new(&c, &t, i, w),
                ArcMap::new(w, c.arc_length(i)),
            )
        };
        let (pulled, map) = arc(Vec3::zero());
        let end = |u| {
            let (pulled, map) = arc(u);
            map.end_along(pulled.chord)
        };
        assert_near(differences(end), pulled.end_jacobian(&map), 1.0);
        let by = |u| {
            let (pulled, map) = arc(u);
            pulled.end_jacobian(&map).tr_mul(n)
        };
        let hessian = pulled.hessian(&c, &t, &map, n, Vec3::zero());
        assert_near(differences(by), hessian, 10.0);
    }

    /// Derivatives of an element's energy and of an arc's end.
    #[test]
    fn derivatives_of_an_element() {
        for number in 0..13 {
            derivatives_in_the_last_element::<2>(number);
            derivatives_in_the_last_element::<4>(number);
            derivatives_in_the_last_element::<16>(number);
        }
    }

    /// On a stiff arc of constant curvature a continuous tendon has the length of the parallel arc.
    #[test]
    fn a_tendon_of_an_arc_is_the_parallel_arc() {
        let (c, t) = (constants::<2>(), tendons(&[0.0; 2]));
        for angle in [0.0, 0.1, -0.4, 1.2] {
            let mut state = State::<f64, 2>::straight();
            state.w = [Vec3([0.0, 0.5 * angle, 0.0]); 2];
            state.shape(&c, &t);
            let length = PulledModule::new(&state, &c, &t).length(&c, &HOLES[1]);
            // a bend about y shortens a tendon on the side of +x
            let expected = c.flexible + c.clamp[0] + c.clamp[1] - angle * HOLE[0];
            assert!((length - expected).abs() < 1e-12, "{angle}");
        }
    }

    /// The potential `elastic + pulled - f . rho`, whose derivatives are imbalance and lengths.
    fn potential<const A: usize>(tensions: [f64; 2], w: [Vec3; A], f: Vec3) -> State<f64, A> {
        let (c, t) = (constants::<A>(), tendons(&tensions));
        let mut state = State::straight();
        state.w = w;
        state.f[0] = f;
        state.shape(&c, &t);
        state.balance(&c, &t);
        state
    }

    /// A tendon's length is the derivative of the potential with respect to its tension, also where
    /// loads shear the section.
    #[test]
    fn lengths_are_derivatives_of_the_potential() {
        for number in 0..9 {
            let mut draw = Draw::new(33, number);
            let w = [0; 4].map(|_| vector(&mut draw, 0.2));
            let f = vector(&mut draw, 20.0);
            let c = constants::<4>();
            let state = potential(TENSIONS, w, f);
            let pulled = PulledModule::new(&state, &c, &tendons(&TENSIONS));
            for (i, holes) in HOLES.iter().enumerate() {
                let at = |step: f64| {
                    let mut tensions = TENSIONS;
                    tensions[i] += step;
                    potential(tensions, w, f).energy
                };
                let by_tension = (at(1e-3) - at(-1e-3)) / 2e-3;
                let length = pulled.length(&c, holes) - holes.beside_clamps(&c);
                assert!(
                    (length - by_tension).abs() < 1e-9,
                    "{length} against {by_tension}"
                );
            }
        }
    }
}
