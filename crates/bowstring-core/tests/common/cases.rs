//! Random robots under random loads, and an independent check of a solution.
#![allow(dead_code)]

use super::common::{coupled, section};
pub use super::common::{inverse, Draw, Stiffness};
use bowstring_core::math::linalg::{Mat3, Vec3};
use bowstring_core::model::load::{Model, OwnedLoad, PointLoad, TendonPath, Theory};
use bowstring_core::model::robot::{Disk, Payload, Profile, Robot, RobotSpec, Section, Tendon};
use bowstring_core::statics::solver::{Pose, Solver, Status};

impl Draw {
    pub fn direction(&mut self) -> Vec3 {
        let (z, a) = (
            self.within(-1.0, 1.0),
            self.within(0.0, std::f64::consts::TAU),
        );
        let r = (1.0 - z * z).sqrt();
        Vec3([r * a.cos(), r * a.sin(), z])
    }
}

#[derive(Clone, Debug)]
pub struct Case {
    pub spec: RobotSpec,
    pub load: OwnedLoad,
    /// Strains by moments and forces where they are coupled, by segments; empty if none are.
    pub compliances: Vec<Stiffness>,
    pub model: Model,
}

impl Case {
    /// A robot of realistic size, with loads that bend it as in use.
    pub fn realistic(draw: &mut Draw) -> Self {
        let segments = draw.count(1, 3);
        let diameter = draw.decades(0.3e-3, 8e-3);
        let young = draw.decades(1e9, 210e9);
        let density = draw.within(1000.0, 8000.0);
        let slenderness = draw.decades(40.0, 200.0);
        let poisson = draw.within(0.2, 0.45);
        let (mut backbone, mut disks, mut tendons) = (vec![], vec![], vec![]);
        let (mut station, mut tensions, mut softest) = (0.0, vec![], f64::INFINITY);
        for segment in 0..segments {
            let d = diameter * draw.within(0.7, 1.0).powi(segment as i32);
            let round = section(d, young, poisson, density);
            let bending = round.bending[0];
            backbone.push(Profile::from(round));
            let length = d * slenderness * draw.within(0.7, 1.0);
            let count = draw.count(2, 20);
            // half of it is also subtracted from the next segment's first module
            let clamp = f64::min(length / count as f64 * draw.within(0.0, 0.4), d * 0.4);
            // the horizontal weight of all disks bends the segment by up to about a third
            let mass = draw.within(0.0, 1.0) * bending
                / (length * length)
                / 9.81
                / (count * segments * segments) as f64;
            for k in 1..=count {
                disks.push(Disk {
                    hole_length: 0.0,
                    station: station + length * k as f64 / count as f64,
                    clamped_length: clamp,
                    mass,
                    inertia: [mass * d * d, mass * d * d],
                    segment,
                });
            }
            station += length;
            softest = f64::min(softest, bending);
            let first = draw.within(0.0, std::f64::consts::TAU);
            let pitch = length * draw.within(0.02, 0.1);
            let holes = draw.count(3, 6);
            for i in 0..holes {
                let angle = first
                    + std::f64::consts::TAU * (i as f64 + draw.within(-0.3, 0.3)) / holes as f64;
                let r = pitch * draw.within(0.7, 1.0);
                tendons.push(Tendon {
                    holes: vec![[r * angle.cos(), r * angle.sin()]],
                    end_disk: disks.len() - 1,
                    pushes: false,
                });
                // the linear law: theta = T r L / EI
                let theta = if draw.often(0.5) {
                    draw.within(0.0, 1.5)
                } else {
                    0.0
                };
                tensions.push(theta * bending / (pitch * length));
            }
        }
        let force = draw.within(0.0, 3.0) * softest / (station * station);
        let mut often = |size: f64| (draw.direction() * if draw.often(0.7) { size } else { 0.0 }).0;
        let (gravity, tip_force) = (often(9.81), often(force));
        let theory = match draw.often(0.5) {
            true => Theory::Cosserat,
            false => Theory::Kirchhoff,
        };
        Case {
            spec: RobotSpec {
                payloads: vec![],
                backbone,
                disks,
                tendons,
                gravity,
            },
            load: OwnedLoad {
                tensions,
                gravity,
                tip_force,
                ..OwnedLoad::default()
            },
            compliances: vec![],
            model: Model {
                theory,
                ..Model::default()
            },
        }
    }

