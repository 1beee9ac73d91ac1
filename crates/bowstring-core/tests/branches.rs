//! Branches of equilibria against classical buckling loads.

mod common;

use bowstring_core::model::load::{Load, OwnedLoad, PointLoad, RodModel};
use bowstring_core::model::robot::{Robot, Section, Tendon};
use bowstring_core::statics::branches::{
    diagram, Diagram, End, EventKind, LoadPath, Point, Search,
};
use common::{hole, rod};
use std::f64::consts::PI;

const BENDING: f64 = 1.3;
const LENGTH: f64 = 0.7;

fn column(disks: usize, mass_per_length: f64) -> Robot {
    let section = Section {
        bending: [BENDING; 2],
        principal_angle: 0.0,
        torsion: 0.8 * BENDING,
        axial: 1e6,
        shear: 1e6,
        mass_per_length,
        rotary_inertia: 1e-6,
        rest_curvature: [0.0; 3],
    };
    let mut spec = rod(section.into(), LENGTH, disks).spec().clone();
    let angles = [0.0, 120.0, 240.0];
    spec.tendons = angles
        .map(|a| Tendon::parallel(hole(0.01, a), disks - 1))
        .to_vec();
    Robot::new(spec).unwrap()
}

fn kirchhoff() -> RodModel {
    RodModel {
        model: common::kirchhoff(),
        elements: None,
    }
}

fn path(to: Load) -> LoadPath {
    let from = OwnedLoad {
        tensions: vec![0.0; 3],
        ..OwnedLoad::default()
    };
    let mut end = from.clone();
    end.set(&to);
    LoadPath { from, to: end }
}

fn found(robot: &Robot, to: Load, search: Search) -> Diagram {
    diagram(robot, &kirchhoff(), &path(to), &search).unwrap()
}

fn compressed(force: f64) -> Load<'static> {
    Load {
        tensions: &[0.0; 3],
        tip_force: [0.0, 0.0, -force],
        ..Load::default()
    }
}

/// Checks the first bifurcation of the straight branch, and stability on both sides of it.
fn check_first(diagram: &Diagram, factor: f64, multiplicity: usize) {
    let straight = &diagram.branches[0];
    let event = straight.events[0];
    assert_eq!(event.kind, EventKind::Bifurcation);
    assert_eq!(event.multiplicity, multiplicity);
    let critical = straight.points[event.point].factor;
    assert!(
        (critical / factor - 1.0).abs() < 1e-4,
        "{critical} {factor}"
    );
    for point in &straight.points {
        assert!(point.residual < 1e-10);
        if (point.factor / factor - 1.0).abs() > 1e-4 {
            assert_eq!(
                point.stable,
                Some(point.factor < factor),
                "{}",
                point.factor
            );
        }
    }
}

#[test]
fn euler_column_buckles_at_its_load() {
    let euler = PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let robot = column(9, 0.0);
    let all = found(&robot, compressed(10.0 * euler), Search::default());
    check_first(&all, 0.1, 2);
    let straight = &all.branches[0];
    assert_eq!(straight.events.len(), 2);
    let second = straight.points[straight.events[1].point].factor;
    assert!((second - 0.9).abs() < 1e-4, "{second}");
    // of the family that buckles in any plane, one branch
    let buckled = &all.branches[1];
    assert_eq!(buckled.origin, Some((0, 0)));
    assert_eq!(buckled.end, End::Range);
    assert!(buckled.points[1..].iter().all(|p| p.stable.is_none()));
    assert!(buckled.points[1..]
        .iter()
        .all(|p| p.unstable_modes == Some(0)));
    let second = &all.branches[2];
    assert_eq!(second.end, End::Range);
    assert!(second.points[1..].iter().all(|p| p.stable == Some(false)));
    // elastica with an end angle of 20 and 60 degrees: force over that of Euler
    for (angle, ratio, z) in [(20.0_f64, 1.015, 0.970), (60.0, 1.152, 0.741)] {
        let at = |p: &Point| p.disks.last().unwrap().rotation.0[2][2].acos().to_degrees();
        let pair = buckled
            .points
            .windows(2)
            .find(|p| at(&p[1]) > angle)
            .unwrap();
        let share = (angle - at(&pair[0])) / (at(&pair[1]) - at(&pair[0]));
        let mix = |of: &dyn Fn(&Point) -> f64| of(&pair[0]) + share * (of(&pair[1]) - of(&pair[0]));
        assert!((mix(&|p| p.factor) * 10.0 - ratio).abs() < 1e-3);
        assert!((mix(&|p| p.disks.last().unwrap().position[2]) / LENGTH - z).abs() < 1e-3);
    }
}

