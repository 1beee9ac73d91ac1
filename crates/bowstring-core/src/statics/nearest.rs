//! Displacements without an equilibrium: which tendons fight, and the nearest that have one.

use crate::model::load::Load;
use crate::statics::path_step::PathStep;
use crate::statics::solver::Status;
use crate::tendon::{Command, History};

/// Compliances that all tendons share, over that of bending: less and less.
const COMPLIANCES: [f64; 4] = [1.0, 0.1, 1e-2, 1e-3];
/// Share of the length lacked before that is left where tendons fight: what only stretch makes up
/// for falls with the compliance.
const STAYS: f64 = 0.3;
/// Length lacked, over the robot's, that counts as none.
const NO_LENGTH: f64 = 1e-6;
/// Share of the largest length lacked from which a tendon fights.
const FIGHTS: f64 = 0.1;

/// Nearest displacements that have an equilibrium.
pub(crate) struct Nearest {
    /// Tendons that pull against each other.
    pub fighting: Vec<usize>,
    /// By tendons, m; NaN under tension control.
    pub displacements: Vec<f64>,
}

impl PathStep {
    /// Least squares of what displacements lack, friction aside, from the home pose; none where no
    /// tendons fight.
    pub fn nearest(
        &mut self,
        home: &History,
        commands: &[Command],
        load: &Load,
    ) -> Option<Nearest> {
        let before = self.transmission.tendons.compliance.before.clone();
        let now = self.transmission.tendons.now.clone();
        let friction = std::mem::replace(&mut self.transmission.friction.enabled, false);
        let mut best = None;
        let mut lacked = f64::INFINITY;
        for share in COMPLIANCES {
            let tendons = &mut self.transmission.tendons;
            let more = share * tendons.compliance.scale;
            for (to, from) in tendons.compliance.before.iter_mut().zip(&before) {
                *to = from + more;
            }
            if self.solve(home, commands, load).status != Status::Converged {
                break;
            }
            let lacks: Vec<f64> = self.lacks(commands, more);
            let most = lacks.iter().copied().fold(0.0, f64::max);
            let stays = lacked.is_finite() && most > STAYS * lacked;
            let length = self.solver.robot().length();
            best = (stays && most > NO_LENGTH * length).then(|| Nearest {
                fighting: (0..commands.len())
                    .filter(|&i| lacks[i] > FIGHTS * most)
                    .collect(),
                displacements: commands
                    .iter()
                    .zip(&lacks)
                    .map(|(command, lack)| match command {
                        Command::Displacement(p) => p - lack,
                        Command::Tension(_) => f64::NAN,
                    })
                    .collect(),
            });
            lacked = most;
        }
        self.transmission.tendons.compliance.before = before;
        self.transmission.tendons.now = now;
        self.transmission.friction.enabled = friction;
        best
    }

    /// Length that every tendon lacks by a compliance, m; zero under tension control.
    fn lacks(&self, commands: &[Command], compliance: f64) -> Vec<f64> {
        let tensions = &self.transmission.tendons.now.tensions;
        let lack = |(command, tension): (&Command, &f64)| match command {
            Command::Displacement(_) => compliance * tension,
            Command::Tension(_) => 0.0,
        };
        commands.iter().zip(tensions).map(lack).collect()
    }
}