    /// The same robot with tendons that wind around the backbone, converge, and meet their holes
    /// with random errors.
    pub fn routed(mut self, draw: &mut Draw) -> Self {
        let disks = &self.spec.disks;
        let length = disks[disks.len() - 1].station;
        for tendon in &mut self.spec.tendons {
            let [x, y] = tendon.holes[0];
            let (turns, wider) = (draw.within(-0.7, 0.7), draw.within(-0.5, 0.5));
            let stations = disks[..=tendon.end_disk].iter().map(|d| d.station);
            let place = |station: f64| {
                let share = station / length;
                let (sin, cos) = (std::f64::consts::TAU * turns * share).sin_cos();
                let size = 1.0 + wider * share;
                let at = [size * (cos * x - sin * y), size * (sin * x + cos * y)];
                at.map(|x| x * draw.within(0.95, 1.05))
            };
            tendon.holes = std::iter::once(0.0).chain(stations).map(place).collect();
        }
        self
    }

    /// The same robot with a backbone that is curved and twisted without load.
    pub fn precurved(mut self, draw: &mut Draw) -> Self {
        let disks = &self.spec.disks;
        let length = disks[disks.len() - 1].station;
        for section in self
            .spec
            .backbone
            .iter_mut()
            .flat_map(Profile::sections_mut)
        {
            section.rest_curvature = (draw.direction() * (draw.within(0.0, 2.0) / length)).0;
        }
        self
    }

    /// The same robot with backbones that are tapered, flat, curved and twisted without load.
    pub fn tapered(mut self, draw: &mut Draw) -> Self {
        let length = self.spec.disks.last().unwrap().station;
        for profile in &mut self.spec.backbone {
            let mut first = profile.sections()[0];
            first.bending[1] *= draw.decades(0.3, 1.0);
            first.principal_angle = draw.within(-3.0, 3.0);
            first.rest_curvature = [0; 3].map(|_| draw.within(-1.0, 1.0) / length);
            let end = draw.within(0.6, 1.3);
            *profile = Profile::Tapered(Box::new(std::array::from_fn(|i| {
                let size: f64 = 1.0 + (end - 1.0) * i as f64 / 4.0;
                let (area, moment) = (size.powi(2), size.powi(4));
                Section {
                    bending: first.bending.map(|b| b * moment),
                    torsion: first.torsion * moment,
                    axial: first.axial * area,
                    shear: first.shear * area,
                    mass_per_length: first.mass_per_length * area,
                    rotary_inertia: first.rotary_inertia * moment,
                    ..first
                }
            })));
        }
        self
    }

    /// The same robot with sections by their stiffness matrix, curved without load.
    pub fn coupled(mut self, draw: &mut Draw) -> Self {
        let length = self.spec.disks.last().unwrap().station;
        self.model.theory = Theory::Cosserat;
        for profile in &mut self.spec.backbone {
            let s = profile.sections()[0];
            let sizes = [
                s.bending[0],
                s.bending[1] * draw.within(0.5, 1.0),
                s.torsion,
                s.shear,
                s.shear * draw.within(0.5, 1.0),
                s.axial,
            ];
            let share = draw.within(0.1, 0.6);
            let stiffness = coupled(draw, sizes, share);
            let rest = [0; 3].map(|_| draw.within(-1.0, 1.0) / length);
            self.compliances.push(inverse(&stiffness));
            *profile = Profile::of_stiffness(stiffness, s.mass_per_length, s.rotary_inertia, rest);
        }
        self
    }

