//! Constants of a module that do not depend on its load: lengths, stiffness and compliance.
//!
//! Theory: docs/theory/rod.md (Energy).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Maybe, Real};
use crate::model::load::{Model, Theory, RIGID_IN_TORSION};
use crate::model::robot::{in_axes, Profile, Robot, Section};
use crate::rod::coupling::Coupling;
use crate::rod::gauss::{self, FAR, NEAR};

/// Stiffness of an element against bending and torsion: moment by rotation (N m), or by curvature
/// (N m^2).
#[derive(Clone, Copy, Debug)]
pub struct Stiffness<T> {
    /// About x and y, and their product.
    pub bending: [T; 3],
    pub torsion: T,
}

impl<T: Real> Stiffness<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        Stiffness {
            bending: [T::zero(); 3],
            torsion: T::zero(),
        }
    }

    #[inline(always)]
    pub fn times(&self, w: Vec3<T>) -> Vec3<T> {
        let [x, y, xy] = self.bending;
        Vec3([
            x.mul_add(w[0], xy * w[1]),
            y.mul_add(w[1], xy * w[0]),
            self.torsion * w[2],
        ])
    }

    /// Product with a matrix.
    #[inline(always)]
    pub fn times_mat(&self, m: Mat3<T>) -> Mat3<T> {
        let [x, y, xy] = self.bending;
        let mut out = m.scale_rows([x, y, self.torsion]);
        for q in 0..3 {
            out.0[0][q] = xy.mul_add(m.0[1][q], out.0[0][q]);
            out.0[1][q] = xy.mul_add(m.0[0][q], out.0[1][q]);
        }
        out
    }

    /// Sum with a matrix.
    #[inline(always)]
    pub fn plus_mat(&self, m: Mat3<T>) -> Mat3<T> {
        let [x, y, xy] = self.bending;
        let mut out = m.add_diagonal([x, y, self.torsion]);
        out.0[0][1] += xy;
        out.0[1][0] += xy;
        out
    }

    // loops, not closures: one that is not inlined is compiled without the processor's SIMD
    // instructions

    /// `self * s + o * t`
    #[inline(always)]
    pub fn combined(&self, s: T, o: &Self, t: T) -> Self {
        let mut out = o.scaled(t);
        for q in 0..3 {
            out.bending[q] = self.bending[q].mul_add(s, out.bending[q]);
        }
        out.torsion = self.torsion.mul_add(s, out.torsion);
        out
    }

    #[inline(always)]
    pub fn scaled(&self, s: T) -> Self {
        let mut out = *self;
        for q in 0..3 {
            out.bending[q] = out.bending[q] * s;
        }
        out.torsion = out.torsion * s;
        out
    }

    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let [x, y, xy] = self.bending;
        let one = T::splat(1.0);
        let per = one / (x * y - xy * xy);
        Stiffness {
            bending: [y * per, x * per, -(xy * per)],
            torsion: one / self.torsion,
        }
    }

    fn set_lane(&mut self, lane: usize, of: &Stiffness<f64>) {
        for q in 0..3 {
            self.bending[q].set_lane(lane, of.bending[q]);
        }
        self.torsion.set_lane(lane, of.torsion);
    }
}

impl Stiffness<f64> {
    /// Moment by curvature of a section (N m^2).
    fn of(section: &Section, model: Model) -> Self {
        let rigid = if model.twist { 1.0 } else { RIGID_IN_TORSION };
        Stiffness {
            bending: in_axes(section.bending, section.principal_angle),
            torsion: section.torsion * rigid,
        }
    }
}

