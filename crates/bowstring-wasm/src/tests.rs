//! The bench beside the core's own solvers, and what it does without an equilibrium.

use crate::arcs::CurvatureLaw;
use crate::bench::Bench;
use crate::effects::Effect;
use crate::loads::Loads;
use bowstring_core::model::load::{Load, Model, TendonPath};
use bowstring_core::statics::adaptive::Adaptive;

/// Four disks of 1 g on 0.2 m of a 1 mm rod, three tendons 8 mm from it.
fn text() -> String {
    let disk = |k: usize| {
        format!(
            r#"{{"station_m": {}, "clamped_length_m": 0, "hole_length_m": 0, "mass_kg": 1e-3,
                "inertia_kg_m2": [3e-8, 5e-8], "segment": 0}}"#,
            0.05 * k as f64
        )
    };
    let tendon = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / 3.0;
        format!(
            r#"{{"holes_m": [[{}, {}]], "end_disk": 3, "compliance_m_per_N": 0, "pretension_N": 0,
                "max_tension_N": 10}}"#,
            0.008 * angle.cos(),
            0.008 * angle.sin()
        )
    };
    let list = |of: &dyn Fn(usize) -> String, range: std::ops::Range<usize>| {
        range.map(of).collect::<Vec<_>>().join(", ")
    };
    format!(
        r#"{{"format": "bowstring compiled robot", "format_version": 1, "tendon_path": "straight",
            "segments": [{{"sections": [[2.65e-3, 2.65e-3, 0, 2.04e-3, 4.24e4, 1.63e4, 5.07e-3,
            3.2e-10, 0, 0, 0]], "stiffness": null}}], "disks": [{}], "tendons": [{}],
            "payloads": [], "gravity_m_per_s2": [0, 0, 0]}}"#,
        list(&disk, 1..5),
        list(&tendon, 0..3)
    )
}

const UPRIGHT: Loads = Loads {
    gravity: [0.0, 0.0, -9.81],
    force: [0.01, 0.0, 0.0],
    moment: [0.0; 3],
};

