//! Strain of a round section, and stress at its surface.
//!
//! Theory: docs/theory/stress.md.

use crate::interrupt;
use crate::math::series::small_arc_tangent;
use crate::math::vectorize;
use std::f64::consts::{FRAC_PI_2, PI};

/// Constants of a section for strain and stress; SI units.
#[derive(Clone, Copy, Debug)]
pub struct Section {
    /// Outer radius (m).
    pub radius: f64,
    /// Area (m^2).
    pub area: f64,
    /// Section modulus (m^3): second moment of area over the radius.
    pub modulus: f64,
    /// Largest shear stress over transverse force, k/A of theory Eq. 6.1 (1/m^2).
    pub shear: f64,
    /// Compliance in bending: curvature over moment about x and y, and twist over torsion (1/(N
    /// m^2)).
    pub bending_compliance: [f64; 3],
    /// Compliance to force: shear over transverse force along x and y, and extension over axial
    /// force (1/N).
    pub force_compliance: [f64; 3],
}

impl Section {
    /// A ring, or a full circle with inner radius zero (m), for stress alone: it has no compliance.
    pub fn ring(outer: f64, inner: f64) -> Self {
        let (square, bore) = (outer * outer, inner * inner);
        let area = PI * (square - bore);
        // the parabolic law at the neutral axis: 4/3 for a solid rod, 2 for a thin tube
        let factor = 4.0 / 3.0 * (square + outer * inner + bore) / (square + bore);
        Section {
            radius: outer,
            area,
            modulus: 0.25 * area * (square + bore) / outer,
            shear: factor / area,
            bending_compliance: [0.0; 3],
            force_compliance: [0.0; 3],
        }
    }

    /// Normal and shear stress around the surface by force and moment in body axes, theory Eq. 6.1:
    /// the coefficients of `a + b cos(psi) + c sin(psi)` (Pa).
    #[inline(always)]
    pub fn stress(&self, force: [f64; 3], moment: [f64; 3]) -> [[f64; 3]; 2] {
        let ([fx, fy, fz], [mx, my, mz]) = (force, moment);
        let sigma = [fz / self.area, -my / self.modulus, mx / self.modulus];
        let tau = [mz / (2.0 * self.modulus), fy * self.shear, -fx * self.shear];
        [sigma, tau]
    }
}

/// Input of [`derive()`]: sections along the backbone at one time after the other; vectors flat.
#[derive(Clone, Copy, Debug)]
pub struct Sections<'a> {
    /// Sections from base to tip.
    pub sections: &'a [Section],
    /// Positions (m).
    pub position: &'a [f64],
    /// Rotations from body to base, row by row.
    pub rotation: &'a [f64],
    /// Internal forces in body axes (N).
    pub force: &'a [f64],
    /// Internal moments in body axes (N m).
    pub moment: &'a [f64],
}

/// Strain and stress of sections, SI; vectors flat.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Curvatures about x and y, and twist (rad/m).
    pub curvature: Vec<f64>,
    /// Shear along x and y, and extension.
    pub strain: Vec<f64>,
    /// Mean normal stress (Pa).
    pub axial: Vec<f64>,
    /// Largest normal stress due to bending at the surface (Pa).
    pub bending: Vec<f64>,
    /// Largest normal stress at the surface (Pa).
    pub normal: Vec<f64>,
    /// Largest shear stress due to transverse force at the surface (Pa).
    pub shear: Vec<f64>,
    /// Shear stress due to torsion at the surface (Pa).
    pub torsion: Vec<f64>,
    /// Largest von Mises stress around the surface (Pa).
    pub von_mises: Vec<f64>,
    /// Angle of the point of largest von Mises stress, from x towards y (rad).
    pub angle: Vec<f64>,
    /// Position of the point of largest von Mises stress, base frame (m).
    pub place: Vec<f64>,
}

impl Derived {
    /// All arrays, with the count of numbers for each section.
    fn arrays(&mut self) -> [(&mut Vec<f64>, usize); 10] {
        [
            (&mut self.curvature, 3),
            (&mut self.strain, 3),
            (&mut self.axial, 1),
            (&mut self.bending, 1),
            (&mut self.normal, 1),
            (&mut self.shear, 1),
            (&mut self.torsion, 1),
            (&mut self.von_mises, 1),
            (&mut self.angle, 1),
            (&mut self.place, 3),
        ]
    }
}

/// Sections between two polls for an interruption.
const BLOCK: usize = 1 << 15;

