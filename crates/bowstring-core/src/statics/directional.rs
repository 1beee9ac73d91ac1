//! Derivatives of an equilibrium along a direction of its load and its robot, by one elimination.
//!
//! Theory: docs/theory/statics.md (Derivatives along a direction).
//!
//! With the imbalance `r(w, p)` of the strain `w` under the parameter `p`, the equilibrium follows
//! `w(p)` with `r_w w' = -r_p` and `r_w w'' = -d^2 r(w + s w', p + s) / ds^2`. The derivatives of `r`
//! and of the results along `p` are differences of evaluations, without another solve: these are
//! smooth to rounding, so that differences of high order are accurate to about 1e-11.

use crate::dispatch::{self, Plain};
use crate::interrupt;
use crate::math::lie::log;
use crate::math::linalg::{Mat3, Vec3};
use crate::model::error::InputError;
use crate::model::load::{Load, Model};
use crate::model::robot::Robot;
use crate::outcome::Settings;
use crate::statics::loads::Loads;
use crate::statics::newton::LEAST_PIVOT;

/// Newton steps that take the equilibrium of a solver from its tolerance to rounding.
const POLISHING_STEPS: usize = 2;

/// A finite difference of a function along a line.
#[derive(Clone, Debug)]
pub struct Stencil {
    /// Places along the line, in units of the parameter; one of them is zero.
    pub offsets: Vec<f64>,
    /// Weights of the values for the first derivative.
    pub first: Vec<f64>,
    /// Weights for the first derivative at a lower order, which show the error.
    pub coarse: Vec<f64>,
    /// Weights for the second derivative.
    pub second: Vec<f64>,
}

/// Derivatives along a line.
///
/// Each is a row of numbers: position of the tip (m, 3), its rotation vector in the base frame (rad,
/// 3), elastic energy of the backbone (J), lengths of the tendons (m), and positions of the disks
/// from base to tip (m, 3 each).
#[derive(Clone, Debug)]
pub struct Along {
    /// First derivatives.
    pub first: Vec<f64>,
    /// First derivatives at a lower order, which show the error.
    pub coarse: Vec<f64>,
    /// Second derivatives.
    pub second: Vec<f64>,
}

/// An equilibrium with its eliminated tangent.
pub struct Linearised {
    robot: Robot,
    model: Model,
    elements: usize,
    strain: Vec<Vec3>,
    /// Rod at the equilibrium; its elimination gives all steps.
    rod: Box<dyn Plain>,
    /// Rod of the same robot for other loads and strains.
    probe: Box<dyn Plain>,
    symmetric: bool,
    /// Rotation of the tip.
    rotation: Mat3,
    /// Numbers of [`Along`] at the equilibrium.
    values: Vec<f64>,
}

impl Linearised {
    /// Linearises about the equilibrium of a load with this strain.
    ///
    /// `None` for continuous tendons, and where the equilibrium is so close to losing stability that
    /// there are no derivatives.
    pub(super) fn new(robot: &Robot, model: Model, load: &Load, strain: Vec<Vec3>) -> Option<Self> {
        if model.tendon.is_continuous() {
            return None;
        }
        let elements = strain.len() / (2 * robot.module_count());
        let settings = Settings::new(robot, elements);
        let load = settings.without_negligible(load);
        let made = || dispatch::plain(robot, model, elements).expect("a solver has these elements");
        let (mut rod, probe, mut strain) = (made(), made(), strain);
        let mut symmetric = true;
        for round in 0..=POLISHING_STEPS {
            rod.take_strain(&load, &strain);
            symmetric = rod.has_potential();
            rod.gradient();
            rod.linearise();
            let pivot = rod.eliminate(symmetric, 0.0);
            if symmetric && !(pivot > LEAST_PIVOT * settings.shift_unit) {
                return None;
            }
            if round < POLISHING_STEPS {
                let largest = rod.newton_step(symmetric).largest;
                if !largest.is_finite() {
                    return None;
                }
                rod.steps(&mut |i, step| strain[i] += step);
            }
        }
        let rotation = rod.disk(robot.module_count() - 1).rotation;
        let mut values = vec![0.0; 7 + robot.tendon_count() + 3 * robot.module_count()];
        read(rod.as_ref(), robot, &rotation, &mut values);
        Some(Linearised {
            robot: robot.clone(),
            model,
            elements,
            strain,
            rod,
            probe,
            symmetric,
            rotation,
            values,
        })
    }

