//! Derivatives of equilibria against central differences, and Maxwell's reciprocity.

mod common;
use bowstring_core::math::lie;
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Load, Model, Theory};
use bowstring_core::model::robot::Robot;
use bowstring_core::rod::sensitivity::Derivative;
use bowstring_core::statics::solver::{Solver, Status};
use common::study_robot;

const TENSIONS: [f64; 3] = [60.0, 15.0, 25.0];
const FORCE: [f64; 3] = [-0.4, 0.8, 0.3];

/// Tip and lengths after a change of one parameter.
fn solution(
    robot: &Robot,
    theory: Theory,
    elements: usize,
    tensions: [f64; 3],
    force: [f64; 3],
    moment: [f64; 3],
) -> (Mat3, Vec3, Vec<f64>) {
    let model = Model {
        theory,
        ..Model::default()
    };
    let mut solver = Solver::new(robot, model, elements).unwrap();
    let load = Load {
        tensions: &tensions,
        gravity: [1.0, 2.0, -9.81],
        tip_force: force,
        tip_moment: moment,
        ..Load::default()
    };
    let outcome = solver.solve(&load).unwrap();
    assert_eq!(outcome.status, Status::Converged);
    let tip = solver.tip().unwrap();
    (
        tip.rotation,
        tip.position,
        (0..3).map(|i| solver.tendon_length(i).unwrap()).collect(),
    )
}

fn stiffer(clamp: f64, factor: f64) -> Robot {
    let mut spec = study_robot(9, clamp).spec().clone();
    let s = &mut spec.backbone[0].sections_mut()[0];
    let [x, y] = &mut s.bending;
    for v in [x, y, &mut s.torsion, &mut s.axial, &mut s.shear] {
        *v *= factor;
    }
    Robot::new(spec).unwrap()
}

fn compare(
    found: &Derivative,
    plus: (Mat3, Vec3, Vec<f64>),
    minus: (Mat3, Vec3, Vec<f64>),
    step: f64,
    what: &str,
) {
    let per = 0.5 / step;
    let position = (plus.1 - minus.1) * per;
    let rotation = lie::log(&(plus.0 * minus.0.transpose())) * per;
    let scale = position.norm().max(1e-3);
    assert!(
        (found.position - position).norm() < 2e-6 * scale,
        "{what}: {:?} {position:?}",
        found.position
    );
    assert!(
        (found.rotation - rotation).norm() < 2e-6 * rotation.norm().max(1e-3),
        "{what}: {:?} {rotation:?}",
        found.rotation
    );
    for i in 0..3 {
        let length = (plus.2[i] - minus.2[i]) * per;
        assert!(
            (found.lengths[i] - length).abs() < 2e-6 * scale,
            "{what}: length {i}"
        );
    }
}

#[test]
fn derivatives_match_central_differences() {
    for (theory, clamp, elements, moment) in [
        (Theory::Kirchhoff, 0.0, 1, [0.0; 3]),
        (Theory::Cosserat, 0.003, 1, [0.0; 3]),
        (Theory::Cosserat, 0.003, 4, [0.0; 3]),
        (Theory::Cosserat, 0.003, 1, [0.05, -0.1, 0.2]),
    ] {
        let robot = study_robot(9, clamp);
        let mut solver = Solver::new(
            &robot,
            Model {
                theory,
                ..Model::default()
            },
            elements,
        )
        .unwrap();
        let load = Load {
            tensions: &TENSIONS,
            gravity: [1.0, 2.0, -9.81],
            tip_force: FORCE,
            tip_moment: moment,
            ..Load::default()
        };
        assert_eq!(solver.solve(&load).unwrap().status, Status::Converged);
        let j = solver.jacobians(false).unwrap();
        let solve = |t, f, m| solution(&robot, theory, elements, t, f, m);
        for i in 0..3 {
            let shifted = |base: [f64; 3], step: f64| {
                let mut v = base;
                v[i] += step;
                v
            };
            let s = 1e-3;
            compare(
                &j.tensions[i],
                solve(shifted(TENSIONS, s), FORCE, moment),
                solve(shifted(TENSIONS, -s), FORCE, moment),
                s,
                "tension",
            );
            let s = 1e-4;
            compare(
                &j.tip_force[i],
                solve(TENSIONS, shifted(FORCE, s), moment),
                solve(TENSIONS, shifted(FORCE, -s), moment),
                s,
                "force",
            );
            compare(
                &j.tip_moment[i],
                solve(TENSIONS, FORCE, shifted(moment, s)),
                solve(TENSIONS, FORCE, shifted(moment, -s)),
                s,
                "moment",
            );
        }
        let s = 1e-4;
        compare(
            &j.stiffness[0],
            solution(
                &stiffer(clamp, 1.0 + s),
                theory,
                elements,
                TENSIONS,
                FORCE,
                moment,
            ),
            solution(
                &stiffer(clamp, 1.0 - s),
                theory,
                elements,
                TENSIONS,
                FORCE,
                moment,
            ),
            s,
            "stiffness",
        );
        if moment == [0.0; 3] {
            // reciprocity: the displacement at the second place due to a force at the first equals
            // the reverse
            for a in 0..3 {
                for b in 0..3 {
                    let pairs = [
                        (j.tensions[a].lengths[b], j.tensions[b].lengths[a]),
                        (j.tip_force[a].position[b], j.tip_force[b].position[a]),
                        (j.tensions[a].position[b], -j.tip_force[b].lengths[a]),
                        (j.tip_moment[a].position[b], j.tip_force[b].rotation[a]),
                    ];
                    for (x, y) in pairs {
                        assert!((x - y).abs() < 1e-11, "{x} {y}");
                    }
                }
            }
        }
    }
}