/// [`derive()`] at many times, in blocks between which it can be interrupted.
pub fn derive_all(given: Sections) -> Derived {
    let total = given.force.len() / 3;
    // whole times, so that each begins with the first section
    let size = BLOCK.div_ceil(given.sections.len()) * given.sections.len();
    let (mut found, mut block) = (Derived::default(), Derived::default());
    for start in (0..total).step_by(size) {
        if interrupt::work(8 * size) {
            break;
        }
        let end = total.min(start + size);
        let part = Sections {
            sections: given.sections,
            position: &given.position[3 * start..3 * end],
            rotation: &given.rotation[9 * start..9 * end],
            force: &given.force[3 * start..3 * end],
            moment: &given.moment[3 * start..3 * end],
        };
        derive(part, &mut block);
        for ((to, size), (from, _)) in found.arrays().into_iter().zip(block.arrays()) {
            if to.capacity() == 0 {
                to.reserve_exact(size * total);
            }
            to.extend_from_slice(from);
        }
    }
    found
}

/// Coefficients of normal and shear stress around sections (Pa), (2, 3, K) flat, from force (N) and
/// moment (N m) in body axes, (K, 3) flat; the sections repeat at every time.
pub fn surface_stress(sections: &[Section], force: &[f64], moment: &[f64]) -> Vec<f64> {
    let total = force.len() / 3;
    let mut out = vec![0.0; 6 * total];
    for i in 0..total {
        if interrupt::work(8) {
            break;
        }
        let three = |v: &[f64]| [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
        let found = sections[i % sections.len()].stress(three(force), three(moment));
        for (q, v) in found.as_flattened().iter().enumerate() {
            out[q * total + i] = *v;
        }
    }
    out
}

/// Largest von Mises stress around each of K sections (Pa) with cosine and sine of its angle, (3,
/// K) flat, from coefficients of normal and shear stress (Pa), (3, K) flat.
pub fn von_mises(sigma: &[f64], tau: &[f64]) -> Vec<f64> {
    let total = sigma.len() / 3;
    let mut out = vec![0.0; 3 * total];
    for start in (0..total).step_by(WIDTH) {
        if interrupt::work(8 * WIDTH) {
            break;
        }
        let count = WIDTH.min(total - start);
        let gather = |from: &[f64]| {
            [0, 1, 2].map(|q| {
                let mut lanes = [0.0; WIDTH];
                lanes[..count].copy_from_slice(&from[q * total + start..][..count]);
                lanes
            })
        };
        let found = largest_side_by_side(&gather(sigma), &gather(tau), count);
        for (q, row) in found.iter().enumerate() {
            out[q * total + start..][..count].copy_from_slice(&row[..count]);
        }
    }
    out
}

/// Largest von Mises stress around each section (Pa), from force (N) and moment (N m) in body axes,
/// (K, 3) flat.
pub fn largest_von_mises(sections: &[Section], force: &[f64], moment: &[f64]) -> Vec<f64> {
    let stress = surface_stress(sections, force, moment);
    let total = force.len() / 3;
    let (sigma, tau) = stress.split_at(3 * total);
    let mut found = von_mises(sigma, tau);
    found.truncate(total);
    found
}

/// Sections computed side by side.
const WIDTH: usize = 16;
type Lanes = [f64; WIDTH];

/// Strain and stress of all sections; replaces the contents of `out`.
pub fn derive(given: Sections, out: &mut Derived) {
    vectorize(
        #[inline(always)]
        || derive_here(given, out),
    );
}

#[inline(always)]
fn derive_here(given: Sections, out: &mut Derived) {
    let (stations, total) = (given.sections.len(), given.force.len() / 3);
    for (values, size) in out.arrays() {
        values.resize(size * total, 0.0);
    }
    let mut station = 0;
    for start in (0..total).step_by(WIDTH) {
        let count = WIDTH.min(total - start);
        let (mut sigma, mut tau) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3]);
        let mut radius = [0.0; WIDTH];
        for i in 0..count {
            let section = &given.sections[station];
            station = if station + 1 == stations {
                0
            } else {
                station + 1
            };
            let at = 3 * (start + i);
            let force = &given.force[at..at + 3];
            let moment = &given.moment[at..at + 3];
            let (strain, curvature) = (&mut out.strain[at..at + 3], &mut out.curvature[at..at + 3]);
            for q in 0..3 {
                strain[q] = force[q] * section.force_compliance[q];
                curvature[q] = moment[q] * section.bending_compliance[q];
            }
            let [normal, shear] = section.stress(
                [force[0], force[1], force[2]],
                [moment[0], moment[1], moment[2]],
            );
            for q in 0..3 {
                sigma[q][i] = normal[q];
                tau[q][i] = shear[q];
            }
            radius[i] = section.radius;
        }
        let [value, cosine, sine] = largest_side_by_side(&sigma, &tau, count);
        let (mut bending, mut normal, mut shear) = ([0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]);
        let mut torsion = [0.0; WIDTH];
        for i in 0..WIDTH {
            bending[i] = (sigma[1][i] * sigma[1][i] + sigma[2][i] * sigma[2][i]).sqrt();
            normal[i] = bending[i] + sigma[0][i].abs();
            shear[i] = (tau[1][i] * tau[1][i] + tau[2][i] * tau[2][i]).sqrt();
            torsion[i] = tau[0][i].abs();
        }
        for (to, from) in [
            (&mut out.axial, &sigma[0]),
            (&mut out.bending, &bending),
            (&mut out.normal, &normal),
            (&mut out.shear, &shear),
            (&mut out.torsion, &torsion),
            (&mut out.von_mises, &value),
        ] {
            to[start..start + count].copy_from_slice(&from[..count]);
        }
        let angle = angles_side_by_side(&cosine, &sine);
        out.angle[start..start + count].copy_from_slice(&angle[..count]);
        for i in 0..count {
            let (x, y) = (radius[i] * cosine[i], radius[i] * sine[i]);
            let at = 3 * (start + i);
            let position = &given.position[at..at + 3];
            let rotation = &given.rotation[3 * at..3 * at + 9];
            let place = &mut out.place[at..at + 3];
            for q in 0..3 {
                place[q] = position[q] + rotation[3 * q] * x + rotation[3 * q + 1] * y;
            }
        }
    }
}

