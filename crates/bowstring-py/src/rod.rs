//! Statics of the rod: `Robot`, which solves, and `Solution`, which holds one solution.

use crate::input::{array, copied, input_error, numbers, refused, Array};
use crate::interrupt::interruptible;
use crate::model::{law_of, numbers_of_points, POINT_LOAD};
use crate::model::{DeadLoad, DesignArrays, OwnLoads, RobotArrays, RodModel};
use bowstring_core::memory;
use bowstring_core::model::error::InputError;
use bowstring_core::model::load::RodModel as Settings;
use bowstring_core::model::load::{Load, OwnedLoad, PointLoad, TendonPath};
use bowstring_core::robot_arcs::{self, Law};
use bowstring_core::rod::sensitivity::Derivative;
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::batch::{self, write_pose, Solutions};
use bowstring_core::statics::designs;
use bowstring_core::statics::path::PathOutcome;
use bowstring_core::statics::solver::Solver;
use bowstring_core::statics::solver::{Outcome, Status};
use numpy::{Element, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};
use std::sync::{Mutex, PoisonError};

/// A robot in the core, checked and immutable.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Robot {
    pub(crate) inner: bowstring_core::model::robot::Robot,
    /// Whether the tendons are embedded in the body, which they touch everywhere.
    pub(crate) embedded: bool,
    /// Solvers of the last calls, reused for the same settings.
    solvers: Mutex<Vec<(Settings, Adaptive)>>,
}

#[pymethods]
impl Robot {
    /// From the arrays of a `bowstring.Robot`.
    #[new]
    fn new(arrays: RobotArrays<'_>) -> PyResult<Self> {
        let spec = arrays.spec()?;
        Ok(Robot {
            inner: bowstring_core::model::robot::Robot::new(spec).map_err(input_error)?,
            embedded: arrays.is_embedded,
            solvers: Mutex::default(),
        })
    }

    /// Number of tendons.
    #[getter]
    fn tendon_count(&self) -> usize {
        self.inner.tendon_count()
    }

    /// Number of disks.
    #[getter]
    fn disk_count(&self) -> usize {
        self.inner.module_count()
    }

    /// The fewest elements in a module that take loads at arc lengths (m).
    fn least_elements(&self, arc_lengths: Vec<f64>) -> usize {
        let at = |arc_length| PointLoad {
            arc_length: Some(arc_length),
            ..PointLoad::default()
        };
        let point_loads: Vec<_> = arc_lengths.into_iter().map(at).collect();
        let load = Load {
            point_loads: &point_loads,
            ..Load::default()
        };
        load.least_elements(&self.inner)
    }

    /// One equilibrium from the straight backbone.
    fn solve(
        slf: &Bound<'_, Self>,
        tensions: &Bound<'_, PyAny>,
        load: DeadLoad<'_>,
        model: &RodModel,
    ) -> PyResult<Solution> {
        let this = slf.get();
        let robot = &this.inner;
        let settings = this.settings(model);
        let tensions = numbers(tensions, "tensions", "N", robot.tendon_count())?;
        let load = load.with(robot, tensions)?;
        let found = interruptible(slf.py(), || {
            this.with_solver(settings, |solver| {
                let outcome = solver.solve(&load.borrow())?;
                let solver = solver.solver();
                let answer =
                    (outcome.status == Status::Converged).then(|| Answer::read(robot, solver));
                Ok((outcome, answer, solver.elements()))
            })
        })?;
        found
            .map(|(outcome, answer, elements)| Solution {
                robot: slf.clone().unbind(),
                settings: Settings {
                    elements: Some(elements),
                    ..settings
                },
                load,
                outcome,
                answer,
                path: None,
            })
            .map_err(input_error)
    }

