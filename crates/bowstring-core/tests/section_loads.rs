//! Loads on a section of the backbone between two disks: limits at the disks, and a disk without mass
//! in their place.

mod common;

use bowstring_core::dynamics::integrator::{Integrator, Simulator};
use bowstring_core::math::linalg::Vec3;
use bowstring_core::model::load::{Load, Model, PointLoad, TendonPath};
use bowstring_core::model::robot::{Disk, Profile, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::solver::{Outcome, Solver, Status};
use common::{fixed_steps, go, kirchhoff, solved, study_robot, Draw};

/// A robot of four modules, whose tendons end at the second disk, with further disks without mass; the
/// diameter at the end is a share of that at the base.
fn robot(extra: &[f64], clamped: f64, share: f64) -> Robot {
    let section = Section {
        bending: [1.07, 0.8],
        principal_angle: 0.3,
        torsion: 0.83,
        axial: 7e5,
        shear: 2.6e5,
        mass_per_length: 0.2,
        rotary_inertia: 5.5e-8,
        rest_curvature: [0.6, -0.4, 0.5],
    };
    let disk = |station: f64, mass: f64, clamped_length: f64| Disk {
        hole_length: 0.0,
        station,
        clamped_length,
        mass,
        inertia: if mass > 0.0 {
            [5.1e-6, 1.02e-5]
        } else {
            [0.0; 2]
        },
        segment: 0,
    };
    let mut disks: Vec<_> = (1..=4)
        .map(|k| disk(0.1 * k as f64, 0.02, clamped))
        .collect();
    disks.extend(extra.iter().map(|station| disk(*station, 0.0, 0.0)));
    disks.sort_by(|a, b| a.station.total_cmp(&b.station));
    let sections = [0.0, 0.25, 0.5, 0.75, 1.0].map(|x| {
        let by = 1.0 + x * (share - 1.0);
        Section {
            bending: section.bending.map(|b| b * by.powi(4)),
            torsion: section.torsion * by.powi(4),
            axial: section.axial * by * by,
            shear: section.shear * by * by,
            mass_per_length: section.mass_per_length * by * by,
            ..section
        }
    });
    let backbone = match share {
        1.0 => section.into(),
        _ => Profile::Tapered(Box::new(sections)),
    };
    let end_disk = disks.iter().position(|d| d.station == 0.2).unwrap();
    let tendons = [[0.02, 0.0], [-0.01, 0.015]].map(|hole| Tendon::parallel(hole, end_disk));
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![backbone],
        disks,
        tendons: tendons.to_vec(),
        gravity: [0.0; 3],
    })
    .unwrap()
}

fn drawn(draw: &mut Draw, arc_length: f64, follower: bool) -> PointLoad {
    let mut vector = |size: f64| [0; 3].map(|_| draw.within(-size, size));
    PointLoad {
        disk: 0,
        arc_length: Some(arc_length),
        point: vector(0.03),
        force: vector(1.5),
        moment: vector(0.1),
        follower,
    }
}

/// Loads on sections of a robot, and the same on disks without mass there, where no straight tendon
/// passes.
struct Pair {
    robots: [Robot; 2],
    loads: [Vec<PointLoad>; 2],
    tensions: [f64; 2],
    model: Model,
}

impl Pair {
    fn new(own: Vec<PointLoad>, [clamped, share]: [f64; 2], tensions: [f64; 2]) -> Self {
        let mut stations: Vec<_> = own.iter().map(|load| load.arc_length.unwrap()).collect();
        stations.sort_by(f64::total_cmp);
        stations.dedup();
        let robots = [robot(&[], clamped, share), robot(&stations, clamped, share)];
        let place = |load: &PointLoad| {
            let mut disks = robots[1].spec().disks.iter();
            PointLoad {
                disk: disks
                    .position(|d| Some(d.station) == load.arc_length)
                    .unwrap(),
                arc_length: None,
                ..*load
            }
        };
        let on_disks = own.iter().map(place).collect();
        Pair {
            robots,
            loads: [own, on_disks],
            tensions,
            model: Model::default(),
        }
    }

