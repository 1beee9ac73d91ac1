//! Motion of robots that are driven by pulls, hang slack and rub.

mod common;

use bowstring_core::drive::{Command, Drive, Line};
use bowstring_core::dynamics::{Damping, Fields, Settings, Simulator, Step, Stop};
use bowstring_core::load::{Load, Model, Theory};
use bowstring_core::robot::Robot;
use bowstring_core::statics::Status;
use common::{pull, rao_robot, study_robot};

fn settings(step: f64, rho: f64) -> Settings {
    Settings {
        gravity: [0.0; 3],
        damping: Damping {
            mass: 0.0,
            material: 0.0,
        },
        spectral_radius: rho,
        step: Step::Fixed(step),
    }
}

fn lines(robot: &Robot, line: Line) -> Vec<Line> {
    vec![line; robot.tendon_count()]
}

/// At rest in the equilibrium of commands.
fn at_rest(robot: &Robot, model: Model, s: Settings, line: Line, commands: &[Command], load: &Load) -> (Simulator, Drive) {
    let mut simulator = Simulator::new(robot, model, 1, s).unwrap();
    let mut drive = simulator.drive(&lines(robot, line)).unwrap();
    let outcome = drive.step(commands, load).unwrap();
    assert_eq!(outcome.status, Status::Converged);
    assert_eq!(simulator.rest_at(&drive).unwrap(), None);
    (simulator, drive)
}

fn pulls(values: &[f64]) -> Vec<Command> {
    values.iter().map(|p| Command::Pull(*p)).collect()
}

#[test]
fn explore() {
    let robot = study_robot(9, 0.0);
    let stiff = Line::default();
    let elastic = Line { stiffness: 3e4, ..stiff };
    for (name, line) in [("stiff", stiff), ("elastic", elastic)] {
        for rho in [1.0, 0.8] {
            for h in [5e-3, 2e-3, 1e-3, 5e-4] {
                let mut s = settings(h, rho);
                s.damping.mass = 0.5;
                let (mut sim, _) = at_rest(&robot, Model::default(), s, line, &pulls(&[0.0; 3]), &pull(&[0.0; 3]));
                let mut iterations = 0;
                let mut steps = 0;
                let mut f = Fields::default();
                let mut stop = None;
                let start = std::time::Instant::now();
                for i in 1..=100 {
                    let p = 0.02 * f64::min(i as f64 / 50.0, 1.0);
                    let (st, count) = sim.advance(0.01, &pull(&[p, -p / 2.0, -p / 2.0])).unwrap();
                    iterations += count.iterations;
                    steps += count.steps;
                    if st.is_some() { stop = st; break; }
                    sim.record(0, &mut f);
                }
                let wall = start.elapsed().as_secs_f64();
                let e = sim.energies();
                let n = f.tension.len();
                println!("{name} rho {rho} h {h}: {stop:?} steps {steps} it {iterations} {:.1} us/it tip {:?} T {:?} slack {:?} left {:e} {e:?}",
                    1e6 * wall / iterations as f64, sim.tip().0, &f.tension[n - 6..], &f.slack[n - 3..], e.kinetic + e.elastic - e.work + e.dissipated);
            }
        }
    }
}
