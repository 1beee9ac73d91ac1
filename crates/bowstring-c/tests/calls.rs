//! The C interface from its outside: pointers in, statuses and numbers out.

use bowstring::*;
use bowstring_core::model::load::{Load, Model};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::adaptive::Adaptive;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::CStr;
use std::ptr::{null, null_mut};

/// Counts what a thread allocates.
struct Counting;

thread_local! {
    static ALLOCATED: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: all is left to the system's allocator
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATED.set(ALLOCATED.get() + 1);
        // SAFETY: as the caller has it
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller has it
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const TENDONS: usize = 5;
const ENDS: [usize; TENDONS] = [4, 4, 9, 9, 9];
const COMPLIANCE: f64 = 2e-6;
const LIMIT: f64 = 40.0;

fn hole(i: usize) -> [f64; 2] {
    let angle = 1.3 * i as f64;
    [0.02 * angle.cos(), 0.02 * angle.sin()]
}

fn station(k: usize) -> f64 {
    0.06 * (k + 1) as f64
}

/// Two segments of five disks each, with five tendons.
fn text() -> String {
    let section = "[1.0, 1.0, 0.0, 0.8, 7e5, 2.6e5, 0.035, 5.5e-8, 0.0, 0.0, 0.0]";
    let disk = |k: usize| {
        format!(
            r#"{{"station_m": {}, "clamped_length_m": 0.002, "hole_length_m": 0.0, "mass_kg": 0.02,
            "inertia_kg_m2": [5.1e-6, 1.0e-5], "segment": {}}}"#,
            station(k),
            usize::from(k > 4)
        )
    };
    let tendon = |i: usize| {
        format!(
            r#"{{"holes_m": [{:?}], "end_disk": {}, "compliance_m_per_N": {COMPLIANCE},
            "pretension_N": 0.0, "max_tension_N": {LIMIT}}}"#,
            hole(i),
            ENDS[i]
        )
    };
    let all = |rows: Vec<String>| rows.join(",");
    format!(
        r#"{{"format": "bowstring compiled robot", "format_version": 1, "tendon_path": "straight",
        "segments": [{{"sections": [{section}], "stiffness": null}},
                     {{"sections": [{section}], "stiffness": null}}],
        "disks": [{}], "tendons": [{}], "payloads": [],
        "gravity_m_per_s2": [0.0, 0.0, -9.81], "robot": "another key"}}"#,
        all((0..10).map(disk).collect()),
        all((0..TENDONS).map(tendon).collect())
    )
}

/// The same robot without the file.
fn same() -> Robot {
    let section = Section {
        bending: [1.0; 2],
        principal_angle: 0.0,
        torsion: 0.8,
        axial: 7e5,
        shear: 2.6e5,
        mass_per_length: 0.035,
        rotary_inertia: 5.5e-8,
        rest_curvature: [0.0; 3],
    };
    let disks = (0..10).map(|k| Disk {
        station: station(k),
        clamped_length: 0.002,
        hole_length: 0.0,
        mass: 0.02,
        inertia: [5.1e-6, 1.0e-5],
        segment: usize::from(k > 4),
    });
    Robot::new(RobotSpec {
        backbone: vec![section.into(), section.into()],
        disks: disks.collect(),
        tendons: (0..TENDONS)
            .map(|i| Tendon::parallel(hole(i), ENDS[i]))
            .collect(),
        payloads: vec![],
        gravity: [0.0, 0.0, -9.81],
    })
    .unwrap()
}

fn said() -> String {
    // SAFETY: the library keeps a text for this thread
    let text = unsafe { CStr::from_ptr(bowstring_last_error()) };
    text.to_str().unwrap().to_owned()
}

fn read(text: &str) -> *mut BowstringRobot {
    // SAFETY: the text has as many bytes
    unsafe { bowstring_robot_from_text(text.as_ptr().cast(), text.len()) }
}

/// A solver, freed at the end.
struct Made(*mut BowstringSolver);

impl Made {
    fn new(options: Option<BowstringOptions>) -> Self {
        let robot = read(&text());
        assert!(!robot.is_null(), "{}", said());
        let options = options.as_ref().map_or(null(), |o| o as *const _);
        // SAFETY: a robot of the library, which the solver does not need later
        let solver = unsafe {
            let solver = bowstring_solver_new(robot, options);
            bowstring_robot_free(robot);
            solver
        };
        assert!(!solver.is_null(), "{}", said());
        Made(solver)
    }

