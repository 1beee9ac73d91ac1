//! WebAssembly interface of `bowstring-core` for the playground (`web/`): statics, constant
//! curvature, inverse kinematics, stress and motion of one robot.
//!
//! Numbers are in SI and cross as flat arrays; no mechanics is computed here.

#![warn(missing_docs)]

mod arcs;
mod bench;
mod effects;
mod loads;
mod motion;
mod reach;
#[cfg(test)]
mod tests;

pub use arcs::CurvatureLaw;
use bench::Bench;
pub use effects::Effect;
use loads::Loads;
use wasm_bindgen::prelude::*;

type Answer<T> = Result<T, JsError>;

fn error(sentence: impl ToString) -> JsError {
    JsError::new(&sentence.to_string())
}

/// A robot with its last equilibrium, and the state of its motion.
#[wasm_bindgen]
pub struct Playground(Bench);

/// How a solve ended.
#[wasm_bindgen]
pub struct Solved {
    /// Whether the equilibrium was found; if not, the last pose is kept.
    pub converged: bool,
    /// Largest moment imbalance over (bending stiffness / length); a solution is below 1e-10.
    pub residual: f64,
    /// Estimated discretisation error of the tip (m); NaN without a solution.
    pub error: f64,
    /// Newton steps.
    pub iterations: usize,
    sentence: String,
}

#[wasm_bindgen]
impl Solved {
    /// What to tell the user: empty for a plain solution.
    #[wasm_bindgen(getter)]
    pub fn sentence(&self) -> String {
        self.sentence.clone()
    }
}

#[wasm_bindgen]
impl Playground {
    /// A robot from the text of a compiled robot, in its home pose.
    #[wasm_bindgen(constructor)]
    pub fn new(compiled: &str) -> Answer<Playground> {
        Bench::new(compiled).map(Playground).map_err(error)
    }

    /// Gives each segment a round section, outer and inner radius (m), for stress.
    #[wasm_bindgen(js_name = setRadii)]
    pub fn set_radii(&mut self, outer: &[f64], inner: &[f64]) -> Answer<()> {
        self.0.set_radii(outer, inner).map_err(error)
    }

    /// Equilibrium under a command of each tendon (N, or m with `displacements`) and nine numbers
    /// of dead loads: gravity (m/s^2), force (N) and moment (N m) on the tip. `cold` starts from the
    /// home pose, otherwise the path goes on from the last equilibrium.
    pub fn solve(
        &mut self,
        displacements: bool,
        commands: &[f64],
        loads: &[f64],
        cold: bool,
    ) -> Answer<Solved> {
        let loads = Loads::new(loads).map_err(error)?;
        let found = self.0.solve(displacements, commands, &loads, cold);
        let found = found.map_err(error)?;
        Ok(Solved {
            converged: found.converged,
            residual: found.residual,
            error: found.error,
            iterations: found.iterations,
            sentence: found.sentence,
        })
    }

    /// Tip (m) of the rod without an effect, from the home pose; empty where the effect does not act
    /// and where there is no equilibrium. Commands and loads as those of `solve`.
    #[wasm_bindgen(js_name = tipWithout)]
    pub fn tip_without(
        &self,
        effect: Effect,
        displacements: bool,
        commands: &[f64],
        loads: &[f64],
    ) -> Answer<Vec<f64>> {
        let loads = Loads::new(loads).map_err(error)?;
        let found = self.0.tip_without(effect, displacements, commands, &loads);
        Ok(found.map_err(error)?.map_or_else(Vec::new, Vec::from))
    }

    /// Position (3) and rotation (9, row by row, body to base) of each disk, from base to tip, in
    /// the present pose.
    pub fn disks(&self) -> Vec<f64> {
        self.0.disks()
    }

    /// Points of the backbone (m), three numbers each, from base to tip.
    pub fn backbone(&self) -> Vec<f64> {
        let fields = self.0.fields();
        fields.map_or_else(Vec::new, |fields| fields.sections.position.clone())
    }

    /// Largest von Mises stress (Pa) in the section of each point of the backbone; empty where the
    /// sections are not known to be round.
    pub fn stress(&self) -> Vec<f64> {
        self.0.stress()
    }

    /// Tension of each tendon (N) in the present pose.
    pub fn tensions(&self) -> Vec<f64> {
        let fields = self.0.fields();
        fields.map_or_else(Vec::new, |fields| fields.tendons.tension.clone())
    }

    /// Displacement of each tendon from the home pose (m) in the present pose.
    pub fn displacements(&self) -> Vec<f64> {
        let fields = self.0.fields();
        fields.map_or_else(Vec::new, |fields| fields.tendons.displacement.clone())
    }

    /// By how much the path of each tendon is shorter than in the straight robot (m), in the last
    /// equilibrium: its displacement, but where it is slack or elastic.
    #[wasm_bindgen(js_name = pathDisplacements)]
    pub fn path_displacements(&self) -> Vec<f64> {
        self.0.path_displacements()
    }

    /// Slack of each tendon (m) in the present pose; zero where it is taut.
    pub fn slack(&self) -> Vec<f64> {
        let fields = self.0.fields();
        fields.map_or_else(Vec::new, |fields| fields.tendons.slack.clone())
    }

    /// Constant curvature: position (3) and rotation (9) at `steps` equal steps of each segment,
    /// from base to tip. Commands are tensions (N), of the laws from lengths displacements (m).
    #[wasm_bindgen(js_name = constantCurvature)]
    pub fn constant_curvature(
        &self,
        law: CurvatureLaw,
        commands: &[f64],
        steps: usize,
    ) -> Answer<Vec<f64>> {
        let found = self.0.arcs().poses(law, commands, steps);
        found.map_err(error)
    }

    /// Tensions (N) from zero to `most` whose tip is nearest to a position (m), under nine numbers of
    /// dead loads as those of `solve`; empty without an equilibrium. `warm` starts from the tensions
    /// found last.
    pub fn reach(
        &mut self,
        position: &[f64],
        most: &[f64],
        loads: &[f64],
        warm: bool,
    ) -> Answer<Vec<f64>> {
        let position = position.try_into();
        let position = position.map_err(|_| error("a position must be three numbers"))?;
        let loads = Loads::new(loads).map_err(error)?;
        let found = self.0.reach(position, most, &loads, warm).map_err(error)?;
        Ok(found.unwrap_or_default().to_vec())
    }

    /// Starts a motion from the last equilibrium; in it commands and loads go to the given ones
    /// within `rise` seconds. `damping` is proportional to mass (1/s).
    pub fn release(
        &mut self,
        commands: &[f64],
        loads: &[f64],
        rise: f64,
        damping: f64,
    ) -> Answer<()> {
        let loads = Loads::new(loads).map_err(error)?;
        let started = self.0.release(commands, &loads, rise, damping);
        started.map_err(error)
    }

    /// Advances the motion by a duration (s). Returns an empty sentence, or why it stopped.
    pub fn advance(&mut self, duration: f64) -> Answer<String> {
        self.0.advance(duration).map_err(error)
    }

    /// Kinetic energy of the motion (J).
    #[wasm_bindgen(js_name = kineticEnergy)]
    pub fn kinetic_energy(&self) -> f64 {
        self.0.kinetic_energy()
    }
}
