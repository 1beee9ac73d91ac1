//! Fields of a run: strain and stress of sections, and the records of its file.

use crate::input::{input_error, refused};
use crate::interrupt::interruptible;
use bowstring_core::dynamics::integrator::Fields;
use bowstring_core::interrupt;
use bowstring_core::memory;
use bowstring_core::model::robot::Robot;
use bowstring_core::stress::{self, Derived, Section, Sections};
use numpy::{
    IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice};

/// Largest von Mises stress around each of K sections, Pa, and cosine and sine of its place, as
/// the rows of (3, K); from coefficients (3, K) of normal and shear stress.
#[pyfunction]
pub fn von_mises<'py>(
    py: Python<'py>,
    sigma: PyReadonlyArray2<'py, f64>,
    tau: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let count = sigma.shape()[1];
    if sigma.shape() != [3, count] || tau.shape() != [3, count] {
        return Err(refused("stress coefficients must be two arrays (3, K)"));
    }
    let (sigma, tau) = (sigma.as_slice()?, tau.as_slice()?);
    check_sections(count, 3 + 6)?;
    let (sigma, tau) = (sigma.to_vec(), tau.to_vec());
    let mut out = vec![0.0; 3 * count];
    interruptible(py, || {
        for start in (0..count).step_by(BLOCK) {
            if interrupt::work(8 * BLOCK) {
                return;
            }
            let end = count.min(start + BLOCK);
            let rows = [0, 1, 2].map(|q| q * count + start..q * count + end);
            let found = stress::largest_of_many(
                rows.clone().map(|row| &sigma[row]),
                rows.map(|row| &tau[row]),
            );
            for (q, row) in found.iter().enumerate() {
                out[q * count + start..][..row.len()].copy_from_slice(row);
            }
        }
    })?;
    out.into_pyarray(py)
        .reshape([3, count])
        .map(|a| a.to_dyn().clone())
}

/// Coefficients (2, 3, ...) of normal and shear stress around sections, Pa, from force and moment
/// (..., P, 3). Columns of the sections (P, 10): those of `stress::Section`.
#[pyfunction]
pub fn surface_stress<'py>(
    py: Python<'py>,
    sections: PyReadonlyArray2<'py, f64>,
    force: PyReadonlyArrayDyn<'py, f64>,
    moment: PyReadonlyArrayDyn<'py, f64>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let sections = sections_of(&sections)?;
    let mut shape = vec![2, 3];
    shape.extend(outer_shape(&sections, [&force, &moment])?);
    let (force, moment) = (force.as_slice()?, moment.as_slice()?);
    let total = force.len() / 3;
    check_sections(total, 6)?;
    let mut out = vec![0.0; 6 * total];
    for i in 0..total {
        if i % BLOCK == BLOCK - 1 {
            py.check_signals()?;
        }
        let three = |v: &[f64]| [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
        let found = sections[i % sections.len()].stress(three(force), three(moment));
        for (q, v) in found.as_flattened().iter().enumerate() {
            out[q * total + i] = *v;
        }
    }
    out.into_pyarray(py).reshape(shape)
}