    fn solve(
        &self,
        tensions: &[f64],
        load: Option<&BowstringLoad>,
    ) -> (BowstringStatus, BowstringSolution) {
        let mut found = std::mem::MaybeUninit::uninit();
        let load = load.map_or(null(), |load| load as *const _);
        // SAFETY: arrays of the numbers that are given
        unsafe {
            let status = bowstring_solve(
                self.0,
                tensions.as_ptr(),
                tensions.len(),
                load,
                found.as_mut_ptr(),
            );
            (status, found.assume_init())
        }
    }

    fn inverse(&self, position: [f64; 3], direction: Option<[f64; 3]>) -> Inverted {
        let mut tensions = [0.0; TENDONS];
        let mut result = std::mem::MaybeUninit::uninit();
        let direction = direction.as_ref().map_or(null(), |d| d.as_ptr());
        // SAFETY: arrays of the numbers that are given
        unsafe {
            let status = bowstring_inverse(
                self.0,
                position.as_ptr(),
                direction,
                null(),
                tensions.as_mut_ptr(),
                TENDONS,
                result.as_mut_ptr(),
            );
            (status, tensions, result.assume_init())
        }
    }
}

type Inverted = (BowstringStatus, [f64; TENDONS], BowstringInverse);

impl Drop for Made {
    fn drop(&mut self) {
        // SAFETY: it is freed once
        unsafe { bowstring_solver_free(self.0) };
    }
}

const TENSIONS: [f64; TENDONS] = [5.0, 12.0, 14.0, 3.0, 9.0];
const OK: BowstringStatus = BowstringStatus::Ok;
const BAD: BowstringStatus = BowstringStatus::BadInput;

/// The file describes the robot that the core is given directly.
#[test]
fn forward_solves_are_those_of_the_core() {
    let solver = Made::new(None);
    let mut core = Adaptive::new(&same(), Model::default(), None).unwrap();
    let load = BowstringLoad {
        gravity_m_per_s2: [1.0, 2.0, -9.0],
        tip_force_N: [0.3, -0.2, 0.1],
        tip_moment_Nm: [0.01, 0.02, 0.0],
    };
    for given in [None, Some(&load)] {
        let (status, found) = solver.solve(&TENSIONS, given);
        assert_eq!(status, OK, "{}", said());
        let given = given.copied().unwrap_or(BowstringLoad {
            gravity_m_per_s2: [0.0, 0.0, -9.81],
            tip_force_N: [0.0; 3],
            tip_moment_Nm: [0.0; 3],
        });
        let outcome = core.solve(&Load {
            tensions: &TENSIONS,
            gravity: given.gravity_m_per_s2,
            tip_force: given.tip_force_N,
            tip_moment: given.tip_moment_Nm,
            ..Load::default()
        });
        assert!(outcome.unwrap().error.unwrap().tip < 1e-5 * 0.6);
        let tip = core.solver().tip().unwrap();
        for q in 0..3 {
            assert!((found.position_m[q] - tip.position[q]).abs() < 1e-9);
            for p in 0..3 {
                assert!((found.rotation[3 * q + p] - tip.rotation.0[q][p]).abs() < 1e-8);
            }
        }
        assert!(found.residual < 1e-10 && found.stable == 1 && found.error_estimate_m < 6e-6);
        let mut lengths = [0.0; TENDONS];
        let mut displacements = [0.0; TENDONS];
        // SAFETY: arrays of the numbers that are given
        unsafe {
            assert_eq!(
                bowstring_tendon_lengths(solver.0, lengths.as_mut_ptr(), TENDONS),
                OK
            );
            assert_eq!(
                bowstring_displacements(solver.0, displacements.as_mut_ptr(), TENDONS),
                OK
            );
        }
        for i in 0..TENDONS {
            let length = core.solver().tendon_length(i).unwrap();
            assert!((lengths[i] - length).abs() < 1e-9);
            // a straight robot without pretension has tendons as long as their backbone
            let shortened = station(ENDS[i]) - length + COMPLIANCE * TENSIONS[i];
            assert!((displacements[i] - shortened).abs() < 1e-9);
        }
    }
}

