//! Fields of a run: strain and stress of sections, and the records of its file.

use crate::rod::refused;
use bowstring_core::stress::{self, Derived, Section, Sections};
use numpy::{
    IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArrayDyn, PyReadwriteArray1, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

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
    let rows = |v: &'_ [f64]| [0, 1, 2].map(|q| v[q * count..(q + 1) * count].to_vec());
    let (sigma, tau) = (rows(sigma), rows(tau));
    let found = py.detach(|| {
        stress::largest_of_many(
            sigma.each_ref().map(Vec::as_slice),
            tau.each_ref().map(Vec::as_slice),
        )
    });
    found
        .concat()
        .into_pyarray(py)
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
    let mut out = vec![0.0; 6 * total];
    for i in 0..total {
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
    let given = Sections {
        sections: &sections,
        position: position.as_slice()?,
        rotation: rotation.as_slice()?,
        force: force.as_slice()?,
        moment: moment.as_slice()?,
    };
    let mut found = Derived::default();
    py.detach(|| stress::derive(given, &mut found));
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

/// Fills `out` with the records of a run's file from output time `first` on, most significant byte
/// first: time, position, rotation, force and moment (T, P, ...), all that `derive` makes of them
/// and the largest von Mises stress with its arc length and place, then `others` (T, ...).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn write_records(
    py: Python<'_>,
    sections: PyReadonlyArray2<'_, f64>,
    station: PyReadonlyArray1<'_, f64>,
    time: PyReadonlyArray1<'_, f64>,
    position: PyReadonlyArrayDyn<'_, f64>,
    rotation: PyReadonlyArrayDyn<'_, f64>,
    force: PyReadonlyArrayDyn<'_, f64>,
    moment: PyReadonlyArrayDyn<'_, f64>,
    others: Vec<PyReadonlyArrayDyn<'_, f64>>,
    first: usize,
    mut out: PyReadwriteArray1<'_, u8>,
) -> PyResult<()> {
    let sections = sections_of(&sections)?;
    let (stations, times) = (sections.len(), time.len());
    let vectors = outer_shape(&sections, [&position, &force, &moment])?;
    let whole = |a: &PyReadonlyArrayDyn<'_, f64>| a.shape().first() == Some(&times);
    if vectors != [times, stations]
        || rotation.len() != 9 * times * stations
        || station.len() != stations
        || !others.iter().all(whole)
    {
        return Err(refused("fields must have a row for every time and station"));
    }
    let (station, time) = (station.as_slice()?, time.as_slice()?);
    let (position, rotation) = (position.as_slice()?, rotation.as_slice()?);
    let (force, moment) = (force.as_slice()?, moment.as_slice()?);
    let mut beside = Vec::with_capacity(others.len());
    for other in &others {
        beside.push((other.as_slice()?, other.len() / times.max(1)));
    }
    let size = 1 + 34 * stations + 5 + beside.iter().map(|(_, size)| size).sum::<usize>();
    let mut rest = out.as_slice_mut()?;
    let count = rest.len() / (8 * size);
    if rest.len() != 8 * size * count || first + count > times {
        return Err(refused(
            "there must be room for whole records, no more than times",
        ));
    }
    py.detach(|| {
        let mut found = Derived::default();
        for t in first..first + count {
            let vectors = 3 * stations * t..3 * stations * (t + 1);
            let given = Sections {
                sections: &sections,
                position: &position[vectors.clone()],
                rotation: &rotation[9 * stations * t..9 * stations * (t + 1)],
                force: &force[vectors.clone()],
                moment: &moment[vectors],
            };
            stress::derive(given, &mut found);
            let top = first_largest(&found.von_mises);
            for values in [
                &time[t..=t],
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
                &station[top..=top],
                &found.place[3 * top..3 * top + 3],
            ] {
                rest = put(rest, values);
            }
            for (values, size) in &beside {
                rest = put(rest, &values[t * size..(t + 1) * size]);
            }
        }
    });
    Ok(())
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
        // SAFETY: the processor has it
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

fn sections_of(columns: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Section>> {
    if columns.shape()[1] != 10 || columns.shape()[0] == 0 {
        return Err(refused("sections must be rows of ten numbers"));
    }
    let rows = columns.as_slice()?.chunks_exact(10);
    Ok(rows
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