/// Euler's column is as long as the part before the load; one branch of its family is followed,
/// whatever the rounding of the load factor.
#[test]
fn a_column_loaded_between_disks_buckles_once_at_eulers_load() {
    let robot = column(9, 0.0);
    for (at, over, most) in [
        (0.33, 1.07, 1.0),
        (0.33, 1.3, 1.0),
        (0.6, 1.07, 1.0),
        (0.1, 1.1, 1.0),
        (0.45, 1.21, 1.0),
        (0.45, 1.33, 1.0),
        (0.2, 1.17, 1.0),
        (0.33, 1.1, 1.3),
    ] {
        let euler = PI * PI * BENDING / (4.0 * at * at);
        let point_loads = [PointLoad {
            arc_length: Some(at),
            force: [0.0, 0.0, -over * euler],
            ..PointLoad::default()
        }];
        let to = Load {
            point_loads: &point_loads,
            ..compressed(0.0)
        };
        let search = Search {
            most,
            ..Search::default()
        };
        let all = found(&robot, to, search);
        check_first(&all, 1.0 / over, 2);
        let ends: Vec<_> = all.branches.iter().map(|b| (b.origin, b.end)).collect();
        assert_eq!(
            ends,
            [(None, End::Range), (Some((0, 0)), End::Range)],
            "{at} {over}"
        );
        assert!(!all.deflated && all.complete);
        for branch in &all.branches {
            assert_eq!(branch.points.last().unwrap().factor, most);
        }
        // the elastica with an end angle of 20 degrees
        let angle = |p: &Point| p.disks.last().unwrap().rotation.0[2][2].acos().to_degrees();
        let buckled = all.branches[1].points.windows(2);
        let [a, b] = buckled
            .map(|pair| [&pair[0], &pair[1]])
            .find(|[_, b]| angle(b) > 20.0)
            .unwrap();
        let share = (20.0 - angle(a)) / (angle(b) - angle(a));
        let factor = a.factor + share * (b.factor - a.factor);
        assert!((factor * over - 1.0154).abs() < 1e-3, "{factor}");
    }
}

/// Base angle and tip of a rod under its weight and a force at an arc length, integrated from the
/// tip.
fn heavy_elastica(tip_angle: f64, force: [f64; 2], at: f64, weight: f64) -> [f64; 3] {
    let steps = 4000;
    let h = LENGTH / f64::from(steps);
    let rate = |share: f64, beyond: f64, [angle, moment, ..]: [f64; 4]| {
        let axial = share * force[1] - weight * beyond;
        let of_moment = share * force[0] * angle.cos() - axial * angle.sin();
        [-moment / BENDING, of_moment, angle.sin(), angle.cos()]
    };
    let mut y = [tip_angle, 0.0, 0.0, 0.0];
    for i in 0..steps {
        let beyond = h * f64::from(i);
        let share = f64::from(u8::from(LENGTH - beyond < at + 0.5 * h));
        let rate = |beyond: f64, y: [f64; 4]| rate(share, beyond, y);
        let ahead = |k: [f64; 4], by: f64| [0, 1, 2, 3].map(|q| y[q] + by * k[q]);
        let a = rate(beyond, y);
        let b = rate(beyond + 0.5 * h, ahead(a, 0.5 * h));
        let c = rate(beyond + 0.5 * h, ahead(b, 0.5 * h));
        let d = rate(beyond + h, ahead(c, h));
        y = [0, 1, 2, 3].map(|q| y[q] + h / 6.0 * (a[q] + 2.0 * b[q] + 2.0 * c[q] + d[q]));
    }
    [y[0], y[2], y[3]]
}

