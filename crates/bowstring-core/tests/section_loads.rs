//! Loads on a section of the backbone between two disks: limits at the disks, a disk without mass
//! in their place, equivalent loads, derivatives and energy.

mod common;

use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator, Step};
use bowstring_core::model::load::{Load, Model, PointLoad, TendonPath, Theory};
use bowstring_core::model::robot::{Disk, Profile, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::path::{Command, Line, PathSolver};
use bowstring_core::statics::solver::{Outcome, Solver, Status};
use common::{study_robot, Draw};

fn kirchhoff() -> Model {
    Model {
        theory: Theory::Kirchhoff,
        ..Model::default()
    }
}

fn solved(solver: &mut Solver, load: &Load) -> Outcome {
    let outcome = solver.solve(load).unwrap();
    assert_eq!(outcome.status, Status::Converged, "{load:?}");
    outcome
}

/// A robot of four modules, whose tendons end at the second disk, with further disks without mass.
fn robot(extra: Option<f64>, clamped: f64) -> Robot {
    with_end(extra, clamped, 1.0)
}

/// The same, whose diameter at the end is a share of that at the base.
fn with_end(extra: Option<f64>, clamped: f64, share: f64) -> Robot {
    let extra: Vec<_> = extra.into_iter().collect();
    with_disks(&extra, clamped, share)
}

fn with_disks(extra: &[f64], clamped: f64, share: f64) -> Robot {
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
    Robot::new(RobotSpec {
        payloads: vec![],
        backbone: vec![backbone],
        disks,
        tendons: vec![
            Tendon::parallel([0.02, 0.0], 1),
            Tendon::parallel([-0.01, 0.015], 1),
        ],
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

/// The load acts as on a disk without mass, where no tendon passes.
#[test]
fn a_load_acts_as_on_a_disk_without_mass() {
    let mut draw = Draw(11);
    let mut worst: [f64; 2] = [0.0; 2];
    for trial in 0..60 {
        let s = draw.within(0.215, 0.385);
        if (s - 0.3).abs() < 0.015 {
            continue;
        }
        let clamped = if trial % 3 == 0 { 0.004 } else { 0.0 };
        let model = if trial % 2 == 0 {
            kirchhoff()
        } else {
            Model::default()
        };
        let mut own = drawn(&mut draw, s, trial % 4 > 1);
        if trial % 5 == 0 {
            own.moment = [0.0; 3];
        }
        let tensions = [draw.within(0.0, 25.0), draw.within(0.0, 25.0)];
        let lines = [[0.0, 1.0, -2.0]; 5];
        let load = Load {
            tensions: &tensions,
            gravity: [3.0, 0.0, -9.81],
            tip_force: [0.0, 0.3, 0.1],
            point_loads: &[own],
            line_forces: &lines[..4],
            ..Load::default()
        };
        let mut solver = Solver::new(&robot(None, clamped), model, 8).unwrap();
        let outcome = solved(&mut solver, &load);
        assert!(outcome.iterations < 15, "{trial}: {}", outcome.iterations);
        let tip = solver.tip().unwrap();
        let mut other = Solver::new(&robot(Some(s), clamped), model, 8).unwrap();
        let on_disk = PointLoad {
            disk: if s < 0.3 { 2 } else { 3 },
            arc_length: None,
            ..own
        };
        solved(
            &mut other,
            &Load {
                point_loads: &[on_disk],
                line_forces: &lines,
                ..load
            },
        );
        let off = (other.tip().unwrap().position - tip.position).norm();
        let which = usize::from(model.theory == Theory::Cosserat);
        worst[which] = f64::max(worst[which], off);
    }
    println!("{worst:?}");
    assert!(worst[0] < 1e-8 && worst[1] < 1e-6, "{worst:?}");
}

/// Load on a section of the robot and the same on its disk without mass.
fn on_disk(own: &PointLoad) -> PointLoad {
    let s = own.arc_length.unwrap();
    PointLoad {
        disk: (s / 0.1) as usize,
        arc_length: None,
        ..*own
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

/// A follower acts as the dead load that it is in equilibrium.
#[test]
fn followers_equal_dead_loads_in_equilibrium() {
    let robot = study_robot(9, 0.003);
    let mut draw = Draw(13);
    for trial in 0..20 {
        let s = draw.within(0.29, 0.35);
        let own = PointLoad {
            point: [0.0; 3],
            ..drawn(&mut draw, s, true)
        };
        let tensions = [0; 3].map(|_| draw.within(0.0, 30.0));
        let elements = [2, 4, 8][trial % 3];
        let solve = |own: PointLoad| {
            let load = Load {
                tensions: &tensions,
                gravity: [0.0, 0.0, -9.81],
                point_loads: &[own],
                ..Load::default()
            };
            let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
            let outcome = solved(&mut solver, &load);
            assert!(outcome.iterations < 12, "{}", outcome.iterations);
            solver
        };
        // along the tangent of the section
        let along = PointLoad {
            force: [0.0, 0.0, 1.2],
            moment: [0.0, 0.0, 0.05],
            ..own
        };
        let (module, points) = ((s / 0.641 * 9.0) as usize, 2000);
        let solver = solve(along);
        let line = solver.centerline(points).unwrap();
        let at = (s * 9.0 / 0.641 - module as f64) * points as f64;
        let first = module * points + at as usize;
        let t = line[first + 1] - line[first];
        let t = t * (1.0 / t.norm());
        let dead = PointLoad {
            follower: false,
            force: (t * 1.2).0,
            moment: (t * 0.05).0,
            ..along
        };
        let other = solve(dead);
        let off = (other.tip().unwrap().position - solver.tip().unwrap().position).norm();
        assert!(off < 2e-5, "{trial}: {off:e}");
    }
}

/// Motion of the tip by the load equals that of the section by a force on the tip, and derivatives
/// are those of differences.
#[test]
fn derivatives_and_reciprocity() {
    let robot = study_robot(9, 0.003);
    let mut draw = Draw(14);
    for trial in 0..6 {
        let (lengths, elements) = (robot.length() / 9.0, [2, 4, 8][trial % 3]);
        // a quarter of the sixth module with its clamps
        let s = lengths * 5.25;
        let mut own = drawn(&mut draw, s, trial % 2 == 1);
        if trial % 2 == 0 {
            own.moment = [0.0; 3];
            own.point = [0.0; 3];
        }
        let solve =
            |tensions: [f64; 3], tip_force: [f64; 3], tip_moment: [f64; 3], own: PointLoad| {
                let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
                solved(
                    &mut solver,
                    &Load {
                        tensions: &tensions,
                        gravity: [1.0, 0.0, -9.81],
                        tip_force,
                        tip_moment,
                        point_loads: &[own],
                        ..Load::default()
                    },
                );
                solver
            };
        let (t, force, none) = ([20.0, 5.0, 8.0], [0.1, 0.2, 0.0], [0.0; 3]);
        let found = solve(t, force, none, own).jacobians(false).unwrap();
        let h = 1e-3;
        let stepped = |q: usize, base: [f64; 3], by: f64| {
            let mut out = base;
            out[q] += by;
            out
        };
        let difference = |of: &dyn Fn(f64) -> Solver| {
            let tip = |step: f64| of(step).tip().unwrap().position;
            // Richardson
            let once = |h: f64| (tip(h) - tip(-h)) * (0.5 / h);
            once(0.5 * h) * (4.0 / 3.0) - once(h) * (1.0 / 3.0)
        };
        for q in 0..3 {
            let exact = difference(&|by| solve(stepped(q, t, by), force, none, own));
            let off = (found.tensions[q].position - exact).norm();
            assert!(off < 1e-9, "{trial}, tension {q}: {off:e}");
            let exact = difference(&|by| solve(t, stepped(q, force, by), none, own));
            let off = (found.tip_force[q].position - exact).norm();
            assert!(off < 1e-8, "{trial}, force {q}: {off:e}");
            let exact = difference(&|by| solve(t, force, stepped(q, none, 0.1 * by), own)) * 10.0;
            let off = (found.tip_moment[q].position - exact).norm();
            assert!(off < 1e-7, "{trial}, moment {q}: {off:e}");
            if trial % 2 == 0 {
                // the section: a quarter of the module
                let node = |solver: &Solver| solver.centerline(4).unwrap()[4 * 5 + 1];
                for r in 0..3 {
                    let by_tip = |by: f64| node(&solve(t, stepped(q, force, by), none, own))[r];
                    let by_own = |by: f64| {
                        let own = PointLoad {
                            force: stepped(r, own.force, by),
                            ..own
                        };
                        solve(t, force, none, own).tip().unwrap().position[q]
                    };
                    let slope = |of: &dyn Fn(f64) -> f64| {
                        let once = |h: f64| (of(h) - of(-h)) * (0.5 / h);
                        once(0.5 * h) * (4.0 / 3.0) - once(h) * (1.0 / 3.0)
                    };
                    let off = (slope(&by_tip) - slope(&by_own)).abs();
                    assert!(off < 1e-8, "{trial} {q} {r}: {off:e}");
                }
            }
        }
    }
}

/// Stability, modes and motion are those of a robot with a disk without mass in place of the load.
#[test]
fn motion_is_that_with_a_disk_without_mass() {
    let damping = Damping {
        mass: 1.0,
        material: 0.0,
    };
    let mut draw = Draw(15);
    for (trial, s) in [0.23, 0.365, 0.355, 0.245].into_iter().enumerate() {
        let mut own = drawn(&mut draw, s, trial % 2 == 1);
        own.force = own.force.map(|x| 0.5 * x);
        let tensions = [10.0, 4.0];
        let robots = [robot(None, 0.004), robot(Some(s), 0.004)];
        let loads = [own, on_disk(&own)];
        let run = |which: usize, elements: usize| {
            let settings = Integrator {
                step: Step::Fixed(1e-3),
                damping,
                gravity: [0.0, 0.0, -9.81],
                spectral_radius: 0.9,
            };
            let mut simulator =
                Simulator::new(&robots[which], Model::default(), elements, settings).unwrap();
            let mut own = loads[which];
            let load = |own: &PointLoad, by: f64| -> PointLoad {
                PointLoad {
                    force: own.force.map(|x| by * x),
                    moment: own.moment.map(|x| by * x),
                    ..*own
                }
            };
            let start = load(&own, 0.5);
            simulator
                .rest(&Load {
                    tensions: &tensions,
                    point_loads: &[start],
                    ..Load::default()
                })
                .unwrap();
            assert!(simulator.is_ready());
            own = load(&own, 1.5);
            let (stop, _) = simulator
                .advance(
                    0.1,
                    &Load {
                        tensions: &tensions,
                        point_loads: &[own],
                        ..Load::default()
                    },
                )
                .unwrap();
            assert!(stop.is_none());
            (simulator.tip(), *simulator.energies())
        };
        let (a, balance) = run(0, 8);
        let (b, other) = run(1, 4);
        let off = (a - b).norm();
        let work = (balance.work - other.work).abs();
        println!("{trial}: {off:e} {work:e} of {:e}", balance.work);
        assert!(off < 2e-5 && work < 1e-3 * balance.work.abs(), "{trial}");
    }
}

/// Also beside tendons that follow the backbone, and on a taper: with the lengths of the tendons.
#[test]
fn continuous_tendons_and_tapers_are_divided() {
    let mut draw = Draw(16);
    for trial in 0..30 {
        let continuous = trial % 3 < 2;
        let (from, to) = if continuous {
            (0.012, 0.188)
        } else {
            (0.212, 0.388)
        };
        let s = draw.within(from, to);
        if (s % 0.1 - 0.05).abs() > 0.04 {
            continue;
        }
        let share = if trial % 2 == 0 { 0.7 } else { 1.0 };
        let own = drawn(&mut draw, s, trial % 5 > 2);
        let tensions = [draw.within(0.0, 25.0), draw.within(0.0, 25.0)];
        let model = Model {
            tendon: if continuous {
                TendonPath::Continuous
            } else {
                TendonPath::Straight
            },
            ..kirchhoff()
        };
        let solve = |extra: Option<f64>, load: PointLoad| {
            let robot = with_end(extra, 0.0, share);
            let end_disk = 1 + usize::from(extra.is_some_and(|s| s < 0.2));
            let mut spec = robot.spec().clone();
            for tendon in &mut spec.tendons {
                tendon.end_disk = end_disk;
            }
            let robot = Robot::new(spec).unwrap();
            let mut solver = Solver::new(&robot, model, 8).unwrap();
            let load = Load {
                tensions: &tensions,
                gravity: [3.0, 0.0, -9.81],
                point_loads: &[load],
                ..Load::default()
            };
            let outcome = solved(&mut solver, &load);
            assert!(outcome.iterations < 15, "{trial}: {}", outcome.iterations);
            let mut outcome = outcome;
            solver.estimate_error(&mut outcome);
            let lengths = [0, 1].map(|i| solver.tendon_length(i).unwrap());
            (solver.tip().unwrap().position, lengths, outcome.error)
        };
        let (tip, lengths, error) = solve(None, own);
        let (other, others, finer) = solve(Some(s), on_disk(&own));
        let off = (other - tip).norm();
        let longer = (lengths[0] - others[0])
            .abs()
            .max((lengths[1] - others[1]).abs());
        let stated = error.unwrap().tip + finer.unwrap().tip;
        println!("{trial} {s} {continuous} {share} {off:e} {longer:e} {stated:e}");
        assert!(off <= stated + 1e-10 && longer <= stated + 1e-10, "{trial}");
        assert!(stated < 1e-6, "{trial}: {stated:e}");
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
        let count = 2 + trial % 5;
        let scale = 0.6;
        let own: Vec<_> = (0..count)
            .map(|i| {
                let load = drawn(&mut draw, places[i], (i + trial) % 3 == 1);
                PointLoad {
                    force: load.force.map(|x| scale * x),
                    moment: load.moment.map(|x| scale * x),
                    ..load
                }
            })
            .collect();
        let mut stations: Vec<_> = places[..count.min(5)].to_vec();
        stations.sort_by(f64::total_cmp);
        let whole = with_disks(&stations, 0.002, 1.0);
        let on_disks: Vec<_> = own
            .iter()
            .map(|load| {
                let station = load.arc_length.unwrap();
                let disks = &whole.spec().disks;
                PointLoad {
                    disk: disks.iter().position(|d| d.station == station).unwrap(),
                    arc_length: None,
                    ..*load
                }
            })
            .collect();
        let robots = [robot(None, 0.002), whole];
        let loads = [own, on_disks];
        let tensions = [draw.within(0.0, 15.0), draw.within(0.0, 15.0)];
        let model = if trial % 2 == 0 {
            kirchhoff()
        } else {
            Model::default()
        };
        let rest = |which: usize, tension: f64| {
            let tensions = [tensions[0] + tension, tensions[1]];
            let load = Load {
                tensions: &tensions,
                gravity: [1.0, 0.0, -9.81],
                point_loads: &loads[which],
                ..Load::default()
            };
            let mut solver = Solver::new(&robots[which], model, 8).unwrap();
            let outcome = solved(&mut solver, &load);
            assert!(outcome.iterations < 15, "{trial}: {}", outcome.iterations);
            (solver.tip().unwrap().position, outcome.stable, solver)
        };
        let ((a, stable, solver), (b, other, _)) = (rest(0, 0.0), rest(1, 0.0));
        let off = (a - b).norm();
        let most = if model.theory == Theory::Kirchhoff {
            1e-8
        } else {
            1e-7
        };
        assert!(
            off < most && stable == other,
            "{trial}: {off:e} {stable:?} {other:?}"
        );
        let h = 1e-3;
        let slope = |h: f64| (rest(0, h).0 - rest(0, -h).0) * (0.5 / h);
        let exact = slope(0.5 * h) * (4.0 / 3.0) - slope(h) * (1.0 / 3.0);
        let found = solver.jacobians(false).unwrap().tensions[0].position;
        assert!(
            (found - exact).norm() < 1e-9,
            "{trial}: {:e}",
            (found - exact).norm()
        );
        let run = |which: usize| {
            let settings = Integrator {
                step: Step::Fixed(1e-3),
                damping: Damping {
                    mass: 1.0,
                    material: 0.0,
                },
                gravity: [0.0, 0.0, -9.81],
                spectral_radius: 0.9,
            };
            let elements = if which == 0 { 8 } else { 4 };
            let mut simulator = Simulator::new(&robots[which], model, elements, settings).unwrap();
            let mut at = |by: f64, rest: bool| {
                let scaled = |load: &PointLoad| PointLoad {
                    force: load.force.map(|x| by * x),
                    moment: load.moment.map(|x| by * x),
                    ..*load
                };
                let points: Vec<_> = loads[which].iter().map(scaled).collect();
                let load = Load {
                    tensions: &tensions,
                    point_loads: &points,
                    ..Load::default()
                };
                if rest {
                    simulator.rest(&load).unwrap();
                    assert!(simulator.is_ready());
                } else {
                    let (stop, _) = simulator.advance(0.05, &load).unwrap();
                    assert!(stop.is_none());
                }
            };
            at(0.3, true);
            at(1.0, false);
            (simulator.tip(), simulator.energies().work)
        };
        let ((a, work), (b, other)) = (run(0), run(1));
        let off = (a - b).norm();
        println!("{trial}: {off:e} {:e}", (work - other) / work);
        assert!(
            off < 2e-5 && (work - other).abs() < 1e-3 * work.abs(),
            "{trial}: {off:e}"
        );
    }
}

/// The loads of a motion may come in another order, and on a disk by its arc length; not elsewhere.
#[test]
fn motion_takes_loads_on_the_same_sections_in_any_order() {
    let robot = robot(None, 0.004);
    let at = |s: f64, force: f64| PointLoad {
        arc_length: Some(s),
        force: [force, 0.0, 0.1],
        ..PointLoad::default()
    };
    let run = |then: &[PointLoad]| {
        let settings = Integrator {
            step: Step::Fixed(1e-3),
            damping: Damping {
                mass: 0.0,
                material: 0.0,
            },
            gravity: [0.0, 0.0, -9.81],
            spectral_radius: 0.9,
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
    let robot = robot(None, 0.004);
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
