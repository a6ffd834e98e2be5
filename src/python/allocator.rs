//! Memory that is kept between frames, and a reserve for when there is no more.

use std::alloc::{GlobalAlloc, Layout, System};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};

use mimalloc::MiMalloc;

use crate::memory;

/// Bytes from which the system allocates: it refuses what the machine has not, which mimalloc would only find
/// out when the memory is touched. Kernels ask for what they are going to need in one piece first.
const LARGE: usize = 1 << 28;

/// Bytes of the reserve: address space only, no page of it is ever touched. mimalloc takes pieces of 32 MiB, and twice
/// that where they do not come aligned.
const RESERVE: usize = 1 << 27;

/// The reserve, if there is one, and its bytes.
static PIECE: AtomicPtr<u8> = AtomicPtr::new(null_mut());
static BYTES: AtomicUsize = AtomicUsize::new(0);

fn reserve_layout(bytes: usize) -> Layout {
    Layout::from_size_align(bytes, 16).expect("a power of two")
}

/// Takes the reserve, or as much as there is of it; memory then counts as there.
pub(super) fn take_reserve() {
    memory::set_exhausted(false);
    if !PIECE.load(Ordering::Acquire).is_null() {
        return;
    }
    let mut bytes = RESERVE;
    while bytes >= RESERVE / 8 {
        // SAFETY: the size is not zero.
        let piece = unsafe { System.alloc(reserve_layout(bytes)) };
        if !piece.is_null() {
            let empty =
                PIECE.compare_exchange(null_mut(), piece, Ordering::AcqRel, Ordering::Acquire);
            match empty {
                Ok(_) => BYTES.store(bytes, Ordering::Release),
                // SAFETY: just allocated so; another thread was faster.
                Err(_) => unsafe { System.dealloc(piece, reserve_layout(bytes)) },
            }
            return;
        }
        bytes /= 2;
    }
}

/// Gives the reserve up; whether there was one.
fn give_up() -> bool {
    let piece = PIECE.swap(null_mut(), Ordering::AcqRel);
    if piece.is_null() {
        // Whoever gave it up did so for all.
        return memory::exhausted();
    }
    // SAFETY: `take_reserve` allocated it with this layout, and nobody else has it any more.
    unsafe { System.dealloc(piece, reserve_layout(BYTES.load(Ordering::Acquire))) };
    true
}

/// mimalloc, and the system's allocator for large pieces.
///
/// The system's allocator gives the arrays of an image back at once, and the next frame pays for new pages.
pub(super) struct Allocator;

impl Allocator {
    /// Tries once more with the reserve given up; the kernels stop at their next step.
    fn retry(layout: Layout, allocate: impl Fn() -> *mut u8) -> *mut u8 {
        let first = allocate();
        if !first.is_null() || memory::asking() || !give_up() {
            return first;
        }
        memory::set_exhausted(true);
        // A piece that would take most of the reserve is refused, which libraries answer with a panic.
        if layout.size() > RESERVE / 2 {
            return first;
        }
        allocate()
    }

    fn of(layout: Layout) -> &'static dyn GlobalAlloc {
        if layout.size() < LARGE {
            &MiMalloc
        } else {
            &System
        }
    }
}

// SAFETY: the layout tells which of two allocators has a piece.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        Self::retry(layout, || unsafe { Self::of(layout).alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        Self::retry(layout, || unsafe { Self::of(layout).alloc_zeroed(layout) })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise; the same layout goes to the same allocator.
        unsafe { Self::of(layout).dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller promises that the size, rounded up to the alignment, does not overflow.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        let (from, to) = (Self::of(layout), Self::of(new));
        // SAFETY: the caller's promise; pieces of one allocator stay with it.
        unsafe {
            if (layout.size() < LARGE) == (size < LARGE) {
                // What is refused leaves the old piece as it was.
                return Self::retry(new, || from.realloc(pointer, layout, size));
            }
            let moved = Self::retry(new, || to.alloc(new));
            if !moved.is_null() {
                std::ptr::copy_nonoverlapping(pointer, moved, layout.size().min(size));
                from.dealloc(pointer, layout);
            }
            moved
        }
    }
}
