//! The robot as constant curvature sees it.

use bowstring_core::math::linalg::{Mat3, Vec3};
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

/// Models of constant curvature; of a law that the robot does not allow, the sentence that says so.
pub struct Curvature {
    linear: Result<RobotArcs, String>,
    lengths: Result<RobotArcs, String>,
    chords: Result<RobotArcs, String>,
    /// Length of each straight tendon (m).
    straight: Vec<f64>,
}

impl Curvature {
    pub fn new(robot: &Robot) -> Self {
        let of = |law| RobotArcs::new(robot, law).map_err(|error| error.to_string());
        let spec = robot.spec();
        let end =
            |tendon: &bowstring_core::model::robot::Tendon| spec.disks[tendon.end_disk].station;
        Curvature {
            linear: of(Law::Linear),
            lengths: of(Law::Lengths),
            chords: of(Law::Chords),
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
        let (arcs, law, commands) = match law {
            CurvatureLaw::Linear => (&self.linear, Law::Linear, commands.to_vec()),
            CurvatureLaw::Lengths => (&self.lengths, Law::Lengths, lengths()),
            CurvatureLaw::Chords => (&self.chords, Law::Chords, lengths()),
        };
        let found = arcs.as_ref().map_err(String::clone)?;
        let found = found
            .arcs(law, &commands)
            .map_err(|error| error.to_string())?;
        let mut poses = Vec::with_capacity(12 * (found.len() * steps + 1));
        let mut position = Vec3::zero();
        let mut frame = Mat3::<f64>::identity();
        let mut add = |position: Vec3, frame: Mat3<f64>| {
            poses.extend(position.0);
            poses.extend(frame.0.as_flattened());
        };
        add(position, frame);
        for arc in found {
            let (start, axes) = (position, frame);
            for step in 1..=steps {
                let part = arc.part(arc.length * step as f64 / steps as f64);
                let pose = part.map_err(|error| error.to_string())?.pose();
                position = start + axes * Vec3(pose.position);
                frame = axes * Mat3(pose.rotation);
                add(position, frame);
            }
        }
        Ok(poses)
    }
}
