//! Sixteen `f32` lanes on whatever the machine has, chosen at run time.
//!
//! A kernel is written once, generic over [`Lanes`], marked `#[inline(always)]`, and called through
//! `dispatch!`, which wraps it in functions compiled for AVX-512, AVX2 and the baseline. No
//! operation contracts a multiplication and an addition, so that all three give the same bits.

use std::sync::OnceLock;

use glam::Vec4;

/// Lanes in a vector.
pub const LANES: usize = 16;

/// One value a lane, aligned for the widest load.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Row(pub [f32; LANES]);

impl Default for Row {
    fn default() -> Self {
        Row([0.0; LANES])
    }
}

/// Instruction set that kernels run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The baseline of the target.
    Portable,
    /// AVX2, and the bit operations of the machines that have it (POPCNT, BMI1, BMI2).
    Avx2,
    /// That, and AVX-512 (F, DQ, BW, VL).
    Avx512,
}

/// Returns the best level that this machine has.
pub fn detect() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("popcnt")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2");
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
            {
                return Level::Avx512;
            }
            if avx2 {
                return Level::Avx2;
            }
        }
        Level::Portable
    })
}

/// Sixteen `f32` lanes; comparisons return one bit a lane.
///
/// Comparisons with NaN are false. `min` and `max` return the second operand when either is NaN, on
/// every level.
///
/// # Safety
/// Every method may only be called where the features of the implementing type are enabled, which
/// `dispatch!` sees to.
pub trait Lanes: Copy {
    /// All lanes equal.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn splat(x: f32) -> Self;
    /// Loads a row.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn load(row: &Row) -> Self;
    /// Four lanes after four lanes.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn join(four: [Vec4; 4]) -> Self;
    /// Lanes 0 to 3 change places with 4 to 7, and 8 to 11 with 12 to 15.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn swap_fours(self) -> Self;
    /// Stores a row.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn store(self, row: &mut Row);
    /// `self + o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn add(self, o: Self) -> Self;
    /// `self - o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn sub(self, o: Self) -> Self;
    /// `self * o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn mul(self, o: Self) -> Self;
    /// `self / o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn div(self, o: Self) -> Self;
    /// Square root.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn sqrt(self) -> Self;
    /// Lane-wise `self < o ? self : o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn min(self, o: Self) -> Self;
    /// Lane-wise `self > o ? self : o`
    ///
    /// # Safety
    /// See the trait.
    unsafe fn max(self, o: Self) -> Self;
    /// Bit `i` set where lane `i` has `self < o`.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn lt(self, o: Self) -> u16;
    /// Bit `i` set where lane `i` has `self <= o`.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn le(self, o: Self) -> u16;
    /// Lane `i` of `self` where bit `i` of `mask` is set, of `o` elsewhere.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn select(self, mask: u16, o: Self) -> Self;
    /// Bit `i` set where `values[i]` is positive.
    ///
    /// # Safety
    /// See the trait.
    unsafe fn positive(values: &[f64; 8]) -> u8;

    /// Absolute value.
    ///
    /// # Safety
    /// See the trait.
    #[inline(always)]
    unsafe fn abs(self) -> Self {
        // SAFETY: the caller enabled the features.
        unsafe { self.max(Self::splat(0.0).sub(self)) }
    }
}

impl Lanes for Row {
    #[inline(always)]
    unsafe fn splat(x: f32) -> Self {
        Row([x; LANES])
    }
    #[inline(always)]
    unsafe fn load(row: &Row) -> Self {
        *row
    }
    #[inline(always)]
    unsafe fn join(four: [Vec4; 4]) -> Self {
        Row(std::array::from_fn(|i| four[i / 4][i % 4]))
    }
    #[inline(always)]
    unsafe fn swap_fours(self) -> Self {
        Row(std::array::from_fn(|i| self.0[i ^ 4]))
    }
    #[inline(always)]
    unsafe fn store(self, row: &mut Row) {
        *row = self;
    }
    #[inline(always)]
    unsafe fn add(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| self.0[i] + o.0[i]))
    }
    #[inline(always)]
    unsafe fn sub(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| self.0[i] - o.0[i]))
    }
    #[inline(always)]
    unsafe fn mul(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| self.0[i] * o.0[i]))
    }
    #[inline(always)]
    unsafe fn div(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| self.0[i] / o.0[i]))
    }
    #[inline(always)]
    unsafe fn sqrt(self) -> Self {
        Row(std::array::from_fn(|i| self.0[i].sqrt()))
    }
    #[inline(always)]
    unsafe fn min(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| {
            if self.0[i] < o.0[i] {
                self.0[i]
            } else {
                o.0[i]
            }
        }))
    }
    #[inline(always)]
    unsafe fn max(self, o: Self) -> Self {
        Row(std::array::from_fn(|i| {
            if self.0[i] > o.0[i] {
                self.0[i]
            } else {
                o.0[i]
            }
        }))
    }
    #[inline(always)]
    unsafe fn lt(self, o: Self) -> u16 {
        (0..LANES).fold(0, |m, i| m | (u16::from(self.0[i] < o.0[i]) << i))
    }
    #[inline(always)]
    unsafe fn le(self, o: Self) -> u16 {
        (0..LANES).fold(0, |m, i| m | (u16::from(self.0[i] <= o.0[i]) << i))
    }
    #[inline(always)]
    unsafe fn select(self, mask: u16, o: Self) -> Self {
        Row(std::array::from_fn(|i| {
            if mask >> i & 1 == 1 {
                self.0[i]
            } else {
                o.0[i]
            }
        }))
    }
    #[inline(always)]
    unsafe fn positive(values: &[f64; 8]) -> u8 {
        (0..8).fold(0, |m, i| m | (u8::from(values[i] > 0.0) << i))
    }
}

