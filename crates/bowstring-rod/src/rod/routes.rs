//! Routing of the tendons: their holes at both ends of each module.
//!
//! Theory: docs/theory/rod.md (Tendons).

use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Maybe, Real};
use crate::model::load::TendonPath;
use crate::model::robot::Robot;
use crate::rod::constants::Constants;

/// Most holes that give the slope of an embedded tendon at one of them.
const STENCIL: usize = 5;

/// Holes of a tendon at both ends of a module, or of several side by side: x and y in the frames of
/// the disks (m).
#[derive(Clone)]
pub struct Holes<T: Real> {
    pub start: [T; 2],
    pub end: [T; 2],
    /// Derivatives along the backbone at both ends beyond those of a straight line, of an embedded
    /// tendon: it is a cubic, in scalars only.
    pub curve: T::Maybe<[[T; 2]; 2]>,
}

impl<T: Real> Holes<T> {
    /// Place in the cross-section of a continuous tendon, at a distance from the start of the
    /// flexible part (m), and its derivative along the backbone.
    #[inline(always)]
    pub fn between<const A: usize>(&self, c: &Constants<T, A>, at: T) -> (Vec3<T>, Vec3<T>) {
        let mut slope = self.slope(c);
        let [x, y] = self.start;
        let start = Vec3([x, y, T::zero()]);
        let from_start = at + c.clamp[0];
        let mut place = slope.scaled_add(from_start, start);
        if let Some(curve) = self.curve.get() {
            let length = c.clamp[0] + c.flexible + c.clamp[1];
            let (one, t) = (T::splat(1.0), from_start / length);
            let rest = one - t;
            let [a, b] = [t * rest * rest * length, t * t * rest * length];
            let three = T::splat(3.0);
            let [da, db] = [rest * (one - three * t), t * (T::splat(2.0) - three * t)];
            for q in 0..2 {
                place.0[q] += a * curve[0][q] - b * curve[1][q];
                slope.0[q] += da * curve[0][q] - db * curve[1][q];
            }
        }
        (place, slope)
    }

    /// Change of the hole over the length of the module.
    #[inline(always)]
    fn slope<const A: usize>(&self, c: &Constants<T, A>) -> Vec3<T> {
        let per_length = T::splat(1.0) / (c.clamp[0] + c.flexible + c.clamp[1]);
        let by = |q: usize| (self.end[q] - self.start[q]) * per_length;
        Vec3([by(0), by(1), T::zero()])
    }

    /// Length of a continuous tendon beside both clamped parts (m).
    #[inline(always)]
    pub fn beside_clamps<const A: usize>(&self, c: &Constants<T, A>) -> T {
        let mut along = self.slope(c);
        along.0[2] = T::splat(1.0);
        (c.clamp[0] + c.clamp[1]) * along.norm()
    }
}

/// The tendons of the robot and their tensions in one module, zero where they do not pass, and the
/// loads between its disks.
#[derive(Clone, Copy)]
pub struct Tendons<'a, T: Real> {
    pub holes: &'a [Holes<T>],
    pub tensions: &'a [T],
    pub path: TendonPath,
    /// Forces of loads between the disks on the nodes before the elements (N), in the frame of the
    /// module's start; empty if there are none.
    pub on_nodes: &'a [Vec3<T>],
}

impl<T: Real> Tendons<'_, T> {
    /// Whether they are continuous, which lanes do not take.
    #[inline(always)]
    pub fn are_continuous(&self) -> bool {
        T::PLAIN && self.path.is_continuous()
    }
}

/// The tendons of a rod.
#[derive(Clone)]
pub struct Routes<M: Real> {
    /// Holes by groups of modules and tendons; beyond an end disk they do not count.
    holes: Vec<Holes<M>>,
    pub end_disks: Vec<usize>,
    /// Lengths of the tendons in the holes of their disks (m), by robots and tendons.
    in_holes: Vec<f64>,
}

impl<M: Real> Routes<M> {
    pub fn empty() -> Self {
        Routes {
            holes: vec![],
            end_disks: vec![],
            in_holes: vec![],
        }
    }

