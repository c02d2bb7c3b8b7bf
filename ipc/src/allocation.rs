//! Heap allocations, counted per thread, to verify that a stage makes none while it processes a frame.
//!
//! iceoryx2 allocates a block of 48 bytes for each loaned message and frees it when the message is sent. A thread that
//! has called [`keep_small_blocks`] therefore caches the few small blocks that it frees and reuses them without the
//! heap: no lock, no search, no system call.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr;

/// The system's allocator with a count of allocations. Counting costs about a nanosecond and is always on, so that
/// every report states the number of allocations of its frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct CountingAllocator;

/// Maximum number of blocks in the cache of a thread.
const MAX_KEPT: usize = 16;

/// Layout of all small blocks: sizes are rounded up to it, so that blocks are interchangeable.
const SMALL: Layout = match Layout::from_size_align(64, 16) {
    Ok(layout) => layout,
    Err(_) => panic!("16 is a power of two"),
};

/// Whether a block is small: it fits [`SMALL`] and uses more than half of it.
fn is_small(layout: Layout) -> bool {
    (33..=SMALL.size()).contains(&layout.size()) && layout.align() <= SMALL.align()
}

/// Count and cache of one thread.
struct Local {
    count: Cell<u64>,
    /// Whether freed small blocks are cached.
    keeps: Cell<bool>,
    /// Number of cached blocks.
    kept: Cell<usize>,
    blocks: [Cell<*mut u8>; MAX_KEPT],
}

thread_local! {
    // Constant and without a destructor, so that its first use does not allocate.
    static LOCAL: Local = const {
        Local {
            count: Cell::new(0),
            keeps: Cell::new(false),
            kept: Cell::new(0),
            blocks: [const { Cell::new(ptr::null_mut()) }; MAX_KEPT],
        }
    };
}

impl Local {
    fn take(&self) -> Option<*mut u8> {
        let last = self.kept.get().checked_sub(1)?;
        self.kept.set(last);
        Some(self.blocks[last].get())
    }

    fn keep(&self, pointer: *mut u8) -> bool {
        let next = self.kept.get();
        let fits = self.keeps.get() && next < MAX_KEPT;
        if fits {
            self.blocks[next].set(pointer);
            self.kept.set(next + 1);
        }
        fits
    }
}

// A thread that is ending may have no thread-local storage any more. It then uses the heap directly, uncounted.

fn count() {
    let _ = LOCAL.try_with(|local| local.count.set(local.count.get().wrapping_add(1)));
}

fn take() -> Option<*mut u8> {
    LOCAL.try_with(Local::take).ok().flatten()
}

fn keep(pointer: *mut u8) -> bool {
    LOCAL.try_with(|local| local.keep(pointer)).unwrap_or(false)
}

/// Number of heap allocations of this thread so far, including reallocations. 0 if [`CountingAllocator`] is not the
/// global allocator of the program.
pub fn by_this_thread() -> u64 {
    LOCAL.try_with(|local| local.count.get()).unwrap_or(0)
}

/// Makes this thread cache up to 16 freed blocks of 33 to 64 bytes for reuse. It is meant for threads that live as
/// long as their process: cached blocks are not freed when the thread ends.
pub fn keep_small_blocks() {
    let _ = LOCAL.try_with(|local| local.keeps.set(true));
}