/// Asks for an element of a slice before it is needed.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: it changes nothing and faults at no address.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(slice.as_ptr().wrapping_add(at).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, at);
}

#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, Row};
    use glam::Vec4;
    use std::arch::x86_64::*;

    /// One AVX-512 register.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    /// Two AVX registers.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256, __m256);

    macro_rules! binary512 {
        ($name:ident, $intrinsic:ident) => {
            #[inline(always)]
            unsafe fn $name(self, o: Self) -> Self {
                // SAFETY: the caller enabled AVX-512.
                unsafe { Avx512($intrinsic(self.0, o.0)) }
            }
        };
    }

    impl Lanes for Avx512 {
        #[inline(always)]
        unsafe fn splat(x: f32) -> Self {
            // SAFETY: the caller enabled AVX-512.
            unsafe { Avx512(_mm512_set1_ps(x)) }
        }
        #[inline(always)]
        unsafe fn load(row: &Row) -> Self {
            // SAFETY: the caller enabled AVX-512; a row is aligned to 64 bytes.
            unsafe { Avx512(_mm512_load_ps(row.0.as_ptr())) }
        }
        #[inline(always)]
        unsafe fn join([a, b, c, d]: [Vec4; 4]) -> Self {
            // SAFETY: the caller enabled AVX-512.
            unsafe {
                let low = _mm512_castps128_ps512(a.into());
                let low = _mm512_insertf32x4::<1>(low, b.into());
                let low = _mm512_insertf32x4::<2>(low, c.into());
                Avx512(_mm512_insertf32x4::<3>(low, d.into()))
            }
        }
        #[inline(always)]
        unsafe fn swap_fours(self) -> Self {
            // SAFETY: the caller enabled AVX-512.
            unsafe { Avx512(_mm512_shuffle_f32x4::<0b10_11_00_01>(self.0, self.0)) }
        }
        #[inline(always)]
        unsafe fn store(self, row: &mut Row) {
            // SAFETY: the caller enabled AVX-512; a row is aligned to 64 bytes.
            unsafe { _mm512_store_ps(row.0.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        unsafe fn sqrt(self) -> Self {
            // SAFETY: the caller enabled AVX-512.
            unsafe { Avx512(_mm512_sqrt_ps(self.0)) }
        }
        binary512!(add, _mm512_add_ps);
        binary512!(sub, _mm512_sub_ps);
        binary512!(mul, _mm512_mul_ps);
        binary512!(div, _mm512_div_ps);
        binary512!(min, _mm512_min_ps);
        binary512!(max, _mm512_max_ps);
        #[inline(always)]
        unsafe fn lt(self, o: Self) -> u16 {
            // SAFETY: the caller enabled AVX-512.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, o.0) }
        }
        #[inline(always)]
        unsafe fn le(self, o: Self) -> u16 {
            // SAFETY: the caller enabled AVX-512.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, o.0) }
        }
        #[inline(always)]
        unsafe fn select(self, mask: u16, o: Self) -> Self {
            // SAFETY: the caller enabled AVX-512.
            unsafe { Avx512(_mm512_mask_blend_ps(mask, o.0, self.0)) }
        }
        #[inline(always)]
        unsafe fn positive(values: &[f64; 8]) -> u8 {
            // SAFETY: the caller enabled AVX-512; eight values are read.
            unsafe {
                let v = _mm512_loadu_pd(values.as_ptr());
                _mm512_cmp_pd_mask::<_CMP_GT_OQ>(v, _mm512_setzero_pd())
            }
        }
    }

    macro_rules! binary256 {
        ($name:ident, $intrinsic:ident) => {
            #[inline(always)]
            unsafe fn $name(self, o: Self) -> Self {
                // SAFETY: the caller enabled AVX2.
                unsafe { Avx2($intrinsic(self.0, o.0), $intrinsic(self.1, o.1)) }
            }
        };
    }

    macro_rules! compare256 {
        ($name:ident, $predicate:ident) => {
            #[inline(always)]
            unsafe fn $name(self, o: Self) -> u16 {
                // SAFETY: the caller enabled AVX2.
                unsafe {
                    let low = _mm256_movemask_ps(_mm256_cmp_ps::<$predicate>(self.0, o.0));
                    let high = _mm256_movemask_ps(_mm256_cmp_ps::<$predicate>(self.1, o.1));
                    (low | (high << 8)) as u16
                }
            }
        };
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        unsafe fn splat(x: f32) -> Self {
            // SAFETY: the caller enabled AVX2.
            unsafe { Avx2(_mm256_set1_ps(x), _mm256_set1_ps(x)) }
        }
        #[inline(always)]
        unsafe fn load(row: &Row) -> Self {
            // SAFETY: the caller enabled AVX2; a row is aligned to 64 bytes and has 16 values.
            unsafe {
                Avx2(
                    _mm256_load_ps(row.0.as_ptr()),
                    _mm256_load_ps(row.0.as_ptr().add(8)),
                )
            }
        }
        #[inline(always)]
        unsafe fn join([a, b, c, d]: [Vec4; 4]) -> Self {
            // SAFETY: the caller enabled AVX2.
            unsafe {
                Avx2(
                    _mm256_set_m128(b.into(), a.into()),
                    _mm256_set_m128(d.into(), c.into()),
                )
            }
        }
        #[inline(always)]
        unsafe fn swap_fours(self) -> Self {
            // SAFETY: the caller enabled AVX2.
            unsafe {
                Avx2(
                    _mm256_permute2f128_ps::<1>(self.0, self.0),
                    _mm256_permute2f128_ps::<1>(self.1, self.1),
                )
            }
        }
        #[inline(always)]
        unsafe fn store(self, row: &mut Row) {
            // SAFETY: the caller enabled AVX2; a row is aligned to 64 bytes and has 16 values.
            unsafe {
                _mm256_store_ps(row.0.as_mut_ptr(), self.0);
                _mm256_store_ps(row.0.as_mut_ptr().add(8), self.1);
            }
        }
        #[inline(always)]
        unsafe fn sqrt(self) -> Self {
            // SAFETY: the caller enabled AVX2.
            unsafe { Avx2(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
        }
        binary256!(add, _mm256_add_ps);
        binary256!(sub, _mm256_sub_ps);
        binary256!(mul, _mm256_mul_ps);
        binary256!(div, _mm256_div_ps);
        binary256!(min, _mm256_min_ps);
        binary256!(max, _mm256_max_ps);
        compare256!(lt, _CMP_LT_OQ);
        compare256!(le, _CMP_LE_OQ);
        #[inline(always)]
        unsafe fn select(self, mask: u16, o: Self) -> Self {
            // SAFETY: the caller enabled AVX2.
            unsafe {
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let low = _mm256_and_si256(_mm256_set1_epi32(i32::from(mask)), bits);
                let high = _mm256_and_si256(_mm256_set1_epi32(i32::from(mask >> 8)), bits);
                let low = _mm256_castsi256_ps(_mm256_cmpeq_epi32(low, bits));
                let high = _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, bits));
                Avx2(
                    _mm256_blendv_ps(o.0, self.0, low),
                    _mm256_blendv_ps(o.1, self.1, high),
                )
            }
        }
        #[inline(always)]
        unsafe fn positive(values: &[f64; 8]) -> u8 {
            // SAFETY: the caller enabled AVX2; eight values are read.
            unsafe {
                let zero = _mm256_setzero_pd();
                let low = _mm256_loadu_pd(values.as_ptr());
                let high = _mm256_loadu_pd(values.as_ptr().add(4));
                let low = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_GT_OQ>(low, zero));
                let high = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_GT_OQ>(high, zero));
                (low | high << 4) as u8
            }
        }
    }
}

