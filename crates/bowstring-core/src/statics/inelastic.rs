//! Inelastic backbone and tendons of a path, and the curvature that the backbone keeps without load.
//!
//! Theory: docs/theory/actuation.md (Hysteresis of the backbone, Relaxation and creep).

use crate::dispatch::Passes;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::robot::{Profile, Robot};
use crate::statics::hysteresis::{followed, Hysteresis};
use crate::statics::relaxation::{Creep, Lag, Relaxation};
use crate::tendon::{History, TERMS};

/// Weights of the neglected motion by an uneven bend of a module, and by the bulge of a compressed
/// one, which changes its mean bend. Measured against robots with the relaxed stiffness: 144 random
/// errors were at most 0.82 times the estimate.
const UNEVEN: f64 = 3.0;
const BULGE: f64 = 4.5e-3;

/// Laws of hysteresis, relaxation and creep of a robot; elastic by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inelasticity {
    /// Hysteresis of the backbone, by segments; empty if none.
    pub hysteresis: Vec<Hysteresis>,
    /// Terms of the relaxation of the backbone, by segments; empty if none.
    pub relaxation: Vec<[Relaxation; TERMS]>,
    /// Terms of the creep, by tendons; empty if none.
    pub creep: Vec<[Creep; TERMS]>,
}

/// Curvature that each module keeps without load, as it follows the present strain.
#[derive(Clone)]
pub(crate) struct UnloadedCurvature {
    modules: Vec<Module>,
    /// Curvature beyond that at rest which each module's play and lags have followed (1/m).
    pub plays: Vec<[f64; 2]>,
    pub lags: Vec<[[f64; 2]; TERMS]>,
}

#[derive(Clone)]
struct Module {
    hysteresis: Hysteresis,
    relaxation: [Relaxation; TERMS],
    /// Curvature without load and history (1/m).
    rest: Vec3,
    per_length: f64,
    /// Lag of each term at the end of the step without the part of the curvature there (1/m), and
    /// the weight of that part.
    carried: [[f64; 2]; TERMS],
    now: [f64; TERMS],
}

impl Module {
    /// Mean curvature beyond that at rest (1/m), by the bend from start to end (rad).
    fn beyond_rest(&self, bend: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|q| bend[q] * self.per_length - self.rest[q])
    }
}

impl UnloadedCurvature {
    /// Of a robot with these laws; `None` if its backbone is elastic.
    ///
    /// # Errors
    /// If a number is out of range, or a section has coupled strains.
    pub fn new(robot: &Robot, laws: &Inelasticity) -> Result<Option<Self>, InputError> {
        let Inelasticity {
            hysteresis,
            relaxation,
            ..
        } = laws;
        hysteresis.iter().try_for_each(Hysteresis::check)?;
        let terms = relaxation.as_flattened();
        terms.iter().try_for_each(Relaxation::check)?;
        let elastic = hysteresis.iter().all(|law| law.share == 0.0)
            && terms.iter().all(|law| law.share == 0.0);
        if elastic {
            return Ok(None);
        }
        let backbone = &robot.spec().backbone;
        for (what, count) in [
            ("hysteresis", hysteresis.len()),
            ("relaxation", relaxation.len()),
        ] {
            if count != 0 && count != backbone.len() {
                return Err(InputError::other(format!(
                    "{count} laws of {what} were given, a robot with {} segments needs one for each",
                    backbone.len()
                )));
            }
        }
        if backbone.iter().any(|p| matches!(p, Profile::Coupled(_))) {
            return Err(InputError::other(
                "hysteresis and relaxation need sections without coupled strains",
            ));
        }
        let module = |k: usize| {
            let segment = robot.spec().disks[k].segment;
            Module {
                hysteresis: hysteresis.get(segment).copied().unwrap_or_default(),
                relaxation: relaxation.get(segment).copied().unwrap_or_default(),
                rest: Vec3(robot.profile(k).sections()[0].rest_curvature),
                per_length: 1.0 / robot.flexible_length(k),
                carried: [[0.0; 2]; TERMS],
                now: [0.0; TERMS],
            }
        };
        let modules: Vec<_> = (0..robot.module_count()).map(module).collect();
        Ok(Some(UnloadedCurvature {
            plays: vec![[0.0; 2]; modules.len()],
            lags: vec![[[0.0; 2]; TERMS]; modules.len()],
            modules,
        }))
    }