/// Strain and stress of sections as a dict of arrays (T, P) and (T, P, 3), named as the fields of a
/// run.
#[pyfunction]
pub fn derive<'py>(
    py: Python<'py>,
    sections: PyReadonlyArray2<'py, f64>,
    position: PyReadonlyArrayDyn<'py, f64>,
    rotation: PyReadonlyArrayDyn<'py, f64>,
    force: PyReadonlyArrayDyn<'py, f64>,
    moment: PyReadonlyArrayDyn<'py, f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let sections = sections_of(&sections)?;
    let shape = outer_shape(&sections, [&position, &force, &moment])?.to_vec();
    if rotation.len() != 3 * position.len() {
        return Err(refused("rotations must be (T, P, 3, 3)"));
    }
    let (position, rotation) = (position.as_slice()?, rotation.as_slice()?);
    let (force, moment) = (force.as_slice()?, moment.as_slice()?);
    let total = force.len() / 3;
    check_sections(total, 16)?;
    let mut found = Derived::default();
    interruptible(py, || {
        // whole times, so that each begins with the first section
        let size = BLOCK.div_ceil(sections.len()) * sections.len();
        let mut block = Derived::default();
        for start in (0..total).step_by(size) {
            if interrupt::work(8 * size) {
                return;
            }
            let end = total.min(start + size);
            let given = Sections {
                sections: &sections,
                position: &position[3 * start..3 * end],
                rotation: &rotation[9 * start..9 * end],
                force: &force[3 * start..3 * end],
                moment: &moment[3 * start..3 * end],
            };
            stress::derive(given, &mut block);
            found.append(&block, total);
        }
    })?;
    let mut vector = shape.clone();
    vector.push(3);
    let out = PyDict::new(py);
    for (name, values, shape) in [
        ("curvature", found.curvature, &vector),
        ("strain", found.strain, &vector),
        ("axial_stress", found.axial, &shape),
        ("bending_stress", found.bending, &shape),
        ("normal_stress", found.normal, &shape),
        ("shear_stress", found.shear, &shape),
        ("torsion_stress", found.torsion, &shape),
        ("von_mises", found.von_mises, &shape),
        ("von_mises_angle", found.angle, &shape),
        ("von_mises_place", found.place, &vector),
    ] {
        out.set_item(name, values.into_pyarray(py).reshape(shape.as_slice())?)?;
    }
    Ok(out)
}

/// Output times as the file of a run has them: packed one after the other, without the interpreter,
/// and handed to `append` in a room of Python's whenever that is full.
///
/// A record is the time and then all fields in the order of the file, most significant byte first.
pub(crate) struct Records {
    sections: Vec<Section>,
    station: Vec<f64>,
    /// m, of the straight robot.
    length: f64,
    energy_at_start: Option<f64>,
    derived: Derived,
    packed: Vec<u8>,
    filled: usize,
    room: Py<PyArray1<u8>>,
    append: Py<PyAny>,
}

impl Records {
    /// Of a robot, from sections and their arc lengths.
    pub(crate) fn new(
        robot: &Robot,
        sections: &PyReadonlyArray2<'_, f64>,
        station: &PyReadonlyArray1<'_, f64>,
        room: Bound<'_, PyArray1<u8>>,
        append: Py<PyAny>,
    ) -> PyResult<Self> {
        let sections = sections_of(sections)?;
        let (disks, tendons) = (robot.module_count(), robot.tendon_count());
        let of_disks = 18 * disks + 2 * disks * tendons;
        // beside these: time, the largest stress and its place, the tip, energies
        let record = 8 * (1 + 34 * sections.len() + 5 + of_disks + 3 + 4 * tendons + 6);
        if station.len() != sections.len() || room.is_empty() || room.len() % record != 0 {
            return Err(refused(
                "there must be a section for every station, and room for whole records",
            ));
        }
        if !room.is_contiguous() || room.try_readwrite().is_err() {
            return Err(refused(
                "the room must be bytes in a row that may be written",
            ));
        }
        Ok(Records {
            sections,
            station: station.as_slice()?.to_vec(),
            length: robot.length(),
            energy_at_start: None,
            derived: Derived::default(),
            packed: vec![0; room.len()],
            filled: 0,
            room: room.unbind(),
            append,
        })
    }

