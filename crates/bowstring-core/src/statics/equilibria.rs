//! Equilibria of many loads as a function with derivatives, for automatic differentiation.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination).

use crate::memory::unknown;
use crate::model::error::InputError;
use crate::model::load::{Load, OwnedLoad, RodModel};
use crate::model::robot::Robot;
use crate::outcome::Outcome;
use crate::statics::adaptive::Adaptive;
use crate::statics::batch::{for_each, solve_and_differentiate, too_many, Solutions};
use crate::statics::differentiator::Differentiator;
use crate::statics::loads::Loads;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Arguments of [`Equilibria::evaluate`], row by row; SI units, base frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inputs<'a> {
    /// Number of rows.
    pub count: usize,
    /// Tensions (N), one for each tendon in each row.
    pub tensions: &'a [f64],
    /// Gravity (m/s^2), n x 3.
    pub gravity: &'a [f64],
    /// Force on the tip (N), n x 3.
    pub tip_force: &'a [f64],
    /// Moment on the tip (N m), n x 3.
    pub tip_moment: &'a [f64],
    /// Factors of the stiffness of the backbone, one for each segment in each row.
    pub stiffness: &'a [f64],
}

/// Wanted derivatives of [`Equilibria::evaluate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Derivatives {
    /// None.
    None,
    /// By tensions, tip load and stiffness.
    Most,
    /// Also by gravity.
    All,
}

/// Equilibria and, if wanted, their derivatives.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Equilibria; NaN in rows without one.
    pub solutions: Solutions,
    /// Derivatives of each row, a matrix row by row: position of the tip (m), its rotation vector
    /// in the base frame (rad) and the tendon lengths (m), by the tensions (N), the tip force (N),
    /// the tip moment (N m), the factors of stiffness and, if it is wanted, gravity (m/s^2). NaN in
    /// rows without them; empty if they are not wanted.
    pub jacobians: Vec<f64>,
}

/// Solver of one load with its derivatives.
struct Single {
    solver: Adaptive,
    differentiator: Differentiator,
}

/// A robot under constant loads, as a function of tensions, gravity, tip load and stiffness.
pub struct Equilibria {
    robot: Robot,
    model: RodModel,
    /// Constant loads on disks and backbone.
    load: OwnedLoad,
    /// Solvers of single loads, reused.
    kept: Mutex<Vec<Single>>,
}

/// Most kept solvers of single loads.
const MOST_KEPT: usize = 4;

