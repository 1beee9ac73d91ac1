//! Hysteresis of the backbone: a play operator on the curvature of every module.
//!
//! Theory: docs/theory/actuation.md (Hysteresis of the backbone).

use crate::model::error::InputError;

/// Rate-independent hysteresis of the backbone of one segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hysteresis {
    /// Unloaded curvature over the curvature that the play has followed; zero if elastic.
    pub share: f64,
    /// Half-width of the play (1/m): change of curvature that leaves no set.
    pub play: f64,
}

impl Hysteresis {
    pub(crate) fn check(&self) -> Result<(), InputError> {
        let share = (0.0..1.0).contains(&self.share);
        if !(share && self.play >= 0.0 && self.play.is_finite()) {
            return Err(InputError::other(format!(
                "hysteresis has share {} and play {} 1/m; the share must be >= 0 and < 1, the play finite and >= 0 1/m",
                self.share, self.play
            )));
        }
        Ok(())
    }
}

/// Play in the plane: the point of the disk of radius `play` about `to` that is nearest to `from`.
pub(crate) fn followed(from: [f64; 2], to: [f64; 2], play: f64) -> [f64; 2] {
    let apart = [from[0] - to[0], from[1] - to[1]];
    let distance = apart[0].hypot(apart[1]);
    if distance <= play {
        return from;
    }
    let share = play / distance;
    [to[0] + share * apart[0], to[1] + share * apart[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_play_follows_at_its_half_width() {
        let mut at = [0.0; 2];
        for (to, expected) in [(0.9, 0.0), (3.0, 2.0), (2.5, 2.0), (1.5, 2.0), (-3.0, -2.0)] {
            at = followed(at, [to, 0.0], 1.0);
            assert_eq!(at, [expected, 0.0]);
        }
        // across, the play is the same in every direction
        let turned = followed([0.0; 2], [3.0, 4.0], 1.0);
        assert!((turned[0] - 2.4).abs() < 1e-15 && (turned[1] - 3.2).abs() < 1e-15);
    }

    #[test]
    fn a_law_out_of_range_is_refused() {
        for (share, play) in [(1.0, 1.0), (-0.1, 1.0), (f64::NAN, 1.0), (0.2, f64::NAN)] {
            assert!(Hysteresis { share, play }.check().is_err());
        }
    }
}
