//! Lumped inertia, and the balance of momentum with the base.

use super::mass::Nodal;
use super::{Damping, Motion, Moving};
use crate::math::linalg::Vec3;
use crate::math::real::Scalar;
use crate::model::load::{Load, Model};
use crate::model::robot::{Profile, Robot, Section};
use crate::parts;
use crate::rod::routes::in_group;

/// Clamps on a tapered backbone have the mass that weighs in statics.
#[test]
fn tapered_clamps_have_the_mass_of_their_weight() {
    let at = |fraction: f64| {
        let diameter: f64 = 1.0 - 0.6 * fraction;
        Section {
            mass_per_length: 0.035 * diameter.powi(2),
            ..parts::section(1.1)
        }
    };
    let mut spec = parts::robot(&[], &[3], [0.07, 0.03], 0.0, &[2]);
    let sections = [0.0, 0.25, 0.5, 0.75, 1.0].map(at);
    spec.backbone = vec![Profile::Tapered(Box::new(sections))];
    let robot = Robot::new(spec).unwrap();
    let backbone = robot.length() * robot.spec().backbone[0].mean(0.0, 1.0, |s| s.mass_per_length);
    let disks: f64 = robot.spec().disks.iter().map(|disk| disk.mass).sum();
    assert!((robot.mass() / (backbone + disks) - 1.0).abs() < 1e-12);
    assert_eq!(robot.with_stiffness(&[1.0]).unwrap().mass(), robot.mass());
    let still = Damping {
        mass: 0.0,
        material: 0.0,
    };
    let model = Model::default();
    let motion = Motion::<Scalar, 2>::new(Scalar, &robot, model, [0.0; 3], still);
    // the node at the base does not move; Simpson's rule gives it a sixth
    let at_base = at(0.0).mass_per_length * robot.flexible_length(0) / 6.0;
    let total = motion.body.mass.total + at_base;
    assert!((total / robot.mass() - 1.0).abs() < 1e-12);
}

/// Rotated as a rigid body, the straight robot has the inertia of its disks and of the whole rod,
/// clamped lengths included.
#[test]
fn rigid_rotation_has_the_inertia_of_the_rod() {
    let section = parts::section(1.1);
    let mut spec = parts::robot(&[section], &[4], [0.07, 0.05], 0.0, &[3]);
    // 20 mm between all clamps; the last disk would clamp on one side only, and clamps nothing here
    spec.disks.iter_mut().for_each(|disk| disk.station -= 0.025);
    (spec.disks[3].station, spec.disks[3].clamped_length) = (0.23, 0.0);
    spec.disks.iter_mut().for_each(|disk| disk.mass = 0.002);
    let robot = Robot::new(spec).unwrap();
    let still = Damping {
        mass: 0.0,
        material: 0.0,
    };
    let model = Model::default();
    let mut motion = Motion::<Scalar, 2>::new(Scalar, &robot, model, [0.0; 3], still);
    assert!(motion.settle());
    let masses = &motion.body.mass.points;
    let points = motion.kinematics.position.iter().flat_map(|p| p.points);
    let points = masses.iter().zip(points);
    let lumped: f64 = points.map(|(m, p)| m * p.0[2].powi(2)).sum();
    // directors perpendicular to the axis and along it move
    let turning: f64 = motion
        .body
        .mass
        .directors
        .iter()
        .map(|[e1, e3]| e1 + e3)
        .sum();
    let length = robot.length();
    let mut whole = section.mass_per_length * length.powi(3) / 3.0;
    // the rotary inertia of the first half module belongs to the base
    whole += section.rotary_inertia * (length - robot.modules[0].flexible / 2.0);
    for disk in &robot.spec().disks {
        whole += disk.mass * disk.station.powi(2) + disk.inertia[0];
    }
    let off = (lumped + turning) / whole - 1.0;
    assert!(off.abs() < 1e-12, "{off:e}");
}

