//! Routing of the tendons: their holes at both ends of each module.
//!
//! Theory: docs/theory/rod.md (Tendons).

use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::model::load::TendonPath;
use crate::model::robot::Robot;
use crate::rod::constants::Constants;

/// Holes of a tendon at both ends of a module, or of several side by side: x and y in the frames of
/// the disks (m).
#[derive(Clone, Copy, Debug)]
pub struct Holes<T> {
    pub start: [T; 2],
    pub end: [T; 2],
}

impl<T: Real> Holes<T> {
    /// Place in the cross-section of a continuous tendon, at a distance from the start of the
    /// flexible part (m), and its derivative along the backbone: a straight line from hole to hole.
    #[inline(always)]
    pub fn between<const A: usize>(&self, c: &Constants<T, A>, at: T) -> (Vec3<T>, Vec3<T>) {
        let slope = self.slope(c);
        let [x, y] = self.start;
        let start = Vec3([x, y, T::zero()]);
        (slope.scaled_add(at + c.clamp[0], start), slope)
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

/// The tendons of a rod.
#[derive(Clone, Debug)]
pub struct Routes<M> {
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
            TendonPath::Continuous => T::zero(),
        }
    }

    /// Takes the numbers of the robots: one for each lane of the chain, the last one also in the
    /// lanes beyond.
    pub fn set<L: Layout<Module = M>>(&mut self, robots: &[Robot]) {
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
                };
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
