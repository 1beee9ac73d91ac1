//! Ten thousand robots that have an equilibrium, and ten thousand that may have none.
//!
//! An answer is checked from the outside: the wrench that tendons, disks and dead loads leave
//! to the backbone is balanced here from the poses alone, and the rod's differential equation
//! is integrated under it from each disk to the one before.

use bowstring_core::linalg::{Mat3, Vec3};
use bowstring_core::load::{Load, Model, TendonPath, Theory};
use bowstring_core::robot::{Disk, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::{Outcome, Pose, Solver, Status, TOLERANCE};
use std::time::{Duration, Instant};

/// SplitMix64: the same draws everywhere, and each by its number alone.
struct Draw(u64);

impl Draw {
    fn new(test: u64, number: usize) -> Self {
        let mut draw = Draw(test << 32 | number as u64);
        draw.next();
        Draw(draw.next())
    }
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn within(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Every decade as likely as another.
    fn decades(&mut self, from: f64, to: f64) -> f64 {
        self.within(from.ln(), to.ln()).exp()
    }
    fn count(&mut self, from: usize, to: usize) -> usize {
        from + (self.next() % (to - from + 1) as u64) as usize
    }
    fn often(&mut self, probability: f64) -> bool {
        self.within(0.0, 1.0) < probability
    }
    fn direction(&mut self) -> Vec3 {
        let (z, a) = (
            self.within(-1.0, 1.0),
            self.within(0.0, std::f64::consts::TAU),
        );
        let r = (1.0 - z * z).sqrt();
        Vec3([r * a.cos(), r * a.sin(), z])
    }
}

#[derive(Clone, Debug)]
struct Case {
    spec: RobotSpec,
    tensions: Vec<f64>,
    tip_force: Vec3,
    tip_moment: Vec3,
    theory: Theory,
    tendon: TendonPath,
}

impl Case {
    /// A robot of realistic size and loads that bend it as in use.
    fn realistic(draw: &mut Draw) -> Self {
        let segments = draw.count(1, 3);
        let diameter = draw.decades(0.3e-3, 8e-3);
        let young = draw.decades(1e9, 210e9);
        let density = draw.within(1000.0, 8000.0);
        let slenderness = draw.decades(40.0, 200.0);
        let poisson = draw.within(0.2, 0.45);
        let (mut sections, mut disks, mut tendons) = (vec![], vec![], vec![]);
        let (mut station, mut tensions, mut softest) = (0.0, vec![], f64::INFINITY);
        for segment in 0..segments {
            let d = diameter * draw.within(0.7, 1.0).powi(segment as i32);
            let (area, inertia) = (
                std::f64::consts::PI * d * d / 4.0,
                std::f64::consts::PI * d.powi(4) / 64.0,
            );
            let shear = young / (2.0 * (1.0 + poisson));
            sections.push(Section {
                bending: young * inertia,
                torsion: shear * 2.0 * inertia,
                axial: young * area,
                shear: shear * area,
                mass_per_length: density * area,
                rotary_inertia: density * inertia,
            });
            let length = d * slenderness * draw.within(0.7, 1.0);
            let count = draw.count(2, 20);
            // half of it also goes off the next segment's first module
            let clamp = f64::min(length / count as f64 * draw.within(0.0, 0.4), d * 0.4);
            // the weight of all disks, held across, bends the segment by up to a third or so
            let mass = draw.within(0.0, 1.0) * young * inertia
                / (length * length)
                / 9.81
                / (count * segments * segments) as f64;
            for k in 1..=count {
                disks.push(Disk {
                    station: station + length * k as f64 / count as f64,
                    clamped_length: clamp,
                    mass,
                    inertia: [mass * d * d, mass * d * d],
                    segment,
                });
            }
            station += length;
            softest = f64::min(softest, young * inertia);
            let first = draw.within(0.0, std::f64::consts::TAU);
            let pitch = length * draw.within(0.02, 0.1);
            let holes = draw.count(3, 6);
            for i in 0..holes {
                let angle = first
                    + std::f64::consts::TAU * (i as f64 + draw.within(-0.3, 0.3)) / holes as f64;
                let r = pitch * draw.within(0.7, 1.0);
                tendons.push(Tendon {
                    hole: [r * angle.cos(), r * angle.sin()],
                    end_disk: disks.len() - 1,
                });
                // the linear law: theta = T r L / EI
                let theta = if draw.often(0.5) {
                    draw.within(0.0, 1.5)
                } else {
                    0.0
                };
                tensions.push(theta * young * inertia / (pitch * length));
            }
        }
        let force = draw.within(0.0, 3.0) * softest / (station * station);
        Case {
            spec: RobotSpec {
                sections,
                disks,
                tendons,
                gravity: (draw.direction() * if draw.often(0.7) { 9.81 } else { 0.0 }).0,
            },
            tensions,
            tip_force: draw.direction() * if draw.often(0.7) { force } else { 0.0 },
            tip_moment: Vec3([0.0; 3]),
            theory: if draw.often(0.5) {
                Theory::Cosserat
            } else {
                Theory::Kirchhoff
            },
            tendon: TendonPath::Straight,
        }
    }

    fn model(&self) -> Model {
        Model {
            theory: self.theory,
            tendon: self.tendon,
            twist: true,
        }
    }

    fn at<'a>(&self, fraction: f64, tensions: &'a mut Vec<f64>) -> Load<'a> {
        tensions.clear();
        tensions.extend(self.tensions.iter().map(|t| t * fraction));
        Load {
            tensions,
            gravity: self.spec.gravity.map(|g| g * fraction),
            tip_force: (self.tip_force * fraction).0,
            tip_moment: (self.tip_moment * fraction).0,
        }
    }

    /// Tip at the end of a forward path from rest: stable at every step, no jump.
    fn forward_path(&self, robot: &Robot) -> Option<Vec3> {
        let mut solver = Solver::new(robot, self.model(), 1).unwrap();
        let mut tensions = vec![];
        let mut tip = Vec3([0.0, 0.0, robot.length()]);
        for step in 1..=16 {
            let load = self.at(step as f64 / 16.0, &mut tensions);
            let outcome = solver.solve_next(&load).unwrap();
            let sound = outcome.status == Status::Converged
                && outcome.stable == Some(true)
                && !outcome.left_unstable;
            let place = solver.tip()?.position;
            if !sound || (place - tip).norm() > 0.25 * robot.length() {
                return None;
            }
            tip = place;
        }
        Some(tip)
    }

    /// How far the poses are from solving the rod's equation: the largest gap at a disk, by
    /// place over length of module and by angle.
    fn gap(&self, robot: &Robot, solver: &Solver, steps: usize) -> f64 {
        let spec = robot.spec();
        let gravity = Vec3(spec.gravity);
        let base = Pose {
            rotation: Mat3::identity(),
            position: Vec3([0.0; 3]),
        };
        let poses: Vec<_> = std::iter::once(base)
            .chain((0..spec.disks.len()).map(|k| solver.disk(k).unwrap()))
            .collect();
        let hole = |t: &Tendon, k: usize| poses[k].rotation * Vec3([t.hole[0], t.hole[1], 0.0]);
        // of the backbone beyond the disk, about the disk
        let (mut force, mut moment) = (self.tip_force, self.tip_moment);
        let mut worst: f64 = 0.0;
        for k in (0..spec.disks.len()).rev() {
            let (start, end) = (poses[k], poses[k + 1]);
            let disk = spec.disks[k];
            force += gravity * disk.mass;
            for (t, tension) in spec.tendons.iter().zip(&self.tensions) {
                let arm = hole(t, k + 1);
                let unit = |v: Vec3| v * (1.0 / v.norm());
                let mut pull = Vec3([0.0; 3]);
                if t.end_disk >= k {
                    pull -= unit(end.position + arm - start.position - hole(t, k)) * *tension;
                }
                if t.end_disk > k {
                    let next = poses[k + 2].position + hole(t, k + 2);
                    pull += unit(next - end.position - arm) * *tension;
                }
                force += pull;
                moment += arm.cross(pull);
            }
            let before = if k == 0 {
                (0.0, 0.0)
            } else {
                (
                    spec.disks[k - 1].station,
                    spec.disks[k - 1].clamped_length / 2.0,
                )
            };
            let pitch = disk.station - before.0;
            let mut section = Station {
                pose: end,
                force,
                moment,
            };
            let s = &spec.sections[disk.segment];
            let stiff = |section: &mut Station, length: f64| section.rigid(s, gravity, length);
            stiff(&mut section, disk.clamped_length / 2.0);
            let flexible = pitch - disk.clamped_length / 2.0 - before.1;
            section.integrate(s, self.theory, gravity, flexible, steps);
            stiff(&mut section, before.1);
            let place = (section.pose.position - start.position).norm() / pitch;
            let turn = section.pose.rotation.tr_mat(start.rotation) - Mat3::identity();
            let angle = turn.rows().map(|r| r.norm2()).iter().sum::<f64>().sqrt();
            worst = worst.max(place).max(angle);
            if !(place.is_finite() && angle.is_finite()) {
                return f64::INFINITY;
            }
            // keep the solver's pose, carry the wrench on
            moment = section.moment + (section.pose.position - start.position).cross(section.force);
            force = section.force;
        }
        worst
    }
}