/// Twice the weight under which it buckles.
const HEAVY: f64 = 2.0 * 7.837347 * BENDING / (LENGTH * LENGTH * LENGTH);

fn from_heavy(robot: &Robot, force: [f64; 3], at: f64) -> Diagram {
    let from = OwnedLoad {
        tensions: vec![0.0; 3],
        gravity: [0.0, 0.0, -HEAVY / 0.2],
        ..OwnedLoad::default()
    };
    let mut to = from.clone();
    match at {
        LENGTH => to.tip_force = force,
        _ => to.point_loads.push(PointLoad {
            arc_length: Some(at),
            force,
            ..PointLoad::default()
        }),
    }
    let path = LoadPath { from, to };
    diagram(robot, &kirchhoff(), &path, &Search::default()).unwrap()
}

/// A transverse force leaves two equilibria of the family: the robot leans with it or against it.
#[test]
fn a_column_bent_by_its_weight_leans_with_a_force_or_against_it() {
    check_leaning(LENGTH);
}

/// The load at factor 0 divides modules as those after it.
#[test]
fn a_column_bent_by_its_weight_leans_with_a_force_between_disks() {
    check_leaning(0.5 * LENGTH);
}

fn check_leaning(at: f64) {
    let robot = column(9, 0.2);
    let force = 0.1 * PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let direction = [0.6, -0.8];
    let all = from_heavy(
        &robot,
        [force * direction[0], force * direction[1], 0.0],
        at,
    );
    assert!(all.complete && all.deflated);
    let counts: Vec<_> = all
        .branches
        .iter()
        .map(|b| b.points.last().unwrap().unstable_modes)
        .collect();
    // beside them the nearly straight one
    assert_eq!(counts, [Some(0), Some(1), Some(2)]);
    for (branch, side) in all.branches.iter().zip([1.0, -1.0, -1.0]) {
        assert_eq!((branch.end, branch.origin), (End::Range, None));
        for point in branch.points.iter().filter(|p| p.factor > 0.0) {
            assert!(point.residual < 1e-10);
            let tip = point.disks.last().unwrap();
            let [x, y, z] = tip.position.0;
            let along = x * direction[0] + y * direction[1];
            assert!(along * side > 0.0);
            assert!((x * direction[1] - y * direction[0]).abs() < 1e-8);
            let lean = tip.rotation.0[0][2] * direction[0] + tip.rotation.0[1][2] * direction[1];
            let angle = lean.atan2(tip.rotation.0[2][2]);
            let [base, across, up] = heavy_elastica(angle, [point.factor * force, 0.0], at, HEAVY);
            assert!(base.abs() < 2e-4, "{base}");
            assert!((across - along).abs() < 1e-4 * LENGTH && (up - z).abs() < 1e-4 * LENGTH);
        }
    }
}

/// A force along the axis keeps the family, up to the force that straightens the robot.
#[test]
fn a_column_bent_by_its_weight_is_straightened_by_a_force_along_its_axis() {
    let robot = column(9, 0.2);
    let force = 3.0 * PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let all = from_heavy(&robot, [0.0, 0.0, force], LENGTH);
    let ends: Vec<_> = all.branches.iter().map(|b| (b.origin, b.end)).collect();
    let straight = [(Some((0, 0)), End::Range); 2];
    assert_eq!(ends, [(None, End::Joined), straight[0], straight[1]]);
    let bent = &all.branches[0];
    assert!(bent.points.iter().all(|p| p.neutral_modes > 0));
    let hub = bent.events.last().unwrap();
    assert_eq!(hub.kind, EventKind::Bifurcation);
    let critical = bent.points[hub.point].factor;
    let least = heavy_elastica(1e-5, [0.0, critical * force], LENGTH, HEAVY);
    assert!(least[0].abs() < 1e-9, "{}", least[0]);
    for branch in &all.branches[1..] {
        for point in branch
            .points
            .iter()
            .filter(|p| (p.factor - critical).abs() > 1e-4)
        {
            assert_eq!(point.stable, Some(point.factor > critical));
            assert!((point.disks.last().unwrap().position.0[2] - LENGTH).abs() < 1e-6);
        }
    }
    // compressed, it stays bent
    let all = from_heavy(&robot, [0.0, 0.0, -0.2 * force], LENGTH);
    assert_eq!((all.branches.len(), all.branches[0].end), (1, End::Range));
    let point = all.branches[0].points.last().unwrap();
    assert_eq!((point.factor, point.unstable_modes), (1.0, Some(0)));
    let tip = point.disks.last().unwrap();
    let angle = tip.rotation.0[2][2].acos();
    let [base, _, up] = heavy_elastica(angle, [0.0, -0.2 * force], LENGTH, HEAVY);
    assert!(base.abs() < 2e-4 && (up - tip.position.0[2]).abs() < 1e-4 * LENGTH);
}

