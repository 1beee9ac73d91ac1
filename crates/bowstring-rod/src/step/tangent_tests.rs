//! Tangents against finite differences of the residual at random strains, for each kind of load.

use crate::math::linalg::Vec3;
use crate::math::real::Scalar;
use crate::model::load::{Load, Model, PointLoad, TendonPath, Theory};
use crate::model::robot::{Robot, RobotSpec, Section};
use crate::parts;
use crate::random::Draw;
use crate::rod::chain::Rod;
use crate::step::{Damping, Motion, Moving};

fn vector(draw: &mut Draw, size: f64) -> Vec3 {
    Vec3([0; 3].map(|_| draw.within(-size, size)))
}

/// Four modules with enough shear and extension to affect the results.
fn robot() -> Robot {
    let section = Section {
        axial: 900.0,
        shear: 400.0,
        mass_per_length: 0.9,
        rotary_inertia: 2e-5,
        ..parts::section(1.1)
    };
    let mut spec = parts::robot(&[section], &[4], [0.07, 0.004], 2.0, &[2, 3, 3]);
    spec.disks.iter_mut().for_each(|disk| disk.mass = 0.05);
    Robot::new(spec).unwrap()
}

const DISK_FORCES: [[f64; 3]; 4] = [
    [2.0, -3.0, 5.0],
    [0.0; 3],
    [-4.0, 1.0, -9.0],
    [1.0, 2.0, 3.0],
];
const DISK_MOMENTS: [[f64; 3]; 4] = [
    [0.3, 0.2, -0.4],
    [-0.5, 0.1, 0.3],
    [0.0; 3],
    [0.1, 0.2, 0.2],
];

const LINE_FORCES: [[f64; 3]; 4] = [
    [10.0, -30.0, 50.0],
    [0.0; 3],
    [-40.0, 10.0, -90.0],
    [10.0, 20.0, 30.0],
];
const DEAD_AT_POINT: PointLoad = PointLoad {
    disk: 1,
    arc_length: None,
    point: [0.02, -0.01, 0.03],
    force: [3.0, -5.0, 8.0],
    moment: [0.0; 3],
    follower: false,
};
const FOLLOWER_FORCE: PointLoad = PointLoad {
    disk: 3,
    arc_length: None,
    point: [0.0; 3],
    force: [2.0, 3.0, -6.0],
    moment: [0.0; 3],
    follower: true,
};
const FOLLOWER_MOMENT: PointLoad = PointLoad {
    disk: 2,
    arc_length: None,
    point: [0.0; 3],
    force: [0.0; 3],
    moment: [0.2, -0.4, 0.3],
    follower: true,
};
const FOLLOWER_AT_POINT: PointLoad = PointLoad {
    disk: 1,
    arc_length: None,
    point: [0.03, 0.01, -0.02],
    force: [-4.0, 2.0, 5.0],
    moment: [0.3, 0.1, -0.2],
    follower: true,
};
const DEAD_MOMENT_AT_POINT: PointLoad = PointLoad {
    disk: 3,
    arc_length: None,
    point: [-0.02, 0.03, 0.01],
    force: [1.0, 2.0, -3.0],
    moment: [0.1, -0.2, 0.4],
    follower: false,
};

