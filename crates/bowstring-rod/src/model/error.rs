//! Why a robot, a load or a setting was rejected: which argument, which entry, its value and its
//! rule.

use std::fmt;

/// An argument, by its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // each is named by `Argument::words`
pub enum Argument {
    Tension,
    Displacement,
    Gravity,
    TipForce,
    TipMoment,
    DiskForces,
    DiskMoments,
    PointLoads,
    LineForces,
    BaseMotion,
    PayloadMass,
    PayloadCentre,
    PayloadInertia,
    HoleLength,
    Elements,
    Duration,
    TimeStep,
    Tolerance,
    LongestStep,
    SpectralRadius,
    MassDamping,
    MaterialDamping,
    BendingStiffness,
    SectionStiffness,
    PrincipalAngle,
    TorsionStiffness,
    AxialStiffness,
    ShearStiffness,
    MassPerLength,
    RotaryInertia,
    RestCurvature,
    Station,
    Segment,
    ClampedLength,
    FlexibleLength,
    Mass,
    Inertia,
    Hole,
    EndDisk,
    TendonStiffness,
    FreeLength,
    Compliance,
    Friction,
    Pretension,
    Backlash,
    HoleClearance,
    MountCompliance,
    WrapAngle,
}

impl Argument {
    /// Name in Python.
    pub fn name(self) -> &'static str {
        match self {
            Argument::Tension => "tensions",
            Argument::Displacement => "displacements",
            Argument::TimeStep => "dt",
            Argument::TipForce => "tip_force",
            Argument::TipMoment => "tip_moment",
            Argument::DiskForces => "disk_forces",
            Argument::DiskMoments => "disk_moments",
            Argument::PointLoads => "point_loads",
            Argument::LineForces => "line_forces",
            Argument::BaseMotion => "base",
            Argument::LongestStep => "longest_step",
            Argument::SpectralRadius => "spectral_radius",
            Argument::MassDamping => "mass_damping",
            Argument::MaterialDamping => "material_damping",
            Argument::TendonStiffness => "axial_stiffness",
            Argument::FreeLength => "free_length",
            other => other.words(),
        }
    }

    /// Name in a sentence, unit, and what its entries are called.
    fn description(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Argument::Tension => ("tension", "N", "tendon"),
            Argument::Displacement => ("displacement", "m", "tendon"),
            Argument::Gravity => ("gravity", "m/s^2", ""),
            Argument::TipForce => ("tip force", "N", ""),
            Argument::TipMoment => ("tip moment", "N m", ""),
            Argument::DiskForces => ("dead force", "N", "disk"),
            Argument::DiskMoments => ("dead moment", "N m", "disk"),
            Argument::PointLoads => ("point, force or moment", "", "point load"),
            Argument::LineForces => ("force per length", "N/m", "disk"),
            Argument::Elements => ("elements", "", ""),
            Argument::Duration => ("duration", "s", ""),
            Argument::TimeStep => ("time step", "s", ""),
            Argument::Tolerance => ("tolerance", "m", ""),
            Argument::LongestStep => ("longest time step", "s", ""),
            Argument::SpectralRadius => ("spectral radius", "", ""),
            Argument::MassDamping => ("mass damping", "1/s", ""),
            Argument::MaterialDamping => ("material damping", "s", ""),
            Argument::PrincipalAngle => ("angle of the principal axes", "rad", "segment"),
            Argument::SectionStiffness => ("stiffness matrix", "", "segment"),
            Argument::BendingStiffness => ("bending stiffness", "N m^2", "segment"),
            Argument::TorsionStiffness => ("torsion stiffness", "N m^2", "segment"),
            Argument::AxialStiffness => ("axial stiffness", "N", "segment"),
            Argument::ShearStiffness => ("shear stiffness", "N", "segment"),
            Argument::MassPerLength => ("mass per length", "kg/m", "segment"),
            Argument::RotaryInertia => ("rotary inertia", "kg m", "segment"),
            Argument::RestCurvature => ("curvature without load", "1/m", "segment"),
            Argument::Station => ("distance from the base", "m", "disk"),
            Argument::Segment => ("segment", "", "disk"),
            Argument::ClampedLength => ("clamped length", "m", "disk"),
            Argument::BaseMotion => ("motion of the base", "", ""),
            Argument::HoleLength => ("length of the holes", "m", "disk"),
            Argument::PayloadMass => ("mass", "kg", "payload"),
            Argument::PayloadCentre => ("centre of mass", "m", "payload"),
            Argument::PayloadInertia => ("moments of inertia", "kg m^2", "payload"),
            Argument::FlexibleLength => ("flexible length before the disk", "m", "disk"),
            Argument::Mass => ("mass", "kg", "disk"),
            Argument::Inertia => ("moments of inertia", "kg m^2", "disk"),
            Argument::Hole => ("hole position", "m", "tendon"),
            Argument::EndDisk => ("end disk", "", "tendon"),
            Argument::TendonStiffness => ("axial stiffness", "N", "tendon"),
            Argument::FreeLength => ("free length", "m", "tendon"),
            Argument::Compliance => ("compliance of the transmission", "m/N", "tendon"),
            Argument::Friction => ("friction coefficient", "", "tendon"),
            Argument::Pretension => ("pretension", "N", "tendon"),
            Argument::Backlash => ("backlash", "m", "tendon"),
            Argument::HoleClearance => ("hole_clearance", "m", "tendon"),
            Argument::MountCompliance => ("mount_compliance", "m/N", "tendon"),
            Argument::WrapAngle => ("wrap_angle", "rad", "tendon"),
        }
    }

    /// Name in a sentence.
    pub fn words(self) -> &'static str {
        self.description().0
    }

    fn unit(self) -> &'static str {
        self.description().1
    }
}