#[test]
fn a_column_buckles_under_its_own_weight() {
    let weight = 0.2;
    // Greenhill: first zero of the Bessel function of order -1/3
    let load = 7.837347 * BENDING / LENGTH.powi(3);
    let to = Load {
        tensions: &[0.0; 3],
        gravity: [0.0, 0.0, -2.0 * load / weight],
        ..Load::default()
    };
    check_first(&found(&column(9, weight), to, Search::default()), 0.5, 2);
}

/// A transverse force disturbs the column: two buckled branches, one of them behind a limit point.
#[test]
fn a_disturbed_column_has_a_limit_point_that_deflation_finds() {
    let euler = PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let to = Load {
        tip_force: [0.05 * euler, 0.0, -1.9 * euler],
        ..compressed(0.0)
    };
    let robot = column(9, 0.0);
    let all = found(&robot, to, Search::default());
    assert!(all.deflated && all.complete);
    assert!(all.branches[0]
        .points
        .iter()
        .all(|p| p.stable == Some(true)));
    let beside = &all.branches[1];
    assert_eq!(beside.origin, None);
    assert_eq!(
        beside
            .events
            .iter()
            .filter(|e| e.kind == EventKind::LimitPoint)
            .count(),
        1
    );
    let end = |p: &Point| p.disks.last().unwrap().position[0];
    assert!(end(&beside.points[0]) * end(all.branches[0].points.last().unwrap()) < 0.0);
    let limit = beside
        .events
        .iter()
        .find(|e| e.kind == EventKind::LimitPoint)
        .unwrap();
    let factors = beside.points.iter().map(|p| p.factor);
    let least = factors.fold(f64::INFINITY, f64::min);
    assert!((beside.points[limit.point].factor - least).abs() < 1e-9);
    let none = found(
        &robot,
        to,
        Search {
            deflation: false,
            ..Search::default()
        },
    );
    assert_eq!(none.branches.len(), 1);
    // a branch more for each of Euler's loads below, also where they go on beyond the load and cross
    // it between two points
    for (force, most, count) in [
        ([0.05, 0.0, -1.9], 1.0, 2),
        ([0.05, 0.0, -1.9], 1.3, 2),
        ([0.1, 0.03, -1.5], 1.0, 2),
        ([0.1, 0.03, -1.5], 1.2, 2),
        ([0.05, 0.0, -10.0], 1.0, 3),
        ([1.0, 0.5, -15.0], 1.0, 3),
    ] {
        let to = Load {
            tip_force: force.map(|f| f * euler),
            ..compressed(0.0)
        };
        let search = Search {
            most,
            ..Search::default()
        };
        let all = found(&robot, to, search).branches;
        assert_eq!(all.len(), count);
        for branch in &all {
            let mut at = branch.events.iter().map(|e| branch.points[e.point].factor);
            assert!(at.all(|factor| factor <= most));
        }
    }
}