    /// Many loads in sequence; arrays of n rows, the last three may be one row.
    fn sweep<'py>(
        &self,
        py: Python<'py>,
        tensions: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        model: &RodModel,
        warm: bool,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let loads = self.loads(tensions, load, disks)?;
        let found = interruptible(py, || {
            self.with_solver(self.settings(model), |solver| {
                batch::sweep_with(&self.inner, solver, &loads.borrow(), warm, disks)
            })
        })?;
        self.arrays(py, found.map_err(input_error)?, disks)
    }

    /// Many independent loads, each from the straight backbone, on `threads` cores (0: all).
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        tensions: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        model: &RodModel,
        threads: usize,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let loads = self.loads(tensions, load, disks)?;
        let found = interruptible(py, || {
            batch::solve_batch(
                &self.inner,
                &self.settings(model),
                &loads.borrow(),
                threads,
                disks,
            )
        })?;
        self.arrays(py, found.map_err(input_error)?, disks)
    }

    /// Sweeps of many robots like this one, each along its own rows of the loads, on `threads`
    /// cores (0: all).
    fn sweep_designs<'py>(
        &self,
        py: Python<'py>,
        designs: DesignArrays<'py>,
        tensions: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        model: &RodModel,
        threads: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let loads = self.loads(tensions, load, false)?;
        let robots = designs.robots(&self.inner)?;
        let found = interruptible(py, || {
            designs::sweep_designs(&robots, &self.settings(model), &loads.borrow(), threads)
        })?;
        self.arrays(py, found.map_err(input_error)?, false)
    }

    /// Tips (n, 3) of many robots like this one by constant curvature, on all cores; NaN where there
    /// is no arc.
    fn arc_tips<'py>(
        &self,
        py: Python<'py>,
        designs: DesignArrays<'py>,
        law: &str,
        commands: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Array<'py>> {
        let law = law_of(law)?;
        let robots = designs.robots(&self.inner)?;
        let rows = commands.shape()[0];
        let commands: Vec<f64> = commands.as_array().iter().copied().collect();
        if self.embedded && matches!(law, Law::Chords | Law::LeverArm) {
            return Ok(array(py, vec![f64::NAN; 3 * rows], &[rows, 3]));
        }
        let found = interruptible(py, || robot_arcs::tips(&robots, law, &commands, 0))?;
        Ok(array(py, found.map_err(input_error)?, &[rows, 3]))
    }
}

impl Robot {
    /// Settings of a model; embedded tendons follow the body whatever it says.
    pub(crate) fn settings(&self, model: &RodModel) -> Settings {
        let mut settings = model.0;
        if self.embedded {
            settings.model.tendon = TendonPath::Embedded;
        }
        settings
    }

    /// Largest robot whose solvers are kept, and most kept solvers, for chosen and for given
    /// elements.
    const MOST_DISKS: usize = 500;
    const MOST_SOLVERS: usize = 2;

    /// Runs work with a solver of these settings, an earlier one if there is: solutions of a solver
    /// do not depend on what it solved before.
    fn with_solver<T>(
        &self,
        settings: Settings,
        work: impl FnOnce(&mut Adaptive) -> Result<T, InputError>,
    ) -> Result<T, InputError> {
        let kept = || self.solvers.lock().unwrap_or_else(PoisonError::into_inner);
        let former = {
            let mut kept = kept();
            let place = kept.iter().position(|(of, _)| *of == settings);
            place.map(|place| kept.remove(place).1)
        };
        let mut solver = match former {
            Some(solver) => solver,
            None => Adaptive::of(&self.inner, &settings)?,
        };
        let done = work(&mut solver);
        if self.inner.module_count() <= Self::MOST_DISKS {
            let mut kept = kept();
            kept.truncate(Self::MOST_SOLVERS - 1);
            kept.insert(0, (settings, solver));
        }
        done
    }

    /// Loads whose solutions fit into memory, as arrays and lists of Python.
    fn loads(
        &self,
        tensions: PyReadonlyArray2<'_, f64>,
        load: DeadLoad<'_>,
        disks: bool,
    ) -> PyResult<OwnLoads> {
        let (n, m) = (self.inner.module_count(), self.inner.tendon_count());
        let numbers = 12 + 4 * m + if disks { 12 * n } else { 0 } + 20;
        check_rows(tensions.shape()[0], numbers, disks)?;
        OwnLoads::new(&self.inner, tensions, &load)
    }