/// The given value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number in the unit of the argument.
    Number(f64),
    /// Several numbers in the unit of the argument.
    Numbers(Vec<f64>),
    /// An integer.
    Whole(usize),
    /// A count of numbers.
    Count(usize),
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Value::Number(value)
    }
}

impl From<usize> for Value {
    fn from(value: usize) -> Self {
        Value::Whole(value)
    }
}

impl From<&[f64]> for Value {
    fn from(values: &[f64]) -> Self {
        Value::Numbers(values.to_vec())
    }
}

/// Requirement on a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Rule {
    /// A finite number.
    Finite,
    /// Above zero.
    Positive,
    /// Zero or more.
    NotNegative,
    /// Zero or more: a tendon cannot push.
    TendonsPull,
    /// One of these numbers.
    OneOf(&'static [usize]),
    /// Less than a number, with the meaning of that number.
    Below(f64, &'static str),
    /// At least a number, with the reason.
    AtLeast(f64, &'static str),
    /// A count of numbers, one for each of the named things.
    Count(usize, &'static str),
    /// Another requirement, in words after "it must".
    Other(&'static str),
}

/// Why a robot, a load or a setting was rejected.
#[derive(Clone, Debug, PartialEq)]
pub enum InputError {
    /// A value breaks its rule.
    Value {
        /// The argument.
        argument: Argument,
        /// Entry (tendon, disk or segment), from 0; `None` for an argument without entries.
        index: Option<usize>,
        /// The given value.
        value: Value,
        /// The requirement.
        rule: Rule,
    },
    /// A row of several loads is wrong.
    Row {
        /// Index of the row, from 0.
        row: usize,
        /// The error in the row.
        error: Box<InputError>,
    },
    /// Arguments are incompatible, or the request does not fit into memory: a sentence.
    Other(String),
}

impl InputError {
    /// A number, or several, that violates its rule.
    pub fn number(
        argument: Argument,
        index: impl Into<Option<usize>>,
        value: impl Into<Value>,
        rule: Rule,
    ) -> Self {
        InputError::Value {
            argument,
            index: index.into(),
            value: value.into(),
            rule,
        }
    }

    /// Checks that an entry is finite, and positive or non-negative where that is its rule.
    pub fn check_number(
        argument: Argument,
        index: impl Into<Option<usize>>,
        value: f64,
        rule: Rule,
    ) -> Result<(), Self> {
        let kept = match rule {
            Rule::Positive => value > 0.0,
            Rule::NotNegative => value >= 0.0,
            _ => true,
        };
        match kept && value.is_finite() {
            true => Ok(()),
            false => Err(Self::number(argument, index, value, rule)),
        }
    }

    /// Checks that numbers are finite.
    pub fn check_finite(
        argument: Argument,
        index: impl Into<Option<usize>>,
        values: &[f64],
    ) -> Result<(), Self> {
        match values.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(Self::not_finite(argument, index, values)),
        }
    }

    /// Numbers, at least one of which is not finite.
    pub fn not_finite(argument: Argument, index: impl Into<Option<usize>>, values: &[f64]) -> Self {
        Self::number(argument, index, values, Rule::Finite)
    }

    /// A wrong number of entries.
    pub fn count(argument: Argument, given: usize, needed: usize, each: &'static str) -> Self {
        let rule = Rule::Count(needed, each);
        Self::number(argument, None, Value::Count(given), rule)
    }

    /// A number of elements that is not available.
    pub fn elements(n: usize) -> Self {
        Self::number(Argument::Elements, None, n, Rule::OneOf(&[1, 2, 4, 8]))
    }

    /// A sentence of its own.
    pub fn other(sentence: impl Into<String>) -> Self {
        InputError::Other(sentence.into())
    }

    /// The same error, in a row counted from 0.
    pub fn in_row(self, row: usize) -> Self {
        let error = Box::new(self);
        InputError::Row { row, error }
    }

    /// The error without its row.
    pub fn innermost(&self) -> &Self {
        match self {
            InputError::Row { error, .. } => error.innermost(),
            other => other,
        }
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            InputError::Value {
                argument,
                index,
                value,
                rule,
            } => {
                let (words, unit, part) = argument.description();
                f.write_str(words)?;
                if let (Some(index), false) = (index, part.is_empty()) {
                    write!(f, " of {part} {}", index + 1)?;
                }
                let verb = match value {
                    Value::Count(_) => "has",
                    _ => "is",
                };
                write!(f, " {verb} {}, it must {rule}", value.with(unit))
            }
            InputError::Row { row, error } => write!(f, "row {}: {error}", row + 1),
            InputError::Other(sentence) => f.write_str(sentence),
        }
    }
}

impl std::error::Error for InputError {}

impl Value {
    /// Text with its unit.
    fn with(&self, unit: &str) -> String {
        let text = match self {
            Value::Number(x) => Short(*x).to_string(),
            Value::Numbers(v) => format!("{v:?}"),
            Value::Whole(n) => n.to_string(),
            Value::Count(n) => return format!("{n} entries"),
        };
        match unit {
            "" => text,
            unit => format!("{text} {unit}"),
        }
    }
}

/// Parts of an error, for a sentence that is composed elsewhere.
impl InputError {
    /// Argument, index, value with its unit, and rule; `None` where there is only a sentence.
    pub fn parts(&self) -> Option<(&'static str, Option<usize>, String, String)> {
        match self.innermost() {
            InputError::Value {
                argument,
                index,
                value,
                rule,
            } => {
                let rule = rule.to_string();
                let rule = rule.strip_prefix("be ").unwrap_or(&rule);
                Some((
                    argument.name(),
                    *index,
                    value.with(argument.unit()),
                    rule.into(),
                ))
            }
            _ => None,
        }
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Rule::Finite => f.write_str("be finite"),
            Rule::Positive => f.write_str("be positive"),
            Rule::NotNegative => f.write_str("be zero or more"),
            Rule::TendonsPull => f.write_str("be zero or more: a tendon can only pull"),
            Rule::OneOf(numbers) => {
                f.write_str("be ")?;
                for (k, n) in numbers.iter().enumerate() {
                    let before = match k {
                        0 => "",
                        k if k + 1 == numbers.len() => " or ",
                        _ => ", ",
                    };
                    write!(f, "{before}{n}")?;
                }
                Ok(())
            }
            Rule::Below(most, what) => write!(f, "be less than {what}, {} m", Short(*most)),
            Rule::AtLeast(least, why) => write!(f, "be at least {least:.1e}: {why}"),
            Rule::Count(needed, each) => write!(f, "have {needed}, one for each {each}"),
            Rule::Other(words) => f.write_str(words),
        }
    }
}

/// A number for a sentence, short also where it is tiny or huge.
pub struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Short(x) = self;
        if *x == 0.0 || !x.is_finite() || (1e-5..1e16).contains(&x.abs()) {
            write!(f, "{x}")
        } else {
            write!(f, "{x:e}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_counts_from_one_and_has_a_unit() {
        let error = InputError::number(Argument::Tension, 1, -2.0, Rule::TendonsPull);
        assert_eq!(
            error.to_string(),
            "tension of tendon 2 is -2 N, it must be zero or more: a tendon can only pull"
        );
        assert_eq!(error.clone().in_row(3).parts(), error.parts());
        assert!(error.in_row(3).to_string().starts_with("row 4: tension"));
        let (name, index, value, rule) = InputError::elements(3).parts().unwrap();
        assert_eq!((name, index, &*value), ("elements", None, "3"));
        assert_eq!(rule, "1, 2, 4 or 8");
        let few = InputError::count(Argument::Tension, 2, 3, "tendon");
        assert!(few
            .to_string()
            .contains("2 entries, it must have 3, one for each tendon"));
        assert_eq!(InputError::other("no").parts(), None);
    }
}