impl Equilibria {
    /// A robot and its model. Of the load, those on disks and backbone act in all rows.
    ///
    /// # Errors
    /// For loads that are not valid, and for continuous tendons, which have no derivatives.
    pub fn new(robot: &Robot, model: RodModel, load: OwnedLoad) -> Result<Self, InputError> {
        if model.model.tendon.is_continuous() {
            return Err(InputError::other(
                "continuous and embedded tendons have no derivatives: take straight ones",
            ));
        }
        let none = vec![0.0; robot.tendon_count()];
        let constant = Load {
            tensions: &none,
            ..load.borrow()
        };
        constant.check(robot)?;
        if let Some(elements) = model.elements {
            constant.check_elements(robot, elements)?;
        }
        Adaptive::of(robot, &model)?;
        Ok(Equilibria {
            robot: robot.clone(),
            model,
            load,
            kept: Mutex::default(),
        })
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Text that is the same for the same function only.
    pub fn description(&self) -> String {
        format!("{:?}{:?}{:?}", self.robot.spec(), self.model, self.load)
    }

    /// Rows and columns of the derivatives of a row.
    pub fn jacobian_shape(&self, derivatives: Derivatives) -> [usize; 2] {
        let spec = self.robot.spec();
        let (tendons, segments) = (spec.tendons.len(), spec.backbone.len());
        let columns = match derivatives {
            Derivatives::None => 0,
            Derivatives::Most => tendons + 6 + segments,
            Derivatives::All => tendons + 6 + segments + 3,
        };
        [6 + tendons, columns]
    }

    /// Equilibria of all rows, each from the straight backbone, on `threads` cores (0: all), and
    /// their derivatives.
    ///
    /// Rows with invalid numbers, such as a tension below zero, have no equilibrium. Rows of equal
    /// stiffness one after the other are solved together, which is faster.
    ///
    /// # Errors
    /// If the inputs do not have the right length, or the results do not fit into memory.
    pub fn evaluate(
        &self,
        inputs: &Inputs,
        threads: usize,
        derivatives: Derivatives,
    ) -> Result<Evaluated, InputError> {
        let (n, segments) = (inputs.count, self.robot.spec().backbone.len());
        for (name, numbers, each) in [
            ("tensions", inputs.tensions, self.robot.tendon_count()),
            ("gravity", inputs.gravity, 3),
            ("tip force", inputs.tip_force, 3),
            ("tip moment", inputs.tip_moment, 3),
            ("stiffness", inputs.stiffness, segments),
        ] {
            if Some(numbers.len()) != n.checked_mul(each) {
                return Err(InputError::other(format!(
                    "{name} has {} numbers, it must have {each} for each of {n} loads",
                    numbers.len()
                )));
            }
        }
        let invalid: Vec<usize> = (0..n).filter(|&i| !self.is_valid(inputs, i)).collect();
        if invalid.is_empty() {
            return self.evaluate_valid(inputs, threads, derivatives);
        }
        let with = |numbers: &[f64], value: f64| {
            let mut numbers = numbers.to_vec();
            let each = numbers.len() / n;
            for i in &invalid {
                numbers[i * each..][..each].fill(value);
            }
            numbers
        };
        let mut found = self.evaluate_valid(
            &Inputs {
                count: n,
                tensions: &with(inputs.tensions, 0.0),
                gravity: &with(inputs.gravity, 0.0),
                tip_force: &with(inputs.tip_force, 0.0),
                tip_moment: &with(inputs.tip_moment, 0.0),
                stiffness: &with(inputs.stiffness, 1.0),
            },
            threads,
            derivatives,
        )?;
        let Evaluated {
            solutions,
            jacobians,
        } = &mut found;
        for i in invalid {
            solutions.outcomes[i] = Outcome::pending();
            for numbers in [
                &mut solutions.tip_position,
                &mut solutions.tip_rotation,
                &mut solutions.tendon_length,
                &mut *jacobians,
            ] {
                let each = numbers.len() / n;
                numbers[i * each..][..each].fill(f64::NAN);
            }
        }
        Ok(found)
    }

    fn is_valid(&self, inputs: &Inputs, i: usize) -> bool {
        let segments = self.robot.spec().backbone.len();
        let mut factors = inputs.stiffness[i * segments..][..segments].iter();
        let tendons = self.robot.tendon_count();
        let row = Loads {
            tensions: inputs.tensions,
            gravity: inputs.gravity,
            tip_force: inputs.tip_force,
            tip_moment: inputs.tip_moment,
            ..Loads::default()
        };
        factors.all(|f| f.is_finite() && *f > 0.0) && row.row(i, tendons).check(&self.robot).is_ok()
    }

    fn evaluate_valid(
        &self,
        inputs: &Inputs,
        threads: usize,
        derivatives: Derivatives,
    ) -> Result<Evaluated, InputError> {
        let n = inputs.count;
        let segments = self.robot.spec().backbone.len();
        let mut runs: Vec<Range<usize>> = vec![];
        for i in 0..n {
            let factors = |i: usize| &inputs.stiffness[i * segments..][..segments];
            match runs.last_mut() {
                Some(run) if factors(run.start) == factors(i) => run.end = i + 1,
                _ => runs.push(i..i + 1),
            }
        }
        if runs.len() < 2 {
            return self.evaluate_run(inputs, 0..n, threads, derivatives);
        }
        let mut parts: Vec<_> = runs.into_iter().map(|run| (run, None)).collect();
        for_each(
            &mut parts,
            threads,
            || (),
            |_, (run, found)| {
                *found = Some(self.evaluate_run(inputs, run.clone(), 1, derivatives));
            },
        );
        let mut all = Evaluated {
            solutions: Solutions::empty(),
            jacobians: vec![],
        };
        for (run, found) in parts {
            // interrupted work leaves runs out
            let found = match found {
                Some(found) => found?,
                None => self.pending(run.len(), derivatives)?,
            };
            all.solutions.append(found.solutions);
            all.jacobians.extend(found.jacobians);
        }
        Ok(all)
    }

    fn pending(&self, n: usize, derivatives: Derivatives) -> Result<Evaluated, InputError> {
        Ok(Evaluated {
            solutions: Solutions::pending(&self.robot, n, false)?,
            jacobians: self.unknown_jacobians(n, derivatives)?,
        })
    }

    /// Derivatives of `n` rows, all NaN; empty if they are not wanted.
    fn unknown_jacobians(
        &self,
        n: usize,
        derivatives: Derivatives,
    ) -> Result<Vec<f64>, InputError> {
        let [rows, columns] = self.jacobian_shape(derivatives);
        unknown(n.checked_mul(rows * columns), &|| too_many(n))
    }

    /// Equilibria of rows of equal stiffness.
    fn evaluate_run(
        &self,
        inputs: &Inputs,
        rows: Range<usize>,
        threads: usize,
        derivatives: Derivatives,
    ) -> Result<Evaluated, InputError> {
        let (n, tendons) = (rows.len(), self.robot.tendon_count());
        let segments = self.robot.spec().backbone.len();
        let of =
            |numbers: &'_ [f64], each: usize| numbers[rows.start * each..][..n * each].to_vec();
        let [gravity, tip_force, tip_moment] =
            [inputs.gravity, inputs.tip_force, inputs.tip_moment].map(|v| common(of(v, 3)));
        let loads = Loads {
            count: n,
            tensions: &inputs.tensions[rows.start * tendons..][..n * tendons],
            gravity: &gravity,
            tip_force: &tip_force,
            tip_moment: &tip_moment,
            disks: self.robot.module_count(),
            disk_forces: &self.load.disk_forces,
            disk_moments: &self.load.disk_moments,
            point_loads: &self.load.point_loads,
            line_forces: &self.load.line_forces,
        };
        let factors = inputs.stiffness.get(rows.start * segments..);
        let factors = &factors.unwrap_or_default()[..if n == 0 { 0 } else { segments }];
        let own = factors.iter().all(|f| *f == 1.0);
        let scaled = match own {
            true => None,
            false => match self.robot.with_stiffness(factors) {
                Ok(robot) => Some(robot),
                // the factors leave what numbers can hold
                Err(_) => return self.pending(n, derivatives),
            },
        };
        let robot = scaled.as_ref().unwrap_or(&self.robot);
        let mut found = match n {
            1 => self.evaluate_one(robot, own, &loads, derivatives)?,
            _ => {
                let mut by = self.unknown_jacobians(n, derivatives)?;
                let model = &self.model;
                let solutions =
                    solve_and_differentiate(robot, model, &loads, threads, false, &mut by)?;
                Evaluated {
                    solutions,
                    jacobians: by,
                }
            }
        };
        // from the logarithm to the factor itself
        let [_, columns] = self.jacobian_shape(derivatives);
        if columns > 0 && !own {
            for row in found.jacobians.chunks_exact_mut(columns) {
                for (x, factor) in row[tendons + 6..].iter_mut().zip(factors) {
                    *x /= factor;
                }
            }
        }
        Ok(found)
    }

    /// Equilibrium of a single load; of the robot itself if `own`, by a kept solver.
    fn evaluate_one(
        &self,
        robot: &Robot,
        own: bool,
        loads: &Loads,
        derivatives: Derivatives,
    ) -> Result<Evaluated, InputError> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let former = if own { kept().pop() } else { None };
        let mut single = match former {
            Some(single) => single,
            None => Single {
                solver: Adaptive::of(robot, &self.model)?,
                differentiator: Differentiator::new(robot, &self.model),
            },
        };
        let mut found = self.pending(1, derivatives)?;
        let Single {
            solver,
            differentiator,
        } = &mut single;
        for mut chunk in found.solutions.chunks(robot, 1) {
            if derivatives != Derivatives::None {
                chunk.keep_strains();
            }
            chunk.solve(0, solver, loads, false);
            if derivatives != Derivatives::None {
                chunk.differentiate(differentiator, loads, &mut found.jacobians);
            }
        }
        if own && kept().len() < MOST_KEPT {
            kept().push(single);
        }
        Ok(found)
    }
}

