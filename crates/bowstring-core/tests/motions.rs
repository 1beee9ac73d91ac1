//! Many motions side by side: against single ones of `Simulator`, and without allocation.

mod common;

use bowstring_core::dynamics::batch::{Between, Control, MotionStatus, Motions, Observations};
use bowstring_core::dynamics::integrator::{Damping, Integrator, Simulator};
use bowstring_core::model::load::Model;
use common::{by_tensions, fixed_steps, kirchhoff, study_robot};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts allocations.
struct Counting;

static ALLOCATED: AtomicUsize = AtomicUsize::new(0);

// SAFETY: passes all calls to the system's allocator
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATED.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as of the caller
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: as of the caller
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const PERIOD: f64 = 0.02;
const COUNT: usize = 11;

fn settings(step: f64) -> Integrator {
    Integrator {
        gravity: [0.0, 0.0, -9.81],
        damping: Damping {
            mass: 1.0,
            material: 1e-3,
        },
        ..fixed_steps(step, 0.8)
    }
}

fn control(between: Between) -> Control {
    Control {
        period: PERIOD,
        between,
    }
}

/// Tensions of all motions in a period (N).
fn tensions(period: usize) -> Vec<f64> {
    let of = |i: usize| 20.0 + 20.0 * f64::sin(0.37 * (i * i) as f64 + 0.8 * period as f64);
    (0..3 * COUNT).map(of).collect()
}

/// Largest distance (m) of a tip from that of the same motion in fine steps, over half a second.
fn error(model: Model, elements: usize, step: f64, between: Between) -> f64 {
    let robot = study_robot(9, 0.0);
    let make = |threads| {
        let size = (COUNT, threads);
        let (of, control) = ((model, elements), control(between));
        Motions::new(&robot, of, settings(step), control, [0.0; 3], size).unwrap()
    };
    let mut motions = make(1);
    let all: Vec<_> = (0..COUNT).collect();
    motions.reset(&all, &tensions(0)).unwrap();
    let mut singles: Vec<_> = [0, 4, 10]
        .map(|i| {
            let fine = settings(2e-4);
            let mut single = Simulator::new(&robot, model, elements, fine).unwrap();
            single
                .rest(&by_tensions(&tensions(0)[3 * i..][..3]))
                .unwrap();
            (i, single)
        })
        .into();
    let (mut seen, mut worst) = (Observations::default(), 0.0);
    for period in 1..=25 {
        let now = tensions(period);
        motions.step(&now).unwrap();
        motions.observe(&mut seen);
        for (i, single) in &mut singles {
            let load = by_tensions(&now[3 * *i..][..3]);
            if between == Between::Held {
                single.jump(&load).unwrap();
            }
            assert_eq!(single.advance(PERIOD, &load).unwrap().0, None);
            let tip = single.tip().0;
            let apart = (0..3).map(|q| (tip[q] - seen.position[3 * *i + q]).powi(2));
            worst = f64::max(worst, apart.sum::<f64>().sqrt());
        }
    }
    assert!((0..COUNT).all(|i| motions.status(i) == MotionStatus::Moving));
    worst
}

#[test]
fn motions_converge_to_single_ones() {
    for between in [Between::Held, Between::Linear] {
        let errors = [2e-3, 1e-3].map(|step| error(Model::default(), 1, step, between));
        assert!(
            errors[0] < 0.005 && errors[1] < 0.35 * errors[0],
            "{errors:?}"
        );
    }
    assert!(error(kirchhoff(), 1, 1e-3, Between::Held) < 0.002);
    assert!(error(Model::default(), 2, 1e-3, Between::Held) < 0.002);
}

#[test]
fn a_period_does_not_allocate() {
    let robot = study_robot(9, 0.0);
    let (of, control) = ((Model::default(), 1), control(Between::Held));
    let size = (COUNT, 1);
    let made = Motions::new(&robot, of, settings(2e-3), control, [0.0; 3], size);
    let mut motions = made.unwrap();
    let all: Vec<_> = (0..COUNT).collect();
    motions.reset(&all, &tensions(0)).unwrap();
    let rows: Vec<_> = (1..20).map(tensions).collect();
    motions.step(&rows[0]).unwrap();
    // other tests run on other threads: the fewest of many
    let allocated = |row: &Vec<f64>| {
        let before = ALLOCATED.load(Ordering::Relaxed);
        motions.step(row).unwrap();
        ALLOCATED.load(Ordering::Relaxed) - before
    };
    assert_eq!(rows[1..].iter().map(allocated).min(), Some(0));
}