/// Constants of a module that do not depend on its load.
#[derive(Clone, Copy)]
pub struct Constants<T: Real, const A: usize> {
    /// Flexible length (m).
    pub flexible: T,
    /// Inverse of the flexible length (1/m).
    pub per_flexible: T,
    /// Rigid lengths at start and end (m).
    pub clamp: [T; 2],
    /// Distances of the holes from the flexible part, along the axes of both disks (m).
    pub reach: [T; 2],
    /// Mean mass per length rho A (kg/m).
    pub mass_per_length: T,
    /// Second derivative of the elastic energy with respect to the rotation vector of each arc (N
    /// m). Those with respect to both arcs of an element, and the stiffness at its Gauss points,
    /// follow from these; solvers in lanes are slower with more numbers here.
    pub own: [Stiffness<T>; A],
    /// Mean compliance of a section to shear, 1 / GA, and extension, 1 / EA, where the theory has
    /// them (1/N).
    pub compliance: [T; 2],
    /// Rotation vector of each unloaded arc (rad).
    pub rest: [Vec3<T>; A],
    /// Coefficients d0 to d3 (m/N) of the compliance D, theory Eq. 2.5. With a coupled section that of
    /// shear and extension is its own.
    pub d: [T; 4],
    /// Fractions of the flexible length at the ends of the arcs where loads between two disks divide
    /// the module, in scalars only; nothing if they are equally spaced.
    pub ends: T::Maybe<[T; A]>,
    /// Section with coupled strains, in scalars only; the other numbers are then those without
    /// couplings.
    pub coupled: T::Maybe<Coupling<T>>,
}

/// Fractions of a length at the ends of equally long arcs.
fn equal<const A: usize>() -> [f64; A] {
    std::array::from_fn(|a| (a + 1) as f64 / A as f64)
}

impl<T: Real, const A: usize> Constants<T, A> {
    /// Whether there are more than two elements in a module. Such rods are rare and in plain numbers:
    /// their passes are compiled only for sections that may be coupled or tapered.
    pub const FINE: bool = A > 4;
}

impl<const A: usize> Constants<f64, A> {
    pub fn new(robot: &Robot, k: usize, model: Model) -> Self {
        Self::divided(robot, k, model, None)
    }

    /// Constants of a module whose arcs end at these fractions of its flexible length, equally
    /// spaced if none are given.
    pub fn divided(robot: &Robot, k: usize, model: Model, given: Option<[f64; A]>) -> Self {
        let ends = given.unwrap_or_else(equal);
        let elements = A as f64 / 2.0;
        let start = |e: usize| if e == 0 { 0.0 } else { ends[2 * e - 1] };
        let part = |e: usize| (ends[2 * e + 1] - start(e)) * elements;
        let m = robot.modules[k];
        let length = m.flexible;
        let h = length / elements;
        let profile = robot.profile(k);
        let [from, to] = m.part;
        let mean = |of: &dyn Fn(&Section) -> f64| profile.mean(from, to, of);
        let rest = Vec3(profile.sections()[0].rest_curvature);
        let coupled = match profile {
            Profile::Coupled(section) => Some(Coupling::new(section, model, rest, h)),
            _ => None,
        };
        let (shear, axial) = match model.theory {
            _ if coupled.is_some() => (0.0, 0.0),
            Theory::Cosserat => (mean(&|s| 1.0 / s.shear), mean(&|s| 1.0 / s.axial)),
            Theory::Kirchhoff => (0.0, 0.0),
        };
        // d3 of theory Eq. 2.5: a force N bends an element by a quadratic strain that the two arcs
        // lack; its energy is h^3 |s x N|^2 / (1440 EI), s the element's share of the change of
        // tangent
        let flexibility = mean(&|s| 0.5 / s.bending[0] + 0.5 / s.bending[1]);
        let unequal = (0..A / 2).map(|e| part(e).powi(5)).sum::<f64>() / elements;
        let bubble = h.powi(3) * flexibility / (720.0 * elements) * unequal;
        let at_gauss_point = |a: usize| {
            let e = a / 2;
            let fraction = start(e) + part(e) * gauss::fraction(a) / elements;
            Stiffness::of(&robot.section(k, fraction), model).scaled(1.0 / (h * part(e)))
        };
        let own = |a: usize| {
            let [near, far] = [NEAR, FAR].map(|slope| 0.5 * slope * slope);
            at_gauss_point(a).combined(near, &at_gauss_point(a ^ 1), far)
        };
        Constants {
            flexible: length,
            per_flexible: 1.0 / length,
            clamp: m.clamp,
            reach: [m.clamp[0] - m.guides[0], m.clamp[1] - m.guides[1]],
            mass_per_length: robot.mass_per_length(k),
            own: std::array::from_fn(own),
            compliance: [shear, axial],
            rest: std::array::from_fn(|a| rest * (0.5 * h * part(a / 2))),
            coupled: Maybe::new(coupled),
            d: [
                length * shear,
                length * (axial - shear),
                length * (axial - shear) / 12.0 - bubble,
                bubble,
            ],
            ends: Maybe::new(given),
        }
    }
}