    /// Equilibria, with the more elements the more exact, under further loads.
    fn rest(&self, tension: f64, line: [f64; 3]) -> [(Vec3, Outcome, Solver); 2] {
        [0, 1].map(|which| {
            let robot = &self.robots[which];
            let load = Load {
                tensions: &[self.tensions[0] + tension, self.tensions[1]],
                gravity: [3.0, 0.0, -9.81],
                tip_force: [0.0, 0.3, 0.1],
                point_loads: &self.loads[which],
                line_forces: &vec![line; robot.module_count()],
                ..Load::default()
            };
            let mut solver = Solver::new(robot, self.model, 8).unwrap();
            let mut outcome = solved(&mut solver, &load);
            assert!(outcome.iterations < 15, "{}", outcome.iterations);
            solver.estimate_error(&mut outcome);
            (solver.tip().unwrap().position, outcome, solver)
        })
    }

    /// Checks tip and work of motions from the equilibrium under a share of the loads to another
    /// share of them.
    fn check_motion(&self, shares: [f64; 2], duration: f64) {
        let [(a, work), (b, other)] = [(0, 8), (1, 4)].map(|(which, elements)| {
            let mut settings = fixed_steps(1e-3, 0.9);
            (settings.gravity, settings.damping.mass) = ([0.0, 0.0, -9.81], 1.0);
            let robot = &self.robots[which];
            let mut simulator = Simulator::new(robot, self.model, elements, settings).unwrap();
            let scaled = |by: f64| {
                let loads = self.loads[which].iter();
                let loads = loads.map(|load| PointLoad {
                    force: load.force.map(|x| by * x),
                    moment: load.moment.map(|x| by * x),
                    ..*load
                });
                loads.collect::<Vec<_>>()
            };
            let [start, end] = shares.map(scaled);
            let under = |point_loads| Load {
                tensions: &self.tensions,
                point_loads,
                ..Load::default()
            };
            simulator.rest(&under(&start)).unwrap();
            assert!(simulator.is_ready());
            go(&mut simulator, duration, &under(&end));
            (simulator.tip(), simulator.energies().work)
        });
        let (off, gained) = ((a - b).norm(), (work - other).abs());
        assert!(
            off < 2e-5 && gained < 1e-3 * work.abs(),
            "{off:e} {gained:e} of {work:e}"
        );
    }
}

/// A load on a section acts as on a disk without mass.
#[test]
fn a_load_acts_as_on_a_disk_without_mass() {
    let mut draw = Draw(11);
    for trial in 0..60 {
        let s = draw.within(0.215, 0.385);
        if (s - 0.3).abs() < 0.015 {
            continue;
        }
        let (clamped, model, most) = (
            [0.004, 0.0, 0.0][trial % 3],
            [kirchhoff(), Model::default()][trial % 2],
            [1e-8, 1e-6][trial % 2],
        );
        let mut own = drawn(&mut draw, s, trial % 4 > 1);
        if trial % 5 == 0 {
            own.moment = [0.0; 3];
        }
        let tensions = [draw.within(0.0, 25.0), draw.within(0.0, 25.0)];
        let pair = Pair {
            model,
            ..Pair::new(vec![own], [clamped, 1.0], tensions)
        };
        let [(a, ..), (b, ..)] = pair.rest(0.0, [0.0, 1.0, -2.0]);
        let off = (a - b).norm();
        assert!(off < most, "{trial}: {off:e}");
    }
}

/// So do stability, modes and motion.
#[test]
fn motion_is_that_with_a_disk_without_mass() {
    let mut draw = Draw(15);
    for (trial, s) in [0.23, 0.365, 0.355, 0.245].into_iter().enumerate() {
        let mut own = drawn(&mut draw, s, trial % 2 == 1);
        own.force = own.force.map(|x| 0.5 * x);
        Pair::new(vec![own], [0.004, 1.0], [10.0, 4.0]).check_motion([0.5, 1.5], 0.1);
    }
}

