//! Inelastic backbone and tendons of a path, and the curvature that the backbone keeps without load.
//!
//! Theory: docs/theory/actuation.md (Hysteresis of the backbone, Relaxation and creep).

use crate::dispatch::Passes;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::robot::{Profile, Robot};
use crate::statics::adaptive::with_elements;
use crate::statics::hysteresis::{followed, Hysteresis};
use crate::statics::relaxation::{Creep, Lag, Relaxation};
use crate::tendon::{History, TERMS};

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

/// Curvature that the backbone keeps without load at the Gauss points of its elements, as it follows
/// the present strain.
#[derive(Clone)]
pub(crate) struct UnloadedCurvature {
    points: Vec<Point>,
    /// Curvature beyond that at rest which play and lags of each point have followed (1/m).
    pub plays: Vec<[f64; 2]>,
    pub lags: Vec<[[f64; 2]; TERMS]>,
}

#[derive(Clone)]
struct Point {
    hysteresis: Hysteresis,
    relaxation: [Relaxation; TERMS],
    /// Curvature without load and history (1/m).
    rest: Vec3,
    /// Lag of each term at the end of the step, without the part of the curvature there (1/m).
    carried: [[f64; 2]; TERMS],
    /// Weight of that part.
    weight: [f64; TERMS],
}

impl UnloadedCurvature {
    /// Of a robot with these laws and so many elements in a module; `None` if its backbone is elastic.
    ///
    /// # Errors
    /// If a number is out of range, or a section has coupled strains.
    pub fn new(
        robot: &Robot,
        elements: usize,
        laws: &Inelasticity,
    ) -> Result<Option<Self>, InputError> {
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
        let point = |k: usize| {
            let segment = robot.spec().disks[k].segment;
            Point {
                hysteresis: hysteresis.get(segment).copied().unwrap_or_default(),
                relaxation: relaxation.get(segment).copied().unwrap_or_default(),
                rest: Vec3(robot.profile(k).sections()[0].rest_curvature),
                carried: [[0.0; 2]; TERMS],
                weight: [0.0; TERMS],
            }
        };
        let each = 2 * elements;
        let points: Vec<_> = (0..each * robot.module_count())
            .map(|i| point(i / each))
            .collect();
        Ok(Some(UnloadedCurvature {
            plays: vec![[0.0; 2]; points.len()],
            lags: vec![[[0.0; 2]; TERMS]; points.len()],
            points,
        }))
    }

    /// Prepares a step from `old`, at whose strain the engine is.
    pub fn begin(&mut self, engine: &dyn Passes, old: &History, duration: f64) {
        let points = &mut self.points;
        engine.curvatures(&mut |i, u| {
            let point = &mut points[i];
            let curvature = [0, 1].map(|q| u[q] - point.rest[q]);
            for (term, law) in point.relaxation.iter().enumerate() {
                let lag = Lag::over(duration, law.time);
                let state = old.lags[i][term];
                point.carried[term] = [0, 1].map(|q| lag.carried(state[q], curvature[q]));
                point.weight[term] = lag.end;
            }
        });
    }

    /// Moves plays and lags from those of the last step, `old`, to the present strain, and sets the
    /// unloaded curvature.
    pub fn follow(&mut self, engine: &mut dyn Passes, old: &History) {
        let (points, plays, lags) = (&self.points, &mut self.plays, &mut self.lags);
        engine.curvatures(&mut |i, u| {
            let point = &points[i];
            let curvature = [0, 1].map(|q| u[q] - point.rest[q]);
            for (term, lag) in lags[i].iter_mut().enumerate() {
                let (carried, end) = (point.carried[term], point.weight[term]);
                *lag = [0, 1].map(|q| carried[q] + end * curvature[q]);
            }
            plays[i] = followed(old.plays[i], curvature, point.hysteresis.play);
        });
        self.set(engine);
    }

    /// Sets the unloaded curvature from plays and lags of a state.
    pub fn hold(&mut self, engine: &mut dyn Passes, state: &History) {
        self.plays.copy_from_slice(&state.plays);
        self.lags.copy_from_slice(&state.lags);
        self.set(engine);
    }

    fn set(&self, engine: &mut dyn Passes) {
        engine.set_unloaded_curvatures(&|i| {
            let Point {
                hysteresis,
                relaxation,
                rest,
                ..
            } = self.points[i];
            let relaxed = |q: usize| -> f64 {
                let terms = relaxation.iter().zip(&self.lags[i]);
                terms.map(|(law, lag)| law.share * lag[q]).sum()
            };
            let kept = |q: usize| hysteresis.share * self.plays[i][q] + relaxed(q);
            rest + Vec3([kept(0), kept(1), 0.0])
        });
    }
}

/// Curvatures at the Gauss points of `from` elements in a module at those of `to`, both powers of two.
pub(crate) fn at_points_of(curvatures: &[[f64; 2]], from: usize, to: usize) -> Vec<[f64; 2]> {
    // as the strain of elements of unit length, which is linear in each
    let slope = 1.0 / 3f64.sqrt();
    let arcs = curvatures.chunks_exact(2).flat_map(|pair| {
        let mean = [0, 1].map(|q| 0.5 * (pair[0][q] + pair[1][q]));
        let change = [0, 1].map(|q| slope * (pair[1][q] - pair[0][q]));
        [-0.5, 0.5].map(|side| {
            let of = |q: usize| 0.5 * mean[q] + side * change[q];
            Vec3([of(0), of(1), 0.0])
        })
    });
    let strain = with_elements(arcs.collect(), from, to);
    let scale = to as f64 / from as f64;
    let points = strain.chunks_exact(2).flat_map(|pair| {
        let (sum, change) = (pair[0] + pair[1], (pair[1] - pair[0]) * (0.5 / slope));
        [sum - change, sum + change].map(|u| [u[0] * scale, u[1] * scale])
    });
    points.collect()
}
