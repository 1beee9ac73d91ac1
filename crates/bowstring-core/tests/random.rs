//! Ten thousand robots that have an equilibrium, and ten thousand that may have none.
//!
//! A solution is checked independently: the wrench that tendons, disks and dead loads exert on the
//! backbone is computed here from the poses alone, and the rod's differential equations are
//! integrated under it from each disk to the one before.

#[path = "common/cases.rs"]
mod cases;
mod common;

use bowstring_core::model::load::{PointLoad, Theory};
use bowstring_core::model::robot::{Profile, Robot};
use bowstring_core::statics::solver::{Outcome, Solver, Status, TOLERANCE};
use cases::{hostile, Case, Draw};
use std::ops::Range;
use std::time::{Duration, Instant};

#[test]
fn realistic_robots_converge_from_straight() {
    let (mut kept, mut drawn, mut converged, mut elsewhere, mut fine) = (0, 0, 0, 0, 0);
    let mut closed = 0;
    let (mut worst_fine, mut worst_ratio) = (0.0f64, 0.0f64);
    let mut gaps = vec![];
    while kept < 10_000 {
        let case = Case::realistic(&mut Draw::new(1, drawn));
        drawn += 1;
        let robot = Robot::new(case.spec.clone()).unwrap();
        let Some(path_tip) = case.forward_path(&robot) else {
            continue;
        };
        kept += 1;
        let mut solver = Solver::new(&robot, case.model, 1).unwrap();
        let load = case.load.borrow();
        let outcome = solver.solve(&load).unwrap();
        if outcome.status != Status::Converged {
            println!("draw {}: {outcome:?}", drawn - 1);
            continue;
        }
        converged += 1;
        assert!(
            outcome.residual <= TOLERANCE && outcome.stable == Some(true),
            "{outcome:?}"
        );
        if !((solver.tip().unwrap().position - path_tip).norm() < 1e-6 * robot.length()) {
            elsewhere += 1;
        }
        let gap = case.gap(&robot, &solver, 12).expect("not that taut");
        gaps.push(gap);
        // finer elements distinguish discretisation error from a wrong solution
        if gap > 1e-3 || kept % 50 == 0 {
            let mut solver = Solver::new(&robot, case.model, 8).unwrap();
            if solver.solve(&load).unwrap().status != Status::Converged {
                // disks of the finer rod can collide where those of the coarse one just do not
                closed += 1;
                continue;
            }
            let gap_fine = case.gap(&robot, &solver, 100).expect("not that taut");
            // fourth order; shear and extension are averaged over a module whatever its elements
            let most = match case.model.theory {
                Theory::Kirchhoff => f64::max(1e-6, gap / 300.0),
                Theory::Cosserat => f64::max(1e-5, gap / 40.0),
            };
            assert!(
                gap_fine <= most,
                "draw {}: gap {gap:.1e}, with 8 elements {gap_fine:.1e}",
                drawn - 1
            );
            fine += 1;
            worst_ratio = worst_ratio.max(gap_fine / gap.max(1e-5));
            worst_fine = worst_fine.max(gap_fine);
        }
    }
    gaps.sort_by(f64::total_cmp);
    println!(
        "{drawn} drawn, {kept} with a path, {converged} converged, {elsewhere} of them on another \
         branch; gap: median {:.1e}, 99 % {:.1e}, worst {:.1e}; {fine} with 8 elements, worst {worst_fine:.1e}, {worst_ratio:.1e} of the gap with 1, {closed} without a solution",
        gaps[gaps.len() / 2],
        gaps[gaps.len() * 99 / 100],
        gaps[gaps.len() - 1]
    );
    assert!(converged * 1000 >= kept * 995);
    assert!(elsewhere * 1000 <= kept * 5 && closed * 1000 <= kept * 10);
}

fn one_sentence(message: &str) {
    assert!(
        !message.is_empty() && !message.contains('\n') && !message.contains(". "),
        "{message}"
    );
}

// two tests, for two cores
#[test]
#[ignore = "takes minutes: make test-all"]
fn hostile_robots_give_no_wrong_solution() {
    hostile_robots(0..5_000);
}

#[test]
#[ignore = "takes minutes: make test-all"]
fn more_hostile_robots_give_no_wrong_solution() {
    hostile_robots(5_000..10_000);
}

fn hostile_robots(numbers: Range<usize>) {
    let (mut refused, mut converged, mut failed, mut wild_jacobians) = (0, 0, 0, 0);
    let mut total = Duration::ZERO;
    let mut slowest = (Duration::ZERO, 0, String::new());
    for number in numbers {
        let case = hostile(&mut Draw::new(2, number));
        let robot = match Robot::new(case.spec.clone()) {
            Ok(robot) => robot,
            Err(e) => {
                one_sentence(&e.to_string());
                refused += 1;
                continue;
            }
        };
        let mut solver = Solver::new(&robot, case.model, 1).unwrap();
        let start = Instant::now();
        let outcome = match solver.solve(&case.load.borrow()) {
            Ok(outcome) => outcome,
            Err(e) => {
                one_sentence(&e.to_string());
                refused += 1;
                continue;
            }
        };
        let taken = start.elapsed();
        total += taken;
        if taken > slowest.0 {
            slowest = (
                taken,
                number,
                format!("{outcome:?}, {} disks", robot.module_count()),
            );
        }
        if outcome.status != Status::Converged {
            failed += 1;
            continue;
        }
        converged += 1;
        assert!(outcome.residual <= TOLERANCE, "draw {number}: {outcome:?}");
        let mut finite =
            (0..robot.tendon_count()).all(|i| solver.tendon_length(i).unwrap().is_finite());
        for k in 0..robot.module_count() {
            let pose = solver.disk(k).unwrap();
            finite &= pose.position.norm().is_finite();
            finite &= pose
                .rotation
                .rows()
                .iter()
                .all(|r| (r.norm() - 1.0).abs() < 1e-6);
        }
        finite &= solver
            .centerline(3)
            .unwrap()
            .iter()
            .all(|p| p.norm().is_finite());
        assert!(finite, "draw {number}: {outcome:?} {case:?}");
        if let Some(j) = solver.jacobians(false) {
            wild_jacobians += usize::from(format!("{j:?}").contains("NaN"));
        }
    }
    println!(
        "{refused} refused, {converged} converged ({wild_jacobians} without finite derivatives), \
         {failed} without a solution; {total:?} in all, slowest {slowest:?}"
    );
    // half a second on an idle machine
    assert!(slowest.0 < Duration::from_secs(5), "{slowest:?}");
}

