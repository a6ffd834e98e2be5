//! Memory of whole images: touched in parallel, and once.

use std::mem::{ManuallyDrop, MaybeUninit};

use rayon::prelude::*;

/// A vector whose memory all threads touch first, so that the system clears its pages in parallel.
pub(crate) fn filled<T: Clone + Send>(value: T, len: usize) -> Vec<T> {
    rayon::iter::repeat_n(value, len).collect()
}

/// Memory for so many values, none of which is written yet.
pub(crate) fn unwritten<T: Copy>(len: usize) -> Vec<MaybeUninit<T>> {
    let mut out = Vec::with_capacity(len);
    // SAFETY: the capacity is there, and `MaybeUninit` needs no value.
    unsafe { out.set_len(len) };
    out
}

/// Writes one value to all of a part.
pub(crate) fn fill<T: Copy>(part: &mut [MaybeUninit<T>], value: T) -> &mut [T] {
    for place in &mut *part {
        place.write(value);
    }
    // SAFETY: all of it was just written, and `MaybeUninit<T>` is laid out as `T`.
    unsafe { &mut *(std::ptr::from_mut(part) as *mut [T]) }
}

/// The values of memory that was written.
///
/// # Safety
/// Every value was written.
pub(crate) unsafe fn written<T: Copy>(values: Vec<MaybeUninit<T>>) -> Vec<T> {
    let mut values = ManuallyDrop::new(values);
    let (at, len, capacity) = (values.as_mut_ptr(), values.len(), values.capacity());
    // SAFETY: the allocation is the vector's own, of values laid out as `T`, and the caller wrote them.
    unsafe { Vec::from_raw_parts(at.cast(), len, capacity) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_are_filled_make_up_the_vector() {
        let mut values = unwritten(1000);
        values
            .par_chunks_mut(300)
            .enumerate()
            .for_each(|(i, part)| {
                let part = fill(part, -1.0);
                part[i] = i as f64;
            });
        // SAFETY: all parts were filled.
        let values = unsafe { written(values) };
        assert_eq!(values.len(), 1000);
        for (i, value) in values.into_iter().enumerate() {
            let expected = if i % 300 == i / 300 {
                (i / 300) as f64
            } else {
                -1.0
            };
            assert_eq!(value, expected, "{i}");
        }
        // SAFETY: there are none.
        assert!(unsafe { written(unwritten::<bool>(0)) }.is_empty());
    }
}
