//! A texture of which only the texels that were looked up are known.

use std::sync::atomic::{AtomicU64, Ordering};

/// Bits of a texel that was not looked up yet; no visibility is such a NaN.
const UNKNOWN: u64 = u64::MAX;

/// Visibility and irradiance of texels, each found when it is first wanted.
///
/// A texel's value does not depend on who finds it, so that frames that do at once need not wait for each other.
#[derive(Debug)]
pub(super) struct Sparse {
    pub(super) size: [u32; 2],
    texels: Vec<AtomicU64>,
}

impl Sparse {
    /// A texture without a known texel.
    pub(super) fn new(size: [u32; 2]) -> Self {
        let count = size[0] as usize * size[1] as usize;
        let texels = (0..count).map(|_| AtomicU64::new(UNKNOWN)).collect();
        Sparse { size, texels }
    }

    fn texel(&self, [x, y]: [u32; 2]) -> &AtomicU64 {
        &self.texels[y as usize * self.size[0] as usize + x as usize]
    }

    /// A texel's visibility and irradiance, if they are known.
    #[inline(always)]
    pub(super) fn get(&self, texel: [u32; 2]) -> Option<[f32; 2]> {
        let bits = self.texel(texel).load(Ordering::Relaxed);
        (bits != UNKNOWN).then(|| [bits as u32, (bits >> 32) as u32].map(f32::from_bits))
    }

    /// Keeps what was found.
    pub(super) fn set(&self, texel: [u32; 2], value: [f32; 2]) {
        let [seen, irradiance] = value.map(|v| u64::from(v.to_bits()));
        self.texel(texel)
            .store(seen | irradiance << 32, Ordering::Relaxed);
    }

    /// Bytes of the texels.
    pub(super) fn bytes(&self) -> usize {
        self.texels.len() * size_of::<AtomicU64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_unknown_until_they_are_set() {
        let texture = Sparse::new([3, 2]);
        assert_eq!(texture.get([2, 1]), None);
        texture.set([2, 1], [0.25, -0.0]);
        texture.set([0, 0], [0.0; 2]);
        assert_eq!(texture.get([2, 1]), Some([0.25, -0.0]));
        assert_eq!(texture.get([0, 0]), Some([0.0; 2]));
        assert_eq!(texture.get([1, 1]), None);
        assert_eq!(texture.bytes(), 48);
    }
}
