//! Critical loads of rods against closed forms and linear analyses of their own: compression with
//! shear and extension, lateral buckling, and Kirchhoff's rod under a moment along its axis. Those of
//! Euler and Greenhill are in `branches.rs`.

mod common;

use bowstring_core::math::lie::exp;
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, OwnedLoad, RodModel, Theory};
use bowstring_core::model::robot::{Robot, Section};
use bowstring_core::statics::branches::{diagram, Branch, EventKind, LoadPath, Search};
use bowstring_core::statics::solver::Solver;
use common::solved;
use std::f64::consts::PI;
use std::ops::{Add, Mul, Neg, Sub};

const BENDING: f64 = 1.3;
const LENGTH: f64 = 0.7;
/// Compressive force at which a column clamped at one end buckles (N).
const EULER: f64 = PI * PI * BENDING / (4.0 * LENGTH * LENGTH);

/// Round, with no rotary inertia.
const ROUND: Section = Section {
    bending: [BENDING; 2],
    principal_angle: 0.0,
    torsion: 0.8 * BENDING,
    axial: 1e6,
    shear: 1e6,
    mass_per_length: 0.2,
    rotary_inertia: 0.0,
    rest_curvature: [0.0; 3],
};

/// A bare rod in equal modules.
fn rod(section: Section, modules: usize) -> Robot {
    common::rod(section.into(), LENGTH, modules)
}

fn model(theory: Theory, elements: Option<usize>) -> RodModel {
    let model = Model {
        theory,
        ..Model::default()
    };
    RodModel { model, elements }
}

/// The branch that begins at the first load, up to a factor of the second one.
fn first_branch(robot: &Robot, model: &RodModel, loads: [Load; 2], most: f64) -> Branch {
    let [from, to] = loads.map(|load| {
        let mut owned = OwnedLoad::default();
        owned.set(&load);
        owned
    });
    let search = Search {
        most,
        branches: 1,
        deflation: false,
        ..Search::default()
    };
    let path = LoadPath { from, to };
    let mut found = diagram(robot, model, &path, &search).unwrap();
    found.branches.swap_remove(0)
}

/// Stability at a factor of a load.
fn stable_at(robot: &Robot, model: &RodModel, loads: [Load; 2], factor: f64) -> Option<bool> {
    let branch = first_branch(robot, model, loads, factor);
    let last = branch.points.last().unwrap();
    assert!((last.factor / factor - 1.0).abs() < 1e-9);
    last.stable
}

/// Checks the first critical load to 0.02 %, and `stable` at 0.5 % below and above it.
fn check(robot: &Robot, model: &RodModel, critical: Load, multiplicity: usize) {
    let loads = [Load::default(), critical];
    let branch = first_branch(robot, model, loads, 1.1);
    let event = branch.events[0];
    assert_eq!(event.kind, EventKind::Bifurcation);
    assert_eq!(event.multiplicity, multiplicity);
    let factor = branch.points[event.point].factor;
    assert!((factor - 1.0).abs() < 2e-4, "{factor}");
    for (share, stable) in [(0.995, true), (1.005, false)] {
        assert_eq!(
            stable_at(robot, model, loads, share),
            Some(stable),
            "{share}"
        );
    }
}

fn compressed(force: f64) -> Load<'static> {
    Load {
        tip_force: [0.0, 0.0, -force],
        ..Load::default()
    }
}

/// Reissner: with shear and extension, `P (1 + P/(G A) - P/(E A))` is Euler's load.
#[test]
fn column_with_shear_and_extension() {
    for (shear, axial) in [(20.0, 1e6), (1e6, 50.0), (20.0, 50.0)] {
        let soft = Section {
            shear: shear * EULER,
            axial: axial * EULER,
            ..ROUND
        };
        let excess = 1.0 / shear - 1.0 / axial;
        let critical = 2.0 / (1.0 + (1.0 + 4.0 * excess).sqrt());
        assert!((critical - 1.0).abs() > 0.015);
        let thick = model(Theory::Cosserat, Some(4));
        check(&rod(soft, 40), &thick, compressed(critical * EULER), 2);
    }
}

/// Michell and Prandtl: a strip under a dead transverse force at its tip buckles sideways at
/// `4.01260 sqrt(E I G J) / L^2`, with `E I` of the soft direction. That of the other one raises the
/// force by 0.01 % where it is ten thousand times as large.
#[test]
fn strip_buckles_sideways() {
    for ratio in [1e4, 1e6] {
        let strip = Section {
            bending: [BENDING, ratio * BENDING],
            ..ROUND
        };
        let critical = 4.012599 * (strip.bending[0] * strip.torsion).sqrt() / (LENGTH * LENGTH);
        // the first principal axis is along x: a force along x bends it about the stiff one
        let load = Load {
            tip_force: [critical, 0.0, 0.0],
            ..Load::default()
        };
        check(&rod(strip, 9), &model(Theory::Kirchhoff, Some(4)), load, 1);
    }
}