    /// Solutions as NumPy arrays, named as in `bowstring.Sweep`.
    pub(crate) fn arrays<'py>(
        &self,
        py: Python<'py>,
        found: Solutions,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = found.outcomes.len();
        let modules = self.inner.module_count();
        let out = PyDict::new(py);
        self.outcomes(py, &found.outcomes, &out)?;
        let tendons = self.inner.tendon_count();
        for (name, values, shape) in [
            ("tip_position", found.tip_position, &[n, 3][..]),
            ("tip_rotation", found.tip_rotation, &[n, 3, 3]),
            ("tendon_lengths", found.tendon_length, &[n, tendons]),
        ] {
            out.set_item(name, array(py, values, shape))?;
        }
        for (name, values, shape) in [
            ("disk_positions", found.disk_position, &[n, modules, 3][..]),
            ("disk_rotations", found.disk_rotation, &[n, modules, 3, 3]),
        ] {
            out.set_item(name, disks.then(|| array(py, values, shape)))?;
        }
        Ok(out)
    }

    fn outcomes<'py>(
        &self,
        py: Python<'py>,
        outcomes: &[Outcome],
        out: &Bound<'py, PyDict>,
    ) -> PyResult<()> {
        let words = [
            Status::Converged,
            Status::MaxIterations,
            Status::Unstable,
            Status::NoEquilibrium,
        ]
        .map(|status| (status, PyString::intern(py, status.word())));
        let word = |o: &Outcome| {
            let (_, word) = words.iter().find(|(status, _)| *status == o.status)?;
            Some(word)
        };
        out.set_item("status", PyList::new(py, outcomes.iter().map(word))?)?;
        let stable = PyList::new(py, outcomes.iter().map(|o| o.stable))?;
        out.set_item("stable", stable)?;
        py.check_signals()?;
        let tip_error = |o: &Outcome| o.error.map_or(f64::NAN, |e| e.tip);
        let tension_error = |o: &Outcome| o.error.map_or(f64::NAN, |e| e.tension);
        for (name, values) in [
            (
                "converged",
                column(py, outcomes, |o| o.status == Status::Converged),
            ),
            ("iterations", column(py, outcomes, |o| o.iterations as i64)),
            ("residual", column(py, outcomes, |o| o.residual)),
            ("fraction", column(py, outcomes, |o| o.fraction)),
            ("tip_error", column(py, outcomes, tip_error)),
            ("tension_error", column(py, outcomes, tension_error)),
            ("left_unstable", column(py, outcomes, |o| o.left_unstable)),
            (
                "collision",
                column(py, outcomes, |o| o.collision.map_or(-1, |k| k as i64)),
            ),
        ] {
            out.set_item(name, values)?;
        }
        Ok(())
    }
}

/// Checks that the solutions of so many loads, of so many numbers each, fit into memory.
pub(crate) fn check_rows(count: usize, numbers: usize, disks: bool) -> PyResult<()> {
    let cure = if disks {
        "give fewer at a time, or leave the disks out (disks=False)"
    } else {
        "give fewer at a time"
    };
    let what = || format!("the solutions of {count} loads");
    memory::check(8.0 * count as f64 * numbers as f64, what, cure).map_err(input_error)
}

/// Array of one value of each row.
pub(crate) fn column<'py, R, T: Element + Copy>(
    py: Python<'py>,
    rows: &[R],
    value: impl Fn(&R) -> T,
) -> Bound<'py, PyAny> {
    array(py, rows.iter().map(value).collect(), &[rows.len()]).into_any()
}

fn vector<'py, T: Element + Copy>(py: Python<'py>, values: &[T]) -> Array<'py, T> {
    copied(py, values, &[values.len()])
}

fn on_disks<'py>(py: Python<'py>, vectors: &[[f64; 3]]) -> Option<Array<'py>> {
    let shape = [vectors.len(), 3];
    (!vectors.is_empty()).then(|| copied(py, vectors.as_flattened(), &shape))
}

/// The solution for one load.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Solution {
    pub(crate) robot: Py<Robot>,
    pub(crate) settings: Settings,
    pub(crate) load: OwnedLoad,
    pub(crate) outcome: Outcome,
    pub(crate) answer: Option<Answer>,
    /// Result of a path, if it was computed by a `PathSolver`.
    pub(crate) path: Option<Box<PathResult>>,
}

impl Solution {
    /// State of a converged step of a path.
    fn state(&self) -> Option<&State> {
        self.path.as_ref()?.state.as_ref()
    }

    /// Evaluates `question` on the solver in the pose of the solution. After a solve by tensions
    /// alone it is solved again, which gives the same numbers.
    pub(crate) fn ask<T>(&self, question: impl FnOnce(&Solver) -> T) -> Result<T, InputError> {
        if let Some(state) = self.state() {
            return Ok(question(&state.solver));
        }
        self.robot.get().with_solver(self.settings, |solver| {
            solver.solve(&self.load.borrow())?;
            Ok(question(solver.solver()))
        })
    }
}

/// Additional results of a step of a `PathSolver`.
pub(crate) struct PathResult {
    /// Whether each tendon is displacement-controlled, and its displacement (m) or tension (N).
    pub by_displacement: Vec<bool>,
    pub commands: Vec<f64>,
    pub found: PathOutcome,
    pub state: Option<State>,
}