impl<T: Real, const A: usize> Constants<T, A> {
    /// Constants of modules in lanes.
    pub fn gather(of: &[&Constants<f64, A>]) -> Self {
        let mut out = Constants {
            flexible: T::zero(),
            per_flexible: T::zero(),
            clamp: [T::zero(); 2],
            reach: [T::zero(); 2],
            mass_per_length: T::zero(),
            own: [Stiffness::zero(); A],
            compliance: [T::zero(); 2],
            rest: [Vec3::zero(); A],
            d: [T::zero(); 4],
            ends: Maybe::new(None),
            coupled: Maybe::new(None),
        };
        for (lane, of) in of.iter().enumerate() {
            out.set_lane(lane, of);
        }
        if T::PLAIN {
            out.ends = Maybe::new(of[0].ends.get().map(|ends| ends.map(T::splat)));
            out.coupled = Maybe::new(of[0].coupled.get().map(|c| c.splat()));
        }
        out
    }

    fn set_lane(&mut self, lane: usize, of: &Constants<f64, A>) {
        self.flexible.set_lane(lane, of.flexible);
        self.per_flexible.set_lane(lane, of.per_flexible);
        self.mass_per_length.set_lane(lane, of.mass_per_length);
        for q in 0..2 {
            self.clamp[q].set_lane(lane, of.clamp[q]);
            self.reach[q].set_lane(lane, of.reach[q]);
            self.compliance[q].set_lane(lane, of.compliance[q]);
        }
        for q in 0..4 {
            self.d[q].set_lane(lane, of.d[q]);
        }
        for a in 0..A {
            self.own[a].set_lane(lane, &of.own[a]);
            for q in 0..3 {
                self.rest[a].0[q].set_lane(lane, of.rest[a][q]);
            }
        }
    }

    /// Length of an element over the mean of the module.
    #[inline(always)]
    pub fn part(&self, element: usize) -> T {
        if A == 2 || !T::PLAIN {
            return T::splat(1.0);
        }
        let Some(ends) = self.ends.get() else {
            return T::splat(1.0);
        };
        let end = ends[2 * element + 1];
        let length = match element {
            0 => end,
            _ => end - ends[2 * element - 1],
        };
        length * T::splat(A as f64 / 2.0)
    }

    /// Length of an arc (m).
    #[inline(always)]
    pub fn arc_length(&self, arc: usize) -> T {
        let mean = self.flexible * T::splat(1.0 / A as f64);
        if A == 2 {
            return mean;
        }
        mean * self.part(arc / 2)
    }

    /// Distance from the start of the flexible part at a fraction of an element (m).
    #[inline(always)]
    pub fn within(&self, element: usize, fraction: f64) -> T {
        let length = self.arc_length(2 * element) * T::splat(2.0 * fraction);
        self.fraction(2 * element).mul_add(self.flexible, length)
    }

    /// Fraction of the flexible part that lies before this many arcs.
    #[inline(always)]
    pub fn fraction(&self, arcs: usize) -> T {
        match self.ends.get() {
            Some(ends) if A > 2 && arcs > 0 => ends[arcs - 1],
            _ => T::splat(arcs as f64 / A as f64),
        }
    }