/// Loads of one kind each, and all together.
fn loads() -> Vec<(&'static str, Robot, Load<'static>)> {
    let none = Load {
        tensions: &[0.0; 3],
        ..Load::default()
    };
    let with = |change: &dyn Fn(&mut RobotSpec)| {
        let mut spec = robot().spec().clone();
        change(&mut spec);
        Robot::new(spec).unwrap()
    };
    let gravity = [6.0, 30.0, -60.0];
    vec![
        ("no load", robot(), none),
        (
            "tension",
            robot(),
            Load {
                tensions: &[20.0, 5.0, 8.0],
                ..none
            },
        ),
        (
            "disk weight",
            with(&|s| s.backbone[0].sections_mut()[0].mass_per_length = 0.0),
            Load { gravity, ..none },
        ),
        (
            "backbone weight",
            with(&|s| s.disks.iter_mut().for_each(|d| d.mass = 0.0)),
            Load { gravity, ..none },
        ),
        (
            "tip force",
            robot(),
            Load {
                tip_force: [1.0, -4.0, -15.0],
                ..none
            },
        ),
        (
            "tip moment",
            robot(),
            Load {
                tip_moment: [0.5, -0.3, 0.4],
                ..none
            },
        ),
        (
            "disk forces",
            robot(),
            Load {
                disk_forces: &DISK_FORCES,
                ..none
            },
        ),
        (
            "disk moments",
            robot(),
            Load {
                disk_moments: &DISK_MOMENTS,
                ..none
            },
        ),
        (
            "all forces",
            robot(),
            Load {
                tensions: &[20.0, 5.0, 8.0],
                gravity,
                tip_force: [1.0, -4.0, -15.0],
                disk_forces: &DISK_FORCES,
                ..none
            },
        ),
        (
            "all",
            robot(),
            Load {
                tensions: &[20.0, 5.0, 8.0],
                gravity,
                tip_force: [1.0, -4.0, -15.0],
                tip_moment: [0.5, -0.3, 0.4],
                disk_forces: &DISK_FORCES,
                disk_moments: &DISK_MOMENTS,
                point_loads: &[
                    FOLLOWER_FORCE,
                    DEAD_AT_POINT,
                    FOLLOWER_AT_POINT,
                    FOLLOWER_MOMENT,
                    DEAD_MOMENT_AT_POINT,
                ],
                line_forces: &LINE_FORCES,
                ..none
            },
        ),
        (
            "forces per length",
            robot(),
            Load {
                line_forces: &LINE_FORCES,
                ..none
            },
        ),
        (
            "dead force off the centre",
            robot(),
            Load {
                point_loads: &[DEAD_AT_POINT],
                ..none
            },
        ),
        (
            "follower force",
            robot(),
            Load {
                point_loads: &[FOLLOWER_FORCE],
                ..none
            },
        ),
        (
            "follower moment",
            robot(),
            Load {
                point_loads: &[FOLLOWER_MOMENT],
                ..none
            },
        ),
        (
            "two followers",
            robot(),
            Load {
                point_loads: &[FOLLOWER_FORCE, FOLLOWER_AT_POINT],
                ..none
            },
        ),
    ]
}

const MODELS: [Model; 3] = [
    Model {
        theory: Theory::Cosserat,
        tendon: TendonPath::Straight,
        twist: true,
    },
    Model {
        theory: Theory::Kirchhoff,
        tendon: TendonPath::Straight,
        twist: true,
    },
    Model {
        theory: Theory::Cosserat,
        tendon: TendonPath::Continuous,
        twist: true,
    },
];

fn statics<const A: usize>() {
    let mut draw = Draw::new(A as u64, 0);
    for (kind, robot, load) in loads() {
        for model in MODELS {
            let n = robot.module_count();
            let mut rod = Rod::<Scalar, A>::new(Scalar, &robot, model);
            rod.load(&load);
            let strain: Vec<_> = (0..A * n)
                .map(|_| vector(&mut draw, 0.6 / A as f64))
                .collect();
            let ahead: Vec<_> = (0..A * n).map(|_| vector(&mut draw, 1.0)).collect();
            // derivative of the energy with respect to the strain
            let gradient = |rod: &mut Rod<Scalar, A>, step: f64| {
                rod.make_unloaded();
                rod.set_strains(|i| ahead[i].scaled_add(step, strain[i]));
                let energy = rod.evaluate();
                rod.gradient();
                let by_strain = (0..A * n).map(|i| {
                    let own = &rod.gradients[i / A];
                    own.to_strain[i % A].inverse().tr_mul(own.g[i % A])
                });
                (energy, by_strain.collect::<Vec<_>>())
            };
            let h = 1e-5;
            let (up, down) = (gradient(&mut rod, h), gradient(&mut rod, -h));
            let here = gradient(&mut rod, 0.0).1;
            let symmetric = load.has_potential();
            if symmetric {
                let slope: f64 = here.iter().zip(&ahead).map(|(g, d)| g.dot(*d)).sum();
                let found = (up.0 - down.0) / (2.0 * h);
                let off = (found - slope).abs() / slope.abs().max(1e-3);
                assert!(off < 1e-6, "{kind} {model:?} {A}: slope {off:e}");
            }
            rod.linearise();
            if symmetric {
                rod.eliminate::<true>(0.0);
            } else {
                rod.eliminate::<false>(0.0);
            }
            let change: Vec<_> = (0..A * n)
                .map(|i| {
                    let by_strain = (up.1[i] - down.1[i]) * (0.5 / h);
                    rod.gradients[i / A].to_strain[i % A].tr_mul(by_strain)
                })
                .collect();
            rod.set_gradient(|i| change[i]);
            if symmetric {
                rod.newton_step::<true>();
            } else {
                rod.newton_step::<false>();
            }
            rod.make_unloaded();
            rod.save();
            rod.advance(1.0);
            let mut worst: f64 = 0.0;
            rod.strains(|i, w| worst = worst.max((w + ahead[i]).max_abs()));
            assert!(worst < 1e-5, "{kind} {model:?} {A}: tangent {worst:e}");
        }
    }
}