#[test]
fn stated_errors_of_kirchhoff_rods_cover_the_error() {
    compare_stated_errors(Theory::Kirchhoff);
}

#[test]
fn stated_errors_of_cosserat_rods_cover_the_error() {
    compare_stated_errors(Theory::Cosserat);
}

/// The stated error of the tip against the error with respect to eight elements, over 1 500 robots;
/// a third of them are softer in torsion than any tube, like notched ones.
fn compare_stated_errors(theory: Theory) {
    for (elements, torsion) in [(1, 1.0), (2, 1.0), (1, 0.02)] {
        let (mut kept, mut covered, mut close, mut drawn) = (0, 0, 0, 0);
        let mut ratios = vec![];
        while kept < 500 {
            let mut case = Case::realistic(&mut Draw::new(7, drawn));
            drawn += 1;
            case.model.theory = theory;
            for section in case
                .spec
                .backbone
                .iter_mut()
                .flat_map(Profile::sections_mut)
            {
                section.torsion *= torsion;
            }
            let robot = Robot::new(case.spec.clone()).unwrap();
            let load = case.load.borrow();
            let mut fine = Solver::new(&robot, case.model, 8).unwrap();
            let mut coarse = Solver::new(&robot, case.model, elements).unwrap();
            let mut found = fine.solve(&load).unwrap();
            let mut outcome = coarse.solve(&load).unwrap();
            let sound = |o: &Outcome| o.status == Status::Converged && !o.left_unstable;
            if !sound(&found) || !sound(&outcome) {
                continue;
            }
            let (fine_tip, tip) = (fine.tip().unwrap(), coarse.tip().unwrap());
            fine.estimate_error(&mut found);
            coarse.estimate_error(&mut outcome);
            let rest = found.error.unwrap().tip;
            let stated = outcome.error.unwrap().tip;
            let error = (tip.position - fine_tip.position).norm();
            // another branch, or no better reference
            if error > 0.1 * robot.length() || rest > 0.1 * stated || error < 1e-10 * robot.length()
            {
                continue;
            }
            kept += 1;
            let ratio = stated / error;
            covered += usize::from(ratio >= 1.0);
            close += usize::from(ratio <= 30.0);
            ratios.push(ratio);
        }
        ratios.sort_by(f64::total_cmp);
        println!(
            "{theory:?}, {elements}, torsion {torsion}: {covered} of {kept} covered, {close} within 30 times; \
             least {:.2}, 1 % {:.2}, median {:.2}, 90 % {:.2}, most {:.1e}",
            ratios[0],
            ratios[kept / 100],
            ratios[kept / 2],
            ratios[kept * 9 / 10],
            ratios[kept - 1]
        );
        assert!(covered * 100 >= kept * 99 && close * 10 >= kept * 9);
    }
}

/// 2 000 robots with all of it: tapered, flat, precurved, routed freely through thick holes, with
/// payloads, and with forces on disks, beside their centres and along the backbone. Where a path in
/// small steps reaches a stable equilibrium, a single solve finds one too.
#[test]
fn robots_with_everything_converge() {
    let (mut known, mut found, mut worst) = (0, 0, 0.0_f64);
    for number in 0..2000 {
        let case = Case::realistic(&mut Draw::new(41, number));
        let mut draw = Draw::new(43, number);
        let mut case = case.tapered(&mut draw).routed(&mut draw).laden(&mut draw);
        let robot = Robot::new(case.spec.clone()).unwrap();
        // small beside the tensions and the force on the tip
        let (n, length) = (robot.module_count(), robot.length());
        let size = 0.2 * robot.moment_scale() / length;
        let mut force = |size: f64| (draw.direction() * (size * draw.within(0.0, 1.0))).0;
        case.load.disk_forces = (0..n).map(|_| force(size)).collect();
        case.load.line_forces = vec![force(size / length); n];
        let point = |disk| PointLoad {
            disk,
            point: force(0.05 * length),
            force: force(size),
            ..PointLoad::default()
        };
        case.load.point_loads = [number % n, n - 1].map(point).to_vec();
        let Some(tip) = case.forward_path(&robot) else {
            continue;
        };
        known += 1;
        let mut solver = Solver::new(&robot, case.model, 1).unwrap();
        let outcome = solver.solve(&case.load.borrow()).unwrap();
        if outcome.status == Status::Converged {
            found += 1;
            assert_ne!(outcome.stable, Some(false), "draw {number}");
            let again = solver.tip().unwrap().position;
            worst = worst.max((again - tip).norm() / length);
        }
    }
    println!("{found} of {known} known equilibria found; farthest tip {worst:.2}");
    assert!(known > 1200, "{known}");
    assert!(found as f64 >= 0.99 * known as f64, "{found} of {known}");
}
