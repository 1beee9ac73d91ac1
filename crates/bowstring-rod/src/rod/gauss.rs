//! The two Gauss points of an element.

/// Distance of a Gauss point from the middle of an element, over its length: sqrt(3) / 6.
pub const GAUSS: f64 = 0.288_675_134_594_812_9;
/// Derivatives of the curvature at a Gauss point with respect to the rotation vectors of the nearer
/// and the farther arc of its element, times the element's length: 1 plus and minus sqrt(3)/2.
pub const NEAR: f64 = 1.866_025_403_784_438_6;
pub const FAR: f64 = 0.133_974_596_215_561_36;

/// Fraction of its element at the first of two Gauss points (even) or the second (odd).
pub fn fraction(point: usize) -> f64 {
    if point.is_multiple_of(2) {
        0.5 - GAUSS
    } else {
        0.5 + GAUSS
    }
}