/// Also beside tendons that follow the backbone, and on a taper: with the lengths of the tendons.
#[test]
fn continuous_tendons_and_tapers_are_divided() {
    let mut draw = Draw(16);
    for trial in 0..30 {
        let continuous = trial % 3 < 2;
        let (from, tendon) = match continuous {
            true => (0.012, TendonPath::Continuous),
            false => (0.212, TendonPath::Straight),
        };
        let s = draw.within(from, from + 0.176);
        if (s % 0.1 - 0.05).abs() > 0.04 {
            continue;
        }
        let own = drawn(&mut draw, s, trial % 5 > 2);
        let tensions = [draw.within(0.0, 25.0), draw.within(0.0, 25.0)];
        let pair = Pair {
            model: Model {
                tendon,
                ..kirchhoff()
            },
            ..Pair::new(vec![own], [0.0, [0.7, 1.0][trial % 2]], tensions)
        };
        let [(a, one, solver), (b, two, other)] = pair.rest(0.0, [0.0; 3]);
        let stated = one.error.unwrap().tip + two.error.unwrap().tip;
        let longer = [0, 1]
            .map(|i| (solver.tendon_length(i).unwrap() - other.tendon_length(i).unwrap()).abs());
        let off = longer.into_iter().fold((a - b).norm(), f64::max);
        assert!(
            off <= stated + 1e-10 && stated < 1e-6,
            "{trial}: {off:e} {stated:e}"
        );
    }
}

/// Several sections between the same two disks, dead loads and followers, with several loads on one of
/// them: at rest, their derivatives, and in motion.
#[test]
fn several_sections_between_two_disks() {
    let mut draw = Draw(17);
    for trial in 0..12 {
        let first = draw.within(0.215, 0.225);
        let places = [first, first + 0.02, first + 0.055, 0.33, 0.385, first];
        let own = places[..2 + trial % 5]
            .iter()
            .enumerate()
            .map(|(i, place)| {
                let load = drawn(&mut draw, *place, (i + trial) % 3 == 1);
                PointLoad {
                    force: load.force.map(|x| 0.6 * x),
                    moment: load.moment.map(|x| 0.6 * x),
                    ..load
                }
            });
        let own = own.collect();
        let tensions = [draw.within(0.0, 15.0), draw.within(0.0, 15.0)];
        let pair = Pair {
            model: [kirchhoff(), Model::default()][trial % 2],
            ..Pair::new(own, [0.002, 1.0], tensions)
        };
        let [(a, outcome, solver), (b, other, _)] = pair.rest(0.0, [0.0; 3]);
        let off = (a - b).norm();
        assert!(off < [1e-8, 1e-7][trial % 2], "{trial}: {off:e}");
        assert_eq!(outcome.stable, other.stable, "{trial}");
        let slope = |h: f64| {
            let [[(up, ..), _], [(down, ..), _]] = [h, -h].map(|h| pair.rest(h, [0.0; 3]));
            (up - down) * (0.5 / h)
        };
        let exact = slope(5e-4) * (4.0 / 3.0) - slope(1e-3) * (1.0 / 3.0);
        let off = (solver.jacobians(false).unwrap().tensions[0].position - exact).norm();
        assert!(off < 1e-9, "{trial}: {off:e}");
        pair.check_motion([0.3, 1.0], 0.05);
    }
}

