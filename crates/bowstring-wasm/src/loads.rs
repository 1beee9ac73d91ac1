//! Dead loads on the bench.

use bowstring_core::model::load::Load;

/// Dead loads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loads {
    pub gravity: [f64; 3],
    pub force: [f64; 3],
    pub moment: [f64; 3],
}

impl Loads {
    /// From gravity, force and moment in one row.
    pub fn new(row: &[f64]) -> Result<Self, String> {
        let &[gx, gy, gz, fx, fy, fz, mx, my, mz] = row else {
            return Err(format!("{} numbers of loads, must be 9", row.len()));
        };
        Ok(Loads {
            gravity: [gx, gy, gz],
            force: [fx, fy, fz],
            moment: [mx, my, mz],
        })
    }

    pub fn with<'a>(&self, tensions: &'a [f64]) -> Load<'a> {
        Load {
            tensions,
            gravity: self.gravity,
            tip_force: self.force,
            tip_moment: self.moment,
            ..Load::default()
        }
    }
}
