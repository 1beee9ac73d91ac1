//! Right-angle cantilever of Simo and Vu-Quoc (1988), "On the dynamics in space of rods undergoing
//! large motions - a geometrically exact approach".
//!
//! Two legs of length 10 in the x-z plane meet at a right angle; one end is clamped. A dead force
//! along y acts on the elbow, rises linearly from 0 to 50 in 1 s and falls to 0 in the next second.
//! Then the frame moves freely, with displacements as large as a leg. All numbers are without unit.

use bowstring_core::dynamics::integrator::{
    Damping, Energies, Fields, Integrator, Simulator, Step,
};
use bowstring_core::model::load::{Load, Model};
use bowstring_core::model::robot::{Disk, Robot, RobotSpec, Section};
use std::f64::consts::FRAC_PI_2;

const LEG: f64 = 10.0;
const END: f64 = 17.0;
/// Time between two records.
const SAMPLE: f64 = 0.02;

/// Largest or smallest displacement out of the plane, and its time.
#[derive(Clone, Copy, Debug)]
struct Peak {
    value: f64,
    time: f64,
}

/// Another geometrically exact code, 40 elements, steps of 0.005, given to two decimals: largest
/// and smallest displacement of the tip, smallest of the elbow.
const PUBLISHED: [Peak; 3] = [
    Peak {
        value: 8.25,
        time: 7.44,
    },
    Peak {
        value: -9.73,
        time: 15.87,
    },
    Peak {
        value: -4.06,
        time: 10.87,
    },
];

impl Peak {
    /// Largest of the samples times `sign`, by a parabola through its neighbours.
    fn of(samples: &[f64], sign: f64) -> Self {
        let by = |i: &usize, j: &usize| (sign * samples[*i]).total_cmp(&(sign * samples[*j]));
        let top = (1..samples.len() - 1).max_by(by).unwrap();
        let (before, here, after) = (samples[top - 1], samples[top], samples[top + 1]);
        let offset = 0.5 * (before - after) / (before - 2.0 * here + after);
        Peak {
            value: here - 0.25 * (before - after) * offset,
            time: (top as f64 + 1.0 + offset) * SAMPLE,
        }
    }
}

/// Largest relative distance of values and largest distance of times.
fn apart(found: &[Peak; 3], expected: &[Peak; 3]) -> [f64; 2] {
    let mut gaps = [0.0; 2];
    for (a, b) in found.iter().zip(expected) {
        gaps[0] = f64::max(gaps[0], (a.value / b.value - 1.0).abs());
        gaps[1] = f64::max(gaps[1], (a.time - b.time).abs());
    }
    gaps
}

/// Discretisation of the frame in space and time.
#[derive(Clone, Copy)]
struct Mesh {
    /// Modules in a leg.
    modules: usize,
    /// Length of backbone, curved without load, that makes the right angle.
    corner: f64,
    step: f64,
    spectral_radius: f64,
}

/// Without numerical damping.
const MESH: Mesh = Mesh {
    modules: 20,
    corner: 1e-3,
    step: 0.01,
    spectral_radius: 1.0,
};

impl Mesh {
    /// The frame: a quarter of a circle cuts its corner off.
    fn robot(&self) -> Robot {
        let radius = self.corner / FRAC_PI_2;
        let section = |curvature: f64| Section {
            bending: [1e3; 2],
            principal_angle: 0.0,
            torsion: 1e3,
            axial: 1e6,
            shear: 1e6,
            mass_per_length: 1.0,
            rotary_inertia: 10.0, // 20 about the axis
            rest_curvature: [0.0, curvature, 0.0],
        };
        let disk = |station: f64, segment: usize| Disk {
            hole_length: 0.0,
            station,
            clamped_length: 0.0,
            mass: 0.0,
            inertia: [0.0; 2],
            segment,
        };
        let n = self.modules;
        let straight = LEG - radius;
        let along = |k: usize| straight * k as f64 / n as f64;
        let after = straight + self.corner;
        let mut disks: Vec<_> = (1..=n).map(|k| disk(along(k), 0)).collect();
        disks.push(disk(straight + 0.5 * self.corner, 1));
        disks.push(disk(after, 1));
        disks.extend((1..=n).map(|k| disk(after + along(k), 2)));
        let backbone = [0.0, 1.0 / radius, 0.0].map(|c| section(c).into());
        Robot::new(RobotSpec {
            payloads: vec![],
            backbone: backbone.to_vec(),
            disks,
            tendons: vec![],
            gravity: [0.0; 3],
        })
        .unwrap()
    }

    /// Index of the disk in the middle of the corner.
    fn elbow(&self) -> usize {
        self.modules
    }