/// Maximum of `sqrt(sigma^2 + 3 tau^2)` (theory Eq. 6.2) around each of the first `count` sections,
/// where `sigma` and `tau` are `a + b cos(psi) + c sin(psi)` in Pa: the value, and cosine and sine
/// of its angle. Newton steps run side by side for all sections; those that do not converge are
/// solved one by one.
///
/// Accurate to 1e-12 of the value.
#[inline(always)]
fn largest_side_by_side(sigma: &[Lanes; 3], tau: &[Lanes; 3], count: usize) -> [Lanes; 3] {
    let zero = [0.0; WIDTH];
    let (mut e_x, mut e_y) = (zero, zero);
    let (mut along, mut across, mut gap) = (zero, zero, zero);
    let (mut cosine, mut sine) = (zero, zero);
    // With u = (cos, sin) the square is u.Q u + 2 b.u + const. In the axes of Q, with eigenvalues
    // q1 >= q2, the maximum lies in the quadrant of b and is the only stationary point there.
    for i in 0..WIDTH {
        let [s0, s1, s2] = [sigma[0][i], sigma[1][i], sigma[2][i]];
        let [t0, t1, t2] = [tau[0][i], tau[1][i], tau[2][i]];
        let half = 0.5 * (s1 * s1 - s2 * s2 + 3.0 * (t1 * t1 - t2 * t2));
        let cross = s1 * s2 + 3.0 * t1 * t2;
        let (b_x, b_y) = (s0 * s1 + 3.0 * t0 * t1, s0 * s2 + 3.0 * t0 * t2);
        let radius = (half * half + cross * cross).sqrt();
        // axis of q1: the longer of two equivalent forms
        let reach = radius + half.abs();
        let alike = reach * reach < f64::MIN_POSITIVE;
        let x = if half < 0.0 { cross } else { reach };
        let x = if alike { 1.0 } else { x };
        let y = if half < 0.0 { reach } else { cross };
        let per = 1.0 / (x * x + y * y).sqrt();
        (e_x[i], e_y[i]) = (x * per, y * per);
        along[i] = b_x * e_x[i] + b_y * e_y[i];
        across[i] = b_y * e_x[i] - b_x * e_y[i];
        gap[i] = 2.0 * radius;
        let (x, y) = (gap[i] + along[i].abs(), across[i].abs());
        let per = 1.0 / (x * x + y * y).sqrt();
        (cosine[i], sine[i]) = (x * per, y * per);
    }
    // Newton's method of `quadrant_maximum`, by a rotation of the unit vector
    let mut settled = [false; WIDTH];
    for _ in 0..6 {
        for i in 0..WIDTH {
            let (a, b) = (along[i].abs(), across[i].abs());
            let (c, s) = (cosine[i], sine[i]);
            let slope = c * (b - gap[i] * s) - a * s;
            let bend = gap[i] * (c * c - s * s) + a * c + b * s;
            let turn = slope / bend;
            // a unit vector up to second order in the rotation
            let (x, y) = (c - s * turn, s + c * turn);
            let per = 1.5 - 0.5 * (x * x + y * y);
            let (to_c, to_s) = (x * per, y * per);
            // keep converged sections, or a section's stress would depend on its neighbours
            (cosine[i], sine[i]) = if settled[i] { (c, s) } else { (to_c, to_s) };
            settled[i] |= turn.abs() < 1e-8 && bend > 0.0 && to_c >= 0.0 && to_s >= 0.0;
        }
        if settled == [true; WIDTH] {
            break;
        }
    }
    for i in 0..count {
        if !settled[i] {
            (cosine[i], sine[i]) = quadrant_maximum(gap[i], along[i].abs(), across[i].abs());
        }
    }
    let mut out = [zero; 3];
    for i in 0..WIDTH {
        let per = 1.0 / (cosine[i] * cosine[i] + sine[i] * sine[i]).sqrt();
        let (c, s) = (cosine[i] * per, sine[i] * per);
        let (c, s) = (c.copysign(along[i]), s.copysign(across[i]));
        let (x, y) = (c * e_x[i] - s * e_y[i], c * e_y[i] + s * e_x[i]);
        let normal = sigma[0][i] + sigma[1][i] * x + sigma[2][i] * y;
        let shear = tau[0][i] + tau[1][i] * x + tau[2][i] * y;
        out[0][i] = (normal * normal + 3.0 * shear * shear).sqrt();
        (out[1][i], out[2][i]) = (x, y);
    }
    out
}