#[test]
fn statics_tangent_is_the_derivative_of_the_residual() {
    statics::<2>();
    statics::<4>();
    statics::<8>();
}

/// Difference between the tangent at rest and finite differences of the residual, at strains and
/// contact forces along a line; the forces start from the balance of all ends.
fn tangent_error<const A: usize>(
    motion: &mut Motion<Scalar, A>,
    strain: impl Fn(usize, f64) -> Vec3,
    force: impl Fn(usize, f64) -> Vec3,
) -> f64 {
    let n = motion.module_count();
    motion.begin_at_rest();
    let mut balanced: Vec<Vec3> = (0..n).map(|k| force(k, 0.0)).collect();
    let at = |motion: &mut Motion<Scalar, A>, step: f64, balanced: &[Vec3]| {
        for k in 0..n {
            for a in 0..A {
                motion.next[k].w[a] = strain(k * A + a, step);
            }
            motion.next[k].n = balanced[k] + (force(k, step) - force(k, 0.0));
        }
        motion.residual();
        let mut out = vec![];
        for k in 0..n {
            let gradient = &motion.body.rod.gradients[k];
            for a in 0..A {
                out.push(gradient.to_strain[a].inverse().tr_mul(gradient.g[a]));
            }
            out.push(motion.residual.modules[k].imbalance);
        }
        out
    };
    for _ in 0..200 {
        let off = at(motion, 0.0, &balanced);
        for (k, n) in balanced.iter_mut().enumerate() {
            *n -= off[k * (A + 1) + A] * 0.5;
        }
    }
    let h = 1e-5;
    let (up, down) = (at(motion, h, &balanced), at(motion, -h, &balanced));
    at(motion, 0.0, &balanced);
    motion.ready(true);
    for k in 0..n {
        for a in 0..=A {
            let change = (up[k * (A + 1) + a] - down[k * (A + 1) + a]) * (0.5 / h);
            if a < A {
                let gradient = &mut motion.body.rod.gradients[k];
                gradient.g[a] = gradient.to_strain[a].tr_mul(change);
            } else {
                motion.residual.modules[k].imbalance = change;
            }
        }
    }
    motion.substitute();
    motion.combine(&[1.0]);
    let mut worst: f64 = 0.0;
    for k in 0..n {
        for a in 0..A {
            let back = strain(k * A + a, 1.0) - strain(k * A + a, 0.0);
            let moved = motion.next[k].w[a] - strain(k * A + a, 0.0);
            worst = worst.max((moved + back).max_abs());
        }
        let back = force(k, 1.0) - force(k, 0.0);
        let moved = motion.next[k].n - balanced[k];
        worst = worst.max((moved + back).max_abs() / 10.0);
    }
    worst
}

fn at_rest<const A: usize>() {
    let mut draw = Draw::new(A as u64, 1);
    let undamped = Damping {
        mass: 0.0,
        material: 0.0,
    };
    for (kind, robot, load) in loads() {
        for model in MODELS {
            let n = robot.module_count();
            let mut motion =
                Motion::<Scalar, A>::new(Scalar, &robot, model, load.gravity, undamped);
            motion.set_load(&load);
            let strain: Vec<_> = (0..A * n)
                .map(|_| vector(&mut draw, 0.6 / A as f64))
                .collect();
            let ahead: Vec<_> = (0..A * n).map(|_| vector(&mut draw, 1.0)).collect();
            let force: Vec<_> = vec![Vec3::zero(); n];
            let force_ahead: Vec<_> = (0..n).map(|_| vector(&mut draw, 10.0)).collect();
            let worst = tangent_error(
                &mut motion,
                |i, step| ahead[i].scaled_add(step, strain[i]),
                |k, step| force_ahead[k].scaled_add(step, force[k]),
            );
            assert!(worst < 1e-5, "{kind} {model:?} {A}: tangent {worst:e}");
        }
    }
}

#[test]
fn tangent_at_rest_is_the_derivative_of_the_residual() {
    at_rest::<2>();
    at_rest::<4>();
    at_rest::<8>();
}
