//! Memory of whole images, touched in parallel and once; and whether there is as much as something takes.
//!
//! Rust ends the process where a vector cannot grow. So large jobs ask for all that they are going to take in one
//! piece first ([`check`]), and what an estimate has missed comes out of a reserve: the allocator of the bindings
//! gives it up and notes so (`set_exhausted`), and kernels stop at their next step.

use std::cell::Cell;
use std::mem::{ManuallyDrop, MaybeUninit};
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};

/// Whether the reserve had to be given up.
static EXHAUSTED: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Whether this thread only asks whether there is memory.
    static ASKING: Cell<bool> = const { Cell::new(false) };
}

/// Says that memory has run out, or that there is some again.
#[cfg(feature = "python")]
pub(crate) fn set_exhausted(exhausted: bool) {
    EXHAUSTED.store(exhausted, Ordering::Relaxed);
}

/// Whether memory has run out.
pub(crate) fn exhausted() -> bool {
    EXHAUSTED.load(Ordering::Relaxed)
}

/// Whether a piece that this thread is refused may do without the reserve.
#[cfg(feature = "python")]
pub(crate) fn asking() -> bool {
    ASKING.get()
}

/// Asks for all of what something takes at once.
///
/// # Errors
/// More than the address space or, as far as the system tells, the machine has left.
pub(crate) fn check(what: impl FnOnce() -> String, bytes: usize) -> Result<()> {
    ASKING.set(true);
    let there = Vec::<u8>::new().try_reserve_exact(bytes).is_ok();
    ASKING.set(false);
    if there && (bytes < LARGE || available().is_none_or(|most| bytes <= most)) {
        return Ok(());
    }
    let what = what();
    Err(Error::Memory { what, bytes })
}

/// Bytes below which the system is not asked for what it has left, which takes tens of microseconds.
const LARGE: usize = 1 << 26;

/// Bytes that the machine can give without swapping, and the group of processes that this one is in may take.
fn available() -> Option<usize> {
    let text = |path: &str| std::fs::read_to_string(path).ok();
    let number = |path: &str| text(path)?.trim().parse::<usize>().ok();
    let machine = text("/proc/meminfo")?
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))
        .and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<usize>().ok())?
        .saturating_mul(1024);
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(most, taken)| most.saturating_sub(taken));
    Some(group.map_or(machine, |group| group.min(machine)))
}

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
    fn what_no_machine_has_is_an_error_that_says_how_much_it_is() {
        assert!(check(|| "a map".into(), 1 << 20).is_ok());
        let error = check(|| "a map".into(), 1 << 60).unwrap_err();
        assert!(error.to_string().contains("a map takes 1152921504.6 GB"));
        if let Some(most) = available() {
            // Ten times as much address space is there, and no memory behind it.
            assert!(check(String::new, most.saturating_mul(10)).is_err());
        }
    }

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