    /// Fraction of the end's displacement due to shear and extension, at the end of an arc.
    #[inline(always)]
    pub fn share(&self, arc: usize) -> T {
        self.fraction(arc + 1)
    }

    /// Whether its arcs end at these fractions of the flexible length.
    pub fn ends_at(&self, ends: Option<[f64; A]>) -> bool {
        let own = self.ends.get().map(|own| own.map(|end| end.lane(0)));
        own.unwrap_or_else(equal) == ends.unwrap_or_else(equal)
    }

    /// Whether its arcs end where those of another module do.
    pub fn divided_as(&self, other: &Self) -> bool {
        self.ends_at(other.ends.get().map(|ends| ends.map(|end| end.lane(0))))
    }

    /// Number of arcs before a fraction of the flexible part; lanes have equal elements.
    pub fn arcs_before(&self, fraction: f64) -> f64 {
        let Some(ends) = self.ends.get() else {
            return fraction * A as f64;
        };
        let ends = ends.map(|end| end.lane(0));
        let e = (0..A / 2 - 1).find(|e| fraction <= ends[2 * e + 1]);
        let e = e.unwrap_or(A / 2 - 1);
        let start = if e == 0 { 0.0 } else { ends[2 * e - 1] };
        2.0 * (e as f64 + (fraction - start) / (ends[2 * e + 1] - start))
    }

    /// Longest element over the mean of the module.
    pub fn longest_part(&self) -> T {
        let mut longest = T::zero();
        for e in 0..A / 2 {
            longest = longest.max(self.part(e));
        }
        longest
    }

    /// Length that the end of this many arcs stands for by Simpson's rule over each element, in
    /// thirds of a mean arc.
    #[inline(always)]
    pub fn simpson(&self, arcs: usize) -> T {
        if arcs % 2 == 1 {
            return self.part(arcs / 2) * T::splat(4.0);
        }
        let mut sum = T::zero();
        if arcs > 0 {
            sum += self.part(arcs / 2 - 1);
        }
        if arcs < A {
            sum += self.part(arcs / 2);
        }
        sum
    }

    /// Weight of the node before an element, over that of a mean element.
    #[inline(always)]
    pub fn node_weight(&self, element: usize) -> T {
        (self.part(element - 1) + self.part(element)) * T::splat(0.5)
    }

    /// Loads on the module (`State::f`) by a force per length on its backbone and a force on its end
    /// disk. Hermite's rule: half of the force on an element at each end, and a couple.
    #[inline(always)]
    pub fn lumped(&self, line: Vec3<T>, force: Vec3<T>) -> [Vec3<T>; 4] {
        let half = T::splat(0.5);
        let (flexible, [start, end]) = (self.flexible, self.clamp);
        let element = flexible * T::splat(2.0 / A as f64);
        let [first, last] = [element * self.part(0), element * self.part(A / 2 - 1)];
        let [at_start, at_end] = [first, last].map(|length| length * length / T::splat(12.0));
        [
            force + line * (last * half + end),
            force * end + line * (end * end * half - at_end),
            force * start + line * (start * (start * half + flexible + end) + at_start),
            line * element,
        ]
    }

    /// Curvature and twist without load of an element, linear in the distance from the start of the
    /// flexible part: there (1/m), and their change by this distance (1/m^2).
    #[inline(always)]
    pub fn rest_line(&self, e: usize) -> [Vec3<T>; 2] {
        let [a, b] = [self.rest[2 * e], self.rest[2 * e + 1]];
        let per = T::splat(0.5) / self.arc_length(2 * e);
        let change = (b - a) * (T::splat(3.0) * per * per);
        let middle = self.within(e, 0.5);
        [change.scaled_add(-middle, (a + b) * per), change]
    }

