//! Constant curvature of a whole robot on arrays: one robot in a row.

use crate::arc::{arc, each, raise, row};
use crate::input::{array, refused, Array, Rows};
use crate::model::law_of;
use crate::rod::Robot;
use bowstring_core::arc::{Arc, Error};
use bowstring_core::robot_arcs::{self, Law, SegmentArc};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

/// Arcs of a robot under one law. Arcs are (n, S, 3); bends of the modules are (n, N), without
/// columns under a law of one arc a segment.
#[pyclass(frozen)]
pub struct RobotArcs(robot_arcs::RobotArcs);

#[pymethods]
impl RobotArcs {
    #[new]
    fn new(robot: &Robot, law: &str) -> PyResult<Self> {
        let law = law_of(law)?;
        if robot.embedded && matches!(law, Law::Chords | Law::LeverArm) {
            return Err(refused(
                "the corrections are for tendons that run straight between disks; those of this robot run in its body",
            ));
        }
        Ok(RobotArcs(robot_arcs::RobotArcs::new(&robot.inner, law)))
    }

    /// Arcs, misfits (n, S) and bends of the modules from commands (n, T).
    fn arcs<'py>(
        &self,
        py: Python<'py>,
        commands: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        let commands = commands.as_array();
        let found = each(py, commands.nrows(), |i| {
            self.0.arcs(&commands.row(i).to_vec())
        })?;
        let every = || found.iter().flatten();
        let shape = [found.len(), self.0.segment_count()];
        Ok((
            array(
                py,
                every().flat_map(|segment| row(segment.arc)).collect(),
                &[shape[0], shape[1], 3],
            ),
            array(py, every().map(|segment| segment.misfit).collect(), &shape),
            self.bends_of(py, &found),
        ))
    }

    /// Derivative (3, own tendons) of the fitted arc of a segment by the lengths within it.
    fn fit_jacobian<'py>(&self, py: Python<'py>, segment: usize) -> PyResult<Array<'py>> {
        let rows = self.0.fit_jacobian(segment).map_err(raise)?;
        Ok(array(py, rows.concat(), &[3, rows[0].len()]))
    }

    /// Bends of the modules of given arcs.
    fn bends<'py>(&self, py: Python<'py>, arcs: Rows<3>) -> PyResult<Array<'py>> {
        let rows = self.rows(&arcs);
        let found = each(py, rows.len(), |i| self.0.of_arcs(&rows[i]))?;
        Ok(self.bends_of(py, &found))
    }

    /// Tendon lengths (n, T), m.
    fn tendon_lengths<'py>(
        &self,
        py: Python<'py>,
        arcs: Rows<3>,
        bends: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Array<'py>> {
        let given = self.given(&arcs, &bends);
        let found = each(py, given.len(), |i| self.0.tendon_lengths(&given[i]))?;
        let shape = [found.len(), self.0.tendon_count()];
        Ok(array(py, found.concat(), &shape))
    }

    /// Positions (n, k, 3), m, and rotations (n, k, 3, 3) at arc lengths (n, k) in m; by default at
    /// the disks.
    fn poses<'py>(
        &self,
        py: Python<'py>,
        arcs: Rows<3>,
        bends: PyReadonlyArray2<'py, f64>,
        arc_lengths: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let given = self.given(&arcs, &bends);
        let places = arc_lengths.as_ref().map(|s| s.as_array());
        let found = each(py, given.len(), |i| {
            let at = match &places {
                Some(s) => s.row(i).to_vec(),
                None => self.0.disks(&given[i]),
            };
            Ok::<_, Error>(self.0.poses(&given[i], &at))
        })?;
        let count = places.map_or(self.0.disk_count(), |s| s.ncols());
        let every = || found.iter().flatten();
        Ok((
            array(
                py,
                every().flat_map(|pose| pose.position).collect(),
                &[found.len(), count, 3],
            ),
            array(
                py,
                every().flat_map(|pose| pose.rotation.concat()).collect(),
                &[found.len(), count, 3, 3],
            ),
        ))
    }
}

impl RobotArcs {
    fn rows(&self, arcs: &Rows<3>) -> Vec<Vec<Arc>> {
        let rows = arcs.chunks_exact(self.0.segment_count());
        rows.map(|row| row.iter().copied().map(arc).collect())
            .collect()
    }

    fn given(&self, arcs: &Rows<3>, bends: &PyReadonlyArray2<f64>) -> Vec<Vec<SegmentArc>> {
        let bends = bends.as_array();
        let rows = self.rows(arcs).into_iter().enumerate();
        rows.map(|(i, arcs)| self.0.with_bends(&arcs, &bends.row(i).to_vec()))
            .collect()
    }

    fn bends_of<'py>(&self, py: Python<'py>, found: &[Vec<SegmentArc>]) -> Array<'py> {
        let bends = found.iter().flatten().flat_map(|s| s.bends.iter().copied());
        array(py, bends.collect(), &[found.len(), self.0.bend_count()])
    }
}