/// Against central differences of forward solves.
#[test]
fn derivatives_are_those_of_differences() {
    let solver = Made::new(None);
    let (status, here) = solver.solve(&TENSIONS, None);
    assert_eq!(status, OK);
    let mut found = [0.0; 6 * TENDONS];
    // SAFETY: room for six rows
    let status = unsafe { bowstring_tip_derivatives(solver.0, found.as_mut_ptr(), TENDONS) };
    assert_eq!(status, OK);
    let step = 1e-3;
    for i in 0..TENDONS {
        let [less, more] = [-step, step].map(|d| {
            let mut tensions = TENSIONS;
            tensions[i] += d;
            solver.solve(&tensions, None).1
        });
        for q in 0..3 {
            let slope = (more.position_m[q] - less.position_m[q]) / (2.0 * step);
            assert!((found[q * TENDONS + i] - slope).abs() < 1e-8);
        }
        // spin: derivative of the rotation times its transpose
        let rate = |a: usize, b: usize| -> f64 {
            let by =
                |c: usize| (more.rotation[3 * a + c] - less.rotation[3 * a + c]) / (2.0 * step);
            (0..3).map(|c| by(c) * here.rotation[3 * b + c]).sum()
        };
        for (q, spin) in [rate(2, 1), rate(0, 2), rate(1, 0)].into_iter().enumerate() {
            assert!((found[(3 + q) * TENDONS + i] - spin).abs() < 1e-7);
        }
    }
}

/// Targets that the robot has under other tensions are reached, and a path stays warm.
#[test]
fn inverses_along_a_path() {
    let forward = Made::new(None);
    let solver = Made::new(None);
    let mut iterations = vec![];
    for k in 0..40 {
        let tensions: [f64; TENDONS] =
            std::array::from_fn(|i| TENSIONS[i] + 2.0 * (0.05 * (k * (i + 1)) as f64).sin());
        let (_, there) = forward.solve(&tensions, None);
        let (status, found, result) = solver.inverse(there.position_m, None);
        assert_eq!(status, OK, "{}", said());
        assert!(result.distance_m < 1e-6 * 0.6 && result.restarted == 0);
        assert!(found.iter().all(|t| (0.0..=LIMIT).contains(t)));
        // by a solver of its own
        let (_, again) = forward.solve(&found, None);
        for q in 0..3 {
            assert!((again.position_m[q] - there.position_m[q]).abs() < 1e-6);
        }
        iterations.push(result.iterations);
    }
    let first = iterations.remove(0);
    iterations.sort_unstable();
    assert!(iterations[iterations.len() / 2] < first);
    // SAFETY: a solver of the library
    assert_eq!(unsafe { bowstring_reset(solver.0) }, OK);
    let (_, there) = forward.solve(&TENSIONS, None);
    let tangent = [2, 5, 8].map(|q| 3.0 * there.rotation[q]);
    let (status, _, result) = solver.inverse(there.position_m, Some(tangent));
    assert_eq!(status, OK, "{}", said());
    assert!(result.direction_error_rad < 1e-5);
}

#[test]
fn limits_hold_and_unreachable_targets_have_a_nearest_tip() {
    let solver = Made::new(None);
    let (_, there) = solver.solve(&TENSIONS, None);
    let most = [3.0; TENDONS];
    // SAFETY: arrays of the numbers that are given
    let status = unsafe { bowstring_set_limits(solver.0, null(), most.as_ptr(), TENDONS) };
    assert_eq!(status, OK);
    let (status, found, result) = solver.inverse(there.position_m, None);
    assert_eq!(status, BowstringStatus::Unreachable);
    assert!(said().contains("do not allow"));
    assert!(found.iter().all(|t| (0.0..=3.0).contains(t)));
    let [nearest, distance] = [result.nearest_distance_m, result.distance_m];
    // the forward solve has a discretisation error of its own
    assert!(
        nearest > 1e-3 && distance > nearest - 6e-6,
        "{nearest} {distance}"
    );
    assert!(distance <= nearest + 1.01e-3 * 0.6);
    let off = |q: usize| result.solution.position_m[q] - there.position_m[q];
    let distance = (0..3).map(|q| off(q) * off(q)).sum::<f64>().sqrt();
    assert!((distance - result.distance_m).abs() < 1e-12);
}