/// A section of the backbone: its pose and the wrench of all beyond on it.
#[derive(Clone, Copy)]
struct Station {
    pose: Pose,
    force: Vec3,
    moment: Vec3,
}

impl Station {
    /// Back along a clamp.
    fn rigid(&mut self, s: &Section, gravity: Vec3, length: f64) {
        let back = self.pose.rotation.column(2) * length;
        let weight = gravity * (s.mass_per_length * length);
        self.moment += back.cross(self.force) + (back * 0.5).cross(weight);
        self.force += weight;
        self.pose.position -= back;
    }

    /// Back along the elastic rod, by the classical method of Runge and Kutta.
    fn integrate(&mut self, s: &Section, theory: Theory, gravity: Vec3, length: f64, steps: usize) {
        let rate = |x: &Station| {
            let r = &x.pose.rotation;
            let m = r.tr_mul(x.moment);
            let n = r.tr_mul(x.force);
            let u = Vec3([m[0] / s.bending, m[1] / s.bending, m[2] / s.torsion]);
            let mut v = Vec3([0.0, 0.0, 1.0]);
            if theory == Theory::Cosserat {
                v += Vec3([n[0] / s.shear, n[1] / s.shear, n[2] / s.axial]);
            }
            let along = *r * v;
            Station {
                pose: Pose {
                    rotation: *r * u.skew(),
                    position: along,
                },
                force: -(gravity * s.mass_per_length),
                moment: -along.cross(x.force),
            }
        };
        let plus = |x: &Station, d: &Station, h: f64| Station {
            pose: Pose {
                rotation: x.pose.rotation + d.pose.rotation * Mat3::scalar(h),
                position: x.pose.position + d.pose.position * h,
            },
            force: x.force + d.force * h,
            moment: x.moment + d.moment * h,
        };
        let h = -length / steps as f64;
        for _ in 0..steps {
            let a = rate(self);
            let b = rate(&plus(self, &a, h / 2.0));
            let c = rate(&plus(self, &b, h / 2.0));
            let d = rate(&plus(self, &c, h));
            for (k, weight) in [(a, 1.0), (b, 2.0), (c, 2.0), (d, 1.0)] {
                *self = plus(self, &k, h * weight / 6.0);
            }
        }
    }
}

