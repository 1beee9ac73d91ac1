//! Section of the backbone with coupled strains, by its full stiffness matrix.
//!
//! Theory: docs/theory/rod.md (Coupled sections).

use crate::math::linalg::Mat3;
use crate::model::error::{Argument, InputError, Rule};
use crate::model::section::Section;

/// Section whose strains are coupled.
///
/// Strains and their order: curvature about x and y, twist, shear along x and y, extension; moments
/// and forces on the section in the same order, in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoupledSection {
    /// Moments and forces by strains (N m^2, N m, N).
    stiffness: [[f64; 6]; 6],
    /// Mass, unloaded curvature, and stiffness without couplings, for scales.
    section: Section,
}

/// Stiffness in the form that the solver uses: with the change of curvature `e` and the force `n`,
/// the moment is `moment e - shift' n`, and shear and extension are `shift e + compliance n`.
#[derive(Clone, Copy, Debug)]
pub struct Mixed {
    /// Moment by curvature and twist at constant force (N m^2).
    pub moment: Mat3,
    /// Shear and extension by curvature and twist at constant force (m).
    pub shift: Mat3,
    /// Shear and extension by force at constant curvature (1/N).
    pub compliance: Mat3,
}

/// Relative difference up to which a stiffness matrix counts as symmetric.
const SYMMETRY: f64 = 1e-9;
/// Least pivot of a positive definite stiffness matrix, relative to its diagonal.
const LEAST_PIVOT: f64 = 1e-12;

impl CoupledSection {
    /// From stiffness, mass and rotary inertia per length, and unloaded curvature.
    pub fn new(
        stiffness: [[f64; 6]; 6],
        [mass_per_length, rotary_inertia]: [f64; 2],
        rest_curvature: [f64; 3],
    ) -> Self {
        let mut coupled = CoupledSection {
            stiffness,
            section: Section {
                bending: [0.0; 2],
                principal_angle: 0.0,
                torsion: 0.0,
                axial: 0.0,
                shear: 0.0,
                mass_per_length,
                rotary_inertia,
                rest_curvature,
            },
        };
        let Mixed {
            moment,
            shift,
            compliance,
        } = coupled.mixed(true);
        // strains by one moment or force alone
        let bent = moment.inverse();
        let pulled = compliance + shift * bent * shift.transpose();
        let (flexibility, angle) = principal_values(&bent);
        let section = &mut coupled.section;
        section.bending = flexibility.map(|x| 1.0 / x);
        section.principal_angle = angle;
        section.torsion = 1.0 / bent.0[2][2];
        section.shear = 2.0 / (pulled.0[0][0] + pulled.0[1][1]);
        section.axial = 1.0 / pulled.0[2][2];
        coupled
    }

    /// Multiplies all stiffnesses by a factor.
    pub fn scale(&mut self, factor: f64) {
        let section = &self.section;
        let mass = [section.mass_per_length, section.rotary_inertia];
        let stiffness = self.stiffness.map(|row| row.map(|x| x * factor));
        *self = CoupledSection::new(stiffness, mass, section.rest_curvature);
    }

    /// The section without couplings, for scales.
    pub fn without_couplings(&self) -> &Section {
        &self.section
    }

    /// Place in the section (m) through which an axial force neither bends it about x nor about y.
    pub fn tension_centre(&self) -> [f64; 2] {
        let Mixed { moment, shift, .. } = self.mixed(true);
        let (bent, along) = (moment.inverse().0, shift.0[2]);
        // a force N at (x, y) has the moment N (y, -x) and bends by `bent` as N (y, -x, 0) + N along
        let twisted = [bent[0][2], bent[1][2]].map(|b| b * along[2]);
        let [[a, b], [c, d]] = [[bent[0][0], bent[0][1]], [bent[1][0], bent[1][1]]];
        let det = a * d - b * c;
        let y = -along[0] - (d * twisted[0] - b * twisted[1]) / det;
        let x = along[1] + (a * twisted[1] - c * twisted[0]) / det;
        [x, y]
    }

    /// The plain section where there are no couplings except between the two curvatures, and the
    /// shear stiffnesses are equal.
    pub fn plain(&self) -> Option<Section> {
        let k = &self.stiffness;
        let alone = |i: usize, j: usize| i == j || (i < 2 && j < 2) || k[i][j] == 0.0;
        let plain = (0..6).all(|i| (0..6).all(|j| alone(i, j)));
        if !plain || k[3][3] != k[4][4] || k[0][1] != k[1][0] {
            return None;
        }
        let [bending, _, _] = self.blocks();
        let (bending, principal_angle) = principal_values(&bending);
        Some(Section {
            bending,
            principal_angle,
            torsion: k[2][2],
            axial: k[5][5],
            shear: k[3][3],
            ..self.section
        })
    }

    /// Stiffness against curvature and twist (N m^2), against both kinds of strain, curvature by rows
    /// (N m), and against shear and extension (N).
    fn blocks(&self) -> [Mat3; 3] {
        let k = &self.stiffness;
        [(0, 0), (0, 3), (3, 3)].map(|(row, column)| {
            Mat3(std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let (i, j) = (row + i, column + j);
                    0.5 * (k[i][j] + k[j][i])
                })
            }))
        })
    }

    /// The mixed form; without shear and extension if not `extensible`.
    pub fn mixed(&self, extensible: bool) -> Mixed {
        let [moment, coupling, force] = self.blocks();
        if !extensible {
            return Mixed {
                moment,
                shift: Mat3::zero(),
                compliance: Mat3::zero(),
            };
        }
        let compliance = force.inverse().symmetric_part();
        let shift = -(compliance * coupling.transpose());
        Mixed {
            moment: (moment + coupling * shift).symmetric_part(),
            shift,
            compliance,
        }
    }

    /// Refuses a section of a segment that no material has.
    pub fn check(&self, segment: usize) -> Result<(), InputError> {
        let refuse = |rule| {
            let given = self.stiffness.as_flattened();
            let argument = Argument::SectionStiffness;
            Err(InputError::number(argument, segment, given, rule))
        };
        let k = &self.stiffness;
        if !k.as_flattened().iter().all(|x| x.is_finite()) {
            return refuse(Rule::Finite);
        }
        for i in 0..6 {
            for j in 0..i {
                let size = (k[i][i] * k[j][j]).abs().sqrt();
                if (k[i][j] - k[j][i]).abs() > SYMMETRY * size {
                    return refuse(Rule::Other("be symmetric"));
                }
            }
        }
        if !is_positive_definite(k) {
            return refuse(Rule::Other("be positive definite"));
        }
        Ok(())
    }
}

/// By Cholesky's factors.
fn is_positive_definite(m: &[[f64; 6]; 6]) -> bool {
    let mut factor = [[0.0; 6]; 6];
    for j in 0..6 {
        for i in j..6 {
            let done: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let rest = m[i][j] - done;
            if i > j {
                factor[i][j] = rest / factor[j][j];
            } else if rest > LEAST_PIVOT * m[j][j] {
                factor[j][j] = rest.sqrt();
            } else {
                return false;
            }
        }
    }
    true
}

/// Principal values of a symmetric matrix in x and y, and the angle of the first axis from x.
fn principal_values(m: &Mat3) -> ([f64; 2], f64) {
    let [x, y, xy] = [m.0[0][0], m.0[1][1], m.0[0][1]];
    if xy == 0.0 {
        return ([x, y], 0.0);
    }
    let (mean, half) = (0.5 * (x + y), 0.5 * (x - y));
    let radius = half.hypot(xy);
    ([mean + radius, mean - radius], 0.5 * xy.atan2(half))
}