    /// The same robot with forces and moments at points of its disks, and on its backbone between
    /// them, some of which turn with it.
    pub fn loaded(mut self, draw: &mut Draw) -> Self {
        let disks = &self.spec.disks;
        let (n, length) = (disks.len(), disks.last().unwrap().station);
        let sections = self
            .spec
            .backbone
            .iter()
            .map(|p| p.sections()[0].bending[0]);
        let size = sections.fold(f64::INFINITY, f64::min) / (length * length);
        for _ in 0..draw.count(1, 3) {
            let disk = draw.count(0, n - 1);
            // on the flexible part of the module before the disk
            let (start, clamp) = match disk {
                0 => (0.0, 0.0),
                _ => (
                    disks[disk - 1].station,
                    0.5 * disks[disk - 1].clamped_length,
                ),
            };
            let end = disks[disk].station - 0.5 * disks[disk].clamped_length;
            let within = draw.within(0.1, 0.9);
            let between = start + clamp + within * (end - start - clamp);
            self.load.point_loads.push(PointLoad {
                disk,
                arc_length: draw.often(0.5).then_some(between),
                point: (draw.direction() * draw.within(0.0, 0.05 * length)).0,
                force: (draw.direction() * (draw.within(0.0, 1.0) * size)).0,
                moment: (draw.direction() * (draw.within(0.0, 0.3) * size * length)).0,
                follower: draw.often(0.3),
            });
        }
        self
    }

    /// The same robot with rods in place of some tendons, which push in half of the loads.
    pub fn pushed(mut self, draw: &mut Draw) -> Self {
        for (tendon, tension) in self.spec.tendons.iter_mut().zip(&mut self.load.tensions) {
            tendon.pushes = draw.often(0.5);
            if tendon.pushes && draw.often(0.5) {
                *tension = -*tension;
            }
        }
        self
    }

    /// The same robot with payloads on some of its disks, and with thick holes.
    pub fn laden(mut self, draw: &mut Draw) -> Self {
        let n = self.spec.disks.len();
        let mut station = 0.0;
        for disk in &mut self.spec.disks {
            disk.hole_length = draw.within(0.0, 0.4) * (disk.station - station);
            station = disk.station;
        }
        let shortest = (self.spec.disks.windows(2))
            .map(|pair| pair[1].station - pair[0].station)
            .fold(self.spec.disks[0].station, f64::min);
        for disk in &mut self.spec.disks {
            disk.hole_length = disk.hole_length.min(0.8 * shortest);
        }
        for _ in 0..2 {
            let disk = (draw.within(0.0, n as f64) as usize).min(n - 1);
            self.spec.payloads.push(Payload {
                disk,
                mass: draw.within(0.0, 0.5) * self.spec.disks[disk].mass,
                centre: (draw.direction() * draw.within(0.0, 0.1 * station)).0,
                inertia: [0.0; 3],
            });
        }
        self
    }

    /// A fraction of the load.
    pub fn at(&self, fraction: f64) -> OwnedLoad {
        let mut load = self.load.clone();
        load.scale(fraction, fraction);
        load
    }

    /// Tip at the end of a forward path from rest; `None` unless stable at every step and without
    /// jumps.
    pub fn forward_path(&self, robot: &Robot) -> Option<Vec3> {
        let mut solver = Solver::new(robot, self.model, 1).unwrap();
        let mut tip: Option<Vec3> = None;
        for step in 0..=16 {
            let load = self.at(step as f64 / 16.0);
            let outcome = solver.solve_next(&load.borrow()).unwrap();
            let sound = outcome.status == Status::Converged
                && outcome.stable == Some(true)
                && !outcome.left_unstable;
            let place = solver.tip()?.position;
            let jumps = tip.is_some_and(|tip| (place - tip).norm() > 0.25 * robot.length());
            if !sound || jumps {
                return None;
            }
            tip = Some(place);
        }
        tip
    }