    /// Derivatives along a line of loads and, if given, of robots of the same topology: one for each
    /// offset of the stencil, those of the equilibrium at zero.
    ///
    /// # Errors
    /// If there is not one load and one robot for each offset, or the robots differ in the number of
    /// disks or tendons.
    pub fn along(
        &mut self,
        robots: Option<&[Robot]>,
        loads: &Loads,
        stencil: &Stencil,
    ) -> Result<Along, InputError> {
        let count = stencil.offsets.len();
        let weights = [&stencil.first, &stencil.coarse, &stencil.second];
        let same = weights.iter().all(|w| w.len() == count)
            && loads.count == count
            && robots.is_none_or(|robots| robots.len() == count);
        if !same {
            return Err(InputError::other(format!(
                "a line of {count} offsets takes as many weights, loads and robots"
            )));
        }
        let alike = |robot: &Robot| {
            robot.module_count() == self.robot.module_count()
                && robot.tendon_count() == self.robot.tendon_count()
        };
        if !robots.into_iter().flatten().all(alike) {
            return Err(InputError::other(
                "the robots along the line differ in the number of disks or tendons",
            ));
        }
        let mut rods = match robots {
            Some(robots) => robots
                .iter()
                .map(|robot| dispatch::plain(robot, self.model, self.elements))
                .collect::<Result<Vec<_>, _>>()?,
            None => vec![],
        };
        let arcs = self.strain.len();
        let (mut velocity, mut acceleration) = (vec![Vec3::zero(); arcs], vec![Vec3::zero(); arcs]);
        let mut strain = self.strain.clone();
        let mut imbalance = vec![Vec3::zero(); arcs];
        for order in 1..=2 {
            imbalance.fill(Vec3::zero());
            for (i, s) in stencil.offsets.iter().enumerate() {
                let weight = match order {
                    1 => stencil.first[i],
                    _ => stencil.second[i],
                };
                for (a, w) in strain.iter_mut().enumerate() {
                    *w = self.strain[a] + velocity[a] * *s;
                }
                let rod = rods.get_mut(i).unwrap_or(&mut self.probe);
                rod.take_strain(&loads.row(i, self.robot.tendon_count()), &strain);
                rod.gradient();
                rod.gradients(&mut |a, g| imbalance[a] += g * weight);
            }
            let to = match order {
                1 => &mut velocity,
                _ => &mut acceleration,
            };
            self.rod.set_gradient(&|a| imbalance[a]);
            self.rod.newton_step(self.symmetric);
            self.rod.steps(&mut |a, step| to[a] = step);
        }
        let [mut first, mut coarse, mut second] = [0; 3].map(|_| vec![0.0; self.values.len()]);
        let mut row = self.values.clone();
        for (i, s) in stencil.offsets.iter().enumerate() {
            if interrupt::work(arcs * (8 + 2 * self.robot.tendon_count())) {
                row.fill(f64::NAN);
            }
            for (a, w) in strain.iter_mut().enumerate() {
                *w = self.strain[a] + velocity[a] * *s + acceleration[a] * (0.5 * s * s);
            }
            let rod = rods.get_mut(i).unwrap_or(&mut self.probe);
            rod.take_strain(&loads.row(i, self.robot.tendon_count()), &strain);
            read(rod.as_ref(), &self.robot, &self.rotation, &mut row);
            for (sums, weights) in [&mut first, &mut coarse, &mut second]
                .into_iter()
                .zip(&weights)
            {
                // the weights have the sum zero; changes are rounded less than values
                for ((sum, x), from) in sums.iter_mut().zip(&row).zip(&self.values) {
                    *sum += weights[i] * (x - from);
                }
            }
        }
        Ok(Along {
            first,
            coarse,
            second,
        })
    }
}

/// Writes the numbers of [`Along`] at the present state; the rotation is that from another.
fn read(rod: &dyn Plain, robot: &Robot, from: &Mat3, row: &mut [f64]) {
    let (n, tendons) = (robot.module_count(), robot.tendon_count());
    let tip = rod.disk(n - 1);
    row[..3].copy_from_slice(&tip.position.0);
    row[3..6].copy_from_slice(&log(&(tip.rotation * from.transpose())).0);
    row[6] = rod.elastic_energy();
    for i in 0..tendons {
        row[7 + i] = rod.length(i);
    }
    for (k, place) in row[7 + tendons..].chunks_exact_mut(3).enumerate() {
        place.copy_from_slice(&rod.disk(k).position.0);
    }
}