/// Numbers of a converged step.
pub(crate) struct State {
    /// Solver in the pose of the step, which a solve by tensions alone may not reach again.
    pub solver: Solver,
    pub displacements: Vec<f64>,
    pub slack: Vec<f64>,
    /// Span tensions by modules and tendons (N).
    pub spans: Vec<f64>,
}

/// Numbers of a converged solution.
pub(crate) struct Answer {
    pub disk_position: Vec<f64>,
    pub disk_rotation: Vec<f64>,
    pub tendon_length: Vec<f64>,
}

impl Answer {
    pub fn read(robot: &bowstring_core::model::robot::Robot, solver: &Solver) -> Self {
        let n = robot.module_count();
        let (mut disk_position, mut disk_rotation) = (vec![0.0; 3 * n], vec![0.0; 9 * n]);
        for k in 0..n {
            write_pose(
                &solver.disk(k).expect("it converged"),
                k,
                &mut disk_position,
                &mut disk_rotation,
            );
        }
        Answer {
            disk_position,
            disk_rotation,
            tendon_length: (0..robot.tendon_count())
                .filter_map(|i| solver.tendon_length(i))
                .collect(),
        }
    }
}

#[pymethods]
impl Solution {
    #[getter]
    fn status(&self) -> &'static str {
        self.outcome.status.word()
    }
    #[getter]
    fn converged(&self) -> bool {
        self.answer.is_some()
    }
    #[getter]
    fn stable(&self) -> Option<bool> {
        self.outcome.stable
    }
    #[getter]
    fn iterations(&self) -> usize {
        self.outcome.iterations
    }
    #[getter]
    fn residual(&self) -> f64 {
        self.outcome.residual
    }
    #[getter]
    fn left_unstable(&self) -> bool {
        self.outcome.left_unstable
    }
    #[getter]
    fn fraction(&self) -> f64 {
        self.outcome.fraction
    }
    #[getter]
    fn collision(&self) -> Option<usize> {
        self.outcome.collision
    }
    /// The rod model of the solve: `elements` is the number used.
    #[getter]
    fn model(&self) -> RodModel {
        RodModel(self.settings)
    }
    /// Estimated discretisation error of tip (m) and tensions (N); `None` without a solution.
    #[getter]
    fn error_estimate(&self) -> Option<(f64, f64)> {
        self.outcome.error.map(|e| (e.tip, e.tension))
    }
    #[getter]
    fn tensions<'py>(&self, py: Python<'py>) -> Array<'py> {
        vector(py, &self.load.tensions)
    }
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Array<'py> {
        vector(py, &self.load.gravity)
    }
    #[getter]
    fn tip_force<'py>(&self, py: Python<'py>) -> Array<'py> {
        vector(py, &self.load.tip_force)
    }
    #[getter]
    fn tip_moment<'py>(&self, py: Python<'py>) -> Array<'py> {
        vector(py, &self.load.tip_moment)
    }
    /// Forces on the disks (N, 3); `None` if there are none.
    #[getter]
    fn disk_forces<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        on_disks(py, &self.load.disk_forces)
    }
    #[getter]
    fn disk_moments<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        on_disks(py, &self.load.disk_moments)
    }
    /// Numbers (P, 12) of the point loads; `None` if there are none.
    #[getter]
    fn point_loads<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let loads = &self.load.point_loads;
        let shape = [loads.len(), POINT_LOAD];
        (!loads.is_empty()).then(|| array(py, numbers_of_points(loads), &shape))
    }
    /// Forces per length before each disk (N, 3); `None` if there are none.
    #[getter]
    fn line_forces<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        on_disks(py, &self.load.line_forces)
    }
    #[getter]
    fn tip_position<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let p = &self.answer.as_ref()?.disk_position;
        Some(vector(py, &p[p.len() - 3..]))
    }
    #[getter]
    fn tip_rotation<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let r = &self.answer.as_ref()?.disk_rotation;
        Some(copied(py, &r[r.len() - 9..], &[3, 3]))
    }
    #[getter]
    fn disk_positions<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let p = &self.answer.as_ref()?.disk_position;
        Some(copied(py, p, &[p.len() / 3, 3]))
    }
    #[getter]
    fn disk_rotations<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let r = &self.answer.as_ref()?.disk_rotation;
        Some(copied(py, r, &[r.len() / 9, 3, 3]))
    }
    #[getter]
    fn tendon_lengths<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        Some(vector(py, &self.answer.as_ref()?.tendon_length))
    }

    /// Whether it was computed by a `PathSolver`: what follows is `None` otherwise.
    #[getter]
    fn on_path(&self) -> bool {
        self.path.is_some()
    }
    /// Which tendons are displacement-controlled.
    #[getter]
    fn by_displacement<'py>(&self, py: Python<'py>) -> Option<Array<'py, bool>> {
        Some(vector(py, &self.path.as_ref()?.by_displacement))
    }
    /// Commanded displacements and tensions.
    #[getter]
    fn commands<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        Some(vector(py, &self.path.as_ref()?.commands))
    }
    #[getter]
    fn undetermined(&self) -> Option<bool> {
        Some(self.path.as_ref()?.found.undetermined)
    }
    #[getter]
    fn length_residual(&self) -> Option<f64> {
        Some(self.path.as_ref()?.found.length_residual)
    }
    /// Opposing tendons, from 0, and the nearest feasible displacements.
    #[getter]
    fn conflict(&self) -> Option<(Vec<usize>, Option<Vec<f64>>)> {
        let found = &self.path.as_ref()?.found;
        Some((found.opposing.clone(), found.nearest.clone()))
    }
    #[getter]
    fn displacements<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        Some(vector(py, &self.state()?.displacements))
    }
    #[getter]
    fn slack_lengths<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        Some(vector(py, &self.state()?.slack))
    }
    #[getter]
    fn span_tensions<'py>(&self, py: Python<'py>) -> Option<Array<'py>> {
        let (spans, m) = (&self.state()?.spans, self.load.tensions.len());
        Some(copied(py, spans, &[spans.len() / m, m]))
    }

    /// Points of the backbone. A solution by tensions stores only frequently requested quantities,
    /// not the solver.
    fn centerline<'py>(
        &self,
        py: Python<'py>,
        points_per_module: usize,
    ) -> PyResult<Option<Array<'py>>> {
        const MOST: usize = 1_000_000;
        let robot = &self.robot.get().inner;
        if points_per_module == 0 || points_per_module > MOST / robot.module_count().min(MOST) {
            return Err(refused(format!(
                "points_per_module is {points_per_module}, it must be 1 or more, and at most {MOST} points in all"
            )));
        }
        if self.answer.is_none() {
            return Ok(None);
        }
        let points = interruptible(py, || {
            self.ask(|solver| solver.centerline(points_per_module))
        })?
        .map_err(input_error)?;
        Ok(points.map(|points| {
            let flat = points.iter().flat_map(|p| p.0).collect();
            array(py, flat, &[points.len(), 3])
        }))
    }

    /// Derivatives with respect to tension, tip force, tip moment and stiffness, each as arrays of
    /// position, rotation, lengths and bends with a column for each parameter; `None` if there are none
    /// (not converged, or continuous tendons). Those with respect to gravity if requested.
    #[pyo3(signature = (gravity=false))]
    fn jacobians<'py>(
        &self,
        py: Python<'py>,
        gravity: bool,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        if self.answer.is_none() {
            return Ok(None);
        }
        let robot = &self.robot.get().inner;
        let columns = robot.tendon_count() + robot.spec().backbone.len() + 9;
        // twice: as columns and as arrays
        let bytes = 16.0 * columns as f64 * (2 * robot.tendon_count() + 6) as f64;
        memory::check(bytes, || "derivatives".into(), "use fewer tendons").map_err(input_error)?;
        let found = interruptible(py, || self.ask(|solver| solver.jacobians(gravity)))?
            .map_err(input_error)?;
        let Some(found) = found else {
            return Ok(None);
        };
        let out = PyDict::new(py);
        for (parameter, columns) in [
            ("tension", &found.tensions),
            ("tip_force", &found.tip_force),
            ("tip_moment", &found.tip_moment),
            ("stiffness", &found.stiffness),
            ("gravity", &found.gravity),
        ] {
            let table = |rows: usize, entry: fn(&Derivative, usize) -> f64| {
                let entries = (0..rows).flat_map(|i| columns.iter().map(move |d| entry(d, i)));
                array(py, entries.collect(), &[rows, columns.len()])
            };
            for (quantity, values) in [
                ("tip_position", table(3, |d, i| d.position[i])),
                ("tip_rotation", table(3, |d, i| d.rotation[i])),
                ("lengths", table(robot.tendon_count(), |d, i| d.lengths[i])),
                ("bends", table(robot.tendon_count(), |d, i| d.bends[i])),
            ] {
                out.set_item(format!("{quantity}_by_{parameter}"), values)?;
            }
        }
        Ok(Some(out))
    }
}
