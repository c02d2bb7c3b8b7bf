//! Heap allocations, counted by thread: proof that a stage makes none for a frame.
//!
//! The transport makes a piece of 48 bytes for each message that is loaned, inside the library, and frees it
//! when the message is sent. A thread that asks for it ([`keep_small_pieces`]) therefore keeps the few
//! such pieces that it frees, and gets them back without the heap: no lock, no search, no system call.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr;

/// The system's allocator, which counts. The count costs about a nanosecond and is always on, so that
/// every report tells what its frame has allocated.
#[derive(Clone, Copy, Debug, Default)]
pub struct CountingAllocator;

/// Pieces that a thread keeps.
const KEPT: usize = 16;

/// What small pieces are rounded up to, so that each can be used for any other.
const SMALL: Layout = match Layout::from_size_align(64, 16) {
    Ok(layout) => layout,
    Err(_) => panic!("16 is a power of two"),
};

/// Whether a piece is one that is kept: more than half of it is used.
fn is_small(layout: Layout) -> bool {
    (33..=SMALL.size()).contains(&layout.size()) && layout.align() <= SMALL.align()
}

/// What one thread knows.
struct Local {
    count: Cell<u64>,
    keeps: Cell<bool>,
    kept: Cell<usize>,
    pieces: [Cell<*mut u8>; KEPT],
}

thread_local! {
    // Constant and without a destructor: to use it allocates nothing.
    static LOCAL: Local = const {
        Local {
            count: Cell::new(0),
            keeps: Cell::new(false),
            kept: Cell::new(0),
            pieces: [const { Cell::new(ptr::null_mut()) }; KEPT],
        }
    };
}

impl Local {
    fn take(&self) -> Option<*mut u8> {
        let last = self.kept.get().checked_sub(1)?;
        self.kept.set(last);
        Some(self.pieces[last].get())
    }

    fn keep(&self, pointer: *mut u8) -> bool {
        let next = self.kept.get();
        let fits = self.keeps.get() && next < KEPT;
        if fits {
            self.pieces[next].set(pointer);
            self.kept.set(next + 1);
        }
        fits
    }
}

// A thread that is ending has nothing local any more: it goes straight to the heap, uncounted.

fn count() {
    let _ = LOCAL.try_with(|local| local.count.set(local.count.get().wrapping_add(1)));
}

fn take() -> Option<*mut u8> {
    LOCAL.try_with(Local::take).ok().flatten()
}

fn keep(pointer: *mut u8) -> bool {
    LOCAL.try_with(|local| local.keep(pointer)).unwrap_or(false)
}

/// Memory that this thread has asked the heap for so far: each new piece and each that grew or shrank. 0
/// where [`CountingAllocator`] is not the program's allocator.
pub fn by_this_thread() -> u64 {
    LOCAL.try_with(|local| local.count.get()).unwrap_or(0)
}

/// From now on this thread keeps up to 16 pieces of 33 to 64 bytes that it frees, for its own use. For
/// threads that live as long as their process: what they keep is not given back.
pub fn keep_small_pieces() {
    let _ = LOCAL.try_with(|local| local.keeps.set(true));
}

// SAFETY: a piece is either the system's, asked for and given back with the same layout (rounded up to
// SMALL where `is_small` says so, which depends on the layout alone), or one of those that this thread
// keeps: freed before, of SMALL's size and alignment, and in one place only. Nothing here touches the heap
// otherwise, and nothing unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let small = is_small(layout);
        if let (true, Some(pointer)) = (small, take()) {
            return pointer;
        }
        count();
        // SAFETY: the layout is the caller's, whose size is not zero, or a larger one.
        unsafe { System.alloc(if small { SMALL } else { layout }) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let small = is_small(layout);
        if let (true, Some(pointer)) = (small, take()) {
            // SAFETY: the piece is as long as SMALL, and nobody else has it.
            unsafe { pointer.write_bytes(0, SMALL.size()) };
            return pointer;
        }
        count();
        // SAFETY: as in `alloc`.
        unsafe { System.alloc_zeroed(if small { SMALL } else { layout }) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller keeps size and alignment within what a layout may be.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        match (is_small(layout), is_small(new)) {
            (true, true) => pointer,
            (false, false) => {
                count();
                // SAFETY: the piece is the system's, with this very layout.
                unsafe { System.realloc(pointer, layout, size) }
            }
            _ => {
                // SAFETY: `new` is not empty; both pieces hold what is copied, and do not overlap.
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
        // SAFETY: the piece is the system's, with this layout.
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
        assert_eq!(by_this_thread() - before, 1, "what is there is used again");
        numbers.push(9);
        assert_eq!(by_this_thread() - before, 2, "it grew");
        // Other threads have counts of their own.
        let other = std::thread::spawn(|| {
            let before = by_this_thread();
            black_box(vec![0_u8; 100]);
            by_this_thread() - before
        });
        assert_eq!(other.join().unwrap(), 1);
    }

    #[test]
    fn small_pieces_are_kept_by_a_thread_that_wants_to() {
        std::thread::spawn(|| {
            let rounds = || {
                let before = by_this_thread();
                (0..1000_u64).for_each(|i| drop(black_box(Box::new([i; 6]))));
                by_this_thread() - before
            };
            assert_eq!(rounds(), 1000, "48 bytes each");
            keep_small_pieces();
            assert_eq!(rounds(), 1, "the first is freed, kept, and used again");
            assert_eq!(rounds(), 0);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn whatever_is_asked_for_freed_and_moved_keeps_its_content() {
        for seed in 0..4 {
            let run = move || {
                keep_small_pieces();
                let mut random = fastrand::Rng::with_seed(seed);
                let mut held: Vec<Vec<u8>> = Vec::new();
                for round in 0..20_000_u32 {
                    match random.u8(..4) {
                        0 => held.push(vec![0; random.usize(1..150)]),
                        1 => held.push((0..random.u8(1..150)).collect()),
                        2 if !held.is_empty() => {
                            // Grows or shrinks over all sizes, small and not.
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
