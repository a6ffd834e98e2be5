//! Memory that is kept between frames.

use std::alloc::{GlobalAlloc, Layout, System};

use mimalloc::MiMalloc;

/// Bytes from which the system allocates: it refuses what the machine has not, which mimalloc would only find
/// out when the memory is touched. Kernels ask for what they are going to need in one piece first.
const LARGE: usize = 1 << 28;

/// mimalloc, and the system's allocator for large pieces.
///
/// The system's allocator gives the arrays of an image back at once, and the next frame pays for new pages.
pub(super) struct Allocator;

impl Allocator {
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
        unsafe { Self::of(layout).alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        unsafe { Self::of(layout).alloc_zeroed(layout) }
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
                return from.realloc(pointer, layout, size);
            }
            let moved = to.alloc(new);
            if !moved.is_null() {
                std::ptr::copy_nonoverlapping(pointer, moved, layout.size().min(size));
                from.dealloc(pointer, layout);
            }
            moved
        }
    }
}