// SAFETY: a block comes either from the system's allocator, which allocates and frees it with the same layout (rounded
// up to SMALL where `is_small` holds, which depends on the layout alone), or from the cache of this thread: it was freed
// before, has SMALL's size and alignment, and is in the cache once. No other code here uses the heap, and nothing
// unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let small = is_small(layout);
        if let (true, Some(pointer)) = (small, take()) {
            return pointer;
        }
        count();
        // SAFETY: the layout is the caller's, whose size is not zero, or SMALL, which is larger.
        unsafe { System.alloc(if small { SMALL } else { layout }) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let small = is_small(layout);
        if let (true, Some(pointer)) = (small, take()) {
            // SAFETY: the block has the size of SMALL, and the cache has just given up its only pointer to it.
            unsafe { pointer.write_bytes(0, SMALL.size()) };
            return pointer;
        }
        count();
        // SAFETY: as in `alloc`.
        unsafe { System.alloc_zeroed(if small { SMALL } else { layout }) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the contract of `realloc` requires that size and alignment form a valid layout.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        match (is_small(layout), is_small(new)) {
            (true, true) => pointer,
            (false, false) => {
                count();
                // SAFETY: the block is not small, so the system has allocated it with this layout.
                unsafe { System.realloc(pointer, layout, size) }
            }
            _ => {
                // SAFETY: the size of `new` is not zero; both blocks are at least as long as the copied bytes, and
                // they do not overlap because both are allocated.
                unsafe {
                    let moved = self.alloc(new);
                    if !moved.is_null() {
                        moved.copy_from_nonoverlapping(pointer, layout.size().min(size));
                        self.dealloc(pointer, layout);
                    }
                    moved
                }
            }
        }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        let small = is_small(layout);
        if small && keep(pointer) {
            return;
        }
        // SAFETY: the system has allocated the block with this layout.
        unsafe { System.dealloc(pointer, if small { SMALL } else { layout }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    #[global_allocator]
    static ALLOCATOR: CountingAllocator = CountingAllocator;

    #[test]
    fn new_memory_is_counted_and_old_memory_is_not() {
        let before = by_this_thread();
        let mut numbers: Vec<u64> = Vec::with_capacity(16);
        assert_eq!(by_this_thread() - before, 1);
        numbers.extend(0..16);
        numbers.clear();
        numbers.extend(0..16);
        assert_eq!(by_this_thread() - before, 1, "the capacity is reused");
        numbers.push(9);
        assert_eq!(by_this_thread() - before, 2, "it grew");
        // Each thread has its own count.
        let other = std::thread::spawn(|| {
            let before = by_this_thread();
            black_box(vec![0_u8; 100]);
            by_this_thread() - before
        });
        assert_eq!(other.join().unwrap(), 1);
    }

    #[test]
    fn a_thread_caches_small_blocks_on_request() {
        std::thread::spawn(|| {
            let rounds = || {
                let before = by_this_thread();
                (0..1000_u64).for_each(|i| drop(black_box(Box::new([i; 6]))));
                by_this_thread() - before
            };
            assert_eq!(rounds(), 1000, "48 bytes each");
            keep_small_blocks();
            assert_eq!(rounds(), 1, "the first block is cached and reused");
            assert_eq!(rounds(), 0);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn blocks_keep_their_content_over_random_allocations_and_reallocations() {
        for seed in 0..4 {
            let run = move || {
                keep_small_blocks();
                let mut random = fastrand::Rng::with_seed(seed);
                let mut held: Vec<Vec<u8>> = Vec::new();
                for round in 0..20_000_u32 {
                    match random.u8(..4) {
                        0 => held.push(vec![0; random.usize(1..150)]),
                        1 => held.push((0..random.u8(1..150)).collect()),
                        2 if !held.is_empty() => {
                            // Grows or shrinks across the limits of small blocks.
                            let place = random.usize(..held.len());
                            let bytes = &mut held[place];
                            let (rising, length) = (bytes.last() != Some(&0), random.usize(1..150));
                            let next = bytes.len();
                            bytes.truncate(length);
                            bytes.shrink_to_fit();
                            bytes.extend((next..length).map(|i| if rising { i as u8 } else { 0 }));
                        }
                        _ if !held.is_empty() => drop(held.swap_remove(random.usize(..held.len()))),
                        _ => {}
                    }
                    if held.len() > 60 {
                        held.truncate(20);
                    }
                    if round % 64 == 0 {
                        for bytes in &held {
                            let rising = bytes.iter().enumerate().all(|(i, &b)| b == i as u8);
                            assert!(rising || bytes.iter().all(|&b| b == 0), "seed {seed}: {bytes:?}");
                        }
                    }
                }
            };
            std::thread::spawn(run).join().unwrap();
        }
    }
}