/// Solves in a loop take nothing from the heap.
#[test]
fn forward_solves_from_the_last_one_do_not_allocate() {
    let fixed = BowstringOptions {
        elements: 2,
        ..bowstring_options_default()
    };
    for options in [None, Some(fixed)] {
        let solver = Made::new(options);
        let mut lengths = [0.0; TENDONS];
        let mut count = 0;
        for k in 0..50 {
            let mut tensions = TENSIONS;
            tensions[2] += 0.05 * k as f64;
            let before = ALLOCATED.get();
            let (status, _) = solver.solve(&tensions, None);
            // SAFETY: room for a number for each tendon
            unsafe {
                bowstring_tendon_lengths(solver.0, lengths.as_mut_ptr(), TENDONS);
                bowstring_displacements(solver.0, lengths.as_mut_ptr(), TENDONS);
            }
            assert_eq!(status, OK);
            if k > 3 {
                count += ALLOCATED.get() - before;
            }
        }
        assert_eq!(count, 0);
    }
}

#[test]
fn wrong_calls_are_refused_with_a_sentence() {
    let solver = Made::new(None);
    let nan = [f64::NAN, 0.0, 0.0, 0.0, 0.0];
    let negative = [0.0, -3.0, 0.0, 0.0, 0.0];
    for (tensions, words) in [
        (&nan[..], "tension of tendon 1 is NaN"),
        (&negative[..], "tension of tendon 2 is -3"),
        (&TENSIONS[..4], "tendon_count is 4, and the robot has 5"),
    ] {
        let (status, found) = solver.solve(tensions, None);
        assert_eq!(status, BAD);
        assert!(said().contains(words), "{}", said());
        assert!(found.position_m[0].is_nan() && found.rotation[8].is_nan());
    }
    let load = BowstringLoad {
        gravity_m_per_s2: [0.0, f64::INFINITY, 0.0],
        tip_force_N: [0.0; 3],
        tip_moment_Nm: [0.0; 3],
    };
    assert_eq!(solver.solve(&TENSIONS, Some(&load)).0, BAD);
    assert!(said().contains("gravity"), "{}", said());
    let mut out = [0.0; TENDONS];
    // SAFETY: arrays of the numbers that are given, or NULL, which is refused
    unsafe {
        let lengths = |solver, out, count| bowstring_tendon_lengths(solver, out, count);
        assert_eq!(lengths(solver.0, out.as_mut_ptr(), TENDONS), BAD);
        assert!(said().contains("no solution") && out[0].is_nan());
        solver.solve(&TENSIONS, None);
        assert_eq!(lengths(solver.0, null_mut(), TENDONS), BAD);
        assert!(said().contains("lengths is NULL"));
        assert_eq!(lengths(null_mut(), out.as_mut_ptr(), TENDONS), BAD);
        assert!(said().contains("solver is NULL"));
        assert_eq!(lengths(solver.0, out.as_mut_ptr(), 0), BAD);
        // a wrong call keeps the solution
        assert_eq!(solver.solve(&nan, None).0, BAD);
        assert_eq!(lengths(solver.0, out.as_mut_ptr(), TENDONS), OK);
        let limits = |most: f64| {
            let most = [most; TENDONS];
            bowstring_set_limits(solver.0, null(), most.as_ptr(), TENDONS)
        };
        assert_eq!(limits(f64::NAN), BAD);
        assert_eq!(limits(-1.0), BAD);
        assert!(said().contains("limits of tension 1"), "{}", said());
        assert_eq!(
            bowstring_solve(solver.0, null(), TENDONS, null(), null_mut()),
            BAD
        );
        assert_eq!(
            bowstring_solve(null_mut(), null(), TENDONS, null(), null_mut()),
            BAD
        );
        assert!(bowstring_solver_new(null(), null()).is_null());
        bowstring_solver_free(null_mut());
        bowstring_robot_free(null_mut());
        assert_eq!(bowstring_robot_tendon_count(null()), 0);
        assert!(bowstring_robot_length(null()).is_nan());
    }
    let (status, tensions, result) = solver.inverse([f64::NAN, 0.0, 0.5], None);
    assert!(status == BAD && tensions[4].is_nan() && result.distance_m.is_nan());
    assert!(said().contains("target position"), "{}", said());
    assert_eq!(solver.inverse([0.1, 0.0, 0.5], Some([0.0; 3])).0, BAD);
    assert!(said().contains("not zero"));
}

