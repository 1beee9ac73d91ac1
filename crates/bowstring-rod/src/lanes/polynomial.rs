//! Strain as a polynomial of the load: where many loads start.
//!
//! Theory: docs/theory/statics.md (Globalisation).

use crate::math::real::Real;
use crate::model::load::Load;

/// Number of a load that varies.
#[derive(Clone, Copy, Debug)]
pub enum Number {
    Tension(usize),
    Gravity(usize),
    TipForce(usize),
    DiskForce(usize, usize),
}

impl Number {
    fn of(self, load: &Load) -> f64 {
        match self {
            Number::Tension(i) => load.tensions[i],
            Number::Gravity(q) => load.gravity[q],
            Number::TipForce(q) => load.tip_force[q],
            Number::DiskForce(k, q) => load.disk_forces[k][q],
        }
    }
}

/// A number of the load, scaled to -1 to 1.
#[derive(Clone, Copy, Debug)]
pub struct Input {
    pub number: Number,
    pub middle: f64,
    pub per_unit: f64,
}

/// A product of Chebyshev polynomials of the inputs: that of an earlier term and one more input.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    earlier: usize,
    input: usize,
    degree: usize,
}

/// Chebyshev polynomials up to a total degree.
#[derive(Clone, Debug)]
pub struct Basis {
    inputs: Vec<Input>,
    /// Terms after the constant one.
    pub terms: Vec<Term>,
}

impl Basis {
    pub fn new(inputs: &[Input], degree: usize) -> Self {
        let mut terms = vec![];
        // total degree and last input of each term, the constant one included
        let mut all = vec![(0, None)];
        let mut earlier = 0;
        while earlier < all.len() {
            let (total, last): (usize, Option<usize>) = all[earlier];
            for input in last.map_or(0, |last| last + 1)..inputs.len() {
                for degree in 1..=degree - total {
                    terms.push(Term {
                        earlier,
                        input,
                        degree,
                    });
                    all.push((total + degree, Some(input)));
                }
            }
            earlier += 1;
        }
        Basis {
            inputs: inputs.to_vec(),
            terms,
        }
    }

    /// Number of terms of a total degree.
    pub fn size(inputs: usize, degree: usize) -> usize {
        (1..=degree).fold(1, |size, k| size * (inputs + k) / k)
    }

    /// Values of the terms under a load in every lane; the last load also in the lanes beyond.
    #[inline(always)]
    pub fn evaluate<T: Real>(&self, loads: &[Load], values: &mut Values<T>) {
        values.inputs.clear();
        for input in &self.inputs {
            values.inputs.push(T::from_fn(
                #[inline(always)]
                |lane| {
                    let load = &loads[lane.min(loads.len() - 1)];
                    (input.number.of(load) - input.middle) * input.per_unit
                },
            ));
        }
        let terms = &mut values.terms;
        terms.clear();
        terms.push(T::splat(1.0));
        for (i, term) in self.terms.iter().enumerate() {
            let x = values.inputs[term.input];
            // the terms of an input and an earlier term follow each other by degree
            terms.push(match term.degree {
                1 => terms[term.earlier] * x,
                2 => (x + x) * terms[i] - terms[term.earlier],
                _ => (x + x) * terms[i] - terms[i - 1],
            });
        }
    }
}

/// Scratch memory of an evaluation.
#[derive(Clone, Debug)]
pub struct Values<T> {
    inputs: Vec<T>,
    pub terms: Vec<T>,
}

impl<T> Values<T> {
    pub fn empty() -> Self {
        Values {
            inputs: vec![],
            terms: vec![],
        }
    }
}

/// Strain as a polynomial of the load.
#[derive(Clone, Debug)]
pub struct StartPolynomial {
    pub basis: Basis,
    /// By components of the strain, then by terms.
    pub coefficients: Vec<f64>,
}

impl StartPolynomial {
    /// Hands over each component of the strain under a load in every lane; the last load also in
    /// the lanes beyond.
    #[inline(always)]
    pub fn evaluate<T: Real>(
        &self,
        loads: &[Load],
        values: &mut Values<T>,
        mut set: impl FnMut(usize, T),
    ) {
        self.basis.evaluate(loads, values);
        let terms = &values.terms;
        for (at, of) in self.coefficients.chunks_exact(terms.len()).enumerate() {
            // two sums, which the processor adds to at once
            let mut sum = [T::zero(); 2];
            for (factors, terms) in of.chunks(2).zip(terms.chunks(2)) {
                for (q, (factor, term)) in factors.iter().zip(terms).enumerate() {
                    sum[q] = term.mul_add(T::splat(*factor), sum[q]);
                }
            }
            set(at, sum[0] + sum[1]);
        }
    }
}
