//! Sixteen `f32` lanes on whatever the machine has, chosen at run time: what kernels need over the
//! `fearless_simd` crate.
//!
//! A kernel is written once, generic over [`Simd`] with the level's token as an argument, marked
//! `#[inline(always)]`, and called through `dispatch!(detect(), simd => kernel(simd, …))`, which
//! compiles it for every level. Kernels without lanes, left to the compiler's vectoriser, need no
//! token. No operation contracts a multiplication and an addition, so that all levels give the same
//! bits.
//!
//! The environment variable `SOFTSHADOW_SIMD` chooses a lower level by its name in [`levels`].

use std::sync::OnceLock;

pub use fearless_simd::Level;
use fearless_simd::{f32x4, f32x16, f64x8, prelude::*};
use glam::{Vec3, Vec4};

/// Lanes in a vector.
pub const LANES: usize = 16;

/// A value for each lane, aligned for the widest load.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Row(pub [f32; LANES]);

impl Default for Row {
    fn default() -> Self {
        Row([0.0; LANES])
    }
}

impl Row {
    /// Reads it into lanes.
    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self, simd: S) -> f32x16<S> {
        f32x16::load_array_ref(simd, &self.0)
    }

    /// Writes lanes.
    #[inline(always)]
    pub(crate) fn set<S: Simd>(&mut self, lanes: f32x16<S>) {
        lanes.store_array(&mut self.0);
    }
}

/// The variable of the environment with the name of the level to use.
pub const VARIABLE: &str = "SOFTSHADOW_SIMD";

/// Names of the levels that this machine has, the best one last.
///
/// The `fallback` is what every machine of the target has: SSE2 on x86-64, NEON on AArch64.
pub fn levels() -> Vec<(&'static str, Level)> {
    #[allow(unused_mut, reason = "other targets have one level")]
    let mut out = vec![("fallback", Level::baseline())];
    #[cfg(target_arch = "x86_64")]
    {
        let best = Level::new();
        out.extend(best.as_sse4_2().map(|s| ("sse4.2", s.level())));
        out.extend(best.as_avx2().map(|s| ("avx2", s.level())));
        out.extend(best.as_avx512().map(|s| ("avx512", s.level())));
    }
    out
}