/// A flat column buckles at one load in its first mode across and in its second one along its width:
/// both and a mixture of them leave to both sides.
#[test]
fn two_modes_of_a_flat_column_at_one_load() {
    let mut spec = column(9, 0.0).spec().clone();
    // Euler's ratio is 9, with the error of two elements
    spec.backbone[0].sections_mut()[0].bending[1] *= 8.99999;
    let robot = Robot::new(spec).unwrap();
    let model = RodModel {
        elements: Some(2),
        ..kirchhoff()
    };
    let search = Search {
        most: 9.05,
        deflation: false,
        ..Search::default()
    };
    let euler = PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let found = diagram(&robot, &model, &path(compressed(euler)), &search).unwrap();
    let events = &found.branches[0].events;
    assert_eq!([events[0].multiplicity, events[1].multiplicity], [1, 2]);
    assert_eq!(found.branches.len(), 1 + 2 + 6);
}

/// Two of five branches of a flat curved column are found by continuation in a transverse force alone.
#[test]
fn branches_of_a_flat_curved_column() {
    let mut spec = column(6, 0.0).spec().clone();
    let section = &mut spec.backbone[0].sections_mut()[0];
    section.bending[1] *= 3.0;
    section.rest_curvature = [-2.0, 1.0, -1.0];
    let model = RodModel {
        elements: Some(1),
        ..kirchhoff()
    };
    let euler = PI * PI * BENDING / (4.0 * LENGTH * LENGTH);
    let to = Load {
        tip_force: [-2.0 * euler, 0.0, -10.0 * euler],
        ..compressed(0.0)
    };
    let robot = Robot::new(spec).unwrap();
    let found = diagram(&robot, &model, &path(to), &Search::default()).unwrap();
    assert_eq!(found.branches.len(), 5);
}

/// At load factor 0 a follower turns with its disk.
#[test]
fn a_branch_begins_with_its_followers() {
    let robot = column(9, 0.0);
    let follower = PointLoad {
        disk: 8,
        force: [2.0 * BENDING / (LENGTH * LENGTH), 0.0, 0.0],
        follower: true,
        ..PointLoad::default()
    };
    let from = OwnedLoad {
        tensions: vec![0.0; 3],
        point_loads: vec![follower],
        ..OwnedLoad::default()
    };
    let mut to = from.clone();
    to.tip_force = [0.0, 0.1, 0.0];
    let path = LoadPath { from, to };
    let all = diagram(&robot, &kirchhoff(), &path, &Search::default()).unwrap();
    let points = &all.branches[0].points;
    assert!(points.iter().all(|p| p.residual < 1e-10));
}

/// Three equal tensions hold a robot straight until its modules buckle between their disks, at some
/// hundred times the load that bends it by a radian.
#[test]
fn equal_tensions_buckle_the_modules_behind_a_long_straight_branch() {
    let modules = 24;
    let robot = column(modules, 0.0);
    // Euler's load of a module between joints: straight spans turn its ends nearly freely
    let module = LENGTH / modules as f64;
    let critical = PI * PI * BENDING / (module * module) / 3.0;
    let tensions = [1.05 * critical; 3];
    let to = Load {
        tensions: &tensions,
        ..Load::default()
    };
    let search = Search {
        first_loss: true,
        ..Search::default()
    };
    let all = found(&robot, to, search);
    let straight = &all.branches[0];
    assert_eq!(straight.end, End::Unstable);
    assert!(all.complete);
    assert!(straight.points.len() < 400, "{}", straight.points.len());
    let event = straight.events[0];
    assert_eq!(event.kind, EventKind::Bifurcation);
    let factor = 1.05 * straight.points[event.point].factor;
    assert!((0.95..1.0).contains(&factor), "{factor}");
    let few = Search {
        points: 20,
        deflation: false,
        ..Search::default()
    };
    let cut = found(&robot, to, few);
    assert_eq!(cut.branches[0].end, End::Points);
    assert!(!cut.complete);
}

#[test]
fn equal_loads_and_wrong_counts_are_refused() {
    let search = Search::default();
    let same = diagram(
        &column(3, 0.0),
        &kirchhoff(),
        &path(compressed(0.0)),
        &search,
    );
    assert!(same.unwrap_err().to_string().contains("are equal"));
    let few = Load {
        tensions: &[1.0],
        ..compressed(0.0)
    };
    assert!(diagram(&column(3, 0.0), &kirchhoff(), &path(few), &search).is_err());
}