    /// Largest bending flexibility times length of an element (1/(N m)).
    #[inline(always)]
    pub fn largest_flexibility(&self) -> T {
        let mut largest = T::zero();
        for e in 0..A / 2 {
            let [first, second] = self.at_gauss_points(e);
            let ([a, b, _], [c, d, _]) = (first.inverse().bending, second.inverse().bending);
            largest = largest.max(a).max(b).max(c).max(d);
        }
        largest
    }

    /// Stiffness over the length of an element (N m), at its Gauss points.
    #[inline(always)]
    pub fn at_gauss_points(&self, e: usize) -> [Stiffness<T>; 2] {
        let (a, b) = (&self.own[2 * e], &self.own[2 * e + 1]);
        let (near, far) = (NEAR * NEAR, FAR * FAR);
        let per = 2.0 / (near * near - far * far);
        let (near, far) = (T::splat(per * near), T::splat(-per * far));
        [a.combined(near, b, far), b.combined(near, a, far)]
    }

    /// Second derivative of the elastic energy with respect to both arcs of an element (N m).
    #[inline(always)]
    pub fn mutual(&self, e: usize) -> Stiffness<T> {
        let share = T::splat(NEAR * FAR / (NEAR * NEAR + FAR * FAR));
        self.own[2 * e].combined(share, &self.own[2 * e + 1], share)
    }

    /// Scales the stiffness, but not the moment of the unloaded strain.
    #[inline(always)]
    pub fn stiffen(&mut self, elastic: &Self, factor: f64) {
        for a in 0..A {
            self.own[a] = elastic.own[a].scaled(T::splat(factor));
            self.rest[a] = elastic.rest[a] * T::splat(1.0 / factor);
        }
        if let (Some(own), Some(of)) = (self.coupled.get_mut(), elastic.coupled.get()) {
            own.stiffen(of, factor);
        }
    }

    /// Derivatives of the bending energy (theory Eq. 2.4) with respect to each arc's rotation
    /// vector.
    #[inline(always)]
    pub fn elastic_moments(&self, w: &[Vec3<T>; A]) -> [Vec3<T>; A] {
        self.moments_beyond(&self.rest, w)
    }

    /// The same for a change of strain.
    #[inline(always)]
    pub fn bending_moments(&self, w: &[Vec3<T>; A]) -> [Vec3<T>; A] {
        self.moments_beyond(&[Vec3::zero(); A], w)
    }

    /// Moments of elements whose arcs are unloaded with the rotation vectors `rest`.
    #[inline(always)]
    fn moments_beyond(&self, rest: &[Vec3<T>; A], w: &[Vec3<T>; A]) -> [Vec3<T>; A] {
        let mut g = [Vec3::zero(); A];
        for e in 0..A / 2 {
            let i = 2 * e;
            let beyond = [w[i] - rest[i], w[i + 1] - rest[i + 1]];
            let pair = self.moments_of_element(e, beyond);
            (g[i], g[i + 1]) = (pair[0], pair[1]);
        }
        g
    }

    /// Coupled section of the module.
    #[inline(always)]
    pub fn coupling(&self) -> Option<&Coupling<T>> {
        self.coupled.get()
    }

    /// Moments of an element by the elastic rotation vectors of its arcs.
    #[inline(always)]
    pub fn moments_of_element(&self, e: usize, [a, b]: [Vec3<T>; 2]) -> [Vec3<T>; 2] {
        if T::PLAIN {
            if let Some(coupling) = self.coupling() {
                return coupling.moments_of_element(self.part(e), [a, b]);
            }
        }
        let i = 2 * e;
        let mutual = self.mutual(e);
        [
            self.own[i].times(a) + mutual.times(b),
            self.own[i + 1].times(b) + mutual.times(a),
        ]
    }
}