    /// Packs fields of one time; returns whether there is no room for another.
    pub(crate) fn add(&mut self, fields: &Fields) -> bool {
        let given = Sections {
            sections: &self.sections,
            position: &fields.position,
            rotation: &fields.rotation,
            force: &fields.force,
            moment: &fields.moment,
        };
        stress::derive(given, &mut self.derived);
        let found = &self.derived;
        let top = first_largest(&found.von_mises);
        let tip = &fields.disk_position[fields.disk_position.len() - 3..];
        let energy = &fields.energies[0];
        let left_over = energy.left();
        let start = *self.energy_at_start.get_or_insert(left_over);
        let mut rest = &mut self.packed[self.filled..];
        let left = rest.len();
        for values in [
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
            &fields.disk_position,
            &fields.disk_rotation,
            &fields.disk_velocity,
            &fields.disk_angular_velocity,
            &[tip[0], tip[1], tip[2] - self.length],
            &fields.tension,
            &fields.tendon_length,
            &fields.pull,
            &fields.slack,
            &fields.span_length,
            &fields.span_tension,
            &[energy.kinetic, energy.elastic, energy.gravity],
            &[energy.work, energy.dissipated, left_over - start],
        ] {
            rest = put(rest, values);
        }
        self.filled += left - rest.len();
        rest.is_empty()
    }

    /// Has all that is packed written; after an error it is forgotten.
    pub(crate) fn flush(&mut self, py: Python<'_>) -> PyResult<()> {
        let filled = std::mem::take(&mut self.filled);
        if filled > 0 {
            let room = self.room.bind(py);
            let mut bytes = room.try_readwrite()?;
            bytes.as_slice_mut()?[..filled].copy_from_slice(&self.packed[..filled]);
            drop(bytes);
            let records = room.get_item(PySlice::new(py, 0, filled as isize, 1))?;
            self.append.call1(py, (records,))?;
        }
        Ok(())
    }
}

/// Writes numbers, most significant byte first, and returns what is left.
fn put<'a>(out: &'a mut [u8], values: &[f64]) -> &'a mut [u8] {
    #[inline(always)]
    fn here(out: &mut [u8], values: &[f64]) {
        for (bytes, value) in out.as_chunks_mut().0.iter_mut().zip(values) {
            *bytes = value.to_be_bytes();
        }
    }
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn with_avx2(out: &mut [u8], values: &[f64]) {
        here(out, values);
    }
    let (to, rest) = out.split_at_mut(8 * values.len());
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has just been found to have AVX2
        unsafe { with_avx2(to, values) };
        return rest;
    }
    here(to, values);
    rest
}

/// As numpy's argmax: the first of several, and NaN before any number.
fn first_largest(values: &[f64]) -> usize {
    let mut top = 0;
    for (i, value) in values.iter().enumerate() {
        if !(*value <= values[top]) && !values[top].is_nan() {
            top = i;
        }
    }
    top
}

/// Sections between two looks for an interruption.
const BLOCK: usize = 1 << 15;

/// Checks that so many numbers for each of `count` sections fit into memory.
fn check_sections(count: usize, numbers: usize) -> PyResult<()> {
    let bytes = 8.0 * count as f64 * numbers as f64;
    let what = || format!("strain and stress of {count} sections");
    memory::check(bytes, what, "give fewer times or points").map_err(input_error)
}

fn sections_of(columns: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Section>> {
    if columns.shape()[1] != 10 || columns.shape()[0] == 0 {
        return Err(refused("sections must be rows of ten numbers"));
    }
    let columns = columns.as_array();
    Ok(columns
        .rows()
        .into_iter()
        .map(|row| Section {
            radius: row[0],
            area: row[1],
            modulus: row[2],
            shear: row[3],
            bending_compliance: [row[4], row[5], row[6]],
            force_compliance: [row[7], row[8], row[9]],
        })
        .collect())
}

/// The shape of vectors (..., P, 3) at these sections without the last dimension.
fn outer_shape<'a, const K: usize>(
    sections: &[Section],
    vectors: [&'a PyReadonlyArrayDyn<'_, f64>; K],
) -> PyResult<&'a [usize]> {
    let shape = vectors[0].shape();
    match shape {
        [outer @ .., 3]
            if outer.last() == Some(&sections.len())
                && vectors.iter().all(|v| v.shape() == shape) =>
        {
            Ok(outer)
        }
        _ => Err(refused("vectors of sections must be (..., P, 3)")),
    }
}
