//! A global allocator that remembers the most bytes that were in use at a time.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

struct Peak {
    now: AtomicUsize,
    most: AtomicUsize,
}

#[global_allocator]
static PEAK: Peak = Peak { now: AtomicUsize::new(0), most: AtomicUsize::new(0) };

// SAFETY: all of the work is the system allocator's; the counters only watch.
unsafe impl GlobalAlloc for Peak {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = self.now.fetch_add(layout.size(), Relaxed) + layout.size();
        self.most.fetch_max(now, Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let now = self.now.fetch_add(layout.size(), Relaxed) + layout.size();
        self.most.fetch_max(now, Relaxed);
        // SAFETY: the caller keeps the contract of `alloc_zeroed`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        self.now.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Runs `work`; returns its result, and by how many bytes memory in use grew meanwhile at most.
///
/// Other threads count as well: one measurement at a time.
pub fn measure<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = PEAK.now.load(Relaxed);
    PEAK.most.store(before, Relaxed);
    let result = work();
    (result, PEAK.most.load(Relaxed).saturating_sub(before))
}
