//! Random numbers for tests.
#![allow(dead_code)]

/// SplitMix64: the same draws on every platform, each determined by its index.
pub struct Draw(pub u64);

impl Draw {
    pub fn new(test: u64, number: usize) -> Self {
        let mut draw = Draw(test << 32 | number as u64);
        draw.next();
        Draw(draw.next())
    }
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    pub fn within(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Log-uniform: every decade is equally likely.
    pub fn decades(&mut self, from: f64, to: f64) -> f64 {
        self.within(from.ln(), to.ln()).exp()
    }
    pub fn count(&mut self, from: usize, to: usize) -> usize {
        from + (self.next() % (to - from + 1) as u64) as usize
    }
    pub fn often(&mut self, probability: f64) -> bool {
        self.within(0.0, 1.0) < probability
    }
}