    /// Residual of the poses in the rod's differential equations: the largest gap at a disk, in
    /// position over the length of the module and in angle, over the amplification of a difference
    /// by the integration along a taut module; `None` where that is a thousand or more.
    pub fn gap(&self, robot: &Robot, solver: &Solver, steps: usize) -> Option<f64> {
        let spec = robot.spec();
        let load = &self.load;
        let gravity = Vec3(load.gravity);
        let base = Pose {
            rotation: Mat3::identity(),
            position: Vec3([0.0; 3]),
        };
        let poses: Vec<_> = std::iter::once(base)
            .chain((0..spec.disks.len()).map(|k| solver.disk(k).unwrap()))
            .collect();
        // entry (-1) or exit (1) of the hole of a disk, counted from 1; the base has a point
        let hole = |t: &Tendon, k: usize, side: f64| {
            let [x, y] = t.hole(k);
            let length = if k == 0 {
                0.0
            } else {
                spec.disks[k - 1].hole_length
            };
            poses[k].rotation * Vec3([x, y, side * 0.5 * length])
        };
        // internal force and moment of the backbone beyond the disk, about the disk
        let (mut force, mut moment) = (Vec3(load.tip_force), Vec3(load.tip_moment));
        let mut worst: f64 = 0.0;
        for k in (0..spec.disks.len()).rev() {
            let (start, end) = (poses[k], poses[k + 1]);
            let disk = spec.disks[k];
            let on = |vectors: &[[f64; 3]]| Vec3(vectors.get(k).copied().unwrap_or_default());
            force += gravity * disk.mass + on(&load.disk_forces);
            moment += on(&load.disk_moments);
            for payload in spec.payloads.iter().filter(|p| p.disk == k) {
                let weight = gravity * payload.mass;
                force += weight;
                moment += (end.rotation * Vec3(payload.centre)).cross(weight);
            }
            for (t, tension) in spec.tendons.iter().zip(&load.tensions) {
                if *tension == 0.0 {
                    continue; // its direction may be lost in rounding
                }
                let unit = |v: Vec3| v * (1.0 / v.norm());
                if t.end_disk >= k {
                    let arm = hole(t, k + 1, -1.0);
                    let span = end.position + arm - start.position - hole(t, k, 1.0);
                    let pull = unit(span) * -*tension;
                    force += pull;
                    moment += arm.cross(pull);
                }
                if t.end_disk > k {
                    let arm = hole(t, k + 1, 1.0);
                    let next = poses[k + 2].position + hole(t, k + 2, -1.0);
                    let pull = unit(next - end.position - arm) * *tension;
                    force += pull;
                    moment += arm.cross(pull);
                }
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
            let applied = |load: &PointLoad, turn: Mat3| {
                let given = [Vec3(load.force), Vec3(load.moment)];
                let [force, own] = given.map(|v| if load.follower { turn * v } else { v });
                [force, (turn * Vec3(load.point)).cross(force) + own]
            };
            for load in &load.point_loads {
                if load.arc_length.is_none() && load.disk == k {
                    let [f, m] = applied(load, end.rotation);
                    force += f;
                    moment += m;
                }
            }
            let mut section = Station {
                pose: end,
                force,
                moment,
            };
            let profile = &spec.backbone[disk.segment];
            let ends = |segment: usize| {
                let last = spec.disks.iter().rfind(|d| d.segment == segment);
                last.map_or(0.0, |d| d.station)
            };
            let start_of_segment = match disk.segment {
                0 => 0.0,
                segment => ends(segment - 1),
            };
            let along = ends(disk.segment) - start_of_segment;
            let flexible = pitch - disk.clamped_length / 2.0 - before.1;
            let from = (before.0 + before.1 - start_of_segment) / along;
            let to = from + flexible / along;
            let s = profile.at(0.5 * (from + to));
            let line = on(&load.line_forces);
            let clamp =
                |from: f64, to: f64| gravity * profile.mean(from, to, |s| s.mass_per_length) + line;
            let held = disk.clamped_length / 2.0;
            section.rigid(clamp(to, to + held / along), held);
            let rod = Flexible {
                at: &|x: f64| profile.at(from + x * (to - from)),
                compliance: self.compliances.get(disk.segment),
                theory: self.model.theory,
                gravity,
                line,
                length: flexible,
            };
            // back to each load on it, from the end
            let mut loads: Vec<_> = (load.point_loads.iter())
                .filter_map(|load| {
                    let part = (load.arc_length? - before.0 - before.1) / flexible;
                    (0.0..=1.0).contains(&part).then_some((part, load))
                })
                .collect();
            loads.sort_by(|a, b| b.0.total_cmp(&a.0));
            let mut done = 1.0;
            for (part, load) in loads {
                section.integrate(&rod, [done, part], steps);
                let [f, m] = applied(load, section.pose.rotation);
                section.force += f;
                section.moment += m;
                done = part;
            }
            section.integrate(&rod, [done, 0.0], steps);
            section.rigid(clamp(from - before.1 / along, from), before.1);
            // positions are rounded to the size of the robot, however short the module
            let unit = f64::max(pitch, 1e-6 * robot.length());
            let place = (section.pose.position - start.position).norm() / unit;
            // only a tensile force amplifies a difference
            let pull = f64::max(
                force.dot(end.rotation.column(2)),
                section.force.dot(start.rotation.column(2)),
            );
            let growth = (pitch * (pull.max(0.0) / s.bending[0]).sqrt()).cosh();
            if growth > 1e3 {
                return None;
            }
            let turn = section.pose.rotation.tr_mat(start.rotation) - Mat3::identity();
            let angle = turn.rows().map(|r| r.norm2()).iter().sum::<f64>().sqrt();
            worst = worst.max(place / growth).max(angle / growth);
            if !(place.is_finite() && angle.is_finite()) {
                return Some(f64::INFINITY);
            }
            // keep the solver's pose and integrate the wrench further
            moment = section.moment + (section.pose.position - start.position).cross(section.force);
            force = section.force;
        }
        Some(worst)
    }
}

/// Flexible part of a module.
struct Flexible<'a> {
    /// Section at a fraction of it.
    at: &'a dyn Fn(f64) -> Section,
    compliance: Option<&'a Stiffness>,
    theory: Theory,
    gravity: Vec3,
    /// Force per length.
    line: Vec3,
    length: f64,
}