#[test]
fn loads_without_a_solution_have_no_numbers() {
    let solver = Made::new(None);
    let (status, found) = solver.solve(&[0.0, 0.0, 1e5, 0.0, 0.0], None);
    assert!(status as i32 > 0, "{status:?}");
    assert!(found.position_m[0].is_nan() && !said().is_empty());
    let mut out = [0.0; 6 * TENDONS];
    // SAFETY: room for six rows
    let status = unsafe { bowstring_tip_derivatives(solver.0, out.as_mut_ptr(), TENDONS) };
    assert!(status == BAD && out.iter().all(|x| x.is_nan()));
    assert_eq!(solver.solve(&TENSIONS, None).0, OK);
}

#[test]
fn wrong_options_are_refused() {
    let robot = read(&text());
    let usual = bowstring_options_default();
    for (options, words) in [
        (BowstringOptions { theory: 2, ..usual }, "theory is 2"),
        (
            BowstringOptions {
                elements: 3,
                ..usual
            },
            "elements is 3",
        ),
        (
            BowstringOptions {
                distance_margin: f64::NAN,
                ..usual
            },
            "distance_margin is NaN",
        ),
    ] {
        // SAFETY: a robot and options
        assert!(unsafe { bowstring_solver_new(robot, &options) }.is_null());
        assert!(said().contains(words), "{}", said());
    }
    // SAFETY: a robot of the library
    unsafe {
        assert_eq!(bowstring_robot_tendon_count(robot), TENDONS);
        assert!((bowstring_robot_length(robot) - 0.6).abs() < 1e-15);
        bowstring_robot_free(robot);
    }
}

#[test]
fn wrong_files_are_refused() {
    let good = text();
    for (text, words) in [
        (String::new(), "bowstring export"),
        ("segments:\n  - length: 1 m\n".into(), "no compiled robot"),
        (
            r#"{"format": "x", "format_version": 1}"#.into(),
            r#"its format is "x""#,
        ),
        (
            good.replace(r#""format_version": 1"#, r#""format_version": 2"#),
            "format version 2",
        ),
        (good.replace(r#""pretension_N": 0.0, "#, ""), "pretension_N"),
        (
            good.replace("2e-6", "-1.0").replace("0.000002", "-1.0"),
            "compliance_m_per_N of tendon 1 is -1",
        ),
        (
            good.replace("[1.0, 1.0, 0.0,", "[1e999, 1.0, 0.0,"),
            "no compiled robot",
        ),
        (
            good.replace("[1.0, 1.0, 0.0,", "[-1.0, 1.0, 0.0,"),
            "stiffness",
        ),
        (
            good.replace(r#""end_disk": 9"#, r#""end_disk": 99"#),
            "disk",
        ),
    ] {
        assert!(read(&text).is_null(), "{words}");
        assert!(said().contains(words), "{words}: {}", said());
    }
    // SAFETY: texts that end with a zero, or NULL, which is refused
    unsafe {
        assert!(bowstring_robot_from_text(null(), 3).is_null());
        assert!(bowstring_robot_from_file(null()).is_null());
        assert!(bowstring_robot_from_file(c"/no/such/file".as_ptr()).is_null());
        assert!(said().contains("/no/such/file cannot be read"));
    }
}

/// Threads have errors of their own.
#[test]
fn solvers_run_in_threads_of_their_own() {
    struct Shared(*mut BowstringRobot);
    // SAFETY: a robot is immutable
    unsafe impl Sync for Shared {}
    let robot = Shared(read(&text()));
    let robot = &robot;
    std::thread::scope(|scope| {
        for k in 0..4 {
            scope.spawn(move || {
                let Shared(robot) = robot;
                // SAFETY: a robot of the library, and a solver of this thread
                unsafe {
                    let solver = Made(bowstring_solver_new(*robot, null()));
                    let mut tensions = TENSIONS;
                    tensions[0] += k as f64;
                    assert_eq!(solver.solve(&tensions, None).0, OK);
                    assert!(said().is_empty());
                    assert_eq!(solver.solve(&tensions[..k], None).0, BAD);
                    assert!(said().contains(&format!("tendon_count is {k}")));
                }
            });
        }
    });
    // SAFETY: it is freed once
    unsafe { bowstring_robot_free(robot.0) };
}