    /// Number of tendons.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.end_disks.len()
    }

    /// Holes of all tendons in a group of modules.
    #[inline(always)]
    pub fn in_group(&self, group: usize) -> &[Holes<M>] {
        let count = self.len();
        &self.holes[group * count..][..count]
    }

    /// Length of a tendon in the holes of its disks (m), to the middle of its end disk; zero for a
    /// continuous tendon, whose length includes it.
    #[inline(always)]
    pub fn length_in_holes<T: Real>(&self, tendon: usize, path: TendonPath) -> T {
        match path {
            TendonPath::Straight => T::from_fn(|lane| {
                let last = self.in_holes.len() / self.len() - 1;
                self.in_holes[lane.min(last) * self.len() + tendon]
            }),
            TendonPath::Continuous | TendonPath::Embedded => T::zero(),
        }
    }

    /// Takes the numbers of the robots: one for each lane of the chain, the last one also in the
    /// lanes beyond.
    pub fn set<L: Layout<Module = M>>(&mut self, robots: &[Robot], path: TendonPath) {
        let first = &robots[0];
        let (n, tendons) = (first.module_count(), &first.spec().tendons);
        self.end_disks.clear();
        self.end_disks.extend(tendons.iter().map(|t| t.end_disk));
        self.in_holes.clear();
        for robot in robots {
            let lengths = (0..tendons.len()).map(|i| robot.length_in_holes(i));
            self.in_holes.extend(lengths);
        }
        self.holes.clear();
        for g in 0..n.div_ceil(L::WIDTH) {
            for i in 0..tendons.len() {
                let mut holes = Holes {
                    start: [M::zero(); 2],
                    end: [M::zero(); 2],
                    curve: Maybe::new(None),
                };
                if path == TendonPath::Embedded && M::PLAIN {
                    let curve = curve(&robots[0], i, g);
                    holes.curve = Maybe::new(Some(curve.map(|end| end.map(M::splat))));
                }
                for lane in 0..M::LANES {
                    // modules side by side belong to one robot; idle lanes repeat the last
                    let (robot, k) = match L::WIDTH {
                        1 => (lane.min(robots.len() - 1), g),
                        width => (0, (g * width + lane).min(n - 1)),
                    };
                    let tendon = &robots[robot].spec().tendons[i];
                    let (start, end) = (tendon.hole(k), tendon.hole(k + 1));
                    for q in 0..2 {
                        holes.start[q].set_lane(lane, start[q]);
                        holes.end[q].set_lane(lane, end[q]);
                    }
                }
                self.holes.push(holes);
            }
        }
    }
}

/// The tendons in one group of modules.
#[inline(always)]
pub fn in_group<'a, M: Real>(
    tendons: &'a Routes<M>,
    tensions: &'a [M],
    path: TendonPath,
    group: usize,
) -> Tendons<'a, M> {
    let count = tendons.len();
    Tendons {
        holes: tendons.in_group(group),
        tensions: &tensions[group * count..(group + 1) * count],
        path,
        on_nodes: &[],
    }
}

/// Derivatives of an embedded tendon along the backbone at both ends of a module beyond those of a
/// straight line: of the polynomials through the nearest holes in its segment.
fn curve(robot: &Robot, tendon: usize, module: usize) -> [[f64; 2]; 2] {
    let (disks, tendon) = (&robot.spec().disks, &robot.spec().tendons[tendon]);
    if module > tendon.end_disk {
        return [[0.0; 2]; 2];
    }
    let segment = disks[module].segment;
    let same = |k: &usize| disks[*k].segment == segment;
    let first = (0..module).rev().take_while(same).last().unwrap_or(module);
    let last = (module..=tendon.end_disk).take_while(same).last();
    let count = last.unwrap_or(module) + 2 - first;
    let station = |p: usize| if p == 0 { 0.0 } else { disks[p - 1].station };
    let used = count.min(STENCIL);
    let derivative = |p: usize| {
        let start = p
            .saturating_sub(used / 2)
            .clamp(first, first + count - used);
        let nodes: Vec<f64> = (start..start + used).map(station).collect();
        let weights = derivative_at(&nodes, p - start);
        [0, 1].map(|q| {
            let holes = (start..start + used).map(|p| tendon.hole(p)[q]);
            weights.iter().zip(holes).map(|(w, hole)| w * hole).sum()
        })
    };
    let length = station(module + 1) - station(module);
    let [a, b] = [module, module + 1].map(|p| tendon.hole(p));
    let straight = [0, 1].map(|q| (b[q] - a[q]) / length);
    [module, module + 1].map(|p| {
        let slope: [f64; 2] = derivative(p);
        [0, 1].map(|q| slope[q] - straight[q])
    })
}

/// Weights of values at `nodes` in the derivative at one of them of the polynomial through them.
fn derivative_at(nodes: &[f64], at: usize) -> Vec<f64> {
    let others = |i: usize| (0..nodes.len()).filter(move |j| *j != i);
    let weight = |i: usize| -> f64 {
        if i == at {
            return others(i).map(|j| 1.0 / (nodes[at] - nodes[j])).sum();
        }
        let factor = |j: usize| (nodes[at] - nodes[j]) / (nodes[i] - nodes[j]);
        let product: f64 = others(i).filter(|j| *j != at).map(factor).product();
        product / (nodes[i] - nodes[at])
    };
    (0..nodes.len()).map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_polynomials_are_exact() {
        let nodes: [f64; 5] = [0.0, 0.3, 0.5, 1.1, 1.2];
        let value = |x: f64| 2.0 - x + 3.0 * x.powi(3) - 0.5 * x.powi(4);
        for (at, x) in nodes.iter().enumerate() {
            let weights = derivative_at(&nodes, at);
            let found: f64 = weights.iter().zip(nodes).map(|(w, x)| w * value(x)).sum();
            let exact = -1.0 + 9.0 * x * x - 2.0 * x.powi(3);
            assert!((found - exact).abs() < 1e-13, "{found} {exact}");
        }
    }
}