/// Loads on sections just before and beyond a disk, and just on it.
#[test]
fn loads_tend_to_those_on_the_disk() {
    for (clamped, model) in [(0.0, Model::default()), (0.004, kirchhoff())] {
        let robot = study_robot(9, clamped);
        let station = robot.spec().disks[3].station;
        let mut draw = Draw(12);
        for follower in [false, true] {
            let own = drawn(&mut draw, station, follower);
            let tip = |arc_length: Option<f64>, shift: f64, elements: usize| {
                let mut point = own.point;
                point[2] += shift;
                let load = PointLoad {
                    disk: 3,
                    arc_length,
                    point,
                    ..own
                };
                let load = Load {
                    tensions: &[30.0, 0.0, 10.0],
                    gravity: [0.0, 2.0, -9.81],
                    point_loads: &[load],
                    ..Load::default()
                };
                let mut solver = Solver::new(&robot, model, elements).unwrap();
                solved(&mut solver, &load);
                solver.tip().unwrap().position
            };
            let half = 0.5 * clamped;
            for side in [-1.0, 1.0] {
                let exact = tip(None, side * half, 8);
                let edge = station + side * half;
                // at the edge of the clamp it acts on the disk
                let at_edge = tip(Some(edge), 0.0, 8);
                assert!((at_edge - exact).norm() < 1e-10);
                let mut last = f64::INFINITY;
                for distance in [1e-5, 1e-6, 1e-7, 1e-8] {
                    let off = (tip(Some(edge + side * distance), 0.0, 8) - exact).norm();
                    println!("{clamped} {follower} {side} {distance:e} {off:e}");
                    // the elements of the module are unequal: that error remains
                    assert!(off < 2.0 * distance + 2e-8, "{distance:e}: {off:e}");
                    last = off;
                }
                assert!(last < 2e-8);
            }
            // one element takes a load on a station
            assert!((tip(Some(station), 0.0, 1) - tip(None, 0.0, 1)).norm() < 1e-13);
        }
    }
}

/// The loads of a motion may come in another order, and on a disk by its arc length; not elsewhere.
#[test]
fn motion_takes_loads_on_the_same_sections_in_any_order() {
    let robot = robot(&[], 0.004, 1.0);
    let at = |s: f64, force: f64| PointLoad {
        arc_length: Some(s),
        force: [force, 0.0, 0.1],
        ..PointLoad::default()
    };
    let run = |then: &[PointLoad]| {
        let settings = Integrator {
            gravity: [0.0, 0.0, -9.81],
            ..fixed_steps(1e-3, 0.9)
        };
        let mut simulator = Simulator::new(&robot, Model::default(), 4, settings).unwrap();
        let under = |point_loads| Load {
            tensions: &[10.0, 4.0],
            point_loads,
            ..Load::default()
        };
        let start = [at(0.23, 0.2), at(0.365, -0.1)];
        simulator.rest(&under(&start)).unwrap();
        simulator.advance(0.05, &under(then)).map(|(stop, _)| {
            assert!(stop.is_none());
            simulator.tip()
        })
    };
    let (a, b) = (at(0.23, 0.6), at(0.365, 0.3));
    let expected = run(&[a, b]).unwrap();
    assert!((run(&[b, a]).unwrap() - expected).norm() < 1e-12);
    let on_disk = PointLoad {
        arc_length: Some(0.2),
        ..PointLoad::default()
    };
    assert!((run(&[b, on_disk, a]).unwrap() - expected).norm() < 1e-12);
    let error = run(&[a, at(0.33, 0.3)]).unwrap_err().to_string();
    assert!(
        error.contains("act on other sections than before"),
        "{error}"
    );
}

/// A path divides modules at the sections of the load before too, and says so where they are many.
#[test]
fn a_path_names_the_load_before() {
    let robot = robot(&[], 0.004, 1.0);
    let at = |share: f64| PointLoad {
        arc_length: Some(0.2 + 0.1 * share),
        force: [0.1, 0.0, 0.0],
        ..PointLoad::default()
    };
    let lines = vec![Line::default(); robot.tendon_count()];
    let mut path = PathSolver::new(&robot, Model::default(), 4, &lines).unwrap();
    let commands = [Command::Tension(10.0), Command::Tension(4.0)];
    let mut step = |shares: &[f64]| {
        let point_loads: Vec<_> = shares.iter().map(|share| at(*share)).collect();
        let load = Load {
            point_loads: &point_loads,
            ..Load::default()
        };
        path.step(&commands, &load).map(|found| found.status)
    };
    assert_eq!(step(&[0.2, 0.4]).unwrap(), Status::Converged);
    assert_eq!(step(&[0.4, 0.2, 0.6]).unwrap(), Status::Converged);
    let error = step(&[0.3]).unwrap_err().to_string();
    assert!(
        error.contains("loads of this load and of the load before it on 4 sections"),
        "{error}"
    );
    let error = step(&[0.25, 0.35, 0.45, 0.55, 0.65])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("point loads of this load and of the load before it act on 8 sections"),
        "{error}"
    );
}