/// Calls a kernel, compiled for the given [`Level`].
///
/// `dispatch!(level => kernel(argument: Type, …) -> Return)`, where `kernel` is an
/// `#[inline(always)] unsafe fn kernel<S: Lanes>(…)`.
macro_rules! dispatch {
    ($level:expr => $kernel:ident($($argument:ident: $type:ty),* $(,)?) $(-> $return:ty)?) => {{
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,popcnt,bmi1,bmi2")]
        unsafe fn avx512($($argument: $type),*) $(-> $return)? {
            // SAFETY: this function enables what the lanes need.
            unsafe { $kernel::<$crate::simd::Avx512>($($argument),*) }
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
        unsafe fn avx2($($argument: $type),*) $(-> $return)? {
            // SAFETY: this function enables what the lanes need.
            unsafe { $kernel::<$crate::simd::Avx2>($($argument),*) }
        }
        match $level {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `detect` saw these features, or a level below them was asked for.
            $crate::simd::Level::Avx512 => unsafe { avx512($($argument),*) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            $crate::simd::Level::Avx2 => unsafe { avx2($($argument),*) },
            // SAFETY: plain arrays need no features.
            _ => unsafe { $kernel::<$crate::simd::Row>($($argument),*) },
        }
    }};
}
pub(crate) use dispatch;
