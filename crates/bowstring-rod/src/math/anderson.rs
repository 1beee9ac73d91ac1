//! Anderson acceleration of a fixed-point iteration.
//!
//! Theory: docs/theory/actuation.md (Friction).
//!
//! An iteration `x -> x + f(x)` that neglects part of the derivatives converges linearly.
//! Differences of its steps `f` estimate the neglected part: the residual is minimised over the
//! span of earlier differences (Anderson 1965; Walker and Ni 2011, type II). Differences are kept
//! orthogonal, so that each direction is used once.

/// Points and steps of an iteration so far.
#[derive(Clone, Default)]
pub struct AndersonAcceleration {
    /// The latest point and its plain step; empty at the beginning.
    point: Vec<f64>,
    step: Vec<f64>,
    /// Pairs of differences, oldest first; the first `known` are valid.
    pairs: Vec<Pair>,
    known: usize,
}

/// Change of a step, and the corresponding change of `x + f`.
#[derive(Clone, Default)]
struct Pair {
    change: Vec<f64>,
    motion: Vec<f64>,
    /// Squared norm of the change of the step.
    norm2: f64,
}

/// Most differences kept.
const DEPTH: usize = 4;
/// Least fraction of a difference that is orthogonal to the others.
const LEAST_ORTHOGONAL: f64 = 1e-4;
/// Largest accelerated step over the plain step.
const MAX_LENGTHENING: f64 = 3.0;

impl AndersonAcceleration {
    /// Discards all points.
    pub fn clear(&mut self) {
        self.point.clear();
        self.known = 0;
    }

    /// Replaces the step `f` at `x` by the accelerated step; false where it is kept unchanged.
    pub fn accelerate(&mut self, x: &[f64], f: &mut [f64]) -> bool {
        if self.point.len() == x.len() {
            self.learn(x, f);
        } else {
            self.known = 0;
        }
        self.point.clear();
        self.point.extend_from_slice(x);
        self.step.clear();
        self.step.extend_from_slice(f);
        let plain = dot(f, f);
        for pair in &self.pairs[..self.known] {
            let share = dot(&pair.change, &self.step) / pair.norm2;
            add(f, -share, &pair.motion);
        }
        if dot(f, f) <= MAX_LENGTHENING * MAX_LENGTHENING * plain {
            return self.known > 0;
        }
        f.copy_from_slice(&self.step);
        self.known = 0;
        false
    }

    fn learn(&mut self, x: &[f64], f: &[f64]) {
        if self.known == DEPTH {
            self.pairs.rotate_left(1);
            self.known -= 1;
        } else if self.pairs.len() == self.known {
            self.pairs.push(Pair::default());
        }
        let (before, rest) = self.pairs.split_at_mut(self.known);
        let new = &mut rest[0];
        new.change.clear();
        let changed = f.iter().zip(&self.step).map(|(now, then)| now - then);
        new.change.extend(changed);
        new.motion.clear();
        let moved = x.iter().zip(&self.point).map(|(now, then)| now - then);
        new.motion
            .extend(moved.zip(&new.change).map(|(x, f)| x + f));
        let whole = dot(&new.change, &new.change);
        for pair in before {
            let share = dot(&pair.change, &new.change) / pair.norm2;
            add(&mut new.change, -share, &pair.change);
            add(&mut new.motion, -share, &pair.motion);
        }
        new.norm2 = dot(&new.change, &new.change);
        if new.norm2 > LEAST_ORTHOGONAL * LEAST_ORTHOGONAL * whole {
            self.known += 1;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // four partial sums, for SIMD
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4
        .remainder()
        .iter()
        .zip(b4.remainder())
        .map(|(a, b)| a * b)
        .sum();
    let mut sums = [0.0; 4];
    for (a, b) in a4.zip(b4) {
        for q in 0..4 {
            sums[q] += a[q] * b[q];
        }
    }
    tail + sums.iter().sum::<f64>()
}

fn add(to: &mut [f64], factor: f64, of: &[f64]) {
    for (to, of) in to.iter_mut().zip(of) {
        *to += factor * of;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear iteration with a few slow directions converges with as many differences as there
    /// are slow directions.
    #[test]
    fn few_slow_directions_converge() {
        let (size, slow) = (11, [0.6, -0.5, 0.4]);
        let step_at = |x: &[f64]| -> Vec<f64> {
            let mut f: Vec<_> = x.iter().enumerate().map(|(i, x)| i as f64 - x).collect();
            for (q, factor) in slow.iter().enumerate() {
                // orthogonal directions that involve every component
                let turn = std::f64::consts::PI * (q + 1) as f64 / size as f64;
                let axis: Vec<_> = (0..size).map(|i| ((i as f64 + 0.5) * turn).cos()).collect();
                let along = dot(&axis, x) / dot(&axis, &axis);
                add(&mut f, factor * along, &axis);
            }
            f
        };
        let run = |mixed: bool| {
            let (mut x, mut anderson) = (vec![0.0; size], AndersonAcceleration::default());
            for _ in 0..6 {
                let mut f = step_at(&x);
                if mixed {
                    anderson.accelerate(&x, &mut f);
                }
                add(&mut x, 1.0, &f);
            }
            let left = step_at(&x);
            dot(&left, &left).sqrt()
        };
        assert!(run(false) > 0.1, "{:e}", run(false));
        assert!(run(true) < 1e-12, "{:e}", run(true));
    }

    /// A step that the differences would lengthen too much is kept unchanged.
    #[test]
    fn long_steps_are_not_accelerated() {
        let mut anderson = AndersonAcceleration::default();
        let mut f = [1.0, 0.0];
        assert!(!anderson.accelerate(&[0.0, 0.0], &mut f));
        // the step hardly changes, so the extrapolated limit is far away
        let mut f = [0.999, 0.0];
        assert!(!anderson.accelerate(&[1.0, 0.0], &mut f));
        assert_eq!(f, [0.999, 0.0]);
        anderson.clear();
        let mut f = [1.0, 0.0];
        assert!(!anderson.accelerate(&[0.0, 0.0], &mut f));
        let mut f = [0.5, 0.0];
        assert!(anderson.accelerate(&[1.0, 0.0], &mut f));
        assert!((f[0] - 1.0).abs() < 1e-15, "{f:?}");
    }
}