impl Flexible<'_> {
    /// Curvature and the strain along the backbone, under a moment and a force in body axes.
    fn strain(&self, s: &Section, m: Vec3, n: Vec3) -> [Vec3; 2] {
        let mut v = Vec3([0.0, 0.0, 1.0]);
        if let Some(compliance) = self.compliance {
            let wrench = [m[0], m[1], m[2], n[0], n[1], n[2]];
            let by = |row: &[f64; 6]| row.iter().zip(wrench).map(|(c, w)| c * w).sum::<f64>();
            let [a, b, c, x, y, z] = compliance.each_ref().map(by);
            return [
                Vec3(s.rest_curvature) + Vec3([a, b, c]),
                v + Vec3([x, y, z]),
            ];
        }
        // in the principal axes and back
        let (sin, cos) = s.principal_angle.sin_cos();
        let first = (cos * m[0] + sin * m[1]) / s.bending[0];
        let second = (cos * m[1] - sin * m[0]) / s.bending[1];
        let bent = Vec3([
            cos * first - sin * second,
            sin * first + cos * second,
            m[2] / s.torsion,
        ]);
        if self.theory == Theory::Cosserat {
            v += Vec3([n[0] / s.shear, n[1] / s.shear, n[2] / s.axial]);
        }
        [Vec3(s.rest_curvature) + bent, v]
    }
}

/// A section of the backbone: its pose and the wrench of the distal part on it.
#[derive(Clone, Copy)]
struct Station {
    pose: Pose,
    force: Vec3,
    moment: Vec3,
}

