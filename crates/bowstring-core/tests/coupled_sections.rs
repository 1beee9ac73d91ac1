//! Backbones by their full stiffness matrix, against independent solutions.

mod common;

use bowstring_core::math::lie;
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Load, Model};
use bowstring_core::model::robot::Profile;
use bowstring_core::statics::solver::Solver;
use common::{coupled, inverse, rod, solved, Draw, Stiffness};

/// Curvature, twist, shear and extension of a rod of 0.4 m that bends by tens of degrees under 1 N,
/// without couplings.
const SIZES: [f64; 6] = [0.06, 0.09, 0.05, 800.0, 1100.0, 1500.0];

const REST: [f64; 3] = [0.8, -0.5, 1.1];
const LENGTH: f64 = 0.4;

/// A rod in the base frame: position, rotation and internal moment.
#[derive(Clone, Copy)]
struct Here {
    place: Vec3,
    turn: Mat3,
    moment: Vec3,
}

/// Integrates the rod's equations from the base by the compliance matrix, under a force at the tip;
/// `moment` is that at the base. The rotation advances by Munthe-Kaas's method, of fourth order.
fn integrate(compliance: &Stiffness, force: Vec3, moment: Vec3, steps: usize) -> Here {
    let h = LENGTH / steps as f64;
    let rate = |at: &Here| {
        let (m, n) = (at.turn.tr_mul(at.moment), at.turn.tr_mul(force));
        let wrench = [m[0], m[1], m[2], n[0], n[1], n[2]];
        let strain = compliance.map(|row| row.iter().zip(wrench).map(|(c, w)| c * w).sum::<f64>());
        let curvature = Vec3([0, 1, 2].map(|i| strain[i] + REST[i]));
        let along = at.turn * Vec3([strain[3], strain[4], 1.0 + strain[5]]);
        (along, curvature, -along.cross(force))
    };
    let mut at = Here {
        place: Vec3::zero(),
        turn: Mat3::identity(),
        moment,
    };
    for _ in 0..steps {
        let stage = |t: Vec3, rates: (Vec3, Vec3, Vec3), by: f64| Here {
            place: at.place + rates.0 * by,
            turn: at.turn * lie::exp(t),
            moment: at.moment + rates.2 * by,
        };
        let zero = Vec3::zero();
        // inverse of the right Jacobian of the exponential, to second order
        let pull = |t: Vec3, u: Vec3| {
            let c = t.cross(u);
            u + c * 0.5 + t.cross(c) * (1.0 / 12.0)
        };
        let k1 = rate(&at);
        let t1 = k1.1;
        let k2 = rate(&stage(t1 * (0.5 * h), k1, 0.5 * h));
        let t2 = pull(t1 * (0.5 * h), k2.1);
        let k3 = rate(&stage(t2 * (0.5 * h), k2, 0.5 * h));
        let t3 = pull(t2 * (0.5 * h), k3.1);
        let k4 = rate(&stage(t3 * h, k3, h));
        let t4 = pull(t3 * h, k4.1);
        let mean = |a: Vec3, b: Vec3, c: Vec3, d: Vec3| (a + (b + c) * 2.0 + d) * (1.0 / 6.0);
        at = stage(
            mean(t1, t2, t3, t4) * h,
            (
                mean(k1.0, k2.0, k3.0, k4.0),
                zero,
                mean(k1.2, k2.2, k3.2, k4.2),
            ),
            h,
        );
    }
    at
}

/// Shoots for the moment at the base.
fn shoot(stiffness: &Stiffness, force: Vec3, moment: Vec3, steps: usize) -> Here {
    let compliance = inverse(stiffness);
    let mut base = moment;
    let miss = |base: Vec3| integrate(&compliance, force, base, steps).moment - moment;
    // the loads in steps, from a rod without force
    for share in [0.25, 0.5, 0.75, 1.0] {
        for _ in 0..12 {
            let miss = |b: Vec3| integrate(&compliance, force * share, b, steps).moment - moment;
            let at = miss(base);
            let columns = [0, 1, 2].map(|i| {
                let mut by = Vec3::zero();
                by[i] = 1e-6;
                (miss(base + by) - miss(base - by)) * 0.5e6
            });
            let by_columns = Mat3(columns.map(|c| c.0)).transpose();
            base -= by_columns.inverse() * at;
            if at.norm() < 1e-13 {
                break;
            }
        }
    }
    assert!(miss(base).norm() < 1e-12);
    integrate(&compliance, force, base, steps)
}

/// A tip wrench on random coupled rods: the tip is that of the integrated rod within the error
/// estimate, which falls with the elements.
#[test]
fn a_tip_wrench_bends_the_rod_as_integrated() {
    let mut least = [f64::INFINITY; 2];
    for number in 0..12 {
        let draw = &mut Draw::new(61, number);
        let stiffness = coupled(draw, SIZES, [0.2, 0.5, 0.8][number % 3]);
        let force = Vec3([0; 3].map(|_| draw.within(-0.6, 0.6)));
        let moment = Vec3([0; 3].map(|_| draw.within(-0.05, 0.05)));
        let expected = shoot(&stiffness, force, moment, 400);
        let profile = Profile::of_stiffness(stiffness, 0.0, 0.0, REST);
        let robot = rod(profile, LENGTH, 5);
        let mut errors = vec![];
        for elements in [1, 2, 4, 8] {
            let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
            let load = Load {
                tip_force: force.0,
                tip_moment: moment.0,
                ..Load::default()
            };
            let mut outcome = solved(&mut solver, &load);
            solver.estimate_error(&mut outcome);
            let tip = solver.tip().unwrap();
            let error = (tip.position - expected.place).norm();
            let turn = lie::log(&(tip.rotation.transpose() * expected.turn)).norm();
            let stated = outcome.error.unwrap().tip;
            assert!(
                error < stated.max(1e-9),
                "{number} {elements}: {error} {stated}"
            );
            errors.push((error, turn));
        }
        least = [
            least[0].min(errors[0].0 / errors[1].0),
            least[1].min(errors[0].1 / errors[2].1),
        ];
    }
    // fourth order in the rotation; that of the place is limited by the mean contact force
    assert!(least[0] > 2.5 && least[1] > 20.0, "{least:?}");
}
