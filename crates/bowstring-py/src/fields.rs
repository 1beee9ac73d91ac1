//! Fields of a run: strain and stress of sections, and the records of its file.

use crate::input::{array, input_error, refused, Array};
use crate::interrupt::interruptible;
use bowstring_core::dynamics::integrator::Fields;
use bowstring_core::dynamics::records;
use bowstring_core::memory;
use bowstring_core::model::robot::Robot;
use bowstring_core::stress::{self, Section, Sections};
use numpy::{
    PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice};

/// Largest von Mises stress around each of K sections (Pa), with cosine and sine of its angle, as
/// the rows of (3, K); from coefficients (3, K) of normal and shear stress.
#[pyfunction]
pub fn von_mises<'py>(
    py: Python<'py>,
    sigma: PyReadonlyArray2<'py, f64>,
    tau: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array<'py>> {
    let count = sigma.shape()[1];
    if sigma.shape() != [3, count] || tau.shape() != [3, count] {
        return Err(refused("stress coefficients must be two arrays (3, K)"));
    }
    let (sigma, tau) = (sigma.as_slice()?, tau.as_slice()?);
    check_sections(count, 3 + 6)?;
    let (sigma, tau) = (sigma.to_vec(), tau.to_vec());
    let out = interruptible(py, || stress::von_mises(&sigma, &tau))?;
    Ok(array(py, out, &[3, count]))
}

/// Coefficients (2, 3, ...) of normal and shear stress around sections (Pa), from force and moment
/// (..., P, 3). Columns of the sections (P, 10): those of `stress::Section`.
#[pyfunction]
pub fn surface_stress<'py>(
    py: Python<'py>,
    sections: PyReadonlyArray2<'py, f64>,
    force: PyReadonlyArrayDyn<'py, f64>,
    moment: PyReadonlyArrayDyn<'py, f64>,
) -> PyResult<Array<'py>> {
    let sections = sections_of(&sections)?;
    let mut shape = vec![2, 3];
    shape.extend(outer_shape(&sections, [&force, &moment])?);
    let (force, moment) = (force.as_slice()?, moment.as_slice()?);
    let total = force.len() / 3;
    check_sections(total, 6)?;
    let out = interruptible(py, || stress::surface_stress(&sections, force, moment))?;
    Ok(array(py, out, &shape))
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
    let given = Sections {
        sections: &sections,
        position,
        rotation,
        force,
        moment,
    };
    let found = interruptible(py, || stress::derive_all(given))?;
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
        out.set_item(name, array(py, values, shape))?;
    }
    Ok(out)
}

/// Records of a run, passed to `append` in a buffer of Python whenever that is full.
pub(crate) struct Records {
    inner: records::Records,
    room: Py<PyArray1<u8>>,
    append: Py<PyAny>,
}

impl Records {
    /// Records of a robot, from sections and their arc lengths.
    pub(crate) fn new(
        robot: &Robot,
        sections: &PyReadonlyArray2<'_, f64>,
        station: &PyReadonlyArray1<'_, f64>,
        room: Bound<'_, PyArray1<u8>>,
        append: Py<PyAny>,
    ) -> PyResult<Self> {
        let (sections, station) = (sections_of(sections)?, station.as_slice()?.to_vec());
        let inner =
            records::Records::new(robot, sections, station, room.len()).ok_or_else(|| {
                refused("there must be a section for every station, and room for whole records")
            })?;
        if !room.is_contiguous() || room.try_readwrite().is_err() {
            return Err(refused(
                "the room must be bytes in a row that may be written",
            ));
        }
        Ok(Records {
            inner,
            room: room.unbind(),
            append,
        })
    }

    /// Packs the fields of one time; returns whether there is no room for another.
    pub(crate) fn add(&mut self, fields: &Fields) -> bool {
        self.inner.add(fields)
    }

    /// Writes the packed bytes; after an error they are discarded.
    pub(crate) fn flush(&mut self, py: Python<'_>) -> PyResult<()> {
        let packed = self.inner.take();
        if !packed.is_empty() {
            let room = self.room.bind(py);
            let mut bytes = room.try_readwrite()?;
            bytes.as_slice_mut()?[..packed.len()].copy_from_slice(packed);
            drop(bytes);
            let records = room.get_item(PySlice::new(py, 0, packed.len() as isize, 1))?;
            self.append.call1(py, (records,))?;
        }
        Ok(())
    }
}

/// Checks that this many numbers for each of `count` sections fit into memory.
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

/// Leading dimensions of vectors (..., P, 3) at these sections.
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
