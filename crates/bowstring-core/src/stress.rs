//! Stress at the surface of a round section.

/// Maximum of `sqrt(sigma^2 + 3 tau^2)` around a section, where `sigma` and `tau` are
/// `a + b cos(psi) + c sin(psi)`, in Pa: the value, and cosine and sine of its place.
///
/// Exact to 1e-12 of the value.
pub fn largest_von_mises(sigma: [f64; 3], tau: [f64; 3]) -> [f64; 3] {
    let ([s0, s1, s2], [t0, t1, t2]) = (sigma, tau);
    // With u = (cos, sin) the square is u.Q u + 2 b.u + const. In the axes of Q, with values
    // q1 >= q2, the maximum lies in the quadrant of b, and is the only stationary point there.
    let half = 0.5 * (s1 * s1 - s2 * s2 + 3.0 * (t1 * t1 - t2 * t2));
    let cross = s1 * s2 + 3.0 * t1 * t2;
    let (b_x, b_y) = (s0 * s1 + 3.0 * t0 * t1, s0 * s2 + 3.0 * t0 * t2);
    let radius = half.hypot(cross);
    // axis of q1: the longer of two equal forms
    let reach = radius + half.abs();
    let (e_x, e_y) = if half < 0.0 {
        (cross, reach)
    } else {
        (reach, cross)
    };
    let norm = e_x.hypot(e_y);
    let (e_x, e_y) = if norm > 0.0 {
        (e_x / norm, e_y / norm)
    } else {
        (1.0, 0.0)
    };
    let (along, across) = (b_x * e_x + b_y * e_y, b_y * e_x - b_x * e_y);
    let (cosine, sine) = quadrant_maximum(2.0 * radius, along.abs(), across.abs());
    let (cosine, sine) = (cosine.copysign(along), sine.copysign(across));
    let (x, y) = (cosine * e_x - sine * e_y, cosine * e_y + sine * e_x);
    let normal = s0 + s1 * x + s2 * y;
    let shear = t0 + t1 * x + t2 * y;
    [(normal * normal + 3.0 * shear * shear).sqrt(), x, y]
}

/// Cosine and sine of the angle in the first quadrant where `gap cos^2 / 2 + a cos + b sin` is
/// largest, all three not negative.
fn quadrant_maximum(gap: f64, a: f64, b: f64) -> (f64, f64) {
    // half the slope falls from b to -a over the quadrant
    let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
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
        // Newton, or the middle where that leaves the bracket
        let mut to = angle + slope / bend;
        if !(to > low && to < high) {
            to = 0.5 * (low + high);
        }
        let step = to - angle;
        angle = to;
        (sine, cosine) = angle.sin_cos();
        // the value is off by the step squared
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
        let (mut best, mut width) = (0.0, std::f64::consts::PI);
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
    fn is_the_largest_around() {
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
            let [value, x, y] = largest_von_mises(sigma, tau);
            let expected = brute(sigma, tau);
            assert!(
                (value - expected).abs() < 1e-12 * expected,
                "{sigma:?} {tau:?}"
            );
            assert!((x.hypot(y) - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn isotropic_and_still_sections() {
        assert_eq!(largest_von_mises([0.0; 3], [0.0; 3])[0], 0.0);
        assert_eq!(largest_von_mises([-5.0, 0.0, 0.0], [0.0; 3])[0], 5.0);
        let [value, ..] = largest_von_mises([0.0; 3], [2.0, 0.0, 0.0]);
        assert!((value - 2.0 * 3f64.sqrt()).abs() < 1e-15);
    }
}
