//! Output times of a motion in the format of a run file.

use crate::math::vectorize;
use crate::model::robot::Robot;
use crate::step::Fields;
use crate::stress::{self, Derived, Section, Sections};

/// Output times packed one after the other.
///
/// A record is the time and then all fields in the order of the file, big-endian.
pub struct Records {
    sections: Vec<Section>,
    /// Arc length of every section (m).
    station: Vec<f64>,
    /// Length of the straight robot (m).
    length: f64,
    energy_at_start: Option<f64>,
    derived: Derived,
    packed: Vec<u8>,
    filled: usize,
}

impl Records {
    /// Records of a robot, from sections and their arc lengths (m), with room for `bytes`. `None`
    /// where the numbers of sections and arc lengths differ, or the room does not hold whole
    /// records.
    pub fn new(
        robot: &Robot,
        sections: Vec<Section>,
        station: Vec<f64>,
        bytes: usize,
    ) -> Option<Self> {
        let (disks, tendons) = (robot.module_count(), robot.tendon_count());
        let of_disks = 18 * disks + 2 * disks * tendons;
        // besides these: time, the largest stress and its position, the tip, energies
        let record = 8 * (1 + 34 * sections.len() + 5 + of_disks + 3 + 4 * tendons + 6);
        if station.len() != sections.len() || bytes == 0 || !bytes.is_multiple_of(record) {
            return None;
        }
        Some(Records {
            sections,
            station,
            length: robot.length(),
            energy_at_start: None,
            derived: Derived::default(),
            packed: vec![0; bytes],
            filled: 0,
        })
    }

    /// Packs the fields of one time; returns whether there is no room for another.
    pub fn add(&mut self, fields: &Fields) -> bool {
        let (backbone, disks, tendons) = (&fields.sections, &fields.disks, &fields.tendons);
        let given = Sections {
            sections: &self.sections,
            position: &backbone.position,
            rotation: &backbone.rotation,
            force: &backbone.force,
            moment: &backbone.moment,
        };
        stress::derive(given, &mut self.derived);
        let found = &self.derived;
        let top = first_largest(&found.von_mises);
        let tip = &disks.position[disks.position.len() - 3..];
        let energy = &fields.energies[0];
        let left_over = energy.left();
        let start = *self.energy_at_start.get_or_insert(left_over);
        let values: [&[f64]; 31] = [
            &fields.time,
            given.position,
            given.rotation,
            given.force,
            given.moment,
            &found.curvature,
            &found.strain,
            &found.axial,
            &found.bending,
            &found.normal,
            &found.shear,
            &found.torsion,
            &found.von_mises,
            &found.angle,
            &found.place,
            &found.von_mises[top..=top],
            &self.station[top..=top],
            &found.place[3 * top..3 * top + 3],
            &disks.position,
            &disks.rotation,
            &disks.velocity,
            &disks.angular_velocity,
            &[tip[0], tip[1], tip[2] - self.length],
            &tendons.tension,
            &tendons.length,
            &tendons.displacement,
            &tendons.slack,
            &tendons.span_length,
            &tendons.span_tension,
            &[energy.kinetic, energy.elastic, energy.gravity],
            &[energy.work, energy.dissipated, left_over - start],
        ];
        let room = &mut self.packed[self.filled..];
        let filled = vectorize(
            #[inline(always)]
            || pack(room, &values),
        );
        self.filled += filled;
        self.filled == self.packed.len()
    }

    /// Returns the packed bytes and clears them.
    pub fn take(&mut self) -> &[u8] {
        &self.packed[..std::mem::take(&mut self.filled)]
    }
}

/// Writes numbers big-endian; returns the count of bytes.
#[inline(always)]
fn pack(out: &mut [u8], values: &[&[f64]]) -> usize {
    let mut filled = 0;
    for values in values {
        let to = &mut out[filled..][..8 * values.len()];
        for (bytes, value) in to.as_chunks_mut().0.iter_mut().zip(*values) {
            *bytes = value.to_be_bytes();
        }
        filled += to.len();
    }
    filled
}

/// Index of the maximum as numpy's argmax: the first of several, and NaN before any number.
fn first_largest(values: &[f64]) -> usize {
    let mut top = 0;
    for (i, value) in values.iter().enumerate() {
        if !(*value <= values[top]) && !values[top].is_nan() {
            top = i;
        }
    }
    top
}
