//! The robot as constant curvature sees it.

use bowstring_core::model::robot::Robot;
use bowstring_core::robot_arcs::{Law, RobotArcs};
use wasm_bindgen::prelude::wasm_bindgen;

/// Constant-curvature models of the page.
#[wasm_bindgen]
#[derive(Clone, Copy)]
pub enum CurvatureLaw {
    /// From tensions, linear law.
    Linear,
    /// From commanded tendon lengths.
    Lengths,
    /// From commanded tendon lengths, with tendons straight between the disks.
    Chords,
}

/// Models of constant curvature.
pub struct Curvature {
    linear: RobotArcs,
    lengths: RobotArcs,
    chords: RobotArcs,
    /// Length of each straight tendon (m).
    straight: Vec<f64>,
}

impl Curvature {
    pub fn new(robot: &Robot) -> Self {
        let spec = robot.spec();
        let end =
            |tendon: &bowstring_core::model::robot::Tendon| spec.disks[tendon.end_disk].station;
        Curvature {
            linear: RobotArcs::new(robot, Law::Linear),
            lengths: RobotArcs::new(robot, Law::Lengths),
            chords: RobotArcs::new(robot, Law::Chords),
            straight: spec.tendons.iter().map(end).collect(),
        }
    }

    /// Position (3) and rotation (9) at `steps` equal steps of each segment, from base to tip.
    pub fn poses(
        &self,
        law: CurvatureLaw,
        commands: &[f64],
        steps: usize,
    ) -> Result<Vec<f64>, String> {
        if commands.len() != self.straight.len() {
            return Err(format!(
                "{} commands, and the robot has {} tendons",
                commands.len(),
                self.straight.len()
            ));
        }
        let lengths = || {
            let pairs = commands.iter().zip(&self.straight);
            pairs.map(|(p, l)| l - p).collect()
        };
        let (arcs, commands) = match law {
            CurvatureLaw::Linear => (&self.linear, commands.to_vec()),
            CurvatureLaw::Lengths => (&self.lengths, lengths()),
            CurvatureLaw::Chords => (&self.chords, lengths()),
        };
        let found = arcs.arcs(&commands).map_err(|error| error.to_string())?;
        let mut places = vec![0.0];
        for segment in &found {
            let start = places[places.len() - 1];
            let step = segment.arc.length / steps as f64;
            places.extend((1..=steps).map(|k| start + step * k as f64));
        }
        let poses = arcs.poses(&found, &places).into_iter();
        Ok(poses
            .flat_map(|pose| pose.position.into_iter().chain(pose.rotation.concat()))
            .collect())
    }
}