fn tip(bench: &Bench) -> [f64; 3] {
    let poses = bench.disks();
    poses[poses.len() - 12..][..3].try_into().unwrap()
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

#[test]
fn the_pose_is_that_of_the_core() {
    let mut bench = Bench::new(&text()).unwrap();
    let tensions = [1.5, 0.2, 0.0];
    let found = bench.solve(false, &tensions, &UPRIGHT, true).unwrap();
    assert!(found.converged && found.residual < 1e-10 && found.error < 2e-6);
    let robot = bowstring_compiled::read(text().as_bytes()).unwrap().robot;
    let mut core = Adaptive::new(&robot, Model::default(), None).unwrap();
    let load: Load = UPRIGHT.with(&tensions);
    core.solve(&load).unwrap();
    let expected = core.solver().tip().unwrap().position.0;
    assert!(apart(tip(&bench), expected) < 1e-12);
    // the picture has its masses in points, and is the same within a thousandth of the length
    let drawn = &bench.fields().unwrap().disks.position;
    let drawn = drawn[drawn.len() - 3..].try_into().unwrap();
    assert!(apart(drawn, expected) < 2e-4);
}

#[test]
fn displacements_are_met_and_conflicts_keep_the_pose() {
    let mut bench = Bench::new(&text()).unwrap();
    let pulled = [0.004, -0.002, -0.002];
    assert!(
        bench
            .solve(true, &pulled, &Loads::default(), true)
            .unwrap()
            .converged
    );
    let fields = bench.fields().unwrap();
    assert!((fields.tendons.displacement[0] - 0.004).abs() < 1e-12);
    // the others are slack
    let [taut, slack, _] = bench.path_displacements()[..] else {
        panic!("three tendons")
    };
    assert!((taut - 0.004).abs() < 1e-9 && slack > -0.002 + 1e-6);
    let before = tip(&bench);
    // all three cannot be shortened by half the length
    let found = bench
        .solve(true, &[0.1; 3], &Loads::default(), false)
        .unwrap();
    assert!(!found.converged && !found.sentence.is_empty());
    assert_eq!(tip(&bench), before);
    assert!(bench
        .solve(false, &[1.0], &Loads::default(), false)
        .is_err());
    assert!(bench
        .solve(false, &[f64::NAN; 3], &Loads::default(), false)
        .is_err());
}

#[test]
fn an_effect_is_removed_alone() {
    let (plain, tensions) = (text(), [1.5, 0.2, 0.0]);
    let clamped = plain.replace(r#""clamped_length_m": 0"#, r#""clamped_length_m": 4e-3"#);
    let [plain, clamped] = [plain, clamped].map(|text| {
        let mut bench = Bench::new(&text).unwrap();
        bench.solve(false, &tensions, &UPRIGHT, true).unwrap();
        bench
    });
    let tip_without = |bench: &Bench, effect| {
        let found = bench.tip_without(effect, false, &tensions, &UPRIGHT);
        found.unwrap()
    };
    let free = tip_without(&clamped, Effect::Clamps).unwrap();
    assert!(apart(free, tip(&plain)) < 1e-9);
    assert!(apart(free, tip(&clamped)) > 1e-3);
    assert_eq!(tip_without(&plain, Effect::Clamps), None);
    assert_eq!(tip_without(&plain, Effect::HolePlanes), None);
    let mut core = Adaptive::new(
        &bowstring_compiled::read(text().as_bytes()).unwrap().robot,
        Model {
            tendon: TendonPath::Continuous,
            ..Model::default()
        },
        None,
    )
    .unwrap();
    core.solve(&UPRIGHT.with(&tensions)).unwrap();
    let expected = core.solver().tip().unwrap().position.0;
    let found = tip_without(&plain, Effect::StraightSpans).unwrap();
    assert!(apart(found, expected) < 1e-9);
    for effect in [Effect::ShearExtension, Effect::Torsion] {
        let moved = apart(tip_without(&plain, effect).unwrap(), tip(&plain));
        assert!(moved > 0.0 && moved < 1e-3, "{effect:?}: {moved}");
    }
    let displaced = |effect| plain.tip_without(effect, true, &[4e-3, 0.0, 0.0], &UPRIGHT);
    assert_eq!(displaced(Effect::StraightSpans).unwrap(), None);
    assert!(displaced(Effect::Torsion).unwrap().is_some());
    let few = plain.tip_without(Effect::Torsion, false, &[1.0], &UPRIGHT);
    assert!(few.is_err());
}

#[test]
fn stress_is_that_of_bending() {
    let mut bench = Bench::new(&text()).unwrap();
    bench.set_radii(&[0.5e-3], &[0.0]).unwrap();
    // one tendon bends nearly by T d everywhere, and compresses
    bench
        .solve(false, &[0.05, 0.0, 0.0], &Loads::default(), true)
        .unwrap();
    let (moment, radius) = (0.05 * 0.008, 0.5e-3f64);
    let bending = 4.0 * moment / (std::f64::consts::PI * radius.powi(3));
    let pressed = 0.05 / (std::f64::consts::PI * radius * radius);
    for stress in bench.stress() {
        assert!(
            (stress / (bending + pressed) - 1.0).abs() < 0.02,
            "{stress}"
        );
    }
    assert!(bench.set_radii(&[0.5e-3], &[0.6e-3]).is_err());
    assert!(bench.set_radii(&[], &[]).is_err());
}

#[test]
fn constant_curvature_bends_by_the_linear_law() {
    let bench = Bench::new(&text()).unwrap();
    let poses = bench
        .arcs()
        .poses(CurvatureLaw::Linear, &[0.3, 0.0, 0.0], 4)
        .unwrap();
    let bend: f64 = 0.3 * 0.008 * 0.2 / 2.65e-3;
    let expected = [
        0.2 * (1.0 - bend.cos()) / bend,
        0.0,
        0.2 * bend.sin() / bend,
    ];
    assert!(apart(poses[48..51].try_into().unwrap(), expected) < 1e-12);
    assert!(apart(poses[..3].try_into().unwrap(), [0.0; 3]) == 0.0);
    assert!(bench.arcs().poses(CurvatureLaw::Linear, &[0.3], 4).is_err());
    // straight tendons of the given lengths
    let lengths = bench
        .arcs()
        .poses(CurvatureLaw::Lengths, &[0.0; 3], 1)
        .unwrap();
    assert!(apart(lengths[12..15].try_into().unwrap(), [0.0, 0.0, 0.2]) < 1e-12);
}

#[test]
fn the_tip_goes_to_a_point_within_reach() {
    let mut bench = Bench::new(&text()).unwrap();
    bench
        .solve(false, &[0.9, 0.3, 0.0], &UPRIGHT, true)
        .unwrap();
    let point = tip(&bench);
    for warm in [false, true] {
        let found = bench.reach(point, &[5.0; 3], &UPRIGHT, warm).unwrap();
        let tensions = found.unwrap().to_vec();
        assert!(tensions.iter().all(|t| (0.0..=5.0).contains(t)));
        bench.solve(false, &tensions, &UPRIGHT, true).unwrap();
        let missed = apart(tip(&bench), point);
        assert!(missed < 5e-3 * 0.2, "{missed}");
    }
    // beyond reach the tip comes as near as the tensions allow
    let far = [1.0, 0.0, 0.1];
    let tensions = bench.reach(far, &[5.0; 3], &UPRIGHT, true).unwrap();
    assert!(tensions.unwrap()[0] > 0.1);
    assert!(bench
        .reach([f64::NAN; 3], &[5.0; 3], &UPRIGHT, true)
        .is_err());
    assert!(bench.reach(far, &[5.0; 2], &UPRIGHT, true).is_err());
}

#[test]
fn a_released_robot_swings_and_rests() {
    let mut bench = Bench::new(&text()).unwrap();
    assert!(bench.advance(0.1).is_err());
    bench
        .solve(false, &[0.5, 0.0, 0.0], &Loads::default(), true)
        .unwrap();
    let start = tip(&bench);
    bench
        .release(&[0.0; 3], &Loads::default(), 0.05, 8.0)
        .unwrap();
    let (mut least, mut fastest) = (start[0], 0.0f64);
    for _ in 0..180 {
        assert_eq!(bench.advance(1.0 / 60.0).unwrap(), "");
        least = least.min(tip(&bench)[0]);
        fastest = fastest.max(bench.kinetic_energy());
    }
    assert!(least < -0.3 * start[0]); // beyond the straight pose
    assert!(fastest > 0.0 && bench.kinetic_energy() < 1e-6 * fastest);
    assert!(apart(tip(&bench), [0.0, 0.0, 0.2]) < 1e-4);
    assert!(bench
        .release(&[0.0; 2], &Loads::default(), 0.0, 1.0)
        .is_err());
    assert!(bench
        .release(&[0.0; 3], &Loads::default(), f64::NAN, 1.0)
        .is_err());
}
