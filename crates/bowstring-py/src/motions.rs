//! `Motions`, many motions of one robot.

use crate::dynamics::Scheme;
use crate::input::{copied, input_error, refused, three, Array};
use crate::interrupt::interruptible;
use crate::model::{self, RodModel};
use crate::rod::Robot;
use bowstring_core::dynamics::batch::{self, Between, Control, MotionStatus, Observations};
use bowstring_core::dynamics::integrator::{Damping, Integrator, Step};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Measured values: position (N, 3), rotation (N, 3, 3), velocity and angular velocity (N, 3) of the
/// tips; lengths of the tendons (N, T); kinetic energy, elastic energy and that of gravity (N, 3).
type Measured<'py> = (
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
);

/// Many motions of one robot.
#[pyclass(module = "bowstring._core")]
pub struct Motions {
    inner: batch::Motions,
    observed: Observations,
}

#[pymethods]
impl Motions {
    /// Motions without a state, with the fixed step of the scheme. `control`: length of a period (s),
    /// and whether tensions are held in it; `size`: number of motions and of threads (0: all cores).
    #[new]
    fn new(
        robot: &Robot,
        model: &RodModel,
        gravity: Option<&Bound<'_, PyAny>>,
        tip_force: &Bound<'_, PyAny>,
        scheme: Scheme,
        control: (f64, bool),
        size: (usize, usize),
    ) -> PyResult<Self> {
        let chosen = robot.settings(model);
        let settings = Integrator {
            gravity: model::gravity(&robot.inner, gravity)?,
            damping: Damping {
                mass: scheme.mass_damping,
                material: scheme.material_damping,
            },
            spectral_radius: scheme.spectral_radius,
            step: Step::Fixed(scheme.step.unwrap_or(scheme.longest_step)),
        };
        let control = Control {
            period: control.0,
            between: if control.1 {
                Between::Held
            } else {
                Between::Linear
            },
        };
        let inner = batch::Motions::new(
            &robot.inner,
            (chosen.model, model.elements_or_one()),
            settings,
            control,
            three(tip_force, "tip_force", "N")?,
            size,
        );
        Ok(Motions {
            inner: inner.map_err(input_error)?,
            observed: Observations::default(),
        })
    }

    /// Brings some motions (K,) to rest in the equilibria of tensions (K, T).
    fn reset(
        &mut self,
        which: PyReadonlyArray1<'_, i64>,
        tensions: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let rows = which.as_array();
        if tensions.shape()[0] != rows.len() {
            return Err(refused("there must be a row of tensions for each motion"));
        }
        let chosen: Vec<_> = rows.iter().map(|i| *i as usize).collect();
        let values: Vec<_> = tensions.as_array().iter().copied().collect();
        let work = || self.inner.reset(&chosen, &values);
        interruptible(tensions.py(), work)?.map_err(input_error)
    }

    /// Advances all motions by a period under tensions (N, T).
    fn step(&mut self, tensions: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let values: Vec<_> = tensions.as_array().iter().copied().collect();
        let work = || self.inner.step(&values);
        interruptible(tensions.py(), work)?.map_err(input_error)
    }

    /// State of each motion (N,): 0 without a state, 1 in motion, 2 without an equilibrium to start
    /// from, 3 where a step failed, 4 where disks collided.
    fn status<'py>(&self, py: Python<'py>) -> Array<'py, u8> {
        let code = |motion| match self.inner.status(motion) {
            MotionStatus::NotStarted => 0,
            MotionStatus::Moving => 1,
            MotionStatus::NoEquilibrium => 2,
            MotionStatus::StepFailed => 3,
            MotionStatus::Collision => 4,
        };
        let codes: Vec<u8> = (0..self.inner.count()).map(code).collect();
        copied(py, &codes, &[codes.len()])
    }

    /// Measures all motions.
    fn observe<'py>(&mut self, py: Python<'py>) -> Measured<'py> {
        let (n, tendons) = (self.inner.count(), self.inner.robot().tendon_count());
        let found = &mut self.observed;
        self.inner.observe(found);
        (
            copied(py, &found.position, &[n, 3]),
            copied(py, &found.rotation, &[n, 3, 3]),
            copied(py, &found.velocity, &[n, 3]),
            copied(py, &found.angular_velocity, &[n, 3]),
            copied(py, &found.lengths, &[n, tendons]),
            copied(py, &found.energies, &[n, 3]),
        )
    }

    /// Steps of a period.
    #[getter]
    fn steps(&self) -> usize {
        self.inner.steps()
    }

    /// Number of periods of single motions that were repeated with shorter steps.
    #[getter]
    fn repeated(&self) -> usize {
        self.inner.repeated()
    }
}