/// A complex number.
#[derive(Clone, Copy, Debug)]
struct Complex(f64, f64);

impl Complex {
    fn size(self) -> f64 {
        self.0.hypot(self.1)
    }

    fn inverse(self) -> Self {
        let square = self.0 * self.0 + self.1 * self.1;
        Complex(self.0 / square, -self.1 / square)
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Complex(self.0 + o.0, self.1 + o.1)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Complex(self.0 - o.0, self.1 - o.1)
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Complex(-self.0, -self.1)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Complex(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
}

/// Kirchhoff's rod, clamped at the base, under a compressive dead force and a dead moment along its
/// axis at the tip; in units of bending stiffness and length.
///
/// With `w = x + i y`, small motions obey `w'''' - i m w''' + p w'' = l w`, where `l` is the mass
/// per length times the square of the angular frequency. At the clamp `w = w' = 0`. At the tip the
/// moment in the section is the dead one: `w'' - i m w' = 0` and `w''' - i m w'' + p w' = 0`.
#[derive(Clone, Copy)]
struct Shaft {
    force: f64,
    moment: f64,
}

impl Shaft {
    /// Determinant of the conditions at the tip, zero at an `l` of a motion. `w` and its three
    /// derivatives at the tip are a power series in the length, one for `w'' = 1` and one for
    /// `w''' = 1` at the clamp.
    fn determinant(&self, l: Complex) -> Complex {
        let (i_m, p) = (Complex(0.0, self.moment), Complex(self.force, 0.0));
        let tip = |start: usize| {
            // coefficients of the series are `d[k] / k!`, `d[k]` the k-th derivative at the clamp
            let mut d = vec![Complex(0.0, 0.0); 90];
            d[start] = Complex(1.0, 0.0);
            for k in 4..d.len() {
                d[k] = i_m * d[k - 1] - p * d[k - 2] + l * d[k - 4];
            }
            let at_tip = |order: usize| {
                let (mut sum, mut factor) = (Complex(0.0, 0.0), 1.0);
                for (k, v) in d[order..].iter().enumerate() {
                    factor /= k.max(1) as f64;
                    sum = sum + *v * Complex(factor, 0.0);
                }
                sum
            };
            let [w1, w2, w3] = [1, 2, 3].map(at_tip);
            [w2 - i_m * w1, w3 - i_m * w2 + p * w1]
        };
        let ([a, b], [c, d]) = (tip(2), tip(3));
        a * d - b * c
    }

    /// `l` of the lowest motions, followed from those of the unloaded rod.
    fn motions(&self) -> Vec<Complex> {
        let steps = 200;
        let follow = |root: f64| {
            let mut l = Complex(root.powi(4), 0.0);
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let at = Shaft {
                    force: share * self.force,
                    moment: share * self.moment,
                };
                // Newton's method with a difference for the derivative
                for _ in 0..20 {
                    let h = Complex(1e-5 * (1.0 + l.size()), 0.0);
                    let (here, up) = (at.determinant(l), at.determinant(l + h));
                    let change = h * here * (up - here).inverse();
                    l = l - change;
                    if change.size() < 1e-12 * (1.0 + l.size()) {
                        break;
                    }
                }
            }
            l
        };
        let clamped_free = [1.875104068711961, 4.694091132974175, 7.854757438237613];
        clamped_free.map(follow).to_vec()
    }

    /// Growth rate of the motion that grows fastest, over its angular frequency. As much modal
    /// damping prevents growth.
    fn growth(&self) -> f64 {
        let of = |l: Complex| (0.5 * l.1.atan2(l.0)).sin().abs();
        self.motions().into_iter().map(of).fold(0.0, f64::max)
    }
}

/// Largest argument at which a condition holds that holds at the first and not at the last one.
fn last_where(
    mut holds: impl FnMut(f64) -> bool,
    [mut low, mut high]: [f64; 2],
    digits: f64,
) -> f64 {
    assert!(holds(low) && !holds(high), "{low} {high}");
    while high - low > digits * high {
        let middle = 0.5 * (low + high);
        match holds(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}

/// Load of a [`Shaft`] on a rod of `ROUND`.
fn load_of(shaft: Shaft) -> Load<'static> {
    Load {
        tip_moment: [0.0, 0.0, shaft.moment * BENDING / LENGTH],
        ..compressed(shaft.force * BENDING / (LENGTH * LENGTH))
    }
}

/// Without damping, a dead moment along the axis makes a round rod flutter however small it is
/// (Nikolai), so stability is that of motions with a damping ratio of 1 %. The moment at which this
/// damping no longer suffices is found to 0.1 % (1e-5 seen), from tension to 97 % of Euler's load.
#[test]
fn moment_along_the_axis_that_one_percent_of_damping_bears() {
    let robot = rod(ROUND, 9);
    let mut solver = Solver::new(&robot, model(Theory::Kirchhoff, None).model, 1).unwrap();
    for force in [-2.0, 0.0, 1.0, 2.0, 2.4] {
        let critical = last_where(
            |moment| Shaft { force, moment }.growth() < 0.01,
            [1e-4, 1.0],
            1e-5,
        );
        let mut stable = |moment: f64| {
            let outcome = solved(&mut solver, &load_of(Shaft { force, moment }));
            let [x, y, z] = solver.tip().unwrap().position.0;
            assert!(x.hypot(y) < 1e-9 && (z - LENGTH).abs() < 1e-9);
            outcome.stable
        };
        assert_eq!(stable(0.995 * critical), Some(true), "{force}");
        assert_eq!(stable(1.005 * critical), None, "{force}");
        let found = last_where(|m| stable(m) == Some(true), [1e-4, 1.0], 1e-4);
        let gap = (found / critical - 1.0).abs();
        assert!(gap < 1e-3, "{force}: {found} {critical}");
    }
}

/// Where motions grow at more than half of their angular frequency, no damping helps: unstable.
#[test]
fn compression_that_no_damping_bears_under_a_moment() {
    let (robot, thin) = (rod(ROUND, 9), model(Theory::Kirchhoff, Some(1)));
    for moment in [0.1, 0.5, 1.0] {
        let unbearable = last_where(
            |force| Shaft { force, moment }.growth() < 0.5,
            [0.0, 2.46],
            1e-5,
        );
        let stable = |force: f64| {
            let loads = [0.0, force].map(|force| load_of(Shaft { force, moment }));
            stable_at(&robot, &thin, loads, 1.0)
        };
        assert_eq!(stable(0.995 * unbearable), None, "{moment}");
        assert_eq!(stable(1.005 * unbearable), Some(false), "{moment}");
        // beyond Euler's load
        assert_eq!(stable(2.6), Some(false), "{moment}");
    }
}

/// Kirchhoff: a round rod under a force and a moment along one axis is a helix about it. With
/// curvature `k`, torsion `t` and twisting moment `c`, the force is `w (c - E I t)`, where `w` is
/// the root of `k^2 + t^2`.
#[test]
fn rod_under_a_wrench_is_a_helix() {
    let thin = model(Theory::Kirchhoff, Some(8));
    let mut solver = Solver::new(&rod(ROUND, 12), thin.model, 8).unwrap();
    for (curvature, torsion, force) in [
        (2.0, 0.0, 1.0),
        (2.0, 1.5, 0.0),
        (1.0, 3.0, 2.0),
        (3.0, -1.0, 0.5),
        (1.5, 2.0, -0.5),
    ] {
        let rate = f64::hypot(curvature, torsion) / LENGTH;
        let (k, t) = (curvature / LENGTH, torsion / LENGTH);
        let force = force * BENDING / (LENGTH * LENGTH);
        let twisting = BENDING * t + force / rate;
        // base: normal along x, binormal along y, tangent along z
        let axis = Vec3([0.0, k / rate, t / rate]);
        let turn = exp(axis * (rate * LENGTH));
        let along = axis * (t / rate);
        let across = Vec3([0.0, 0.0, 1.0]) - along;
        let (sin, cos) = (rate * LENGTH).sin_cos();
        let tip =
            along * LENGTH + across * (sin / rate) + axis.cross(across) * ((1.0 - cos) / rate);
        let load = Load {
            tip_force: (axis * force).0,
            tip_moment: (turn.column(1) * (BENDING * k) + turn.column(2) * twisting).0,
            ..Load::default()
        };
        solved(&mut solver, &load);
        let gap = (solver.tip().unwrap().position - tip).norm() / LENGTH;
        assert!(gap < 1e-8, "{curvature} {torsion}: {gap:e}");
        let tangent = solver.tip().unwrap().rotation.column(2);
        assert!((tangent - turn.column(2)).norm() < 1e-8);
    }
}
