//! Branches of equilibria against classical buckling loads.

use bowstring_core::model::load::{Load, Model, OwnedLoad, RodModel, Theory};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::branches::{
    diagram, Diagram, End, EventKind, LoadPath, Point, Search,
};
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
    let disks = (1..=disks).map(|k| Disk {
        hole_length: 0.0,
        station: LENGTH * k as f64 / disks as f64,
        clamped_length: 0.0,
        mass: 0.0,
        inertia: [1e-9, 1e-9],
        segment: 0,
    });
    let disks: Vec<_> = disks.collect();
    let last = disks.len() - 1;
    let hole = |a: f64| [0.01 * a.cos(), 0.01 * a.sin()];
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![section.into()],
        disks,
        tendons: (0..3)
            .map(|i| Tendon::parallel(hole(2.0 * PI * i as f64 / 3.0), last))
            .collect(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

fn kirchhoff() -> RodModel {
    RodModel {
        model: Model {
            theory: Theory::Kirchhoff,
            ..Model::default()
        },
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