#[test]
fn realistic_robots_converge_from_straight() {
    let (mut kept, mut drawn, mut converged, mut elsewhere, mut fine) = (0, 0, 0, 0, 0);
    let mut closed = 0;
    let (mut worst_fine, mut worst_ratio) = (0.0f64, 0.0f64);
    let mut gaps = vec![];
    let mut tensions = vec![];
    while kept < 10_000 {
        let case = Case::realistic(&mut Draw::new(1, drawn));
        drawn += 1;
        let robot = Robot::new(case.spec.clone()).unwrap();
        let Some(path_tip) = case.forward_path(&robot) else {
            continue;
        };
        kept += 1;
        let mut solver = Solver::new(&robot, case.model(), 1).unwrap();
        let load = case.at(1.0, &mut tensions);
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
        let gap = case.gap(&robot, &solver, 12);
        gaps.push(gap);
        // finer elements tell the method's own error from a false answer
        if gap > 1e-3 || kept % 50 == 0 {
            let mut solver = Solver::new(&robot, case.model(), 8).unwrap();
            if solver.solve(&load).unwrap().status != Status::Converged {
                // the finer rod can fold where the coarse one just does not
                closed += 1;
                continue;
            }
            let gap_fine = case.gap(&robot, &solver, 100);
            // fourth order; shear and extension are averaged over a module whatever its elements
            let most = match case.theory {
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
         branch; gap: median {:.1e}, 99 % {:.1e}, worst {:.1e}; {fine} with 8 elements, worst {worst_fine:.1e}, {worst_ratio:.1e} of the gap with 1, {closed} without an answer",
        gaps[gaps.len() / 2],
        gaps[gaps.len() * 99 / 100],
        gaps[gaps.len() - 1]
    );
    assert!(converged * 1000 >= kept * 995);
    assert!(elsewhere * 1000 <= kept * 5 && closed * 1000 <= kept * 10);
}

/// A number that nobody should give, or only just.
fn extreme(draw: &mut Draw) -> f64 {
    match draw.count(0, 39) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -draw.decades(1e-12, 1e12),
        3 => 0.0,
        4 => [f64::MAX, f64::MIN_POSITIVE, 5e-324, f64::NEG_INFINITY][draw.count(0, 3)],
        _ => draw.decades(1e-12, 1e12),
    }
}

fn hostile(draw: &mut Draw) -> Case {
    let mut case = Case::realistic(draw);
    if draw.often(0.2) {
        case.spec.disks.truncate(1);
        case.spec.sections.truncate(1);
        case.spec.tendons.iter_mut().for_each(|t| t.end_disk = 0);
    }
    if draw.often(0.1) {
        case.spec.tendons.clear();
        case.tensions.clear();
    }
    if draw.often(0.2) {
        case.tendon = TendonPath::Continuous;
    }
    if draw.often(0.3) {
        case.tip_moment = draw.direction() * draw.decades(1e-6, 1e6);
    }
    for _ in 0..draw.count(1, 4) {
        let value = extreme(draw);
        let spec = &mut case.spec;
        let section = draw.count(0, spec.sections.len() - 1);
        let s = &mut spec.sections[section];
        let disk = draw.count(0, spec.disks.len() - 1);
        let d = &mut spec.disks[disk];
        let axis = draw.count(0, 2);
        match draw.count(0, 15) {
            0 => s.bending = value,
            1 => s.torsion = value,
            2 => s.axial = value,
            3 => s.shear = value,
            4 => s.mass_per_length = value,
            5 => d.station = value,
            6 => d.clamped_length = value,
            7 => d.mass = value,
            8 => spec.gravity[axis] = value,
            9 => case.tip_force[axis] = value,
            10 => case.tip_moment[axis] = value,
            11 => d.segment = draw.count(0, 3),
            kind if spec.tendons.is_empty() => case.tensions.extend((kind > 13).then_some(value)),
            kind => {
                let i = draw.count(0, spec.tendons.len() - 1);
                match kind {
                    12 => spec.tendons[i].hole = [value, extreme(draw)],
                    13 => spec.tendons[i].hole = [0.0; 2],
                    14 => case.tensions[i] = value,
                    _ => case
                        .tensions
                        .iter_mut()
                        .for_each(|t| *t *= draw.decades(1.0, 1e9)),
                }
            }
        }
    }
    if draw.often(0.05) {
        // one disk hardly beyond the one before
        let last = case.spec.disks.len() - 1;
        let gap = draw.decades(1e-15, 1e-6);
        if last > 0 {
            case.spec.disks[last].station = case.spec.disks[last - 1].station + gap;
        }
        case.spec
            .disks
            .iter_mut()
            .for_each(|d| d.clamped_length = 0.0);
    }
    case
}

fn one_sentence(message: &str) {
    assert!(
        !message.is_empty() && !message.contains('\n') && !message.contains(". "),
        "{message}"
    );
}

#[test]
fn hostile_robots_do_no_harm() {
    let (mut refused, mut converged, mut failed, mut wild_jacobians) = (0, 0, 0, 0);
    let mut total = Duration::ZERO;
    let mut slowest = (Duration::ZERO, 0, String::new());
    for number in 0..10_000 {
        let case = hostile(&mut Draw::new(2, number));
        let robot = match Robot::new(case.spec.clone()) {
            Ok(robot) => robot,
            Err(e) => {
                one_sentence(&e.to_string());
                refused += 1;
                continue;
            }
        };
        let mut solver = Solver::new(&robot, case.model(), 1).unwrap();
        let load = Load {
            tensions: &case.tensions,
            gravity: case.spec.gravity,
            tip_force: case.tip_force.0,
            tip_moment: case.tip_moment.0,
        };
        let start = Instant::now();
        let outcome = match solver.solve(&load) {
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
        if let Some(j) = solver.jacobians() {
            wild_jacobians += usize::from(format!("{j:?}").contains("NaN"));
        }
    }
    println!(
        "{refused} refused, {converged} converged ({wild_jacobians} without finite derivatives), \
         {failed} without an answer; {total:?} in all, slowest {slowest:?}"
    );
    // half a second where the machine is idle
    assert!(slowest.0 < Duration::from_secs(5), "{slowest:?}");
}

/// The stated error of the tip against the error, by a rod of eight elements, over 2 000 robots.
#[test]
fn stated_error_covers_the_error() {
    for theory in [Theory::Kirchhoff, Theory::Cosserat] {
        for elements in [1, 2] {
            let (mut kept, mut covered, mut close, mut drawn) = (0, 0, 0, 0);
            let (mut ratios, mut tensions) = (vec![], vec![]);
            while kept < 500 {
                let mut case = Case::realistic(&mut Draw::new(7, drawn));
                drawn += 1;
                case.theory = theory;
                let robot = Robot::new(case.spec.clone()).unwrap();
                let load = case.at(1.0, &mut tensions);
                let mut fine = Solver::new(&robot, case.model(), 8).unwrap();
                let mut coarse = Solver::new(&robot, case.model(), elements).unwrap();
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
                if error > 0.1 * robot.length()
                    || rest > 0.1 * stated
                    || error < 1e-10 * robot.length()
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
                "{theory:?}, {elements}: {covered} of {kept} covered, {close} within 30 times; \
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
}