/// Course of a tapered backbone along a module, at five places at equal distances.
#[derive(Clone, Copy, Debug)]
pub struct Taper<T> {
    /// Moment by curvature (N m^2).
    stiffness: [Stiffness<T>; 5],
    /// Shear and axial compliance (1/N); zero where the theory has none.
    shear: [T; 5],
    axial: [T; 5],
    /// Change of the mass per length (kg/m): coefficients `a` and `b` of `a x + b (x^2 - 1/12)`,
    /// `x` the distance from the middle of the module over its length.
    pub mass: [T; 2],
    /// Couples on the tangents of start and end for each m/s^2 (kg m): what the clamps weigh more
    /// than by the mean of the module acts beside their disks.
    pub clamps: [T; 2],
}

impl Taper<f64> {
    pub fn new(robot: &Robot, k: usize, model: Model) -> Self {
        let sections: [Section; 5] = std::array::from_fn(|i| robot.section(k, i as f64 / 4.0));
        let (mut shear, mut axial) = ([0.0; 5], [0.0; 5]);
        if model.theory == Theory::Cosserat {
            shear = sections.map(|s| 1.0 / s.shear);
            axial = sections.map(|s| 1.0 / s.axial);
        }
        // with the same first and second moment; Boole's rule is exact for them
        let [a, b, c, d, e] = sections.map(|s| s.mass_per_length);
        let [[_, start], [_, end]] = robot.clamp_excess(k);
        let first = 3.5 * (e - a) + 8.0 * (d - b);
        let second = 7.0 * (a + e) / 6.0 - 32.0 * (b + d) / 48.0 - c;
        Taper {
            stiffness: sections.map(|s| Stiffness::of(&s, model)),
            shear,
            axial,
            mass: [12.0 / 90.0 * first, 180.0 / 90.0 * second],
            clamps: [start, -end],
        }
    }
}

impl<T: Real> Taper<T> {
    /// Tapers of modules in lanes.
    pub fn gather(of: &[&Taper<f64>]) -> Self {
        let mut out = Taper {
            stiffness: [Stiffness::zero(); 5],
            shear: [T::zero(); 5],
            axial: [T::zero(); 5],
            mass: [T::zero(); 2],
            clamps: [T::zero(); 2],
        };
        for (lane, of) in of.iter().enumerate() {
            for p in 0..5 {
                out.stiffness[p].set_lane(lane, &of.stiffness[p]);
                out.shear[p].set_lane(lane, of.shear[p]);
                out.axial[p].set_lane(lane, of.axial[p]);
            }
            for q in 0..2 {
                out.mass[q].set_lane(lane, of.mass[q]);
                out.clamps[q].set_lane(lane, of.clamps[q]);
            }
        }
        out
    }

    /// What the change of the weight along a tapered module adds to the force on its end (N), and to
    /// the couples on the tangents of its start and its end (N m), by Hermite's rule.
    #[inline(always)]
    pub fn lumped(&self, flexible: T, gravity: Vec3<T>) -> (Vec3<T>, [Vec3<T>; 2]) {
        let line = gravity * (self.mass[0] * flexible);
        let parabola = gravity * (self.mass[1] * flexible);
        let turn = line * (flexible * T::splat(-1.0 / 120.0));
        let bend = parabola * (flexible * T::splat(1.0 / 360.0));
        (line * T::splat(0.1), [turn - bend, turn + bend])
    }

    /// Stiffness, shear and axial compliance at a fraction of the module.
    #[inline(always)]
    pub fn at(&self, fraction: T) -> (Stiffness<T>, T, T) {
        let mut stiffness = Stiffness::zero();
        let (mut shear, mut axial) = (T::zero(), T::zero());
        let place = fraction * T::splat(4.0);
        for i in 0..5 {
            // Lagrange's polynomial of the place
            let mut weight = T::splat(1.0);
            for j in (0..5).filter(|&j| j != i) {
                weight =
                    weight * (place - T::splat(j as f64)) * T::splat(1.0 / (i as f64 - j as f64));
            }
            stiffness = self.stiffness[i].combined(weight, &stiffness, T::splat(1.0));
            shear = self.shear[i].mul_add(weight, shear);
            axial = self.axial[i].mul_add(weight, axial);
        }
        (stiffness, shear, axial)
    }
}