/// The change of momentum in one step equals the load less the reaction of the base, from the
/// strain of the first module and the spans that leave the base. The module's node between the
/// arcs, whose weight also acts on the base, is left out on both sides.
#[test]
fn momentum_balances_with_the_base() {
    let spec = parts::robot(&[parts::section(1.1)], &[9], [0.07, 0.0], 2.0, &[8; 3]);
    let robot = Robot::new(spec).unwrap();
    let gravity = Vec3([1.0, 2.0, -9.0]);
    let damping = Damping {
        mass: 0.7,
        material: 2e-3,
    };
    for rho in [1.0, 0.8, 0.5] {
        let mut motion =
            Motion::<Scalar, 2>::new(Scalar, &robot, Model::default(), gravity.0, damping);
        let tensions = [20.0, 0.0, 5.0];
        let mut load = Load {
            tensions: &tensions,
            gravity: gravity.0,
            tip_force: [0.0, 0.3, 0.1],
            ..Load::default()
        };
        motion.set_load(&load);
        assert!(motion.settle());
        load.tip_force = [0.0; 3];
        motion.set_load(&load);
        let duration = 2e-3;
        let beyond: f64 = motion.body.mass.points[1..].iter().sum();
        let mut momentum = Vec3::zero();
        for step in 0..40 {
            let start = motion.kinematics.acceleration.clone();
            motion.begin(duration, rho);
            for _ in 0..12 {
                motion.residual();
                motion.ready(true);
                motion.substitute();
                motion.combine(&[1.0]);
            }
            motion.residual();
            motion.finish(&load);
            // reaction of the base: from the strain and the spans of the first module
            let rod = &motion.body.rod;
            let (state, c) = (&rod.states[0], &rod.constants[0]);
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, 0);
            let strained = state.compliance(c, &t).inverse() * (state.rho - state.rho0);
            let mut held = strained * motion.body.scheme.force_factor() - motion.strain.offset[0].n;
            // this is the mean over the module: half of the force on its node does not reach the
            // base
            held -= motion.residual.modules[0].nodes[0] * 0.5;
            let end = state.offset(c);
            for (tendon, tension) in robot.spec().tendons.iter().zip(tensions) {
                let [x, y] = tendon.holes[0];
                let hole = Vec3([x, y, 0.0]);
                let span = end + state.s * hole - hole;
                held += span * (tension / span.norm());
            }
            // acceleration of the scheme at the balance of forces, with its damping
            let (am, af) = (motion.body.scheme.am, motion.body.scheme.af);
            let mut changes = Vec3::zero();
            let fresh = motion.body.scheme.fresh;
            motion.commit();
            let now = &motion.kinematics;
            for p in 1..motion.body.mass.points.len() {
                let of = |of: &[Nodal<f64, 2>]| of[p / 2].points[p % 2];
                let ends = if fresh {
                    of(&now.acceleration)
                } else {
                    of(&start) * (1.0 - am) + of(&now.acceleration) * am
                };
                let speed = of(&now.next_velocity) * (1.0 - af) + of(&now.velocity) * af;
                changes += (ends + speed * damping.mass) * motion.body.mass.points[p];
            }
            let force = gravity * beyond - held;
            let off = (changes - force).norm() / (gravity * beyond).norm();
            assert!(off < 1e-6, "{rho} {step}: {off:e}");
            // without numerical damping this is the change of momentum
            let mut now = Vec3::zero();
            let mut drag = Vec3::zero();
            for p in 1..motion.body.mass.points.len() {
                let of = |of: &[Nodal<f64, 2>]| of[p / 2].points[p % 2];
                let velocity = of(&motion.kinematics.velocity);
                let speeds = of(&motion.kinematics.next_velocity) + velocity;
                now += velocity * motion.body.mass.points[p];
                drag += speeds * (0.5 * damping.mass * motion.body.mass.points[p]);
            }
            let gain = (now - momentum) * (1.0 / duration);
            if rho == 1.0 {
                let off = (gain + drag - force).norm() / (gravity * beyond).norm();
                assert!(off < 1e-6, "{step}: {off:e}");
                assert!(gain.norm() > 1e-3 || step > 0);
            }
            momentum = now;
        }
        assert!(momentum.norm() > 1e-3, "it moves");
    }
}