/// Arc tangents in all four quadrants.
#[inline(always)]
fn angles_side_by_side(cosine: &Lanes, sine: &Lanes) -> Lanes {
    let mut out = [0.0; WIDTH];
    for i in 0..WIDTH {
        let (x, y) = (cosine[i].abs(), sine[i].abs());
        let mut tangent = x.min(y) / x.max(y);
        // of a quarter of the angle, where the series is short
        for _ in 0..2 {
            tangent /= 1.0 + (1.0 + tangent * tangent).sqrt();
        }
        let octant = 4.0 * small_arc_tangent(tangent);
        let quadrant = if y > x { FRAC_PI_2 - octant } else { octant };
        let half = if cosine[i] < 0.0 {
            PI - quadrant
        } else {
            quadrant
        };
        out[i] = half.copysign(sine[i]);
    }
    out
}

/// Cosine and sine of the angle in the first quadrant that maximises `gap cos^2 / 2 + a cos + b
/// sin`; none of the three coefficients is negative.
fn quadrant_maximum(gap: f64, a: f64, b: f64) -> (f64, f64) {
    // half the slope falls from b to -a over the quadrant
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    let mut angle = b.atan2(gap + a);
    let (mut sine, mut cosine) = angle.sin_cos();
    for _ in 0..60 {
        let slope = cosine * (b - gap * sine) - a * sine;
        if slope > 0.0 {
            low = angle;
        } else {
            high = angle;
        }
        let bend = gap * (cosine * cosine - sine * sine) + a * cosine + b * sine;
        // Newton, or bisection where that leaves the bracket
        let mut to = angle + slope / bend;
        if !(to > low && to < high) {
            to = 0.5 * (low + high);
        }
        let step = to - angle;
        angle = to;
        (sine, cosine) = angle.sin_cos();
        // the error of the value is the step squared
        if step.abs() < 1e-8 {
            break;
        }
    }
    (cosine, sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brute(sigma: [f64; 3], tau: [f64; 3]) -> f64 {
        let square = |psi: f64| {
            let at = |v: [f64; 3]| v[0] + v[1] * psi.cos() + v[2] * psi.sin();
            at(sigma).powi(2) + 3.0 * at(tau).powi(2)
        };
        let (mut best, mut width) = (0.0, PI);
        let mut top = 0.0f64;
        for round in 0..12 {
            let (centre, count) = (best, if round == 0 { 2000 } else { 40 });
            for i in 0..=count {
                let psi = centre + width * (2.0 * i as f64 / count as f64 - 1.0);
                if square(psi) > top {
                    (top, best) = (square(psi), psi);
                }
            }
            width = if round == 0 { 4e-3 } else { 0.1 * width };
        }
        top.sqrt()
    }

    #[test]
    fn maximum_around_the_surface() {
        let mut state = 1u64;
        let mut next = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        for round in 0..3000 {
            let mut draw = || [next(), next(), next()];
            let (mut sigma, mut tau) = (draw(), draw());
            match round % 6 {
                1 => tau = [0.0; 3],
                2 => sigma = [sigma[0], 0.0, 0.0],
                3 => sigma[0] = 0.0,
                4 => tau = tau.map(|t| 1e-9 * t),
                5 => (sigma[0], tau[0]) = (0.0, 1e-12),
                _ => {}
            }
            let expected = brute(sigma, tau);
            let found = von_mises(&sigma, &tau);
            let off = (found[0] - expected).abs();
            assert!(off < 1e-12 * expected, "{sigma:?} {tau:?}");
            assert!((found[1].hypot(found[2]) - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn angles_match_atan2() {
        for i in 0..=4000 {
            let angle = PI * (f64::from(i) / 2000.0 - 1.0);
            let (sine, cosine) = angle.sin_cos();
            for scale in [1.0, 1e-9] {
                // near the axes, too
                let [x, y] = [[cosine, scale * sine], [scale * cosine, sine]][i as usize % 2];
                let found = angles_side_by_side(&[x; WIDTH], &[y; WIDTH])[0];
                assert!(
                    (found - y.atan2(x)).abs() <= 1e-15 * (1.0 + found.abs()),
                    "{x} {y}"
                );
            }
        }
        for (x, y) in [
            (1.0, 0.0),
            (1.0, -0.0),
            (-1.0, 0.0),
            (-1.0, -0.0),
            (0.0, 1.0),
            (0.0, -1.0),
        ] {
            let found = angles_side_by_side(&[x; WIDTH], &[y; WIDTH])[0];
            assert_eq!(found.to_bits(), f64::atan2(y, x).to_bits(), "{x} {y}");
        }
    }

    /// Stress of a section does not depend on the other sections.
    #[test]
    fn sections_are_independent() {
        let section = |radius: f64| Section {
            radius,
            area: 2.0,
            modulus: 3.0 * radius,
            shear: 0.7,
            bending_compliance: [0.1, 0.2, 0.3],
            force_compliance: [1e-3, 2e-3, 3e-3],
        };
        let sections = [section(0.5), section(0.25), section(1.0)];
        let (times, stations) = (7, sections.len());
        let numbers = |size: usize, seed: f64| -> Vec<f64> {
            let each = (0..times * stations * size).map(|i| (seed * (i + 1) as f64).sin());
            each.collect()
        };
        let (position, rotation) = (numbers(3, 1.0), numbers(9, 1.7));
        let (force, mut moment) = (numbers(3, 2.3), numbers(3, 0.9));
        moment[30..36].fill(0.0);
        let given = Sections {
            sections: &sections,
            position: &position,
            rotation: &rotation,
            force: &force,
            moment: &moment,
        };
        let (mut whole, mut one) = (Derived::default(), Derived::default());
        derive(given, &mut whole);
        for i in 0..times * stations {
            let station = i % stations;
            let alone = Sections {
                sections: &sections[station..=station],
                position: &position[3 * i..3 * i + 3],
                rotation: &rotation[9 * i..9 * i + 9],
                force: &force[3 * i..3 * i + 3],
                moment: &moment[3 * i..3 * i + 3],
            };
            derive(alone, &mut one);
            assert_eq!(one.von_mises[0], whole.von_mises[i]);
            assert_eq!(one.angle[0], whole.angle[i]);
            assert_eq!(one.place[..], whole.place[3 * i..3 * i + 3]);
            assert_eq!(one.strain[..], whole.strain[3 * i..3 * i + 3]);
            let three = |v: &[f64]| [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
            let [sigma, tau] = sections[station].stress(three(&force), three(&moment));
            let found = von_mises(&sigma, &tau);
            let (value, x, y) = (found[0], found[1], found[2]);
            assert!((one.von_mises[0] - value).abs() < 1e-14 * value);
            let radius = sections[station].radius;
            for q in 0..3 {
                let turn = &alone.rotation[3 * q..];
                let place = alone.position[q] + radius * (turn[0] * x + turn[1] * y);
                assert!((one.place[q] - place).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn isotropic_and_unloaded_sections() {
        assert_eq!(von_mises(&[0.0; 3], &[0.0; 3]), [0.0, 1.0, 0.0]);
        assert_eq!(von_mises(&[-5.0, 0.0, 0.0], &[0.0; 3])[0], 5.0);
        let value = von_mises(&[0.0; 3], &[2.0, 0.0, 0.0])[0];
        assert!((value - 2.0 * 3f64.sqrt()).abs() < 1e-15);
    }
}
