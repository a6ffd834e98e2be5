//! Random numbers for tests (SplitMix64: Steele, Lea and Flood 2014).

use glam::DVec3;

pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [-1, 1).
    pub(crate) fn number(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    pub(crate) fn point(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }

    pub(crate) fn below(&mut self, n: u64) -> i64 {
        (self.bits() % n) as i64
    }

    pub(crate) fn lattice(&mut self, n: u64) -> DVec3 {
        DVec3::new(
            self.below(n) as f64,
            self.below(n) as f64,
            self.below(n) as f64,
        )
    }
}