    fn run(&self) -> ([Peak; 3], Energies) {
        let robot = self.robot();
        let settings = Integrator {
            gravity: [0.0; 3],
            damping: Damping {
                mass: 0.0,
                material: 0.0,
            },
            spectral_radius: self.spectral_radius,
            step: Step::Fixed(self.step),
        };
        let n = robot.module_count();
        let mut simulator = Simulator::new(&robot, Model::default(), 1, settings).unwrap();
        simulator.rest(&Load::default()).unwrap();
        assert!(simulator.is_ready());
        let (mut fields, mut forces) = (Fields::default(), vec![[0.0; 3]; n]);
        for i in 1..=(END / SAMPLE).round() as usize {
            let time = SAMPLE * i as f64;
            forces[self.elbow()][1] = 50.0 * (1.0 - (time - 1.0).abs()).max(0.0);
            let load = Load {
                disk_forces: &forces,
                ..Load::default()
            };
            let (stop, _) = simulator.advance(SAMPLE, &load).unwrap();
            assert_eq!(stop, None, "at {time}");
            simulator.record(0, &mut fields);
        }
        let across = |disk: usize| -> Vec<f64> {
            let places = fields.disks.position.chunks_exact(3 * n);
            places.map(|p| p[3 * disk + 1]).collect()
        };
        let (tip, elbow) = (across(n - 1), across(self.elbow()));
        let peaks = [
            Peak::of(&tip, 1.0),
            Peak::of(&tip, -1.0),
            Peak::of(&elbow, -1.0),
        ];
        (peaks, *simulator.energies())
    }
}

/// The frame without load is the right angle, cut at its corner.
#[test]
fn the_legs_are_at_a_right_angle() {
    use bowstring_core::statics::solver::Solver;
    let robot = MESH.robot();
    let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
    solver.solve(&Load::default()).unwrap();
    let [x, y, z] = solver.tip().unwrap().position.0;
    let gap = f64::max((x - LEG).hypot(z - LEG), y.abs());
    assert!(gap < 1e-11, "{gap:e}");
    let [x, _, z] = solver.disk(MESH.elbow()).unwrap().position.0;
    assert!(x.hypot(z - LEG) < 0.5 * MESH.corner);
}

/// Peaks within 0.1 % and 0.01, which is what the reference's two decimals allow.
///
/// Found: 8.251 at 7.440, -9.726 at 15.878 and -4.058 at 10.869. With 40 modules, a corner of 1e-4
/// and steps of 0.0025: 8.252 at 7.437, -9.727 at 15.873 and -4.060 at 10.864. The agreement also
/// confirms the reading of the force: its peak is at 1, and from 2 on it is zero.
#[test]
fn peaks_equal_those_of_another_code() {
    let (peaks, energies) = MESH.run();
    println!("{peaks:?}");
    let [value, time] = apart(&peaks, &PUBLISHED);
    assert!(value < 1e-3 && time < 0.01, "{value} {time}");
    // nothing is lost: all work of the force is still there
    let kept = (energies.kinetic + energies.elastic) / energies.work - 1.0;
    assert!(
        kept.abs() < 2e-5 && energies.dissipated == 0.0,
        "{energies:?}"
    );
}

/// Length, mass and compliance of the corner do not matter: neither half of it nor a hundredth
/// changes the peaks. They enter with the first order: a corner of 0.1, which is 1 % of a leg,
/// lowers the elbow's peak by 0.8 %.
#[test]
fn the_corner_does_not_matter() {
    let at = |corner: f64| Mesh { corner, ..MESH }.run().0;
    let found = at(MESH.corner);
    for (corner, most) in [(0.5 * MESH.corner, 1e-4), (1e-2 * MESH.corner, 2e-4)] {
        let [value, time] = apart(&found, &at(corner));
        assert!(value < most && time < 1e-3, "{corner}: {value} {time}");
    }
    let [value, _] = apart(&at(0.1), &found);
    assert!((5e-3..1e-2).contains(&value), "{value}");
}

/// Half the step, twice the modules, and some numerical damping change the peaks by 3e-5, 3e-4 and
/// 3e-6.
#[test]
fn time_step_and_modules_do_not_matter() {
    let found = MESH.run().0;
    let gap = |change: &dyn Fn(&mut Mesh), most: [f64; 2]| {
        let mut mesh = MESH;
        change(&mut mesh);
        let [value, time] = apart(&found, &mesh.run().0);
        println!("{value:e} {time:e}");
        assert!(value < most[0] && time < most[1], "{value} {time}");
    };
    gap(&|mesh| mesh.step *= 0.5, [5e-5, 1e-3]);
    gap(&|mesh| mesh.modules *= 2, [5e-4, 6e-3]);
    gap(&|mesh| mesh.spectral_radius = 0.8, [1e-4, 1e-3]);
}

/// The limit, with its orders: both steps and modules converge with the second order.
#[test]
#[ignore = "a study of convergence"]
fn peaks_converge() {
    let fine = Mesh {
        corner: 1e-4,
        ..MESH
    };
    let orders = |runs: [[Peak; 3]; 3]| {
        let [a, b, c] = runs;
        println!("{c:?}");
        std::array::from_fn::<_, 3, _>(|i| {
            ((a[i].value - b[i].value) / (b[i].value - c[i].value)).log2()
        })
    };
    let steps = [0.02, 0.01, 0.005].map(|step| Mesh { step, ..fine }.run().0);
    let modules = [10, 20, 40].map(|modules| Mesh { modules, ..fine }.run().0);
    for found in [orders(steps), orders(modules)] {
        println!("orders {found:?}");
        assert!(found.iter().all(|o| (1.5..3.0).contains(o)), "{found:?}");
    }
    let limit = Mesh {
        modules: 40,
        step: 0.0025,
        ..fine
    };
    let found = limit.run().0;
    println!("limit {found:?}");
    let [value, time] = apart(&found, &PUBLISHED);
    assert!(value < 1e-3 && time < 0.01, "{value} {time}");
}
