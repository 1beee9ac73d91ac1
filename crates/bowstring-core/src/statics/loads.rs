//! Loads of many rows.

use crate::interrupt;
use crate::model::error::InputError;
use crate::model::load::{Load, PointLoad};
use crate::model::robot::Robot;

/// Loads as flat arrays, row by row; SI units, base frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Loads<'a> {
    /// Number of rows.
    pub count: usize,
    /// Tensions (N), one for each tendon in each row.
    pub tensions: &'a [f64],
    /// Gravity (m/s^2): three numbers, or three in each row.
    pub gravity: &'a [f64],
    /// Force on the tip (N), in the same form as gravity.
    pub tip_force: &'a [f64],
    /// Moment on the tip (N m), in the same form as gravity.
    pub tip_moment: &'a [f64],
    /// Number of disks with a force or a moment in each row.
    pub disks: usize,
    /// Forces on the disks (N): none, those of all rows, or those of each row.
    pub disk_forces: &'a [[f64; 3]],
    /// Moments on the disks (N m), in the same form.
    pub disk_moments: &'a [[f64; 3]],
    /// Loads at points fixed to disks, those of all rows.
    pub point_loads: &'a [PointLoad],
    /// Forces per length on the backbone (N/m), those of all rows.
    pub line_forces: &'a [[f64; 3]],
}

impl<'a> Loads<'a> {
    /// One row, for a robot with this many tendons.
    pub fn row(&self, i: usize, tendons: usize) -> Load<'a> {
        let three = |v: &[f64]| {
            let at = if v.len() == 3 { 0 } else { 3 * i };
            [v[at], v[at + 1], v[at + 2]]
        };
        let on_disks = |v: &'a [[f64; 3]]| match v.len() > self.disks {
            true => &v[self.disks * i..][..self.disks],
            false => v,
        };
        Load {
            tensions: &self.tensions[i * tendons..][..tendons],
            gravity: three(self.gravity),
            tip_force: three(self.tip_force),
            tip_moment: three(self.tip_moment),
            disk_forces: on_disks(self.disk_forces),
            disk_moments: on_disks(self.disk_moments),
            point_loads: self.point_loads,
            line_forces: self.line_forces,
            ..Load::default()
        }
    }

    /// Checks every row; the error names the first invalid one, counted from 0.
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        let (n, tendons) = (self.count, robot.tendon_count());
        if Some(self.tensions.len()) != n.checked_mul(tendons) {
            return Err(InputError::other(format!(
                "{} tensions were given, {n} loads of a robot with {tendons} tendons need {tendons} each",
                self.tensions.len()
            )));
        }
        for (name, v) in [
            ("gravity", self.gravity),
            ("tip force", self.tip_force),
            ("tip moment", self.tip_moment),
        ] {
            if v.len() != 3 && Some(v.len()) != n.checked_mul(3) {
                return Err(InputError::other(format!(
                    "{name} has {} numbers, it must have 3, or 3 for each of the {n} loads",
                    v.len()
                )));
            }
        }
        for (name, v) in [("forces", self.disk_forces), ("moments", self.disk_moments)] {
            let each = n.checked_mul(self.disks);
            if !v.is_empty() && v.len() != self.disks && Some(v.len()) != each {
                return Err(InputError::other(format!(
                    "{} {name} on disks were given, they must be one for each of {} disks, or as \
                     many for each of the {n} loads",
                    v.len(),
                    self.disks
                )));
            }
        }
        for i in 0..n {
            if interrupt::work(1 + tendons / 4) {
                break;
            }
            let row = self.row(i, tendons);
            row.check(robot).map_err(|e| e.in_row(i))?;
        }
        Ok(())
    }

    /// Checks that so many elements in a module take the loads, if they are given.
    pub(crate) fn check_elements(
        &self,
        robot: &Robot,
        elements: Option<usize>,
    ) -> Result<(), InputError> {
        let load = Load {
            point_loads: self.point_loads,
            ..Load::default()
        };
        elements.map_or(Ok(()), |elements| load.check_elements(robot, elements))
    }
}