    /// Prepares a step from `old`, whose strain has `arcs` entries in each module.
    pub fn begin(&mut self, old: &History, arcs: usize, duration: f64) {
        for (k, module) in self.modules.iter_mut().enumerate() {
            let strain = &old.strain[arcs * k..][..arcs];
            let curvature = module.beyond_rest([0, 1].map(|q| strain.iter().map(|w| w[q]).sum()));
            for (term, law) in module.relaxation.iter().enumerate() {
                let lag = Lag::over(duration, law.time);
                let state = old.lags[k][term];
                module.carried[term] = [0, 1].map(|q| lag.carried(state[q], curvature[q]));
                module.now[term] = lag.end;
            }
        }
    }

    /// Moves plays and lags from those of the last step, `old`, to the present strain of `arcs` in
    /// each module, and sets the unloaded curvature of the modules.
    pub fn follow(&mut self, engine: &mut dyn Passes, arcs: usize, old: &History) {
        let (now, modules) = (&mut self.plays, &self.modules);
        for (now, Module { rest, .. }) in now.iter_mut().zip(modules) {
            *now = [-rest[0], -rest[1]];
        }
        engine.strains(&mut |i, w| {
            let k = i / arcs;
            now[k][0] += w[0] * modules[k].per_length;
            now[k][1] += w[1] * modules[k].per_length;
        });
        for (k, module) in modules.iter().enumerate() {
            let curvature = now[k];
            for (term, lag) in self.lags[k].iter_mut().enumerate() {
                let (carried, end) = (module.carried[term], module.now[term]);
                *lag = [0, 1].map(|q| carried[q] + end * curvature[q]);
            }
            now[k] = followed(old.plays[k], curvature, module.hysteresis.play);
        }
        self.set_rest(engine);
    }

    /// Sets the unloaded curvature of the modules from plays and lags of a state.
    pub fn hold(&mut self, engine: &mut dyn Passes, state: &History) {
        self.plays.copy_from_slice(&state.plays);
        self.lags.copy_from_slice(&state.lags);
        self.set_rest(engine);
    }

    fn set_rest(&self, engine: &mut dyn Passes) {
        let (now, modules) = (&self.plays, &self.modules);
        let lags = &self.lags;
        engine.set_rest(&|k| {
            let Module {
                hysteresis,
                relaxation,
                rest,
                ..
            } = modules[k];
            let relaxed = |q: usize| -> f64 {
                let terms = relaxation.iter().zip(&lags[k]);
                terms.map(|(law, lag)| law.share * lag[q]).sum()
            };
            let kept = |q: usize| hysteresis.share * now[k][q] + relaxed(q);
            rest + Vec3([kept(0), kept(1), 0.0])
        });
    }

    /// Estimated motion of the tip (m) by the course of the kept curvature along each module, which
    /// is left out: as far as plays and lags have followed, it varies as the strain of the `arcs`.
    /// `compression` is the largest compression number of a module.
    pub fn neglected_motion(&self, engine: &mut dyn Passes, arcs: usize, compression: f64) -> f64 {
        // sums over the arcs of a module: bend, and bend times distance from the module's middle in
        // arcs
        let mut sums = vec![[[0.0; 2]; 2]; self.modules.len()];
        engine.strains(&mut |i, w| {
            let from_middle = (i % arcs) as f64 - 0.5 * (arcs - 1) as f64;
            for q in 0..2 {
                sums[i / arcs][0][q] += w[q];
                sums[i / arcs][1][q] += w[q] * from_middle;
            }
        });
        let (mut motion, mut beyond) = (0.0, 0.0);
        // the bend of a module moves the tip by its distance
        for (module, (k, [bend, first])) in self.modules.iter().zip(sums.iter().enumerate()).rev() {
            let length = 1.0 / module.per_length;
            beyond += length;
            let curvature = module.beyond_rest(*bend);
            let ratio = |by: [f64; 2]| {
                let (by, of) = (by[0].hypot(by[1]), curvature[0].hypot(curvature[1]));
                if by < of {
                    by / of
                } else {
                    f64::from(u8::from(by > 0.0))
                }
            };
            let terms = module.relaxation.iter().zip(&self.lags[k]);
            let share = module.hysteresis.share * ratio(self.plays[k])
                + terms.map(|(law, lag)| law.share * ratio(*lag)).sum::<f64>();
            let uneven = UNEVEN * first[0].hypot(first[1]) * length / arcs as f64;
            let bulge = BULGE * compression * compression * bend[0].hypot(bend[1]) * beyond;
            motion += share / (1.0 - share) * (uneven + bulge);
        }
        motion
    }
}