/// Rows of three numbers; one row if all are equal.
fn common(mut rows: Vec<f64>) -> Vec<f64> {
    let first = [0, 1, 2].map(|q| rows.get(q).copied().unwrap_or_default());
    if rows.chunks_exact(3).all(|row| row == first) {
        rows.truncate(3);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::load::PointLoad;
    use crate::model::robot::{Payload, Profile, RobotSpec, Section};
    use crate::parts;
    use crate::statics::batch::solve_batch;
    use crate::statics::solver::Status;

    fn robot() -> Robot {
        let sections = [1.1, 0.7].map(|bending| Section {
            rest_curvature: [0.3, 0.0, 0.0],
            ..parts::section(bending)
        });
        let spec = parts::robot(&sections, &[4, 4], [0.07, 0.002], 1.0, &[3, 3, 7, 7]);
        Robot::new(spec).unwrap()
    }

    /// Rows of numbers that vary with the row and the column.
    fn numbers(n: usize, each: usize, size: f64) -> Vec<f64> {
        let at = |k: usize| size * (1.0 + (0.7 * k as f64).sin());
        (0..n * each).map(at).collect()
    }

    fn inputs<'a>(n: usize, numbers: &'a [Vec<f64>; 5]) -> Inputs<'a> {
        let [tensions, gravity, tip_force, tip_moment, stiffness] = numbers;
        Inputs {
            count: n,
            tensions,
            gravity,
            tip_force,
            tip_moment,
            stiffness,
        }
    }

    fn made(n: usize) -> [Vec<f64>; 5] {
        [
            numbers(n, 4, 6.0),
            [0.0, 0.0, -9.81].repeat(n),
            numbers(n, 3, 0.1),
            vec![0.0; 3 * n],
            vec![1.0; 2 * n],
        ]
    }

    fn function() -> Equilibria {
        Equilibria::new(&robot(), RodModel::default(), OwnedLoad::default()).unwrap()
    }

    /// The solutions are those of `solve_batch`, with and without derivatives.
    #[test]
    fn solutions_are_those_of_the_batch() {
        let function = function();
        for n in [0, 1, 3, 300] {
            let own = made(n);
            let inputs = inputs(n, &own);
            let loads = Loads {
                count: n,
                tensions: inputs.tensions,
                gravity: &[0.0, 0.0, -9.81],
                tip_force: inputs.tip_force,
                tip_moment: &[0.0; 3],
                ..Loads::default()
            };
            let batch = solve_batch(&robot(), &RodModel::default(), &loads, 0, false).unwrap();
            for derivatives in [Derivatives::None, Derivatives::Most, Derivatives::All] {
                let found = function.evaluate(&inputs, 0, derivatives).unwrap();
                let off = found.solutions.tip_position.iter().zip(&batch.tip_position);
                for (a, b) in off {
                    assert!(if n == 1 {
                        (a - b).abs() < 1e-12
                    } else {
                        a == b
                    });
                }
                let [rows, columns] = function.jacobian_shape(derivatives);
                assert_eq!(found.jacobians.len(), n * rows * columns);
                assert!(found.jacobians.iter().all(|x| x.is_finite()));
            }
        }
    }

    /// Derivatives by every input agree with Richardson's extrapolation of central differences,
    /// also where the stiffness differs from row to row.
    #[test]
    fn derivatives_agree_with_differences() {
        check_derivatives(&function());
        let segments = |changed: &dyn Fn(&mut RobotSpec)| {
            let mut spec = robot().spec().clone();
            changed(&mut spec);
            Robot::new(spec).unwrap()
        };
        let loaded = segments(&|spec| {
            spec.payloads.push(Payload {
                disk: 4,
                mass: 0.05,
                centre: [0.02, -0.01, 0.03],
                inertia: [0.7, 0.8, 0.1], // of a plate but for rounding
            });
            let Profile::Uniform(section) = spec.backbone[1].clone() else {
                unreachable!("it is uniform")
            };
            let thinner = |p: usize| Section {
                bending: section.bending.map(|b| b * (1.0 - 0.1 * p as f64)),
                mass_per_length: 0.2 * (1.0 - 0.15 * p as f64),
                ..section
            };
            spec.backbone[1] = Profile::Tapered(Box::new([0, 1, 2, 3, 4].map(thinner)));
        });
        let between = OwnedLoad {
            point_loads: vec![PointLoad {
                arc_length: Some(0.24),
                force: [0.1, 0.0, -0.1],
                ..PointLoad::default()
            }],
            ..OwnedLoad::default()
        };
        for elements in [1, 2, 4] {
            let model = RodModel {
                elements: Some(elements),
                ..RodModel::default()
            };
            let constant = if elements > 1 {
                &between
            } else {
                &OwnedLoad::default()
            };
            check_derivatives(&Equilibria::new(&loaded, model, constant.clone()).unwrap());
        }
    }

    fn check_derivatives(function: &Equilibria) {
        let n = 3;
        let mut own = made(n);
        own[3] = numbers(n, 3, 0.02);
        own[4] = vec![1.0, 1.0, 0.8, 1.3, 1.1, 0.9];
        let found = function.evaluate(&inputs(n, &own), 1, Derivatives::All);
        let found = found.unwrap();
        let [rows, columns] = function.jacobian_shape(Derivatives::All);
        let mut column = 0;
        let of_loads = [(0, 4, 0.05), (2, 3, 0.01), (3, 3, 2e-3)];
        for (k, each, step) in of_loads.into_iter().chain([(4, 2, 0.01), (1, 3, 0.3)]) {
            for q in 0..each {
                let at = |h: f64| {
                    let mut moved = own.clone();
                    (0..n).for_each(|i| moved[k][i * each + q] += h);
                    function
                        .evaluate(&inputs(n, &moved), 1, Derivatives::None)
                        .unwrap()
                        .solutions
                };
                let pairs = [step, 0.5 * step].map(|h| (h, at(h), at(-h)));
                let richardson = |of: &dyn Fn(&Solutions) -> f64| {
                    let slope = |k: usize| {
                        let (h, up, down) = &pairs[k];
                        (of(up) - of(down)) / (2.0 * h)
                    };
                    (4.0 * slope(1) - slope(0)) / 3.0
                };
                for i in 0..n {
                    let by = |row: usize| found.jacobians[(i * rows + row) * columns + column];
                    for p in 0..3 {
                        let expected = richardson(&|s| s.tip_position[3 * i + p]);
                        assert!((by(p) - expected).abs() < 2e-6, "{k} {q} {i} {p}");
                    }
                    for t in 0..4 {
                        let expected = richardson(&|s| s.tendon_length[4 * i + t]);
                        assert!((by(6 + t) - expected).abs() < 2e-6, "{k} {q} {i} {t}");
                    }
                }
                column += 1;
            }
        }
        assert_eq!(column, columns);
    }

    /// Rows with invalid numbers hold NaN, and the others their solutions.
    #[test]
    fn invalid_rows_have_no_numbers() {
        let function = function();
        let n = 5;
        let good = made(n);
        let expected = function
            .evaluate(&inputs(n, &good), 0, Derivatives::Most)
            .unwrap();
        let mut own = good.clone();
        own[0][4] = -1.0;
        own[2][6] = f64::NAN;
        own[4][7] = 0.0;
        let found = function
            .evaluate(&inputs(n, &own), 0, Derivatives::Most)
            .unwrap();
        let numbers = found.jacobians.len() / n;
        for i in 0..n {
            let bad = (1..4).contains(&i);
            let status = found.solutions.outcomes[i].status;
            assert_eq!(status == Status::Converged, !bad, "{i}");
            let tip = &found.solutions.tip_position[3 * i..][..3];
            let by = &found.jacobians[numbers * i..][..numbers];
            assert!(tip.iter().chain(by).all(|x| x.is_nan() == bad));
            if !bad {
                let other = &expected.solutions.tip_position[3 * i..][..3];
                assert!(tip.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-12));
            }
        }
    }

    #[test]
    fn inputs_of_the_wrong_length_are_rejected() {
        let own = made(2);
        let wrong = Inputs {
            count: 3,
            ..inputs(2, &own)
        };
        let refused = function()
            .evaluate(&wrong, 0, Derivatives::None)
            .unwrap_err();
        let said = "tensions has 8 numbers, it must have 4 for each of 3 loads";
        assert_eq!(refused.to_string(), said);
    }
}