/// What [`VARIABLE`] names, or the best level, with its name; the environment is read once.
///
/// # Errors
/// The names to choose from if none of this machine's levels has the one that is set.
pub fn chosen() -> Result<(&'static str, Level), &'static str> {
    static CHOSEN: OnceLock<Result<(&'static str, Level), String>> = OnceLock::new();
    let chosen = CHOSEN.get_or_init(|| {
        let levels = levels();
        let name = std::env::var(VARIABLE).unwrap_or_default();
        let named = levels.iter().find(|level| level.0 == name);
        match (named, name.as_str()) {
            (Some(&level), _) => Ok(level),
            (None, "") => Ok(levels[levels.len() - 1]),
            _ => {
                let names: Vec<_> = levels.iter().map(|level| level.0).collect();
                let names = names.join(", ");
                Err(format!("{VARIABLE} is {name:?}; this machine has {names}"))
            }
        }
    });
    chosen.as_ref().copied().map_err(String::as_str)
}

/// The level that kernels run at: the best one where [`chosen`] is an error.
#[inline]
pub fn detect() -> Level {
    // Kept by itself: kernels ask once a packet, and this is all that they wait for.
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| chosen().map_or_else(|_| Level::new(), |(_, level)| level))
}

/// The whole number next to `x`, as both types; of no more than 31 bits. In two additions, where a conversion of what may
/// be too large or no number keeps a loop from becoming one over registers.
#[inline(always)]
pub(crate) fn whole(x: f64) -> (f64, i32) {
    // From here on the last bit of a number is 1.
    const FIRST: f64 = 1.5 * (1u64 << 52) as f64;
    let shifted = x + FIRST;
    (shifted - FIRST, shifted.to_bits() as i32)
}

/// A vector, the same in all lanes.
#[inline(always)]
pub(crate) fn splat_vector<S: Simd>(simd: S, v: Vec3) -> [f32x16<S>; 3] {
    [
        f32x16::splat(simd, v.x),
        f32x16::splat(simd, v.y),
        f32x16::splat(simd, v.z),
    ]
}

/// A vector for each lane, from its coordinates.
#[inline(always)]
pub(crate) fn load_vector<S: Simd>(simd: S, rows: &[Row; 3]) -> [f32x16<S>; 3] {
    [rows[0].load(simd), rows[1].load(simd), rows[2].load(simd)]
}

/// Scalar products, lane by lane.
#[inline(always)]
pub(crate) fn dot<S: Simd>(a: &[f32x16<S>; 3], b: &[f32x16<S>; 3]) -> f32x16<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Comparisons as one bit a lane, and the smaller and larger value with the same bits on every machine:
/// the crate leaves open what its `min` and `max` do with NaN.
///
/// Comparisons with NaN are false. For up to sixteen lanes.
pub(crate) trait Lanes<S: Simd>: SimdFloat<S, Element = f32> {
    /// Bit `i` set where lane `i` has `self < o`.
    fn lt(self, o: impl SimdInto<Self, S>) -> u16;
    /// Bit `i` set where lane `i` has `self <= o`.
    fn le(self, o: impl SimdInto<Self, S>) -> u16;
    /// Bit `i` set where lane `i` has `self > o`.
    fn gt(self, o: impl SimdInto<Self, S>) -> u16;
    /// Bit `i` set where lane `i` has `self >= o`.
    fn ge(self, o: impl SimdInto<Self, S>) -> u16;
    /// Lane-wise `self < o ? self : o`, thus `o` where either is NaN.
    fn lesser(self, o: impl SimdInto<Self, S>) -> Self;
    /// Lane-wise `self > o ? self : o`, thus `o` where either is NaN.
    fn greater(self, o: impl SimdInto<Self, S>) -> Self;
    /// Lane `i` of `self` where bit `i` is set, of `o` elsewhere.
    fn where_bits(self, bits: u16, o: impl SimdInto<Self, S>) -> Self;
}

impl<S: Simd, V: SimdFloat<S, Element = f32>> Lanes<S> for V {
    #[inline(always)]
    fn lt(self, o: impl SimdInto<Self, S>) -> u16 {
        self.simd_lt(o).to_bitmask() as u16
    }
    #[inline(always)]
    fn le(self, o: impl SimdInto<Self, S>) -> u16 {
        self.simd_le(o).to_bitmask() as u16
    }
    #[inline(always)]
    fn gt(self, o: impl SimdInto<Self, S>) -> u16 {
        self.simd_gt(o).to_bitmask() as u16
    }
    #[inline(always)]
    fn ge(self, o: impl SimdInto<Self, S>) -> u16 {
        self.simd_ge(o).to_bitmask() as u16
    }
    #[inline(always)]
    fn lesser(self, o: impl SimdInto<Self, S>) -> Self {
        // x86 has an instruction for just this, which is the crate's `min` there.
        #[allow(clippy::disallowed_methods, reason = "the same bits on x86")]
        if cfg!(target_arch = "x86_64") {
            return self.min(o);
        }
        let o = o.simd_into(self.token());
        self.simd_lt(o).select(self, o)
    }
    #[inline(always)]
    fn greater(self, o: impl SimdInto<Self, S>) -> Self {
        #[allow(clippy::disallowed_methods, reason = "the same bits on x86")]
        if cfg!(target_arch = "x86_64") {
            return self.max(o);
        }
        let o = o.simd_into(self.token());
        self.simd_gt(o).select(self, o)
    }
    #[inline(always)]
    fn where_bits(self, bits: u16, o: impl SimdInto<Self, S>) -> Self {
        let mask = V::Mask::from_bitmask(self.token(), u64::from(bits));
        mask.select(self, o.simd_into(self.token()))
    }
}

#[inline(always)]
fn from_vec4<S: Simd>(simd: S, v: Vec4) -> f32x4<S> {
    f32x4::load_array(simd, v.to_array())
}

/// Four lanes after four lanes.
#[inline(always)]
pub(crate) fn join<S: Simd>(simd: S, four: [Vec4; 4]) -> f32x16<S> {
    // No closures: the compiler need not inline one, and it would not have the kernel's instruction set.
    let [a, b, c, d] = four;
    let (a, b) = (from_vec4(simd, a), from_vec4(simd, b));
    let (c, d) = (from_vec4(simd, c), from_vec4(simd, d));
    simd.combine_f32x8(simd.combine_f32x4(a, b), simd.combine_f32x4(c, d))
}

/// Lanes 0 to 3 change places with 4 to 7, and 8 to 11 with 12 to 15.
#[inline(always)]
pub(crate) fn swap_fours<S: Simd>(lanes: f32x16<S>) -> f32x16<S> {
    let simd = lanes.simd;
    let (low, high) = simd.split_f32x16(lanes);
    let (a, b) = simd.split_f32x8(low);
    let (c, d) = simd.split_f32x8(high);
    simd.combine_f32x8(simd.combine_f32x4(b, a), simd.combine_f32x4(d, c))
}

/// Bit `i` set where `values[i]` is positive.
#[inline(always)]
pub(crate) fn positive<S: Simd>(simd: S, values: &[f64; 8]) -> u8 {
    f64x8::load_array_ref(simd, values)
        .simd_gt(0.0)
        .to_bitmask() as u8
}

/// Bytes that caches hold together.
#[cfg(target_arch = "x86_64")]
const CACHE_LINE: usize = 64;

/// Asks for an element of a slice, all of its bytes, before it is needed.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    for byte in (0..size_of::<T>()).step_by(CACHE_LINE) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let element = slice.as_ptr().wrapping_add(at).cast::<i8>();
        // SAFETY: it changes nothing and faults at no address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(element.wrapping_add(byte)) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, at);
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;

    /// Values that comparisons, roundings and flushing to zero could take differently.
    const HARD: [f32; 16] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        1e-45,
        -1e-40,
        f32::MAX,
        f32::MIN,
        1.0 + f32::EPSILON,
        3.3,
        1e-23,
    ];

    /// What the operations give for a pair of rows: numbers, and bits of lanes.
    type Found = (Vec<Row>, Vec<u16>);

    #[inline(always)]
    fn operate<S: Simd>(simd: S, a: &Row, b: &Row) -> Found {
        let (x, y) = (a.load(simd), b.load(simd));
        let four = [x, y].map(|v| v.as_array().as_chunks::<4>().0[1].into());
        let numbers = [
            x + y,
            x - y,
            x * y,
            x / y,
            x * y + x,
            x.sqrt(),
            x.abs(),
            x.lesser(y),
            x.greater(y),
            x.lesser(0.0),
            x.where_bits(0x5a3c, y),
            x.simd_lt(y).select(x, y),
            swap_fours(x),
            join(simd, [four[0], four[1], four[1], four[0]]),
        ];
        let mut rows = vec![Row::default(); numbers.len()];
        for (row, number) in rows.iter_mut().zip(numbers) {
            row.set(number);
        }
        let values = |from: usize| std::array::from_fn(|i| f64::from(a.0[from + i]));
        let positive = [positive(simd, &values(0)), positive(simd, &values(8))];
        let positive = u16::from(positive[0]) | u16::from(positive[1]) << 8;
        (rows, vec![x.lt(y), x.le(y), x.gt(y), x.ge(y), positive])
    }

    /// The same results, lane by lane.
    fn expected(a: &Row, b: &Row) -> Found {
        let number =
            |of: &dyn Fn(f32, f32) -> f32| Row(std::array::from_fn(|i| of(a.0[i], b.0[i])));
        let lane = |of: &dyn Fn(usize) -> f32| Row(std::array::from_fn(of));
        let bits = |of: &dyn Fn(f32, f32) -> bool| {
            (0..LANES).fold(0, |m, i| m | u16::from(of(a.0[i], b.0[i])) << i)
        };
        // Hidden, since compilers take a comparison with a plain 0 for a minimum that keeps -0.
        let zero = std::hint::black_box(0.0);
        let sides = [a, b, b, a];
        let numbers = vec![
            number(&|x, y| x + y),
            number(&|x, y| x - y),
            number(&|x, y| x * y),
            number(&|x, y| x / y),
            number(&|x, y| x * y + x),
            number(&|x, _| x.sqrt()),
            number(&|x, _| x.abs()),
            number(&|x, y| if x < y { x } else { y }),
            number(&|x, y| if x > y { x } else { y }),
            number(&|x, _| if x < zero { x } else { zero }),
            lane(&|i| if 0x5a3c >> i & 1 == 1 { a.0[i] } else { b.0[i] }),
            number(&|x, y| if x < y { x } else { y }),
            lane(&|i| a.0[i ^ 4]),
            lane(&|i| sides[i / 4].0[4 + i % 4]),
        ];
        let bits = vec![
            bits(&|x, y| x < y),
            bits(&|x, y| x <= y),
            bits(&|x, y| x > y),
            bits(&|x, y| x >= y),
            bits(&|x, _| x > 0.0),
        ];
        (numbers, bits)
    }

    #[test]
    fn all_levels_do_the_same_with_hard_values() {
        for (name, level) in levels() {
            for turn in 0..LANES {
                let (a, b) = (
                    Row(HARD),
                    Row(std::array::from_fn(|i| HARD[(i + turn) % LANES])),
                );
                let (found, expected) = (
                    dispatch!(level, simd => operate(simd, &a, &b)),
                    expected(&a, &b),
                );
                for (k, (x, y)) in found.0.iter().zip(&expected.0).enumerate() {
                    // Only the sign and the payload of a NaN that an operation makes are the machine's.
                    let bits = |row: &Row| row.0.map(|x| if x.is_nan() { 1 } else { x.to_bits() });
                    assert_eq!(bits(x), bits(y), "{name}, operation {k}, turn {turn}");
                }
                assert_eq!(found.1, expected.1, "{name}, turn {turn}");
            }
        }
    }

    #[test]
    fn the_level_in_use_is_the_one_asked_for_or_the_best() {
        let levels = levels();
        let (name, _) = chosen().unwrap();
        match std::env::var(VARIABLE) {
            Ok(asked) if !asked.is_empty() => assert_eq!(name, asked),
            _ => assert_eq!(name, levels[levels.len() - 1].0),
        }
    }
}