impl Station {
    /// Integrates backward along a clamp under a force per length.
    fn rigid(&mut self, line: Vec3, length: f64) {
        let back = self.pose.rotation.column(2) * length;
        let weight = line * length;
        self.moment += back.cross(self.force) + (back * 0.5).cross(weight);
        self.force += weight;
        self.pose.position -= back;
    }

    /// Integrates backward along the elastic rod, from one fraction of it to another, by the
    /// classical Runge-Kutta method.
    fn integrate(&mut self, rod: &Flexible, [end, start]: [f64; 2], steps: usize) {
        let rate = |x: &Station, fraction: f64| {
            let s = (rod.at)(fraction);
            let r = &x.pose.rotation;
            let [u, v] = rod.strain(&s, r.tr_mul(x.moment), r.tr_mul(x.force));
            let along = *r * v;
            Station {
                pose: Pose {
                    rotation: *r * u.skew(),
                    position: along,
                },
                force: -(rod.gravity * s.mass_per_length + rod.line),
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
        let h = (start - end) * rod.length / steps as f64;
        for step in 0..steps {
            let here = |half: f64| end + (start - end) * (step as f64 + half) / steps as f64;
            let a = rate(self, here(0.0));
            let b = rate(&plus(self, &a, h / 2.0), here(0.5));
            let c = rate(&plus(self, &b, h / 2.0), here(0.5));
            let d = rate(&plus(self, &c, h), here(1.0));
            for (k, weight) in [(a, 1.0), (b, 2.0), (c, 2.0), (d, 1.0)] {
                *self = plus(self, &k, h * weight / 6.0);
            }
        }
    }
}

/// A number that is invalid or barely valid.
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

/// A robot and loads with unrealistic numbers.
pub fn hostile(draw: &mut Draw) -> Case {
    let mut case = Case::realistic(draw);
    if draw.often(0.2) {
        case.spec.disks.truncate(1);
        case.spec.backbone.truncate(1);
        case.spec.tendons.iter_mut().for_each(|t| t.end_disk = 0);
    }
    if draw.often(0.1) {
        case.spec.tendons.clear();
        case.load.tensions.clear();
    }
    if draw.often(0.2) {
        case.model.tendon = TendonPath::Continuous;
    }
    if draw.often(0.3) {
        case.load.tip_moment = (draw.direction() * draw.decades(1e-6, 1e6)).0;
    }
    for _ in 0..draw.count(1, 4) {
        let value = extreme(draw);
        let spec = &mut case.spec;
        let section = draw.count(0, spec.backbone.len() - 1);
        let s = &mut spec.backbone[section].sections_mut()[0];
        let disk = draw.count(0, spec.disks.len() - 1);
        let d = &mut spec.disks[disk];
        let axis = draw.count(0, 2);
        match draw.count(0, 15) {
            0 => s.bending = [value; 2],
            1 => s.torsion = value,
            2 => s.axial = value,
            3 => s.shear = value,
            4 => s.mass_per_length = value,
            5 => d.station = value,
            6 => d.clamped_length = value,
            7 => d.mass = value,
            8 => spec.gravity[axis] = value,
            9 => case.load.tip_force[axis] = value,
            10 => case.load.tip_moment[axis] = value,
            11 => d.segment = draw.count(0, 3),
            kind if spec.tendons.is_empty() => {
                case.load.tensions.extend((kind > 13).then_some(value))
            }
            kind => {
                let i = draw.count(0, spec.tendons.len() - 1);
                match kind {
                    12 => spec.tendons[i].holes[0] = [value, extreme(draw)],
                    13 => spec.tendons[i].holes[0] = [0.0; 2],
                    14 => case.load.tensions[i] = value,
                    _ => case
                        .load
                        .tensions
                        .iter_mut()
                        .for_each(|t| *t *= draw.decades(1.0, 1e9)),
                }
            }
        }
    }
    if draw.often(0.05) {
        // one disk barely beyond the one before
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
    case.load.gravity = case.spec.gravity;
    case
}
